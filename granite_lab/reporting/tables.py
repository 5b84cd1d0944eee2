"""The tables of a study, by speed, quantity and trial, and of a search: effects, sensors, candidates."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.finding import Candidate, Detectable, Finding, FoundEffect, FoundParameter
from granite_lab.effects.library import met
from granite_lab.estimate import Estimate, Part, mean_over
from granite_lab.fitting import fit as records
from granite_lab.fitting.fit import AThetaFit, FitStatus, K92Fit, Law
from granite_lab.inference.constants import FORMULA_ERROR
from granite_lab.reporting.answers import Answers, ChannelAnswer, Speed, gap_pair
from granite_lab.reporting.names import (
    amount,
    channels_of,
    declared,
    meaning,
    plain,
    scale_of,
    shown_candidates,
)
from granite_lab.reporting.rounding import (
    NONE,
    interval,
    percent,
    percent_of,
    places,
    plus_minus,
    shown_as,
    significant,
    tidy_unit,
)
from granite_lab.reporting.table import Cell, Cells, Table, number, probable, share, tabulate, words
from granite_lab.reporting.words import PHASES, WORDS, quantity, sensor
from granite_lab.results import Gap, StudyResult, TrialResult

AGREES = {True: ("yes", "good"), False: ("no", "fair"), None: (NONE, "")}

FIT, LAWS = WORDS["fit"], WORDS["laws"]
"""Status of a fit, and laws for k_92, as a reader calls them."""


def slip_table(answers: Answers) -> Table:
    """Return slip and k_92 by speed beside the paper: the table of the first screen."""
    cells: Cells = {
        "slip": lambda s: Cell(s.slip.text, (s.slip.value / 100,)),
        "interval": lambda s: Cell(s.slip.interval, (s.slip.low / 100, s.slip.high / 100)),
        "paper": lambda s: number(s.paper_slip / 100, 3, scale=100),
        "agrees": lambda s: Cell(AGREES[s.agrees][0], (s.agrees,), AGREES[s.agrees][1]),
        "k92": lambda s: Cell(s.k92_note or s.k92.with_std, (s.k92.value, s.k92.std)),
    }
    return tabulate("slip_by_speed", answers.speeds, cells, virtual=bool(answers.virtual))


def channel_table(channels: Sequence[ChannelAnswer], virtual: bool) -> Table:
    """Return how well the model explains each quantity over whole trials."""

    def size(value: float, unit: str) -> Cell:
        return Cell(f"{significant(value, 2)} {unit}" if math.isfinite(value) else NONE, (value, unit))

    cells: Cells = {
        "verdict": lambda c: words(c.verdict, c.tone),
        "rms": lambda c: size(c.rms, c.unit),
        "noise": lambda c: size(c.noise, c.unit),
        "largest": lambda c: size(c.largest, c.unit),
    }
    return tabulate("channels", channels, cells, virtual=virtual)


def misfit_table(found: dict[tuple[str, str], Gap], virtual: bool) -> Table:
    """Return the difference in each quantity and phase."""

    def size(value: float, gap: Gap) -> Cell:
        return number(value, 2, scale=shown_as(gap.unit)[1])

    cells: Cells = {
        "quantity": quantity,
        "phase": lambda phase: PHASES.get(phase, "whole trial"),
        "shown": lambda unit: tidy_unit(shown_as(unit)[0]),
        "rms": lambda g: size(g.rms, g),
        "bias": lambda g: size(g.bias, g),
        "peak": lambda g: size(g.peak, g),
    }
    return tabulate("misfits", found.values(), cells, virtual=virtual)


def law_table(fit: AThetaFit, virtual: bool) -> Table:
    """Return the rival laws for k_92, best first, and which the data prefer; values stand in the CSV file."""
    caption = "Only one law could be fitted." if fit.laws else "No law could be compared."
    if len(fit.laws) > 1:
        lead = fit.laws[1].aicc - fit.laws[0].aicc
        first, second = (LAWS.get(law.id, law.formula) for law in fit.laws[:2])
        clear = "clearly better than" if lead > 10 else "better than" if lead > 2 else "hardly better than"
        caption = (
            f"By the corrected Akaike criterion AICc, {first} is {clear} {second} (ΔAICc "
            f"{places(lead, 1)}; above 10 is decisive)."
        )
        if not math.isfinite(lead):
            caption = "Too few values of k_92 for an information criterion of every law."
    best = fit.laws[0].aicc if fit.laws else math.nan

    def numbers(law: Law) -> Cell:
        values = "; ".join(f"{k} = {v.value:.6g}" for k, v in law.parameters.items())
        return Cell(str(law.n_parameters), (law.n_parameters, values))

    def delta(law: Law) -> Cell:
        over = law.aicc - best
        return Cell(places(over, 1) if math.isfinite(over) else NONE, (over,))

    cells: Cells = {
        "law": lambda law: Cell(LAWS.get(law.id, law.formula), (law.id,)), "numbers": numbers, "delta": delta,
    }  # fmt: skip
    return tabulate("laws", fit.laws, cells, virtual=virtual, verdict=caption)


def trial_table(result: StudyResult) -> Table:
    """Return one row per trial."""
    mixed = result.virtual and not all(r.trial.info.virtual for r in result.trials)

    def speed(r: TrialResult) -> Cell:
        motion = r.comparison.motion
        v, source = motion.variant.velocity, motion.variant_source
        return Cell(f"{v:.3g}" + ("" if source == "given" else f" ({source})"), (v, source))

    cells: Cells = {
        "data": lambda r: "virtual" if r.trial.info.virtual else "measured",
        "speed": speed,
        "steady": steady,
        "trajectory": trajectory,
        "warnings": lambda r: len(set(r.trial.warnings) | set(r.comparison.motion.warnings)),
    }
    skip = () if mixed else ("data",)
    return tabulate("trials", result.trials, cells, virtual=result.virtual and not mixed, skip=skip)


def _fitted(value: Estimate, status: FitStatus) -> Cell:
    """Return a fit of k_92; where it is no inner optimum it stands with the reason."""
    text, raw = plus_minus(value), (value.value, value.std, FIT[status])
    return Cell(text, raw) if status == "ok" else Cell(f"{text} ({FIT[status]})", raw, "fair")


def steady(fit: K92Fit) -> Cell:
    """Return k_92 by the steady slip."""
    return _fitted(fit.k92, fit.status)


def trajectory(fit: K92Fit) -> Cell:
    """Return k_92 by the whole trajectory."""
    return _fitted(fit.k92_trajectory, fit.status_trajectory)


def k92_table(fits: Sequence[K92Fit]) -> Table:
    """Return k_92 of each trial, by the steady slip and by the whole trajectory."""
    cells: Cells = {"steady": steady, "trajectory": trajectory}
    return tabulate("k92", fits, cells, virtual=any(f.virtual for f in fits))


COMBINED = "combined standard uncertainty"

BUDGETS = {
    "slip": ("slip ratio λ_R", "points", 100.0),
    "k92": ("contact-angle ratio k_92", "–", 1.0),
    "a_theta": ("a_θ", "s/m", 1.0),
}
"""Quantity with a budget: in words, unit of the contributions, and the factor to it."""


def budget_tables(result: StudyResult, speeds: Sequence[Speed]) -> list[Table]:
    """Return what the std of λ_R, k_92 and a_θ is made of (JCGM 100:2008, 5.1 and 8), a table each.

    What has no stated std, or no components, has no budget.
    """
    budgets: dict[str, list[records.Budget | None]] = {what: [] for what in BUDGETS}
    for speed in speeds:
        motions = [r.comparison.motion for r in speed.results]
        known = [m for m in motions if math.isfinite(m.slip_ratio.value)]
        inner = [r.comparison.fit for r in speed.results if r.comparison.fit.status == "ok"]
        slip, k92 = mean_over(m.slip_ratio for m in known), mean_over(f.k92 for f in inner)
        parts = {"slip": [m.slip_parts for m in known], "k92": [f.parts for f in inner]}
        for what, mean in (("slip", slip), ("k92", k92)):
            stated = Estimate(mean.value, mean.std)
            budgets[what].append(records.of_mean(speed.velocity, stated, parts[what]))
    if result.a_theta is not None:
        budgets["a_theta"].append(
            records.of_a_theta(result.a_theta, [r.comparison.fit for r in result.trials])
        )
    there = {what: [b for b in own if b is not None] for what, own in budgets.items()}
    return [_budget_table(what, own, result.virtual) for what, own in there.items() if own]


def _budget_table(what: str, of: Sequence[records.Budget], virtual: bool) -> Table:
    """Return the budgets of one quantity as one table, the combined uncertainty of each last."""
    title, unit, scale = BUDGETS[what]
    rows = []
    for b in of:
        rows += [(b.speed, part, b.share(part)) for part in b.parts]
        rows.append((b.speed, Part(COMBINED, "A", "", "", b.result.std, b.combined), 1.0))

    def std(part: Part) -> Cell:
        text = f"{significant(part.std, 2)} {tidy_unit(part.unit if part.unit != '1' else '')}".strip()
        return Cell(text if part.unit else NONE, (part.std if part.unit else None, part.unit))

    cells: Cells = {
        "type": lambda r: "" if r[1].name == COMBINED else r[1].kind,
        "std": lambda r: std(r[1]),
        "sensitivity": lambda r: number(r[1].sensitivity if r[1].unit else math.nan, 2, scale=scale),
        "contribution": lambda r: number(r[1].contribution, 2, scale=scale),
    }
    each = what != "a_theta"
    return tabulate(
        f"budget_of_{what}", rows, cells, virtual=virtual, skip=() if each else ("0:g",), unit=unit,
        quantity=title, left_out=records.LEFT_OUT[what],
        mean="Mean over the trials of a speed. " if each else "",
    )  # fmt: skip


SURE = 0.95
"""Share of sets from which on a candidate is told from all others."""


def effects_table(finding: Finding, effects: Sequence[FoundEffect], *, small: bool = False) -> Table:
    """List named effects, or `small` ones, and their numbers; what holds for an effect stands once."""
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
        "probability": lambda r: once(r, probable(r[0].probability)),
        "closes": lambda r: once(r, Cell(percent_of(r[0].closes), (r[0].closes.value, r[0].closes.std))),
    }
    no_number = FoundParameter(NONE, "", Estimate(math.nan))
    rows = [(e, p, k == 0) for e in effects for k, p in enumerate(e.parameters or (no_number,))]
    return tabulate(
        "found_small" if small else "found_effects", rows, cells, virtual=finding.virtual,
        skip=() if any(e.twins for e in effects) else ("twins",), formula=percent(FORMULA_ERROR[0]),
        where=gap_pair(finding)[2],
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
        "sensor": lambda channel: "all channels" if channel == "all" else sensor(channel),
        "without": lambda g: number(shares.get(g.channel, unknown)[0], 2, "%", 100),
        "with": lambda g: number(shares.get(g.channel, unknown)[1], 2, "%", 100),
    }
    skip = () if out else ("held_out.0:3", "held_out.1:3")
    return tabulate("found_gaps", every, cells, virtual=finding.virtual, skip=skip)


def left_out_table(finding: Finding) -> Table:
    """List how well each trial and each speed is predicted by a fit that did not see it."""
    rows = [(x.name, x) for x in finding.trials_left_out]
    rows += [(f"all at {x.name} m/s", x) for x in finding.speeds_left_out]
    return tabulate("found_left_out", rows, virtual=finding.virtual)


def candidates_table(finding: Finding) -> Table:
    """List every candidate with its probability, the share of the gap it closes, and what became of it."""

    def result(c: Candidate) -> str:
        bounds = ", ".join(b.replace("_", " ") for b in c.bounds)
        return str(WORDS["candidate"][c.status]) + (f" ({bounds})" if bounds else "")

    cells: Cells = {
        "plain": plain,
        "probability": lambda c: words(NONE) if c.status == "screened" else probable(c.probability),
        "meaning": lambda c: getattr(met(c.id), "title", "term of an empirical law"),
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
        "plain": plain,
        "size": size,
        "expected": expected,
        "unit": lambda d: Cell(scale(d)[0] or "–", (d.unit or "–",)),
        "limit": lambda d: d.limit if math.isfinite(d.size) else NONE,
        "alike": alike,
    }
    return tabulate("found_detectable", finding.detectable, cells, virtual=finding.virtual)


def confusion_table(finding: Finding) -> Table | None:
    """List the candidates that would often be taken for another; None where nothing was checked."""
    check = finding.confusion
    if check is None:
        return None
    first = {i: float(check.matrix[k, k]) for k, i in enumerate(check.ids) if math.isfinite(check.missed[k])}
    unsure = [i for i, often in first.items() if often < SURE]
    others = {i: ", ".join(f"{plain(o)} ({percent(x)})" for o, x in check.taken_for(i)) for i in unsure}
    cells: Cells = {
        "plain": plain,
        "first": lambda i: share(first[i]),
        "missed": lambda i: share(float(check.missed[check.ids.index(i)])),
        "others": lambda i: others[i] or "none",
    }
    return tabulate(
        "found_confusion", unsure, cells, virtual=finding.virtual, factor=check.factor, draws=check.draws,
        sure=percent(SURE),
    )  # fmt: skip


def fitted_table(finding: Finding) -> Table:
    """List the sand common to all trials, and what differs from trial to trial.

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
    return tabulate("found_fitted", rows, virtual=finding.virtual, soil=finding.soil.title)
