"""Tables of a discovery: effects, intervals, candidates, gaps, smallest sizes, terms of a law."""

from __future__ import annotations

import math
from collections.abc import Mapping

from granite_lab.discovery.finding import Candidate, Finding
from granite_lab.model.effect import Effect
from granite_lab.reporting.discovery.amounts import amount, meaning, scale_of
from granite_lab.reporting.discovery.names import LAW, STATUS, channel_name, plain
from granite_lab.reporting.discovery.plot_law import BY, law_of, split
from granite_lab.reporting.discovery.sizes import LIKELY, multiple, unseen
from granite_lab.reporting.rounding import NONE, evidence, interval, plus_minus, significant, tidy_unit
from granite_lab.reporting.study_tables import data_cell
from granite_lab.reporting.summary import IN_PHASE
from granite_lab.reporting.table import Cell, Table, columns, fixed, number, words

MOST = 25
"""Intervals that are listed."""


def effects_table(finding: Finding) -> Table | None:
    """List what was named, each number with its interval and its multiple of the smallest size seen."""
    rows = []
    known = {a.effect.id: a.effect for a in finding.active}
    for e in finding.effects:
        if e.empirical:
            continue
        for p in e.parameters:
            half, value = LIKELY * p.estimate.std, p.estimate.value
            unit, scale = scale_of(e.id, p.name, p.unit, value)
            times = multiple(finding, e, p)
            rows.append(
                (
                    words(plain(e.id)),
                    words(p.name.replace("_", " ")),
                    words(meaning(e.id, p.name, known) or NONE),
                    Cell(amount(e, p), (value, p.estimate.std, p.unit)),
                    Cell(interval(value - half, value + half, unit, scale), (value - half, value + half)),
                    Cell(significant(times, 2), (times,)) if math.isfinite(times) else Cell(NONE, (None,)),
                    words(", ".join(map(plain, e.twins)) or "none"),
                    data_cell(finding.virtual),
                )
            )
    if not rows:
        return None
    return Table(
        "found_effects", "What is missing, with sizes",
        "Value ± standard deviation, fitted together with the sand and the sensors' errors; the multiple "
        "is the size over the smallest that these trials show.",
        columns(
            "effect", "number", "what it is", ("value", ("value", "std", "unit")), ("95 %", ("low", "high")),
            ("multiple [–]", ("multiple",)), "cannot be told from", "data",
        ),
        tuple(rows),
    )  # fmt: skip


def intervals_table(finding: Finding) -> Table | None:
    """List the strongest intervals of disagreement."""
    if not finding.where:
        return None
    strongest = sorted(finding.where, key=lambda d: -d.strength)[:MOST]
    more = len(finding.where) - len(strongest)
    rest = f" {more} weaker ones stand in the JSON file." if more else ""
    rows = tuple(
        (
            words(channel_name(d.channel)), words(d.phase), Cell(f"{d.variant:g}", (d.variant,)),
            fixed(d.start, 2), fixed(d.end, 2),
            number(d.frequency, 2) if d.frequency > 0 else Cell("constant", (d.frequency,)),
            number(d.strength, 2),
            data_cell(finding.virtual),
        )
        for d in strongest
    )  # fmt: skip
    return Table(
        "found_intervals", "The strongest intervals of disagreement",
        f"Times count from the start of the command; the frequency is where it is strongest.{rest}",
        columns(
            "channel", "phase", ("speed [m/s]", ("speed_mps",)), ("from [s]", ("start_s",)),
            ("to [s]", ("end_s",)), ("frequency [Hz]", ("frequency_hz",)),
            ("strength over noise [–]", ("strength",)), "data",
        ),
        rows,
    )  # fmt: skip


def candidates_table(finding: Finding, known: Mapping[str, Effect]) -> Table | None:
    """List every candidate with its evidence in each round."""
    if not finding.rounds or not finding.rounds[0]:
        return None
    by_round = [{c.id: c for c in found} for found in finding.rounds]
    rows = []
    for c in finding.rounds[0]:
        cells = [_evidence(found[c.id]) if c.id in found else Cell(NONE, (None,)) for found in by_round]
        title = known[c.id].title if c.id in known else ""
        rows.append(
            (
                words(plain(c.id)), words(title or NONE), *cells, words(STATUS.get(c.status, c.status)),
                data_cell(finding.virtual),
            )
        )  # fmt: skip
    n = len(finding.rounds)
    titles = [(f"round {k + 1} [–]" if n > 1 else "evidence [–]", (f"evidence_{k + 1}",)) for k in range(n)]
    return Table(
        "found_candidates", "Every candidate, its meaning and its evidence",
        f"Chance alone reaches {significant(finding.threshold, 2)} in one set of trials in a hundred. A "
        "dash: already in the model, or a fit that did not converge.",
        columns("candidate", "what it is", *titles, "how far it was tried", "data"),
        tuple(rows),
    )  # fmt: skip


def _evidence(candidate: Candidate) -> Cell:
    """Return the evidence; a fit that did not converge has none."""
    if candidate.status == "not converged":
        return Cell(NONE, (candidate.evidence,))
    return Cell(evidence(candidate.evidence), (candidate.evidence,))


