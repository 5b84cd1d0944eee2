"""The tables of a report: what a study and a search found, by speed, quantity, trial, effect and sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from granite_lab.estimate import Estimate, Part
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.budget import LEFT_OUT, Budget, of_a_theta, of_mean
from granite_lab.fitting.fit import AThetaFit, FitStatus, K92Fit
from granite_lab.reporting.answers import Answers
from granite_lab.reporting.content import Source, StudyResult, shown_path
from granite_lab.reporting.rounding import (
    NONE,
    places,
    plus_minus,
    shown_as,
    significant,
    tidy_unit,
)
from granite_lab.reporting.summary import ChannelAnswer, Gap, Speed, mean_over
from granite_lab.reporting.table import Cell, Spec, Table, estimate, number, share, tabulate, words
from granite_lab.reporting.words import WORDS, quantity

AGREES = {True: ("yes", "good"), False: ("no", "fair"), None: (NONE, "")}

FIT, LAWS = WORDS["fit"], WORDS["laws"]
"""Status of a fit, and laws for k_92, as a reader calls them."""


def slip_table(answers: Answers) -> Table:
    """Return slip and k_92 by speed beside the paper: the table of the first screen."""
    return tabulate(
        "slip_by_speed", answers.speeds,
        [
            ("speed [m/s]", "speed_mps", lambda s: Cell(f"{s.velocity:g}", (s.velocity,))),
            ("slip [%]", "slip_ratio", lambda s: Cell(s.slip.text, (s.slip.value / 100,))),
            ("95 % interval [%]", "slip_ratio_low95 slip_ratio_high95",
             lambda s: Cell(s.slip.interval, (s.slip.low / 100, s.slip.high / 100))),
            ("paper [%]", "slip_ratio_paper_experiment", lambda s: number(s.paper_slip / 100, 3, scale=100)),
            ("paper inside", "", lambda s: Cell(AGREES[s.agrees][0], (s.agrees,), AGREES[s.agrees][1])),
            ("k_92 [–]", "k92 k92_std",
             lambda s: Cell(s.k92_note or s.k92.with_std, (s.k92.value, s.k92.std))),
            # the paper's digits
            ("paper's k_92 [–]", "k92_paper",
             lambda s: Cell(f"{s.paper_k92:g}" if math.isfinite(s.paper_k92) else NONE, (s.paper_k92,))),
            ("trials", "trials", lambda s: s.trials),
        ],
        virtual=bool(answers.virtual),
    )  # fmt: skip


def channel_table(channels: Sequence[ChannelAnswer], virtual: bool) -> Table:
    """Return how well the model explains each quantity over whole trials."""

    def size(value: float, unit: str) -> Cell:
        return Cell(f"{significant(value, 2)} {unit}" if math.isfinite(value) else NONE, (value, unit))

    return tabulate(
        "channels", channels,
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
        "misfits", found.values(),
        [
            ("quantity", "", lambda g: quantity(g.channel)),
            ("phase", "", lambda g: g.phase),
            ("unit", "", lambda g: tidy_unit(shown_as(g.unit)[0])),
            ("rms", "rms_si", lambda g: size(g.rms, g)),
            ("mean", "bias_si", lambda g: size(g.bias, g)),
            ("largest", "peak_si", lambda g: size(g.peak, g)),
            ("rms over noise [–]", "rms_over_noise", lambda g: number(g.normalised, 2)),
            ("trials", "trials", lambda g: g.trials),
        ],
        virtual=virtual,
    )  # fmt: skip


def law_table(fit: AThetaFit, virtual: bool) -> Table:
    """Return the rival laws for k_92, best first, and which the data prefer; values stand in the CSV file."""
    caption = "Only one law could be fitted." if fit.laws else "No law could be compared."
    if len(fit.laws) > 1:
        lead = fit.laws[1].aicc - fit.laws[0].aicc
        first, second = (LAWS.get(law.id, law.formula) for law in fit.laws[:2])
        clear = "clearly better than" if lead > 10 else "better than" if lead > 2 else "hardly better than"
        caption = (
            f"By the corrected Akaike criterion AICc, {first} is {clear} {second} (ΔAICc "
            f"{significant(lead, 2)}; above 10 is decisive)."
        )
        if not math.isfinite(lead):
            caption = "Too few values of k_92 for an information criterion of every law."
    best = fit.laws[0].aicc if fit.laws else math.nan
    return tabulate(
        "laws", fit.laws,
        [
            ("law", "", lambda law: Cell(LAWS.get(law.id, law.formula), (law.id,))),
            ("fitted numbers", "fitted_numbers values", lambda law: Cell(
                str(law.n_parameters),
                (law.n_parameters, "; ".join(f"{k} = {v.value:.6g}" for k, v in law.parameters.items())),
            )),
            ("rms residual [–]", "rms", lambda law: number(law.rms, 2)),
            ("ΔAICc [–]", "delta_aicc", lambda law: Cell(
                places(law.aicc - best, 1) if math.isfinite(law.aicc - best) else NONE, (law.aicc - best,)
            )),
        ],
        virtual=virtual, verdict=caption,
    )  # fmt: skip


def trial_table(result: StudyResult) -> Table:
    """Return one row per trial."""
    mixed = result.virtual and not all(r.trial.info.virtual for r in result.trials)

    def speed(m: Motion) -> Cell:
        source = "" if m.variant_source == "given" else f" ({m.variant_source})"
        return Cell(f"{m.variant.velocity:.3g}{source}", (m.variant.velocity, m.variant_source))

    def repetition(n: int | None) -> Cell:
        return Cell(NONE if n is None else str(n), (n,))

    return tabulate(
        "trials", [(r.trial, r.comparison.motion, r.comparison.fit) for r in result.trials],
        [
            ("trial", "", lambda r: r[0].name),
            ("data", "", lambda r: "virtual" if r[0].info.virtual else "measured") if mixed else None,
            ("speed [m/s]", "speed_mps speed_is", lambda r: speed(r[1])),
            ("repetition", "repetition", lambda r: repetition(r[0].info.repetition)),
            ("distance [m]", "distance_m distance_std_m", lambda r: estimate(r[1].distance)),
            ("λ_R [%]", "slip_ratio slip_ratio_std", lambda r: estimate(r[1].slip_ratio, 100)),
            *_k92_columns(lambda r: r[2]),
            ("wheel stamps late [ms]", "wheel_stamps_late_s wheel_stamps_late_std_s",
             lambda r: estimate(r[1].stamps_late, 1e3)),
            ("estimate", "", lambda r: good(r[1].health.good)),
            ("warnings", "warnings", lambda r: len(set(r[0].warnings) | set(r[1].warnings))),
        ],
        virtual=result.virtual and not mixed,
    )  # fmt: skip


def _k92_columns(fit: Callable[[Any], K92Fit]) -> list[Spec[Any]]:
    """Return the columns of both fits of k_92; where one is no inner optimum it stands with the reason."""

    def fitted(value: Estimate, status: FitStatus) -> Cell:
        text, raw = plus_minus(value), (value.value, value.std, FIT[status])
        return Cell(text, raw) if status == "ok" else Cell(f"{text} ({FIT[status]})", raw, "fair")

    return [
        ("k_92, steady slip [–]", "k92 k92_std k92_status", lambda r: fitted(fit(r).k92, fit(r).status)),
        ("k_92, trajectory [–]", "k92_trajectory k92_trajectory_std k92_trajectory_status",
         lambda r: fitted(fit(r).k92_trajectory, fit(r).status_trajectory)),
    ]  # fmt: skip


def good(is_good: bool) -> Cell:
    """Return the verdict on an estimate."""
    return words("good", "good") if is_good else words("doubtful", "bad")


def k92_table(fits: Sequence[K92Fit]) -> Table:
    """Return k_92 of each trial, by the steady slip and by the whole trajectory."""
    return tabulate(
        "k92", fits,
        [
            ("trial", "", lambda f: f.trial),
            ("speed [m/s]", "speed_mps", lambda f: Cell(f"{f.variant.velocity:.3g}", (f.variant.velocity,))),
            ("λ_R [%]", "slip_ratio slip_ratio_std", lambda f: estimate(f.slip_measured, 100)),
            *_k92_columns(lambda f: f),
        ],
        virtual=any(f.virtual for f in fits),
    )  # fmt: skip


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
    budgets: dict[str, list[Budget | None]] = {what: [] for what in BUDGETS}
    for speed in speeds:
        motions = [r.comparison.motion for r in speed.results]
        known = [m for m in motions if math.isfinite(m.slip_ratio.value)]
        inner = [r.comparison.fit for r in speed.results if r.comparison.fit.status == "ok"]
        slip, k92 = mean_over(m.slip_ratio for m in known), mean_over(f.k92 for f in inner)
        parts = {"slip": [m.slip_parts for m in known], "k92": [f.parts for f in inner]}
        for what, mean in (("slip", slip), ("k92", k92)):
            stated = Estimate(mean.value, mean.std)
            budgets[what].append(of_mean(speed.velocity, stated, parts[what]))
    if result.a_theta is not None:
        budgets["a_theta"].append(of_a_theta(result.a_theta, [r.comparison.fit for r in result.trials]))
    there = {what: [b for b in own if b is not None] for what, own in budgets.items()}
    return [_budget_table(what, own, result.virtual) for what, own in there.items() if own]


def _budget_table(what: str, of: Sequence[Budget], virtual: bool) -> Table:
    """Return the budgets of one quantity as one table, the combined uncertainty of each last."""
    title, unit, scale = BUDGETS[what]
    rows = [(b, part, b.share(part)) for b in of for part in b.parts] + [
        (b, Part(COMBINED, "A", "", "", b.result.std, b.combined), 1.0) for b in of
    ]
    rows.sort(key=lambda r: of.index(r[0]))

    def std(part: Part) -> Cell:
        text = f"{significant(part.std, 2)} {tidy_unit(part.unit if part.unit != '1' else '')}".strip()
        return Cell(text if part.unit else NONE, (part.std if part.unit else None, part.unit))

    speed = None
    if what != "a_theta":
        speed = ("speed [m/s]", "speed_mps", lambda r: Cell(f"{r[0].speed:g}", (r[0].speed,)))
    return tabulate(
        f"budget_of_{what}", rows,
        [
            ("component", "", lambda r: r[1].name),
            speed,
            ("type", "", lambda r: "" if r[1].name == COMBINED else r[1].kind),
            ("distribution", "", lambda r: r[1].distribution or NONE),
            ("standard uncertainty", "std std_unit", lambda r: std(r[1])),
            (f"sensitivity [{unit} per its unit]", "sensitivity",
             lambda r: number(r[1].sensitivity if r[1].unit else math.nan, 2, scale=scale)),
            (f"contribution [{unit}]", "contribution", lambda r: number(r[1].contribution, 2, scale=scale)),
            ("share", "share", lambda r: share(r[2])),
        ],
        virtual=virtual, quantity=title, left_out=LEFT_OUT[what],
        mean="Mean over the trials of a speed. " if speed else "",
    )  # fmt: skip


def parameter_table(source: Source) -> Table:
    """Return every parameter in force and its origin."""
    return tabulate(
        "parameters", source.parameters,
        [
            ("parameter", "", lambda p: p[0]),
            ("value", "value", lambda p: p[1]),
            ("unit", "", lambda p: tidy_unit(p[2])),
            ("origin", "", lambda p: p[3]),
        ],
    )  # fmt: skip


def input_table(source: Source) -> Table:
    """Return the files that were read; of an absolute path only the name."""
    columns = [("file", "", lambda i: shown_path(i.path)), ("SHA-256", "", lambda i: i.sha256)]
    return tabulate("inputs", source.inputs, columns)
