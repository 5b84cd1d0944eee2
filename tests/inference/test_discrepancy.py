"""The discrepancy of the model: a smooth process of unit variance, modulated by how large it may be."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.inference.constants import REST_SHARE, SMOOTH
from granite_lab.inference.discrepancy import (
    FORMULA,
    MOTION,
    REST,
    joined,
    modulated,
    smooth,
    variances,
)

WIDTH = 0.02


@pytest.mark.parametrize("n", [30, 200, 400])
def test_the_process_has_unit_variance(n: int) -> None:
    variance = (smooth(n, WIDTH) ** 2).sum(axis=1)
    assert variance.mean() == pytest.approx(1.0, abs=0.03)
    assert 0.6 < variance.min() < variance.max() < 1.4  # cos^4 + sin^4 lies between 1/2 and 1


def test_the_process_is_smooth_over_the_shorter_time_and_forgets_over_the_longer() -> None:
    columns = smooth(400, WIDTH)
    covariance = columns @ columns.T
    lag = np.array([np.diag(covariance, k).mean() for k in range(80)])
    assert lag[1] > 0.95  # from one bin to the next
    assert 0.2 < lag[round(SMOOTH[0] / WIDTH)] < 0.8
    assert abs(lag[round(2 * SMOOTH[1] / WIDTH) :]).max() < 1e-12


def test_a_size_modulates_the_process() -> None:
    size = np.concatenate([np.zeros(100), np.linspace(0, 3, 100)])
    basis = modulated(size, MOTION, WIDTH)
    std = np.sqrt((basis.columns**2).sum(axis=1))
    assert (std[:100] == 0).all()
    assert std[105:] / size[105:] == pytest.approx(np.ones(95), abs=0.25)
    assert (basis.kind == MOTION).all()
    assert (np.abs(basis.columns).max(axis=0) > 0).all()  # bumps where nothing can be are not kept


def test_bases_are_joined_with_the_variance_of_each_kind() -> None:
    moving, resting = np.ones(100), np.zeros(100)
    moving[60:], resting[60:] = 0.0, 2.0
    parts = [modulated(x, k, WIDTH) for x, k in ((moving, MOTION), (resting, REST), (0.1 * moving, FORMULA))]
    whole = joined(parts)
    assert whole.columns.shape == (100, sum(p.kind.size for p in parts))
    Λ = variances(whole.kind, 0.05, 0.2)
    std = np.sqrt((whole.columns**2 * Λ).sum(axis=1))
    assert std[5:55] == pytest.approx(np.full(50, np.hypot(0.05, 0.02)), rel=0.3)
    assert std[65:] == pytest.approx(np.full(35, 2 * REST_SHARE), rel=0.3)
