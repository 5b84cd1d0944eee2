"""A disturbance that comes differently in each trial is told from noise by the sensors that share it."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from granite_lab.discovery.baseline import pure_error
from granite_lab.discovery.finding import CHANCE, Unrepeated
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.unrepeated import unrepeated

BINS, WIDTH, COMMANDS = 400, 0.02, 4
T = WIDTH * np.arange(BINS)


def found(
    repetitions: int,
    signal: Callable[[int, str], Any],
    *,
    seed: int,
    channels: tuple[str, ...] = ("accel_x", "pitch_rate", "wheel", "current_f"),
) -> Unrepeated:
    """Judge white noise of unit variance plus `signal(trial, channel)`."""
    rng = np.random.default_rng(seed)
    observation = SimpleNamespace(bins=BINS, width=WIDTH)
    trials = [
        SimpleNamespace(variant=i // repetitions, channels=channels, observation=observation)
        for i in range(COMMANDS * repetitions)
    ]
    problem = cast("Problem", SimpleNamespace(trials=trials, variants=range(COMMANDS)))
    white = [
        np.concatenate([rng.normal(size=BINS) + signal(i, c) for c in channels]) for i in range(len(trials))
    ]
    return unrepeated(problem, pure_error(problem, white))


def quiet(i: int, channel: str) -> float:
    return 0.0


def the_same(i: int, channel: str) -> Any:
    return 5 * np.sin(2 * np.pi * 3.3 * T)


def test_independent_noise_is_no_disturbance() -> None:
    assert max(found(3, quiet, seed=s).score for s in range(100)) < CHANCE


@pytest.mark.parametrize("repetitions", [2, 3, 6])
def test_the_score_is_one_of_a_standard_normal_number(repetitions: int) -> None:
    scores = [found(repetitions, quiet, seed=s, channels=("accel_x", "wheel")).score for s in range(300)]
    # largest of four magnitudes, one for each band; their distribution is that of independent normal ones
    expected = np.abs(np.random.default_rng(1).normal(size=(100_000, 4))).max(axis=1)
    assert np.mean(scores) == pytest.approx(expected.mean(), abs=0.1)


def test_a_wave_whose_phase_differs_from_trial_to_trial_is_found_with_its_band() -> None:
    phases = np.random.default_rng(5).uniform(0, 2 * np.pi, 12)
    there = ("accel_x", "current_f")

    def wave(i: int, channel: str) -> Any:
        return 0.4 * np.sin(2 * np.pi * 3.3 * T + phases[i]) if channel in there else 0.0

    seen = found(3, wave, seed=0)
    assert seen.plain
    assert {seen.first, seen.second} == set(there)
    assert (seen.low, seen.high) == (2.0, 5.0)


def test_what_is_the_same_each_time_is_none() -> None:
    assert not found(3, the_same, seed=0).plain


def test_a_vibration_of_the_imu_alone_is_none() -> None:
    shared = np.random.default_rng(3).normal(size=(12, BINS))
    imu = ("accel_x", "pitch_rate")

    def vibration(i: int, channel: str) -> Any:
        return shared[i] if channel in imu else 0.0

    assert not found(3, vibration, seed=0).plain


def test_without_repetitions_nothing_can_be_said() -> None:
    assert found(1, the_same, seed=0).score == 0.0
