"""Noise learnt from repetitions is whitened; numbers of the sensors have the slopes of differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from granite_lab.inference.bench import RAKED, SAND
from granite_lab.inference.noise import at_rest, errors, learn
from granite_lab.inference.nuisances import SENSORS, TrialModel
from granite_lab.inference.observation import UNITS
from granite_lab.inference.point import SHARED
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from tests.inference.stub import predicted, problem_of

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
            step = h * (np.arange(point.vector.size) == place)
            up, down = (predicted(problem, problem.moved(point, s * step))[i].ravel() for s in (1, -1))
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
