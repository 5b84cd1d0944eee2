"""Noise learnt from repetitions is whitened to independent numbers of unit variance, whatever is missing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from granite_lab.inference.noise import at_rest, errors, learn

N, WIDTH = 400, 0.02


def speed() -> np.ndarray:
    v = np.zeros(N)
    v[25:300] = np.minimum(1, np.arange(275) / 20)
    v[280:300] = np.linspace(1, 0, 20)
    return v


def slope() -> np.ndarray:
    s = np.zeros(N)
    s[25:30] = 1.0
    return s


def draw(rng: np.random.Generator) -> np.ndarray:
    """White noise of the sensor, a vibration that grows with speed, and jitter at a steep place."""
    vibration = lfilter([1.0], [1.0, 0.9, 0.6], rng.normal(size=N + 100))[100:]
    return 0.3 * rng.normal(size=N) + speed() * vibration + 0.8 * slope() * rng.normal(size=N)


@pytest.fixture(scope="module")
def missing() -> np.ndarray:
    """What the model lacks, the same in every repetition and far above the noise."""
    return 30 * speed() * np.sin(np.arange(N) / 15)


@pytest.mark.parametrize("repetitions", [3, 6])
def test_fresh_noise_comes_out_white(missing: np.ndarray, repetitions: int) -> None:
    rng = np.random.default_rng(repetitions)
    shown = []
    for _ in range(20):
        rows = [missing + draw(rng) for _ in range(repetitions)]
        whitener = learn(rows, speed(), slope(), 1e-3, WIDTH)[0]
        shown.append(whitener(draw(rng)))
    table = np.stack(shown)
    for part in (slice(0, 25), slice(30, 50), slice(50, 280), slice(305, N)):
        assert np.sqrt(np.mean(table[:, part] ** 2)) == pytest.approx(1.0, abs=0.15)
    for lag in (1, 2, 5):
        assert abs(np.mean(table[:, lag:] * table[:, :-lag])) < 0.06
    # the slow part, where effects live: the spectrum must not be thinner than noise there
    slow = np.array([np.sum(row[50:280]) / np.sqrt(230) for row in table])
    assert 0.6 < np.std(slow) < 1.5


def test_one_run_alone_does_not_take_a_slow_effect_for_noise(missing: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    noise = draw(rng)
    whitener = learn([missing / 5 + noise], speed(), slope(), 1e-3, WIDTH)[0]
    signal = whitener(missing / 5)
    assert np.sqrt(np.mean(whitener(noise)[50:280] ** 2)) == pytest.approx(1.0, abs=0.3)
    assert np.sum(signal**2) > 1000


def test_all_commands_together_tell_the_noise_at_rest_better_than_one() -> None:
    """Half a second of three repetitions that look alike by chance was once taken for a quiet sensor."""
    rng = np.random.default_rng(4)
    alone, together = [], []
    for _ in range(60):
        noise = [errors(list(rng.normal(size=(3, 24)))) for _ in range(4)]
        alone.append(at_rest(list(noise[0]), 1e-3, WIDTH).mean())
        together.append(at_rest([row for rows in noise for row in rows], 1e-3, WIDTH).mean())
    assert np.mean(together) == pytest.approx(1.0, abs=0.05)
    assert np.std(together) < 0.65 * np.std(alone)  # half of it, if they were normal numbers


def test_missing_bins_stay_out(missing: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    rows = [missing + draw(rng) for _ in range(3)]
    rows[1][100:120] = np.nan
    whiteners = learn(rows, speed(), slope(), 1e-3, WIDTH)
    assert (whiteners[1](rows[1])[100:120] == 0).all()
    assert np.isfinite(whiteners[1](rows[1])).all()
    assert np.array_equal(whiteners[0](rows[0]), whiteners[2](rows[0]))


def test_what_the_model_lacks_at_a_steep_place_is_no_jitter_of_one_run_alone() -> None:
    """A missing moment shakes the robot where the command has its corners."""
    rng = np.random.default_rng(3)
    missing = 20 * slope() * np.sin(np.arange(N))
    alone = learn([missing + draw(rng)], speed(), slope(), 1e-3, WIDTH)[0]
    assert np.sum(alone(missing) ** 2) > 300
    twice = learn([draw(rng), draw(rng)], speed(), slope(), 1e-3, WIDTH)[0]
    assert np.diag(twice.inverse)[25:30].max() < 0.8 * np.diag(alone.inverse)[25:30].min()
