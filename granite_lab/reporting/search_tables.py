"""The tables of a search for a missing effect: effects, sensors, candidates, detectable sizes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from granite_lab.columns import Cell, Column, FilledTable, Table, number, probable, share, words
from granite_lab.discovery.finding import (
    Candidate,
    Detectable,
    EffectFinding,
    Finding,
    FittedParameter,
    Gap,
    LeftOut,
    Push,
)
from granite_lab.effects.library import met
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import FORMULA_ERROR
from granite_lab.reporting.answers import gap_pair
from granite_lab.reporting.names import (
    SAND,
    SCALES,
    SENSORS,
    STATUS,
    amount,
    declared,
    inside,
    meaning,
    plain,
    scale_of,
    scale_of_fitted,
    sensors_of,
)
from granite_lab.results import PHASES
from granite_lab.rounding import NONE, interval, percent, percent_of, tidy_unit

SURE = 0.95
"""A candidate that is named first in at least this share of the sets is distinguished from all others."""

FORMULA = percent(FORMULA_ERROR[0])
"""Error of the formula of an effect, as a reader sees it."""

NO_NUMBER = FittedParameter(NONE, "", Estimate(math.nan))


def _spaced(name: str) -> str:
    return name.replace("_", " ")


class Size(NamedTuple):
    """A number of an effect; what holds for the effect as a whole stands beside the first one."""

    effect: EffectFinding
    parameter: FittedParameter
    first: bool

    def once(self, cell: Cell) -> Cell:
        """Return a cell about the effect as a whole, blank beside its other numbers."""
        return cell if self.first else Cell("", cell.raw)


Kind = Literal["named", "likely", "described", "small"]
"""What a table of effects lists."""


def effects_table(finding: Finding, effects: Sequence[EffectFinding], kind: Kind = "named") -> FilledTable:
    """List effects of one kind and their numbers; what holds for an effect stands once."""
    name, title = "found_effects", "What is missing, with sizes"
    note = (
        f"Fitted together with the sand and the errors of the sensors. The std of a strength includes "
        f"{FORMULA} for the error of its formula. Share of the gap: the part of the closed gap that opens "
        f"when the effect is removed, {gap_pair(finding)[2]}."
    )
    if kind == "likely":
        name, title = "found_likely", "What is likely, but not certain"
    if kind == "described":
        name, title = "found_description", "What describes the rest"
    if kind == "small":
        name, title = "found_small", "Small effects"
        note = "Possibly present. They close little of the gap, or are smaller than the tolerance."

    def explanation(r: Size) -> str:
        return r.effect.formula if r.effect.empirical else meaning(r.effect.id, r.parameter.name)

    def size(r: Size) -> Cell:
        value = r.parameter.estimate
        return Cell(amount(r.effect, r.parameter), (value.value, value.std, r.parameter.unit))

    def ends(r: Size) -> Cell:
        both = r.parameter.estimate.interval()
        return Cell(interval(*both, *scale_of_fitted(r.effect, r.parameter)), both)

    def closes(r: Size) -> Cell:
        return r.once(Cell(percent_of(r.effect.closes), (r.effect.closes.value, r.effect.closes.std)))

    rows = [Size(e, p, k == 0) for e in effects for k, p in enumerate(e.parameters or (NO_NUMBER,))]
    return Table[Size](
        name,
        title,
        Column("effect", lambda r: r.once(words(plain(r.effect.id)))),
        Column("number", lambda r: "amount" if r.effect.empirical else _spaced(r.parameter.name)),
        Column("what it is", explanation),
        Column("value ± std", size, "value std unit"),
        Column("95 % interval", ends, "low high"),
        Column(
            "cannot be told from", lambda r: ", ".join(map(plain, r.effect.twins)) or "none",
            shown=any(e.twins for e in effects),
        ),
        Column("probability", lambda r: r.once(probable(r.effect.probability)), "probability"),
        Column("share of the gap", closes, "closes closes_std"),
        note=note,
    ).fill(rows, virtual=finding.virtual)  # fmt: skip


FORCES = {
    "force": "force along the robot",
    "lift": "lift",
    "moment": "moment on the body",
    "torque_f": "torque on the front wheels",
    "torque_r": "torque on the rear wheels",
}
"""What a force free in time may be."""


def ceiling_table(finding: Finding) -> FilledTable | None:
    """List what forces free in time could close, and where each is largest; None where nothing remains."""
    if finding.ceiling is None:
        return None
    most = finding.ceiling
    largest = {name: next((w for w in most.where if w.quantity == name), None) for name in FORCES}

    def place(name: str) -> Cell:
        w = largest.get(name)
        if w is None:
            return Cell(NONE, (None, None, None))
        return Cell(_when(w), (w.variant, w.start, w.end))

    def size(name: str) -> Cell:
        w = largest.get(name)
        return number(w.size if w else math.nan, 2, tidy_unit(w.unit) if w else "")

    return Table[str](
        "found_ceiling",
        "What any force could close beside this model",
        Column("force", lambda name: FORCES.get(name, "all of them together")),
        Column("closes of the gap", lambda name: share(most.parts.get(name, most.value)), "closes"),
        Column("largest", place, "speed start end"),
        Column("size there", size, "size"),
        note="Forces free in time, smooth over about 0.3 s, fitted beside the model to all trials and not "
        "credited to it. They are no cause and cannot be carried over to another speed. What they do not "
        "close, no force on the robot can close.",
    ).fill(["all", *FORCES], virtual=finding.virtual)


def ceiling_in_words(finding: Finding) -> str:
    """Say how much any force could close beside the model; empty where nothing was looked for."""
    if finding.ceiling is None:
        return "Nothing remains beyond the tolerance." if finding.verdict == "named" else ""
    most = finding.ceiling
    text = (
        f"In the fit, the model leaves {percent(most.left)} of the gap. Forces that vary freely in time "
        f"could close {percent(most.value)} of the gap"
    )
    if not most.where:
        return f"{text}."
    w = most.where[0]
    return f"{text}; the largest is a {FORCES[w.quantity]}, {_when(w)}."


def _when(place: Push) -> str:
    """Say when a force is largest."""
    start, end = f"{place.start:.2f}", f"{place.end:.2f}"
    when = f"at {start} s" if start == end else f"from {start} to {end} s"
    return f"{when} at {place.variant:.3g} m/s ({PHASES.get(place.phase, place.phase)})"


def discrepancies(finding: Finding) -> dict[str, tuple[float, float]]:
    """Return per channel the rms of its discrepancy in motion over its rms, without and with the effects."""

    def part(channel: str, name: str) -> float:
        residuals = [r for r in finding.residuals if r.channel == channel and r.size > 0]
        # A discrepancy has a std in the bins of the motion.
        values = np.concatenate([getattr(r, name)[r.std > 0] / r.size for r in residuals] or [np.zeros(0)])
        return float(np.sqrt(np.mean(values**2))) if values.size else math.nan

    return {c: (part(c, "discrepancy_before"), part(c, "discrepancy_after")) for c in sensors_of(finding)}


def gaps_table(finding: Finding) -> FilledTable:
    """List per sensor the gap, in the fit and on trials left out, and the discrepancy."""
    by_channel, unknown = discrepancies(finding), (math.nan, math.nan)
    every = (finding.gap, *finding.gaps)
    out = any(math.isfinite(v) for g in every for v in g.held_out)
    names = {"all": "all sensors"} | SENSORS

    def discrepancy(g: Gap, k: int) -> Cell:
        return number(by_channel.get(g.channel, unknown)[k], 2, "%", 100)

    return Table[Gap](
        "found_gaps",
        "Gap between sensors and model, without and with the effects found",
        Column("sensor", lambda g: names.get(g.channel, g.channel)),
        Column("in the fit: without", lambda g: g.train[0], "train_before", unit="–"),
        Column("with", lambda g: g.train[1], "train_after", unit="–"),
        Column("left out: without", lambda g: g.held_out[0], "held_out_before", unit="–", shown=out),
        Column("with", lambda g: g.held_out[1], "held_out_after", unit="–", shown=out),
        Column("discrepancy: without", lambda g: discrepancy(g, 0), "discrepancy_before"),
        Column("with", lambda g: discrepancy(g, 1), "discrepancy_after"),
        note="All sensors: rms of the residuals, divided by the rms that noise and tolerance explain; up to "
        "1: explained. A sensor: its largest discrepancy beyond its noise, divided by the tolerance. "
        "Discrepancy: difference to the model that all repetitions have in common, as a share of the "
        "sensor's rms in motion.",
    ).fill(every, virtual=finding.virtual)


LEFT_OUT = Table[tuple[str, LeftOut]](
    "found_left_out",
    "Prediction of trials and speeds left out of the fit",
    Column("left out", lambda r: r[0]),
    Column("without", lambda r: r[1].before, "before", unit="–"),
    Column("with", lambda r: r[1].after, "after", unit="–"),
    note="Gap of the trials that were left out, by the model fitted to the others, without and with the "
    "effects found.",
)


def left_out_table(finding: Finding) -> FilledTable:
    """List how well each trial and each speed is predicted by a fit that did not see it."""
    rows = [(x.name, x) for x in finding.trials_left_out]
    rows += [(f"all at {x.name} m/s", x) for x in finding.speeds_left_out]
    return LEFT_OUT.fill(rows, virtual=finding.virtual)


def _became(c: Candidate) -> str:
    bounds = ", ".join(map(_spaced, c.bounds))
    return STATUS[c.status] + (f" ({bounds})" if bounds else "")


CANDIDATES = Table[Candidate](
    "found_candidates",
    "Every candidate",
    Column("candidate", lambda c: plain(c.id)),
    Column("what it is", lambda c: getattr(met(c.id), "title", NONE)),
    Column(
        "probability", lambda c: words(NONE) if c.status == "screened" else probable(c.probability),
        "probability",
    ),
    # a fit to the noise closes no more than all of the gap
    Column("closes alone", lambda c: Cell(percent(min(c.closes, 1.0)), (c.closes,)), "closes"),
    Column("ln Bayes factor, alone", lambda c: c.gain, "log_bayes_factor", unit="–"),
    Column("result", _became),
    note="Probability that the effect is in the model; share of the gap that it closes alone, all trials in "
    "the fit; logarithm of the Bayes factor of the effect alone against the paper's model. A screened "
    "candidate was not fitted in full.",
)  # fmt: skip


def detectable_table(finding: Finding) -> FilledTable:
    """List the smallest size of every candidate that these trials show, and what limits it."""

    def ends_of(d: Detectable) -> tuple[float, float] | None:
        declaration = declared(d.effect, d.parameter)
        return (declaration.prior_low, declaration.prior_high) if declaration else None

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

    return Table[Detectable](
        "found_detectable",
        "Smallest sizes that these trials show",
        Column("candidate", lambda d: plain(d.effect)),
        Column("number", lambda d: _spaced(d.parameter)),
        Column("smallest size", size, "smallest"),
        Column("expected", expected, "expected_low expected_high"),
        Column("unit", lambda d: Cell(scale(d)[0] or NONE, (d.unit or NONE,)), "unit"),
        Column("limited by", lambda d: d.limit if math.isfinite(d.size) else NONE),
        Column("looks like", alike),
        note="An effect of this size is named with a probability of 80 %. Expected: range of the literature.",
    ).fill(finding.detectable, virtual=finding.virtual)


def confusion_table(finding: Finding) -> FilledTable | None:
    """List the candidates that would often be taken for another; None where nothing was checked."""
    check = finding.confusion
    if check is None:
        return None
    first = {i: float(check.matrix[k, k]) for k, i in enumerate(check.ids) if math.isfinite(check.missed[k])}
    unsure = [i for i, often in first.items() if often < SURE]
    others = {i: ", ".join(f"{plain(o)} ({percent(x)})" for o, x in check.taken_for(i)) for i in unsure}
    return Table[str](
        "found_confusion",
        "Candidates that these trials could take for another",
        Column("candidate", plain),
        Column("named first", lambda i: share(first[i]), "first"),
        Column("nothing named", lambda i: share(float(check.missed[check.ids.index(i)])), "missed"),
        Column("taken for", lambda i: others[i] or "none"),
        note=f"Each candidate in turn at {check.factor:g} times its smallest visible size, {check.draws} "
        f"times with other noise. All others are named first in at least {percent(SURE)} of these sets.",
    ).fill(unsure, virtual=finding.virtual)


def fitted_table(finding: Finding) -> FilledTable:
    """List the sand common to all trials, and what differs from trial to trial.

    a_θ has an answer of its own.
    """
    rows = []
    for name, log in finding.sand.items():
        if name != "a_theta":
            ratio = Estimate(float(np.expm1(log.value)), float(np.exp(log.value) * log.std))
            far = ", more than 2 std" if name in finding.strained else ""
            symbol = SAND[name][0] if name in SAND else name
            rows.append((symbol, f"from the file{far}", Cell(percent_of(ratio), (ratio.value,))))
    for name, std in finding.scales.items():
        text, unit, scale = SCALES.get(name, (name, "", 1.0))
        rows.append((text, "from trial to trial, std", number(std, 2, unit, scale)))
    return Table[tuple[str, str, Cell]](
        "found_fitted",
        f"Sand and sensors as fitted, compared with {inside(finding.soil.title)}",
        Column("number", lambda r: r[0]),
        Column("difference", lambda r: r[1]),
        Column("size", lambda r: r[2], "size"),
        note="Fitted together with everything else.",
    ).fill(rows, virtual=finding.virtual)
