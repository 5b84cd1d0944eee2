"""The ceiling: how much of what a model leaves any force could close, where and when.

A force along the robot, a lift, a moment and torques on the wheels, free in time but smooth, stand in the
normal equations beside the model's parameters and the discrepancy. They follow no law, cannot be carried over
to another speed and explain nothing; what they do not close, no force on the robot does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

from granite_lab.discovery.finding import Ceiling, Push
from granite_lab.discovery.impulses import ImpulseResponses, Places
from granite_lab.discovery.where import intervals
from granite_lab.inference.constants import CREDIBLE, NEAR_ZERO, NEGLIGIBLE, TINY, UNOBSERVABLE
from granite_lab.inference.descent import ROUNDS
from granite_lab.inference.fit import Fit
from granite_lab.inference.gap import beyond, tolerated
from granite_lab.inference.normal import NormalEquations, Posterior, posterior
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from granite_lab.model.latent import PUSHES


def ceiling(problem: Problem, baseline: Fit, impulses: ImpulseResponses, tolerance: float) -> Ceiling:
    """Return how much of the gap any force could close beside the fit that was pushed.

    Forces are not credited with what they take up of the noise: each direction that the trials determine
    takes up one unit of the sum of squares. The size of each quantity is learnt by its marginal likelihood
    under a tolerated discrepancy, so that nothing is found where nothing is missing.

    Args:
        problem: the trials.
        baseline: the fit without effects; what it leaves beyond noise and tolerance is the gap.
        impulses: about the likeliest model.
        tolerance: discrepancy that is taken for granted, as a share of a channel's rms.
    """
    fit = impulses.fit
    misfits = [beyond(problem, f, tolerance) for f in (baseline, fit)]
    left = misfits[1][0]
    gap = misfits[0][0] - min(floor for _, floor in misfits)
    kind = np.concatenate(impulses.kind)
    normal = problem.normal(fit.point, fit.derivatives, fit.residuals, further=impulses.further, keep=False)
    solve = _Solver(problem, fit, normal, tolerance, kind)
    sizes = solve.learnt()
    fitted, value = solve.closed(sizes)
    parts = {}
    for q, name in enumerate(PUSHES):
        single = np.where(np.arange(sizes.size) == q, sizes, 0.0)
        parts[name] = _share(left - solve.closed(single)[1], gap)
    amplitudes = fitted.step[-kind.size :]
    std = np.sqrt(np.fmax(np.diag(fitted.covariance)[-kind.size :], 0.0))
    return Ceiling(
        value=_share(left - value, gap),
        left=_share(left - min(floor for _, floor in misfits), gap),
        parts=parts,
        channels=_shown(problem, impulses, amplitudes),
        where=_where(problem, impulses, amplitudes, std),
    )


def _share(closed: float, gap: float) -> float:
    return float(np.clip(closed / gap, 0.0, None)) if gap > 0 else float("nan")


class _Solver:
    """The normal equations with pushes among the parameters.

    Args:
        problem: the trials.
        fit: about which they are linear.
        normal: with the pushes' columns.
        tolerance: of the discrepancy.
        kind: (K,) quantity of each push.
    """

    def __init__(
        self, problem: Problem, fit: Fit, normal: NormalEquations, tolerance: float, kind: Places
    ) -> None:
        self.kind = kind
        scales = tolerated(fit.scales, tolerance)
        self.M, self.logdet = normal.marginal(scales)
        std, mean = problem.prior(fit.point, scales)
        self.precision, self.pull = std**-2.0, mean - fit.point.vector

    def at(self, sizes: Array) -> tuple[Posterior, Array]:
        """Return the posterior under std of the pushes, (5,), and the (K,) share the trials determine."""
        s = np.fmax(sizes[self.kind], NEAR_ZERO * UNOBSERVABLE)
        precision = np.concatenate([self.precision, s**-2.0])
        fitted = posterior(self.M, self.logdet, precision, np.append(self.pull, np.zeros(s.size)))
        determined = 1 - np.diag(fitted.covariance)[-s.size :] / s**2
        return fitted, np.clip(determined, 0.0, 1.0)

    def closed(self, sizes: Array) -> tuple[Posterior, float]:
        """Return the posterior, and the misfit with what the pushes take up of the noise added."""
        fitted, determined = self.at(sizes)
        return fitted, fitted.misfit + float(determined.sum())

    def learnt(self) -> Array:
        """Return the (5,) std of the pushes, by MacKay's fixed point from large ones down.

        They are shares of the robot's weight, which is all that a robot on sand can bear.
        """
        sizes = np.ones(len(PUSHES))
        for _ in range(ROUNDS):
            fitted, determined = self.at(sizes)
            squares = fitted.step[-self.kind.size :] ** 2
            new = np.array(
                [
                    np.sqrt(squares[self.kind == q].sum() / max(determined[self.kind == q].sum(), TINY))
                    for q in range(sizes.size)
                ]
            )
            new = np.clip(new, UNOBSERVABLE, 1)
            done = bool(np.all(np.abs(np.log(new / sizes)) < NEGLIGIBLE))
            sizes = new
            if done:
                break
        return sizes


def _shown(problem: Problem, impulses: ImpulseResponses, amplitudes: Array) -> dict[str, float]:
    """Return channel to how far the forces move it, at most over the commands, over its rms in motion."""
    largest: dict[str, float] = {}
    for command, repetitions in enumerate(problem.commands):
        trial, x = problem.trials[repetitions[0]], impulses.fit.point.trials[repetitions[0]]
        felt = (
            impulses.changes[problem.input_of[repetitions[0]]] @ amplitudes[impulses.further.places(command)]
        )
        shown = trial.effect_columns(felt[..., None], x, impulses.fit.point.sensors)
        for c, row in zip(trial.channels, shown.reshape(len(trial.channels), -1), strict=True):
            size, moving = problem.rms_of(command, c)
            if size > 0:
                rms = float(np.sqrt(np.mean(row[moving] ** 2))) / size
                largest[c] = max(largest.get(c, 0.0), rms)
    return largest


def _where(problem: Problem, impulses: ImpulseResponses, amplitudes: Array, std: Array) -> tuple[Push, ...]:
    """Return the intervals in which a force is certain, those that need the most force first."""
    rows: list[tuple[float, Push]] = []
    certain = -ndtri((1 - CREDIBLE) / 2 / amplitudes.size)  # none by chance in nine of ten searches
    for command, repetitions in enumerate(problem.commands):
        o = problem.trials[repetitions[0]].observation
        place = impulses.further.places(command)
        for q, (name, unit) in enumerate(PUSHES.items()):
            at = place[impulses.kind[command] == q]
            order = np.argsort(impulses.centres[command][impulses.kind[command] == q])
            t = impulses.centres[command][impulses.kind[command] == q][order]
            value, error = amplitudes[at][order], std[at][order]
            phases = _phases(o.t, o.phase, t)
            for a, b in intervals(np.abs(value) > certain * error, phases, 1):
                size = float(np.sqrt(np.mean(value[a:b] ** 2)))
                sign = 1.0 if value[a:b].sum() >= 0 else -1.0
                push = Push(
                    name, unit, phases[(a + b) // 2], o.variant.velocity,
                    float(t[a]), float(t[b - 1]), sign * size * float(impulses.sizes[q]),
                )  # fmt: skip
                rows.append((size * np.sqrt(b - a), push))
    return tuple(push for _, push in sorted(rows, key=lambda r: -r[0]))


def _phases(t: Array, phase: Sequence[str], at: Array) -> tuple[str, ...]:
    return tuple(phase[k] for k in np.clip(np.searchsorted(t, at), 0, t.size - 1))
