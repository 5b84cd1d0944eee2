"""Faults of sensors and loggers that estimation corrects do not change k_92, either way, nor a_θ.

Faults that leave the good trial to the last digit stand in `tests/estimation/test_faults.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from granite_lab.estimation import correct
from granite_lab.fitting import K92Fit, fit_k92
from granite_lab.logs.trial import Trial
from granite_lab.parameters import Robot, load_soil, variant_of
from tests.truth import faults
from tests.truth.simulator import simulate
from tests.truth.trials import TruthTrial, log_run, robot

A_THETA, TENTH = 4.7, 0.1


@cache
def good() -> TruthTrial:
    run = simulate(variant_of(0.5), a_theta=A_THETA, settle=2.0, after=3.0)
    return log_run(3, run, clock_offset=0.003)


def fitted(trial: Trial, robot: Robot) -> K92Fit:
    clean, motion = correct(trial, robot)
    return fit_k92(motion, clean, robot, load_soil())


@cache
def plain() -> K92Fit:
    return fitted(good().trial, robot())


def restarted(trial: Trial, at: float) -> Trial:
    jump = {"accel_jump": np.array([0.15, -0.1, 0.1]), "gyro_jump": np.array([0.01, 0.02, -0.01])}
    return faults.imu_restart(trial, at, gap=0.1, **jump)


def apart(found: K92Fit) -> tuple[float, float]:
    """Difference to the good trial's k_92 by slip and by trajectory, over its std."""
    pairs = (found.k92, plain().k92), (found.k92_trajectory, plain().k92_trajectory)
    return tuple(abs(one.value - other.value) / other.std for one, other in pairs)


def test_good_trial_has_the_k92_of_the_simulator() -> None:
    for k92 in (plain().k92, plain().k92_trajectory):
        assert k92.value == pytest.approx(np.exp(-A_THETA * 0.5), abs=2 * k92.std)


@pytest.mark.parametrize(
    ("fault", "mounting"),
    [
        (lambda t: faults.turned(t, faults.SIDEWAYS), {"forward": "find"}),
        (lambda t: restarted(t, 0.8), {}),
    ],
    ids=["IMU axes found", "restart at rest"],
)
def test_a_corrected_trial_has_the_k92_of_the_good_one(
    fault: Callable[[Trial], Trial], mounting: dict[str, object]
) -> None:
    by_slip, by_trajectory = apart(fitted(fault(good().trial), robot(**mounting)))
    assert by_slip < TENTH
    assert by_trajectory < TENTH


def test_spikes_that_are_left_out_cost_information_but_no_more() -> None:
    by_slip, by_trajectory = apart(fitted(faults.spikes(good().trial, 3, 8, 30.0), robot()))
    assert by_slip < 0.5
    assert by_trajectory < 0.2


@pytest.mark.parametrize("by", [0.03, -0.03])
@pytest.mark.xfail(reason="estimation leaves such an offset in the stamps: 0.7 to 0.9 std")
def test_an_offset_that_nobody_states_is_gone(by: float) -> None:
    assert max(apart(fitted(faults.late(good().trial, -by), robot()))) < TENTH
