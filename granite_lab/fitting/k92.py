r"""k_92 of one trial: by the steady slip ratio (section 5, Table 3), and by the whole trajectory.

The trajectory of all sensors is fitted, in bins, by the same inference as in the search for a missing effect,

.. math:: k_{92}(t) = e^{-a v_d(t)}

where a has a flat prior. Sand, sensors, latency and the discrepancy of the model are nuisances with the usual
priors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate, Part
from granite_lab.estimation.motion import Motion
from granite_lab.estimation.plausibility import BY_RADIUS
from granite_lab.fitting.fit import K92_BOUNDS, LEAST, FitStatus, K92Fit, Shift
from granite_lab.inference.constants import SAND_PER_TRIAL_STD, SAND_STD, TOLERANCE
from granite_lab.inference.fit import Fit
from granite_lab.inference.normal import Scales
from granite_lab.inference.point import SHARED
from granite_lab.inference.pool import SAND, SAND_PER_TRIAL, Scenario, SimulationPool
from granite_lab.inference.priors import radius_std, sand_std
from granite_lab.inference.problem import Problem
from granite_lab.inference.setup import baseline, trial_models
from granite_lab.logs.trial import Trial
from granite_lab.model import Run, simulate
from granite_lab.model.command import duration, reference_velocity, steady_interval, steady_part
from granite_lab.model.effect import Active
from granite_lab.model.instants import COAST
from granite_lab.model.leading import LEADS, count_of
from granite_lab.model.simulator import ways
from granite_lab.parameters import Course, Robot, Soil, Variant, load_paper
from granite_lab.processes import one_thread

RAKED_AS = ("k_φ, from raking to raking", "c, from raking to raking")
"""The parameters of the sand that change with the raking besides a_θ, as a budget calls them."""

SHARED_AS = {
    "frictional_modulus": "k_φ, of the soil",
    "cohesion": "c, of the soil",
    "shear_modulus": "K, of the soil",
    "friction_angle": "φ, of the soil",
    "exponent": "n, of the soil",
    "tyre_friction": "μ_s, of tyre and soil",
    "radius": "wheel radius",
}
"""Numbers that all trials share, as a budget calls them."""

WIDE = 1.0
"""Std of the prior of log a_θ: flat beside the few percent to which one trial determines it."""

COARSE = 0.05
"""Least width of a bin [s]: a seventh of the time in which slip settles."""

_TOLERANCE = 1e-5  # of the root; the simulated slip ratio is good to about the same
_STEP = 0.01  # of k_92 in finite differences
_SLACK = 0.5  # of the measured interval about the constant part of the command [s]


def simulate_k92(
    variant: Variant, robot: Robot, soil: Soil, k92: float, *, effects: Sequence[Active] = ()
) -> Run:
    """Simulate a run in which k_92 follows (5) to a given value at the steady desired velocity.

    Raises:
        InputError: the robot's file lacks chassis or drive.
        EstimateError: the simulation does not converge.
    """
    a_theta = -math.log(min(max(k92, LEAST), 1.0)) / reference_velocity(variant)
    return simulate(variant, robot, soil, a_theta=a_theta, effects=effects)


def simulated_slip(run: Run, interval: tuple[float, float] | None = None) -> float:
    """Return λ_R by (2) of a run: 1 - distance of the body / distance of the wheels by the virtual encoders.

    Args:
        run: a simulated run.
        interval: start and end [s after command start]; by default the run's steady part.

    Raises:
        EstimateError: the wheels do not turn.
    """
    body, wheels = ways(run.signals, interval or run.steady, run.robot.wheels.radius, "enc")
    if not wheels > 0:
        raise EstimateError("the wheels do not turn in the steady part", "check variant and drive")
    return 1 - body / wheels


def slip_interval(motion: Motion) -> tuple[float, float]:
    """Return the interval over which λ_R was measured, and is simulated [s after command start].

    It is the model's own steady part where the start is unknown or the command is not constant meanwhile,
    unless it is that of a whole drive.
    """
    if isinstance(motion.variant, Course):
        return motion.variant.stretch
    t1, t2 = (t - motion.t_start.value for t in motion.steady)
    begin, end = steady_interval(motion.variant)
    if begin - _SLACK <= t1 < t2 <= end + _SLACK:
        return max(t1, begin), min(t2, end)
    if -_SLACK <= t1 < begin and end < t2 <= duration(motion.variant) + COAST:
        return t1, t2
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
        motion, trial: the estimate, and the trial as it was corrected.
        robot, soil: the robot with chassis and drive, and the ground.
        effects: added to the paper's model.
        trajectory: also fit the whole time history; where that is impossible, a note states the reason.

    Raises:
        EstimateError: the trial has no steady slip ratio, or the simulation fails.
        InputError: the robot's file lacks chassis or drive.
    """
    by_slip, reason = _by_slip(motion, robot, soil, effects), "not asked for"
    if trajectory:
        try:
            return _with_trajectory(by_slip, trial, motion, robot, soil, effects)
        except EstimateError as error:
            reason = error.message
    return replace(by_slip, notes=(*by_slip.notes, f"trajectory not fitted: {reason}"))


