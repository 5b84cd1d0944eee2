"""k_92 from the steady slip ratio of the robot, the paper's way (section 5, Table 3)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from granite_lab.errors import EstimateError
from granite_lab.estimate import Part
from granite_lab.fitting.fit import FitStatus
from granite_lab.inference.bench import RAKED, SAND
from granite_lab.inference.constants import RAKING
from granite_lab.model import Run, simulate
from granite_lab.model.command import peak_velocity
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil, Variant

K92_BOUNDS = (0.0, 1.0)
"""The model needs k_92 >= 0 (section 5), and k_92 = 1 is the value at rest, below (4)."""

LEAST_K92 = 1e-3
"""Below it the exponential law's exponent runs away: it takes k_92 for this value."""

RAKED_AS = ("k_φ, from raking to raking", "c, from raking to raking")
"""The parameters of the sand that change with the raking besides a_θ, as a budget calls them."""

_TOLERANCE = 1e-5  # of the root; the simulated slip ratio is good to about the same
_STEP = 0.01  # of k_92 in finite differences


Curve = tuple[tuple[float, float], ...]
"""Simulated slip ratio as a function of k_92: (k_92, λ_R), by k_92."""


@dataclass(frozen=True)
class SlipFit:
    """Root of λ_R,simulated(k_92) = λ_R,measured.

    Attributes:
        k92: the root, or the bound beyond which it lies.
        slip: λ_R simulated with `k92`.
        slope: dλ_R/dk_92 there (negative).
        status: "ok", "at_lower_bound" or "at_upper_bound".
        attainable: λ_R at the bounds of k_92, smallest first.
        curve: (k_92, λ_R) of every simulation, by k_92.
    """

    k92: float
    slip: float
    slope: float
    status: FitStatus
    attainable: tuple[float, float]
    curve: Curve = ()


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
    gained = {
        name: float(np.diff(np.interp([t1, t2], run.t, run[name]))[0])
        for name in ("x_m", "enc_f_rad", "enc_r_rad")
    }
    wheels = run.robot.wheels.radius * (gained["enc_f_rad"] + gained["enc_r_rad"]) / 2
    if not wheels > 0:
        raise EstimateError("the wheels do not turn in the steady part", "check variant and drive")
    return 1 - gained["x_m"] / wheels


def fit_slip(measured: float, slip_of: Callable[[float], float]) -> SlipFit:
    """Find the k_92 that yields a measured slip ratio.

    λ_R falls with k_92 without turning back: a longer rear arc carries load behind the wheel's
    centre, where the normal stress pushes forward.

    Args:
        measured: λ_R as a fraction.
        slip_of: simulated λ_R as a function of k_92.

    Raises:
        EstimateError: `measured` is not a number.
    """
    if not math.isfinite(measured):
        raise EstimateError("no k_92 without a measured slip ratio", "the trial needs a steady part")
    memory: dict[float, float] = {}

    def λ(k: float) -> float:
        if k not in memory:
            memory[k] = slip_of(k)
        return memory[k]

    low, high = K92_BOUNDS
    attainable = (λ(high), λ(low))
    status: FitStatus = "ok"
    if measured >= attainable[1]:
        k, status = low, "at_lower_bound"
    elif measured <= attainable[0]:
        k, status = high, "at_upper_bound"
    else:
        k = float(brentq(lambda k: λ(k) - measured, low, high, xtol=_TOLERANCE))
    left, right = max(low, k - _STEP), min(high, k + _STEP)
    slope = (λ(right) - λ(left)) / (right - left)
    return SlipFit(k, λ(k), slope, status, attainable, tuple(sorted(memory.items())))


def fit_k92_to_slip(
    slip: float, variant: Variant, robot: Robot, soil: Soil, *, effects: Sequence[Active] = ()
) -> float:
    """Return the constant k_92 with which the model slips as measured.

    Args:
        slip: λ_R over the steady part, as a fraction.
        variant: the commanded trapezoid.
        robot: with chassis and drive.
        soil: the ground.
        effects: effects added to the paper's model.

    Raises:
        EstimateError: no k_92 within its bounds yields this slip ratio.
    """
    fit = fit_slip(slip, lambda k: simulated_slip(simulate(variant, robot, soil, k92=k, effects=effects)))
    if fit.status != "ok":
        low, high = fit.attainable
        raise EstimateError(
            f"no k_92 from {K92_BOUNDS[0]:g} to {K92_BOUNDS[1]:g} gives a slip ratio of {slip:.2%}",
            f"the model reaches {low:.2%} to {high:.2%} with this robot and soil",
        )
    return fit.k92


def raking_parts(fit: SlipFit, soil: Soil, slip_on: Callable[[Soil], float]) -> tuple[Part, ...]:
    """Return the parts of the std of k_92 that the scatter of k_φ and c from raking to raking causes.

    dk_92 = -dλ_R / slope. The mean square of the steps to either side is taken, because (10) has a kink.

    Args:
        fit: the root.
        soil: of the fit.
        slip_on: λ_R with the fitted k_92 on another soil.
    """

    def shift(name: str, step: float) -> float:
        other = dataclasses.replace(soil, **{name: getattr(soil, name) * math.exp(step)})
        return (slip_on(other) - fit.slip) / fit.slope

    def size(name: str, std: float) -> float:
        return math.sqrt((shift(name, std) ** 2 + shift(name, -std) ** 2) / 2)

    raked = zip(SAND[1:RAKED], RAKED_AS, RAKING[1:], strict=True)
    return tuple(Part(shown, "B", "log-normal", "1", std, size(name, std)) for name, shown, std in raked)
