"""How the coverage of ±2σ scatters by chance, were the model of the filter exact.

The errors of a smoothed velocity are correlated over the whole motion, so that a trial has few independent
ones, and the coverage of some trials differs from 95 % though the std is right. Errors are drawn from the
joint posterior of the smoother, backwards from the last node:

    e_k = A_k e_k+1 + w,    cov(w) = P_k - A_k P_k+1 A_k^T

with the covariances P and the gains A of Rauch, Tung and Striebel.
"""

from __future__ import annotations

import numpy as np

from benchmarks.against_truth import Array
from granite_lab.estimation.error_model import PD, V, std_of
from granite_lab.estimation.motion import Motion
from granite_lab.estimation.smoother import Smoothed, Solution

QUICK = 0.15
"""The sign of the acceleration is that of its mean over this time [s]."""

LEAST = 1e-12
"""Std below which a state counts as known, in its own unit."""


def root(covariance: Array, scale: Array) -> Array:
    """(..., S, S) a root of covariances (..., S, S) of states whose std is `scale` (..., S) or less."""
    values, vectors = np.linalg.eigh(covariance / (scale[..., :, None] * scale[..., None, :]))
    return np.asarray(scale[..., :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def errors(found: Smoothed, count: int, rng: np.random.Generator) -> Array:
    """(count, K) errors of the velocity at the nodes [m/s], drawn from the posterior of the smoother."""
    P, A = found.P, found.gains[:-1]
    scale = np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2), LEAST**2))
    own = root(P[:-1] - A @ P[1:] @ A.transpose(0, 2, 1), scale[:-1])
    nodes, size = P.shape[:2]
    state = rng.standard_normal((count, size)) @ root(P[-1], scale[-1]).T
    drawn = np.empty((count, nodes))
    drawn[:, -1] = state[:, V] - state[:, PD]
    for k in range(nodes - 2, -1, -1):
        state = state @ A[k].T + rng.standard_normal((count, size)) @ own[k].T
        drawn[:, k] = state[:, V] - state[:, PD]
    return drawn


def coverages(
    motion: Motion, solution: Solution, at: np.ndarray, count: int, rng: np.random.Generator
) -> Array:
    """(count,) shares of the samples `at` (N,) within ±2σ, by chance.

    What the stated std has beyond that of the smoother is the doubt about the latency, one delay for all
    samples.
    """
    nodes, t = solution.nodes.t, motion.t[at]
    drawn = np.array([np.interp(t, nodes, one) for one in errors(solution.smoothed, count, rng)])
    known = np.interp(t, nodes, std_of(solution.smoothed.P, {V: 1.0, PD: -1.0}))
    delay = np.sqrt(np.maximum(motion.v_std[at] ** 2 - known**2, 0.0))
    width = max(round(QUICK / float(np.median(np.diff(motion.t)))), 1)
    slope = np.convolve(np.gradient(motion.v, motion.t), np.ones(width), mode="same")[at]
    drawn += rng.standard_normal((count, 1)) * delay * np.sign(slope)
    return np.asarray(np.mean(np.abs(drawn) < 2.0 * motion.v_std[at], axis=1))