def _by_slip(motion: Motion, robot: Robot, soil: Soil, effects: Sequence[Active]) -> K92Fit:
    """Fit k_92 to the steady slip ratio alone."""
    variant, (measured, sources) = motion.variant, _of_trial(motion)

    def slip_of(k92: float, of: Robot = robot, on: Soil = soil) -> float:
        return _slip_of(motion, of, on, effects, k92)

    curve = SlipCurve(slip_of)
    k92, status = curve.root(measured.value)
    slope, sand = curve.slope(k92), []
    if not slope < 0:
        raise EstimateError(
            f"the slip ratio does not depend on k_92 over the stretch of {motion.trial} that is simulated",
            "look at the trial's wheel speeds and at the start of its command",
        )

    def shift(name: str, std: float) -> Shift:
        """Return how far an error of a number of the soil, or of the wheel radius, moves k_92."""
        ends = []
        for factor in (math.exp(std), math.exp(-std)):
            # λ_R is measured with the radius of the robot's file, too
            measured_more = (1 - measured.value) * (1 - 1 / factor) if name == "radius" else 0.0
            simulated_more = slip_of(k92, *_scaled(robot, soil, name, factor)) - curve[k92]
            ends.append((measured_more - simulated_more) / slope)
        return Shift(SHARED_AS[name], std, *ends)

    for name, shown, step in zip(SAND[1:SAND_PER_TRIAL], RAKED_AS, SAND_PER_TRIAL_STD[1:], strict=True):
        # the mean square of the steps to either side, because (10) has a kink
        raked = shift(name, step)
        whole = math.sqrt((raked.up**2 + raked.down**2) / 2)
        sand.append(Part(shown, "B", "log-normal", "1", step, whole))
    std_sand, std_measurement = math.hypot(*(part.contribution for part in sand)), measured.std / abs(slope)
    std = math.hypot(std_measurement, std_sand)
    known, notes = math.isfinite(std), [] if status == "ok" else [_beyond_reach(status, measured, curve)]
    notes.append(
        f"Std of k_92: {std_measurement:.4f} from λ_R, {std_sand:.4f} from the scatter of the sand."
        if known
        else "The std of k_92 is unknown: λ_R has none."
    )
    stds = dict(zip(SAND[1:], sand_std(soil)[1:], strict=True)) | {"radius": radius_std(robot)}
    # the likelihood of k_92 needs the curve near the root
    near = np.clip([k92 + n * std for n in (-4, -2, -1, 1, 2, 4)] if known else [], *K92_BOUNDS)
    return K92Fit(
        trial=motion.trial,
        virtual=motion.virtual,
        variant=variant,
        k92=Estimate(k92, std),
        k92_trajectory=Estimate(math.nan),
        t_start=motion.t_start,
        slip_measured=measured,
        slip_simulated=curve[k92],
        status=status,
        status_trajectory="not_evaluated",
        notes=tuple(notes),
        std_measurement=std_measurement,
        parts=(*(part.times(1 / slope) for part in sources), *sand) if known else (),
        curve=tuple(sorted({k: curve[k] for k in (*curve, *near.tolist())}.items())),
        shared=tuple(shift(name, std) for name, std in stds.items()),
    )


def _of_trial(motion: Motion) -> tuple[Estimate, tuple[Part, ...]]:
    """Return λ_R with what its std is made of, less the part of the wheel radius, which all trials share."""
    measured, parts = motion.slip_ratio, motion.slip_parts
    common = sum(part.contribution**2 for part in parts if part.name == BY_RADIUS)
    less = replace(measured, std=math.sqrt(max(measured.std**2 - common, 0.0))) if common else measured
    whole = Part("λ_R as measured", "B", "normal", "1", less.std, less.std)
    return less, tuple(part for part in parts if part.name != BY_RADIUS) or (whole,)


def _scaled(robot: Robot, soil: Soil, name: str, factor: float) -> tuple[Robot, Soil]:
    """Return robot and soil, of which one number of the soil, or the wheel radius, is multiplied."""
    if name == "radius":
        wheels = replace(robot.wheels, radius=factor * robot.wheels.radius)
        return replace(robot, wheels=wheels), soil
    return robot, replace(soil, **{name: factor * getattr(soil, name)})


