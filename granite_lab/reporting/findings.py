"""What `discover` prints at its end: verdict, effects, gap, where, and what the trials can show."""

from __future__ import annotations

import math

from rich.console import Console

from granite_lab.discovery.finding import Finding
from granite_lab.reporting.grid import grid, row_of, say
from granite_lab.reporting.rounding import plus_minus, significant

MOST = 8
"""Rows of a table on the terminal."""

TITLES = {
    "none": "The model explains the trials",
    "named": "An effect is missing from the model, and it is named",
    "unknown": "An effect is missing from the model, and no candidate explains it",
}


def show_finding(finding: Finding, console: Console) -> None:
    """Print a finding so that it fits 80 columns."""
    say(console, TITLES[finding.verdict] + (" (virtual data)" if finding.virtual else ""), "bold")
    say(console, finding.sentence)
    if finding.effects:
        _effects(finding, console)
    _gaps(finding, console)
    if finding.where:
        _where(finding, console)
    if finding.rounds:
        _candidates(finding, console)
    for note in finding.notes:
        say(console, f"note: {note}")


def _effects(finding: Finding, console: Console) -> None:
    table = grid("effect", "parameter", "value ± std", "cannot be told from", words=(0, 1, 3))
    for effect in finding.effects:
        for i, p in enumerate(effect.parameters):
            table.add_row(
                *row_of(
                    effect.id if i == 0 else "",
                    p.name,
                    plus_minus(p.estimate, p.unit),
                    ", ".join(effect.twins) if i == 0 else "",
                )
            )
    console.print(table)


def _gaps(finding: Finding, console: Console) -> None:
    table = grid("gap, rms over noise", "before", "after", "floor", words=(0,))
    rows = [("all trials", finding.gap.train), ("trials held out", finding.gap.held_out)]
    rows += [(g.channel, g.train) for g in finding.gaps if g.phase == "all" and g.channel != "all"]
    for name, values in rows:
        table.add_row(*row_of(name, *(_number(v) for v in values)))
    console.print(table)


def _where(finding: Finding, console: Console) -> None:
    table = grid("disagreement", "phase", "speed [m/s]", "from [s]", "to [s]", "strength", words=(0, 1))
    strongest = sorted(finding.where, key=lambda d: -d.strength)[:MOST]
    for d in strongest:
        table.add_row(
            *row_of(
                d.channel, d.phase, f"{d.variant:g}", f"{d.start:.2f}", f"{d.end:.2f}", f"{d.strength:.1f}"
            )
        )
    console.print(table)
    if len(finding.where) > MOST:
        say(console, f"and {len(finding.where) - MOST} weaker disagreements, in finding.json")


def _candidates(finding: Finding, console: Console) -> None:
    table = grid("candidate", "evidence", "looked at", words=(0, 2))
    for c in finding.rounds[0][:MOST]:
        table.add_row(*row_of(c.id, _number(c.evidence), c.status))
    console.print(table)
    say(console, f"evidence is a drop of χ²; chance exceeds {finding.threshold:.0f} in 1 set of 100")


def _number(value: float) -> str:
    return significant(value, 3) if math.isfinite(value) else "–"
