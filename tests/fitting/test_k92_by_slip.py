"""k_92 from the steady slip ratio: the paper's figures, the bounds, and the truth of the interval."""

from __future__ import annotations

import dataclasses
import math
from itertools import cycle, islice

import numpy as np
import pytest

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.fitting import fit_k92, simulated_slip, slip_interval
from granite_lab.fitting.k92 import SlipCurve
from granite_lab.model import simulate
from granite_lab.model.command import steady_interval, steady_part
from granite_lab.parameters import load_paper, load_robot, load_soil, load_variants, variant_of
from tests.fitting.made_up import draw_soil, made_up_trial

ROBOT, SOIL = load_robot(), load_soil()


def k92_of(slip, velocity):
    """k_92 with which the model slips so over its steady part."""
    variant = variant_of(velocity)
    k92, status = SlipCurve(lambda k: simulate(variant, ROBOT, SOIL, k92=k).slip_ratio).root(slip)
    assert status == "ok"
    return k92


@pytest.mark.parametrize(("velocity", "k92"), [(0.2, 0.3345), (0.3, 0.2559), (0.5, 0.1074), (0.7, 0.0283)])
def test_the_papers_measured_slip_gives_its_k92(velocity, k92):
    row = next(p for p in load_paper().table3 if p.velocity == velocity)
    fitted = k92_of(row.slip_measured, velocity)
    assert fitted == pytest.approx(k92, abs=0.0005)
    assert fitted == pytest.approx(row.k92, abs=0.005)


@pytest.mark.parametrize(
    ("slip", "status", "k92"), [(0.29, "at_lower_bound", 0.0), (-0.08, "at_upper_bound", 1.0)]
)
def test_a_trial_beyond_the_models_reach_ends_at_the_bound_and_says_so(slip, status, k92):
    motion, trial, _, _ = made_up_trial(variant_of(0.3), 0.1)
    motion = dataclasses.replace(motion, slip_ratio=Estimate(slip, 0.01))
    fit = fit_k92(motion, trial, ROBOT, SOIL, trajectory=False)
    assert (fit.status, fit.k92.value) == (status, k92)
    assert "to 25.71% that the model attains" in fit.notes[0]
    assert "std)." in fit.notes[0]
    assert fit.status_trajectory == "not_evaluated"
    assert math.isnan(fit.k92_trajectory.value)


def test_a_trial_without_slip_ratio_is_refused():
    motion, trial, _, _ = made_up_trial(variant_of(0.3), 0.1)
    motion = dataclasses.replace(motion, slip_ratio=Estimate(math.nan))
    with pytest.raises(EstimateError, match="slip ratio"):
        fit_k92(motion, trial, ROBOT, SOIL)


def test_simulated_slip_is_taken_over_the_interval_of_the_measured():
    variant = variant_of(0.7)
    run = simulate(variant, ROBOT, SOIL, k92=0.03)
    t1, t2 = steady_interval(variant)
    # right after the ramp the robot still settles, so the interval matters
    assert simulated_slip(run, (t1, t2)) > simulated_slip(run) + 0.01
    motion, _, _, start = made_up_trial(variant, 0.03, run=run, start_error=0.0)
    early = dataclasses.replace(motion, steady=(start + t1, start + t2))
    assert slip_interval(early) == pytest.approx((t1, t2))
    nowhere = dataclasses.replace(motion, t_start=Estimate(math.nan))
    assert slip_interval(nowhere) == steady_part(variant)


def test_the_std_has_a_part_from_slip_and_a_part_from_the_sand():
    motion, trial, run, _ = made_up_trial(variant_of(0.3), 0.22, slip_std=0.005)
    fit = fit_k92(motion, trial, ROBOT, SOIL, trajectory=False)
    slope = (
        simulate(run.variant, ROBOT, SOIL, k92=0.24).slip_ratio
        - simulate(run.variant, ROBOT, SOIL, k92=0.20).slip_ratio
    ) / 0.04
    assert fit.std_measurement == pytest.approx(0.005 / abs(slope), rel=0.1)
    std_sand = math.hypot(*(p.contribution for p in fit.parts if "raking" in p.name))
    assert 0.002 < std_sand < 0.008
    assert fit.k92.std == pytest.approx(math.hypot(fit.std_measurement, std_sand))


@pytest.mark.slow
def test_the_95_percent_interval_holds_the_true_k92():
    """64 virtual trials, each on its own sand and with its own error of λ_R."""
    inside = []
    for seed, variant in enumerate(islice(cycle(load_variants()), 64)):
        rng = np.random.default_rng([7, seed])
        k92 = math.exp(-4.919 * variant.velocity) * (1 + 0.05 * rng.standard_normal())
        motion, trial, _, _ = made_up_trial(variant, k92, seed=seed, soil=draw_soil(rng))
        fit = fit_k92(motion, trial, ROBOT, SOIL, trajectory=False)
        low, high = fit.k92.interval()
        inside.append(low <= k92 <= high)
    assert 0.90 <= np.mean(inside) <= 0.99
