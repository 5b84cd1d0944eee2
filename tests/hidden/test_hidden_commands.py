"""Sticks and controllers of hidden sets: they are what they are said to be, and no log tells of them."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from granite_lab.api.hidden import hide
from granite_lab.errors import UsageError
from granite_lab.hidden.catalogue import model_of
from granite_lab.hidden.command import SLOWEST, Command, draw_stick, trapezoid
from granite_lab.hidden.controller import CONTROLLERS
from granite_lab.hidden.lab import bench
from granite_lab.hidden.making import make_set
from granite_lab.hidden.model import OMEGA, Setup
from granite_lab.hidden.parts import exponential_k92
from granite_lab.hidden.random_numbers import generator
from granite_lab.hidden.simulator import DT
from granite_lab.hidden.spec import Spec
from granite_lab.logs.trial import Trial
from granite_lab.parameters import Variant, load_robot, load_soil
from tests.truth.simulator import Result, integrate

SHORT = (Variant(velocity=0.3, acceleration=1.2, distance=0.4),)
STICK = Command("s1", (0.0, 0.5, 1.5, 2.0, 2.4, 3.0), (0.0, 0.4, 0.35, 0.0, 0.0, 0.0), (0.0, 3.0))
ROBOT = load_robot()


@lru_cache
def drawn() -> tuple[Command, ...]:
    return tuple(draw_stick(generator(1, k), 1, 0.5) for k in range(200))


def test_the_way_of_a_stick_is_the_integral_of_its_velocity() -> None:
    t = np.linspace(-0.5, 3.5, 8001)
    v = np.array([STICK.velocity(x) for x in t])
    way = np.array([STICK.position(x) for x in t])
    assert way == pytest.approx(np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2) * 5e-4]), abs=1e-6)
    assert way[-1] == STICK.distance == pytest.approx(0.1 + 0.375 + 0.0875)
    crossings = [x for x in STICK.corners(0.02) if x not in STICK.times]
    assert [STICK.velocity(x) for x in crossings] == pytest.approx([0.02, 0.02])


def test_sticks_begin_and_end_at_rest_change_their_speed_and_pause_now_and_then() -> None:
    for stick in drawn():
        v = np.array(stick.speeds)
        assert (v[0], v[-1]) == (0.0, 0.0)
        assert (np.diff(stick.times) > 0).all()
        assert ((v == 0) | ((v >= 0.8 * SLOWEST * 0.5) & (v <= 0.5 + 1e-9))).all()
        assert v.max() == pytest.approx(0.5, abs=0.076)  # the hand may drift from the fastest place
    pauses = np.mean([(np.array(s.speeds[1:-1]) == 0).any() for s in drawn()])
    levels = np.array([len({round(v, 2) for v in s.speeds}) for s in drawn()])
    assert 0.2 < pauses < 0.9
    assert (levels >= 3).mean() > 0.9
    assert len(set(drawn())) == len(drawn())


@lru_cache
def run_under(name: str, seed: int = 4) -> tuple[Result, dict[str, float]]:
    """Return a run of 0.4 m/s under a controller, "" for the paper's, and its gains."""
    gains = CONTROLLERS[name].drawn(generator(seed), ROBOT) if name else {}
    setup = Setup(ROBOT, load_soil(), exponential_k92(4.919), controller=name, gains=gains)
    truth = model_of((), setup, trapezoid(0.4, 1.2, 1.4), {})
    t = np.asarray(np.arange(-0.2, truth.command.end + 0.5, 0.0025))
    return integrate(truth, t, rtol=3e-5, atol=1e-6), gains


@pytest.mark.parametrize(("name", "behind"), [("limited", 0.01), ("cascade", 0.01), ("feed_forward", -1.0)])
def test_integral_controllers_reach_the_speed_and_a_voltage_fed_forward_does_not(
    name: str, behind: float
) -> None:
    r, _ = run_under(name)
    late = (r.t > 2.9) & (r.t < 3.4)
    off = 1 - float(r.state[late][:, OMEGA].mean()) * ROBOT.wheels.radius / 0.4
    if behind > 0:
        assert abs(off) < behind
    else:
        assert 0.01 < off < 0.3


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
def test_another_controller_turns_the_wheels_in_another_way_and_comes_to_rest(name: str) -> None:
    own, paper = run_under(name)[0], run_under("")[0]
    apart = (own.state[:, OMEGA] - paper.state[:, OMEGA]) * ROBOT.wheels.radius
    assert np.abs(apart).max() > 0.005
    assert np.abs(own.state[-1, OMEGA]).max() * ROBOT.wheels.radius < 0.03


