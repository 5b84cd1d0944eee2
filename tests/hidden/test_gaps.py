"""What the absence of a cause reopens: of a cause that sand or sensors absorb a refit leaves little."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from granite_lab.hidden.catalogue import influence
from granite_lab.hidden.gaps import Gaps
from granite_lab.logs.trial import CurrentStream, ImuStream, Trial, TrialInfo
from granite_lab.parameters import load_robot

T = np.arange(0, 4, 0.01)
MOVING = np.clip(T - 1, 0, 1)
BUMP = np.exp(-((T - 2.5) ** 2) / 0.02)
NAMES = ("torque_constant_error", "gear_backlash")


def make(active: Sequence[str], number: str = "", factor: float = 1.0) -> list[Trial]:
    """Return two trials: one cause is a gain of the currents, the other one a bump of the pitch rate."""
    gain = 1.02 if "torque_constant_error" in active else 1.0
    began = np.interp(T - 0.01, T, MOVING) if "clock_offset" in active else MOVING
    current = np.outer(gain * began, np.full(4, 2.0)) * (factor if number == "frictional_modulus" else 1.0)
    rate = np.zeros((T.size, 3))
    if "gear_backlash" in active:
        rate[:, 1] += 0.05 * BUMP
    if "tread_ripple" in active:  # the wheels turn otherwise under the other cause
        rate[:, 1] += 0.1 * MOVING * np.sin(30 * T + (1.0 if "gear_backlash" in active else 0.0))
    if "wheel_eccentricity" in active:
        rate[:, 1] += 0.05 * MOVING * np.sin(9 * T)
    force = np.zeros((T.size, 3))
    force[:, 0], force[:, 2] = 0.3 * MOVING, 9.81
    trial = Trial(
        "virtual", TrialInfo(virtual=True), ImuStream(T, force, rate), None, CurrentStream(T, current)
    )
    return [trial, replace(trial, name="other")]


def test_a_refit_absorbs_what_a_gain_explains_and_leaves_what_nothing_else_shows() -> None:
    robot = load_robot("granite")
    gaps = Gaps.of(make, NAMES, robot)
    assert gaps is not None
    before, after = gaps.reopened(), gaps.reopened_after_refit(make)
    gain, bump = (
        float(np.sum((x / noise) ** 2))
        for x, noise in ((np.outer(0.02 * MOVING, np.full(4, 2.0)), robot.currents.noise),
                         (0.05 * BUMP, robot.imu.vibration_rate))
    )  # fmt: skip
    assert before["gear_backlash"] == pytest.approx(bump / (gain + bump), rel=1e-3)
    assert before["torque_constant_error"] == pytest.approx(gain / (gain + bump), rel=1e-3)
    assert after["torque_constant_error"] < 0.1 * before["torque_constant_error"]
    assert after["gear_backlash"] > 0.9


def test_a_refit_absorbs_stamps_of_wheels_and_currents_that_are_late() -> None:
    gaps = Gaps.of(make, ("clock_offset", "gear_backlash"), load_robot("granite"))
    assert gaps is not None
    before, after = gaps.reopened()["clock_offset"], gaps.reopened_after_refit(make)["clock_offset"]
    assert before > 0.02
    assert after < 0.1 * before


def test_a_trace_of_the_wheels_that_falls_out_of_step_is_no_gap_of_another_cause() -> None:
    assert [influence(name).has_phase() for name in ("tread_ripple", "gear_backlash")] == [True, False]
    both = ("gear_backlash", "tread_ripple")
    gaps = Gaps.of(make, both, load_robot("granite"))
    assert gaps is not None
    shares = gaps.reopened()
    ripple = float(np.sum((0.1 * MOVING * np.sin(30 * T)) ** 2))
    bump = float(np.sum((0.05 * BUMP) ** 2))
    assert shares["gear_backlash"] == pytest.approx(bump / (ripple + bump), rel=0.1)
    assert shares["tread_ripple"] == pytest.approx(ripple / (ripple + bump), rel=0.1)


def test_a_refit_leaves_causes_that_all_turn_with_the_wheels() -> None:
    both = ("tread_ripple", "wheel_eccentricity")
    gaps = Gaps.of(make, both, load_robot("granite"))
    assert gaps is not None
    before, after = gaps.reopened(), gaps.reopened_after_refit(make)
    assert after == pytest.approx(before, rel=0.05)
    assert before["wheel_eccentricity"] == pytest.approx(0.2, abs=0.05)  # half the amplitude of the ripple


def test_a_set_is_given_up_once_a_cause_is_too_weak() -> None:
    robot, made = load_robot("granite"), list[tuple[str, ...]]()

    def counted(active: Sequence[str], number: str = "", factor: float = 1.0) -> list[Trial]:
        made.append(tuple(active))
        return make(active, number, factor)

    assert Gaps.of(counted, NAMES, robot, least=0.9) is None  # the gain reopens a fifth, the bump the rest
    assert made == [NAMES, (), NAMES[1:]]
