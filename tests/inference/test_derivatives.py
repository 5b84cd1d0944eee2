"""Derivatives of the real simulator are those of runs at a fine tolerance."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from granite_lab.effects import get
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.point import DIRECTIONS
from granite_lab.inference.pool import ACCURACY, SAND, Scenario, Task
from granite_lab.logs.trial import Array
from granite_lab.model import simulator
from granite_lab.model.native import graphs
from granite_lab.model.simulator import integrate
from granite_lab.parameters import load_robot, load_soil, variant_of
from tests.inference.stub import Respond, problem_of

IDS = ("drive_reaction", "tyre_windup")
SETTING = tuple((id_, tuple((q.prior_low + q.prior_high) / 2 for q in get(id_).parameters)) for id_ in IDS)
CENTRE = np.array([0.05, 0.1, 0.1, -0.1, 0.02, 0.05, -0.05, 0.0, 0.0])
SCENARIO = Scenario(load_robot(), load_soil(), (variant_of(0.5),), {id_: get(id_) for id_ in IDS})


def shown(numbers: Array, like: Array | None = None) -> Array:
    """Return the signals at some numbers, by the steps of a run at others."""
    task = SCENARIO.task(0, numbers, SETTING)
    signals = SCENARIO.respond(task if like is None else replace(task, like=SCENARIO.task(0, like, SETTING)))
    assert signals is not None
    return signals


def finely(numbers: Array) -> Array:
    """Return the signals at some numbers with a ten-thousandth of the errors."""
    task = SCENARIO.task(0, numbers, SETTING)
    accuracy = replace(ACCURACY, relative=1e-4 * ACCURACY.relative, absolute=1e-4 * ACCURACY.absolute)
    names = (
        "imu_ax_mps2",
        "imu_az_mps2",
        "imu_gy_radps",
        "enc_f_rad",
        "enc_r_rad",
        "cur_f_A",
        "cur_r_A",
        "v_mps",
    )
    signals = integrate(SCENARIO.parameters(task), SCENARIO.active(task), accuracy, names)
    return np.stack([signals[name] for name in names])


@pytest.mark.parametrize("name", ["frictional_modulus", "exponent", "shear_modulus"])
def test_neighbours_by_the_same_steps_give_the_derivative(name: str) -> None:
    """The error of one step of each run, over a small step, would hide it."""
    h = 1e-5 * (np.arange(CENTRE.size) == SAND.index(name))
    truth = (finely(CENTRE + 10 * h) - finely(CENTRE - 10 * h)) / 2e-4
    base = shown(CENTRE)
    size = np.sqrt(np.mean(truth**2, axis=1))
    errors = [
        float(
            np.median(np.sqrt(np.mean(((shown(CENTRE + h, like) - base) / 1e-5 - truth) ** 2, axis=1)) / size)
        )
        for like in (CENTRE, None)
    ]
    assert errors[0] < 0.01
    assert errors[1] > 5 * errors[0]


def test_a_run_whose_steps_are_repeated_is_not_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither of its own run, where that was made before, nor of the first neighbour."""
    made = []

    def counted(*given: Any) -> tuple[Array, Array | None]:
        made.append(given)
        return graphs.run(*given)

    elsewhere = CENTRE + 0.01  # no other test has been there
    fake = SimpleNamespace(run=counted, outputs=graphs.outputs)
    monkeypatch.setattr(simulator, "engine_of", lambda *_: fake)
    shown(elsewhere)
    for k in range(3):
        shown(elsewhere + 1e-5 * k, elsewhere)
    assert len(made) == 4
    assert [given[-1] is None for given in made] == [True, False, False, False]
    shown(CENTRE + 0.02, CENTRE + 0.03)
    assert [given[-1] is None for given in made[4:]] == [True, False]


def test_at_a_kink_the_derivative_is_that_of_either_side() -> None:
    @dataclass(frozen=True)
    class Bent(Respond):
        def one(self, scenario: Scenario, task: Task) -> Array | None:
            bent = replace(task, sand=tuple(np.abs(task.sand).tolist()))
            return super().one(scenario, bent)

    problem = problem_of(respond=Bent())
    ahead, behind = (differentiate(problem, problem.neutral(), behind=side) for side in (False, True))
    assert ahead is not None
    assert behind is not None
    for before, after in zip(ahead.changes, behind.changes, strict=True):
        sand = slice(DIRECTIONS, DIRECTIONS + len(SAND))
        assert np.abs(after[..., sand]).max() > 0.1
        np.testing.assert_allclose(after[..., sand], -before[..., sand], atol=1e-9)
