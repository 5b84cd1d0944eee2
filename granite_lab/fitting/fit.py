"""The records of fitted numbers: k_92 of a trial, a_θ over trials, and rival laws."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from granite_lab.estimate import Estimate, Part
from granite_lab.parameters import Variant
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd

PointRow = tuple[str, float, Estimate, Estimate]
"""(trial, velocity [m/s], k_92, λ_R), as in `AThetaFit.points`."""

K92_BOUNDS = (0.0, 1.0)
"""The model needs k_92 >= 0 (section 5), and k_92 = 1 is the value at rest, below (4)."""

FitStatus = Literal["ok", "at_lower_bound", "at_upper_bound", "not_converged", "not_evaluated"]


@dataclass(frozen=True)
class K92Fit(Shown):
    """The ratio k_92 of one trial, fitted twice.

    Attributes:
        trial: name of the trial.
        virtual: the log was written by a simulator.
        variant: the trapezoid that was simulated.
        k92: by the steady slip ratio, as in the paper.
        k92_trajectory: by the whole time history of all sensors and the law (5), at the steady desired
            velocity.
        t_start: start of the command by the trajectory fit [s, the log's time, as the IMU stamps it].
        slip_measured: λ_R as measured.
        slip_simulated: λ_R simulated with `k92`.
        status: whether `k92` is an inner optimum.
        status_trajectory: the same for `k92_trajectory`.
        notes: what a reader should know, one line each.
        std_measurement: the part of the std of `k92` that comes from the measured slip ratio.
        parts: what the std of `k92` is made of, source by source; empty where it has none.
        curve: (k_92, λ_R) of the simulations, by k_92: the likelihood of `k92` goes by it.
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

    def __repr__(self) -> str:
        return (
            f"K92Fit('{self.trial}'{', virtual' if self.virtual else ''}: {self.variant.velocity:g} m/s, "
            f"k_92 {self.k92.value:.4f} ± {self.k92.std:.4f} ({self.status}), by the trajectory "
            f"{self.k92_trajectory.value:.4f} ± {self.k92_trajectory.std:.4f} ({self.status_trajectory}))"
        )

    def to_frame(self) -> pd.DataFrame:
        """Return the fit as one row, units in the column names."""
        import pandas as pd  # noqa: PLC0415

        row = {
            "trial": self.trial,
            "virtual": self.virtual,
            "variant_mps": self.variant.velocity,
            "k92": self.k92.value,
            "k92_std": self.k92.std,
            "k92_trajectory": self.k92_trajectory.value,
            "k92_trajectory_std": self.k92_trajectory.std,
            "slip_ratio": self.slip_measured.value,
            "slip_ratio_std": self.slip_measured.std,
            "slip_ratio_simulated": self.slip_simulated,
            "status": self.status,
            "status_trajectory": self.status_trajectory,
        }
        return pd.DataFrame([row])


@dataclass(frozen=True)
class Law:
    """One rival law for k_92.

    Attributes:
        id: "exponential" (27), "linear_slip" (28) or "free" (a constant per speed).
        formula: as a reader writes it.
        parameters: name to value with std.
        units: name to unit.
        n_parameters: fitted numbers, the scatter not counted.
        rms: root mean square residual of k_92.
        aicc: corrected Akaike information criterion (smaller is better); NaN where the points are
            too few for the law.
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
        published: the paper's value [s/m].
        agrees: the published value lies in `ci95`.
        points: (trial, velocity [m/s], k_92, λ_R) that went in; the velocity is the steady desired one.
        laws: the rivals, best first.
        notes: what a reader should know, one line each.
        parts: what the std of `a_theta` is made of besides the std of the points.
        sensitivity: da_θ/dk_92 of each point [s/m]; 0 for those that were left out. The squares of
            sensitivity times std of the points and of `parts` add up to the variance of `a_theta`.
        virtual: some of the logs were written by a simulator.
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

    def __repr__(self) -> str:
        return (
            f"AThetaFit({self.a_theta.value:.4f} ± {self.a_theta.std:.4f} s/m, 95 % {self.ci95[0]:.4f} to "
            f"{self.ci95[1]:.4f} s/m, published {self.published:g} s/m, {len(self.points)} points)"
        )

    def to_frame(self) -> pd.DataFrame:
        """Return the points that went in, one row a trial, units in the column names."""
        import pandas as pd  # noqa: PLC0415

        rows = [(trial, v, k92.value, k92.std, slip.value, slip.std) for trial, v, k92, slip in self.points]
        return pd.DataFrame(
            rows, columns=["trial", "variant_mps", "k92", "k92_std", "slip_ratio", "slip_ratio_std"]
        )
