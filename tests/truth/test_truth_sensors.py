"""The truth generator: kinematics that close, errors that have the stated size, rest that is rest."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.hidden.sensors import rotation, vibration
from granite_lab.hidden.simulator import DT, Body
from granite_lab.parameters import GRAVITY, load_grade, load_robot
from tests.truth import faults, generate
from tests.truth.body import random_body
from tests.truth.trials import quiet


def draw_body() -> Body:
    return random_body(
        np.random.default_rng(1), velocity=0.5, acceleration=1.2, duration=8.0, still=(1.0, 1.0), slip=None,
        wobble=1.0, radius=0.0965, mass=43.1,
    )  # fmt: skip


def rolled_by(v_wheel: np.ndarray) -> np.ndarray:
    """Wheel angle by the trapezoidal rule."""
    return (np.cumsum(v_wheel) - 0.5 * (v_wheel + v_wheel[0])) * DT / 0.0965


@pytest.mark.parametrize("seed", range(3))
def test_faultless_readings_integrate_back_to_the_truth(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("granite_lab.hidden.sensors.IMU_JITTER", 0.0)
    faultless = quiet(load_robot())
    truth = generate(seed, velocity=0.7, robot=faultless, scale_error=0.0, wobble=0.0)
    imu, arm = truth.trial.imu, faultless.imu
    dt, q = 0.005, imu.angular_rate[:, 1]
    ends = imu.t + 0.5 * dt  # a reading is the mean over the window around its stamp
    pitch = truth.at(imu.t[0], "pitch") + dt * np.cumsum(q)
    middle = pitch - 0.5 * dt * q
    along = imu.specific_force[:, 0] + GRAVITY * np.sin(middle) + q**2 * arm.x
    v = dt * np.cumsum(along) - arm.z * 0.5 * (q + np.append(q[1:], q[-1]))
    assert np.abs(pitch - truth.at(ends, "pitch")).max() < 2e-6
    assert np.abs(v - truth.at(ends, "v")).max() < 3e-4
    assert np.abs(truth.x - DT * np.cumsum(truth.v)).max() < 1e-3


def test_robot_is_exactly_at_rest_before_and_after() -> None:
    truth = generate(4, velocity=0.7, still=(1.0, 1.5))
    before, after = truth.t < truth.start, truth.t > truth.stop + 0.9
    for signal in (truth.v, truth.v_wheel.max(axis=1)):
        assert not signal[before].any()
        assert np.abs(signal[after]).max() < 1e-12
    assert np.ptp(truth.pitch[before]) == 0
    assert truth.v.max() > 0.4
    assert (truth.v > -1e-12).all()


def test_vibration_carries_the_sensor_nowhere() -> None:
    body, robot = draw_body(), load_robot()
    acceleration, rate = vibration(np.random.default_rng(0), body, robot)
    moving = (body.t > 3) & (body.t < 8)
    along = acceleration[moving, 0]
    assert 0.6 * robot.imu.vibration < along.std() < 1.6 * robot.imu.vibration
    assert np.abs(DT * acceleration.sum(axis=0)).max() < 1e-5
    assert np.abs(DT * rate.sum(axis=0)).max() < 1e-6
    assert np.abs(DT * np.cumsum(acceleration[:, 0])).max() < 0.02
    assert not acceleration[body.t < 0.9].any()
    power = np.abs(np.fft.rfft(along * np.hanning(along.size))) ** 2
    frequency = np.fft.rfftfreq(along.size, DT)
    assert 20 < frequency[power.argmax()] < 30
    assert power[frequency < 3].sum() < 0.01 * power.sum()


def test_errors_have_the_size_of_the_grade() -> None:
    for name in ("industrial", "consumer"):
        grade = load_grade(name)
        drawn = [generate(seed, grade=name, duration=1.0) for seed in range(40)]
        bias = np.array([truth.accel_bias for truth in drawn]).ravel()
        assert bias.std() == pytest.approx(grade.accel_bias, rel=0.25)
        noise = np.mean([t.trial.imu.angular_rate[t.trial.imu.t < 1.9].std(axis=0) for t in drawn])
        assert noise == pytest.approx(grade.gyro_noise * np.sqrt(grade.rate / 2), rel=0.05)
        tilt = np.array([np.degrees(truth.mounting[0, 2]) for truth in drawn])
        assert tilt.std() == pytest.approx(load_robot().imu.tilt, rel=0.35)


def test_sensors_do_not_change_the_motion() -> None:
    one, other = generate(7, grade="industrial"), generate(7, grade="consumer", clock_offset=0.1)
    assert np.array_equal(one.v, other.v)
    assert not np.array_equal(generate(8).v, one.v)


@pytest.mark.parametrize("offset", [-0.2, 0.05])
def test_encoder_stamps_lie_behind_by_the_clock_offset(offset: float) -> None:
    truth = generate(5, clock_offset=offset)
    wheels = truth.trial.wheels
    rolled = rolled_by(truth.v_wheel[:, 0])
    expected = np.interp(wheels.t + offset, truth.t, rolled)
    assert np.abs(wheels.angle[:, 0] - expected).max() < 4e-3
    assert (np.diff(wheels.t) > 0).all()
    steps = wheels.angle / wheels.step
    assert np.abs(steps - np.round(steps)).max() < 1e-6


def test_rotation_turns_axes_not_vectors() -> None:
    quarter = np.pi / 2
    # axes turned nose down: what pointed forward in the robot points up (z) in the sensor
    assert rotation(0, quarter, 0) @ [1, 0, 0] == pytest.approx([0, 0, 1], abs=1e-12)
    assert rotation(0, 0, quarter) @ [0, 1, 0] == pytest.approx([1, 0, 0], abs=1e-12)
    assert rotation(quarter, 0, 0) @ [0, 0, 1] == pytest.approx([0, 1, 0], abs=1e-12)


def test_faults_that_no_warning_tells_of() -> None:
    trial = generate(11, velocity=0.5, duration=3.0, still=(1.0, 1.0)).trial
    angle, t = trial.wheels.angle, trial.imu.t
    assert np.array_equal(faults.swapped(trial, "fl", "rr").wheels.angle, angle[:, [3, 1, 2, 0]])
    assert faults.random_dropouts(trial, 1, 0.2).imu.t.size == pytest.approx(0.8 * t.size, rel=0.1)
    assert np.diff(faults.wheel_dropout(trial, 2.0, 2.3).wheels.t).max() > 0.29
    assert np.diff(faults.imu_dropout(trial, 0.5, 0.8).imu.t).max() > 0.29
    assert faults.shifted_time(trial, 1.7e9).imu.t == pytest.approx(t + 1.7e9)
    short = faults.cut(trial, 2.0, 3.0)
    assert 2.0 <= short.imu.t[0] < short.imu.t[-1] <= 3.0
    assert not short.wheels.angle[0].any()
    assert short.wheels.angle[-1] == pytest.approx(5.2, abs=0.2)
