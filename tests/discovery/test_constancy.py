"""A candidate that is free in phase must not be free in size."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from granite_lab.discovery.constancy import CHANCE, TOLERANCE, apart
from granite_lab.effects import library
from granite_lab.logs.trial import Array

TRIALS = 12
LIMIT = chi2.ppf(1 - CHANCE, TRIALS - 1)


def turned(sizes: Array, rng: np.random.Generator, std: float) -> tuple[list[Array], list[Array]]:
    """Vectors of given lengths in any direction, with noise of a covariance that is not round."""
    vectors, covariances = [], []
    for size in sizes:
        phase = rng.uniform(0, 2 * np.pi)
        L = std * np.array([[1.0, 0.0], [0.6, 0.8]])
        vectors.append(size * np.array([np.cos(phase), np.sin(phase)]) + L @ rng.standard_normal(2))
        covariances.append(L @ L.T)
    return vectors, covariances


@given(st.integers(0, 10**6), st.floats(0.0, 50.0))
def test_one_size_at_any_phase_is_one_size(seed: int, size: float) -> None:
    assert apart(*turned(np.full(TRIALS, size), np.random.default_rng(seed), std=1.0)) < LIMIT


@given(st.integers(0, 10**6), st.floats(1.0, 1.0 + TOLERANCE))
def test_a_formula_may_be_off_by_a_tenth_however_small_the_noise(seed: int, factor: float) -> None:
    sizes = np.where(np.arange(TRIALS) % 2, 1.0, factor)
    assert apart(*turned(sizes, np.random.default_rng(seed), std=1e-3)) < LIMIT


@given(st.integers(0, 10**6), st.floats(3.0, 20.0))
def test_a_size_that_differs_is_seen_through_the_noise(seed: int, factor: float) -> None:
    sizes = np.where(np.arange(TRIALS) % 2, 8.0, 8.0 * factor)
    assert apart(*turned(sizes, np.random.default_rng(seed), std=1.0)) > LIMIT


def test_for_large_sizes_it_is_the_scatter_of_the_lengths() -> None:
    """Where the noise is round and small, χ² is that of twelve lengths about their mean."""
    rng = np.random.default_rng(5)
    vectors, _ = turned(np.full(TRIALS, 1.0), rng, std=1e-9)
    vectors = [v * (1 + 0.3 * rng.standard_normal()) for v in vectors]
    lengths = np.array([np.hypot(*v) for v in vectors])
    a = np.linspace(0.2, 2.0, 2001)
    expected = (((lengths[:, None] - a) / (TOLERANCE * a)) ** 2).sum(axis=0).min()
    assert apart(vectors, [1e-12 * np.eye(2)] * TRIALS) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("effect", library().values(), ids=lambda e: e.id)
def test_what_differs_from_trial_to_trial_is_a_phase_in_every_effect(effect: object) -> None:
    free = [p.name for p in effect.parameters if p.per_trial]  # type: ignore[attr-defined]
    assert sorted(free) == sorted(name for pair in effect.circles for name in pair)  # type: ignore[attr-defined]
