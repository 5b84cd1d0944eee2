"""k_92 of one trial: by the steady slip ratio (section 5, Table 3), and by the whole trajectory."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import brentq

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate, Part
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import K92_BOUNDS, FitStatus, K92Fit
from granite_lab.fitting.trajectory import fit_trajectory
from granite_lab.inference.bench import RAKED, SAND
from granite_lab.inference.constants import RAKING
from granite_lab.logs.trial import Trial
from granite_lab.model import Run, simulate
from granite_lab.model.command import peak_velocity, steady_interval, steady_part
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil, Variant

LEAST_K92 = 1e-3
"""Below it the exponential law's exponent runs away: it takes k_92 for this value."""

RAKED_AS = ("k_φ, from raking to raking", "c, from raking to raking")
"""The parameters of the sand that change with the raking besides a_θ, as a budget calls them."""

_TOLERANCE = 1e-5  # of the root; the simulated slip ratio is good to about the same
_STEP = 0.01  # of k_92 in finite differences


def simulate_k92(
    variant: Variant, robot: Robot, soil: Soil, k92: float, *, effects: Sequence[Active] = ()
) -> Run:
    """Simulate a run in which k_92 follows (5) to a given value at the steady desired velocity.

    Raises:
        InputError: the robot's file lacks chassis or drive.
        EstimateError: the simulation does not converge.
    """
    a_theta = -math.log(min(max(k92, LEAST_K92), 1.0)) / peak_velocity(variant)
    return simulate(variant, robot, soil, a_theta=a_theta, effects=effects)


def simulated_slip(run: Run, interval: tuple[float, float] | None = None) -> float:
    """Return λ_R by (2) of a run: 1 - distance of the body / distance the wheels turned through.

    The wheels' distance is taken from the virtual encoders, as the measured one is from the real.

    Args:
        run: a simulated run.
        interval: start and end [s after command start]; by default the run's steady part.
    """
    t1, t2 = interval or run.steady
    x, front, rear = (
        float(np.diff(np.interp([t1, t2], run.t, run[name]))[0]) for name in ("x_m", "enc_f_rad", "enc_r_rad")
    )
    wheels = run.robot.wheels.radius * (front + rear) / 2
    if not wheels > 0:
        raise EstimateError("the wheels do not turn in the steady part", "check variant and drive")
    return 1 - x / wheels


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


class SlipCurve(dict[float, float]):
    """Simulated λ_R by k_92; what is not known yet is simulated.

    λ_R falls with k_92 without turning back: a longer rear arc carries load behind the wheel's
    centre, where the normal stress pushes forward.
    """

    def __init__(self, slip_of: Callable[[float], float]) -> None:
        super().__init__()
        self._slip_of = slip_of

    def __missing__(self, k92: float) -> float:
        self[k92] = self._slip_of(k92)
        return self[k92]

    def root(self, measured: float) -> tuple[float, FitStatus]:
        """Return the k_92 that yields a measured λ_R, or the bound beyond which it lies.

        Raises:
            EstimateError: `measured` is not a number.
        """
        if not math.isfinite(measured):
            raise EstimateError(
                "no slip ratio, so k_92 cannot be fitted",
                "the trial needs a part at constant speed; see granite-lab check",
            )
        low, high = K92_BOUNDS
        if measured >= self[low]:
            return low, "at_lower_bound"
        if measured <= self[high]:
            return high, "at_upper_bound"
        return float(brentq(lambda k: self[k] - measured, low, high, xtol=_TOLERANCE)), "ok"

    def slope(self, k92: float) -> float:
        """Return dλ_R/dk_92, which is negative."""
        left, right = max(K92_BOUNDS[0], k92 - _STEP), min(K92_BOUNDS[1], k92 + _STEP)
        return (self[right] - self[left]) / (right - left)


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

    curve = SlipCurve(slip_of)
    k92, status = curve.root(measured.value)
    slope = curve.slope(k92)

    def sand_part(name: str, shown: str, std: float) -> Part:
        """Return what the scatter of a parameter of the sand from raking to raking adds to the std.

        The mean square of the steps to either side is taken, because (10) has a kink.
        """
        grounds = (
            dataclasses.replace(soil, **{name: getattr(soil, name) * math.exp(s)}) for s in (std, -std)
        )
        shifts = [(slip_of(k92, ground) - curve[k92]) / slope for ground in grounds]
        return Part(shown, "B", "log-normal", "1", std, math.sqrt(sum(s**2 for s in shifts) / 2))

    sand = [sand_part(*of) for of in zip(SAND[1:RAKED], RAKED_AS, RAKING[1:], strict=True)]
    std_sand = math.hypot(*(part.contribution for part in sand))
    std_measurement = measured.std / abs(slope)
    std = math.hypot(std_measurement, std_sand)
    sources = motion.slip_parts or (Part("λ_R as measured", "B", "normal", "1", measured.std, measured.std),)
    notes = []
    if status != "ok":
        low, high = curve[K92_BOUNDS[1]], curve[K92_BOUNDS[0]]
        side = "above" if status == "at_lower_bound" else "below"
        beyond = abs(measured.value - curve[k92]) / measured.std if measured.std > 0 else math.inf
        notes.append(
            f"k_92 {status.replace('_', ' ')}: λ_R = {measured.value:.2%} is {side} the "
            f"{low:.2%} to {high:.2%} that the model attains ({beyond:.1f} std)."
        )
    if math.isfinite(std_measurement):
        notes.append(
            f"Std of k_92: {std_measurement:.4f} from λ_R, {std_sand:.4f} from the scatter of the sand."
        )
    else:
        notes.append("The std of k_92 is unknown: λ_R has none.")
    # the likelihood of k_92 needs the curve near the root
    near = [k92 + n * std for n in (-4, -2, -1, 1, 2, 4)] if math.isfinite(std) else []
    for_likelihood = (*curve, *(min(max(k, K92_BOUNDS[0]), K92_BOUNDS[1]) for k in near))
    history, reason = None, "not asked for"
    if trajectory:
        try:
            history = fit_trajectory(trial, motion, robot, soil, effects=effects)
        except EstimateError as error:
            reason = error.message
    return K92Fit(
        trial=motion.trial,
        virtual=motion.virtual,
        variant=variant,
        k92=Estimate(k92, std),
        k92_trajectory=_k92_at(history.a_theta, variant) if history else Estimate(math.nan),
        t_start=history.t_start if history else motion.t_start,
        slip_measured=measured,
        slip_simulated=curve[k92],
        status=status,
        status_trajectory=history.status if history else "not_evaluated",
        notes=(*notes, *(history.notes if history else (f"trajectory not fitted: {reason}",))),
        std_measurement=std_measurement,
        parts=(*(part.times(1 / slope) for part in sources), *sand) if math.isfinite(std) else (),
        curve=tuple(sorted({k: curve[k] for k in for_likelihood}.items())),
    )


def _k92_at(a_theta: Estimate, variant: Variant) -> Estimate:
    """Return k_92 by (5) at the steady desired velocity."""
    v = peak_velocity(variant)
    k = math.exp(-a_theta.value * v)
    return Estimate(k, k * v * a_theta.std)
