"""The tables of a study: its trials, laws for k_92, and uncertainty budgets."""

from __future__ import annotations

import math
from collections.abc import Sequence

from granite_lab.columns import Cell, Column, FilledTable, Table, good, number, share, words
from granite_lab.comparison.compare import Comparison
from granite_lab.estimate import Estimate, Part, mean_over, weights_of
from granite_lab.estimation.motion import TELLING
from granite_lab.fitting import fit as records
from granite_lab.fitting.fit import (
    COMBINED,
    K92_APART,
    K92_FITS,
    K92_STEADY,
    K92_TRAJECTORY,
    LAW_NAMES,
    VIEWS,
    AThetaFit,
    K92Fit,
    Law,
    View,
)
from granite_lab.logs.trial import InputFile
from granite_lab.reporting.speeds import Speed
from granite_lab.results import StudyResult, shown_path, warnings_of
from granite_lab.rounding import NONE, interval, places, significant, tidy_unit


def law_table(fit: AThetaFit, virtual: bool) -> FilledTable:
    """Return the rival laws for k_92, best first, and which the data prefer; values stand in the CSV file."""
    note = "Only one law could be fitted." if fit.laws else "No law could be compared."
    if len(fit.laws) > 1:
        lead = fit.laws[1].aicc - fit.laws[0].aicc
        first, second = (LAW_NAMES.get(law.id, law.formula) for law in fit.laws[:2])
        clear = "clearly better than" if lead > 10 else "better than" if lead > 2 else "hardly better than"
        note = (
            f"By the corrected Akaike criterion AICc, {first} is {clear} {second} (ΔAICc "
            f"{places(lead, 1)}; above 10 is decisive)."
        )
        if not math.isfinite(lead):
            note = "Too few values of k_92 for an information criterion of every law."
    best = fit.laws[0].aicc if fit.laws else math.nan

    def numbers(law: Law) -> Cell:
        values = "; ".join(f"{k} = {v.value:.6g}" for k, v in law.parameters.items())
        return Cell(str(law.n_parameters), (law.n_parameters, values))

    def delta(law: Law) -> Cell:
        over = law.aicc - best
        return Cell(places(over, 1) if math.isfinite(over) else NONE, (over,))

    return Table[Law](
        "laws",
        "Laws for k_92 compared",
        Column("law", lambda law: Cell(LAW_NAMES.get(law.id, law.formula), (law.id,))),
        Column("fitted numbers", numbers, "fitted_numbers values"),
        Column("rms residual", lambda law: law.rms, "rms", unit="–", digits=2),
        Column("ΔAICc", delta, "delta_aicc", unit="–"),
        note=note,
    ).fill(fit.laws, virtual=virtual)


def trial_table(result: StudyResult) -> FilledTable:
    """Return one row per trial."""
    mixed = result.virtual and not all(r.trial.info.virtual for r in result.trials)

    def speed(r: Comparison) -> Cell:
        motion = r.motion
        v, source = motion.variant.velocity, motion.variant_source
        return Cell(f"{v:.3g}" + ("" if source == "given" else f" ({source})"), (v, source))

    return Table[Comparison](
        "trials",
        "Trials",
        Column("trial", lambda r: r.trial.name),
        Column("data", lambda r: "virtual" if r.trial.info.virtual else "measured", shown=mixed),
        Column("speed", speed, "speed_mps speed_is", unit="m/s"),
        Column("distance", lambda r: r.motion.distance, "distance_m distance_std_m", unit="m"),
        Column(
            "λ_R", lambda r: r.motion.slip_ratio,
            "slip_ratio slip_ratio_std", unit="%", scale=100, widest=1.0,
        ),
        K92_STEADY.of(lambda r: r.fit),
        K92_TRAJECTORY.of(lambda r: r.fit),
        K92_APART.of(lambda r: r.fit),
        Column(
            "wheel stamps late", lambda r: r.motion.stamps_late,
            "wheel_stamps_late_s wheel_stamps_late_std_s", unit="ms", scale=1000,
        ),
        Column("estimate", lambda r: good(r.motion.health.good)),
        Column("warnings", lambda r: len(warnings_of(r)), "warnings"),
        note="Value ± standard deviation of a single trial. Apart: difference of the two k_92 over its std. "
        "Wheel stamps late: how much later the time stamps of encoders and currents are than those of the "
        "IMU; negative where they are earlier.",
    ).fill(result.trials, virtual=result.virtual and not mixed)  # fmt: skip


def k92_table(fits: Sequence[K92Fit]) -> FilledTable:
    """Return k_92 of each trial, by the steady slip and by the whole trajectory."""
    return K92_FITS.fill(fits, virtual=any(f.virtual for f in fits))


BUDGETS = {
    "slip": ("slip ratio λ_R", "points", 100.0),
    "k92": ("contact-angle ratio k_92", "–", 1.0),
    "a_theta": ("a_θ", "s/m", 1.0),
    "a_theta_uncertain": ("a_θ with soil and wheel radius", "s/m", 1.0),
}
"""Quantity with a budget: in words, unit of the contributions, and the factor to it."""


