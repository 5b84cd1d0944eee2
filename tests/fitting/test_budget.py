"""Budgets of means and of a_θ add up to the stated std, whatever the scatter is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from granite_lab.estimate import Estimate, Part
from granite_lab.fitting import fit_a_theta
from granite_lab.fitting.budget import SCATTER, of_a_theta, of_mean
from granite_lab.fitting.fit import K92Fit
from tests.fitting.made_up import made_up_fit

SPEEDS = (0.2, 0.3, 0.5, 0.7)


def fit(name: str, v: float, k: float, parts: tuple[Part, ...]) -> K92Fit:
    std = math.hypot(*(p.contribution for p in parts))
    return made_up_fit(name, v, Estimate(k, std), Estimate(0.2, 0.7 * std), parts=parts)


def fits(shift: dict[float, float], scatter: float) -> list[K92Fit]:
    rng, found = np.random.default_rng(4), []
    for v in SPEEDS:
        for i in range(3):
            k = math.exp(-4.919 * v) * (1 + shift.get(v, 0.0) + scatter * rng.standard_normal())
            own = (
                Part("sensor", "A", "normal", "m/s²", 0.01, 0.003 * rng.uniform(0.5, 2)),
                Part("sand", "B", "log-normal", "1", 0.08, 0.05 * k),
            )
            found.append(fit(f"{v}/{i}", v, k, own))
    return found


@pytest.mark.parametrize(
    ("shift", "scatter"),
    [({}, 0.0), ({}, 0.2), ({0.3: 0.5, 0.5: -0.4}, 0.05)],
    ids=["none", "trials", "speeds"],
)
def test_the_budget_of_a_theta_adds_up(shift: dict[float, float], scatter: float) -> None:
    trials = fits(shift, scatter)
    found = fit_a_theta(trials)
    budget = of_a_theta(found, trials)
    assert budget.combined == pytest.approx(found.a_theta.std, rel=1e-6)
    assert sum(budget.share(p) for p in budget.parts) == pytest.approx(1.0)
    assert ("departure of the speeds from the law (27)" in {p.name for p in budget.parts}) == bool(shift)


def test_the_sensitivity_of_a_theta_is_its_derivative() -> None:
    trials = fits({}, 0.0)
    before = fit_a_theta(trials)
    step = 1e-4
    moved = [*trials[:5], fit("other", 0.3, trials[5].k92.value + step, trials[5].parts), *trials[6:]]
    change = (fit_a_theta(moved).a_theta.value - before.a_theta.value) / step
    assert before.sensitivity[5] == pytest.approx(change, rel=0.01)


def test_what_scatters_beyond_the_stated_std_is_a_component_of_type_a() -> None:
    parts = [(Part("sensor", "A", "normal", "m/s²", 0.01, 0.002),)] * 3
    budget = of_mean(0.3, Estimate(0.1, 0.004), parts)
    assert budget.combined == pytest.approx(0.004)
    scatter = next(p for p in budget.parts if p.name == SCATTER)
    assert scatter.contribution == pytest.approx(math.sqrt(0.004**2 - 0.002**2 / 3))
    assert scatter.kind == "A"
    narrow = of_mean(0.3, Estimate(0.1, 0.002 / math.sqrt(3)), parts)
    assert [p.name for p in narrow.parts] == ["sensor"]
