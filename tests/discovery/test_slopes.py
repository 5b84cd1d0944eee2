"""Derivatives by differences, against those of runs so exact that the smallest step is enough."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from granite_lab.discovery.arrow import Block, covariance
from granite_lab.discovery.baseline import begin
from granite_lab.discovery.bench import ACCURACY, SAND, Bench, World
from granite_lab.discovery.point import Fit, Point
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.refit import at_bound, with_effect
from granite_lab.discovery.setup import trial_models
from granite_lab.discovery.slopes import blocks_at, slopes_at
from granite_lab.effects import get
from granite_lab.model import Accuracy, simulate
from granite_lab.model.virtual import virtual_trial
from granite_lab.parameters import Variant, load_robot, load_soil

SHORT = (
    Variant(velocity=0.3, acceleration=1.2, distance=0.5),
    Variant(velocity=0.6, acceleration=1.2, distance=0.8),
)
SAG = (0.25, 0.01)


@pytest.fixture(scope="module")
def problem() -> Iterator[Problem]:
    """Two short virtual trials under the noise of a first fit."""
    robot, soil = load_robot(), load_soil()
    runs = [simulate(v, robot, soil, accuracy=Accuracy(1e-6, 1e-8, 0.0025)) for v in SHORT]
    trials = [virtual_trial(run, k, f"v{k}")[0] for k, run in enumerate(runs)]
    models, variants = trial_models(trials, robot)
    with Bench(World(robot, soil, variants, {"supply_sag": get("supply_sag")})) as bench:
        problem = Problem(models, bench)
        begin(problem)
        yield problem


def std_of_time(problem: Problem, point: Point, *, again: bool) -> float:
    """Return the std of the sag's time constant, which these trials hardly tell."""
    blocks = blocks_at(problem, point, slopes_at(problem, point))
    if again:
        blocks = blocks_at(problem, point, slopes_at(problem, point, near=blocks))
    return float(np.sqrt(covariance(blocks, problem.bounds(point)[0])[len(SAND) + 1, len(SAND) + 1]))


def test_a_shape_at_its_bound_counts_only_where_the_trials_insist_on_it(problem: Problem) -> None:
    """Whether a bus has hardly any capacitor these trials do not tell; far quieter ones would."""
    point = with_effect(problem, problem.neutral(), "supply_sag", (0.25, 2e-4))
    slopes = slopes_at(problem, point)
    blocks = blocks_at(problem, point, slopes)
    quiet = [Block(1e3 * b.local, 1e3 * b.shared, b.precision) for b in blocks]
    found = [at_bound(problem, Fit(point, (), 0.0, b, slopes, True, ())) for b in (blocks, quiet)]
    assert found == [(), ("time",)]


def test_the_noise_of_simulations_does_not_pass_for_knowledge(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    point = with_effect(problem, problem.neutral(), "supply_sag", SAG)
    rough, wide = (std_of_time(problem, point, again=again) for again in (False, True))
    problem.bench._known.clear()
    monkeypatch.setattr(World, "accuracy", replace(ACCURACY, relative=1e-10, absolute=1e-12))
    exact = std_of_time(problem, point, again=False)
    assert abs(np.log(wide / exact)) < abs(np.log(rough / exact))
    assert wide == pytest.approx(exact, rel=0.02)
