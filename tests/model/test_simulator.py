"""The simulator agrees with the independent implementation in tests.truth, conserves and knows its limits."""

import dataclasses
from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import welch

from granite_lab.errors import InputError
from granite_lab.model import Accuracy, Run, command, simulate
from granite_lab.model.virtual import virtual_trial
from granite_lab.parameters import (
    GRAVITY,
    Variant,
    load_paper,
    load_robot,
    load_soil,
    load_variants,
    variant_of,
)
from tests.model.box import ROBOT, SOIL, in_parts, near
from tests.soak import in_turn, sampled
from tests.truth.simulator import Result
from tests.truth.simulator import simulate as reference
from tests.truth.trials import quiet


def run_of(variant: Variant, **options: object) -> Run:
    return simulate(variant, ROBOT, SOIL, **options)


@pytest.mark.parametrize("options", [{"k92": 0.1}, {"a_theta": 4.919}, {"k92": 1.0}])
def test_a_robot_at_rest_neither_creeps_nor_drifts(options: dict[str, float]) -> None:
    still = Variant(velocity=0.3, acceleration=1.2, distance=2.0)
    run = run_of(still, **options)
    before = run.t < 0
    assert np.abs(run["x_m"][before]).max() < 1e-9
    assert np.abs(run["v_mps"][before]).max() < 1e-9
    assert np.ptp(run["pitch_rad"][before]) < 1e-9
    assert abs(run["v_mps"][-1]) < 2e-4  # coasting out, (26) cannot brake


def test_slip_grows_as_the_rear_contact_angle_shrinks() -> None:
    slips = [run_of(variant_of(0.3), k92=k).slip_ratio for k in (1.0, 0.6, 0.3, 0.1, 0.0)]
    assert all(a < b for a, b in pairwise(slips))


def test_a_robot_without_chassis_cannot_be_simulated() -> None:
    bare = dataclasses.replace(ROBOT, chassis=None)
    with pytest.raises(InputError, match=r"no \[chassis\] table"):
        simulate(variant_of(0.3), bare, SOIL)


Array = npt.NDArray[np.float64]

AFTER = 1.5
"""Time after the command's end that is compared [s]."""

PUBLISHED = {row.velocity: row.k92 for row in load_paper().table3}

CASES = sampled(in_turn(sorted(PUBLISHED), ("constant", "exponential")))

# tolerance as a share of the signal's peak: signal of the package, signal of the reference
BOTH_AXLES = {
    2e-4: {"theta_{}_rad": "angle"}, 1e-3: {"sinkage_{}_m": "sinkage"},
    2e-3: {"omega_{}_radps": "omega", "v_wheel_{}_mps": "v_o"},
    1e-2: {
        "slip_{}": "slip", "load_{}_N": "W", "resistance_{}_N": "R", "thrust_{}_N": "F",
        "force_z_{}_N": "normal", "moment_{}_Nm": "M", "torque_{}_Nm": "torque",
        "current_{}_A": "current", "voltage_{}_V": "voltage",
    },
}  # fmt: skip
WHOLE_ROBOT = {
    1e-9: {"k92": "k92", "v_desired_mps": "v_d", "s_desired_m": "s_d"}, 5e-3: {"pitch_rad": "pitch"}
}  # fmt: skip


def law_of(velocity: float, law: str) -> dict[str, float]:
    return {"k92": PUBLISHED[velocity]} if law == "constant" else {"a_theta": load_paper().a_theta}


@lru_cache
def both(velocity: float, law: str) -> tuple[Run, Result]:
    variant, chosen = variant_of(velocity), law_of(velocity, law)
    run = simulate(variant, load_robot(), load_soil(), **chosen)
    return run, reference(variant, settle=0.5, after=AFTER, **chosen)


def difference(run: Run, name: str, truth: Result, values: Array) -> Array:
    """Package minus reference at the package's samples that both cover."""
    known = (run.t >= truth.t[0]) & (run.t <= truth.t[-1])
    assert run.t[known][-1] > truth.t[-1] - 0.01
    return np.asarray(run[name][known] - np.interp(run.t[known], truth.t, values))


@pytest.mark.parametrize(("velocity", "law"), CASES)
def test_every_signal_agrees(velocity: float, law: str) -> None:
    run, truth = both(velocity, law)
    assert np.abs(difference(run, "v_mps", truth, truth.v)).max() < 1e-4
    assert np.abs(difference(run, "x_m", truth, truth.x)).max() < 1e-4
    assert run.slip_ratio == pytest.approx(truth.slip_ratio(*run.steady), abs=1e-4)
    pairs = []
    for share, channels in WHOLE_ROBOT.items():
        pairs += [(name, np.asarray(getattr(truth, other)), share) for name, other in channels.items()]
    for share, channels in BOTH_AXLES.items():
        for name, other in channels.items():
            pairs += [(name.format(a), getattr(truth, other)[:, i], share) for i, a in enumerate("fr")]
    for name, values, share in pairs:
        assert np.abs(difference(run, name, truth, values)).max() < share * np.abs(values).max(), name


