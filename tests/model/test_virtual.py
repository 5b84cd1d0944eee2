"""Virtual sensors err as the robot's file says, and not otherwise."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.signal import welch

from granite_lab.model import Accuracy, Run, simulate
from granite_lab.model.virtual import Scatter, rake, virtual_trial
from granite_lab.parameters import load_robot, load_soil, variant_of
from tests.truth.trials import quiet


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(variant_of(0.5), load_robot(), load_soil(), accuracy=Accuracy(1e-6, 1e-8, 0.0025))


def test_the_same_seed_gives_the_same_log_and_another_seed_another(run: Run) -> None:
    a, b, c = (virtual_trial(run, seed, "x")[0] for seed in (1, 1, 2))
    assert a.info.virtual
    np.testing.assert_array_equal(a.imu.specific_force, b.imu.specific_force)
    assert np.abs(a.imu.specific_force[:100] - c.imu.specific_force[:100]).max() > 1e-3


def test_without_errors_the_sensors_read_the_model(run: Run) -> None:
    ideal = dataclasses.replace(run, robot=quiet(run.robot))
    trial, truth = virtual_trial(ideal, 3, "x")
    t = trial.imu.t - truth.attrs["t_start_s"]
    # the sum of the samples is the change of velocity, whatever happens between them
    for read, name, scale in (
        (trial.imu.specific_force[:, 0], "imu_ax_mps2", 1.0),
        (trial.imu.angular_rate[:, 1], "imu_gy_radps", 0.1),
    ):
        true = np.trapezoid(run[name], run.t)
        resting = run[name][0] * (run.t[0] - t[0]) + run[name][-1] * (t[-1] - run.t[-1])
        assert (read * np.gradient(t)).sum() == pytest.approx(true + resting, abs=2e-3 * scale)
    rolled = trial.wheels.angle[-1] - trial.wheels.angle[0]
    true = [np.ptp(run[f"theta_{axle}_rad"]) for axle in "ffrr"]
    assert rolled == pytest.approx(true, abs=2 * trial.wheels.step)


def test_white_noise_has_the_density_of_the_grade(run: Run) -> None:
    robot = dataclasses.replace(run.robot, imu=dataclasses.replace(run.robot.imu, vibration=0.0))
    trial, _ = virtual_trial(dataclasses.replace(run, robot=robot), 4, "x")
    still = trial.imu.t < 1.9
    sample_std = robot.imu_grade.accel_noise * np.sqrt(robot.imu_grade.rate)
    assert trial.imu.specific_force[still, 1].std() == pytest.approx(sample_std, rel=0.15)


def test_vibration_shakes_but_does_not_carry_away(run: Run) -> None:
    loud = dataclasses.replace(quiet(run.robot), imu=dataclasses.replace(quiet(run.robot).imu, vibration=1.0))
    shaken, truth = virtual_trial(dataclasses.replace(run, robot=loud), 5, "x")
    still, _ = virtual_trial(dataclasses.replace(run, robot=quiet(run.robot)), 5, "x")
    extra = shaken.imu.specific_force[:, 0] - still.imu.specific_force[:, 0]
    t = shaken.imu.t
    steady = (t > truth.attrs["t_start_s"] + 1) & (t < truth.attrs["t_start_s"] + 4.5)
    assert extra[steady].std() == pytest.approx(1.0, rel=0.3)
    velocity = np.concatenate([[0], np.cumsum((extra[1:] + extra[:-1]) / 2 * np.diff(t))])
    assert np.abs(velocity).max() < 0.03  # white noise of the same rms would reach 0.1 m/s
    frequency, power = welch(extra[steady], fs=200, nperseg=256)
    assert 15 < frequency[power.argmax()] < 36


def test_stamps_rise_and_keep_the_rate(run: Run) -> None:
    trial, _ = virtual_trial(run, 6, "x")
    for stream, rate in ((trial.imu, 200), (trial.wheels, 100), (trial.currents, 100)):
        assert (np.diff(stream.t) > 0).all()
        assert stream.t.size / np.ptp(stream.t) == pytest.approx(rate, rel=0.01)


def test_raking_scatters_the_sand_as_stated() -> None:
    rng = np.random.default_rng(0)
    drawn = [rake(load_soil(), 4.919, Scatter(), rng) for _ in range(2000)]
    k = np.log([soil.frictional_modulus for soil, _ in drawn])
    a = np.log([a_theta for _, a_theta in drawn])
    assert k.std() == pytest.approx(0.05, rel=0.1)
    assert a.std() == pytest.approx(0.03, rel=0.1)
    assert a.mean() == pytest.approx(np.log(4.919), abs=0.003)
