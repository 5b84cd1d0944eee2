r"""k_92 from the whole time history of one trial.

All sensors are compared in bins by the same inference as in the search for a missing effect, with

.. math:: k_{92}(t) = e^{-a v_d(t)}

where a has a flat prior. Sand, sensors, latency and the discrepancy of the model are nuisances with the usual
priors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import FitStatus
from granite_lab.inference.bench import RAKED, SAND, Bench, World
from granite_lab.inference.constants import SAND_STD, TOLERANCE
from granite_lab.inference.problem import Problem
from granite_lab.inference.setup import baseline, trial_models
from granite_lab.logs.trial import Array, Trial
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil, load_paper
from granite_lab.processes import one_thread

WIDE = 1.0
"""Std of the prior of log a_θ: flat beside the few percent that one trial tells."""

COARSE = 0.05
"""Least width of a bin [s]: a seventh of the time in which slip settles."""


@dataclass(frozen=True)
class Trajectory:
    """What the time history of a trial says.

    Attributes:
        a_theta: of (5) in this trial [s/m].
        t_start: start of the command [s, the log's time, as the IMU stamps it].
        latency: by how much the stamps of the IMU come after those of the wheels [s].
        status: whether the fit converged.
        notes: what a reader should know of latency, model and noise, one line each.
    """

    a_theta: Estimate
    t_start: Estimate
    latency: Estimate
    status: FitStatus
    notes: tuple[str, ...]


def fit_trajectory(
    trial: Trial, motion: Motion, robot: Robot, soil: Soil, *, effects: Sequence[Active] = ()
) -> Trajectory:
    """Fit a_θ to the time history of a trial; arguments as in `fit_k92`.

    Raises:
        EstimateError: the trial's sensors or start do not allow it, or the simulation fails.
    """
    if not np.isfinite(motion.t_start.value):
        raise EstimateError(f"{motion.trial}: the start of the motion is unknown")
    models, variants = trial_models([trial], robot, [motion], least=COARSE)
    with one_thread(), Bench(World(robot, soil, variants, {}, tuple(effects))) as bench:
        problem = Problem(models, bench, (WIDE, *SAND_STD[1:]))
        fit = baseline(problem)
    x = fit.point.vector + fit.posterior.step
    common = fit.point.trials[0].size
    late = common + len(SAND)

    def total(*places: int) -> Estimate:
        """Return the sum of some numbers."""
        g: Array = np.zeros(x.size)
        g[list(places)] = 1.0
        return Estimate(float(g @ x), float(np.sqrt(g @ fit.posterior.covariance @ g)))

    log, start, latency = total(0, common), total(RAKED, late), total(late)
    a_theta = load_paper().a_theta * float(np.exp(log.value))
    status: FitStatus = "ok" if fit.converged else "not_converged"
    side = "behind" if latency.value > 0 else "ahead of"
    shares = {c: fit.scales.share_of(c) for c in problem.counts}
    off = [f"{c} {100 * share:.0f} %" for c, share in shares.items() if share > TOLERANCE]
    louder = [f"{c} {value:.2f}" for c, value in fit.scales.louder.items() if value > 1.0]
    most = ", ".join(off) or f"less than {100 * TOLERANCE:.0f} %"
    notes = [
        f"Trajectory: discrepancy of the model, as a share of a channel's rms in motion: {most}.",
        f"Trajectory: IMU {abs(1e3 * latency.value):.1f} ± {1e3 * latency.std:.1f} ms {side} the encoders.",
    ]
    if louder:
        notes.append(f"Trajectory: residuals over the noise: {', '.join(louder)}.")
    if status != "ok":
        notes.append(f"Trajectory: fit {status.replace('_', ' ')}.")
    return Trajectory(
        Estimate(a_theta, a_theta * log.std),
        Estimate(problem.trials[0].observation.t_start + start.value, start.std),
        latency,
        status,
        tuple(notes),
    )
