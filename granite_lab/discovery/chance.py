"""What chance alone would show: the screen's null distribution over all candidates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.point import Fit
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.signature import Signatures
from granite_lab.logs.trial import Array

BLOCK = 25
"""Bins whose whitened residuals change sign together in the bootstrap; 0.5 s."""


def null_maximum(
    problem: Problem,
    fit: Fit,
    signs: Signatures,
    noise: Sequence[Array],
    rng: np.random.Generator,
    draws: int = 2000,
) -> Array:
    """Return (draws,) the largest drop over all probes when nothing is missing.

    Blocks of the pure error and the scatter of the trials' own numbers about their mean change sign
    at random.

    Args:
        problem: for the layout of the bins.
        fit: gives the trials' own numbers.
        signs: the signatures.
        noise: (m,) per trial, whitened pure error.
        rng: of the signs.
        draws: how many.
    """
    rows = []
    for trial, left, w in zip(problem.trials, signs.projection.left, noise, strict=True):
        n = trial.observation.bins
        products = (left * w[:, None]).reshape(len(trial.channels), n, -1)
        rows.append(np.add.reduceat(products, np.arange(0, n, BLOCK), axis=1).reshape(-1, left.shape[1]))
    scatter = _scatter(problem, fit)
    for pull, block, x in zip(signs.projection.pull, fit.blocks, scatter, strict=True):
        size = x.size
        rows.append(pull[:size] * (block.precision[:size] * x)[:, None])
    table = np.concatenate(rows)
    norm = np.sqrt(np.fmax(np.diag(signs.gram), 1e-12))
    flips = rng.choice([-1.0, 1.0], size=(draws, table.shape[0]))
    return np.asarray(((flips @ (table / norm)) ** 2).max(axis=1))


def _scatter(problem: Problem, fit: Fit) -> list[Array]:
    """Return each trial's own numbers about the mean of that number over all trials that have it."""
    values: dict[str, list[float]] = {}
    for trial, x in zip(problem.trials, fit.point.trials, strict=True):
        for name, value in zip(trial.names, x, strict=False):
            values.setdefault(name, []).append(float(value))
    mean = {name: np.mean(v) for name, v in values.items()}
    inflate = {name: np.sqrt(len(v) / max(1, len(v) - 1)) for name, v in values.items()}
    return [
        np.array([inflate[n] * (v - mean[n]) for n, v in zip(trial.names, x, strict=False)])
        if len(problem.trials) > 1
        else x[: trial.size]
        for trial, x in zip(problem.trials, fit.point.trials, strict=True)
    ]
