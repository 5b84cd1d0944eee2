"""What `discover` prints at its end: verdict, effects, gap, where, and which candidates were tried."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from granite_lab.discovery.finding import Finding, FoundEffect
from granite_lab.reporting.discovery.amounts import amount
from granite_lab.reporting.discovery.answers import missing_answer, percent, percent_of
from granite_lab.reporting.discovery.names import (
    STATUS,
    channel_name,
    in_plain_words,
    latency_in_words,
    listed,
    plain,
    shown_candidates,
)
from granite_lab.reporting.discovery.residue import discrepancies
from granite_lab.reporting.grid import TONES, grid, row_of, say
from granite_lab.reporting.rounding import places, significant

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
    for title, effects in (("missing effect", finding.effects), ("small effect", finding.small)):
        if effects:
            console.print()
            _effects(title, effects, console)
    console.print()
    _gaps(finding, console)
    if finding.where:
        console.print()
        _where(finding, console)
    if finding.candidates:
        console.print()
        _candidates(finding, console)
    if latency := latency_in_words(finding.latency):
        say(console, f"{latency}.")
    for trial, reason in finding.dropped:
        say(console, f"left out: {trial}: {reason}", "red")
    for note in finding.notes:
        say(console, f"note: {in_plain_words(note, finding)}", "yellow")


def _effects(title: str, effects: Sequence[FoundEffect], console: Console) -> None:
    table = grid(title, "number", "value ± std", "probability", "closes of\nthe gap", words=(0, 1))
    for effect in effects:
        whole = (percent(effect.probability), percent_of(effect.closes))
        for i, p in enumerate(effect.parameters):
            name = "amount" if effect.empirical else p.name.replace("_", " ")
            first = plain(effect.id) if i == 0 else ""
            table.add_row(*row_of(first, name, amount(effect, p), *(whole if i == 0 else ("", ""))))
    console.print(table)
    for effect in effects:
        if effect.twins:
            twins = listed([plain(t) for t in effect.twins], "or")
            say(console, f"these trials cannot tell {plain(effect.id)} from {twins}", "yellow")


def _gaps(finding: Finding, console: Console) -> None:
    out = math.isfinite(finding.gap.held_out[0])
    titles = ["in the fit:\nbefore", "\nafter", *(("left out:\nbefore", "\nafter") if out else ())]
    table = grid("gap over noise and tolerance;\ndiscrepancy over the rms", *titles,
                 "discr.:\nbefore", "\nafter", words=(0,))  # fmt: skip
    shares = discrepancies(finding)
    for g in (finding.gap, *finding.gaps):
        name = "everything" if g.channel == "all" else channel_name(g.channel)
        values = (*g.train, *(g.held_out if out else ()))
        shown = [significant(v, 3) if math.isfinite(v) else "–" for v in values]
        shown += [percent(s) for s in shares.get(g.channel, (math.nan, math.nan))]
        if not finding.effects:
            shown[1::2] = ["–"] * (len(shown) // 2)
        table.add_row(*row_of(name, *shown))
    console.print(table)


def _where(finding: Finding, console: Console) -> None:
    table = grid(
        "where the model without\neffects is off", "\nphase", "speed\n[m/s]", "from\n[s]", "to\n[s]",
        "near\n[Hz]", "of the\nrms", words=(0, 1),
    )  # fmt: skip
    for d in sorted(finding.where, key=lambda d: -d.share)[:MOST]:
        table.add_row(
            *row_of(
                channel_name(d.channel), d.phase, f"{d.variant:g}", places(d.start, 2),
                places(d.end, 2), significant(d.frequency, 2), percent(d.share),
            )
        )  # fmt: skip
    console.print(table)
    if len(finding.where) > MOST:
        say(console, f"and {len(finding.where) - MOST} smaller intervals; finding.json lists them all", "dim")


def _candidates(finding: Finding, console: Console) -> None:
    table = grid("candidate", "probability", "closes alone", "status", words=(0, 3))
    shown = shown_candidates(finding)
    for c in shown[:MOST]:
        name = Text(plain(c.id), TONES["good"] if c.status == "named" else "")
        table.add_row(*row_of(name, percent(c.probability), percent(c.closes), STATUS[c.status]))
    console.print(table)
    more = len(shown) - MOST
    if more > 0:
        say(console, f"{more} more are less likely; finding.json lists them all", "dim")
