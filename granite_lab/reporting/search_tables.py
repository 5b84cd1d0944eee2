"""The tables of a search for the missing effect: effects, sensors, candidates, and what was fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.finding import Candidate, Detectable, Finding, FoundEffect, FoundParameter
from granite_lab.effects.library import met
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import FORMULA_ERROR
from granite_lab.reporting.names import (
    amount,
    channels_of,
    declared,
    meaning,
    plain,
    scale_of,
    shown_candidates,
)
from granite_lab.reporting.rounding import NONE, interval, percent, percent_of
from granite_lab.reporting.tables import Cell, Cells, Table, number, share, tabulate, words
from granite_lab.reporting.words import WORDS, sensor

SURE = 0.95
"""Share of sets from which on a candidate is told from all others."""


def effects_table(finding: Finding, effects: Sequence[FoundEffect], *, small: bool = False) -> Table:
    """List effects, each number with its interval; what holds for the whole effect stands in its first row.

    Args:
        finding: the record.
        effects: of the finding, those that were named or the small ones.
        small: they are the small ones.
    """
    Row = tuple[FoundEffect, FoundParameter, bool]

    def what(r: Row) -> str:
        return "term of an empirical law" if r[0].empirical else meaning(r[0].id, r[1].name) or NONE

    def value(r: Row) -> Cell:
        return Cell(amount(r[0], r[1]), (r[1].estimate.value, r[1].estimate.std, r[1].unit))

    def ends(r: Row) -> Cell:
        e, p = r[:2]
        both = p.estimate.interval()
        return Cell(interval(*both, *scale_of(e.id, p.name, p.unit, p.estimate.value)), both)

    def once(r: Row, cell: Cell) -> Cell:
        return cell if r[2] else Cell("", cell.raw)

    cells: Cells = {
        "effect": lambda r: once(r, words(plain(r[0].id))),
        "number": lambda r: "amount" if r[0].empirical else r[1].name.replace("_", " "),
        "meaning": what,
        "value": value,
        "interval": ends,
        "twins": lambda r: ", ".join(plain(t) for t in r[0].twins) or "none",
        "probability": lambda r: once(r, share(r[0].probability)),
        "closes": lambda r: once(r, Cell(percent_of(r[0].closes), (r[0].closes.value, r[0].closes.std))),
    }
    no_number = FoundParameter(NONE, "", Estimate(math.nan))
    rows = [(e, p, k == 0) for e in effects for k, p in enumerate(e.parameters or (no_number,))]
    return tabulate(
        "found_small" if small else "found_effects", rows, cells, virtual=finding.virtual,
        skip=() if any(e.twins for e in effects) else ("twins",), formula=percent(FORMULA_ERROR[0]),
    )  # fmt: skip


def discrepancies(finding: Finding) -> dict[str, tuple[float, float]]:
    """Return per channel the rms of its discrepancy in motion over its rms, without and with the effects."""

    def part(channel: str, name: str) -> float:
        own = [r for r in finding.residuals if r.channel == channel and r.size > 0]
        # A discrepancy has a std in the bins of the motion.
        values = np.concatenate([getattr(r, name)[r.std > 0] / r.size for r in own] or [np.zeros(0)])
        return float(np.sqrt(np.mean(values**2))) if values.size else math.nan

    return {c: (part(c, "discrepancy_before"), part(c, "discrepancy_after")) for c in channels_of(finding)}


def gaps_table(finding: Finding) -> Table:
    """List per sensor the gap, in the fit and on trials left out, and the discrepancy."""
    shares, unknown = discrepancies(finding), (math.nan, math.nan)
    every = (finding.gap, *finding.gaps)
    out = any(math.isfinite(v) for g in every for v in g.held_out)
    cells: Cells = {
        "sensor": lambda g: "all channels" if g.channel == "all" else sensor(g.channel),
        "without": lambda g: number(shares.get(g.channel, unknown)[0], 2, "%", 100),
        "with": lambda g: number(shares.get(g.channel, unknown)[1], 2, "%", 100),
    }
    skip = () if out else ("held_out.0:3", "held_out.1:3")
    return tabulate("found_gaps", every, cells, virtual=finding.virtual, skip=skip)


def left_out_table(finding: Finding) -> Table | None:
    """List how well each trial and each speed is predicted by a fit that did not see it; None without any."""
    rows = [(x.name, x) for x in finding.trials_left_out]
    rows += [(f"all at {x.name} m/s", x) for x in finding.speeds_left_out]
    return tabulate("found_left_out", rows, virtual=finding.virtual) if rows else None


def candidates_table(finding: Finding) -> Table:
    """List every candidate with its probability, the share of the gap it closes, and what became of it."""

    def result(c: Candidate) -> str:
        bounds = ", ".join(b.replace("_", " ") for b in c.bounds)
        return str(WORDS["candidate"][c.status]) + (f" ({bounds})" if bounds else "")

    cells: Cells = {
        "candidate": lambda c: plain(c.id),
        "meaning": lambda c: getattr(met(c.id), "title", NONE),
        # a fit to the noise closes no more than all of the gap
        "closes": lambda c: Cell(percent(min(c.closes, 1.0)), (c.closes,)),
        "result": result,
    }
    return tabulate("found_candidates", shown_candidates(finding), cells, virtual=finding.virtual)


def detectable_table(finding: Finding) -> Table:
    """List the smallest size of every candidate that these trials show, and what limits it."""

    def ends_of(d: Detectable) -> tuple[float, float] | None:
        known = declared(d.effect, d.parameter)
        return (known.prior_low, known.prior_high) if known else None

    def scale(d: Detectable) -> tuple[str, float]:
        return scale_of(d.effect, d.parameter, d.unit, max(map(abs, ends_of(d) or (d.size,))))

    def expected(d: Detectable) -> Cell:
        ends = ends_of(d)
        text = " to ".join(f"{v * scale(d)[1]:.4g}".replace("-", "−") for v in ends) if ends else NONE
        return Cell(text, ends or (None, None))

    def size(d: Detectable) -> Cell:
        seen = math.isfinite(d.size)
        return number(d.size, 2, scale=scale(d)[1]) if seen else Cell("not visible", (None,))

    def alike(d: Detectable) -> str:
        first, more = ", ".join(plain(i) for i in d.confused_with[:3]), len(d.confused_with) - 3
        return f"{first} and {more} more" if more > 0 else first or "none"

    cells: Cells = {
        "candidate": lambda d: plain(d.effect),
        "number": lambda d: d.parameter.replace("_", " "),
        "size": size,
        "expected": expected,
        "unit": lambda d: Cell(scale(d)[0] or "–", (d.unit or "–",)),
        "limit": lambda d: d.limit if math.isfinite(d.size) else NONE,
        "alike": alike,
    }
    return tabulate("found_detectable", finding.detectable, cells, virtual=finding.virtual)


def confusion_table(finding: Finding) -> Table | None:
    """List the candidates that would often be taken for another; None without any."""
    check = finding.confusion
    if check is None:
        return None
    first = {i: float(check.matrix[k, k]) for k, i in enumerate(check.ids) if math.isfinite(check.missed[k])}
    unsure = [i for i, often in first.items() if often < SURE]
    others = {i: ", ".join(f"{plain(o)} ({percent(x)})" for o, x in check.taken_for(i)) for i in unsure}
    cells: Cells = {
        "candidate": plain,
        "first": lambda i: share(first[i]),
        "missed": lambda i: share(float(check.missed[check.ids.index(i)])),
        "others": lambda i: others[i] or "none",
    }
    table = tabulate(
        "found_confusion", unsure, cells, virtual=finding.virtual, factor=check.factor, draws=check.draws,
        sure=percent(SURE),
    )  # fmt: skip
    return table if unsure else None


def fitted_table(finding: Finding) -> Table | None:
    """List the sand common to all trials, and what differs from trial to trial; None without any.

    a_θ has an answer of its own.
    """
    rows = []
    for name, log in finding.sand.items():
        if name != "a_theta":
            ratio = Estimate(float(np.expm1(log.value)), float(np.exp(log.value) * log.std))
            text = WORDS["sand"].get(name, name)
            rows.append((text, "from the file", Cell(percent_of(ratio), (ratio.value,))))
    for name, std in finding.scales.items():
        text, unit, scale = WORDS["scales"].get(name, (name, "", 1.0))
        rows.append((text, "from trial to trial, std", number(std, 2, unit, scale)))
    table = tabulate("found_fitted", rows, virtual=finding.virtual, soil=finding.soil.title)
    return table if rows else None
