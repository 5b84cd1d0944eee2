"""The tables of a report: what a study and a search found, by speed, quantity, trial, effect and sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from granite_lab.discovery.finding import Detectable, Finding, FoundEffect, FoundParameter
from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import AThetaFit, FitStatus, K92Fit
from granite_lab.inference.constants import FORMULA_ERROR
from granite_lab.model.effect import Effect
from granite_lab.reporting.answers import Answers, ChannelAnswer
from granite_lab.reporting.content import Source, StudyResult
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
from granite_lab.reporting.rounding import NONE, interval, plus_minus, shown_as, significant, tidy_unit
from granite_lab.reporting.summary import Gap
from granite_lab.reporting.table import Cell, Table, count, estimate, fixed, number, tabulate, words

FIT = {
    "ok": "fitted",
    "at_lower_bound": "at lower limit",
    "at_upper_bound": "at upper limit",
    "not_converged": "not converged",
    "not_evaluated": "not evaluated",
}
"""Status of a fit."""

AGREES = {True: ("yes", "good"), False: ("no", "fair"), None: (NONE, "")}

LAWS = {
    "exponential": "k_92 = exp(−a_θ v)",
    "linear_slip": "k_92 = b_0 + b_1 λ_R",
    "free": "k_92 constant at each speed",
}

LIKELY = 1.96
"""Standard deviations on either side of a value that make its 95 % interval."""

SURE = 0.95
"""Share of sets from which on a candidate is told from all others."""


def slip_table(answers: Answers) -> Table:
    """Return slip and k_92 by speed beside the paper: the table of the first screen."""
    return tabulate(
        "slip_by_speed", "Slip ratio λ_R and contact-angle ratio k_92 by speed",
        "Means over the trials; the interval covers their scatter and their standard deviations. k_92 ± "
        "standard error is fitted to the slip.",
        answers.speeds,
        [
            ("speed [m/s]", "speed_mps", lambda s: Cell(f"{s.velocity:g}", (s.velocity,))),
            ("slip [%]", "slip_ratio", lambda s: Cell(s.slip.text, (s.slip.value / 100,))),
            ("95 % interval [%]", "slip_ratio_low95 slip_ratio_high95",
             lambda s: Cell(s.slip.interval, (s.slip.low / 100, s.slip.high / 100))),
            ("paper [%]", "slip_ratio_paper_experiment", lambda s: number(s.paper_slip / 100, 3, scale=100)),
            ("paper inside", "", lambda s: Cell(AGREES[s.agrees][0], (s.agrees,), AGREES[s.agrees][1])),
            ("k_92 [–]", "k92 k92_std", lambda s: Cell(s.k92_note or s.k92.with_std, (s.k92.value,
            s.k92.std))),
            # the paper's digits
            ("paper's k_92 [–]", "k92_paper",
             lambda s: Cell(f"{s.paper_k92:g}" if math.isfinite(s.paper_k92) else NONE, (s.paper_k92,))),
            ("trials", "trials", lambda s: count(s.trials)),
        ],
        virtual=bool(answers.virtual),
    )  # fmt: skip


def channel_table(channels: Sequence[ChannelAnswer], virtual: bool) -> Table:
    """Return how well the model explains each quantity over whole trials."""

    def size(value: float, unit: str) -> Cell:
        return Cell(f"{significant(value, 2)} {unit}" if math.isfinite(value) else NONE, (value, unit))

    return tabulate(
        "channels", "Simulated minus measured, by quantity",
        "Root mean square of the difference over whole trials, beside the noise of the measurement (its "
        "standard deviation) and the largest simulated value. Points: percentage points of slip.",
        channels,
        [
            ("quantity", "", lambda c: c.name),
            ("verdict", "", lambda c: words(c.verdict, c.tone)),
            ("difference, rms", "rms rms_unit", lambda c: size(c.rms, c.unit)),
            ("noise", "noise noise_unit", lambda c: size(c.noise, c.unit)),
            ("largest value", "largest largest_unit", lambda c: size(c.largest, c.unit)),
            ("largest difference", "", lambda c: c.worst or NONE),
        ],
        virtual=virtual,
    )  # fmt: skip


def misfit_table(found: dict[tuple[str, str], Gap], virtual: bool) -> Table:
    """Return the difference in each quantity and phase."""

    def size(value: float, gap: Gap) -> Cell:
        return number(value, 2, scale=shown_as(gap.unit)[1])

    return tabulate(
        "misfits", "Simulated minus measured, by quantity and phase",
        "Over all trials. The CSV file holds SI units, slip ratios as fractions.",
        found.values(),
        [
            ("quantity", "", lambda g: g.name),
            ("phase", "", lambda g: g.phase),
            ("unit", "", lambda g: tidy_unit(shown_as(g.unit)[0])),
            ("rms", "rms_si", lambda g: size(g.rms, g)),
            ("mean", "bias_si", lambda g: size(g.bias, g)),
            ("largest", "peak_si", lambda g: size(g.peak, g)),
            ("rms over noise [–]", "rms_over_noise", lambda g: number(g.normalised, 2)),
            ("trials", "trials", lambda g: count(g.trials)),
        ],
        virtual=virtual,
    )  # fmt: skip


def law_table(fit: AThetaFit, virtual: bool) -> Table:
    """Return the rival laws for k_92, best first; parameters stand in the CSV file."""
    best = fit.laws[0].aicc if fit.laws else math.nan
    return tabulate(
        "laws", "Laws for k_92 compared", describe_laws(fit), fit.laws,
        [
            ("law", "", lambda law: Cell(LAWS.get(law.id, law.formula), (law.id,))),
            ("fitted numbers", "fitted_numbers values", lambda law: Cell(
                str(law.n_parameters),
                (law.n_parameters, "; ".join(f"{k} = {v.value:.6g}" for k, v in law.parameters.items())),
            )),
            ("rms residual [–]", "rms", lambda law: number(law.rms, 2)),
            ("ΔAICc [–]", "delta_aicc", lambda law: fixed(law.aicc - best, 1)),
        ],
        virtual=virtual,
    )  # fmt: skip


def describe_laws(fit: AThetaFit) -> str:
    """Say which law the data prefer, and how clearly."""
    if len(fit.laws) < 2:
        return "Only one law could be fitted." if fit.laws else "No law could be compared."
    lead = fit.laws[1].aicc - fit.laws[0].aicc
    if not math.isfinite(lead):
        return "Too few values of k_92 for an information criterion of every law."
    first, second = (LAWS.get(law.id, law.formula) for law in fit.laws[:2])
    clear = "clearly better than" if lead > 10 else "better than" if lead > 2 else "hardly better than"
    return (
        f"By the corrected Akaike criterion AICc, {first} is {clear} {second} (ΔAICc "
        f"{significant(lead, 2)}; above 10 is decisive)."
    )


def trial_table(result: StudyResult) -> Table:
    """Return one row per trial."""
    mixed = result.virtual and not all(r.trial.info.virtual for r in result.trials)
    return tabulate(
        "trials", "Trials",
        "Value ± standard deviation of a single trial. Wheel stamps late: how much later the time stamps "
        "of encoders and currents are than those of the IMU; negative where they are earlier.",
        [(r.trial, r.comparison.motion, r.comparison.fit) for r in result.trials],
        [
            ("trial", "", lambda r: r[0].name),
            ("data", "", lambda r: "virtual" if r[0].info.virtual else "measured") if mixed else None,
            ("speed [m/s]", "speed_mps speed_is", lambda r: Cell(
                f"{r[1].variant.velocity:.3g}" + ("" if r[1].variant_source == "given" else f" "
                f"({r[1].variant_source})"),
                (r[1].variant.velocity, r[1].variant_source),
            )),
            ("repetition", "repetition", lambda r: Cell(
                NONE if r[0].info.repetition is None else str(r[0].info.repetition), (r[0].info.repetition,)
            )),
            ("distance [m]", "distance_m distance_std_m", lambda r: estimate(r[1].distance)),
            ("λ_R [%]", "slip_ratio slip_ratio_std", lambda r: estimate(r[1].slip_ratio, 100)),
            ("k_92, steady slip [–]", "k92 k92_std k92_status", lambda r: fitted(r[2].k92, r[2].status)),
            ("k_92, trajectory [–]", "k92_trajectory k92_trajectory_std k92_trajectory_status",
             lambda r: fitted(r[2].k92_trajectory, r[2].status_trajectory)),
            ("wheel stamps late [ms]", "wheel_stamps_late_s wheel_stamps_late_std_s",
            lambda r: late(r[1].stamps_late)),
            ("estimate", "", lambda r: good(r[1].health.good)),
            ("warnings", "warnings", lambda r: count(len(set(r[0].warnings) | set(r[1].warnings)))),
        ],
        virtual=result.virtual and not mixed,
    )  # fmt: skip


def good(is_good: bool) -> Cell:
    """Return the verdict on an estimate."""
    return words("good", "good") if is_good else words("doubtful", "bad")


def late(offset: Estimate) -> Cell:
    """Return by how much stamps are late [ms]."""
    return Cell(plus_minus(offset, scale=1e3), (offset.value, offset.std))


def fitted(value: Estimate, status: FitStatus) -> Cell:
    """Return a fitted k_92; where it is no inner optimum, with the reason."""
    text, raw = plus_minus(value), (value.value, value.std, FIT[status])
    return Cell(text, raw) if status == "ok" else Cell(f"{text} ({FIT[status]})", raw, "fair")


def k92_table(fits: Sequence[K92Fit]) -> Table:
    """Return k_92 of each trial, by the steady slip and by the whole trajectory."""
    return tabulate(
        "k92", "k_92 of each trial", "Value ± standard deviation.", fits,
        [
            ("trial", "", lambda f: f.trial),
            ("speed [m/s]", "speed_mps", lambda f: Cell(f"{f.variant.velocity:.3g}", (f.variant.velocity,))),
            ("λ_R [%]", "slip_ratio slip_ratio_std", lambda f: estimate(f.slip_measured, 100)),
            ("k_92, steady slip [–]", "k92 k92_std k92_status", lambda f: fitted(f.k92, f.status)),
            ("k_92, trajectory [–]", "k92_trajectory k92_trajectory_std k92_trajectory_status",
             lambda f: fitted(f.k92_trajectory, f.status_trajectory)),
        ],
        virtual=any(f.virtual for f in fits),
    )  # fmt: skip


def parameter_table(source: Source) -> Table:
    """Return every parameter in force and its origin."""
    return tabulate(
        "parameters", "Parameters in force", "Each with the file it was read from.", source.parameters,
        [
            ("parameter", "", lambda p: p[0]),
            ("value", "value", lambda p: p[1]),
            ("unit", "", lambda p: tidy_unit(p[2])),
            ("origin", "", lambda p: p[3]),
        ],
    )  # fmt: skip


def input_table(source: Source) -> Table:
    """Return the files that were read; of an absolute path only the name."""
    specs = [("file", "", lambda i: shown_path(i.path)), ("SHA-256", "", lambda i: i.sha256)]
    return tabulate("inputs", "Files that were read", "", source.inputs, specs)


def shown_path(path: Path) -> str:
    """Return a path as a report may show it: of an absolute one only the name."""
    return path.name if path.is_absolute() else path.as_posix()


def effects_table(
    finding: Finding, known: Mapping[str, Effect], effects: Sequence[FoundEffect], *, small: bool = False
) -> Table:
    """List effects, each number with its interval.

    Args:
        finding: the record.
        known: candidates by id, for what their numbers mean.
        effects: of the finding, those that were named or the small ones.
        small: they are the small ones.
    """

    def bounds(e: FoundEffect, p: FoundParameter) -> Cell:
        low, high = (p.estimate.value + sign * LIKELY * p.estimate.std for sign in (-1, 1))
        return Cell(interval(low, high, *scale_of(e.id, p.name, p.unit, p.estimate.value)), (low, high))

    def once(first: bool, text: str, *raw: float | str) -> Cell:
        return Cell(text if first else "", raw)  # what holds for the whole effect stands in its first row

    return tabulate(
        "found_small" if small else "found_effects",
        "Small effects" if small else "What is missing, with sizes",
        "Possibly present; they close little of the gap or stay below the tolerance."
        if small
        else "Fitted together with the sand and the errors of the sensors. The std of a strength includes "
        f"{percent(FORMULA_ERROR[0])} for the error of its formula. Last column: share of the closed gap "
        "that opens again without the effect, on trials left out of the fit.",
        [(e, p, k == 0) for e in effects for k, p in enumerate(e.parameters or (NO_NUMBER,))],
        [
            ("effect", "", lambda r: once(r[2], plain(r[0].id), plain(r[0].id))),
            ("number", "", lambda r: "amount" if r[0].empirical else r[1].name.replace("_", " ")),
            ("what it is", "", lambda r: "term of an empirical law" if r[0].empirical
             else meaning(r[0].id, r[1].name, known) or NONE),
            ("value ± std", "value std unit",
             lambda r: Cell(amount(r[0], r[1]), (r[1].estimate.value, r[1].estimate.std, r[1].unit))),
            ("95 % interval", "low high", lambda r: bounds(r[0], r[1])),
            ("cannot be told from", "", lambda r: ", ".join(plain(t) for t in r[0].twins) or "none")
            if any(e.twins for e in effects) else None,
            ("probability", "probability", lambda r: once(r[2], percent(r[0].probability), r[0].probability)),
            ("gap lost without it", "closes closes_std",
             lambda r: once(r[2], percent_of(r[0].closes), r[0].closes.value, r[0].closes.std)),
        ],
        virtual=finding.virtual,
    )  # fmt: skip


NO_NUMBER = FoundParameter(NONE, "", Estimate(math.nan))


def discrepancies(finding: Finding) -> dict[str, tuple[float, float]]:
    """Return per channel the rms of its discrepancy in motion over its rms, without and with the effects."""

    def share(channel: str, name: str) -> float:
        own = [r for r in finding.residuals if r.channel == channel and r.size > 0]
        parts = [getattr(r, name)[r.std > 0] / r.size for r in own]  # the bins of the motion
        values = np.concatenate(parts) if parts else np.zeros(0)
        return float(np.sqrt(np.mean(values**2))) if values.size else math.nan

    return {c: (share(c, "discrepancy_before"), share(c, "discrepancy_after")) for c in channels_of(finding)}


def gaps_table(finding: Finding) -> Table:
    """List per sensor the gap, in the fit and on trials left out, and the discrepancy."""
    shares, unknown = discrepancies(finding), (math.nan, math.nan)
    every = (finding.gap, *finding.gaps)
    out = any(math.isfinite(v) for g in every for v in g.held_out)
    return tabulate(
        "found_gaps", "Gap between sensors and model, without and with the effects found",
        "Gap: root mean square of the residuals over what noise and tolerance explain; 1 means explained. "
        "Discrepancy: what all repetitions share and the model does not explain, over the rms of the "
        "sensor in motion.",
        every,
        [
            ("sensor", "", lambda g: "all channels" if g.channel == "all" else channel_name(g.channel)),
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


def candidates_table(finding: Finding, known: Mapping[str, Effect]) -> Table:
    """List every candidate with its probability, the share of the gap it closes, and what became of it."""
    return tabulate(
        "found_candidates", "Every candidate",
        "Probability that the effect is in the model; share of the gap that it closes alone, all trials in "
        "the fit; logarithm of the Bayes factor against the model that it was added to.",
        shown_candidates(finding),
        [
            ("candidate", "", lambda c: plain(c.id)),
            ("what it is", "", lambda c: known[c.id].title if c.id in known else NONE),
            ("probability", "probability", lambda c: Cell(percent(c.probability), (c.probability,))),
            # a fit to the noise closes no more than all of the gap
            ("closes alone", "closes", lambda c: Cell(percent(min(c.closes, 1.0)), (c.closes,))),
            ("ln Bayes factor [–]", "log_bayes_factor", lambda c: number(c.gain, 3)),
            ("result", "", lambda c: STATUS[c.status]
             + (f" ({', '.join(b.replace('_', ' ') for b in c.bounds)})" if c.bounds else "")),
        ],
        virtual=finding.virtual,
    )  # fmt: skip


def detectable_table(finding: Finding, known: Mapping[str, Effect]) -> Table:
    """List the smallest size of each candidate that these trials show, and what limits it."""
    declared = {(e.id, p.name): p for e in known.values() for p in e.parameters}

    def expected(d: Detectable) -> tuple[float, float] | None:
        p = declared.get((d.effect, d.parameter))
        return (p.prior_low, p.prior_high) if p else None

    def scale(d: Detectable) -> tuple[str, float]:
        return scale_of(d.effect, d.parameter, d.unit, max(map(abs, expected(d) or (d.size,))))

    def literature(d: Detectable) -> Cell:
        ends = expected(d)
        text = " to ".join(f"{v * scale(d)[1]:.4g}".replace("-", "−") for v in ends) if ends else NONE
        return Cell(text, ends or (None, None))

    def alike(d: Detectable) -> str:
        names = [plain(i) for i in d.confused_with]
        return (", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")) or "none"

    return tabulate(
        "found_detectable", "Smallest sizes that these trials show",
        "An effect of this size is named with a probability of 80 %. Expected: range of the literature.",
        finding.detectable,
        [
            ("candidate", "", lambda d: plain(d.effect)),
            ("number", "", lambda d: d.parameter.replace("_", " ")),
            ("smallest size", "smallest", lambda d: number(d.size, 2, scale=scale(d)[1])
             if math.isfinite(d.size) else Cell("not visible", (None,))),
            ("expected", "expected_low expected_high", literature),
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
    unsure = [i for i, share in first.items() if share < SURE]
    table = tabulate(
        "found_confusion", "Candidates that these trials could take for another",
        f"Each candidate in turn at {check.factor:g} times its smallest visible size, {check.draws} times "
        f"with other noise. All others are named first in at least {percent(SURE)} of these sets.",
        unsure,
        [
            ("candidate", "", plain),
            ("named first", "first", lambda i: Cell(percent(first[i]), (first[i],))),
            ("nothing named", "missed", lambda i: Cell(
                percent(float(check.missed[check.ids.index(i)])), (float(check.missed[check.ids.index(i)]),)
            )),
            ("taken for", "", lambda i: ", ".join(f"{plain(o)} ({percent(x)})" for o,
            x in check.taken_for(i)) or "none"),
        ],
        virtual=finding.virtual,
    )  # fmt: skip
    return table if unsure else None


def fitted_table(finding: Finding) -> Table | None:
    """List the sand common to all trials over its file, and what differs from trial to trial; None "
    "without any.

    a_θ has an answer of its own.
    """
    rows: list[tuple[str, str, Cell]] = []
    for name, log in finding.sand.items():
        if name != "a_theta":
            ratio = Estimate(float(np.expm1(log.value)), float(np.exp(log.value) * log.std))
            rows.append((SAND.get(name, name), "from the file", Cell(percent_of(ratio), (ratio.value,))))
    for name, std in finding.scales.items():
        text, unit, scale = SCALES.get(name, (name, "", 1.0))
        size = Cell(f"{significant(std * scale, 2)} {unit}".strip(), (std,))
        rows.append((text, "from trial to trial, std", size))
    table = tabulate(
        "found_fitted", f"Sand and sensors as fitted, compared with {finding.soil.title}",
        "Fitted together with everything else.", rows,
        [("number", "", lambda r: r[0]), ("difference", "", lambda r: r[1]),
        ("size", "size", lambda r: r[2])],
        virtual=finding.virtual,
    )  # fmt: skip
    return table if rows else None
