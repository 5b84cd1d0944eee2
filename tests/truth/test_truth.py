"""The truth generator and the reference implementation: kinematics that close, figures that are published."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from benchmarks import rk4
from granite_lab.hidden.contact import Stance, contact, slip_ratio
from granite_lab.hidden.sensors import Logger, rotation, vibration
from granite_lab.hidden.simulator import DT
from granite_lab.parameters import GRAVITY, Variant, load_grade, load_robot, load_soil, variant_of
from tests.soak import sampled, whole
from tests.truth import faults, generate
from tests.truth.simulator import Result, build, forces, simulate
from tests.truth.trials import quiet


@pytest.mark.parametrize("seed", range(3))
def test_faultless_readings_integrate_back_to_the_truth(seed: int) -> None:
    faultless = quiet(load_robot())
    exact = Logger(jitter=0.0, gain=0.0)
    truth = generate(seed, velocity=0.7, robot=faultless, logger=exact, wobble=0.0)
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
    body, robot = generate(1, velocity=0.5, still=(1.0, 1.0)).body, load_robot()
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


def test_errors_have_the_size_of_the_grade_and_leave_the_motion() -> None:
    one, other = generate(7, grade="industrial"), generate(7, grade="consumer", clock_offset=0.1)
    assert np.array_equal(one.v, other.v)
    assert not np.array_equal(generate(8).v, one.v)
    for name in ("industrial", "consumer"):
        grade, rig = load_grade(name), load_robot("granite", name)
        drawn = [generate(seed, grade=name, robot=rig, duration=0.6, still=(1.0, 0.1)) for seed in range(40)]
        bias = np.array([truth.accel_bias for truth in drawn]).ravel()
        assert bias.std() == pytest.approx(grade.accel_bias, rel=0.25)
        noise = np.mean([t.trial.imu.angular_rate[t.trial.imu.t < 0.9].std(axis=0) for t in drawn])
        assert noise == pytest.approx(grade.gyro_noise * np.sqrt(grade.rate / 2), rel=0.05)
        tilt = np.array([np.degrees(truth.mounting[0, 2]) for truth in drawn])
        assert tilt.std() == pytest.approx(load_robot().imu.tilt, rel=0.35)


@pytest.mark.parametrize("offset", [-0.2, 0.05])
def test_encoder_stamps_lie_behind_by_the_clock_offset(offset: float) -> None:
    truth = generate(5, clock_offset=offset)
    wheels = truth.trial.wheels
    v = truth.v_wheel[:, 0]
    rolled = (np.cumsum(v) - 0.5 * (v + v[0])) * DT / 0.0965  # by the trapezoidal rule
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


SETTLED = {0.2: (0.33, 5.47), 0.3: (0.26, 8.17), 0.5: (0.111, 16.25), 0.7: (0.026, 23.12)}
"""Velocity: constant k_92 of Table 3, settled λ_R [%] of the model."""
SINKAGE = {0.2: (15.0, 16.1), 0.7: (18.5, 19.9)}
"""Velocity: settled sinkage of the front and rear wheels [mm]."""

SPEEDS = sorted(SETTLED)


@lru_cache
def run(velocity: float) -> Result:
    return simulate(variant_of(velocity), k92=SETTLED[velocity][0])


def steady(velocity: float) -> tuple[float, float]:
    """Second half of the part with constant desired velocity."""
    command = build(variant_of(velocity), k92=1.0).command
    return command.measured


@pytest.mark.parametrize("velocity", sampled(SPEEDS, 3))
def test_settled_slip_ratio_and_sinkage_are_the_known_ones(velocity: float) -> None:
    k92, percent = SETTLED[velocity]
    assert 100 * run(velocity).slip_ratio(*steady(velocity)) == pytest.approx(percent, abs=0.006)
    cruising, finer = (build(variant_of(velocity), k92=k92, intervals=n).cruise()[1] for n in (32, 512))
    assert cruising == pytest.approx(percent / 100, abs=7e-5)
    assert cruising == pytest.approx(finer, abs=1e-9)  # the quadrature on the arc has converged
    if velocity in SINKAGE:
        sinkage = run(velocity).at(steady(velocity)[1], "sinkage") * 1e3
        assert sinkage == pytest.approx(SINKAGE[velocity], abs=0.051)


@pytest.mark.parametrize(
    ("v_o", "v", "harden", "radius"),
    [(0.3, 0.25, 0, None), (0.1, 0.2, 0, None), (0.5, -0.1, 0, None), (0.01, 0.004, 0, None),
     (0.2, 0.0, 0, None), (0.5, 0.4, 0.4, 0.13)],
)  # fmt: skip
def test_forces_on_the_arc_match_quadrature(
    v_o: float, v: float, harden: float, radius: float | None
) -> None:
    ground, k92, z0 = replace(build(variant_of(0.5)).ground, harden=harden, harden_speed=0.02), 0.4, 0.017
    one = np.ones(1)
    at = Stance(v_o * one, v * one, z0 * one, 0.01 * one, None if radius is None else radius * one)
    c = contact(ground, at, k92, intervals=256)
    W, R, F, M = forces(
        load_robot().wheels, load_soil(), v_o=v_o, v=v, z=z0, k92=k92, harden=harden, radius=radius
    )
    assert c.W[0] == pytest.approx(W, rel=1e-5)
    assert c.normal[0] == pytest.approx(W + 0.01 * ground.c_t, rel=1e-5)
    assert c.R[0] == pytest.approx(R, rel=1e-5)
    assert c.F[0] == pytest.approx(F, rel=1e-4, abs=1e-4)
    assert c.M[0] == pytest.approx(M, rel=1e-4, abs=1e-5)


def test_no_force_without_contact_and_no_pull() -> None:
    truth = build(variant_of(0.3), k92=0.26)
    one = np.ones(2)
    lifted = contact(truth.ground, Stance(0.3 * one, 0.2 * one, -0.01 * one, one), 0.3)
    for force in (lifted.W, lifted.R, lifted.F, lifted.M, lifted.normal):
        assert not force.any()
    rising = contact(truth.ground, Stance(0.3 * one, 0.2 * one, 0.01 * one, -5 * one), 0.3)
    assert not rising.normal.any()


def test_slip_ratio_is_that_of_the_paper_above_the_floor_and_odd_in_its_arguments() -> None:
    v_o, v = np.array([0.3, 0.1, 0.5]), np.array([0.2, 0.4, -0.1])
    assert slip_ratio(v_o, v) == pytest.approx([1 / 3, -0.75, 1.2])
    assert slip_ratio(-v_o, -v) == pytest.approx(-slip_ratio(v_o, v))
    assert slip_ratio(np.zeros(1), np.zeros(1)) == 0.0


@whole
def test_the_papers_own_method_agrees() -> None:
    """Fixed-step Runge-Kutta at 0.05 ms, in the robot's axes: a third way to the same motion."""
    variant = Variant(velocity=0.5, acceleration=1.2, distance=0.25)
    fixed = rk4.simulate(variant, load_robot(), load_soil(), a_theta=4.919, settle=0.4, after=0.2)
    r = simulate(variant, a_theta=4.919, settle=0.2, after=0.2)
    both = (fixed.t > -0.2) & (fixed.t < r.t[-1])
    assert np.abs(fixed.v - np.interp(fixed.t, r.t, r.v))[both].max() < 1e-4
    current = np.interp(fixed.t, r.t, r.current[:, 1])
    assert np.abs(fixed.state[:, 11] - current)[both].max() < 2e-3 * np.abs(current).max()
    assert np.abs(fixed.state[:, 2] - np.interp(fixed.t, r.t, r.pitch))[both].max() < 1e-5
