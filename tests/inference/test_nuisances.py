"""Derivatives of what a trial shows are those of differences; a latency moves its sensor and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from granite_lab.inference.bench import RAKED, SAND
from granite_lab.inference.nuisances import SENSORS, TrialModel
from granite_lab.inference.observation import UNITS
from granite_lab.inference.point import SHARED, Point
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from tests.inference.stub import predicted, problem_of

IMU = ("accel_x", "accel_z", "pitch_rate")
CURRENTS = ("current_f", "current_r")


@pytest.fixture(scope="module")
def problem() -> Problem:
    return problem_of((0, 1))


@pytest.fixture(scope="module")
def trial(problem: Problem) -> TrialModel:
    return problem.trials[1]


@pytest.fixture(scope="module")
def response(problem: Problem) -> Array:
    found = problem.respond([problem.task(problem.neutral(), 1)])
    return found[0]


def moved(point: Point, place: int, by: float) -> Point:
    """Return the point with one number of its vector changed."""
    first = [0, *np.cumsum([x.size for x in point.trials]).tolist()]
    if place >= first[-1]:
        shared = point.shared.copy()
        shared[place - first[-1]] += by
        return replace(point, shared=shared)
    i = next(i for i in range(len(point.trials)) if place < first[i + 1])
    trials = [x.copy() for x in point.trials]
    trials[i][place - first[i]] += by
    return replace(point, trials=tuple(trials))


def test_all_columns_are_those_of_differences(problem: Problem) -> None:
    """At the files' values, where the trial's response is that of its command."""
    point = problem.neutral()
    slopes = problem.slopes(point)
    first = np.cumsum([0, *(x.size for x in point.trials)])
    for i, t in enumerate(problem.trials):
        columns = problem.columns(i, point, slopes)
        places = [*range(first[i], first[i + 1]), *range(first[-1], first[-1] + len(SHARED))]
        names = [*(s.name for s in t.slacks), *SHARED]
        assert columns.shape[1] == len(places)
        for name, place, column in zip(names, places, columns.T, strict=True):
            h = 5e-4
            up, down = (predicted(problem, moved(point, place, s * h))[i].ravel() for s in (1, -1))
            wanted = (up - down) / (2 * h)
            assert np.abs(column - wanted).max() < 0.03 * np.abs(wanted).max() + 1e-9, name


@pytest.mark.parametrize(("name", "own"), [("latency", IMU), ("current_latency", CURRENTS)])
def test_a_latency_moves_the_channels_of_its_sensor_alone(
    trial: TrialModel, response: Array, name: str, own: tuple[str, ...]
) -> None:
    x, none, late = np.zeros(trial.size), np.zeros(len(SENSORS)), np.zeros(len(SENSORS))
    late[SENSORS.index(name)] = 0.004
    now, later = trial.predict(response, x, none), trial.predict(response, x, late)
    for k, c in enumerate(trial.channels):
        if c not in own:
            assert np.array_equal(now[k], later[k]), c
    shifted = np.stack([np.interp(trial.t - 0.004, trial.t, s) for s in response])
    wanted = trial.predict(shifted, x, none)
    for c in own:
        k = trial.channels.index(c)
        change = np.abs(later[k] - now[k]).max()
        assert np.abs(later[k] - wanted[k]).max() < 0.05 * change, c


def test_an_imu_further_forward_feels_the_pitching(trial: TrialModel, response: Array) -> None:
    """A rigid body: x forward, z up, Θ positive nose down; ω̇ × r for r = (x, 0, z)."""
    x = np.zeros(trial.size)
    now = trial.predict(response, x, np.zeros(len(SENSORS)))
    pitching = trial.bins_of(
        np.stack([np.gradient(response[2], trial.t)] * 2 + [*response[2:]]), x, np.zeros(len(SENSORS))
    )["accel_x"]
    for name, channel, sign in (("arm_z", "accel_x", 1.0), ("arm_x", "accel_z", -1.0)):
        sensors = np.zeros(len(SENSORS))
        sensors[SENSORS.index(name)] = 0.02
        change = trial.predict(response, x, sensors) - now
        for k, c in enumerate(trial.channels):
            wanted = sign * 0.02 * pitching if c == channel else np.zeros_like(pitching)
            assert change[k] == pytest.approx(wanted, abs=1e-12), (name, c)


def test_a_tilted_imu_turns_forces_and_keeps_their_size(trial: TrialModel, response: Array) -> None:
    x = np.zeros(trial.size)
    x[[s.name for s in trial.slacks].index("tilt")] = 0.01
    plain = trial.predict(response, np.zeros(trial.size), np.zeros(len(SENSORS)))
    tilted = trial.predict(response, x, np.zeros(len(SENSORS)))
    k, j = (trial.channels.index(c) for c in ("accel_x", "accel_z"))
    before, after = np.hypot(plain[k], plain[j]), np.hypot(tilted[k], tilted[j])
    assert after == pytest.approx(before, rel=1e-4)
    assert tilted[k][0] == pytest.approx(plain[k][0] - 0.0981, abs=1e-6)


def test_a_trial_without_a_sensor_has_none_of_its_numbers() -> None:
    names = {s.name for s in problem_of((0,), ("wheel", "current_f")).trials[0].slacks}
    everything = {s.name for s in problem_of((0,), tuple(UNITS)).trials[0].slacks}
    assert {"tilt", "accel_x gain", "current_r gain"} <= everything - names
    assert {*SAND[:RAKED], "start", "wheel gain", "current_f gain"} <= names
