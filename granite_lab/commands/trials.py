"""`granite-lab fit-k92`, `fit-atheta`, `compare`, `study`, `discover`: the model held against trials."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands import options as o
from granite_lab.commands.printing import (
    console,
    print_json,
    progress,
    show,
    warn,
    warn_of,
)
from granite_lab.errors import LabError, UsageError

if TYPE_CHECKING:
    from granite_lab.api.records import Origin

Table = Annotated[Path | None, typer.Option(help="Write the table here, too (CSV).")]

MOST = 20
"""Differences that are printed."""


@o.spread
def fit_k92(
    trials: o.Trials = None,
    model: o.Model = None,
    out: Table = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Print the notes of the fits.")] = False,
    *,
    work: o.Work,
) -> None:
    """Fit k_92 of each trial.

    By the steady slip ratio, as in the paper, and by the whole trajectory.
    """
    from granite_lab.api.trials import fit_k92 as run

    with progress(work.quiet, "fitting") as shown:
        fits = run(trials or [], model=model, done=shown.done, **work.said())
    from granite_lab.files import write_text
    from granite_lab.reporting.json_report import k92_as_json
    from granite_lab.reporting.tables import k92_table
    from granite_lab.reporting.terminal import show_k92_fits

    excluded = warn_of(fits.origin)
    if out is not None:
        write_text(out, k92_table(list(fits)).to_csv())
    if work.as_json:
        rows = [
            {"trial": fit.trial, "virtual": fit.virtual, "speed_mps": fit.variant.velocity}
            | {"slip_ratio": fit.slip_measured.as_json()}
            | k92_as_json(fit)
            for fit in fits
        ]
        document = {"fits": rows, "provenance": _provenance(fits.origin)}
        print_json({"schema": "granite-lab/fit-k92/2"} | document | excluded)
    else:
        show_k92_fits(list(fits), console(), notes=verbose)


def _provenance(origin: Origin, command: str = "") -> dict[str, Any]:
    """Return where results come from, as it stands in JSON."""
    from granite_lab.reporting.json_report import provenance_as_json

    assert origin.source is not None
    said = origin.source.command
    return provenance_as_json(
        replace(origin.source, command=said.replace("fit-k92", command, 1) if command else said)
    )


@o.spread
def fit_atheta(
    trials: o.Trials = None,
    published: Annotated[bool, typer.Option("--published", help="Use Table 3 of the paper.")] = False,
    model: o.Model = None,
    out: Table = None,
    *,
    work: o.Work,
) -> None:
    """Estimate a_θ of k_92 = exp(-a_θ v).

    The result is compared with the paper's 4.919 s/m and with other laws.
    """
    if published and trials:
        raise UsageError("--published takes no trials", "leave out one of the two")
    from granite_lab.api.trials import fit_a_theta
    from granite_lab.api.trials import fit_k92 as run

    origin: dict[str, Any] = {"provenance": None}
    if published:
        fit = fit_a_theta(published=True)
    else:
        with progress(work.quiet, "fitting") as shown:
            fits = run(trials or [], model=model, done=shown.done, **work.said())
        origin = warn_of(fits.origin) | {"provenance": _provenance(fits.origin, "fit-atheta")}
        fit = fit_a_theta(list(fits))
    from granite_lab.files import write_table
    from granite_lab.reporting.answers import a_theta_of
    from granite_lab.reporting.grid import say
    from granite_lab.reporting.json_report import a_theta_as_json
    from granite_lab.reporting.terminal import show_a_theta

    if out is not None:
        table = fit.to_frame()
        write_table(out, table.assign(data="virtual") if fit.virtual else table)
    if work.as_json:
        judged = {"agrees": a_theta_of(fit)[1]}
        print_json({"schema": "granite-lab/fit-atheta/2"} | (a_theta_as_json(fit) or {}) | judged | origin)
    else:
        show_a_theta(fit, console())
        what = "Rows of Table 3" if published else "Virtual trials" if fit.virtual else "Trials"
        say(console(), f"{what}: {', '.join(point[0] for point in fit.points)}.")


@o.spread
def compare(
    trials: o.Trials = None,
    model: o.Model = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for tables and figures.", show_default="reports/compare")
    ] = None,
    *,
    work: o.Work,
) -> None:
    """Compare measured and simulated motion.

    Velocity, wheel speed, slip, torques and pitch.
    """
    from granite_lab.api.project import choose
    from granite_lab.api.trials import compare as run

    logs, said = trials or [], work.said()
    out = out or choose(logs, said).out / "compare"
    with progress(work.quiet, "fitting") as shown:
        found = run(logs, out=out, model=model, done=shown.done, **said)
    excluded = warn_of(found.origin)
    if work.as_json:
        rows = [
            {
                "trial": c.motion.trial,
                "virtual": c.motion.virtual,
                "variant_mps": c.fit.variant.velocity,
                "misfits": c.misfits,
            }
            for c in found
        ]
        document = {"trials": rows, "files": found.origin.written, "provenance": _provenance(found.origin)}
        print_json({"schema": "granite-lab/compare/1"} | document | excluded)
    else:
        from granite_lab.reporting.terminal import show_misfits

        show_misfits(list(found), console())
        show(f"figures and tables: {out}")


@o.spread
def study(
    trials: o.Trials = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the report; its name is the report's name.", show_default="reports/study"
        ),
    ] = None,
    model: o.Model = None,
    recordings: Annotated[bool, typer.Option(help="Write a Rerun recording of each trial.")] = True,
    discover: Annotated[bool, typer.Option(help="Search for an effect that the model lacks.")] = True,
    check: Annotated[
        Path | None,
        typer.Option("--verify", metavar="REPORT", help="Compute a report again and print the differences."),
    ] = None,
    *,
    work: o.Search,
) -> None:
    """Analyse trials and write a report.

    All steps, from logs to the report and recordings.
    """
    if check is not None:
        _verify(check, trials or [], work)
        return
    from granite_lab.api.project import choose
    from granite_lab.api.trials import studied
    from granite_lab.running.output import tell

    logs = trials or []
    said = work.said() | {"model": model}
    out = out or choose(logs, said).out / "study"
    with progress(work.quiet, "trials") as shown:
        said |= {"done": shown.done, "progress": shown.told}
        found = studied(logs, out, "study", discover, recordings, said)
    result, written = found.result, found.written
    assert written is not None
    warn_of(found.origin)
    finding = result.finding
    if work.as_json:
        from granite_lab.discovery.as_json import finding_as_json

        print_json(
            {
                "schema": "granite-lab/study/1",
                "report": written.page,
                "unchanged": found.unchanged,
                "trials": len(result.trials),
                "failures": result.failures,
                "a_theta": result.a_theta.a_theta if result.a_theta else None,
                "discovery": finding_as_json(finding, written.model) if finding is not None else None,
            }
        )
    else:
        from granite_lab.reporting.terminal import show_study

        show_study(result, console(), str(out), written.model.name if written.model else None)
        if written.page is not None:
            kept = " (unchanged: logs, options and code are those it was written from)"
            show(f"report: {written.page}{kept if found.unchanged else ''}")
    tell([*(finding.failures if finding is not None else ()), *written.failures])


def _verify(report: Path, logs: list[Path], work: o.Work) -> None:
    from granite_lab.running import Execution
    from granite_lab.verify import verify

    with progress(work.quiet, "computing again") as shown:
        execution = Execution(work.jobs, work.scheduler)
        found = verify(report, logs, execution=execution, done=shown.done, progress=shown.told)
    warn(found.notes)
    if work.as_json:
        same = not found.differences
        print_json({"schema": "granite-lab/verify/1", "same": same} | vars(found))
    elif not found.differences:
        show(
            f"{found.report}: identical, recomputed from {found.trials} log{'s' if found.trials > 1 else ''}"
        )
    else:
        for line in found.differences[:MOST]:
            show(line)
        if len(found.differences) > MOST:
            show(f"and {len(found.differences) - MOST} more differences; --json lists all")
    if found.differences:
        raise LabError(
            f"{found.report}: differs in {len(found.differences)} places when computed again",
            "an input, the version or a library has changed, or the report was edited",
        )


def compare_studies(
    first: Annotated[Path, typer.Argument(metavar="A", help="Folder written by `study`.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Folder of the other study.")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a page, a figure and a table into this folder.")
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Compare two studies.

    For example of sand A and B, or before and after a change.
    """
    from granite_lab.reporting.two_studies import compare_studies as run

    found = run(first, second)
    from granite_lab.reporting import write_compared
    from granite_lab.reporting.grid import say, show_table
    from granite_lab.reporting.two_studies import compared_as_json, compared_table

    page = write_compared(found, out) if out is not None else None
    if as_json:
        print_json(compared_as_json(found) | {"page": page})
        return
    shown = console()
    say(shown, f"A: {found.names[0]}; B: {found.names[1]}")
    show_table(
        compared_table(found), shown, only=("quantity", "unit", "B − A, 95 %", "detectable", "verdict")
    )
    say(shown, "B − A: 95 % interval. Detectable: difference that is found with a probability of 80 %.")
    for note in found.notes:
        say(shown, note)
    if page is not None:
        show(f"page: {page}")


@o.spread
def discover(
    trials: o.Trials = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the report, finding.json and model.toml.", show_default="reports/discover"
        ),
    ] = None,
    *,
    work: o.Search,
) -> None:
    """Find the effect that the model lacks.

    Writes a report, finding.json and the corrected model.toml.
    """
    from granite_lab.api.project import choose
    from granite_lab.api.search import discovered
    from granite_lab.running.output import tell

    logs = trials or []
    said = work.said()
    out = out or choose(logs, said).out / "discover"
    with progress(work.quiet, "discovering") as shown:
        found = discovered(logs, out, said | {"progress": shown.told})
    finding, written, excluded = found.result.finding, found.written, warn_of(found.origin)
    assert written is not None
    assert finding is not None
    if work.as_json:
        from granite_lab.discovery.as_json import finding_as_json

        print_json(finding_as_json(finding, written.model) | excluded)
    else:
        from granite_lab.reporting.terminal import show_finding

        show_finding(finding, console(), str(out), written.model)
        for what, path in (("report", written.page), ("model with what was found", written.model)):
            if path is not None:
                show(f"{what}: {path}")
    tell(finding.failures)