@pytest.mark.parametrize("name", ["limited", "cascade"])
def test_a_current_keeps_to_its_limit(name: str) -> None:
    gains = CONTROLLERS[name].drawn(generator(4), ROBOT) | {"current": 2.5}
    setup = Setup(ROBOT, load_soil(), exponential_k92(4.919), controller=name, gains=gains)
    truth = model_of((), setup, trapezoid(0.4, 2.4, 0.6), {})
    r = integrate(truth, np.asarray(np.arange(-0.1, truth.command.end, 0.0025)), rtol=3e-5, atol=1e-6)
    assert 2.4 < r.current.max() < 2.55
    assert (r.current.max(axis=1) > 2.35).sum() > 10  # it limits, for a while


@lru_cache
def trials(command: str, *, logged: bool) -> tuple[tuple[Trial, ...], dict[str, object]]:
    spec = Spec(
        "none", 5, repetitions=2, variants=SHORT, command=command, logged=logged, controller="unknown"
    )
    made, answer = make_set(spec, bench(ROBOT, load_soil()))
    return tuple(trial for trial, _ in made), answer


def test_a_recorded_stick_is_repeated_and_a_joystick_is_not() -> None:
    recorded, joystick = (trials(command, logged=True)[0] for command in ("recorded", "joystick"))
    for pair, same in ((recorded, True), (joystick, False)):
        assert [t.name for t in pair] == ["hidden_s1_r1", "hidden_s1_r2"]
        first, second = (np.trim_zeros(t.command.value) for t in pair)  # type: ignore[union-attr]
        n = min(first.size, second.size)
        assert (np.abs(first[:n] - second[:n]).max() < 0.05) == same


def test_a_log_tells_of_a_stick_by_its_column_alone() -> None:
    for logged in (True, False):
        made, answer = trials("joystick", logged=logged)
        assert answer["controller"]["id"] in CONTROLLERS  # type: ignore[index]
        for trial in made:
            info = trial.info
            assert (info.v_desired, info.a_max, info.distance, info.command) == (None,) * 4
            assert (trial.command is not None) == logged
            assert info.robot == "granite"


def test_the_logged_command_is_in_time_with_the_wheels() -> None:
    (trial, _), _ = trials("recorded", logged=True)
    assert trial.command is not None
    assert trial.wheels is not None
    rolled = np.gradient(trial.wheels.angle.mean(axis=1), trial.wheels.t) * ROBOT.wheels.radius
    wanted = np.interp(trial.wheels.t, trial.command.t, trial.command.value)
    later = [float(np.corrcoef(np.roll(wanted, k), rolled)[0, 1]) for k in range(-50, 51)]
    assert 0 <= int(np.argmax(later)) - 50 < 40  # the wheels follow by 0.4 s at most, and never lead
    assert max(later) > 0.9
    assert set(np.round(np.diff(trial.command.t), 1)) == {0.0}
    assert np.median(np.diff(trial.command.t)) == pytest.approx(0.02, abs=0.002)


def test_true_slip_of_a_stick_is_that_of_its_whole_run() -> None:
    spec = Spec("none", 5, repetitions=1, variants=SHORT, command="joystick")
    ((_, motion),), _ = make_set(spec, bench(ROBOT, load_soil()))
    rolled = float((motion["v_wheel_f_mps"] + motion["v_wheel_r_mps"]).sum() / 2 * 5 * DT)
    assert motion.attrs["slip_ratio"] == pytest.approx(1 - motion["x_m"].iloc[-1] / rolled, abs=0.01)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"command": "joystik"}, "unknown command 'joystik'"),
        ({"controller": "pid"}, "unknown controller 'pid'"),
    ],
)
def test_commands_and_controllers_that_are_not_known_are_refused(
    given: dict[str, str], said: str, tmp_path: object
) -> None:
    with pytest.raises(UsageError, match=said):
        hide("none", str(tmp_path), **given)  # type: ignore[arg-type]


def test_the_gains_fit_a_robot_of_other_measures() -> None:
    assert ROBOT.chassis is not None
    heavy = replace(ROBOT, chassis=replace(ROBOT.chassis, body_mass=4 * ROBOT.chassis.body_mass))
    for name in ("limited", "cascade"):
        small, large = (CONTROLLERS[name].drawn(generator(9), robot) for robot in (ROBOT, heavy))
        assert large["current"] / small["current"] == pytest.approx(
            heavy.chassis.total_mass / ROBOT.chassis.total_mass  # type: ignore[union-attr]
        )
        assert large["p"] > small["p"]
