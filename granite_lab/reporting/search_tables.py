"""The tables of a search: effects, gaps, intervals, candidates, smallest sizes, sand, trials left out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from granite_lab.discovery.finding import Finding, FoundEffect, FoundParameter
from granite_lab.estimate import Estimate
from granite_lab.model.effect import Effect
from granite_lab.reporting.names import (
    SAND,
    SCALES,
    STATUS,
    amount,
    channel_name,
    channels_of,
    meaning,
    percent,
    percent_of,
    plain,
    scale_of,
    shown_candidates,
)
from granite_lab.reporting.rounding import NONE, interval, significant
from granite_lab.reporting.table import Cell, Column, Table, columns, number, words

LIKELY = 1.96
"""Standard deviations on either side of a value that make its 95 % interval."""


SURE = 0.95
"""Share of sets from which on a candidate is told from all others."""


def _table(
    finding: Finding, name: str, title: str, caption: str, head: Sequence[Column],
    rows: Sequence[Sequence[Cell]]
) -> Table | None:  # fmt: skip
    """Return a table; None without rows."""
    full = tuple(tuple(row) for row in rows)
    return Table(f"found_{name}", title, caption, tuple(head), full, finding.virtual) if full else None


def effects_table(
    finding: Finding, known: Mapping[str, Effect], effects: Sequence[FoundEffect], *, small: bool = False
) -> Table | None:
    """List effects, each number with its interval.

    Args:
        finding: the record.
        known: candidates by id, for what their numbers mean.
        effects: of the finding, those that were named or the small ones.
        small: they are the small ones.
    """
    rows, twins = [], any(e.twins for e in effects)
    for e in effects:
        for k, p in enumerate(e.parameters or (FoundParameter(NONE, "", Estimate(math.nan)),)):
            half, value = LIKELY * p.estimate.std, p.estimate.value
            unit, scale = scale_of(e.id, p.name, p.unit, value)
            text = "term of an empirical law" if e.empirical else meaning(e.id, p.name, known) or NONE
            first = k == 0  # what holds for the whole effect stands in its first row
            rows.append(
                (
                    Cell(plain(e.id) if first else "", (plain(e.id),)),
                    words("amount" if e.empirical else p.name.replace("_", " ")), words(text),
                    Cell(amount(e, p), (value, p.estimate.std, p.unit)),
                    Cell(interval(value - half, value + half, unit, scale), (value - half, value + half)),
                    *((words(", ".join(plain(t) for t in e.twins) or "none"),) if twins else ()),
                    Cell(percent(e.probability) if first else "", (e.probability,)),
                    Cell(percent_of(e.closes) if first else "", (e.closes.value, e.closes.std)),
                )
            )  # fmt: skip
    head = columns(
        "effect", "number", "what it is", ("value ± std", ("value", "std", "unit")),
        ("95 % interval", ("low", "high")), *(("cannot be told from",) if twins else ()),
        ("probability", ("probability",)), ("gap lost without it", ("closes", "closes_std")),
    )  # fmt: skip
    if small:
        return _table(
            finding, "small", "Small effects",
            "Possibly present; they close little of the gap or stay below the tolerance.", head, rows,
        )  # fmt: skip
    return _table(
        finding, "effects", "What is missing, with sizes",
        "Fitted together with the sand and the errors of the sensors. Last column: share of the closed "
        "gap that "
        "opens again without the effect, on trials left out of the fit.", head, rows,
    )  # fmt: skip


def discrepancies(finding: Finding) -> dict[str, tuple[float, float]]:
    """Return channel to the rms of its discrepancy in motion over the channel's rms, without and with "
    "effects."""

    def share(channel: str, name: str) -> float:
        own = [r for r in finding.residuals if r.channel == channel and r.size > 0]
        parts = [getattr(r, name)[r.std > 0] / r.size for r in own]  # the bins of the motion
        values = np.concatenate(parts) if parts else np.zeros(0)
        return float(np.sqrt(np.mean(values**2))) if values.size else math.nan

    return {c: (share(c, "discrepancy_before"), share(c, "discrepancy_after")) for c in channels_of(finding)}


def gaps_table(finding: Finding) -> Table | None:
    """List per channel the gap, in the fit and on trials left out, and the discrepancy."""
    shares = discrepancies(finding)
    out = any(math.isfinite(v) for g in (finding.gap, *finding.gaps) for v in g.held_out)
    rows = []
    for g in (finding.gap, *finding.gaps):
        values = [number(v, 3) for v in (*g.train, *(g.held_out if out else ()))]
        share = [number(s, 2, "%", 100) for s in shares.get(g.channel, (math.nan, math.nan))]
        rows.append(
            [words("all channels" if g.channel == "all" else channel_name(g.channel)), *values, *share]
        )
    left_out = (("left out: without [–]", ("held_out_before",)), ("with [–]", ("held_out_after",)))
    head = columns(
        "sensor", ("in the fit: without [–]", ("train_before",)), ("with [–]", ("train_after",)),
        *(left_out if out else ()), ("discrepancy: without", ("discrepancy_before",)),
        ("with", ("discrepancy_after",)),
    )  # fmt: skip
    return _table(
        finding, "gaps", "Gap between sensors and model, without and with the effects found",
        "Gap: root mean square of the residuals over what noise and tolerance explain; 1 means explained. "
        "Discrepancy: what all repetitions share and the model does not explain, over the rms of the "
        "sensor in "
        "motion.", head, rows,
    )  # fmt: skip


