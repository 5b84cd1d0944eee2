"""Standstills, by wheels of any resolution, by loud rates, and by an IMU of any noise."""

from pathlib import Path

import numpy as np
import pytest

import granite_lab as gl
from granite_lab.logs import inspect_logs
from granite_lab.logs.sensors.standstill import (
    ZERO_VELOCITY,
    WheelTravel,
    find_standstills,
    imu_quiet,
    wheels_still,
)
from granite_lab.logs.trial import Array, ImuStream
from granite_lab.parameters import load_robot
from tests.logs.test_sensors_that_lie import changed, constant

SAMPLES = Path(__file__).parents[2] / "data" / "samples"
GRADE = load_robot("granite").imu_grade
RADIUS = 0.165
RATE = 100.0


def angles(t: Array, v: Array, counts: int, phase: float = 0.3) -> WheelTravel:
    """Return wheels that count an exact way, each from another place between two counts."""
    q = 2 * np.pi * RADIUS / counts
    way = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
    distance = q * np.floor(way[:, None] / q + phase + np.array([0.0, 0.2, 0.45, 0.7]))
    return WheelTravel(t, distance, None, (q,) * 4)


def rates(t: Array, v: Array, noise: float, offset: float = 0.0, seed: int = 1) -> WheelTravel:
    velocity = v[:, None] + offset + noise * np.random.default_rng(seed).normal(size=(t.size, 4))
    return WheelTravel(t, np.cumsum(velocity, axis=0) / RATE, velocity, (0.0,) * 4)


def drive(end: float = 0.4) -> tuple[Array, Array]:
    """Return stamps and velocity: 2 s at rest, 0.4 m/s, braked within 0.4 s, then a coast of time `end`."""
    t = np.arange(0, 16, 1 / RATE)
    v = np.interp(t, [2.0, 2.4, 7.0, 7.4], [0.0, 0.4, 0.4, 0.02])
    return t, np.where(t > 7.4, 0.02 * np.exp(-(t - 7.4) / end), v)


def imu(t: Array, v: Array, rest: float = 0.01, motion: float = 0.3, seed: int = 2) -> ImuStream:
    rng = np.random.default_rng(seed)
    loud = np.where(v > 0.01, motion, rest)[:, None]
    force = loud * rng.normal(size=(t.size, 3)) + [0.0, 0.0, 9.81]
    force[:, 0] += np.gradient(v, t)
    return ImuStream(t, force, 0.05 * loud * rng.normal(size=(t.size, 3)))


@pytest.mark.parametrize("coast", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("counts", [256, 512, 1920, 4096, 16384, 65536])
def test_a_standstill_begins_within_the_velocity_that_counts_may_hide(counts: int, coast: float) -> None:
    t, v = drive(coast)
    for phase in (0.1, 0.5, 0.9):
        found, unseen = find_standstills(None, angles(t, v, counts, phase), GRADE)
        for begin, end in found:
            k = int(np.searchsorted(t, begin))
            assert v[k : int(np.searchsorted(t, end))].max() <= 2.0 * np.hypot(unseen[k], ZERO_VELOCITY)
        assert found[0][0] == 0.0
        assert found[0][1] > 1.4
        assert found[-1][1] == t[-1]


def test_a_creep_of_less_than_a_count_a_window_is_no_standstill() -> None:
    t = np.arange(0, 30, 1 / RATE)
    q = 2 * np.pi * RADIUS / 512
    v = np.where((t > 5) & (t < 25), q / 0.45, 0.0)  # 4.5 mm/s
    creeping = wheels_still(angles(t, v, 512)).at[(t > 5.5) & (t < 24.5)]
    assert not creeping.any()


def test_a_count_at_its_edge_is_no_motion() -> None:
    t = np.arange(0, 10, 1 / RATE)
    wheels = angles(t, np.zeros(t.size), 1024)
    wheels.distance[::7, 1] += wheels.resolution[1]
    assert wheels_still(wheels).at.all()


@pytest.mark.parametrize(("noise", "offset"), [(0.026, 0.0), (0.15, 0.0), (1e-4, 0.0025), (0.0, 0.0)])
def test_loud_rates_stand_by_their_own_noise_at_rest(noise: float, offset: float) -> None:
    t, v = drive(0.05)
    found, _ = find_standstills(imu(t, v), rates(t, v, noise, offset), GRADE)
    assert len(found) == 2
    (_, set_off), (stop, end) = found
    assert 1.6 < set_off < 2.1
    assert 7.3 < stop < 12.0  # rates this loud may hide a creep: half of the time is left out
    assert end == pytest.approx(t[-1], abs=0.02)


def test_steady_motion_is_no_standstill_however_loud_the_rates() -> None:
    t = np.arange(0, 12, 1 / RATE)
    v = np.full(t.size, 0.4)
    for noise in (0.0, 0.026, 0.15):
        assert find_standstills(imu(t, v), rates(t, v, noise), GRADE)[0] == []
        assert find_standstills(None, rates(t, v, noise), GRADE)[0] == []


def test_a_wheel_that_is_reversed_does_not_stand() -> None:
    t = np.arange(0, 6, 0.05)
    v = np.clip(3.0 * (t - 1.0), -1.2, 2.2)
    for noise in (0.0, 0.02, 0.05):
        assert find_standstills(None, rates(t, v, noise), GRADE)[0] == []


@pytest.mark.parametrize("rate", [10.0, 20.0, 50.0, 100.0, 400.0])
def test_white_noise_at_rest_is_quiet_at_any_rate(rate: float) -> None:
    t = np.arange(0, 300, 1 / rate)
    rng = np.random.default_rng(4)
    force, turn = rng.normal(size=(2, t.size, 3))
    still = ImuStream(t, force + np.array([0.0, 0.0, 9.81]), turn)
    assert GRADE is not None
    quiet = imu_quiet(still, GRADE, np.ones(t.size, dtype=bool))
    assert np.mean(~quiet) < 0.002  # two tests of 1e-4 each, whose windows overlap


@pytest.mark.parametrize("log", sorted(SAMPLES.glob("*_r1.csv")), ids=lambda log: log.stem)
def test_inspect_lists_the_standstills_that_the_estimate_goes_by(log: Path) -> None:
    listed = inspect_logs([log]).files[0].rests
    taken = gl.ingest(log)[0].motion.health.rests
    assert len(listed) == len(taken) == 2
    assert np.ravel(listed) == pytest.approx(np.ravel(taken), abs=0.1)  # the clocks' offset is not known yet


def test_equal_readings_at_rest_are_no_dead_sensor(tmp_path: Path) -> None:
    forces = ("imu_ax_mps2", "imu_ay_mps2", "imu_az_mps2")
    trial = changed(tmp_path, constant(*forces, between=(7.8, 99)))
    assert trial.imu is not None
    assert np.ptp(trial.imu.specific_force[trial.imu.t > 7.85], axis=0).max() == 0.0
