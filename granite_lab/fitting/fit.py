"""Records of fitted numbers: k_92 of a trial, a_θ over trials, rival laws, and the budgets of their stds.

A budget is made in the manner of GUM. Every trial brings the components of its own std (`Motion.slip_parts`,
`K92Fit.parts`). They are independent between trials, so that the variance of a weighted sum is the sum of the
weighted variances (JCGM 100:2008, 5.1.2); what scatters between trials beyond them is a component of type A.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from granite_lab.columns import Cell, Column, Table, number
from granite_lab.estimate import Estimate, Part
from granite_lab.estimation.motion import TELLING
from granite_lab.origin import NOWHERE, Origin
from granite_lab.parameters import Variant
from granite_lab.rounding import plus_minus
from granite_lab.shown import Shown, frame, picked

if TYPE_CHECKING:
    import pandas as pd

PointRow = tuple[str, float, Estimate, Estimate]
"""(trial, velocity [m/s], k_92, λ_R); the velocity is the desired one of the steady part."""


@dataclass(frozen=True)
class Shift:
    """How far an error of a number that all trials share moves k_92.

    Attributes:
        name: of the number, as a reader calls it.
        std: of the logarithm of the number.
        up, down: change of k_92 where the number is one std larger, or smaller.
    """

    name: str
    std: float
    up: float
    down: float


K92_BOUNDS = (0.0, 1.0)
"""The model needs k_92 >= 0 (section 5), and k_92 = 1 is the value at rest, below (4)."""

FitStatus = Literal[
    "ok", "at_lower_bound", "at_upper_bound", "model_misfit", "not_converged", "not_evaluated"
]

BOUNDS: tuple[FitStatus, ...] = ("at_lower_bound", "at_upper_bound")

LEAST = 1e-3
"""(5) never reaches k_92 = 0; smaller values than this one are taken for it."""

ANYTHING = 12**-0.5
"""Std of a k_92 that is anywhere from 0 to 1."""

STATUS_NAMES: Mapping[FitStatus, str] = {
    "ok": "fitted",
    "at_lower_bound": "at lower limit",
    "at_upper_bound": "at upper limit",
    "model_misfit": "model misfit",
    "not_converged": "not converged",
    "not_evaluated": "not evaluated",
}
"""Status of a fit as a reader calls it."""

SCATTER, COMBINED = "scatter between trials beyond these", "combined standard uncertainty"

APART = 3.0
"""Difference of the two k_92 of a trial, in standard deviations, above which it is more than chance."""

TRIALS = "trials"
"""The std of a_θ by the files, as a component of a larger one."""

SMALL = 0.002
"""Components with a smaller share of the variance are listed as one."""

LEFT_OUT: Mapping[str, str] = {
    "k92": "Not part of the stated std: errors that all trials share, of the wheel radius and of the files "
    "of robot and soil; and effects that the model lacks.",
    "a_theta": "Not part of the stated std: errors that all trials share, and effects that the model lacks.",
    "a_theta_uncertain": "Not part of it: masses and drive of the robot's file, and effects that the model "
    "lacks.",
    "slip": "Not part of the stated std: an error of the wheel radius in the robot's file, which all trials "
    "share. 1 % of the radius moves λ_R by nearly 1 point.",
}
"""What the stated std does not hold and a budget does not add."""


@dataclass(frozen=True)
class K92Fit(Shown):
    """The ratio k_92 of one trial, fitted twice.

    Attributes:
        virtual: the log was written by a simulator.
        variant: the trapezoid that was simulated.
        k92: by the steady slip ratio, as in the paper; an inner optimum where `status` is "ok".
        k92_trajectory: by the whole time history of all sensors and the law (5), at the steady desired
            velocity; its status is `status_trajectory`. It has no std where the fit did not converge, or the
            model does not fit the sensors: what it lacks moves k_92.
        t_start: start of the command by the trajectory fit [s, the log's time, as the IMU stamps it].
        slip_measured, slip_simulated: λ_R as measured, and as simulated with `k92`.
        std_measurement: the part of the std of `k92` that comes from the measured slip ratio.
        parts: what the std of `k92` is made of; empty where it has none.
        curve: (k_92, λ_R) of the simulations, by k_92: the likelihood of `k92` goes by it.
        latency: by how much the stamps of the IMU come after those of the wheels [s].
        shared: what the numbers of soil and wheels do to `k92`; no part of its std.
    """

    trial: str
    virtual: bool
    variant: Variant
    k92: Estimate
    k92_trajectory: Estimate
    t_start: Estimate
    slip_measured: Estimate
    slip_simulated: float
    status: FitStatus
    status_trajectory: FitStatus
    notes: tuple[str, ...] = ()
    std_measurement: float = math.nan
    parts: tuple[Part, ...] = ()
    curve: tuple[tuple[float, float], ...] = ()
    latency: Estimate = Estimate(math.nan)  # noqa: RUF009, frozen
    shared: tuple[Shift, ...] = ()

    @property
    def apart(self) -> float:
        """Difference of the two k_92 over the std of both together; NaN where either has none."""
        if self.status != "ok" or self.status_trajectory != "ok":
            return math.nan
        std = math.hypot(self.k92.std, self.k92_trajectory.std)
        return abs(self.k92.value - self.k92_trajectory.value) / std if std > 0 else math.nan

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader of the numbers should know, one line each."""
        lines = []
        if self.status_trajectory == "not_converged":
            lines.append("the fit of k_92 to the trajectory did not converge; its std is not known")
        if self.status_trajectory == "model_misfit":
            lines.append(
                "the model does not fit the sensors over the trajectory; the error of k_92 by it is not known"
            )
        if self.apart > APART:
            lines.append(
                f"k_92 by the steady slip and by the trajectory are more than {APART:g} std apart: the model "
                "does not explain both"
            )
        return tuple(lines)

    @property
    def slip_known(self) -> bool:
        """Whether λ_R is known well enough to tell k_92."""
        return self.slip_measured.std <= TELLING

    @property
    def k92_known(self) -> bool:
        """Whether `k92` may be used: its optimum lies inside the bounds and λ_R is known."""
        return self.status == "ok" and self.slip_known

    @property
    def reach(self) -> tuple[float, float]:
        """The least and the largest λ_R that the model attains, at both bounds of k_92; NaN if not known."""
        slips = dict(self.curve)
        low, high = K92_BOUNDS
        return slips.get(high, math.nan), slips.get(low, math.nan)

    def __repr__(self) -> str:
        pairs = ((self.k92, self.status), (self.k92_trajectory, self.status_trajectory))
        slip, trajectory = (f"{plus_minus(value)} ({STATUS_NAMES[status]})" for value, status in pairs)
        name = f"'{self.trial}'{', virtual' if self.virtual else ''}"
        return f"K92Fit({name}: {self.variant.velocity:g} m/s, k_92 {slip}, by the trajectory {trajectory})"

    def to_frame(self) -> pd.DataFrame:
        """Return the fit as one row, units in the column names."""
        row = {"trial": self.trial, "virtual": self.virtual, "variant_mps": self.variant.velocity}
        estimates = {"k92": self.k92, "k92_trajectory": self.k92_trajectory, "slip_ratio": self.slip_measured}
        if self.status in BOUNDS:
            estimates["k92"] = Estimate(math.nan)
        for name, estimate in estimates.items():
            row |= {name: estimate.value, f"{name}_std": estimate.std}
        row |= {"slip_ratio_simulated": self.slip_simulated}
        return frame([row | picked(self, "status", "status_trajectory")])


def _cell(value: Estimate, status: FitStatus, determined: bool = True) -> Cell:
    """Return k_92 as a cell, or the reason why there is no number: a bound, or an unknown value."""
    if status in BOUNDS:
        return Cell(STATUS_NAMES[status], (math.nan, math.nan, STATUS_NAMES[status]), "fair")
    text, raw = plus_minus(value), (value.value, value.std, STATUS_NAMES[status])
    if not determined:
        return Cell("not known", (*raw[:2], "not known"), "fair")
    return Cell(text, raw) if status == "ok" else Cell(f"{text} ({STATUS_NAMES[status]})", raw, "fair")


def _by_trajectory(f: K92Fit) -> Cell:
    """Return k_92 by the trajectory; below `LEAST` the exponent of (5) runs away."""
    k92, status = f.k92_trajectory, f.status_trajectory
    at_limit = status == "ok" and k92.value < LEAST
    return _cell(k92, "at_lower_bound" if at_limit else status, not k92.std > ANYTHING)


K92_STEADY = Column[K92Fit](
    "k_92, steady slip", lambda f: _cell(f.k92, f.status, f.slip_known), "k92 k92_std k92_status", unit="–"
)
K92_TRAJECTORY = Column[K92Fit](
    "k_92, trajectory", _by_trajectory, "k92_trajectory k92_trajectory_std k92_trajectory_status", unit="–"
)


def _apart(fit: K92Fit) -> Cell:
    return replace(number(fit.apart, 2), tone="fair" if fit.apart > APART else "")


K92_APART = Column[K92Fit]("apart", _apart, "k92_apart", unit="σ")
K92_FITS = Table[K92Fit](
    "k92",
    "k_92 of each trial",
    Column("trial", lambda f: f.trial),
    Column("speed", lambda f: f.variant.velocity, "speed_mps", unit="m/s", form=".3g"),
    Column("λ_R", lambda f: f.slip_measured, "slip_ratio slip_ratio_std", unit="%", scale=100),
    K92_STEADY,
    K92_TRAJECTORY,
    K92_APART,
    note=f"Value ± standard deviation. Apart: difference of the two k_92 over its std; above {APART:g} the "
    "model does not explain both.",
)

LAW_NAMES = {
    "exponential": "k_92 = exp(−a_θ v)",
    "linear_slip": "k_92 = b_0 + b_1 λ_R",
    "free": "k_92 constant at each speed",
}
"""Laws for k_92 by their id, as a reader calls them."""


@dataclass(frozen=True)
class Law:
    """One rival law for k_92.

    Attributes:
        id: "exponential" (27), "linear_slip" (28) or "free" (a constant per speed).
        parameters, units: name to value with std, and to unit.
        n_parameters: fitted numbers, the scatter not counted.
        rms: root mean square residual of k_92.
        aicc: corrected Akaike information criterion, NaN where the points are too few for the law.
        weight: Akaike weight among the laws that have an `aicc`; NaN for the others, and where it is one.
    """

    id: str
    formula: str
    parameters: dict[str, Estimate]
    units: dict[str, str]
    n_parameters: int
    rms: float
    aicc: float
    weight: float


@dataclass(frozen=True)
class AThetaFit(Shown):
    """The exponent a_θ of (27) over trials.

    Attributes:
        a_theta: weighted estimate with its std [s/m]; trial-to-trial scatter included.
        ci95: 95 % interval [s/m], by Student's t, or by the likelihood where that differs by a tenth.
        log_linear: the paper's way: least squares on log k_92 through (0, 1).
        ordinary: least squares on k_92 itself.
        scatter: trial-to-trial std of log k_92 beyond the stated uncertainties [-].
        published: the paper's value [s/m], which lies in `ci95` if it `agrees`.
        points: what went in.
        laws: the rivals, best first.
        parts: what the std of `a_theta` is made of besides the std of the points.
        sensitivity: da_θ/dk_92 of each point [s/m]; 0 for those that were left out. The squares of
            sensitivity times std of the points and of `parts` add up to the variance of `a_theta`.
        virtual: some of the logs were written by a simulator.
        origin: where the fit comes from.
        total, total_ci95: `a_theta` with the std and the 95 % interval that hold the uncertainty of soil and
            wheel radius, too [s/m]; NaN where their influence on the trials is not known.
        shared: what the std of `total` is made of besides that of `a_theta`.
    """

    a_theta: Estimate
    ci95: tuple[float, float]
    log_linear: float
    ordinary: float
    scatter: float
    published: float
    agrees: bool
    points: tuple[PointRow, ...]
    laws: tuple[Law, ...]
    notes: tuple[str, ...] = ()
    parts: tuple[Part, ...] = ()
    sensitivity: tuple[float, ...] = ()
    virtual: bool = False
    origin: Origin = NOWHERE
    total: Estimate = Estimate(math.nan)  # noqa: RUF009, frozen
    total_ci95: tuple[float, float] = (math.nan, math.nan)
    shared: tuple[Part, ...] = ()

    def __repr__(self) -> str:
        return (
            f"AThetaFit({self.a_theta.value:.4f} ± {self.a_theta.std:.4f} s/m, 95 % {self.ci95[0]:.4f} to "
            f"{self.ci95[1]:.4f} s/m, published {self.published:g} s/m, {len(self.points)} points)"
        )

    def to_frame(self) -> pd.DataFrame:
        """Return the points that went in, one row a trial, units in the column names."""
        columns = ("trial", "variant_mps", "k92", "k92_std", "slip_ratio", "slip_ratio_std")
        rows = [(name, v, k92.value, k92.std, slip.value, slip.std) for name, v, k92, slip in self.points]
        return frame([dict(zip(columns, row, strict=True)) for row in rows])


ViewName = Literal["files", "uncertain", "found"]

VIEWS: Mapping[ViewName, str] = {
    "files": "files of soil and robot as they are",
    "uncertain": "with the uncertainty of soil and wheel radius",
    "found": "soil fitted to all sensors, with what was found",
}
"""What a_θ is stated by, as a reader calls it."""


@dataclass(frozen=True)
class View:
    """a_θ by one of the `VIEWS`.

    Attributes:
        a_theta, ci95: value with std, and 95 % interval [s/m].
        parts: what the std is made of, where that is known.
    """

    by: ViewName
    a_theta: Estimate
    ci95: tuple[float, float]
    parts: tuple[Part, ...] = ()


def views_of(fit: AThetaFit) -> tuple[View, ...]:
    """Return a_θ by the files as they are, and with their uncertainty where the trials say what that does."""
    views = (View("files", fit.a_theta, fit.ci95),)
    if not fit.shared:
        return views
    of_trials = Part(TRIALS, "A", "normal", "s/m", fit.a_theta.std, fit.a_theta.std)
    return (*views, View("uncertain", fit.total, fit.total_ci95, _ranked([of_trials, *fit.shared])))


@dataclass(frozen=True)
class Budget:
    """What the standard uncertainty of a result is made of.

    Attributes:
        speed: of the trials [m/s]; NaN for a_θ.
        result: with the std that is stated everywhere else.
        parts: components, largest first, the smallest ones merged into one.
    """

    speed: float
    result: Estimate
    parts: tuple[Part, ...]

    @property
    def combined(self) -> float:
        """Combined standard uncertainty by the components."""
        return math.hypot(*(part.contribution for part in self.parts))

    @property
    def whole(self) -> Part:
        """The combined standard uncertainty as a row below its components."""
        return Part(COMBINED, "A", "", "", self.result.std, self.combined)

    def share(self, part: Part) -> float:
        """Return the share of a component in the combined variance."""
        return (part.contribution / self.combined) ** 2 if self.combined > 0 else math.nan


def of_mean(
    speed: float, mean: Estimate, trials: Sequence[Sequence[Part]], weights: Sequence[float]
) -> Budget | None:
    """Return the budget of a weighted mean over trials of a speed [m/s], by the components of each trial.

    None where a trial has no components, or the mean has no std.
    """
    if not trials or not all(trials) or not math.isfinite(mean.std):
        return None
    n = len(trials)
    weighed = zip(weights, trials, strict=True)
    parts = _pooled(part.times(w) for w, of_trial in weighed for part in of_trial)
    beyond = mean.std**2 - sum(part.contribution**2 for part in parts)
    if beyond > 1e-6 * mean.std**2:
        per_trial = math.sqrt(beyond * n)
        parts.append(Part(SCATTER, "A", f"Student, {n - 1} d.o.f.", "1", per_trial, math.sqrt(beyond)))
    return Budget(speed, mean, _ranked(parts))


def of_a_theta(fit: AThetaFit, fits: Sequence[K92Fit]) -> Budget | None:
    """Return the budget of a_θ; None where it was not fitted to the k_92 of these trials, in this order."""
    weighed = [(c, k92_fit.parts) for c, k92_fit in zip(fit.sensitivity, fits, strict=False) if c]
    if len(fit.sensitivity) != len(fits) or not all(parts for _, parts in weighed):
        return None
    # As in the std of a_θ, errors of k_92 count as independent; those of the files are `AThetaFit.shared`.
    trials = _pooled(replace(part.times(c), common=False) for c, parts in weighed for part in parts)
    return Budget(math.nan, fit.a_theta, _ranked([*trials, *fit.parts]))


def _pooled(parts: Iterable[Part]) -> list[Part]:
    """Return the components of a sum over trials: each source once, its std as rms over trials.

    Contributions of a source that is common to all trials add up, those of another one as squares.
    """
    by_name: dict[str, list[Part]] = {}
    for part in parts:
        by_name.setdefault(part.name, []).append(part)
    return [_as_one(same) for same in by_name.values()]


def _as_one(same: Sequence[Part]) -> Part:
    made = [part.contribution for part in same]
    std = math.sqrt(sum(part.std**2 for part in same) / len(same))
    return replace(same[0], std=std, contribution=sum(made) if same[0].common else math.hypot(*made))


def _ranked(parts: Sequence[Part]) -> tuple[Part, ...]:
    whole = sum(part.contribution**2 for part in parts)
    small = [part for part in parts if part.contribution**2 < SMALL * whole]
    ranked = sorted((part for part in parts if part not in small), key=lambda part: -part.contribution)
    if small:
        rest = math.hypot(*(part.contribution for part in small))
        ranked.append(Part(f"{len(small)} smaller components", "B", "normal", "", math.nan, rest))
    return tuple(ranked)
