"""Stamps that scatter, clocks at different rates, a low-pass in the IMU: right within the std, or no good."""

from dataclasses import replace

import numpy as np
import pytest

from granite_lab.estimation import correct
from granite_lab.estimation.clock_rate import outer_ramps
from granite_lab.estimation.noise import white
from granite_lab.estimation.wheels import rolling_of
from granite_lab.logs import read_trial
from granite_lab.logs.sensors.stamps import evened
from granite_lab.logs.trial import Array, Trial
from granite_lab.parameters import load_robot
from tests.soak import sampled
from tests.truth import field

ROBOT = load_robot("granite")


def sample(name: str) -> tuple[Trial, float]:
    path = next(p for p in field.SAMPLES if p.stem == name)
    return read_trial(path), field.of_sample(path).slip


@pytest.mark.parametrize("period", [0.005, 0.01])
def test_stamps_that_scatter_about_an_even_spacing_are_spaced_evenly(period: float) -> None:
    rng, even = np.random.default_rng(1), period * np.arange(2000)
    for late in (rng.normal(scale=0.3 * period, size=2000), rng.exponential(0.4 * period, 2000)):
        stamps: Array = np.maximum.accumulate(even + late) + 1e-9 * np.arange(2000)
        found, scatter = evened(stamps)
        assert 0.1 * period < scatter < 0.5 * period
        assert np.std(found - even) < 0.35 * np.std(late)
        assert np.diff(found).min() > 0.0


def test_stamps_of_uneven_or_lost_samples_stay() -> None:
    rng, even = np.random.default_rng(2), 0.01 * np.arange(2000)
    uneven = np.cumsum(0.01 * rng.uniform(0.5, 1.5, 2000))
    for stamps in (even, uneven, even[rng.random(2000) > 0.2], even + rng.normal(scale=1e-4, size=2000)):
        t: Array = np.asarray(stamps, dtype=np.float64)
        found, scatter = evened(t)
        assert scatter == 0.0
        np.testing.assert_array_equal(found, t)


def test_noise_behind_a_low_pass_is_that_of_long_times() -> None:
    """A filter of first order leaves the density at low frequencies as it is."""
    rng, dt, density = np.random.default_rng(3), 0.01, 1e-3
    ratios = []
    for corner in (2.0, 5.0, 20.0):
        a = 1.0 - np.exp(-2 * np.pi * corner * dt)
        for _ in range(20):
            x = density / np.sqrt(dt) * rng.normal(size=800)
            y: Array = np.zeros(x.size)
            for k in range(1, x.size):
                y[k] = y[k - 1] + a * (x[k] - y[k - 1])
            t: Array = dt * np.arange(500, dtype=np.float64)
            found = white(t, y[300:], [(0.0, 5.0)], density)
            ratios.append(found / density)
        assert 0.75 < np.median(ratios[-20:]) < 1.5


def clocked(trial: Trial, rate: float) -> Trial:
    """The encoders' clock runs at another rate."""
    assert trial.wheels is not None
    assert trial.currents is not None
    wheels = replace(trial.wheels, t=trial.wheels.t * (1.0 + rate))
    return replace(trial, wheels=wheels, currents=replace(trial.currents, t=trial.currents.t * (1.0 + rate)))


@pytest.mark.parametrize("rate", sampled([0.02, -0.02]))
def test_clocks_at_different_rates_are_never_good(rate: float) -> None:
    trial, slip = sample("virtual_v0.3_r2")
    motion = correct(clocked(trial, rate), ROBOT)[1]
    assert motion.health.grade == "fair"
    assert ("fast" if rate > 0 else "slow") in motion.health.verdict
    assert abs(motion.slip_ratio.value - slip) < 2 * motion.slip_ratio.std < 0.12


def test_ramps_are_those_of_the_whole_motion() -> None:
    trial, _ = sample("virtual_v0.3_r2")
    assert trial.wheels is not None
    ramps = outer_ramps(rolling_of(trial.wheels, ROBOT))
    assert ramps is not None
    first, last = ramps
    # 0.3 m/s at 1.2 m/s^2; 2 m
    assert 0.1 < first.end - first.begin < 0.6
    assert last.begin - first.end == pytest.approx(2.0 / 0.3 - 0.25, abs=0.3)


def test_a_body_that_swings_on_after_its_wheels_is_no_slow_clock() -> None:
    """Soft tyres or play: 5 cm/s at 3 Hz, which fades in 0.3 s."""
    trial, _ = sample("virtual_v0.3_r2")
    assert trial.wheels is not None
    assert trial.imu is not None
    ramps = outer_ramps(rolling_of(trial.wheels, ROBOT))
    assert ramps is not None
    since = np.maximum(trial.imu.t - ramps[1].end, 0.0)
    swing = 0.05 * np.exp(-since / 0.3) * np.sin(2.0 * np.pi * 3.0 * since)
    force = trial.imu.specific_force.copy()
    force[:, 0] += np.gradient(swing, trial.imu.t)
    motion = correct(replace(trial, imu=replace(trial.imu, specific_force=force)), ROBOT)[1]
    assert "clock runs" not in motion.health.verdict
