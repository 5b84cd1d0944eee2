"""k_92 and the start of the command from the whole time history."""

from __future__ import annotations

import dataclasses
import math
from itertools import cycle, islice

import numpy as np
import pytest

from granite_lab.estimate import Estimate
from granite_lab.fitting import fit_k92, simulate_k92
from granite_lab.fitting.bins import SimulatedBins, measured_bins
from granite_lab.fitting.history import correlation_time
from granite_lab.parameters import load_robot, load_soil, load_variants, variant_of
from tests.fitting.made_up import T_START, correlated, draw_soil, made_up_trial, without_currents

ROBOT, SOIL = load_robot(), load_soil()


def trial_by(law, velocity=0.3, k92=0.2286, **options):
    variant = variant_of(velocity)
    run = simulate_k92(variant, ROBOT, SOIL, k92, law)
    return made_up_trial(variant, k92, run=run, **options)


@pytest.mark.parametrize("law", ["constant", "exponential"])
def test_the_time_history_shows_how_k92_ran_through_the_ramps(law):
    motion, trial, _ = trial_by(law, start_error=0.03)
    fit = fit_k92(motion, trial, ROBOT, SOIL)
    assert fit.law == law
    assert fit.status_trajectory == "ok"
    assert fit.k92_trajectory.value == pytest.approx(0.2286, abs=3 * fit.k92_trajectory.std)
    assert fit.k92_trajectory.std < 0.01
    assert fit.t_start.value == pytest.approx(T_START, abs=0.002)


def test_without_currents_the_interval_is_wider():
    motion, trial, _ = trial_by("exponential")
    with_all = fit_k92(motion, trial, ROBOT, SOIL)
    fewer = fit_k92(motion, without_currents(trial), ROBOT, SOIL)
    assert fewer.k92_trajectory.std > 1.2 * with_all.k92_trajectory.std
    assert fewer.k92_trajectory.value == pytest.approx(0.2286, abs=3 * fewer.k92_trajectory.std)


def test_a_k92_below_zero_ends_at_the_bound():
    """A drag that the model does not have slows the body more than k_92 = 0 can explain."""
    motion, trial, _ = trial_by("constant", 0.7, 0.0, velocity_std=0.002)
    motion = dataclasses.replace(motion, v=0.93 * motion.v, slip_ratio=Estimate(0.31, 0.003))
    fit = fit_k92(motion, without_currents(trial), ROBOT, SOIL)
    assert fit.status == "at_lower_bound"
    assert fit.status_trajectory == "at_lower_bound"
    assert any("trajectory fit at lower bound" in note for note in fit.notes)


def test_a_trajectory_without_a_known_start_is_not_evaluated():
    motion, trial, _ = trial_by("constant")
    fit = fit_k92(dataclasses.replace(motion, t_start=Estimate(math.nan)), trial, ROBOT, SOIL)
    assert fit.status_trajectory == "not_evaluated"
    assert fit.status == "ok"
    assert any("start of the motion is unknown" in note for note in fit.notes)


def test_a_log_that_misses_the_motion_is_not_evaluated():
    motion, trial, _ = trial_by("constant")
    fit = fit_k92(dataclasses.replace(motion, t_start=Estimate(motion.t[-1] - 0.1, 0.1)), trial, ROBOT, SOIL)
    assert fit.status_trajectory == "not_evaluated"


def test_measurement_and_simulation_are_binned_alike():
    quiet = dataclasses.replace(
        ROBOT,
        currents=dataclasses.replace(ROBOT.currents, noise=0.0, offset=0.0, gain=0.0),
        encoders=dataclasses.replace(ROBOT.encoders, jitter=0.0),
    )
    run = simulate_k92(variant_of(0.5), quiet, SOIL, 0.1)
    motion, trial, _ = made_up_trial(variant_of(0.5), 0.1, run=run, robot=quiet, velocity_std=0.0)
    bins, simulated = measured_bins(motion, trial, quiet, T_START), SimulatedBins(run)
    for channel, tolerance in [("velocity", 1e-5), ("wheel_f", 2e-4), ("wheel_r", 2e-4), ("current_f", 0.05)]:
        difference = bins.values[channel] - simulated(channel, bins.edges, T_START)
        assert np.abs(difference).max() < tolerance, channel


def test_a_gap_in_the_encoders_leaves_bins_empty_and_the_fit_alive():
    motion, trial, _ = trial_by("exponential")
    wheels = trial.wheels
    kept = ~((wheels.t > T_START + 2.0) & (wheels.t < T_START + 2.4))
    holed = dataclasses.replace(
        trial, wheels=dataclasses.replace(wheels, t=wheels.t[kept], angle=wheels.angle[kept])
    )
    bins = measured_bins(motion, holed, ROBOT, T_START)
    assert np.isnan(bins.values["wheel_f"]).sum() >= 6
    fit = fit_k92(motion, holed, ROBOT, SOIL)
    assert fit.k92_trajectory.value == pytest.approx(0.2286, abs=3 * fit.k92_trajectory.std)


@pytest.mark.parametrize("time", [0.2, 1.0])
def test_the_correlation_time_of_a_known_process_is_found(time):
    found = [
        correlation_time(correlated(np.random.default_rng(seed), 4000, 0.05, 1.0, time), 0.05)
        for seed in range(10)
    ]
    assert np.mean(found) == pytest.approx(time, rel=0.15)


def test_white_residuals_have_no_correlation_time():
    noise = np.random.default_rng(3).standard_normal(4000)
    assert correlation_time(noise, 0.05) < 0.03


@pytest.mark.slow
def test_the_95_percent_interval_of_the_trajectory_holds_the_true_k92():
    """16 virtual trials on their own sand: at least 13 inside (chance 0.993 if 95 % are meant)."""
    inside = 0
    for seed, variant in enumerate(islice(cycle(load_variants()), 16)):
        rng = np.random.default_rng([11, seed])
        k92 = math.exp(-4.919 * variant.velocity) * (1 + 0.05 * rng.standard_normal())
        run = simulate_k92(variant, ROBOT, draw_soil(rng), k92, "exponential")
        motion, trial, _ = made_up_trial(variant, k92, seed=seed, run=run)
        fit = fit_k92(motion, trial, ROBOT, SOIL)
        low, high = fit.k92_trajectory.interval()
        inside += low <= k92 <= high
    assert inside >= 13