def candidates_table(finding: Finding, known: Mapping[str, Effect]) -> Table | None:
    """List every candidate with its probability, the share of the gap it closes, and what became of it."""
    rows = [
        (
            words(plain(c.id)), words(known[c.id].title if c.id in known else NONE), _percent(c.probability),
            _closed(c.closes), number(c.gain, 3), words(f"{STATUS[c.status]}{_bounds(c.bounds)}"),
        )
        for c in shown_candidates(finding)
    ]  # fmt: skip
    head = columns(
        "candidate", "what it is", ("probability", ("probability",)), ("closes alone", ("closes",)),
        ("ln Bayes factor [–]", ("log_bayes_factor",)), "result",
    )  # fmt: skip
    return _table(
        finding, "candidates", "Every candidate",
        "Probability that the effect is in the model; share of the gap that it closes alone, all trials "
        "in the "
        "fit; logarithm of the Bayes factor against the model that it was added to.", head, rows,
    )  # fmt: skip


def _bounds(bounds: Sequence[str]) -> str:
    return f" ({', '.join(b.replace('_', ' ') for b in bounds)})" if bounds else ""


def detectable_table(finding: Finding, known: Mapping[str, Effect]) -> Table | None:
    """List the smallest size of each candidate that these trials show, and what limits it."""
    rows = []
    for d in finding.detectable:
        own = {p.name: p for p in known[d.effect].parameters} if d.effect in known else {}
        p = own.get(d.parameter)
        largest = max(abs(p.prior_low), abs(p.prior_high)) if p else d.size
        unit, scale = scale_of(d.effect, d.parameter, d.unit, largest)
        low, high = (p.prior_low, p.prior_high) if p else (None, None)
        expected = " to ".join(f"{v * scale:.4g}".replace("-", "−") for v in (low, high) if v is not None)
        alike = [plain(i) for i in d.confused_with]
        text = ", ".join(alike[:3]) + (f" and {len(alike) - 3} more" if len(alike) > 3 else "")
        seen = math.isfinite(d.size)
        rows.append(
            (
                words(plain(d.effect)), words(d.parameter.replace("_", " ")),
                number(d.size, 2, scale=scale) if seen else Cell("not visible", (None,)),
                Cell(expected or NONE, (low, high)), Cell(unit or "–", (d.unit or "–",)),
                words(d.limit if seen else NONE), words(text or "none"),
            )
        )  # fmt: skip
    head = columns(
        "candidate", "number", ("smallest size", ("smallest",)),
        ("expected", ("expected_low", "expected_high")), "unit", "limited by", "looks like",
    )  # fmt: skip
    return _table(
        finding, "detectable", "Smallest sizes that these trials show",
        "An effect of this size is named with a probability of 80 %. Expected: range of the literature.",
        head, rows,
    )  # fmt: skip


def confusion_table(finding: Finding) -> Table | None:
    """List what would come first if one candidate at a time were in the trials."""
    check = finding.confusion
    if check is None:
        return None
    rows = []
    for k, id_ in enumerate(check.ids):
        if math.isfinite(check.missed[k]) and check.matrix[k, k] < SURE:
            wrong = ", ".join(f"{plain(other)} ({percent(share)})" for other, share in check.taken_for(id_))
            first, missed = float(check.matrix[k, k]), float(check.missed[k])
            rows.append((words(plain(id_)), _percent(first), _percent(missed), words(wrong or "none")))
    return _table(
        finding, "confusion", "Candidates that these trials could take for another",
        f"Each candidate in turn at {check.factor:g} times its smallest visible size, {check.draws} times "
        "with "
        f"other noise. All others are named first in at least {percent(SURE)} of these sets.",
        columns("candidate", ("named first", ("first",)), ("nothing named", ("missed",)), "taken for"), rows,
    )  # fmt: skip


def fitted_table(finding: Finding) -> Table | None:
    """List the sand common to all trials over its file, and what differs from trial to trial.

    a_θ has an answer of its own.
    """
    rows = []
    for name, log in finding.sand.items():
        if name != "a_theta":
            ratio = Estimate(float(np.expm1(log.value)), float(np.exp(log.value) * log.std))
            rows.append(
                (words(SAND.get(name, name)), words("from the file"), Cell(percent_of(ratio), (ratio.value,)))
            )
    for name, std in finding.scales.items():
        text, unit, scale = SCALES.get(name, (name, "", 1.0))
        shown = Cell(f"{significant(std * scale, 2)} {unit}".strip(), (std,))
        rows.append((words(text), words("from trial to trial, std"), shown))
    return _table(
        finding, "fitted", f"Sand and sensors as fitted, compared with {finding.soil.title}",
        "Fitted together with everything else.",
        columns("number", "difference", ("size", ("size",))), rows,
    )  # fmt: skip


def _closed(share: float) -> Cell:
    """Return the share of a gap that a candidate closes; a fit to the noise is no more than all of it."""
    return Cell(percent(min(share, 1.0)), (share,))


def _percent(share: float) -> Cell:
    return Cell(percent(share), (share,))
