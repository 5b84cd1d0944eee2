"""`granite-lab fit-k92`, `fit-atheta`, `compare`, `study`, `discover`, `plan-next`: model and trials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab import reporting, two_studies
from granite_lab.api import trials as api
from granite_lab.api.records import Origin, Records, Studied
from granite_lab.commands.command import Call, Output, command, show, warn, warn_of
from granite_lab.commands.options import Flag, Table
from granite_lab.errors import LabError
from granite_lab.files import write_table, write_text
from granite_lab.running import Execution
from granite_lab.running.output import trouble
from granite_lab.shown import picked

if TYPE_CHECKING:
    from rich.console import Console

    from granite_lab.comparison.record import Comparison
    from granite_lab.fitting.fit import AThetaFit, K92Fit
    from granite_lab.planning.plan import Plan, Proposal
    from granite_lab.verify import Verification

MOST = 20
"""Differences that are printed."""


def _folder(default: str, text: str) -> Flag:
    return Flag(help=text, shown=default)


def _origin(origin: Origin) -> dict[str, Any]:
    """Warn of what there is to know, and return where results come from, as it stands in JSON."""
    excluded, source = warn_of(origin), origin.source
    return {"provenance": source and reporting.json_report.provenance_as_json(source)} | excluded


@command(api.fit_k92, busy="fitting")
def fit_k92(
    call: Call[Records[K92Fit]],
    out: Table = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Print the notes of the fits.")] = False,
) -> Output:
    """Fits without an optimum are marked; --verbose prints notes on all fits."""
    fits = call()
    if out is not None:
        write_text(out, reporting.tables.k92_table(list(fits)).to_csv())
    rows = [
        {"trial": fit.trial, "virtual": fit.virtual, "speed_mps": fit.variant.velocity}
        | {"slip_ratio": fit.slip_measured.as_json()}
        | reporting.json_report.k92_as_json(fit)
        for fit in fits
    ]
    return Output(
        "fit-k92/2",
        {"fits": rows} | _origin(fits.origin),
        lambda shown: reporting.terminal.show_k92_fits(list(fits), shown, notes=verbose),
    )


@command(api.fit_a_theta, run=api.a_theta_of, busy="fitting")
def fit_atheta(call: Call[tuple[AThetaFit, Origin]], out: Table = None) -> Output:
    """A verdict needs three speeds."""
    fit, origin = call()
    if out is not None:
        table = fit.to_frame()
        write_table(out, table.assign(data="virtual") if fit.virtual else table)

    def text(shown: Console) -> None:
        reporting.terminal.show_a_theta(fit, shown)
        what = "Rows of Table 3" if origin.source is None else "Virtual trials" if fit.virtual else "Trials"
        reporting.table.say(shown, f"{what}: {', '.join(point[0] for point in fit.points)}.")

    document = (reporting.json_report.a_theta_as_json(fit) or {}) | _origin(origin)
    return Output("fit-atheta/2", document | {"agrees": reporting.answers.a_theta_of(fit)[1]}, text)


@command(api.compare, busy="fitting", out=_folder("reports/compare", "Folder for tables and figures."))
def compare(call: Call[Records[Comparison]]) -> Output:
    """Tables and figures are written, the differences by quantity are printed."""
    out = call.folder("compare")
    found = call(out=out)
    rows = [
        {"trial": c.motion.trial, "virtual": c.motion.virtual, "variant_mps": c.fit.variant.velocity}
        | {"misfits": c.misfits}
        for c in found
    ]

    def text(shown: Console) -> None:
        reporting.terminal.show_misfits(list(found), shown)
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
        model = written.model.name if written.model else None
        reporting.terminal.show_study(result, shown, str(out), model)
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
    page = two_studies.write_compared(found, out) if out is not None else None

    def text(shown: Console) -> None:
        say = reporting.table.say
        say(shown, f"A: {found.names[0]}; B: {found.names[1]}")
        columns = ("quantity", "unit", "B − A, 95 %", "detectable", "verdict")
        reporting.table.show_table(two_studies.compared_table(found), shown, only=columns)
        say(shown, "B − A: 95 % interval. Detectable: difference that is found with a probability of 80 %.")
        for note in found.notes:
            say(shown, note)
        if page is not None:
            show(f"page: {page}")

    return Output("compare-studies/1", two_studies.compared_as_json(found) | {"page": page}, text)


@command(
    api.discover,
    run=api.discovered,
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
        reporting.terminal.show_study(found.result, shown, str(out), written.model)
        for what, path in (("report", written.page), ("model with what was found", written.model)):
            if path is not None:
                show(f"{what}: {path}")

    document = finding_as_json(finding, written.model) | excluded
    return Output("discovery/2", document, text, trouble(finding.failures))


@command(api.plan_next, busy="looking at trials")
def plan_next(
    call: Call[Plan], most: Annotated[int, typer.Option(min=1, help="Rows of the table.")] = 8
) -> Output:
    """Proposals are ranked, the best first."""
    found = call()
    return Output("plan/2", _document(found), lambda shown: show_plan(found, most, shown))


def _document(plan: Plan) -> dict[str, Any]:
    """Return a plan as it stands in JSON."""
    return {
        "question": asked(plan),
        "kind": plan.question.kind,
        "models": [dict(model) for model in plan.models],
        "virtual": plan.design.virtual,
        "measure": MEASURE[plan.question.kind == "sharpen"],
        "proposals": [
            picked(p.option, "variant", "conditions", "repeats", "why", "how")
            | picked(p, "after", "improves", "worth")
            | {"log_lines": p.option.conditions.lines}
            for p in plan.proposals
        ],
    } | picked(plan, "now", "worth", "failed")


MEASURE = ("expected log Bayes factor", "relative standard deviation")


def show_plan(plan: Plan, most: int, shown: Console) -> None:
    """Print a plan so that it fits 80 columns."""
    say = reporting.table.say
    sharpens = plan.question.kind == "sharpen"

    def size(value: float) -> str:
        if sharpens:
            return f"{reporting.rounding.significant(100 * value, 2)} %"
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
    rows = (cells(k, p) for k, p in enumerate(plan.proposals[:most], 1))
    reporting.table.show_rows("plan", rows, shown, change="std" if sharpens else "log Bayes factor")
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
