r"""a_θ and k_92 from the whole time history of one trial or of many.

All sensors are compared in bins by the same inference as in the search for a missing effect. In trial i

.. math:: k_{92}(t) = e^{-a_i v_d(t)}, \quad \log a_i = \log a_θ + x_i

with a_θ common to all trials, of a flat prior, and x_i the scatter from raking to raking, whose size is
learnt. Sand, sensors, latency and the discrepancy of the model are nuisances with the usual priors. The
k_92 of a trial is that at its steady desired velocity, exp(-a_i v).
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
from granite_lab.inference.constants import SAND_STD
from granite_lab.inference.fit import Fit
from granite_lab.inference.observation import BIN
from granite_lab.inference.problem import Problem
from granite_lab.inference.setup import baseline, trial_models
from granite_lab.logs.trial import Array, Trial
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil, load_paper
from granite_lab.processes import one_thread

WIDE = 1.0
"""Std of the prior of log a_θ: flat beside the few percent that one trial tells."""

COARSE = 0.05
"""Least width of a bin where a trial is fitted alone [s]: a seventh of the time in which slip settles."""


@dataclass(frozen=True)
class Trajectories:
    """What the time histories of trials say together.

    Attributes:
        a_theta: common to the trials [s/m].
        scatter: learnt std of log a_θ from trial to trial.
        own: a_θ of each trial [s/m].
        t_start: start of each trial's command [s, the log's time, as the IMU stamps it].
        latency: by how much the stamps of the IMU come after those of the wheels [s].
        shares: channel to the discrepancy of the model, as a share of the channel's rms in motion.
        louder: channel to how many times louder its residuals are than its noise, where they are.
        status: whether the fit converged.
    """

    a_theta: Estimate
    scatter: float
    own: tuple[Estimate, ...]
    t_start: tuple[Estimate, ...]
    latency: Estimate
    shares: dict[str, float]
    louder: dict[str, float]
    status: FitStatus


def fit_trajectories(
    trials: Sequence[Trial],
    motions: Sequence[Motion],
    robot: Robot,
    soil: Soil,
    *,
    effects: Sequence[Active] = (),
    jobs: int = 1,
) -> Trajectories:
    """Fit a_θ to the time histories of trials.

    Args:
        trials: as estimation corrected them.
        motions: their estimates, which know command and start.
        robot: with chassis and drive.
        soil: the ground.
        effects: effects added to the paper's model.
        jobs: number of processes.

    Raises:
        EstimateError: a trial's sensors or start do not allow it, or the simulation fails.
        InputError: there is no trial.
    """
    alone = len(trials) == 1
    if alone and not np.isfinite(motions[0].t_start.value):
        raise EstimateError(f"{motions[0].trial}: the start of the motion is unknown")
    models, variants = trial_models(trials, robot, motions, least=COARSE if alone else BIN)
    with one_thread(), Bench(World(robot, soil, variants, {}, tuple(effects)), jobs) as bench:
        problem = Problem(models, bench, (WIDE, *SAND_STD[1:]))
        return trajectories(problem, baseline(problem))


def trajectories(problem: Problem, fit: Fit) -> Trajectories:
    """Return what a fit of the model says of a_θ."""
    x = fit.point.vector + fit.posterior.step
    first = np.cumsum([0, *(own.size for own in fit.point.trials)])
    common, late = int(first[-1]), int(first[-1]) + len(SAND)

    def estimate(*places: int, origin: float = 0.0) -> Estimate:
        """Return the sum of some numbers."""
        g: Array = np.zeros(x.size)
        g[list(places)] = 1.0
        return Estimate(origin + float(g @ x), float(np.sqrt(g @ fit.posterior.covariance @ g)))

    def exponent(*places: int) -> Estimate:
        log = estimate(*places)
        a_theta = load_paper().a_theta * float(np.exp(log.value))
        return Estimate(a_theta, a_theta * log.std)

    begun = zip(first[:-1].tolist(), problem.trials, strict=True)
    return Trajectories(
        a_theta=exponent(common),
        scatter=fit.scales.priors[SAND[0]],
        own=tuple(exponent(common, k) for k in first[:-1].tolist()),
        t_start=tuple(estimate(k + RAKED, late, origin=t.observation.t_start) for k, t in begun),
        latency=estimate(late),
        shares={c: fit.scales.share_of(c) for c in problem.counts},
        louder={c: value for c, value in fit.scales.louder.items() if value > 1.0},
        status="ok" if fit.converged else "not_converged",
    )
