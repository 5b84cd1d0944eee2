"""k_92 of one trial, by the steady slip ratio and by the whole trajectory."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate, Part
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import K92Fit
from granite_lab.fitting.slip import K92_BOUNDS, Curve, SlipFit, fit_slip, raking_parts, simulated_slip
from granite_lab.fitting.trajectory import Trajectories, fit_trajectories
from granite_lab.inference.constants import TOLERANCE
from granite_lab.logs.trial import Trial
from granite_lab.model import simulate
from granite_lab.model.command import peak_velocity, steady_interval, steady_part
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil


def slip_interval(motion: Motion) -> tuple[float, float]:
    """Return the interval of the measured λ_R in the command's time [s after command start].

    The simulated λ_R is taken over the same interval. Where the start is unknown, or the interval
    lies outside the constant part of the command, it is the model's own steady part.
    """
    t1, t2 = (t - motion.t_start.value for t in motion.steady)
    begin, end = steady_interval(motion.variant)
    slack = 0.5
    if math.isfinite(t1) and math.isfinite(t2) and begin - slack <= t1 < t2 <= end + slack:
        return max(t1, begin), min(t2, end)
    return steady_part(motion.variant)


def fit_k92(
    motion: Motion,
    trial: Trial,
    robot: Robot,
    soil: Soil,
    *,
    effects: Sequence[Active] = (),
    trajectory: bool = True,
) -> K92Fit:
    """Fit the k_92 of a trial: a constant by the slip ratio, the value of (5) by the trajectory.

    Args:
        motion: the estimate.
        trial: as estimation corrected it.
        robot: with chassis and drive.
        soil: the ground.
        effects: effects added to the paper's model.
        trajectory: also fit the whole time history.

    Raises:
        EstimateError: the trial has no steady slip ratio, or the simulation fails.
        InputError: the robot's file lacks chassis or drive.
    """
    variant, interval, measured = motion.variant, slip_interval(motion), motion.slip_ratio

    def slip_of(k92: float, on: Soil = soil) -> float:
        return simulated_slip(simulate(variant, robot, on, k92=k92, effects=effects), interval)

    by_slip = fit_slip(measured.value, slip_of)
    sand = raking_parts(by_slip, soil, lambda on: slip_of(by_slip.k92, on))
    std_sand = math.hypot(*(part.contribution for part in sand))
    std_measurement = measured.std / abs(by_slip.slope)
    std = math.hypot(std_measurement, std_sand)
    sources = motion.slip_parts or (Part("λ_R as measured", "B", "normal", "1", measured.std, measured.std),)
    notes = _notes(by_slip, measured, std_measurement, std_sand)
    history, reason = None, "not asked for"
    if trajectory:
        try:
            history = fit_trajectories([trial], [motion], robot, soil, effects=effects)
        except EstimateError as error:
            reason = error.message
    notes += _trajectory_notes(history) if history else [f"trajectory not fitted: {reason}"]
    return K92Fit(
        trial=motion.trial,
        virtual=motion.virtual,
        variant=variant,
        k92=Estimate(by_slip.k92, std),
        k92_trajectory=k92_at(history.own[0], peak_velocity(variant)) if history else Estimate(math.nan),
        t_start=history.t_start[0] if history else motion.t_start,
        slip_measured=measured,
        slip_simulated=by_slip.slip,
        status=by_slip.status,
        status_trajectory=history.status if history else "not_evaluated",
        notes=tuple(notes),
        std_measurement=std_measurement,
        std_sand=std_sand,
        parts=(*(part.times(1 / by_slip.slope) for part in sources), *sand) if math.isfinite(std) else (),
        curve=_with_neighbours(by_slip, std, slip_of),
    )


def _with_neighbours(by_slip: SlipFit, std: float, slip_of: Callable[[float], float]) -> Curve:
    """Return the simulated slip ratio over k_92, with a value each std near the root."""
    known = dict(by_slip.curve)
    low, high = K92_BOUNDS
    for steps in (-4, -2, -1, 1, 2, 4) if math.isfinite(std) else ():
        k = min(max(by_slip.k92 + steps * std, low), high)
        known.setdefault(k, slip_of(k))
    return tuple(sorted(known.items()))


def k92_at(a_theta: Estimate, v: float) -> Estimate:
    """Return k_92 = exp(-a_θ v) by (5)."""
    k = math.exp(-a_theta.value * v)
    return Estimate(k, k * v * a_theta.std)


def _notes(by_slip: SlipFit, measured: Estimate, std_measurement: float, std_sand: float) -> list[str]:
    notes = []
    low, high = by_slip.attainable
    if by_slip.status != "ok":
        side = "above" if by_slip.status == "at_lower_bound" else "below"
        beyond = abs(measured.value - by_slip.slip) / measured.std if measured.std > 0 else math.inf
        notes.append(
            f"k_92 {by_slip.status.replace('_', ' ')}: λ_R = {measured.value:.2%} is {side} the "
            f"{low:.2%} to {high:.2%} that the model attains ({beyond:.1f} std)"
        )
    if math.isfinite(std_measurement):
        notes.append(f"std of k_92: {std_measurement:.4f} from λ_R, {std_sand:.4f} from the sand's scatter")
    else:
        notes.append("std of k_92 unknown: λ_R has none")
    return notes


def _trajectory_notes(history: Trajectories) -> list[str]:
    late = 1e3 * history.latency.value
    side = "behind" if late > 0 else "ahead of"
    off = [f"{name} {share:.0%}" for name, share in history.shares.items() if share > TOLERANCE]
    most = ", ".join(off) or f"less than {TOLERANCE:.0%}"
    notes = [
        f"trajectory: the model is off, over a channel's rms in motion: {most}",
        f"trajectory: IMU {abs(late):.1f} ± {1e3 * history.latency.std:.1f} ms {side} the encoders",
    ]
    if history.louder:
        louder = ", ".join(f"{name} {value:.2f}" for name, value in history.louder.items())
        notes.append(f"trajectory: residuals louder than the noise by a factor of: {louder}")
    if history.status != "ok":
        notes.append(f"trajectory fit {history.status.replace('_', ' ')}")
    return notes
