"""Runs along any desired velocity, and runs whose wheels turn as they were measured."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from granite_lab.effects import get, library
from granite_lab.errors import InputError
from granite_lab.fitting.drive import drives
from granite_lab.model import Accuracy, Run, interpreted, simulate
from granite_lab.model.command import alike, corners, duration, kind_of, path_of, phase_of
from granite_lab.model.contact import WheelForces, WheelState, contact_angles, wheel_forces
from granite_lab.model.effect import Active, activate
from granite_lab.model.engine import engine_of
from granite_lab.model.instants import instants
from granite_lab.model.pieces import NUMBERS, numbers_at, pieces, spin
from granite_lab.model.simulator import parameter_vector, rest_state
from granite_lab.model.symbols import model_parameters
from granite_lab.model.turning import turned
from granite_lab.parameters import Course, Variant, course_of, load_variants, parse_path, variant_of
from tests.model.box import ROBOT, SOIL
from tests.soak import sampled

JOYSTICK = course_of(
    np.array([0.0, 0.6, 2.0, 2.4, 4.0, 5.5, 6.0]), np.array([0.0, 0.45, 0.45, 0.2, 0.3, 0.6, 0.0])
)


def as_course(variant: Variant) -> Course:
    return course_of(*path_of(variant))


def fed_back(run: Run, command: Course | None, effects: tuple[Active, ...] = ()) -> Run:
    """Simulate the wheels of a run; None: their own speed is what k_92 goes by."""
    use = run.t >= 0
    v = tuple(run[f"v_wheel_{axle}_mps"][use] for axle in "fr")
    std = tuple(np.zeros(use.sum()) for _ in "fr")
    course = turned(run.t[use], v, std, ROBOT.wheels.radius, stretch=run.steady, command=command)
    return simulate(course, ROBOT, SOIL, effects=effects)


def apart(one: Run, other: Run, name: str) -> float:
    """Return the rms difference over the rms of the other."""
    gap = np.interp(other.t, one.t, one[name]) - other[name]
    return float(np.sqrt(np.mean(gap**2) / np.mean(other[name] ** 2)))


@pytest.mark.parametrize("variant", sampled(load_variants()), ids=str)
def test_a_trapezoid_given_as_a_list_is_the_same_run(variant: Variant) -> None:
    plain, listed = simulate(variant, ROBOT, SOIL), simulate(as_course(variant), ROBOT, SOIL)
    for name, within in (("v_mps", 1e-9), ("current_f_A", 1e-6), ("s_desired_m", 1e-9), ("k92", 1e-9)):
        assert np.interp(plain.t, listed.t, listed[name]) == pytest.approx(plain[name], abs=within), name


@pytest.mark.parametrize(
    "command", sampled([*map(as_course, load_variants()), JOYSTICK], 4), ids=lambda c: f"{c.peak}"
)
def test_wheels_of_a_run_fed_back_give_its_velocity_and_its_torques(command: Course) -> None:
    run = simulate(command, ROBOT, SOIL)
    back = fed_back(run, command)
    v = np.interp(run.t, back.t, back["v_mps"]) - run["v_mps"]
    assert np.sqrt(np.mean(v**2)) < 1e-4  # m/s
    assert max(apart(back, run, f"torque_{axle}_Nm") for axle in "fr") < 0.01
    assert max(apart(back, run, f"current_{axle}_A") for axle in "fr") < 0.01
    assert back.slip_ratio == pytest.approx(run.slip_ratio, abs=1e-4)
    part = np.linspace(*run.steady, 2000)
    v_d = command.velocity_at(part)
    assert back.variant.velocity == pytest.approx(np.sum(v_d**2) / np.sum(v_d), rel=0.005)


@pytest.mark.parametrize(
    ("id_", "values"),
    sampled([
        ("drivetrain_friction", {"coulomb": 1.0, "viscous": 0.1}),
        ("tyre_windup", {"compliance": 2e-3}),
        ("drive_reaction", {"share": 1.0}),
        ("torque_constant_error", {"error": 0.1}),
    ], 4),
)  # fmt: skip
def test_currents_and_motion_come_back_with_an_effect_between_motor_and_ground(
    id_: str, values: dict[str, float]
) -> None:
    effect = (activate(get(id_), values),)
    run = simulate(JOYSTICK, ROBOT, SOIL, effects=effect)
    back, without = fed_back(run, JOYSTICK, effect), fed_back(run, JOYSTICK)
    names = ("v_mps", "current_f_A", "current_r_A")
    assert max(apart(back, run, name) for name in names) < 0.01
    assert max(apart(without, run, name) for name in names) > 0.01


def test_without_a_command_k92_follows_the_wheels() -> None:
    run = simulate(as_course(variant_of(0.5)), ROBOT, SOIL)
    back = fed_back(run, None)
    mean = (back["v_wheel_f_mps"] + back["v_wheel_r_mps"]) / 2
    assert back["v_desired_mps"] == pytest.approx(mean, abs=0.005)
    assert back["k92"] == pytest.approx(
        np.exp(-back.k92_value * np.maximum(back["v_desired_mps"], 0)), rel=1e-9
    )


def by_sides(share: float) -> Course:
    """Return wheels of which the front right one is a share faster than the mean, the rear one half of it."""
    t = np.linspace(0, 6.5, 400)
    v = np.interp(t, *JOYSTICK.corners)
    std, split = (np.full(400, 1e-3),) * 2, (share * v, 0.5 * share * v)
    return turned(t, (v, 0.97 * v), std, ROBOT.wheels.radius, split=split if share else None)


@pytest.mark.parametrize("axle", ["f", "r"])
def test_each_side_has_the_forces_of_its_own_slip(axle: str) -> None:
    """The forces of a pair are those of two single wheels of one velocity and one sinkage."""
    course = by_sides(0.1)
    run = simulate(course, ROBOT, SOIL)
    k = int(np.argmin(np.abs(run.t - 3.2)))
    at = {name: float(signal[k]) for name, signal in run.signals.items()}
    numbers = dict(zip(NUMBERS["sides"], numbers_at(run.t[[k]], course)[:, 0].tolist(), strict=True))
    half, rate = spin(at["t_s"], numbers, f"split_{axle}").rate, at[f"omega_{axle}_radps"]
    assert half == pytest.approx((0.1 if axle == "f" else 0.05) * rate, rel=0.05)

    def forces(rate: float) -> WheelForces:
        wheel = WheelState(
            axle == "f", 0.0, 0.0, rate, rate, at["v_mps"], at[f"sinkage_{axle}_m"], 0.0,
            ROBOT.wheels.radius, ROBOT.wheels.width, at["v_desired_mps"],
        )  # fmt: skip
        return wheel_forces(wheel, contact_angles(wheel, at["k92"]), SOIL, 0.0)

    left, right, alike = (forces(rate + sign * half) for sign in (-1, 1, 0))
    for name, unit in (("thrust", "N"), ("resistance", "N"), ("moment", "Nm")):
        mean = float(getattr(left, name) + getattr(right, name)) / 2
        assert at[f"{name}_{axle}_{unit}"] == pytest.approx(mean, rel=1e-3)
    assert float(left.thrust + right.thrust) < 1.98 * float(alike.thrust)  # (11) is concave


def test_sides_that_hardly_differ_are_one_contact() -> None:
    alike, apart_ = (simulate(by_sides(share), ROBOT, SOIL) for share in (0.0, 5e-5))
    assert kind_of(alike.variant) == "wheels"
    assert kind_of(apart_.variant) == "sides"
    for name in ("v_mps", "current_f_A", "theta_r_rad", "slip_f"):
        assert np.interp(alike.t, apart_.t, apart_[name]) == pytest.approx(alike[name], abs=2e-5), name


@pytest.mark.parametrize("kind", ["path", "wheels", "sides"])
def test_both_engines_agree(kind: str) -> None:
    course = JOYSTICK if kind == "path" else by_sides(0.05 if kind == "sides" else 0.0)
    p = model_parameters(ROBOT, SOIL, course, a_theta=4.919)
    fine, start, vector = Accuracy(1e-8, 1e-10), rest_state(p), parameter_vector(p, ())
    engine = engine_of((), kind)
    assert engine is not interpreted
    a, b = (e.run((), course, fine, start, vector)[0] for e in (engine, interpreted))
    assert np.abs(a - b).max() < 2e-5
    t = instants(course, fine)
    a, b = (
        e.outputs((), course, ("v_mps", "current_f_A", "k92"), t, b, vector) for e in (engine, interpreted)
    )
    assert a == pytest.approx(b, abs=1e-9)


def test_a_robot_without_drive_is_simulated_by_its_wheels() -> None:
    run = simulate(JOYSTICK, ROBOT, SOIL)
    bare = dataclasses.replace(ROBOT, drive=None)
    with pytest.raises(InputError, match=r"no \[drive\] table"):
        simulate(JOYSTICK, bare, SOIL)
    back = fed_back(run, JOYSTICK)
    alone = simulate(back.variant, bare, SOIL)
    assert alone["torque_f_Nm"] == pytest.approx(back["torque_f_Nm"], rel=1e-9, abs=1e-9)
    assert alone["v_mps"] == pytest.approx(back["v_mps"], abs=1e-12)


def test_effects_that_do_not_act_on_the_drive_run_and_vanish_at_their_neutral_value() -> None:
    plain = fed_back(simulate(JOYSTICK, ROBOT, SOIL), JOYSTICK)
    left = [e for e in library(None).values() if not drives(e)]
    assert {e.id for e in library(None).values()} - {e.id for e in left} == {
        "encoder_eccentricity", "gear_backlash", "supply_sag", "wheel_radius_error",
    }  # fmt: skip
    for effect in sampled(left, 5):
        run = simulate(plain.variant, ROBOT, SOIL, effects=(activate(effect, {}),))
        assert np.abs(run["v_mps"] - plain["v_mps"]).max() < 2e-4, effect.id


def test_the_numbers_of_a_piece_give_the_path_and_its_way() -> None:
    t = np.linspace(-0.5, 7.0, 800)
    table = pieces(JOYSTICK)[1]
    assert len(table) == len(JOYSTICK.path) + 1
    run = simulate(JOYSTICK, ROBOT, SOIL)
    assert np.interp(t, run.t, run["v_desired_mps"]) == pytest.approx(JOYSTICK.velocity_at(t), abs=0.01)
    assert np.interp(t, run.t, run["s_desired_m"]) == pytest.approx(JOYSTICK.distance_at(t), abs=0.002)
    fine = np.linspace(0, JOYSTICK.end, 20001)
    assert JOYSTICK.distance == pytest.approx(np.trapezoid(JOYSTICK.velocity_at(fine), fine), abs=1e-6)


@given(st.lists(st.floats(0, 1), min_size=3, max_size=60), st.floats(0.01, 0.5))
def test_a_course_passes_all_points_within_a_millimetre_a_second(speeds: list[float], period: float) -> None:
    t, v = period * np.arange(len(speeds)), np.array(speeds)
    v[1] = max(v[1], 0.01)
    assert course_of(t, v).velocity_at(t) == pytest.approx(v, abs=0.001)


def test_repetitions_are_commands_that_differ_by_little() -> None:
    again = course_of(np.array([t for t, _ in JOYSTICK.path]), 1.01 * np.array([v for _, v in JOYSTICK.path]))
    other = course_of(np.array([t for t, _ in JOYSTICK.path]), 1.05 * np.array([v for _, v in JOYSTICK.path]))
    assert alike(JOYSTICK, again)
    assert not alike(JOYSTICK, other)
    assert not alike(variant_of(0.2), variant_of(0.3))
    assert duration(again) == duration(JOYSTICK)


def test_phases_of_a_course_are_those_of_its_trapezoid_but_for_the_corners() -> None:
    variant = variant_of(0.5)
    t = np.linspace(-1, duration(variant) + 1, 500)
    same = np.array(phase_of(t, as_course(variant))) == np.array(phase_of(t, variant))
    assert same[np.min(np.abs(t[:, None] - corners(variant)), axis=1) > 0.15].all()


@pytest.mark.parametrize("text", ["", "0:0", "0:0 0:1", "1:0 0:1", "0:0 1:nan", "0 1", "a:b c:d"])
def test_what_is_no_list_of_times_and_velocities_is_refused(text: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        parse_path(text)
    assert parse_path("0:0, 1:0.3 2.5:0") == ((0.0, 0.0), (1.0, 0.3), (2.5, 0.0))
