"""What `discover` prints at its end: verdict, effects, gap, where, and which candidates were tried."""

from __future__ import annotations

import math

from rich.console import Console
from rich.text import Text

from granite_lab.discovery.finding import Finding
from granite_lab.reporting.discovery.amounts import amount
from granite_lab.reporting.discovery.answers import missing_answer
from granite_lab.reporting.discovery.names import STATUS, channel_name, in_plain_words, plain
from granite_lab.reporting.grid import TONES, grid, row_of, say
from granite_lab.reporting.rounding import evidence, places, significant

MOST = 6
"""Rows of a table on the terminal."""

VIRTUAL = "virtual data: written by a simulator."


def show_finding(finding: Finding, console: Console) -> None:
    """Print a finding so that it fits 80 columns."""
    answer = missing_answer(finding)
    line = Text()
    line.append(f"{answer.question} ", "bold")
    line.append(f"{answer.verdict.capitalize()}. ", TONES.get(answer.tone, ""))
    line.append(answer.text)
    console.print(line)
    if finding.virtual:
        say(console, VIRTUAL, "yellow")
    if any(not e.empirical for e in finding.effects):
        console.print()
        _effects(finding, console)
    console.print()
    _gaps(finding, console)
    if finding.where:
        console.print()
        _where(finding, console)
    if finding.rounds:
        console.print()
        _candidates(finding, console)
    for note in finding.notes:
        say(console, f"note: {in_plain_words(note, finding)}", "yellow")


def _effects(finding: Finding, console: Console) -> None:
    table = grid("missing effect", "number", "value ± std", "cannot be told from", words=(0, 1, 3))
    for effect in finding.effects:
        for i, p in enumerate(effect.parameters):
            table.add_row(
                *row_of(
                    plain(effect.id) if i == 0 else "",
                    p.name.replace("_", " "),
                    amount(effect, p),
                    (", ".join(map(plain, effect.twins)) or "–") if i == 0 else "",
                )
            )
    console.print(table)


def _gaps(finding: Finding, console: Console) -> None:
    table = grid(
        "gap between sensors and\nmodel, over the noise",
        "in the fit:\nbefore",
        "\nafter",
        "left out:\nbefore",
        "\nafter",
        words=(0,),
    )
    rows = [("everything", finding.gap)]
    rows += [(channel_name(g.channel), g) for g in finding.gaps if g.phase == "all" and g.channel != "all"]
    for name, g in rows:
        values = (*g.train[:2], *g.held_out[:2])
        shown = [_number(v) for v in values]
        if not finding.effects:
            shown[1] = shown[3] = "–"
        table.add_row(*row_of(name, *shown))
    console.print(table)


def _where(finding: Finding, console: Console) -> None:
    table = grid(
        "where the model without\neffects is off", "\nphase", "speed\n[m/s]", "from\n[s]", "to\n[s]",
        "near\n[Hz]", "over\nnoise", words=(0, 1),
    )  # fmt: skip
    for d in sorted(finding.where, key=lambda d: -d.strength)[:MOST]:
        table.add_row(
            *row_of(
                channel_name(d.channel), d.phase, f"{d.variant:g}", places(d.start, 2),
                places(d.end, 2), significant(d.frequency, 2), significant(d.strength, 2),
            )
        )  # fmt: skip
    console.print(table)
    if len(finding.where) > MOST:
        say(console, f"and {len(finding.where) - MOST} weaker intervals; finding.json lists them all", "dim")


def _candidates(finding: Finding, console: Console) -> None:
    named = {e.id for e in finding.effects}
    table = grid("candidate", "evidence", "how far it was tried", words=(0, 2))
    for c in finding.rounds[0][:MOST]:
        drop = "–" if c.status == "not converged" else evidence(c.evidence)
        name = Text(plain(c.id), TONES["good"] if c.id in named else "")
        table.add_row(*row_of(name, drop, STATUS.get(c.status, c.status)))
    console.print(table)
    more = len(finding.rounds[0]) - MOST
    rest = f"{more} more are weaker. " if more > 0 else ""
    say(
        console,
        f"{rest}Evidence is a drop of χ²; chance alone exceeds {significant(finding.threshold, 2)} in 1 set "
        "of 100.",
        "dim",
    )


def _number(value: float) -> str:
    return significant(value, 3) if math.isfinite(value) else "–"
