"""Tables of a discovery: effects, gaps, intervals, candidates, smallest sizes, scales, trials left out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from granite_lab.discovery.finding import Disagreement, Finding, FoundEffect, FoundParameter
from granite_lab.estimate import Estimate
from granite_lab.model.effect import Effect
from granite_lab.reporting.discovery.amounts import amount, meaning, scale_of
from granite_lab.reporting.discovery.answers import percent, percent_of
from granite_lab.reporting.discovery.names import SAND, SCALES, STATUS, channel_name, plain, shown_candidates
from granite_lab.reporting.discovery.residue import discrepancies
from granite_lab.reporting.discovery.sizes import LIKELY, multiple
from granite_lab.reporting.rounding import NONE, interval, significant
from granite_lab.reporting.study_tables import data_cell
from granite_lab.reporting.table import Cell, Column, Table, columns, fixed, number, words

MOST = 25
"""Intervals that are listed."""

BEFORE_AFTER = (("before [–]", ("before",)), ("after [–]", ("after",)))


def _table(
    finding: Finding,
    id_: str,
    title: str,
    sentence: str,
    head: Sequence[Column],
    rows: Sequence[Sequence[Cell]],
) -> Table | None:
    """Return a table whose last column says whether the data are virtual; None without rows."""
    data = data_cell(finding.virtual)
    full = tuple((*row, data) for row in rows)
    return Table(f"found_{id_}", title, sentence, (*head, *columns("data")), full) if full else None


def effects_table(
    finding: Finding, known: Mapping[str, Effect], effects: Sequence[FoundEffect], *, small: bool = False
) -> Table | None:
    """List effects, each number with its interval and its multiple of the smallest size seen.

    Args:
        finding: the record.
        known: candidates by id, for what their numbers mean.
        effects: of the finding, those that were named or the small ones.
        small: they are the small ones.
    """
    rows = []
    for e in effects:
        for p in e.parameters or (FoundParameter(NONE, "", Estimate(math.nan)),):
            half, value = LIKELY * p.estimate.std, p.estimate.value
            unit, scale = scale_of(e.id, p.name, p.unit, value)
            times = multiple(finding, e, p)
            rows.append(
                (
                    words(plain(e.id)),
                    words("amount" if e.empirical else p.name.replace("_", " ")),
                    words(
                        "term of an empirical law" if e.empirical else meaning(e.id, p.name, known) or NONE
                    ),
                    Cell(amount(e, p), (value, p.estimate.std, p.unit)),
                    Cell(interval(value - half, value + half, unit, scale), (value - half, value + half)),
                    number(times, 2),
                    words(", ".join(map(plain, e.twins)) or "none"),
                    _percent(e.probability),
                    Cell(percent_of(e.closes), (e.closes.value, e.closes.std)),
                )
            )
    head = columns(
        "effect", "number", "what it is", ("value", ("value", "std", "unit")), ("95 %", ("low", "high")),
        ("multiple [–]", ("multiple",)), "cannot be told from", ("probability", ("probability",)),
        ("closes of the gap", ("closes", "closes_std")),
    )  # fmt: skip
    if small:
        sentence = "These trials may show them, but they close little of the gap or stay below the tolerance."
        return _table(finding, "small", "Small effects", sentence, head, rows)
    sentence = (
        "Value ± standard deviation, fitted together with the sand and the sensors' errors. The multiple is "
        "the size over the smallest that these trials show; the share of the gap is that on trials left out, "
        "± its standard error."
    )
    return _table(finding, "effects", "What is missing, with sizes", sentence, head, rows)


def gaps_table(finding: Finding) -> Table | None:
    """List per channel the gap, in the fit and on trials left out, and the discrepancy."""
    shares = discrepancies(finding)
    out = any(math.isfinite(v) for g in (finding.gap, *finding.gaps) for v in g.held_out)
    rows = []
    for g in (finding.gap, *finding.gaps):
        whole = g.channel == "all"
        share = shares.get(g.channel, (math.nan, math.nan))
        values = [number(v, 3) for v in (*g.train, *(g.held_out if out else ()))]
        row = [words("all channels" if whole else channel_name(g.channel)), *values]
        rows.append([*row, *(number(s, 2, "%", 100) for s in share)])
    left_out = (("left out: before [–]", ("held_out_before",)), ("after [–]", ("held_out_after",)))
    head = columns(
        "channel", ("in the fit: before [–]", ("train_before",)), ("after [–]", ("train_after",)),
        *(left_out if out else ()),
        ("discrepancy: before", ("discrepancy_before",)), ("after", ("discrepancy_after",)),
    )  # fmt: skip
    sentence = (
        "Gap: root mean square of the residuals over what noise and tolerance explain; 1 is as good as asked "
        "for. Discrepancy: what the repetitions share and the model does not explain, over the rms of the "
        "channel in motion."
    )
    return _table(finding, "gaps", "The gap of every channel", sentence, head, rows)


def intervals_table(finding: Finding, found: Sequence[Disagreement], *, after: bool = False) -> Table | None:
    """List the intervals in which the model without or with the effects disagrees most."""
    strongest = sorted(found, key=lambda d: -d.share)[:MOST]
    more = len(found) - len(strongest)
    rest = f" {more} smaller ones stand in the JSON file." if more else ""
    rows = [
        (
            words(channel_name(d.channel)), words(d.phase), Cell(f"{d.variant:g}", (d.variant,)),
            fixed(d.start, 2), fixed(d.end, 2),
            number(d.frequency, 2) if d.frequency > 0 else Cell("constant", (d.frequency,)),
            number(d.share, 2, "%", 100), number(d.score, 2),
        )
        for d in strongest
    ]  # fmt: skip
    head = columns(
        "channel", "phase", ("speed [m/s]", ("speed_mps",)), ("from [s]", ("start_s",)),
        ("to [s]", ("end_s",)), ("frequency [Hz]", ("frequency_hz",)),
        ("share of the channel's rms", ("share",)), ("over its std [–]", ("score",)),
    )  # fmt: skip
    sentence = f"Times count from the start of the command; the frequency is where it is strongest.{rest}"
    title = "Where the model with the effects still disagrees" if after else "Where the model disagrees most"
    return _table(finding, "left" if after else "intervals", title, sentence, head, rows)


def candidates_table(finding: Finding, known: Mapping[str, Effect]) -> Table | None:
    """List every candidate with its probability, the share of the gap it closes, and its fate."""
    rows = [
        (
            words(plain(c.id)), words(known[c.id].title if c.id in known else NONE),
            _percent(c.probability), number(c.closes, 2, "%", 100), number(c.gain, 3),
            words(f"{STATUS[c.status]}{_bounds(c.bounds)}"),
        )
        for c in shown_candidates(finding)
    ]  # fmt: skip
    head = columns(
        "candidate", "what it is", ("probability", ("probability",)), ("closes alone", ("closes",)),
        ("ln Bayes factor [–]", ("log_bayes_factor",)), "status",
    )  # fmt: skip
    sentence = (
        "Probability that the candidate is in the model, share of the gap that it closes alone with all "
        "trials in the fit, and logarithm of the Bayes factor against the model it was added to."
    )
    return _table(finding, "candidates", "Every candidate, and what it means", sentence, head, rows)


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
                number(d.size, 2, scale=scale) if seen else Cell("cannot be seen", (None,)),
                Cell(expected or NONE, (low, high)), Cell(unit or "–", (d.unit or "–",)),
                words(d.limit if seen else NONE), words(text or "none"),
            )
        )  # fmt: skip
    head = columns(
        "candidate", "number", ("smallest size", ("smallest",)),
        ("expected", ("expected_low", "expected_high")), "unit", "limited by", "looks like",
    )  # fmt: skip
    sentence = "A size that is named four times out of five, beside what the literature leads to expect."
    return _table(finding, "detectable", "Smallest sizes that these trials show", sentence, head, rows)


def confusion_table(finding: Finding) -> Table | None:
    """List what would come first if one candidate at a time were in the trials."""
    check = finding.confusion
    if check is None:
        return None
    rows = []
    for k, id_ in enumerate(check.ids):
        if not math.isfinite(check.missed[k]):
            continue
        wrong = ", ".join(f"{plain(other)} ({percent(share)})" for other, share in check.taken_for(id_))
        first = float(check.matrix[k, k])
        rows.append(
            (words(plain(id_)), _percent(first), _percent(float(check.missed[k])), words(wrong or "none"))
        )
    head = columns(
        "candidate", ("comes first", ("first",)), ("nothing named", ("missed",)), "something else comes first"
    )
    sentence = (
        f"Each candidate in turn at {check.factor:g} times the smallest size that is seen, {check.draws} "
        "times with other noise."
    )
    return _table(finding, "confusion", "What these trials would say of each candidate", sentence, head, rows)


def scales_table(finding: Finding) -> Table | None:
    """List what differs from trial to trial, with its std as learnt."""
    rows = []
    for name, std in finding.scales.items():
        text, unit, scale = SCALES.get(name, (name, "", 1.0))
        rows.append((words(text), Cell(f"± {significant(std * scale, 2)} {unit}".strip(), (std,))))
    head = columns("number", ("std from trial to trial", ("std",)))
    sentence = (
        "Standard deviations that the trials themselves show; the robot's file only says where to begin."
    )
    return _table(finding, "scales", "What differs from trial to trial", sentence, head, rows)


def sand_table(finding: Finding) -> Table | None:
    """List the sand common to all trials over its file."""
    rows = []
    for name, log in finding.sand.items():
        ratio = Estimate(float(np.expm1(log.value)), float(np.exp(log.value) * log.std))
        rows.append((words(SAND.get(name, name)), Cell(percent_of(ratio), (ratio.value, ratio.std))))
    head = columns("parameter", ("off the file's value", ("off", "std")))
    sentence = "Fitted along with everything else, common to all trials."
    return _table(finding, "sand", f"The sand, beside {finding.soil.title}", sentence, head, rows)


def left_out_table(finding: Finding) -> Table | None:
    """List how well each trial and each speed is predicted by a fit that did not see it."""
    rows = [(words(x.name), number(x.before, 3), number(x.after, 3)) for x in finding.trials_left_out]
    rows += [
        (words(f"all at {x.name} m/s"), number(x.before, 3), number(x.after, 3))
        for x in finding.speeds_left_out
    ]
    sentence = "Misfit over what noise and tolerance explain, without and with what was found."
    head = columns("left out", *BEFORE_AFTER)
    return _table(finding, "left_out", "Trials and speeds left out", sentence, head, rows)


def dropped_table(finding: Finding) -> Table | None:
    """List the trials that nothing fits."""
    rows = [(words(name), words(why)) for name, why in finding.dropped]
    return _table(
        finding, "dropped", "Trials that nothing fits", "They are in no fit and no figure.",
        columns("trial", "why"), rows,
    )  # fmt: skip


def _percent(share: float) -> Cell:
    return Cell(percent(share), (share,))
