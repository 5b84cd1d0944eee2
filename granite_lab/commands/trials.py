"""Commands on logs and trials: what a log holds, the motion in it, and the model held against it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab import reporting, two_studies
from granite_lab.api import logs
from granite_lab.api import trials as api
from granite_lab.api.at_hand import refuse_others, remember
from granite_lab.api.records import Origin, Records
from granite_lab.columns import Column, words
from granite_lab.columns import Table as Tabular
from granite_lab.commands.command import Call, command, warn, warn_of, write_picture
from granite_lab.commands.options import AT_HAND, Flag, Format, Table, picture
from granite_lab.errors import EstimateError, InputError, LabError, printable
from granite_lab.files import ending_of, write_table, write_text
from granite_lab.logs.trial import name_of
from granite_lab.rounding import significant
from granite_lab.running import Execution
from granite_lab.running.output import tell
from granite_lab.shown import picked

if TYPE_CHECKING:
    from rich.console import Console

    from granite_lab.comparison.compare import Comparison
    from granite_lab.fitting.fit import AThetaFit, K92Fit
    from granite_lab.logs import Inspection
    from granite_lab.planning.plan import Plan, Proposal
    from granite_lab.study import Written

MOST, PROPOSALS = 20, 8
"""Differences and proposed trials that are printed at most."""


@command(logs.check_logs, busy="checking", logs=AT_HAND)
def check(call: Call[Records[logs.Checked]]) -> None:
    """Of several logs one line each is shown. The exit code is 3 if one cannot be used, 4 if one is poor."""
    call.take_logs_at_hand()
    found = call()
    if len(found) == 1:
        _show_checks(call, found[0])
    else:
        _show_sheet(call, found)


def _check_as_json(found: logs.Checked) -> dict[str, Any]:
    return picked(found, "log", "virtual", "good", "checks") | {"health": {"grade": found.grade or None}}


def _show_sheet(call: Call[Any], found: Records[logs.Checked]) -> None:
    """Print one line a run, and end with the exit code of the worst."""
    errors = [one.error for one in found if one.error is not None]
    call.json("check/2", {"good": not errors, "runs": [_check_as_json(one) for one in found]})
    width = max(len(printable(name_of(one.log))) for one in found)
    for one in found:
        mark, style = ("good", "green") if one.good else ("BAD ", "red")
        virtual = " (virtual)" if one.virtual else ""
        call.line(f"{mark}  {printable(name_of(one.log)):<{width}}  {printable(one.reason)}{virtual}", style)
    if errors:
        kind = InputError if any(isinstance(error, InputError) for error in errors) else EstimateError
        hint = "check one of them alone to see all of its checks and what to do"
        raise kind(f"{len(errors)} of {len(found)} runs are bad", hint)
    call.say(f"All {len(found)} runs are good.", "bold green")


CHECKS = Tabular[logs.Check](
    "checks",
    "Checks of a run",
    Column("", lambda c: words("good", "good") if c.good else words("BAD", "bad")),
    Column("check", lambda c: c.name),
    Column(
        "found",
        lambda c: words(c.found if c.good else f"{c.found}. {reporting.names.capital(c.advice)}."),
    ),
)


def _show_checks(call: Call[Any], found: logs.Checked) -> None:
    """Print each check of one run."""
    call.json("check/1", _check_as_json(found))
    call.rows(CHECKS, found.checks)
    if found.virtual:
        call.say("virtual data: written by a simulator.", "yellow")
    if found.error is not None:
        raise found.error
    call.say("The run is good.", "bold green")


@command(logs.inspect)
def inspect(
    call: Call[Inspection],
    write_map: Annotated[
        Path | None, typer.Option(help="Write the column map here, to edit and to pass with --map.")
    ] = None,
    plot: Annotated[Path | None, picture("Draw the recognised channels over time")] = None,
) -> None:
    """Columns that are not used are listed, too."""
    found = call()
    if write_map:
        write_text(write_map, found.to_map_toml())
    if plot:
        write_picture(plot, reporting.pictures.inspection_figure(found))
    call.json("inspect/1", found.as_json())
    reporting.terminal.show_inspection(found, call.shown)
    for what, path in (("column map", write_map), ("plot", plot)):
        if path:
            call.line(f"{what}: {path}")


@command(logs.ingest, busy="ingesting")
def ingest(
    call: Call[Records[logs.Ingested]],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the motion tables.", show_default="reports/ingest")
    ] = None,
    table_format: Format = None,
) -> None:
    """The motion of each log is written as a table, a row for each IMU sample.

    The logs are listed beside the tables: commands that are given no logs take these.
    """
    ending, folder = ending_of(None, table_format), out or call.folder("ingest")
    found = call()
    rows = [(item.motion, folder / f"{item.name}{ending}", item.judgement) for item in found]
    tables = {item.log: path for item, (_, path, _) in zip(found, rows, strict=True)}
    refuse_others(folder, tables.values())
    for motion, path, _ in rows:
        write_table(path, motion.to_frame(), ending)
    remember(folder, tables, call.said)
    documents = [
        {"name": m.trial, "virtual": m.virtual, "warnings": m.warnings, "motion": path}
        | reporting.json_report.motion_as_json(m)
        | ({"judgement": judged} if judged is not None else {})
        for m, path, judged in rows
    ]
    failures = [one for one in found.origin.left_out if not one.excluded]
    call.json("ingest/2", {"trials": documents, "failures": failures} | warn_of(found.origin))
    reporting.terminal.show_motions(rows, call.shown)
    for one in failures:
        call.say(f"left out: {one.trial}: {one.message}", "red")


@command(
    logs.view,
    json=False,
    what=Flag(metavar="WHAT", help="A recording (.rrd), a report folder, or a log (CSV, ROS bag, MCAP)."),
    screenshot=Flag(help="Save a picture of the viewer (.png) instead; needs no display."),
)
def view(call: Call[None]) -> None:
    """A log is analysed first."""
    call(tell=lambda address: call.line(f"{address}\nCtrl+C ends it."))
    if "screenshot" in call.said:
        call.line(call.said["screenshot"])


def _origin(origin: Origin) -> dict[str, Any]:
    """Warn as `warn_of`; return provenance and what is excluded, for JSON."""
    source = origin.source
    return {"provenance": source and reporting.json_report.provenance_as_json(source)} | warn_of(origin)


@command(api.fit_k92, busy="fitting", logs=AT_HAND)
def fit_k92(
    call: Call[Records[K92Fit]],
    out: Table = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Print the notes of the fits.")] = False,
) -> None:
    """Fits without an optimum are marked; --verbose prints notes on all fits."""
    call.take_logs_at_hand()
    fits = call()
    if out is not None:
        write_text(out, reporting.tables.k92_table(list(fits)).to_csv())
    rows = [
        {"trial": fit.trial, "virtual": fit.virtual, "speed_mps": fit.variant.velocity}
        | {"slip_ratio": fit.slip_measured.as_json()}
        | reporting.json_report.k92_as_json(fit)
        for fit in fits
    ]
    call.json("fit-k92/2", {"fits": rows} | _origin(fits.origin))
    reporting.terminal.show_k92_fits(list(fits), call.shown, notes=verbose)


@command(api.fit_a_theta, run=api.a_theta_of, busy="fitting", logs=AT_HAND)
def fit_atheta(call: Call[tuple[AThetaFit, Origin]], out: Table = None) -> None:
    """A verdict needs three speeds."""
    if not call.said["published"]:
        call.take_logs_at_hand()
    fit, origin = call()
    if out is not None:
        table = fit.to_frame()
        write_table(out, table.assign(data="virtual") if fit.virtual else table)
    document = (reporting.json_report.a_theta_as_json(fit) or {}) | _origin(origin)
    call.json("fit-atheta/2", document | {"agrees": reporting.answers.a_theta_of(fit)[1]})
    reporting.terminal.show_a_theta(fit, call.shown)
    what = "Rows of Table 3" if origin.source is None else "Virtual trials" if fit.virtual else "Trials"
    call.say(f"{what}: {', '.join(point[0] for point in fit.points)}.")


@command(
    api.compare,
    busy="fitting",
    logs=AT_HAND,
    out=Flag(help="Folder for tables and figures.", shown="reports/compare"),
)
def compare(call: Call[Records[Comparison]]) -> None:
    """Tables and figures are written, the differences by quantity are printed."""
    call.take_logs_at_hand()
    out = call.folder("compare")
    found = call(out=out)
    rows = [
        {"trial": c.motion.trial, "virtual": c.motion.virtual, "variant_mps": c.fit.variant.velocity}
        | {"misfits": c.misfits}
        for c in found
    ]
    document = {"trials": rows, "files": found.origin.written}
    call.json("compare/1", document | _origin(found.origin))
    reporting.terminal.show_misfits(list(found), call.shown)
    call.line(f"figures and tables: {out}")


@command(
    api.study,
    run=api.studied,
    busy="trials",
    logs=AT_HAND,
    out=Flag(help="Folder of the report; its name is the report's name.", shown="reports/study"),
)
def study(
    call: Call[tuple[Written, Origin]],
    check: Annotated[
        Path | None,
        typer.Option("--verify", metavar="REPORT", help="Compute a report again and print the differences."),
    ] = None,
) -> None:
    """The report has a page, a PDF, tables, figures and recordings."""
    if check is not None:
        _verify(call, check)
        return
    call.take_logs_at_hand()
    out = call.folder("study")
    written, origin = call(out=out)
    from granite_lab.discovery.as_json import finding_as_json

    warn_of(origin)
    result, finding, model = written.result, written.result.finding, written.model
    document = {
        "report": written.page,
        "unchanged": written.unchanged,
        "trials": len(result.trials),
        "failures": result.failures,
        "a_theta": result.a_theta.a_theta if result.a_theta else None,
        "discovery": finding_as_json(finding, model) if finding is not None else None,
    }
    call.json("study/1", document)
    reporting.terminal.show_study(result, call.shown, str(out), model and model.name)
    if written.page is not None:
        kept = " (unchanged: logs, options and code are those it was written from)"
        call.line(f"report: {written.page}{kept if written.unchanged else ''}")
    tell(list(dict.fromkeys((*(finding.failures if finding is not None else ()), *written.failures))))


def _verify(call: Call[tuple[Written, Origin]], report: Path) -> None:
    execution = Execution(call.said["jobs"], call.said.get("scheduler"))
    effects = call.said.get("effects")
    found = call.of(api.verify, report, call.said["logs"], effects=effects, execution=execution)
    warn(found.notes)
    lines = found.differences
    call.json("verify/1", {"same": not lines} | vars(found))
    for line in lines[:MOST]:
        call.line(line)
    if len(lines) > MOST:
        call.line(f"and {len(lines) - MOST} more differences; --json lists all")
    if lines:
        raise LabError(
            f"{found.report}: differs in {len(lines)} places when computed again",
            "an input, the version or a library has changed, or the report was edited",
        )
    several = "s" if found.trials > 1 else ""
    call.line(f"{found.report}: identical, recomputed from {found.trials} log{several}")


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
) -> None:
    """For example of sand A and B, or before and after a change."""
    found = call()
    page = two_studies.write_compared(found, out) if out is not None else None
    call.json("compare-studies/1", two_studies.compared_as_json(found) | {"page": page})
    call.say(f"A: {found.names[0]}; B: {found.names[1]}")
    columns = ("quantity", "unit", "B − A, 95 %", "detectable", "verdict")
    reporting.table.show_table(two_studies.compared_table(found), call.shown, only=columns)
    call.say("B − A: 95 % interval. Detectable: difference that is found with a probability of 80 %.")
    for note in found.notes:
        call.say(note)
    if page is not None:
        call.line(f"page: {page}")


@command(
    api.discover,
    run=api.discovered,
    busy="discovering",
    logs=AT_HAND,
    out=Flag(help="Folder of the report, finding.json and model.toml.", shown="reports/discover"),
)
def discover(call: Call[tuple[Written, Origin]]) -> None:
    """Report, finding and corrected model are written."""
    call.take_logs_at_hand()
    out = call.folder("discover")
    written, origin = call(out=out)
    from granite_lab.discovery.as_json import finding_as_json

    finding, excluded = written.result.finding, warn_of(origin)
    assert finding is not None
    call.json("discovery/2", finding_as_json(finding, written.model) | excluded)
    reporting.terminal.show_study(written.result, call.shown, str(out), written.model)
    for what, path in (("report", written.page), ("model with what was found", written.model)):
        if path is not None:
            call.line(f"{what}: {path}")
    tell(finding.failures)


@command(api.plan_next, busy="looking at trials")
def plan_next(call: Call[Plan], out: Table = None) -> None:
    """Proposals are ranked, the best first."""
    found = call()
    if out is not None:
        table = found.to_frame()
        write_table(out, table.assign(data="virtual") if found.design.virtual else table)
    kind = found.question.kind
    proposals = [
        picked(p.option, "variant", "conditions", "repeats", "why", "how")
        | picked(p, "after", "improves", "worth")
        | {"log_lines": p.option.conditions.lines}
        for p in found.proposals
    ]
    measure = "relative standard deviation" if kind == "sharpen" else "expected log Bayes factor"
    document: dict[str, Any] = {
        "question": asked(found),
        "kind": kind,
        "models": [dict(model) for model in found.models],
    }
    document |= {"virtual": found.design.virtual, "measure": measure, "proposals": proposals}
    call.json("plan/2", document | picked(found, "now", "worth", "failed"))
    show_plan(found, call.shown)


def show_plan(plan: Plan, shown: Console) -> None:
    """Print a plan so that it fits 80 columns."""
    say = reporting.table.say
    sharpens = plan.question.kind == "sharpen"

    def size(value: float) -> str:
        if sharpens:
            return f"{significant(100 * value, 2)} %"
        return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}"

    def cells(k: int, p: Proposal) -> tuple[str, ...]:
        v, under, why = p.option.variant, p.option.conditions.words, p.option.why
        command = f"{v.velocity:g} m/s, {v.acceleration:g} m/s², {v.distance:g} m"
        change = f"{size(plan.now[p.improves])} → {size(p.after[p.improves])}"
        because = f"{p.improves}: {why}" if len(plan.now) > 1 else why
        return (str(k), f"{command}, {under}" if under else command, change, because)

    count = sum(int(d.count) for d in plan.design.driven)
    trials = f"the {count} trials at hand" if count > 1 else "the one trial at hand"
    known = ", ".join(f"{name} {size(value)}" for name, value in plan.now.items())
    what = "Relative standard deviation" if sharpens else "Expected log Bayes factors"
    say(shown, asked(plan) + (" (virtual data)" if plan.design.virtual else ""), "bold")
    say(shown, f"{what} with {trials}: {known}.")
    if not plan.worth:
        why = "none lowers the std by a fifth" if sharpens else "none adds 3 to a log Bayes factor (20 to 1)"
        say(shown, f"No trial is recommended: {why}.", "bold")
    table = Tabular[tuple[str, ...]](
        "plan",
        "Proposals",
        Column("", lambda row: row[0], "rank"),
        Column("next trial", lambda row: row[1]),
        Column("std" if sharpens else "log Bayes factor", lambda row: row[2], "change"),
        Column("because", lambda row: row[3]),
    )
    rows = (cells(k, p) for k, p in enumerate(plan.proposals[:PROPOSALS], 1))
    reporting.table.show_table(table.fill(rows), shown)
    if plan.worth:
        best = plan.proposals[0].option
        say(shown, f"First choice: {best.how}.")
        if best.conditions.lines:
            lines = ", ".join(f"'{line}'" for line in best.conditions.lines)
            say(shown, f"Write {lines} into its log, so that discover knows.")
    if plan.failed:
        say(shown, f"{plan.failed} commands cannot be simulated and were left out.")


def asked(plan: Plan) -> str:
    """Return the question."""
    rivals = plan.question.rivals
    if plan.question.kind == "apart":
        return f"Which trial distinguishes {', '.join(rivals[:-1])} and {rivals[-1]}?"
    if plan.question.kind == "show":
        return f"Which trial shows {' or '.join(rivals)}, if it is present?"
    return "Which trial lowers the largest relative standard deviation?"
