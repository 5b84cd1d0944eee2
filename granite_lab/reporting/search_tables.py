"""The tables of a search for the missing effect: effects, sensors, candidates, and what was fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.finding import Detectable, Finding, FoundEffect, FoundParameter
from granite_lab.effects.library import met
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import FORMULA_ERROR
from granite_lab.reporting import names
from granite_lab.reporting.rounding import NONE, interval, percent, percent_of
from granite_lab.reporting.table import Cell, Table, number, share, tabulate, words
from granite_lab.reporting.words import WORDS, sensor

LIKELY = 1.96
"""Standard deviations on either side of a value that make its 95 % interval."""

SURE = 0.95
"""Share of sets from which on a candidate is told from all others."""


def effects_table(finding: Finding, effects: Sequence[FoundEffect], *, small: bool = False) -> Table:
    """List effects, each number with its interval.

    Args:
        finding: the record.
        effects: of the finding, those that were named or the small ones.
        small: they are the small ones.
    """

    def bounds(e: FoundEffect, p: FoundParameter) -> Cell:
        low, high = (p.estimate.value + sign * LIKELY * p.estimate.std for sign in (-1, 1))
        return Cell(interval(low, high, *names.scale_of(e.id, p.name, p.unit, p.estimate.value)), (low, high))

    def once(first: bool, cell: Cell) -> Cell:
        return (
            cell if first else Cell("", cell.raw)
        )  # what holds for the whole effect stands in its first row

    def closes(e: FoundEffect) -> Cell:
        return Cell(percent_of(e.closes), (e.closes.value, e.closes.std))

    no_number = FoundParameter(NONE, "", Estimate(math.nan))
    return tabulate(
        "found_small" if small else "found_effects",
        [(e, p, k == 0) for e in effects for k, p in enumerate(e.parameters or (no_number,))],
        [
            ("effect", "", lambda r: once(r[2], words(names.plain(r[0].id)))),
            ("number", "", lambda r: "amount" if r[0].empirical else r[1].name.replace("_", " ")),
            ("what it is", "", lambda r: "term of an empirical law" if r[0].empirical
             else names.meaning(r[0].id, r[1].name) or NONE),
            ("value ± std", "value std unit",
             lambda r: Cell(names.amount(r[0], r[1]), (r[1].estimate.value, r[1].estimate.std, r[1].unit))),
            ("95 % interval", "low high", lambda r: bounds(r[0], r[1])),
            ("cannot be told from", "", lambda r: ", ".join(names.plain(t) for t in r[0].twins) or "none")
            if any(e.twins for e in effects) else None,
            ("probability", "probability", lambda r: once(r[2], share(r[0].probability))),
            ("gap lost without it", "closes closes_std", lambda r: once(r[2], closes(r[0]))),
        ],
        virtual=finding.virtual, formula=percent(FORMULA_ERROR[0]),
    )  # fmt: skip


def discrepancies(finding: Finding) -> dict[str, tuple[float, float]]:
    """Return per channel the rms of its discrepancy in motion over its rms, without and with the effects."""

    def part(channel: str, name: str) -> float:
        own = [r for r in finding.residuals if r.channel == channel and r.size > 0]
        # A discrepancy has a std in the bins of the motion.
        values = np.concatenate([getattr(r, name)[r.std > 0] / r.size for r in own] or [np.zeros(0)])
        return float(np.sqrt(np.mean(values**2))) if values.size else math.nan

    return {
        c: (part(c, "discrepancy_before"), part(c, "discrepancy_after")) for c in names.channels_of(finding)
    }


def gaps_table(finding: Finding) -> Table:
    """List per sensor the gap, in the fit and on trials left out, and the discrepancy."""
    shares, unknown = discrepancies(finding), (math.nan, math.nan)
    every = (finding.gap, *finding.gaps)
    out = any(math.isfinite(v) for g in every for v in g.held_out)
    return tabulate(
        "found_gaps", every,
        [
            ("sensor", "", lambda g: "all channels" if g.channel == "all" else sensor(g.channel)),
            ("in the fit: without [–]", "train_before", lambda g: number(g.train[0], 3)),
            ("with [–]", "train_after", lambda g: number(g.train[1], 3)),
            ("left out: without [–]", "held_out_before", lambda g: number(g.held_out[0], 3)) if out else None,
            ("with [–]", "held_out_after", lambda g: number(g.held_out[1], 3)) if out else None,
            ("discrepancy: without", "discrepancy_before",
             lambda g: number(shares.get(g.channel, unknown)[0], 2, "%", 100)),
            ("with", "discrepancy_after", lambda g: number(shares.get(g.channel, unknown)[1], 2, "%", 100)),
        ],
        virtual=finding.virtual,
    )  # fmt: skip


def left_out_table(finding: Finding) -> Table | None:
    """List how well each trial and each speed is predicted by a fit that did not see it; None without any."""
    rows = [(x.name, x) for x in finding.trials_left_out]
    rows += [(f"all at {x.name} m/s", x) for x in finding.speeds_left_out]
    table = tabulate(
        "found_left_out", rows,
        [
            ("left out", "", lambda r: r[0]),
            ("without [–]", "before", lambda r: number(r[1].before, 3)),
            ("with [–]", "after", lambda r: number(r[1].after, 3)),
        ],
        virtual=finding.virtual,
    )  # fmt: skip
    return table if rows else None


def candidates_table(finding: Finding) -> Table:
    """List every candidate with its probability, the share of the gap it closes, and what became of it."""
    return tabulate(
        "found_candidates", names.shown_candidates(finding),
        [
            ("candidate", "", lambda c: names.plain(c.id)),
            ("what it is", "", lambda c: getattr(met(c.id), "title", NONE)),
            ("probability", "probability", lambda c: share(c.probability)),
            # a fit to the noise closes no more than all of the gap
            ("closes alone", "closes", lambda c: Cell(percent(min(c.closes, 1.0)), (c.closes,))),
            ("ln Bayes factor [–]", "log_bayes_factor", lambda c: number(c.gain, 3)),
            ("result", "", lambda c: WORDS["candidate"][c.status]
             + (f" ({', '.join(b.replace('_', ' ') for b in c.bounds)})" if c.bounds else "")),
        ],
        virtual=finding.virtual,
    )  # fmt: skip


def detectable_table(finding: Finding) -> Table:
    """List the smallest size of each candidate that these trials show, and what limits it."""

    def ends_of(d: Detectable) -> tuple[float, float] | None:
        known = names.declared(d.effect, d.parameter)
        return (known.prior_low, known.prior_high) if known else None

    def expected(d: Detectable) -> Cell:
        ends = ends_of(d)
        text = " to ".join(f"{v * scale(d)[1]:.4g}".replace("-", "−") for v in ends) if ends else NONE
        return Cell(text, ends or (None, None))

    def scale(d: Detectable) -> tuple[str, float]:
        return names.scale_of(d.effect, d.parameter, d.unit, max(map(abs, ends_of(d) or (d.size,))))

    def size(d: Detectable) -> Cell:
        seen = math.isfinite(d.size)
        return number(d.size, 2, scale=scale(d)[1]) if seen else Cell("not visible", (None,))

    def alike(d: Detectable) -> str:
        first = ", ".join(names.plain(i) for i in d.confused_with[:3])
        more = len(d.confused_with) - 3
        return f"{first} and {more} more" if more > 0 else first or "none"

    return tabulate(
        "found_detectable", finding.detectable,
        [
            ("candidate", "", lambda d: names.plain(d.effect)),
            ("number", "", lambda d: d.parameter.replace("_", " ")),
            ("smallest size", "smallest", size),
            ("expected", "expected_low expected_high", expected),
            ("unit", "unit", lambda d: Cell(scale(d)[0] or "–", (d.unit or "–",))),
            ("limited by", "", lambda d: d.limit if math.isfinite(d.size) else NONE),
            ("looks like", "", alike),
        ],
        virtual=finding.virtual,
    )  # fmt: skip


def confusion_table(finding: Finding) -> Table | None:
    """List the candidates that would often be taken for another; None without any."""
    check = finding.confusion
    if check is None:
        return None
    first = {i: float(check.matrix[k, k]) for k, i in enumerate(check.ids) if math.isfinite(check.missed[k])}
    unsure = [i for i, often in first.items() if often < SURE]
    others = {i: ", ".join(f"{names.plain(o)} ({percent(x)})" for o, x in check.taken_for(i)) for i in unsure}
    table = tabulate(
        "found_confusion", unsure,
        [
            ("candidate", "", names.plain),
            ("named first", "first", lambda i: share(first[i])),
            ("nothing named", "missed", lambda i: share(float(check.missed[check.ids.index(i)]))),
            ("taken for", "", lambda i: others[i] or "none"),
        ],
        virtual=finding.virtual, factor=check.factor, draws=check.draws, sure=percent(SURE),
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
            rows.append(
                (WORDS["sand"].get(name, name), "from the file", Cell(percent_of(ratio), (ratio.value,)))
            )
    for name, std in finding.scales.items():
        text, unit, scale = WORDS["scales"].get(name, (name, "", 1.0))
        rows.append((text, "from trial to trial, std", number(std, 2, unit, scale)))
    table = tabulate(
        "found_fitted", rows,
        [
            ("number", "", lambda r: r[0]), ("difference", "", lambda r: r[1]),
            ("size", "size", lambda r: r[2]),
        ],
        virtual=finding.virtual, soil=finding.soil.title,
    )  # fmt: skip
    return table if rows else None
