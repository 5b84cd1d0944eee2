"""Conditions do to a simulated trial what they do to a robot, and a log says under which it was driven."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.effects import library
from granite_lab.errors import InputError
from granite_lab.inference.bench import ACCURACY, SAND, Setting, Task
from granite_lab.inference.conditions import PLAIN, STAGING, Conditions, StagedWorld, conditions_of
from granite_lab.logs.trial import Trial, TrialInfo
from granite_lab.model.instants import instants
from granite_lab.parameters import GRAVITY, Variant, load_robot, load_soil

ROBOT, SOIL = load_robot(), load_soil()
SLOW = Variant(velocity=0.3, acceleration=1.2, distance=0.9)
TURNED = Conditions(turned=True)


def steady(conditions: Conditions, setting: Setting = ()) -> np.ndarray:
    """What the sensors read at constant speed."""
    world = StagedWorld(ROBOT, SOIL, (SLOW,), library() | STAGING, conditions=(conditions,))
    response = world.respond(Task(0, (0.0,) * len(SAND), setting))
    return np.asarray(response[:, np.searchsorted(instants(SLOW, ACCURACY), 1.8)])


def test_a_raised_box_pulls_by_the_weight_times_the_sine_of_its_slope() -> None:
    up, down = (steady(Conditions(slope=s)) for s in (3.0, -3.0))
    assert up[0] - down[0] == pytest.approx(2 * GRAVITY * np.sin(np.radians(3)), rel=0.02)
    assert up[5] > steady(PLAIN)[5] > down[5]


def test_a_slope_changes_its_sign_for_a_robot_that_is_turned_round_and_nothing_else_does() -> None:
    slope = (("ground_slope", (2.0,)),)
    assert steady(PLAIN, slope)[0] > 0.2 > -0.2 > steady(TURNED, slope)[0]
    assert np.allclose(steady(TURNED), steady(PLAIN))


def test_wheels_in_the_air_need_the_friction_of_their_drives_alone() -> None:
    spun = steady(Conditions(wheels_up=True), (("drivetrain_friction", (1.0, 0.0, 0.005)),))
    drive = ROBOT.drive
    torque = drive.torque_constant * drive.gear_ratio * drive.gear_efficiency
    assert spun[5] == pytest.approx(1.0 / torque, rel=0.02)
    assert spun[:3] == pytest.approx([0, GRAVITY, 0], abs=1e-6)


def test_a_payload_costs_current() -> None:
    assert steady(Conditions(payload=5.0))[5] > 1.05 * steady(PLAIN)[5]


def test_a_rut_is_what_multi_pass_says_under_all_wheels() -> None:
    rut = (("multi_pass", (0.5, 0.5, 1.0)),)
    again = steady(Conditions(same_rut=True), rut)
    assert again[5] < steady(PLAIN, rut)[5] < steady(PLAIN)[5]
    assert np.allclose(steady(Conditions(same_rut=True)), steady(PLAIN))


@pytest.mark.parametrize(
    "under", [PLAIN, TURNED, Conditions(payload=5.0, slope=-3.0), Conditions(same_rut=True)]
)
def test_a_log_says_under_which_conditions_it_was_driven(under: Conditions) -> None:
    said = dict(line.lstrip("# ").split(" = ") for line in under.lines)
    assert conditions_of(Trial("t", TrialInfo(extra=said))) == under


@pytest.mark.parametrize(("key", "text"), [("payload_kg", "heavy"), ("turned", "yes")])
def test_conditions_that_cannot_be_used_are_refused(key: str, text: str) -> None:
    with pytest.raises(InputError, match=f"{key} = {text} cannot be used"):
        conditions_of(Trial("t", TrialInfo(extra={key: text})))
