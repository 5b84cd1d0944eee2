"""`granite-lab fit-k92`, `fit-atheta`, `compare`, `study`, `discover`: the model held against trials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.api import search as searches
from granite_lab.api import trials as api
from granite_lab.api.records import Origin, Records, Studied
from granite_lab.commands.command import Call, Output, command
from granite_lab.commands.options import Flag, Table
from granite_lab.commands.printing import show, warn, warn_of
from granite_lab.errors import LabError
from granite_lab.reporting import two_studies
from granite_lab.running import Execution
from granite_lab.running.output import trouble

if TYPE_CHECKING:
    from rich.console import Console

    from granite_lab.comparison.record import Comparison
    from granite_lab.fitting.fit import AThetaFit, K92Fit
    from granite_lab.verify import Verification

MOST = 20
"""Differences that are printed."""


def _folder(default: str, text: str) -> Flag:
    return Flag(help=text, shown=default)


def _origin(origin: Origin) -> dict[str, Any]:
    """Warn of what there is to know, and return where results come from, as it stands in JSON."""
    from granite_lab.reporting.json_report import provenance_as_json

    excluded = warn_of(origin)
    return {"provenance": provenance_as_json(origin.source) if origin.source else None} | excluded


@command(api.fit_k92, busy="fitting")
def fit_k92(
    call: Call[Records[K92Fit]],
    out: Table = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Print the notes of the fits.")] = False,
) -> Output:
    """Fits that need a remark are marked; --verbose lists the remarks."""
    fits = call()
    from granite_lab.files import write_text
    from granite_lab.reporting.json_report import k92_as_json
    from granite_lab.reporting.tables import k92_table
    from granite_lab.reporting.terminal import show_k92_fits

    if out is not None:
        write_text(out, k92_table(list(fits)).to_csv())
    rows = [
        {"trial": fit.trial, "virtual": fit.virtual, "speed_mps": fit.variant.velocity}
        | {"slip_ratio": fit.slip_measured.as_json()}
        | k92_as_json(fit)
        for fit in fits
    ]
    return Output(
        "fit-k92/2",
        {"fits": rows} | _origin(fits.origin),
        lambda shown: show_k92_fits(list(fits), shown, notes=verbose),
    )


@command(api.fit_a_theta, run=api.a_theta_of, busy="fitting")
def fit_atheta(call: Call[tuple[AThetaFit, Origin]], out: Table = None) -> Output:
    """A verdict needs three speeds."""
    fit, origin = call()
    from granite_lab.files import write_table
    from granite_lab.reporting.answers import a_theta_of
    from granite_lab.reporting.grid import say
    from granite_lab.reporting.json_report import a_theta_as_json
    from granite_lab.reporting.terminal import show_a_theta

    if out is not None:
        table = fit.to_frame()
        write_table(out, table.assign(data="virtual") if fit.virtual else table)

    def text(shown: Console) -> None:
        show_a_theta(fit, shown)
        what = "Rows of Table 3" if origin.source is None else "Virtual trials" if fit.virtual else "Trials"
        say(shown, f"{what}: {', '.join(point[0] for point in fit.points)}.")

    judged = {"agrees": a_theta_of(fit)[1]}
    return Output("fit-atheta/2", (a_theta_as_json(fit) or {}) | judged | _origin(origin), text)


@command(api.compare, busy="fitting", out=_folder("reports/compare", "Folder for tables and figures."))
def compare(call: Call[Records[Comparison]]) -> Output:
    """Tables and figures are written, the misfits printed."""
    out = call.folder("compare")
    found = call(out=out)
    rows = [
        {"trial": c.motion.trial, "virtual": c.motion.virtual, "variant_mps": c.fit.variant.velocity}
        | {"misfits": c.misfits}
        for c in found
    ]

    def text(shown: Console) -> None:
        from granite_lab.reporting.terminal import show_misfits

        show_misfits(list(found), shown)
        show(f"figures and tables: {out}")

    document = {"trials": rows, "files": found.origin.written}
    return Output("compare/1", document | _origin(found.origin), text)


@command(
    api.study,
    run=api.studied,
    busy="trials",
    leave=("name",),
    out=_folder("reports/study", "Folder of the report; its name is the report's name."),
)
def study(
    call: Call[Studied],
    check: Annotated[
        Path | None,
        typer.Option("--verify", metavar="REPORT", help="Compute a report again and print the differences."),
    ] = None,
) -> Output:
    """The report has a page, a PDF, tables, figures and recordings."""
    if check is not None:
        return _verified(call, check)
    out = call.folder("study")
    found = call(out=out)
    from granite_lab.discovery.as_json import finding_as_json

    result, written = found.result, found.written
    assert written is not None
    warn_of(found.origin)
    finding = result.finding

    def text(shown: Console) -> None:
        from granite_lab.reporting.terminal import show_study

        show_study(result, shown, str(out), written.model.name if written.model else None)
        if written.page is not None:
            kept = " (unchanged: logs, options and code are those it was written from)"
            show(f"report: {written.page}{kept if found.unchanged else ''}")

    document = {
        "report": written.page,
        "unchanged": found.unchanged,
        "trials": len(result.trials),
        "failures": result.failures,
        "a_theta": result.a_theta.a_theta if result.a_theta else None,
        "discovery": finding_as_json(finding, written.model) if finding is not None else None,
    }
    failed = trouble([*(finding.failures if finding is not None else ()), *written.failures])
    return Output("study/1", document, text, failed)


def _verified(call: Call[Studied], report: Path) -> Output:
    from granite_lab.verify import verify

    execution = Execution(call.said["jobs"], call.said.get("scheduler"))
    found: Verification = call.of(verify, report, call.said.get("logs", ()), execution=execution)
    warn(found.notes)
    lines, error = found.differences, None
    if lines:
        error = LabError(
            f"{found.report}: differs in {len(lines)} places when computed again",
            "an input, the version or a library has changed, or the report was edited",
        )

    def text(_: Console) -> None:
        if not lines:
            logs = f"{found.trials} log{'s' if found.trials > 1 else ''}"
            show(f"{found.report}: identical, recomputed from {logs}")
        for line in lines[:MOST]:
            show(line)
        if len(lines) > MOST:
            show(f"and {len(lines) - MOST} more differences; --json lists all")

    return Output("verify/1", {"same": not lines} | vars(found), text, error)


@command(
    two_studies.compare_studies,
    first=Flag(metavar="A", help="Folder written by study."),
    second=Flag(metavar="B", help="Folder of the other study."),
)
def compare_studies(
    call: Call[two_studies.Compared],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a page, a figure and a table into this folder.")
    ] = None,
) -> Output:
    """For example of sand A and B, or before and after a change."""
    found = call()
    from granite_lab.reporting import write_compared
    from granite_lab.reporting.grid import say, show_table

    page = write_compared(found, out) if out is not None else None

    def text(shown: Console) -> None:
        say(shown, f"A: {found.names[0]}; B: {found.names[1]}")
        columns = ("quantity", "unit", "B − A, 95 %", "detectable", "verdict")
        show_table(two_studies.compared_table(found), shown, only=columns)
        say(shown, "B − A: 95 % interval. Detectable: difference that is found with a probability of 80 %.")
        for note in found.notes:
            say(shown, note)
        if page is not None:
            show(f"page: {page}")

    return Output("compare-studies/1", two_studies.compared_as_json(found) | {"page": page}, text)


@command(
    searches.discover,
    run=searches.discovered,
    busy="discovering",
    out=_folder("reports/discover", "Folder of the report, finding.json and model.toml."),
)
def discover(call: Call[Studied]) -> Output:
    """Report, finding and corrected model are written."""
    out = call.folder("discover")
    found = call(out=out)
    from granite_lab.discovery.as_json import finding_as_json

    finding, written, excluded = found.result.finding, found.written, warn_of(found.origin)
    assert written is not None
    assert finding is not None

    def text(shown: Console) -> None:
        from granite_lab.reporting.terminal import show_finding

        show_finding(finding, shown, str(out), written.model)
        for what, path in (("report", written.page), ("model with what was found", written.model)):
            if path is not None:
                show(f"{what}: {path}")

    document = finding_as_json(finding, written.model) | excluded
    return Output("discovery/2", document, text, trouble(finding.failures))
