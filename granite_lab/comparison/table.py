"""This lab's rows of Table 3, beside the paper's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.comparison.record import Comparison
from granite_lab.estimate import Estimate
from granite_lab.model.command import peak_velocity
from granite_lab.parameters import Published, load_paper


@dataclass(frozen=True)
class Table3Row:
    """One speed.

    Attributes:
        velocity: desired velocity [m/s].
        trials: names of the trials that went in.
        virtual: any of them was written by a simulator.
        slip_measured: mean λ_R with the std of the mean: the larger of what the trials state and
            what they show.
        slip_simulated: mean λ_R simulated with the fitted k_92.
        k92: mean k_92, std likewise.
        at_bound: how many k_92 are a bound of the fit.
        paper: the paper's row; None where it has no such speed.
    """

    velocity: float
    trials: tuple[str, ...]
    virtual: bool
    slip_measured: Estimate
    slip_simulated: float
    k92: Estimate
    at_bound: int
    paper: Published | None


def table3(comparisons: Sequence[Comparison]) -> tuple[Table3Row, ...]:
    """Return a row per desired velocity, slowest first."""
    by_speed: dict[float, list[Comparison]] = {}
    for comparison in comparisons:
        by_speed.setdefault(round(peak_velocity(comparison.fit.variant), 3), []).append(comparison)
    return tuple(_row(velocity, by_speed[velocity]) for velocity in sorted(by_speed))


def mean_of(estimates: Sequence[Estimate]) -> Estimate:
    """Return the mean with its std, the larger of the stated and, from two on, the observed one."""
    values = np.array([e.value for e in estimates])
    n = values.size
    stated = math.sqrt(sum(e.std**2 for e in estimates)) / n
    shown = float(np.std(values, ddof=1)) / math.sqrt(n) if n > 1 else math.nan
    return Estimate(float(values.mean()), float(np.fmax(stated, shown)))


def _row(velocity: float, comparisons: Sequence[Comparison]) -> Table3Row:
    fits = [c.fit for c in comparisons]
    paper = next((p for p in load_paper().table3 if abs(p.velocity - velocity) < 1e-3), None)
    return Table3Row(
        velocity=velocity,
        trials=tuple(fit.trial for fit in fits),
        virtual=any(fit.virtual for fit in fits),
        slip_measured=mean_of([fit.slip_measured for fit in fits]),
        slip_simulated=float(np.mean([fit.slip_simulated for fit in fits])),
        k92=mean_of([fit.k92 for fit in fits]),
        at_bound=sum(fit.status in {"at_lower_bound", "at_upper_bound"} for fit in fits),
        paper=paper,
    )
