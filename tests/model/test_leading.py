"""A command that nobody states leads its wheels: what (26) says, and a second way to integrate it."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from granite_lab.inference.pool import ACCURACY, SAND, Scenario
from granite_lab.model import simulate
from granite_lab.model.command import kind_of
from granite_lab.model.instants import instants
from granite_lab.model.leading import LASTING, is_free, lasting_of, led
from granite_lab.model.pieces import NUMBERS, numbers_at, spin
from granite_lab.model.turning import turned
from granite_lab.parameters import Course, course_of, variant_of
from tests.model.box import ROBOT, SOIL

RADIUS = ROBOT.wheels.radius
STICK = course_of(
    np.array([0.0, 0.6, 2.0, 2.4, 4.0, 4.6, 5.2]), np.array([0.0, 0.45, 0.45, 0.2, 0.3, 0.3, 0.0])
)


def free(t: np.ndarray, v: np.ndarray) -> Course:
    """Return wheels that turn at v [m/s], with a command that nobody states."""
    return turned(t, (v, v), (np.zeros(t.size), np.zeros(t.size)), RADIUS)


def test_the_lead_is_what_a_differential_equation_gives() -> None:
    t = np.arange(0, 4.0025, 0.005)
    speed, rise = 0.2 * (1 - np.cos(np.pi * t / 2)), 0.1 * np.pi * np.sin(np.pi * t / 2)
    late = solve_ivp(
        lambda x, y: (0.1 * np.pi * np.sin(np.pi * x / 2) - y) / lasting_of(ROBOT), (0, t[-1]), [0.0],
        t_eval=t, rtol=1e-8, atol=1e-10,
    ).y[0]  # fmt: skip
    course = led(free(t, speed), (0.03, 0.2), ROBOT)
    wanted = speed + 0.03 * rise + 0.2 * late
    assert course.velocity == free(t, speed).velocity  # that of the slip stays
    assert isinstance(course, Course)
    at, v = course.corners  # where the wheels are told, it is linear in between
    assert v[1:-1] == pytest.approx(np.interp(at, t, wanted)[1:-1], abs=1e-3)  # of paths, by `ENOUGH`


def test_the_paper_s_controller_leads_as_its_gains_say() -> None:
    """Of the speeds that the EMF needs, (24), the loop (26) leaves k_e n_d / k_P of the acceleration."""
    assert ROBOT.drive is not None
    run = simulate(STICK, ROBOT, SOIL)
    use = run.t >= 0
    t, axles = run.t[use], [run[f"v_wheel_{axle}_mps"][use] for axle in "fr"]
    wheels = turned(t, (axles[0], axles[1]), (np.zeros(t.size), np.zeros(t.size)), RADIUS)
    lasting = ROBOT.drive.emf_constant * ROBOT.drive.gear_ratio / ROBOT.drive.gain_p
    course = led(wheels, (0.0, lasting), ROBOT)
    assert isinstance(course, Course)
    moving = (t > 0.3) & (t < 5.0)
    behind, left = (
        float(np.std((STICK.velocity_at(t) - c.velocity_at(t))[moving])) for c in (wheels, course)
    )
    assert left < 0.2 * behind
    gaps = []
    for c in (wheels, course):
        back = simulate(c, ROBOT, SOIL)
        gaps.append(float(np.std((np.interp(t, back.t, back["v_mps"]) - run["v_mps"][use])[moving])))
    assert gaps[1] < 0.3 * gaps[0]


def test_the_lasting_lead_goes_by_the_gains_of_the_robot_s_file() -> None:
    assert ROBOT.drive is not None
    assert lasting_of(ROBOT) == LASTING == pytest.approx(ROBOT.drive.gain_d / ROBOT.drive.gain_p)
    slower = dataclasses.replace(ROBOT, drive=dataclasses.replace(ROBOT.drive, gain_p=10.0))
    assert lasting_of(slower) == pytest.approx(1.0)
    speed_loop = dataclasses.replace(ROBOT, drive=dataclasses.replace(ROBOT.drive, gain_p=0.0))
    for unstated in (speed_loop, dataclasses.replace(ROBOT, drive=None)):
        assert lasting_of(unstated) == LASTING
    t = np.arange(0, 4.0025, 0.005)
    wheels = free(t, 0.2 * (1 - np.cos(np.pi * t / 2)))
    ways = [led(wheels, (0.0, 0.2), robot) for robot in (ROBOT, slower)]
    ahead = [np.abs(way.velocity_at(t) - wheels.velocity_at(t)).max() for way in ways]  # type: ignore[attr-defined]
    assert ahead[1] < 0.8 * ahead[0]  # a slower loop lets less of the acceleration through


@pytest.mark.parametrize("split", [0.0, 0.1])
def test_a_command_that_only_the_wheels_date_is_led_as_a_whole(split: float) -> None:
    t = np.arange(-0.2, 5.4, 0.005)
    v, still = STICK.velocity_at(t), np.zeros(t.size)
    apart = (split * v, split * v) if split else None
    asked = dataclasses.replace(STICK, stamped=False)
    wheels = turned(t, (v, 0.97 * v), (still, still), RADIUS, command=asked, split=apart)
    course = led(wheels, (0.03, 0.2), ROBOT)
    assert isinstance(course, Course)
    assert course.velocity_at(t) == pytest.approx(STICK.velocity_at(t + 0.03), abs=1e-9)
    names = NUMBERS[kind_of(wheels)]
    for axle in ("f", "r", *(("split_f", "split_r") if split else ())):
        before, after = (
            spin(t, dict(zip(names, numbers_at(t, c), strict=True)), axle) for c in (wheels, course)
        )
        assert after.angle == pytest.approx(before.angle, abs=1e-5)  # instants are rounded to 1e-6 s
        assert after.rate == pytest.approx(before.rate, abs=1e-4)
    task = Scenario(ROBOT, SOIL, (wheels,), {}).task(0, np.append(np.zeros(len(SAND)), (0.03, 0.2)), ())
    assert task.leads == (0.03, 0.0)


@pytest.mark.parametrize("lead", [0.03, -0.03])
def test_a_command_that_outlasts_its_wheels_is_computed_at_the_same_instants(lead: float) -> None:
    """As for wheels that stand before the stated distance is driven."""
    t = np.arange(-0.2, 3.0, 0.005)
    v = 0.3 * np.sin(np.pi * np.clip(t / 2.8, 0, 1)) ** 2
    still = np.zeros(t.size)
    wheels = turned(t, (v, v), (still, still), RADIUS, command=dataclasses.replace(STICK, stamped=False))
    course = led(wheels, (lead, 0.0), ROBOT)
    assert isinstance(course, Course)
    assert np.array_equal(instants(course, ACCURACY), instants(wheels, ACCURACY))
    within = t[(t > 0.05) & (t < 2.9)]
    assert course.velocity_at(within) == pytest.approx(STICK.velocity_at(within + lead), abs=1e-9)


def test_what_was_commanded_is_not_led() -> None:
    t = np.arange(0, 4.0025, 0.005)
    wheels = free(t, 0.2 * (1 - np.cos(np.pi * t / 2)))
    stated = dataclasses.replace(wheels, commanded=True)
    assert is_free(wheels)
    for variant in (variant_of(0.3), STICK, stated):
        assert not is_free(variant)
        assert led(variant, (0.05, 0.1), ROBOT) is variant
    scenario = Scenario(ROBOT, SOIL, (wheels, stated), {})
    numbers = np.append(np.zeros(len(SAND)), (0.05, 0.1))
    tasks = [scenario.task(k, numbers, ()) for k in range(2)]
    assert tasks[0].leads == (0.05, 0.1)
    assert tasks[1] == scenario.task(1, 0 * numbers, ())  # one simulation, whatever the leads
    first, other = scenario.respond(tasks[0]), scenario.respond(scenario.task(0, 0 * numbers, ()))
    assert first is not None
    assert other is not None
    assert np.abs(first[7] - other[7]).max() > 1e-3
