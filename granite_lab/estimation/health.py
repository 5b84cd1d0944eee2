"""Consistency of the filter: innovations, their statistics, and a verdict in plain words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc

from granite_lab.estimation.error_model import BA, BG, V, std_of
from granite_lab.estimation.motion import Health
from granite_lab.estimation.smoother import (
    REFERENCES,
    WANDERING,
    WANDERS,
    Solution,
    correlation,
    slow_excess,
    usual,
)
from granite_lab.logs.sensors.doubt import Grade
from granite_lab.logs.sensors.standstill import Interval
from granite_lab.logs.trial import Array

ANCHORED, SLOW = 0.02, 0.004
"""The velocity is anchored at an end where its std is below this share of the pace, or below this [m/s]."""

VAGUE = 0.1
"""A velocity whose std is beyond this share of the pace tells little of slip."""

SIDES = (("start", 0), ("end", -1))
"""Ends of a log, and the places of their nodes."""

SHAKEN = 3.0
"""A pitch gyro this many times as noisy in motion as at rest is not the sensor of its grade any more."""

WHAT = {
    "zero_velocity": "the velocity that integration leaves at standstill",
    "specific_force": "the accelerometer at standstill",
    "zero_rate": "the gyro at standstill",
    "wheel": "the speed of the wheels against the IMU",
    "distance": "the measured distance",
    "reference_v": "the velocity of the external reference",
    "reference_x": "the place of the external reference",
}


@dataclass(frozen=True)
class Statistics:
    """How the measurements of one kind met their predictions."""

    nis: float  # mean normalised innovation squared of those that told anything new
    count: int  # how many they are
    white: float  # `correlation` of successive ones
    chance: float  # `ljung_box` of them
    wild: float  # share beyond four std
    slow: float  # `slow_excess` of them


def assess(solution: Solution) -> Health:
    """Build the health record of the smoother's last pass; biases at the IMU's stamps (N,)."""
    problem, nodes, smoothed, nominal = solution.problem, solution.nodes, solution.smoothed, solution.nominal
    came = smoothed.innovations
    sigma = np.sqrt(came.variance)
    kinds: dict[str, Statistics] = {}
    for kind in dict.fromkeys(came.updates.kind.tolist()):
        of_kind = came.fresh(kind)
        if not of_kind.any():
            of_kind = came.updates.kind == kind
        ratio = (came.value / sigma)[of_kind]
        nis, wild = float(np.mean(ratio**2)), float(np.mean(np.abs(ratio) > 4.0))
        kinds[kind] = Statistics(
            nis, ratio.size, correlation(ratio), ljung_box(ratio), wild, slow_excess(ratio)
        )
    at_stamps, (grade, reasons, remark) = solution.at_stamps, judge_health(kinds, solution)
    return Health(
        t=nodes.t[came.updates.node], kind=tuple(came.updates.kind.tolist()), innovation=came.value,
        innovation_std=sigma, nis={kind: statistics.nis for kind, statistics in kinds.items()},
        accel_bias=at_stamps(smoothed.x[:, BA] + nominal.accel_bias),
        accel_bias_std=at_stamps(std_of(smoothed.P, {BA: 1.0})),
        gyro_bias=at_stamps(smoothed.x[:, BG] + nominal.gyro_bias),
        gyro_bias_std=at_stamps(std_of(smoothed.P, {BG: 1.0})),
        rests=problem.rests, verdict=sentence(grade, reasons, remark), grade=grade, reasons=reasons,
        whiteness={kind: statistics.white for kind, statistics in kinds.items()},
        ljung_box={kind: statistics.chance for kind, statistics in kinds.items()},
        gaps=problem.faults.gaps, plateaus=problem.faults.plateaus,
    )  # fmt: skip


def ljung_box(ratio: Array, lags: int = 10) -> float:
    """Probability that white innovations correlate as much over some lags by chance (Ljung & Box 1978)."""
    n = ratio.size
    if n < 5 * lags:
        return float("nan")
    r = np.array([correlation(ratio, lag) for lag in range(1, lags + 1)])
    statistic = n * (n + 2) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    return float(gammaincc(0.5 * lags, 0.5 * statistic))


def scattering(kind: str, nis: float) -> str:
    """Say that measurements of a kind miss their predictions by more than the noise explains."""
    size = f"scatters {math.sqrt(nis):.1f} times more than the noise explains"
    return f"{WHAT[kind]} {size}, and the std is widened by as much"


def judge_health(kinds: dict[str, Statistics], solution: Solution) -> tuple[Grade, tuple[str, ...], str]:
    """Return a grade, the reasons for it, and a remark on a good one.

    It is "poor" where nothing anchors the velocity or its std is more than a tenth of the pace, "fair" where
    the std had to be widened or grows for want of samples or of a standstill, and "good" otherwise.
    """
    problem, nodes, noise = solution.problem, solution.nodes, solution.problem.noise
    complaints, referred = [], bool(kinds.keys() & {*REFERENCES})
    for kind, statistics in kinds.items():
        if statistics.nis > max(3.0, usual(statistics.count)):
            complaints.append(scattering(kind, statistics.nis))
        elif statistics.wild > 0.02:
            complaints.append(f"{WHAT[kind]} has {100 * statistics.wild:.0f} % outliers")
        elif kind in WANDERING and not referred and statistics.slow > WANDERS:
            known = "the slip model" if kind == "wheel" else "the IMU's grade"
            complaints.append(
                f"slow changes of {WHAT[kind]} are larger than {known} explains, and the std is widened"
            )
    shaken = noise.gyro_motion / noise.gyro
    if shaken > SHAKEN:
        complaints.append(f"motion makes the pitch gyro {shaken:.0f} times as noisy as it is at rest")
    v_std, pace = std_of(solution.smoothed.P, {V: 1.0}), float(np.max(np.abs(nodes.w)))
    limit = max(ANCHORED * pace, SLOW)
    # where a log moves at an end, nothing shows whether the biases are what they were
    loose = [side for side, k in SIDES if side in problem.open_ends or v_std[k] > limit]
    anchored = _anchor(problem.rests, loose, referred=referred)
    nothing_anchors = not problem.rests and not referred
    middle = float(np.median(v_std[nodes.moving])) if nodes.moving.any() else 0.0
    if nothing_anchors or middle > VAGUE * max(pace, SLOW):
        if not nothing_anchors:
            complaints.append(f"the velocity is known to {middle:.2g} m/s only")
        return "poor", (anchored, *complaints), ""
    if complaints or loose:
        return "fair", (anchored, *complaints), ""
    wheel, remark = kinds.get("wheel"), ""
    if wheel is not None and wheel.chance < 1e-3 and abs(wheel.white) > 0.1:
        side = "on the safe side" if wheel.white < 0 else "short of the fastest changes"
        remark = f" (the wheels' innovations correlate by {wheel.white:+.2f}: the std is {side})"
    return "good", (anchored,), remark


def _anchor(rests: Sequence[Interval], loose: Sequence[str], *, referred: bool) -> str:
    """Say what anchors the velocity, by the ends without an anchor and whether there is a reference."""
    several = f"{len(rests)} standstill{'s' * (len(rests) > 1)}"
    if referred:
        text = f"velocity is anchored by the external reference{f' and {several}' if rests else ''}"
        return text + (f", less surely at the {' and '.join(loose)}" if loose else "")
    if not rests:
        return (
            "no standstill anchors the velocity: it leans on the wheels, with all the slip they may have, "
            "and steady slip is assumed, not measured"
        )
    if loose:
        return f"no standstill at the {' and '.join(loose)}: velocity drifts there, as its std shows"
    return f"velocity is anchored at both ends, by {several} and the wheels' coming to rest"


def sentence(grade: Grade, reasons: Sequence[str], remark: str = "") -> str:
    """Return the verdict on an estimate: one sentence that gives the reasons for its grade."""
    text = "; ".join(reasons)
    if grade == "good":
        return f"The estimate can be trusted: {text}, and all measurements agree with their noise{remark}."
    return {"fair": "Usable, within its std: ", "poor": "Look twice: "}[grade] + text + "."
