"""Wheels that spin on while the body stands, and standstills between which no wheel turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granite_lab.estimation import estimate
from granite_lab.estimation.clock import bridged_rests
from granite_lab.parameters import load_robot
from tests.truth.trials import generate

SPINS = 0.8
"""So long the wheels turn on when the body has stopped [s]."""


def test_wheels_that_spin_on_bend_neither_velocity_nor_clock() -> None:
    robot = load_robot("granite", "industrial")
    truth = generate(91, velocity=0.5, duration=5.0, still=(1.5, 2.0), grade="industrial")
    wheels = truth.trial.wheels
    on = np.clip(wheels.t - truth.stop, 0.0, SPINS) * 0.3 / robot.wheels.radius
    motion = estimate(replace(truth.trial, wheels=replace(wheels, angle=wheels.angle + on[:, None])), robot)
    moving = (motion.t > truth.start) & (motion.t < truth.stop + SPINS + 0.5)
    off = (motion.v - truth.at(motion.t, "v"))[moving]
    assert np.sqrt(np.mean(off**2)) < 0.006
    assert np.mean(np.abs(off) < 2.0 * motion.v_std[moving]) > 0.88
    assert motion.clock_applied == 0.0


def test_standstills_between_which_no_wheel_turned_are_one() -> None:
    rests = [(0.0, 1.0), (1.2, 2.0), (5.0, 6.0)]
    assert bridged_rests(rests, np.array([2.5, 4.0])) == [(0.0, 2.0), (5.0, 6.0)]
