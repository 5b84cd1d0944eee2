"""`granite-lab plan-next`: the trial that would best tell apart what a discovery could not."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands.common import (
    EffectsOption,
    JobsOption,
    JsonOption,
    QuietOption,
    console,
    print_json,
    progress,
)

if TYPE_CHECKING:
    from rich.console import Console

    from granite_lab.discovery.plan import Outlook, Plan, Proposal
    from granite_lab.discovery.plan_design import Design


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command("plan-next")(plan)


def plan(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder written by `discover` or `study`.")],
    room: Annotated[
        float | None,
        typer.Option(min=0.1, help="Longest way the sand allows [m].", show_default="the longest so far"),
    ] = None,
    max_speed: Annotated[
        float | None,
        typer.Option(min=0.02, help="Fastest command [m/s].", show_default="1.25 times the fastest so far"),
    ] = None,
    most: Annotated[int, typer.Option(min=1, help="Rows of the table.")] = 8,
    effects: EffectsOption = None,
    jobs: JobsOption = 0,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Propose the next trial: the one that best separates what the trials so far left open."""
    from granite_lab.api.plan import plan_next

    with progress(quiet) as display:
        task = display.add_task("looking at trials", total=None)
        planned = plan_next(
            folder,
            room=room,
            max_speed=max_speed,
            effects=effects,
            jobs=jobs,
            progress=lambda done, all_: display.update(task, completed=done, total=all_),
        )
    found, design = planned.plan, planned.design
    if as_json:
        print_json(_document(found, design))
    else:
        show_plan(found, design, most, console())


def _document(plan: Plan, design: Design) -> dict[str, Any]:
    """Return a plan as it stands in JSON."""
    from granite_lab.discovery.plan_words import how, why

    return {
        "schema": "granite-lab/plan/1",
        "question": plan.question.words,
        "kind": plan.question.kind,
        "rivals": [
            {
                "id": r.id,
                "values": {p.name: v for p, v in zip(r.effect.parameters, r.values, strict=True)}
                if r.effect
                else {},
            }
            for r in plan.rivals
        ],
        "virtual": design.virtual,
        "now": _outlook(plan, plan.now),
        "proposals": [
            {
                "variant": p.option.variant,
                "conditions": p.option.conditions,
                "repeats": p.option.repeats,
                "after": _outlook(plan, p.after),
                "channel": p.channel or None,
                "phase": p.phase or None,
                "why": why(design, p.option.variant, p.option.conditions, repeats=p.option.repeats),
                "how": how(p.option.conditions),
                "log_lines": p.option.conditions.lines,
            }
            for p in plan.proposals
        ],
        "left_out": plan.left_out,
    }


def _outlook(plan: Plan, outlook: Outlook) -> dict[str, Any]:
    return {
        "probability": outlook.chance,
        "evidence": outlook.evidence,
        "std": dict(zip(_sharpened(plan), outlook.std, strict=True)) if outlook.std else None,
    }


def _sharpened(plan: Plan) -> list[str]:
    effect = plan.rivals[0].effect
    return [p.name for p in effect.parameters if not p.shape] if effect else []


HEADING = {"apart": "told\napart", "show": "shown", "sharpen": "std"}


def show_plan(plan: Plan, design: Design, most: int, shown: Console) -> None:
    """Print a plan so that it fits 80 columns."""
    from granite_lab.discovery.plan_words import IN_WORDS, WHEN, how, trial_words, why
    from granite_lab.reporting.grid import grid, row_of, say

    kind = plan.question.kind
    say(shown, plan.question.words + (" (virtual data)" if design.virtual else ""), "bold")
    count = sum(d.count for d in design.driven)
    say(shown, _now(plan, count))
    gains = kind != "sharpen"
    heads = ("", "next trial", HEADING[kind], *(["evidence"] if gains else []), "because")
    table = grid(*heads, words=(1, len(heads) - 1))
    for k, p in enumerate(plan.proposals[:most], 1):
        table.add_row(
            *row_of(
                str(k),
                trial_words(p.option.variant, p.option.conditions),
                _chance(plan, p.after),
                *([_gain(plan, p)] if gains else []),
                why(design, p.option.variant, p.option.conditions, repeats=p.option.repeats),
            )
        )
    shown.print(table)
    if plan.proposals:
        best = plan.proposals[0]
        say(shown, f"First choice: {how(best.option.conditions)}.")
        if best.option.conditions.lines:
            lines = ", ".join(f"'{line}'" for line in best.option.conditions.lines)
            say(shown, f"Write {lines} into its log, so that discover knows.")
        if best.channel:
            most_seen = "they part" if kind == "apart" else "it shows"
            say(shown, f"There {most_seen} most in {IN_WORDS[best.channel]} {WHEN[best.phase]}.")
    if gains:
        say(shown, "evidence: expected drop of χ² in favour of the true one, whichever it is, beyond now")
    for line in plan.left_out:
        say(shown, f"left out: {line}")


def _now(plan: Plan, count: int) -> str:
    trials = f"the {count} trials at hand" if count > 1 else "the one trial at hand"
    names, now = [r.id for r in plan.rivals], _chance(plan, plan.now)
    if plan.question.kind == "apart":
        return f"With {trials} {' and '.join(names)} are told apart with a probability of {now}."
    if plan.question.kind == "show":
        sizes = "; ".join(_values(plan, k) for k in range(1, len(names)))
        weak = f"an effect just too weak to be named ({sizes})"
        return f"With {trials} {weak} is shown with a probability of {now}."
    return f"{names[0]} is named and alone; with {trials} its std is {now}."


def _values(plan: Plan, k: int) -> str:
    from granite_lab.reporting.rounding import significant, tidy_unit

    rival = plan.rivals[k]
    assert rival.effect is not None
    sizes = [
        f"{p.name} {significant(v, 2)} {tidy_unit(p.unit)}".rstrip()
        for p, v in zip(rival.effect.parameters, rival.values, strict=True)
        if not p.shape and v != p.neutral
    ]
    return f"{rival.id}: {', '.join(sizes)}"


def _chance(plan: Plan, outlook: Outlook) -> str:
    from granite_lab.reporting.rounding import significant, tidy_unit

    if plan.question.kind == "sharpen":
        effect = plan.rivals[0].effect
        assert effect is not None
        units = [p.unit for p in effect.parameters if not p.shape]
        return ", ".join(
            f"{significant(s, 2)} {tidy_unit(u)}".rstrip() for s, u in zip(outlook.std, units, strict=True)
        )
    if math.isnan(outlook.chance):
        return "–"
    percent = 100 * outlook.chance
    return "> 99 %" if percent > 99.5 else "< 1 %" if percent < 0.5 else f"{percent:.0f} %"


def _gain(plan: Plan, proposal: Proposal) -> str:
    gain = proposal.after.evidence - plan.now.evidence
    return f"+{gain:.0f}" if gain >= 9.5 else f"+{max(gain, 0.0):.1f}"