def budget_tables(result: StudyResult, speeds: Sequence[Speed]) -> list[FilledTable]:
    """Return what the std of λ_R, k_92 and a_θ is made of (JCGM 100:2008, 5.1 and 8), a table each.

    What has no stated std, or no components, has no budget.
    """
    budgets: dict[str, list[records.Budget | None]] = {quantity: [] for quantity in BUDGETS}
    for speed in speeds:
        motions = [r.motion for r in speed.results]
        with_slip = [m for m in motions if math.isfinite(m.slip_ratio.value)]
        inner = [r.fit for r in speed.results if r.fit.k92_known]
        slips, k92 = [m.slip_ratio for m in with_slip], [f.k92 for f in inner]
        parts = {"slip": [m.slip_parts for m in with_slip], "k92": [f.parts for f in inner]}
        for quantity, estimates, vague in (("slip", slips, TELLING), ("k92", k92, math.inf)):
            mean, weights = mean_over(estimates, vague, parts[quantity]), weights_of(estimates, vague)
            stated = Estimate(mean.value, mean.std)
            budgets[quantity].append(records.of_mean(speed.velocity, stated, parts[quantity], weights))
    if result.a_theta is not None:
        budgets["a_theta"].append(records.of_a_theta(result.a_theta, [r.fit for r in result.trials]))
        wide = [records.Budget(math.nan, v.a_theta, v.parts) for v in records.views_of(result.a_theta)[1:]]
        budgets["a_theta_uncertain"] += wide
    there = {quantity: [b for b in stated if b is not None] for quantity, stated in budgets.items()}
    return [_budget_table(quantity, stated, result.virtual) for quantity, stated in there.items() if stated]


A_THETA = Table[View](
    "a_theta",
    "a_θ, and how far it depends on the files and on what is missing",
    Column("by", lambda v: VIEWS[v.by]),
    Column("a_θ", lambda v: v.a_theta, "a_theta a_theta_std", unit="s/m"),
    Column("95 % interval", lambda v: Cell(interval(*v.ci95), v.ci95), "low95 high95", unit="s/m"),
    note="The std of soil and wheel radius are those of their files (keys with “_std”), else those of the "
    "literature.",
)


Component = tuple[records.Budget, Part]
"""A row of a budget."""


def _budget_table(quantity: str, budgets: Sequence[records.Budget], virtual: bool) -> FilledTable:
    """Return the budgets of one quantity as one table, the combined uncertainty of each last."""
    title, unit, scale = BUDGETS[quantity]

    def std(row: Component) -> Cell:
        part = row[1]
        text = f"{significant(part.std, 2)} {tidy_unit(part.unit if part.unit != '1' else '')}".strip()
        return Cell(text if part.unit else NONE, (part.std if part.unit else None, part.unit))

    def sensitivity(row: Component) -> Cell:
        return number(row[1].sensitivity if row[1].unit else math.nan, 2, scale=scale)

    each = not quantity.startswith("a_theta")
    mean = "Mean over the trials of a speed. " if each else ""
    return Table[Component](
        f"budget_{quantity}",
        f"Uncertainty budget of {title}",
        Column("component", lambda row: row[1].name),
        Column("speed", lambda row: row[0].speed, "speed_mps", unit="m/s", form="g", shown=each),
        Column("type", lambda row: words("" if row[1].name == COMBINED else row[1].kind)),
        Column("distribution", lambda row: row[1].distribution),
        Column("standard uncertainty", std, "std std_unit"),
        Column("sensitivity", sensitivity, "sensitivity", unit=f"{unit} per its unit"),
        Column(
            "contribution", lambda row: row[1].contribution, "contribution",
            unit=unit, digits=2, scale=scale,
        ),
        Column("share", lambda row: share(row[0].share(row[1])), "share"),
        note=f"{mean}Contribution: sensitivity times standard uncertainty, combined over the trials. Share: "
        "of the variance. Type A: from the scatter of the data; type B: from other knowledge. "
        f"{records.LEFT_OUT[quantity]}",
    ).fill(((b, part) for b in budgets for part in (*b.parts, b.whole)), virtual=virtual)  # fmt: skip


PARAMETERS = Table[tuple[str, str, str, str]](
    "parameters",
    "Parameters in force",
    Column("parameter", lambda p: p[0]),
    Column("value", lambda p: p[1], "value"),
    Column("unit", lambda p: words(tidy_unit(p[2]))),
    Column("origin", lambda p: p[3]),
    note="Each with the file it was read from.",
)
"""Rows of `Source.parameters`."""

INPUTS = Table[InputFile](
    "inputs",
    "Files that were read",
    Column("file", lambda f: shown_path(f.path)),
    Column("SHA-256", lambda f: f.sha256),
)
