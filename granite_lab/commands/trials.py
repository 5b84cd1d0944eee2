"""Commands that compare the model with trials: fits, comparisons, studies, and what uses their results."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

import granite_lab as gl
from granite_lab import reporting
from granite_lab.commands.options import (
    BodyRests,
    Changes,
    ColumnMap,
    DriveBy,
    EffectFile,
    Exclude,
    From,
    Jobs,
    Json,
    Latency,
    LogsAtHand,
    ModelFile,
    Quiet,
    RefVStd,
    RefXStd,
    RestTexts,
    Robot,
    Scheduler,
    Soil,
    Strict,
    TableFile,
    Tape,
    To,
    Tolerance,
    Topics,
    UseCache,
    UseReference,
    at_hand,
    count_of,
    keywords_of,
)
from granite_lab.commands.printer import Printer, progress, provenance, warn, warn_of
from granite_lab.errors import LabError
from granite_lab.files import write_table, write_text
from granite_lab.rounding import tidy_unit
from granite_lab.running.output import raise_failed
from granite_lab.shown import picked

if TYPE_CHECKING:
    from granite_lab.api.verification import Verification

MOST = 20
"""Differences that are printed at most."""


def fit_k92(
    logs: LogsAtHand = None,
    robot: Robot = None, soil: Soil = None, column_map: ColumnMap = None, topics: Topics = None,
    begin: From = None, end: To = None, changes: Changes = None,
    rests: RestTexts = None, body_rests: BodyRests = None, distance_measured: Tape = None,
    use_reference: UseReference = False, ref_v_std: RefVStd = None, ref_x_std: RefXStd = None,
    drive: DriveBy = "auto",
    effects: EffectFile = None, strict: Strict = False, jobs: Jobs = 0, scheduler: Scheduler = None,
    cache: UseCache = True,
    model: ModelFile = None,
    out: TableFile = None,
    verbose: Annotated[bool, Option("--verbose", help="Print the notes of the fits.")] = False,
    quiet: Quiet = False, as_json: Json = False,
) -> None:  # fmt: skip
    """Fit k_92 of each trial: by the steady slip ratio, as in the paper, and by the whole trajectory.

    Fits without an optimum are marked; --verbose prints notes on all fits.
    """
    given = at_hand(locals())
    with progress("fitting", quiet=quiet, total=count_of(given["logs"])) as watch:
        fits = gl.fit_k92(**given, done=watch.done)
    if out is not None:
        write_text(out, reporting.tables.k92_table(fits).to_csv())
    rows = [
        {"trial": fit.trial, "virtual": fit.virtual, "speed_mps": fit.variant.velocity}
        | {"slip_ratio": fit.slip_measured.as_json()}
        | reporting.json_report.k92_as_json(fit)
        for fit in fits
    ]
    printer = Printer(as_json)
    printer.json("fit-k92/2", {"fits": rows} | provenance(fits.origin))
    reporting.terminal.show_k92_fits(fits, printer.shown, notes=verbose)


def fit_atheta(
    logs: LogsAtHand = None,
    published: Annotated[bool, Option(
        "--published", help="Use Table 3 of the paper instead of trials.")] = False,
    robot: Robot = None, soil: Soil = None, column_map: ColumnMap = None, topics: Topics = None,
    begin: From = None, end: To = None, changes: Changes = None,
    exclude: Exclude = None,
    rests: RestTexts = None, body_rests: BodyRests = None, distance_measured: Tape = None,
    use_reference: UseReference = False, ref_v_std: RefVStd = None, ref_x_std: RefXStd = None,
    drive: DriveBy = "auto",
    effects: EffectFile = None, strict: Strict = False, jobs: Jobs = 0, scheduler: Scheduler = None,
    cache: UseCache = True,
    model: ModelFile = None,
    out: TableFile = None,
    quiet: Quiet = False, as_json: Json = False,
) -> None:  # fmt: skip
    """Estimate a_θ of k_92 = exp(-a_θ v) over trials, beside the paper's 4.919 and rival laws.

    A verdict needs three speeds.
    """
    given = keywords_of(locals()) if published else at_hand(locals())
    with progress("fitting", quiet=quiet, total=count_of(given["logs"])) as watch:
        fit = gl.fit_a_theta(**given, published=published, done=watch.done)
    if out is not None:
        table = fit.to_frame()
        write_table(out, table.assign(data="virtual") if fit.virtual else table)
    printer = Printer(as_json)
    document = (reporting.json_report.a_theta_as_json(fit) or {}) | provenance(fit.origin)
    printer.json("fit-atheta/2", document | {"agrees": reporting.answers.a_theta_of(fit)[1]})
    reporting.terminal.show_a_theta(fit, printer.shown)
    subject = "Rows of Table 3" if published else "Virtual trials" if fit.virtual else "Trials"
    names = [f"{velocity:g} m/s" if published else name for name, velocity, *_ in fit.points]
    printer.say(f"{subject}: {', '.join(names)}.")


def compare(
    logs: LogsAtHand = None,
    out: Annotated[Path | None, Option(
        help="Folder for tables and figures.", show_default="reports/compare")] = None,
    robot: Robot = None, soil: Soil = None, column_map: ColumnMap = None, topics: Topics = None,
    begin: From = None, end: To = None, changes: Changes = None,
    rests: RestTexts = None, body_rests: BodyRests = None, distance_measured: Tape = None,
    use_reference: UseReference = False, ref_v_std: RefVStd = None, ref_x_std: RefXStd = None,
    drive: DriveBy = "auto",
    effects: EffectFile = None, strict: Strict = False, jobs: Jobs = 0, scheduler: Scheduler = None,
    cache: UseCache = True,
    model: ModelFile = None,
    quiet: Quiet = False, as_json: Json = False,
) -> None:  # fmt: skip
    """Compare measured and simulated motion: velocity, wheel speed, slip, torques and pitch.

    Tables and figures are written, the differences by quantity are printed.
    """
    from granite_lab.api.project import results_folder

    given = at_hand(locals())
    out = out or results_folder(given["logs"], "compare")
    with progress("fitting", quiet=quiet, total=count_of(given["logs"])) as watch:
        comparisons = gl.compare(**given, out=out, done=watch.done)
    rows = [
        {"trial": c.motion.trial, "virtual": c.motion.virtual, "variant_mps": c.fit.variant.velocity}
        | {"misfits": c.misfits}
        for c in comparisons
    ]
    printer, origin = Printer(as_json), comparisons.origin
    printer.json("compare/1", {"trials": rows, "files": origin.written.files} | provenance(origin))
    reporting.terminal.show_misfits(comparisons, printer.shown)
    printer.line(f"figures and tables: {out}")


def study(
    logs: LogsAtHand = None,
    robot: Robot = None, soil: Soil = None, column_map: ColumnMap = None, topics: Topics = None,
    begin: From = None, end: To = None, changes: Changes = None,
    exclude: Exclude = None,
    rests: RestTexts = None, body_rests: BodyRests = None, distance_measured: Tape = None,
    use_reference: UseReference = False, ref_v_std: RefVStd = None, ref_x_std: RefXStd = None,
    drive: DriveBy = "auto",
    effects: EffectFile = None, strict: Strict = False, jobs: Jobs = 0, scheduler: Scheduler = None,
    cache: UseCache = True,
    model: ModelFile = None,
    tolerance: Tolerance = 0.02, latency: Latency = 20.0,
    out: Annotated[Path | None, Option(
        help="Folder of the report; its name is the report's name.", show_default="reports/study")] = None,
    discover: Annotated[bool, Option(help="Search for an effect that the model lacks.")] = True,
    recordings: Annotated[bool, Option(help="Also write a Rerun recording of each trial into --out.")] = True,
    report: Annotated[Path | None, Option(
        "--verify", metavar="REPORT", help="Compute a report again and print the differences.")] = None,
    quiet: Quiet = False, as_json: Json = False,
) -> None:  # fmt: skip
    """Analyse trials: estimate, fit, simulate, compare, a_θ, and the missing effect.

    A trial that cannot be used is left out and listed with the reason.

    The report has a page, a PDF, tables, figures and recordings.
    """
    from granite_lab.api.project import results_folder
    from granite_lab.discovery.as_json import finding_as_json

    printer = Printer(as_json)
    if report is not None:
        with progress("trials", quiet=quiet) as watch:
            verified = gl.verify(
                report, logs or (), effects=effects, jobs=jobs, scheduler=scheduler,
                done=watch.done, progress=watch.stage,
            )  # fmt: skip
        _show_verification(printer, verified)
        return
    given = at_hand(locals())
    out = out or results_folder(given["logs"], "study")
    with progress("trials", quiet=quiet, total=count_of(given["logs"])) as watch:
        result = gl.study(
            **given, out=out, discover=discover, recordings=recordings,
            done=watch.done, progress=watch.stage,
        )  # fmt: skip
    warn_of(result.origin)
    finding, written = result.finding, result.written
    document = {
        "report": written.page,
        "unchanged": written.unchanged,
        "trials": len(result.trials),
        "failures": result.failures,
        "a_theta": result.a_theta.a_theta if result.a_theta else None,
        "discovery": finding_as_json(finding, written.model) if finding is not None else None,
    }
    printer.json("study/1", document)
    reporting.terminal.show_study(result, printer.shown, str(out), written.model and written.model.name)
    if written.page is not None:
        kept = " (unchanged: logs, options and code are those it was written from)"
        printer.line(f"report: {written.page}{kept if written.unchanged else ''}")
    raise_failed(list(dict.fromkeys((*(finding.failures if finding is not None else ()), *written.failures))))


def _show_verification(printer: Printer, verified: Verification) -> None:
    """Print how a report differs when computed again; raise a LabError if it does."""
    warn(verified.notes)
    lines = verified.differences
    printer.json("verify/1", {"same": not lines} | vars(verified))
    for line in lines[:MOST]:
        printer.line(line)
    if len(lines) > MOST:
        printer.line(f"and {len(lines) - MOST} more differences; --json lists all")
    if lines:
        raise LabError(
            f"{verified.report}: differs in {len(lines)} places when computed again",
            "an input, the version or a library has changed, or the report was edited",
        )
    several = "s" if verified.trials > 1 else ""
    printer.line(f"{verified.report}: identical, recomputed from {verified.trials} log{several}")


def compare_studies(
    first: Annotated[Path, Argument(metavar="A", help="Folder written by study.")],
    second: Annotated[Path, Argument(metavar="B", help="Folder of the other study.")],
    out: TableFile = None,
    as_json: Json = False,
) -> None:  # fmt: skip
    """Compare two studies by the numbers of their reports.

    For example of sand A and B, or before and after a change.
    """
    from granite_lab import two_studies

    compared = gl.compare_studies(first, second)
    if out is not None:
        write_text(out, two_studies.compared_table(compared).to_csv())
    printer = Printer(as_json)
    printer.json("compare-studies/1", two_studies.compared_as_json(compared))
    printer.say(f"A: {compared.names[0]}; B: {compared.names[1]}")
    rows = tuple(replace(row, quantity=f"{row.quantity} [{tidy_unit(row.unit)}]") for row in compared.rows)
    table = two_studies.compared_table(replace(compared, rows=rows))
    columns = ("quantity", "A", "B", "B − A, 95 %", "verdict")
    reporting.table.show_table(table, printer.shown, only=columns)
    printer.say("B − A: 95 % interval. --out and --json also state the smallest detectable difference.")
    for note in compared.notes:
        printer.say(note)


def discover(
    logs: LogsAtHand = None,
    out: Annotated[Path | None, Option(
        help="Folder of the report, finding.json and model.toml.", show_default="reports/discover")] = None,
    robot: Robot = None, soil: Soil = None, column_map: ColumnMap = None, topics: Topics = None,
    begin: From = None, end: To = None, changes: Changes = None,
    exclude: Exclude = None,
    rests: RestTexts = None, body_rests: BodyRests = None, distance_measured: Tape = None,
    use_reference: UseReference = False, ref_v_std: RefVStd = None, ref_x_std: RefXStd = None,
    drive: DriveBy = "auto",
    effects: EffectFile = None, strict: Strict = False, jobs: Jobs = 0, scheduler: Scheduler = None,
    cache: UseCache = True,
    tolerance: Tolerance = 0.02, latency: Latency = 20.0,
    quiet: Quiet = False, as_json: Json = False,
) -> None:  # fmt: skip
    """Find the physical effect that the model lacks.

    Report, finding and corrected model are written.
    """
    from granite_lab.api.project import results_folder
    from granite_lab.discovery.as_json import finding_as_json
    from granite_lab.results import of_search

    given = at_hand(locals())
    out = out or results_folder(given["logs"], "discover")
    with progress("discovering", quiet=quiet) as watch:
        finding = gl.discover(**given, out=out, progress=watch.stage)
    printer, written = Printer(as_json), finding.origin.written
    printer.json("discovery/3", finding_as_json(finding, written.model) | warn_of(finding.origin))
    reporting.terminal.show_study(of_search(finding, out), printer.shown, str(out), written.model)
    for subject, path in (("report", written.page), ("model with what was found", written.model)):
        if path is not None:
            printer.line(f"{subject}: {path}")
    raise_failed(finding.failures)


def plan_next(
    folder: Annotated[Path, Argument(metavar="DIR", help="Folder written by discover or study.")],
    room: Annotated[
        float | None,
        Option(
            help="Longest distance that fits on the sand [m]; by default the longest so far (0.1 or more)."
        ),
    ] = None,
    max_speed: Annotated[float | None, Option(
        help="Fastest command [m/s]; by default 1.25 times the fastest so far (0.02 or more).")] = None,
    effects: EffectFile = None,
    jobs: Jobs = 0,
    out: TableFile = None,
    quiet: Quiet = False, as_json: Json = False,
) -> None:  # fmt: skip
    """Propose the most useful next trial.

    Proposals are ranked, the best first.
    """
    with progress("looking at trials", quiet=quiet) as watch:
        plan = gl.plan_next(
            folder, room=room, max_speed=max_speed, effects=effects, jobs=jobs, progress=watch.stage
        )
    if out is not None:
        table = plan.to_frame()
        write_table(out, table.assign(data="virtual") if plan.design.virtual else table)
    kind = plan.question.kind
    proposals = [
        picked(p.trial, "variant", "conditions", "repeats", "why", "how")
        | picked(p, "after", "improves", "worth")
        | {"log_lines": p.trial.conditions.lines}
        for p in plan.proposals
    ]
    measure = "relative standard deviation" if kind == "sharpen" else "expected log Bayes factor"
    document: dict[str, Any] = {
        "question": reporting.terminal.asked(plan),
        "kind": kind,
        "models": [dict(model) for model in plan.models],
    }
    document |= {"virtual": plan.design.virtual, "measure": measure, "proposals": proposals}
    printer = Printer(as_json)
    printer.json("plan/2", document | picked(plan, "now", "worth", "failed"))
    reporting.terminal.show_plan(plan, printer.shown)