def gaps_table(finding: Finding) -> Table:
    """List the gap of every channel and phase, on trials of the fit and on trials left out."""
    rows = []
    for g in (finding.gap, *finding.gaps):
        if not any(math.isfinite(v) for v in (*g.train, *g.held_out)):
            continue
        name = "all channels" if g.channel == "all" else channel_name(g.channel)
        phase = "all phases" if g.phase == "all" else IN_PHASE.get(g.phase, g.phase)
        cells = [number(v, 3) for v in (*g.train[:2], *g.held_out[:2], g.train[2])]
        rows.append((words(name), words(phase), *cells, data_cell(finding.virtual)))
    return Table(
        "found_gaps", "The gap of every channel and phase",
        "Root mean square of what is left over the noise, before and after what was found is added; the "
        "floor is what repetitions of one command do not have in common.",
        columns(
            "channel", "phase", ("in the fit: before [–]", ("train_before",)),
            ("after [–]", ("train_after",)), ("left out: before [–]", ("held_out_before",)),
            ("after [–]", ("held_out_after",)), ("floor [–]", ("floor",)), "data",
        ),
        tuple(rows),
    )  # fmt: skip


def detectable_table(finding: Finding, known: Mapping[str, Effect]) -> Table | None:
    """List the smallest size of each candidate that these trials show, and what it is alike."""
    rows = []
    for d in finding.detectable:
        own = {p.name: p for p in known[d.effect].parameters} if d.effect in known else {}
        p = own.get(d.parameter)
        largest = max(abs(p.prior_low), abs(p.prior_high)) if p else d.size
        unit, scale = scale_of(d.effect, d.parameter, d.unit, largest)
        expected = f"{_short(p.prior_low * scale)} to {_short(p.prior_high * scale)}" if p else NONE
        alike = [plain(i) for i in d.confused_with]
        text = ", ".join(alike[:3]) + (f" and {len(alike) - 3} more" if len(alike) > 3 else "")
        seen = math.isfinite(d.size)
        rows.append(
            (
                words(plain(d.effect)), words(d.parameter.replace("_", " ")),
                number(d.size, 2, scale=scale) if seen else Cell(unseen(finding, d.effect), (None,)),
                Cell(expected, (p.prior_low, p.prior_high) if p else (None, None)),
                Cell(unit or "–", (d.unit or "–",)), words(text or "none"), data_cell(finding.virtual),
            )
        )  # fmt: skip
    if not rows:
        return None
    return Table(
        "found_detectable", "Smallest sizes that these trials show",
        "A size that is found four times out of five, beside what the literature leads to expect.",
        columns(
            "candidate", "number", ("smallest size", ("smallest",)),
            ("expected", ("expected_low", "expected_high")), "unit", "looks like", "data",
        ),
        tuple(rows),
    )  # fmt: skip


def _short(value: float) -> str:
    return f"{value:.4g}".replace("-", "−")


def self_check_table(finding: Finding) -> Table | None:
    """List what would be named if one candidate at a time were in the trials."""
    check = finding.self_check
    if check is None:
        return None
    rows = []
    for k, id_ in enumerate(check.ids):
        if not math.isfinite(check.missed[k]):
            continue
        wrong = ", ".join(f"{plain(other)} ({100 * share:.0f} %)" for other, share in check.taken_for(id_))
        rows.append(
            (
                words(plain(id_)), fixed(100 * check.kept[k], 0), fixed(100 * check.alone[k], 0),
                fixed(100 * check.missed[k], 0), words(wrong or "none"), data_cell(finding.virtual),
            )
        )  # fmt: skip
    if not rows:
        return None
    return Table(
        "found_self_check", "What these trials would say of each candidate",
        f"Each candidate in turn at {check.factor:g} times the smallest size that is seen, {check.draws} "
        "times with other noise: how often it is named, alone or with what cannot be told from it, how "
        "often alone, and how often nothing is named.",
        columns(
            "candidate", ("named [%]", ("named",)), ("named alone [%]", ("named_alone",)),
            ("nothing named [%]", ("missed",)), "something else comes first", "data",
        ),
        tuple(rows),
    )  # fmt: skip


def law_table(finding: Finding) -> Table | None:
    """List the terms of the empirical law."""
    law = law_of(finding)
    if law is None:
        return None
    rows = []
    for p in law.parameters:
        if p.estimate.value == 0:
            continue
        target, term = split(p.name)
        rows.append(
            (
                words(LAW[target]), words(BY.get(term, plain(term))),
                Cell(plus_minus(p.estimate), (p.estimate.value, p.estimate.std)), words(tidy_unit(p.unit)),
                data_cell(finding.virtual),
            )
        )  # fmt: skip
    return Table(
        "found_law", "The terms of the empirical law",
        "Each amount at a typical state: 0.5 m/s, slip 0.2, 1 m of way, 5 s, 20 mm/s of sinking.",
        columns("what is missing", "how it goes", ("amount", ("amount", "std")), "unit", "data"),
        tuple(rows),
    )  # fmt: skip
