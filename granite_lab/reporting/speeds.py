"""Slip and k_92 by speed, with the paper's, and why there is no k_92; every output prints these numbers."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.columns import Cell, Column, FilledTable, Table, number
from granite_lab.comparison.compare import Comparison
from granite_lab.estimate import mean_over
from granite_lab.estimation.motion import TELLING
from granite_lab.fitting.fit import BOUNDS
from granite_lab.parameters import Published, by_speed, load_paper
from granite_lab.reporting.names import listed
from granite_lab.results import StudyResult
from granite_lab.rounding import NONE, Number, rounded, significant

EVERYTHING = 100.0
"""An interval of λ_R wider than this [points] holds every slip that wheels may have, so no slip is known."""


@dataclass(frozen=True, eq=False)
class Speed:
    """All trials at one desired velocity.

    Attributes:
        velocity: desired velocity [m/s].
        results: the trials.
        trials: how many have a slip ratio.
        slip: mean λ_R over the trials [%], with its standard error and 95 % interval.
        k92: mean of k_92 fitted to the steady slip [–], likewise.
        k92_note: stands in place of k_92 where no trial determines it.
        reach: the least and the largest λ_R that the model attains [%]; NaN if not known.
        paper_slip: λ_R of the paper's experiment [%] as printed there; NaN where it has none.
        paper_k92: k_92 of the paper; NaN likewise.
    """

    velocity: float
    results: tuple[Comparison, ...]
    trials: int
    slip: Number
    k92: Number
    k92_note: str
    paper_slip: float
    paper_k92: float
    reach: tuple[float, float] = (math.nan, math.nan)

    @property
    def agrees(self) -> bool | None:
        """Whether the paper's slip lies in the interval as printed; None where that cannot be said."""
        return self.slip.holds(self.paper_slip)

    @property
    def slip_is_known(self) -> bool:
        """Whether the interval of the slip leaves anything out."""
        return math.isfinite(self.slip.value) and not self.slip.high - self.slip.low > EVERYTHING

    @property
    def typical(self) -> Comparison:
        """The trial whose λ_R is in the middle; the one that is drawn."""
        slips = np.array([r.motion.slip_ratio.value for r in self.results])
        ranked = np.argsort(slips)  # NaN last
        return self.results[int(ranked[max(int(np.isfinite(slips).sum()) - 1, 0) // 2])]


K92 = (
    "k_92, the ratio of the contact angles behind and ahead of a wheel, is fitted to the slip; ± is its "
    "standard error."
)

AGREES = {True: Cell("yes", (True,), "good"), False: Cell("no", (False,), "fair"), None: Cell(NONE, (None,))}


def first_table(speeds: Sequence[Speed], *, slip_unknown: bool, virtual: bool) -> FilledTable | None:
    """Return the table of the first screen; None where it would hold nothing that is known.

    There is no k_92 where `slip_unknown`.
    """
    if not speeds or (slip_unknown and not any(s.slip_is_known for s in speeds)):
        return None
    note = "Means over trials. The interval includes their scatter and the std of each."
    return Table[Speed](
        "slip_by_speed",
        "Slip ratio λ_R by speed" if slip_unknown else "Slip ratio λ_R and contact-angle ratio k_92 by speed",
        Column("speed", lambda s: s.velocity, "speed_mps", unit="m/s", form="g"),
        Column("slip", lambda s: Cell(s.slip.text, (s.slip.value / 100,)), "slip_ratio", unit="%"),
        Column(
            "95 % interval", lambda s: Cell(s.slip.interval, (s.slip.low / 100, s.slip.high / 100)),
            "slip_ratio_low95 slip_ratio_high95", unit="%",
        ),
        Column(
            "paper", lambda s: number(s.paper_slip / 100, scale=100), "slip_ratio_paper_experiment", unit="%"
        ),
        Column("paper in interval", lambda s: AGREES[s.agrees]),
        Column(
            "k_92", lambda s: Cell(s.k92_note or s.k92.with_std, (s.k92.value, s.k92.std)),
            "k92 k92_std", unit="–", shown=not slip_unknown,
        ),
        Column(
            "paper's k_92", lambda s: s.paper_k92, "k92_paper", unit="–", form="g", shown=not slip_unknown
        ),
        Column("trials", lambda s: s.trials, "trials"),
        note=note if slip_unknown else f"{note} {K92}",
    ).fill(speeds, virtual=virtual)  # fmt: skip


def speeds_of(result: StudyResult) -> tuple[Speed, ...]:
    """Group the trials by desired velocity (`parameters.by_speed`)."""
    from granite_lab.fitting.atheta import k92_interval  # noqa: PLC0415, heavy

    rows = []
    for velocity, positions in by_speed(velocities_of(result)).items():
        trials = [result.trials[i] for i in positions]
        fits = [t.fit for t in trials]
        inner = [f for f in fits if f.k92_known]
        slips, parts = [t.motion.slip_ratio for t in trials], [t.motion.slip_parts for t in trials]
        *slip, count = mean_over(slips, TELLING, parts)
        k92 = mean_over((f.k92 for f in inner), parts=[f.parts for f in inner])
        # The interval is by the likelihood where the covariance is not enough.
        ends = k92_interval(inner, (k92.low, k92.high))
        published = published_at(velocity)
        rows.append(
            Speed(
                velocity, tuple(trials), count, rounded(*slip, unit="%", scale=100),
                rounded(k92.value, k92.std, *ends),
                "" if inner else "at its limit" if all(f.status in BOUNDS for f in fits) else "not known",
                # The paper prints three digits; the tail of 100 times a fraction is none of them.
                round(100 * published.slip_measured, 6) if published else math.nan,
                published.k92 if published else math.nan,
                (100 * min(f.reach[0] for f in fits), 100 * max(f.reach[1] for f in fits)),
            )
        )  # fmt: skip
    return tuple(rows)


def published_at(velocity: float) -> Published | None:
    """Return the row of Table 3 of the paper at a velocity [m/s]; None where it has none."""
    return next((row for row in load_paper().table3 if abs(row.velocity - velocity) < 0.005), None)


def velocities_of(result: StudyResult) -> list[float]:
    """Return the desired velocity of each trial [m/s]."""
    return [trial.motion.variant.velocity for trial in result.trials]


REMEDY = (
    "Let the robot stand for 2 s before and after each run, name its standstills (rests, body_rests), or use "
    "a reference with its std (--use-reference)."
)


def why_no_k92(result: StudyResult) -> str:
    """Say why no trial of a study determines k_92; empty where a trial does, or where there is no trial."""
    if not result.trials or any(r.fit.k92_known for r in result.trials):
        return ""
    reasons: dict[str, list[Comparison]] = defaultdict(list)
    for r in result.trials:
        reasons[_reason(r)].append(r)
    parts: list[str] = []
    for reason, trials in reasons.items():
        stds = [100 * r.fit.slip_measured.std for r in trials]
        low, high = (significant(f(stds), 2) for f in (min, max))
        uncertainty = f"± {low}" if low == high else f"± {low} to {high}"
        which = "that of" if parts else "λ_R of"
        names = [r.trial.name for r in trials]
        several = f"{len(names)} trials" if len(names) > 3 else listed(names)
        parts.append(f"{which} {several} {reason.format(std=uncertainty)}")
    return f"k_92 cannot be determined from these trials, because {'; '.join(parts)}."


def _reason(r: Comparison) -> str:
    """Return what is wrong with the λ_R of a trial, with a place for how well it is known."""
    fit, motion = r.fit, r.motion
    if not math.isfinite(fit.slip_measured.value):
        return "does not exist: nothing in it is steady"
    if not fit.slip_known:
        causes = [reason for reason in motion.health.reasons if "known to ±" not in reason]
        # the std of slip depends most on what anchors the velocity
        causes.sort(key=lambda reason: "anchor" not in reason and "standstill" not in reason)
        because = f" ({causes[0].split(': ')[0]})" if causes else ""
        return f"is known to {{std}} points only{because.replace('{', '{{').replace('}', '}}')}"
    if fit.status in BOUNDS:
        low, high = (significant(100 * x, 2) for x in fit.reach)
        side = "above" if fit.status == "at_lower_bound" else "below"
        return f"lies {side} the {low} to {high} % that the model reaches on this soil"
    return "could not be fitted"


def reach_in_words(speeds: Sequence[Speed]) -> str:
    """Say which slip the model can reach on the soil of the trials, by its k_92 alone."""
    reached = [s for s in speeds if all(map(math.isfinite, s.reach))]
    if not reached:
        return ""

    def span(low: float, high: float) -> str:
        return f"{significant(max(low, 0.0), 2)} to {significant(high, 2)} %"

    where = listed([f"{span(*s.reach)} at {s.velocity:.3g} m/s" for s in reached])
    if len(reached) > 3:
        ends = min(s.reach[0] for s in reached), max(s.reach[1] for s in reached)
        where = f"{span(*ends)}, depending on speed"
    return f"On this soil the model reaches a slip of {where}."
