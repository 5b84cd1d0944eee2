"""k_92, a_θ and the start of the command from whole time histories."""

from __future__ import annotations

import dataclasses
import math
from itertools import cycle, islice

import numpy as np
import pytest

from granite_lab.effects import get
from granite_lab.estimate import Estimate
from granite_lab.estimation import correct
from granite_lab.fitting import fit_k92, fit_trajectory, simulate_k92
from granite_lab.model.effect import activate
from granite_lab.parameters import load_robot, load_soil, load_variants, variant_of
from tests.fitting.made_up import draw_soil, made_up_trial, without_currents
from tests.truth.simulator import simulate as simulate_truth
from tests.truth.trials import log_run

ROBOT, SOIL = load_robot(), load_soil()


def trial_by_5(velocity=0.3, k92=0.2286, effects=(), **options):
    """A trial in which k_92 follows (5) to its steady value."""
    variant = variant_of(velocity)
    run = simulate_k92(variant, ROBOT, SOIL, k92, effects=effects)
    return made_up_trial(variant, k92, run=run, **options)


def test_k92_and_the_start_are_found_from_a_start_that_is_off():
    motion, trial, _, start = trial_by_5(start_error=0.03)
    fit = fit_k92(motion, trial, ROBOT, SOIL)
    assert fit.status_trajectory == "ok"
    assert fit.k92_trajectory.value == pytest.approx(0.2286, abs=3 * fit.k92_trajectory.std)
    assert fit.k92_trajectory.std < 0.01
    assert fit.t_start.value == pytest.approx(start, abs=0.002)


def test_a_k92_far_from_the_papers_is_found():
    motion, trial, _, _ = trial_by_5(0.5, math.exp(-2.5 * 0.5))
    own = fit_trajectory(trial, motion, ROBOT, SOIL).a_theta
    assert own.value == pytest.approx(2.5, abs=3 * own.std)
    assert own.std < 0.3


def test_without_currents_the_interval_is_wider():
    motion, trial, _, _ = trial_by_5()
    with_all = fit_k92(motion, trial, ROBOT, SOIL)
    fewer = fit_k92(motion, without_currents(trial), ROBOT, SOIL)
    assert fewer.k92_trajectory.std > 1.1 * with_all.k92_trajectory.std
    assert fewer.k92_trajectory.value == pytest.approx(0.2286, abs=3 * fewer.k92_trajectory.std)


def test_stamps_of_the_imu_that_come_late_are_latency_and_not_k92():
    motion, trial, _, _ = trial_by_5(0.5, 0.0855)
    late = dataclasses.replace(trial, imu=dataclasses.replace(trial.imu, t=trial.imu.t + 0.008))
    at_once, delayed = (fit_trajectory(t, motion, ROBOT, SOIL) for t in (trial, late))
    assert delayed.latency.value - at_once.latency.value == pytest.approx(0.008, abs=1e-3)
    assert delayed.a_theta.value == pytest.approx(at_once.a_theta.value, abs=0.5 * at_once.a_theta.std)


def test_effects_of_the_model_are_in_the_fit():
    reaction = activate(get("drive_reaction"), {"share": 1.0})
    motion, trial, _, _ = trial_by_5(0.5, 0.0855, effects=(reaction,))
    whole = fit_k92(motion, trial, ROBOT, SOIL, effects=(reaction,)).k92_trajectory
    without = fit_k92(motion, trial, ROBOT, SOIL)
    assert whole.value == pytest.approx(0.0855, abs=3 * whole.std)
    assert without.k92_trajectory.std > 1.5 * whole.std  # a model that is off says less


@pytest.mark.parametrize(("start", "reason"), [(math.nan, "start of the motion is unknown"), (13.0, "cover")])
def test_a_trajectory_that_cannot_be_had_is_not_evaluated(start, reason):
    motion, trial, _, _ = trial_by_5()
    fit = fit_k92(dataclasses.replace(motion, t_start=Estimate(start, 0.1)), trial, ROBOT, SOIL)
    assert (fit.status, fit.status_trajectory) == ("ok", "not_evaluated")
    assert any(reason in note for note in fit.notes)


def test_a_gap_in_the_encoders_leaves_the_fit_alive():
    motion, trial, _, start = trial_by_5()
    wheels = trial.wheels
    kept = ~((wheels.t > start + 2.0) & (wheels.t < start + 2.4))
    holed = dataclasses.replace(
        trial, wheels=dataclasses.replace(wheels, t=wheels.t[kept], angle=wheels.angle[kept])
    )
    fit = fit_k92(motion, holed, ROBOT, SOIL)
    assert fit.k92_trajectory.value == pytest.approx(0.2286, abs=3 * fit.k92_trajectory.std)


@pytest.mark.parametrize(("number", "velocity"), [*enumerate((0.2, 0.3, 0.5, 0.7))])
def test_a_theta_of_a_trial_by_the_independent_simulator(number, velocity):
    robot = load_robot("granite", "industrial")
    rng = np.random.default_rng([8, number])
    true = 4.6 * float(np.exp(0.03 * rng.standard_normal()))
    soil = draw_soil(rng)
    run = simulate_truth(variant_of(velocity), a_theta=true, soil=soil, settle=2.0, after=3.0)
    trial, motion = correct(log_run(20 + number, run).trial, robot)
    found = fit_trajectory(trial, motion, robot, SOIL).a_theta
    assert found.value == pytest.approx(true, abs=2.5 * found.std)
    assert found.std < 0.2


@pytest.mark.slow
def test_the_95_percent_interval_of_the_trajectory_holds_the_true_k92():
    """16 virtual trials on their own sand: at least 13 inside (chance 0.993 if 95 % are meant)."""
    inside = 0
    for seed, variant in enumerate(islice(cycle(load_variants()), 16)):
        rng = np.random.default_rng([11, seed])
        k92 = math.exp(-4.919 * variant.velocity) * (1 + 0.05 * rng.standard_normal())
        run = simulate_k92(variant, ROBOT, draw_soil(rng), k92)
        motion, trial, _, _ = made_up_trial(variant, k92, seed=seed, run=run)
        low, high = fit_k92(motion, trial, ROBOT, SOIL).k92_trajectory.interval()
        inside += low <= k92 <= high
    assert inside >= 13
