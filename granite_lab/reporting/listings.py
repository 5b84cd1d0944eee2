"""Listings on a terminal: an inspected log, parameters in force, effects."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from granite_lab.logs.inspected import FileReport, Inspection
from granite_lab.model.effect import Effect, EffectParameter
from granite_lab.parameters import Variant
from granite_lab.parameters.catalogue import Provenance
from granite_lab.reporting.grid import TONES, clean, grid, row_of, say
from granite_lab.reporting.rounding import NONE, significant, tidy_unit


def show_inspection(inspection: Inspection, console: Console) -> None:
    """Print what was recognised in each file: layout, columns, clocks, standstills, motion, doubts."""
    for i, report in enumerate(inspection.files):
        if i:
            console.print()
        say(console, str(report.path), "bold")
        if report.problem:
            say(console, report.problem, TONES["bad"])
        if report.problem and not report.columns:
            continue
        _file(report, console)


def _file(report: FileReport, console: Console) -> None:
    sure = f"{100 * report.confidence:.0f} % sure"
    layout = (
        f"layout “{report.layout}”"
        if report.layout
        else "no known layout; columns guessed from names and values"
    )
    say(console, f"{layout}, {sure}")
    if report.dialect is not None:
        d = report.dialect
        say(
            console,
            f"text: {d.encoding}, {d.delimiter_name} between columns, decimal “{d.decimal}”, header in line "
            f"{d.header_line}, first row in line {d.data_line}",
            "dim",
        )
    table = grid("column", "becomes", "unit", "sure [%]", "from", "to", words=(0, 1, 2))
    for c in report.columns:
        table.add_row(
            *row_of(
                c.name or f"(column {c.place + 1})", ", ".join(c.to) or Text(c.why or "not used", "dim"),
                tidy_unit(c.unit) if c.to else "",
                _sure(c.confidence) if c.to else "", _number(c.low), _number(c.high),
            )
        )  # fmt: skip
    console.print(table)
    if report.streams:
        console.print()
        clocks = grid(
            "clock", "samples", "from [s]", "to [s]", "rate [Hz]", "jitter [ms]", "gaps", words=(0,)
        )
        for s in report.streams:
            gaps = f"{s.gaps} (≤ {significant(s.longest_gap, 2)} s)" if s.gaps else "0"
            clocks.add_row(
                *row_of(
                    s.what, str(s.samples), f"{s.start:.2f}", f"{s.end:.2f}", significant(s.rate),
                    significant(1e3 * s.jitter, 2),
                    gaps,
                )
            )  # fmt: skip
        console.print(clocks)
    rests = ", ".join(f"{start:.2f}–{end:.2f} s" for start, end in report.rests)
    say(console, f"standstills: {rests or 'none found'}")
    if report.motion is not None:
        m = report.motion
        which = f", variant {m.variant.velocity:g} m/s of Table 2" if m.variant else ", no variant of Table 2"
        say(
            console,
            f"motion: {significant(m.velocity)} m/s, {significant(m.acceleration, 2)} m/s², "
            f"{significant(m.distance)} m at the wheels{which} ({100 * m.confidence:.0f} % sure)",
        )
    for doubt in report.doubts:
        say(console, f"doubt: {doubt}", "yellow")


def _sure(confidence: float) -> Text:
    tone = "good" if confidence >= 0.9 else "fair" if confidence >= 0.6 else "bad"
    return Text(f"{100 * confidence:.0f}", TONES[tone])


def _number(value: float) -> str:
    return "" if math.isnan(value) else significant(value)


def show_parameters(rows: Sequence[Provenance], variants: Sequence[Variant], console: Console) -> None:
    """Print every parameter in force with symbol, unit, allowed range and origin."""
    for group in dict.fromkeys(row.group for row in rows):
        members = [row for row in rows if row.group == group]
        common = Counter(row.origin for row in members).most_common(1)[0][0]
        console.print(Text.assemble((group, "bold"), (f"  from {common}", "dim")))
        table = grid("key", "symbol", "value", "unit", "allowed", "", words=(0, 1, 3, 4, 5))
        for row in members:
            value = f"{row.value:g}" if isinstance(row.value, (int, float)) else str(row.value)
            other = clean(row.origin, "dim") if row.origin != common else ""
            table.add_row(*row_of(row.key, row.symbol, value, row.unit, _bounds(row.low, row.high), other))
        console.print(table)
        console.print()
    say(console, "variants (Table 2)", "bold")
    table = grid("velocity [m/s]", "acceleration [m/s²]", "distance [m]")
    for v in variants:
        table.add_row(*row_of(f"{v.velocity:g}", f"{v.acceleration:g}", f"{v.distance:g}"))
    console.print(table)


def _bounds(low: float, high: float) -> str:
    return f"{low:g} … {high:g}"


def show_effects(effects: Sequence[Effect], console: Console) -> None:
    """Print one line per effect."""
    table = grid("effect", "what it is", "parameters", words=(0, 1, 2))
    for effect in effects:
        table.add_row(*row_of(effect.id, effect.title, ", ".join(_named(p) for p in effect.parameters)))
    console.print(table)


def _named(p: EffectParameter) -> str:
    return f"{p.name} [{tidy_unit(p.unit)}]" if p.unit else p.name


def show_effect(effect: Effect, console: Console) -> None:
    """Print what an effect is: equation, source, what an observer sees, parameters."""
    say(console, f"{effect.id}: {effect.title}", "bold")
    for label, text in (
        ("equation", effect.equation),
        ("source", effect.source),
        ("seen as", effect.signature),
    ):
        line = Text(f"{label}: ", "dim")
        line.append_text(clean(text))
        console.print(line)
    table = grid("parameter", "unit", "neutral", "allowed", "expected", "meaning", words=(0, 1, 3, 4, 5))
    for p in effect.parameters:
        table.add_row(
            *row_of(
                p.name, tidy_unit(p.unit) or NONE, f"{p.neutral:g}", _bounds(p.low, p.high),
                _bounds(p.prior_low, p.prior_high), p.meaning,
            )
        )  # fmt: skip
    console.print(table)
