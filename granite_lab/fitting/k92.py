"""k_92 of one trial, by the steady slip ratio and by the whole trajectory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.bins import AXLES, measured_bins, standstill_mean
from granite_lab.fitting.fit import FitStatus, K92Fit, K92Law
from granite_lab.fitting.history import VELOCITY_CORRELATION
from granite_lab.fitting.sand import SAND_SCATTER, SHARED_STEP, perturbed
from granite_lab.fitting.slip import SandShift, SlipFit, fit_slip, sand_shift, simulate_k92, simulated_slip
from granite_lab.fitting.trajectory import TrajectoryFit, fit_trajectory
from granite_lab.logs.trial import Trial
from granite_lab.model import Run, simulate
from granite_lab.model.command import steady_interval, steady_part
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil, Variant

_SYMBOLS = {"exponent": "n", "shear_modulus": "K", "tyre_friction": "μ_s"}


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
    """Fit the constant k_92 of a trial.

    Args:
        motion: the estimate.
        trial: the log; encoders and currents enter the trajectory fit.
        robot: with chassis and drive.
        soil: the ground.
        effects: effects added to the paper's model.
        trajectory: also fit the whole time history.

    Raises:
        EstimateError: the trial has no steady slip ratio, or the simulation fails.
        InputError: the robot's file lacks chassis or drive.
    """
    variant, interval = motion.variant, slip_interval(motion)

    def slip_of(k92: float) -> float:
        return simulated_slip(simulate(variant, robot, soil, k92=k92, effects=effects), interval)

    measured = motion.slip_ratio
    by_slip = fit_slip(measured.value, slip_of)
    on_sand = _Sand(variant, robot, soil, by_slip.k92, effects)
    shift = sand_shift(by_slip, on_sand.run, lambda run: simulated_slip(run, interval))
    std_measurement = measured.std / abs(by_slip.slope)
    notes = _notes(by_slip, shift, measured, std_measurement)
    history, reason = None, "not asked for"
    if trajectory:
        try:
            history = _trajectory(motion, trial, robot, soil, by_slip, on_sand, effects)
        except EstimateError as error:
            reason = error.message
    if history is None:
        notes.append(f"trajectory not fitted: {reason}")
    else:
        notes += _trajectory_notes(history)
    return K92Fit(
        trial=motion.trial,
        virtual=motion.virtual,
        variant=variant,
        k92=Estimate(by_slip.k92, math.hypot(std_measurement, shift.std)),
        k92_trajectory=history.k92 if history else Estimate(math.nan),
        t_start=history.t_start if history else motion.t_start,
        slip_measured=measured,
        slip_simulated=by_slip.slip,
        status=by_slip.status,
        status_trajectory=history.status if history else "not_evaluated",
        notes=tuple(notes),
        std_measurement=std_measurement,
        std_sand=shift.std,
        law=history.law if history else "exponential",
    )


class _Sand:
    """Simulations of one trial on changed sand, each computed once."""

    def __init__(
        self, variant: Variant, robot: Robot, soil: Soil, k92: float, effects: Sequence[Active]
    ) -> None:
        self._simulate = partial(simulate_k92, variant, robot, k92=k92, effects=effects)
        self._soil = soil
        self._runs: dict[tuple[str, float, K92Law], Run] = {}

    def run(self, parameter: str, relative: float, law: K92Law = "exponential") -> Run:
        key = parameter, relative, law
        if key not in self._runs:
            self._runs[key] = self._simulate(perturbed(self._soil, parameter, relative), law=law)
        return self._runs[key]

    def scattered(self, law: K92Law) -> dict[str, tuple[Run, Run]]:
        return {
            name: (self.run(name, -std, law), self.run(name, std, law)) for name, std in SAND_SCATTER.items()
        }


def _trajectory(
    motion: Motion,
    trial: Trial,
    robot: Robot,
    soil: Soil,
    by_slip: SlipFit,
    on_sand: _Sand,
    effects: Sequence[Active],
) -> TrajectoryFit:
    t_start = motion.t_start.value
    if not math.isfinite(t_start):
        raise EstimateError(f"{motion.trial}: the start of the motion is unknown")
    bins = measured_bins(motion, trial, robot, t_start)
    offsets = _current_offsets(motion, trial, robot)
    return fit_trajectory(
        bins,
        motion.variant,
        robot,
        soil,
        start=(by_slip.k92, t_start),
        sand=on_sand.scattered,
        offsets=offsets,
        clock_std=motion.clock_offset.std if math.isfinite(motion.clock_offset.std) else 0.0,
        effects=effects,
    )


def _current_offsets(motion: Motion, trial: Trial, robot: Robot) -> dict[str, float]:
    """Return the std of the offset that is left in a pair's mean current [A] after the standstill."""
    sensor, left = robot.currents, {}
    for axle, columns in AXLES.items():
        still = [
            standstill_mean(trial.currents.t, trial.currents.current[:, i], motion.t_start.value)[1]
            for i in columns
            if trial.currents is not None
        ]
        each = min((sensor.noise / math.sqrt(n) if n else sensor.offset for n in still), default=0.0)
        left[f"current_{axle}"] = max(each, sensor.step / math.sqrt(12)) / math.sqrt(2)
    return left


def _notes(by_slip: SlipFit, shift: SandShift, measured: Estimate, std_measurement: float) -> list[str]:
    notes = []
    low, high = by_slip.attainable
    if by_slip.status != "ok":
        side = "above" if by_slip.status == "at_lower_bound" else "below"
        beyond = abs(measured.value - by_slip.slip) / measured.std if measured.std > 0 else math.inf
        status: FitStatus = by_slip.status
        notes.append(
            f"k_92 {status.replace('_', ' ')}: λ_R = {measured.value:.2%} is {side} the "
            f"{low:.2%} to {high:.2%} that the model attains ({beyond:.1f} std)"
        )
    if math.isfinite(std_measurement):
        notes.append(f"std of k_92: {std_measurement:.4f} from λ_R, {shift.std:.4f} from the sand's scatter")
    else:
        notes.append("std of k_92 unknown: λ_R has none")
    moved = ", ".join(f"{_SYMBOLS[name]} {Δ:+.3f}" for name, Δ in shift.shared.items())
    notes.append(f"k_92 would shift, alike in all trials, for {SHARED_STEP:.0%} more of: {moved}")
    return notes


def _trajectory_notes(history: TrajectoryFit) -> list[str]:
    misfit = ", ".join(f"{name} {value:.1f}" for name, value in history.misfit.items())
    course = "follows the desired velocity by (5)" if history.law == "exponential" else "is constant"
    seconds = history.correlation.get("velocity", VELOCITY_CORRELATION)
    notes = [
        f"trajectory: fits better when k_92 {course}",
        f"trajectory: residuals over their stated std, rms: {misfit}",
        f"trajectory: velocity errors taken as correlated over {seconds:.1f} s",
    ]
    if history.status != "ok":
        notes.append(f"trajectory fit {history.status.replace('_', ' ')}")
    return notes
