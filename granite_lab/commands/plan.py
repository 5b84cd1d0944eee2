"""`granite-lab plan-next`: the trial that would best answer what a search has left open."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.api import search as api
from granite_lab.commands.command import Call, Output, command

if TYPE_CHECKING:
    from rich.console import Console

    from granite_lab.planning.plan import Plan, Proposal


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
        "now": plan.now,
        "worth": plan.worth,
        "proposals": [
            {
                "variant": p.option.variant,
                "conditions": p.option.conditions,
                "repeats": p.option.repeats,
                "after": p.after,
                "improves": p.improves,
                "worth": p.worth,
                "why": p.option.why,
                "how": p.option.how,
                "log_lines": p.option.conditions.lines,
            }
            for p in plan.proposals
        ],
        "failed": plan.failed,
    }


MEASURE = ("expected log Bayes factor", "relative standard deviation")


def show_plan(plan: Plan, most: int, shown: Console) -> None:
    """Print a plan so that it fits 80 columns."""
    from granite_lab.reporting.grid import grid, say

    sharpens = plan.question.kind == "sharpen"
    say(shown, asked(plan) + (" (virtual data)" if plan.design.virtual else ""), "bold")
    say(shown, _now(plan))
    if not plan.worth:
        why = "none lowers the std by a fifth" if sharpens else "none adds 3 to a log Bayes factor (20 to 1)"
        say(shown, f"No trial is recommended: {why}.", "bold")
    shown_first = enumerate(plan.proposals[:most], 1)
    rows = ((str(k), trial(p), _change(plan, p), because(plan, p)) for k, p in shown_first)
    titles = ("", "next trial", "std" if sharpens else "log Bayes\nfactor", "because")
    shown.print(grid(*titles, words=(1, 3), rows=rows))
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


def trial(proposal: Proposal) -> str:
    """Return command and conditions."""
    v, under = proposal.option.variant, proposal.option.conditions.words
    command = f"{v.velocity:g} m/s, {v.acceleration:g} m/s², {v.distance:g} m"
    return f"{command}, {under}" if under else command


def because(plan: Plan, proposal: Proposal) -> str:
    """Say what a proposal improves, where there are several things, and why."""
    why = proposal.option.why
    return f"{proposal.improves}: {why}" if len(plan.now) > 1 else why


def _now(plan: Plan) -> str:
    count = sum(int(d.count) for d in plan.design.driven)
    trials = f"the {count} trials at hand" if count > 1 else "the one trial at hand"
    if plan.question.kind == "sharpen":
        ((name, std),) = plan.now.items()
        return f"With {trials} the std of {name} is {_figure(plan, std)}."
    pairs = ", ".join(f"{pair} {_figure(plan, factor)}" for pair, factor in plan.now.items())
    return f"Expected log Bayes factors with {trials}: {pairs}."


def _change(plan: Plan, p: Proposal) -> str:
    return f"{_figure(plan, plan.now[p.improves])} → {_figure(plan, p.after[p.improves])}"


def _figure(plan: Plan, value: float) -> str:
    from granite_lab.reporting.rounding import significant

    if plan.question.kind == "sharpen":
        return f"{significant(100 * value, 2)} %"
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}"