def _beyond_reach(status: FitStatus, measured: Estimate, curve: SlipCurve) -> str:
    """Return the note on a λ_R that the model does not attain."""
    high, low = (curve[bound] for bound in K92_BOUNDS)
    side, end = ("above", high) if status == "at_lower_bound" else ("below", low)
    beyond = abs(measured.value - end) / measured.std if measured.std > 0 else math.inf
    return (
        f"k_92 {status.replace('_', ' ')}: λ_R = {measured.value:.2%} is {side} the {low:.2%} to {high:.2%} "
        f"that the model attains ({beyond:.1f} std)."
    )


def _slip_of(motion: Motion, robot: Robot, soil: Soil, effects: Sequence[Active], k92: float) -> float:
    """Return the simulated λ_R of a trial, over the interval of the measured one."""
    variant, interval = motion.variant, slip_interval(motion)
    if isinstance(variant, Course) or interval[0] < steady_interval(variant)[0]:
        run = simulate_k92(variant, robot, soil, k92, effects=effects)  # it changes with v_d meanwhile
    else:
        run = simulate(variant, robot, soil, k92=k92, effects=effects)
    return simulated_slip(run, interval)


def _with_trajectory(
    by_slip: K92Fit, trial: Trial, motion: Motion, robot: Robot, soil: Soil, effects: Sequence[Active]
) -> K92Fit:
    """Add the fit to the whole time history.

    Raises:
        EstimateError: the trial's sensors or start do not allow it, or the simulation fails.
    """
    if not np.isfinite(motion.t_start.value):
        raise EstimateError(f"{motion.trial}: the start of the motion is unknown")
    models, variants = trial_models([trial], robot, [motion], least=COARSE)
    with one_thread(), SimulationPool(Scenario(robot, soil, variants, {}, tuple(effects))) as pool:
        problem = Problem(models, pool, (WIDE, *SAND_STD[1:]))
        fit = baseline(problem)
    x = fit.point.vector + fit.posterior.step
    common = fit.point.trials[0].size
    late = common + SHARED.index("latency")

    def total(*places: int) -> Estimate:
        """Return the sum of some numbers, its std with the step to an optimum that was not reached."""
        g = np.zeros(x.size)
        g[list(places)] = 1.0
        return Estimate(
            float(g @ x), float(np.hypot(np.sqrt(g @ fit.posterior.covariance @ g), g @ fit.further))
        )

    log, start, latency = total(0, common), total(SAND_PER_TRIAL, late), total(late)
    v, a_theta = reference_velocity(by_slip.variant), load_paper().a_theta * float(np.exp(log.value))
    k92 = math.exp(-a_theta * v)  # (5)
    status = _status(fit)
    std = k92 * v * a_theta * log.std if status == "ok" else math.nan
    lead = None
    if count := count_of(motion.variant):
        lead = total(*(common + SHARED.index(name) for name in LEADS[:count]))
    notes = _trajectory_notes(fit.scales, problem.counts, latency, lead)
    return replace(
        by_slip,
        k92_trajectory=Estimate(k92, std),
        t_start=Estimate(problem.trials[0].observation.t_start + start.value, start.std),
        latency=latency,
        status_trajectory=status,
        notes=(*by_slip.notes, *(f"Trajectory: {note}" for note in notes)),
    )


def _status(fit: Fit) -> FitStatus:
    """Tell whether a fit may state a std: the model is off by no more than formulas are, and it converged."""
    if fit.scales.is_misfit:
        return "model_misfit"
    return "ok" if fit.converged else "not_converged"


def _trajectory_notes(
    scales: Scales, channels: Iterable[str], latency: Estimate, lead: Estimate | None
) -> Iterator[str]:
    """Yield what a fit to the trajectory leaves: discrepancy, latency [s], noise, lead of the command [s]."""
    discrepancies = {c: scales.discrepancy_of(c) for c in channels}
    off = [f"{c} {100 * share:.0f} %" for c, share in discrepancies.items() if share > TOLERANCE]
    most = ", ".join(off or [f"less than {100 * TOLERANCE:.0f} %"])
    yield f"discrepancy of the model, as a share of a channel's rms in motion: {most}."
    side = "behind" if latency.value > 0 else "ahead of"
    yield f"IMU {abs(1e3 * latency.value):.1f} ± {1e3 * latency.std:.1f} ms {side} the encoders."
    larger = [f"{c} {value:.2f}" for c, value in scales.noise_factor.items() if value > 1.0]
    if larger:
        yield f"residuals over the noise: {', '.join(larger)}."
    if lead is not None:
        yield f"the command leads the wheels by {1e3 * lead.value:.0f} ± {1e3 * lead.std:.0f} ms."