@pytest.mark.parametrize(("velocity", "law"), CASES)
def test_imu_feels_what_rigid_body_kinematics_says(velocity: float, law: str) -> None:
    run, truth = both(velocity, law)
    arm, s, c = load_robot().imu, np.sin(truth.pitch), np.cos(truth.pitch)
    q, dq = truth.pitch_rate, truth.pitch_acceleration
    along = truth.acceleration[:, 0] + dq * arm.z - q**2 * arm.x - GRAVITY * s
    up = truth.acceleration[:, 1] - dq * arm.x - q**2 * arm.z + GRAVITY * c
    # at the kinks of the command the acceleration changes within a sample
    for name, values in (("imu_ax_mps2", along), ("imu_az_mps2", up)):
        assert np.sqrt(np.mean(difference(run, name, truth, values) ** 2)) < 5e-3
    assert np.abs(difference(run, "imu_gy_radps", truth, q)).max() < 2e-4


@pytest.mark.parametrize("number", sampled(range(3)))
def test_other_robots_on_other_soils_agree_too(number: int) -> None:
    """No number of the paper's robot or sand is built in."""
    rng = np.random.default_rng([13, number])
    robot, soil = in_parts(ROBOT, lambda part: near(part, rng, 1.4)), near(SOIL, rng, 1.4)
    variant = Variant(velocity=0.4, acceleration=0.8, distance=0.9)
    run = simulate(variant, robot, soil, k92=0.2)
    truth = reference(variant, robot=robot, soil=soil, settle=0.5, after=AFTER, k92=0.2)
    assert truth.v.max() > 0.2
    assert np.abs(difference(run, "v_mps", truth, truth.v)).max() < 1e-4
    for i, axle in enumerate("fr"):
        torque = truth.torque[:, i]
        assert np.abs(difference(run, f"torque_{axle}_Nm", truth, torque)).max() < 0.01 * np.abs(torque).max()
    assert np.abs(difference(run, "pitch_rad", truth, truth.pitch)).max() < 2e-5


variants = st.builds(
    Variant, velocity=st.floats(0.05, 2.0), acceleration=st.floats(0.1, 5.0), distance=st.floats(0.1, 10.0)
)


def evaluate(function: object, variant: Variant, t: np.ndarray) -> np.ndarray:
    symbol = ca.SX.sym("t")
    return np.array(ca.Function("f", [symbol], [function(symbol, variant)])(t[None, :])).ravel()


@given(variants)
def test_distance_is_reached_exactly_as_integral_of_a_velocity_inside_its_bounds(variant: Variant) -> None:
    corners = [0.0, *command.steady_interval(variant), command.duration(variant)]
    t = np.unique(np.concatenate([corners, np.linspace(-1, corners[-1] + 1, 400)]))
    v = evaluate(command.desired_velocity, variant, t)
    s = evaluate(command.desired_distance, variant, t)
    assert s[0] == 0
    assert s[-1] == pytest.approx(variant.distance, rel=1e-9)
    assert (np.diff(s) >= -1e-12).all()
    assert v.min() >= 0
    assert v.max() <= variant.velocity * (1 + 1e-12)
    assert (np.abs(np.diff(v)) <= variant.acceleration * np.diff(t) + 1e-9).all()
    # the trapezoidal rule is exact between the corners of a trapezoid
    integral = np.concatenate([[0], np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t))])
    np.testing.assert_allclose(s, integral, atol=1e-9 * variant.distance)


@pytest.mark.parametrize("variant", load_variants())
def test_phases_follow_table_2(variant: Variant) -> None:
    ramp, brake = command.steady_interval(variant)
    assert ramp == pytest.approx(variant.velocity / variant.acceleration)
    end = command.duration(variant)
    assert end - brake == pytest.approx(ramp)
    t = np.array([-0.1, ramp / 2, (ramp + brake) / 2, brake + ramp / 2, end + 0.1])
    assert command.phase_of(t, variant) == ["rest", "accelerate", "steady", "brake", "rest"]


@given(variants)
def test_the_acceleration_jumps_at_the_corners_and_nowhere_else(variant: Variant) -> None:
    places = np.array(command.corners(variant))
    assert (np.diff(places) >= -1e-12).all()
    between = np.sort(np.concatenate([places, np.linspace(-0.5, places[-1] + 0.5, 60)]))
    level = evaluate(command.desired_velocity, variant, between)
    middle = evaluate(command.desired_velocity, variant, (between[1:] + between[:-1]) / 2)
    assert middle == pytest.approx((level[1:] + level[:-1]) / 2, abs=1e-9)


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(variant_of(0.5), load_robot(), load_soil(), accuracy=Accuracy(1e-6, 1e-8, 0.0025))


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


def test_stamps_rise_at_the_rate_and_white_noise_has_the_density_of_the_grade(run: Run) -> None:
    robot = dataclasses.replace(run.robot, imu=dataclasses.replace(run.robot.imu, vibration=0.0))
    trial, _ = virtual_trial(dataclasses.replace(run, robot=robot), 4, "x")
    sample_std = robot.imu_grade.accel_noise * np.sqrt(robot.imu_grade.rate)
    still = trial.imu.specific_force[trial.imu.t < 1.9, 1]
    assert still.std() == pytest.approx(sample_std, rel=0.15)
    for stream, rate in ((trial.imu, 200), (trial.wheels, 100), (trial.currents, 100)):
        assert (np.diff(stream.t) > 0).all()
        assert stream.t.size / np.ptp(stream.t) == pytest.approx(rate, rel=0.01)
