"""k_92, a_θ and the start of the command of a trial: by steady slip, by whole histories, and under faults."""

import dataclasses
import math
from collections.abc import Callable
from functools import cache
from itertools import cycle, islice

import numpy as np
import pytest

from granite_lab.effects import get
from granite_lab.estimate import Estimate
from granite_lab.estimation import correct
from granite_lab.fitting import K92Fit, fit_k92, simulate_k92, simulated_slip, slip_interval
from granite_lab.fitting import k92 as k92_module
from granite_lab.fitting.k92 import SlipCurve
from granite_lab.logs.trial import Trial
from granite_lab.model import simulate
from granite_lab.model.command import peak_velocity, steady_interval, steady_part
from granite_lab.model.effect import activate
from granite_lab.parameters import Robot, load_paper, load_robot, load_soil, load_variants, variant_of
from tests.fitting.made_up import draw_soil, made_up_trial
from tests.remembered import made_once
from tests.soak import SOAK, sampled
from tests.truth import faults
from tests.truth.simulator import simulate as simulate_truth
from tests.truth.trials import TruthTrial, log_run, robot

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
    assert "to 25.72% that the model attains" in fit.notes[0]
    assert "std)." in fit.notes[0]
    assert fit.status_trajectory == "not_evaluated"
    assert math.isnan(fit.k92_trajectory.value)


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
    high, low = (simulate(run.variant, ROBOT, SOIL, k92=k).slip_ratio for k in (0.20, 0.24))
    assert fit.std_measurement == pytest.approx(0.005 * 0.04 / (high - low), rel=0.1)
    std_sand = math.hypot(*(p.contribution for p in fit.parts if "raking" in p.name))
    assert 0.002 < std_sand < 0.008
    assert fit.k92.std == pytest.approx(math.hypot(fit.std_measurement, std_sand))


def test_errors_of_soil_and_radius_move_k92_as_the_model_says():
    """The true k_92 of a trial comes out where the file's number is put right: slope and curve agree."""
    motion, trial, _, _ = made_up_trial(variant_of(0.3), 0.22, slip_std=0.005)
    fit = fit_k92(motion, trial, ROBOT, SOIL, trajectory=False)
    shifts = {s.name: s for s in fit.shared}
    assert shifts["K, of the soil"].std == 0.2
    assert shifts["wheel radius"].std == 0.005
    known = dataclasses.replace(SOIL, shear_modulus_std=0.02 * SOIL.shear_modulus)
    stiffer = dataclasses.replace(SOIL, shear_modulus=SOIL.shear_modulus * math.exp(0.02))
    small = {s.name: s for s in fit_k92(motion, trial, ROBOT, known, trajectory=False).shared}
    moved = fit_k92(motion, trial, ROBOT, stiffer, trajectory=False).k92.value - fit.k92.value
    assert small["K, of the soil"].up == pytest.approx(moved, rel=0.05)
    wheels = dataclasses.replace(ROBOT.wheels, radius=1.005 * ROBOT.wheels.radius)
    seen = 1 - (1 - motion.slip_ratio.value) / 1.005
    there = dataclasses.replace(motion, slip_ratio=dataclasses.replace(motion.slip_ratio, value=seen))
    larger = dataclasses.replace(ROBOT, wheels=wheels)
    moved = fit_k92(there, trial, larger, SOIL, trajectory=False).k92.value - fit.k92.value
    assert shifts["wheel radius"].up == pytest.approx(moved, rel=0.1)


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


def a_theta_of(fit):
    """a_θ of (5) by the trajectory."""
    k92, v = fit.k92_trajectory, peak_velocity(fit.variant)
    return Estimate(-math.log(k92.value) / v, k92.std / (k92.value * v))


def test_a_k92_far_from_the_papers_is_found():
    motion, trial, _, _ = trial_by_5(0.5, math.exp(-2.5 * 0.5))
    own = a_theta_of(fit_k92(motion, trial, ROBOT, SOIL))
    assert own.value == pytest.approx(2.5, abs=3 * own.std)
    assert own.std < 0.3


@made_once
def whole():
    """The fit of `trial_by_5(0.5, 0.0855)`."""
    motion, trial, _, _ = trial_by_5(0.5, 0.0855)
    return fit_k92(motion, trial, ROBOT, SOIL)


def test_without_currents_the_interval_is_wider():
    motion, trial, _, _ = trial_by_5(0.5, 0.0855)
    with_all = whole()
    fewer = fit_k92(motion, dataclasses.replace(trial, currents=None), ROBOT, SOIL)
    assert fewer.k92_trajectory.std > 1.1 * with_all.k92_trajectory.std
    assert fewer.k92_trajectory.value == pytest.approx(0.0855, abs=3 * fewer.k92_trajectory.std)


def test_stamps_of_the_imu_that_come_late_are_latency_and_not_k92():
    motion, trial, _, _ = trial_by_5(0.5, 0.0855)
    late = dataclasses.replace(trial, imu=dataclasses.replace(trial.imu, t=trial.imu.t + 0.008))
    at_once, delayed = whole(), fit_k92(motion, late, ROBOT, SOIL)
    assert delayed.latency.value - at_once.latency.value == pytest.approx(0.008, abs=1e-3)
    k92 = at_once.k92_trajectory
    assert delayed.k92_trajectory.value == pytest.approx(k92.value, abs=0.5 * k92.std)


def test_effects_of_the_model_are_in_the_fit():
    reaction = activate(get("drive_reaction"), {"share": 1.0})
    motion, trial, _, _ = trial_by_5(0.5, 0.0855, effects=(reaction,))
    whole = fit_k92(motion, trial, ROBOT, SOIL, effects=(reaction,)).k92_trajectory
    without = fit_k92(motion, trial, ROBOT, SOIL)
    assert whole.value == pytest.approx(0.0855, abs=3 * whole.std)
    # a model that lacks an effect fits another value, which has no std
    assert without.status_trajectory == "model_misfit"
    assert math.isnan(without.k92_trajectory.std)
    assert math.isnan(without.apart)
    assert any("does not fit" in line for line in without.warnings)
    assert abs(without.k92_trajectory.value - 0.0855) > 3 * whole.std


def test_a_fit_that_did_not_converge_has_a_value_without_std(monkeypatch):
    motion, trial, _, _ = trial_by_5()
    ends = k92_module.baseline
    off = {"converged": False, "predicted_drop": 1.0}
    monkeypatch.setattr(k92_module, "baseline", lambda p: dataclasses.replace(ends(p), **off))
    fit = fit_k92(motion, trial, ROBOT, SOIL)
    assert fit.status_trajectory == "not_converged"
    assert 0 < fit.k92_trajectory.value < 1
    assert math.isnan(fit.k92_trajectory.std)
    assert math.isnan(fit.apart)
    assert "±" not in repr(fit).partition("trajectory")[2]
    assert "(not converged)" in repr(fit)


@pytest.mark.parametrize(("start", "reason"), [(math.nan, "start of the motion is unknown"), (13.0, "cover")])
def test_a_trajectory_that_cannot_be_had_is_not_evaluated(start, reason):
    motion, trial, _, _ = trial_by_5()
    fit = fit_k92(dataclasses.replace(motion, t_start=Estimate(start, 0.1)), trial, ROBOT, SOIL)
    assert (fit.status, fit.status_trajectory) == ("ok", "not_evaluated")
    assert any(reason in note for note in fit.notes)


def test_a_gap_in_the_encoders_leaves_the_fit_alive():
    motion, trial, _, start = trial_by_5(0.5, 0.0855)
    fit = fit_k92(motion, faults.wheel_dropout(trial, start + 2.0, start + 2.4), ROBOT, SOIL)
    assert fit.k92_trajectory.value == pytest.approx(0.0855, abs=3 * whole().k92_trajectory.std)


LARGEST = 0.1
"""Std of a_θ [s/m] that the sensors of an industrial IMU leave at most."""


@pytest.mark.parametrize(("number", "velocity"), sampled(enumerate((0.2, 0.3, 0.5, 0.7)), 4))
def test_a_theta_of_a_trial_by_the_independent_simulator(number, velocity):
    robot = load_robot("granite", "industrial")
    rng = np.random.default_rng([8, number])
    true = 4.6 * float(np.exp(0.03 * rng.standard_normal()))
    soil = draw_soil(rng)
    run = simulate_truth(variant_of(velocity), a_theta=true, soil=soil, settle=2.0, after=3.0)
    trial, motion = correct(log_run(20 + number, run).trial, robot)
    fit = fit_k92(motion, trial, robot, SOIL)
    found = a_theta_of(fit)
    assert found.value == pytest.approx(true, abs=2.5 * LARGEST)
    if fit.status_trajectory == "ok":  # elsewhere there is no std
        assert found.value == pytest.approx(true, abs=2.5 * found.std)
        assert found.std < LARGEST


@pytest.mark.slow
@pytest.mark.parametrize(
    ("trajectory", "trials", "least", "most"),
    [(False, 64, 58, 63), (True, 16, 13, 16)] if SOAK else [(False, 32, 28, 31), (True, 4, 3, 4)],
    ids=["by slip", "by trajectory"],
)
def test_the_95_percent_interval_holds_the_true_k92(
    trajectory: bool, trials: int, least: int, most: int
) -> None:
    """Each trial on its own sand; if 95 % are meant, so many inside have a chance of 0.92 and 0.99.

    Of 32 trials by slip, 28 to 31 have one of 0.79; the draws are the same in each run.
    """
    inside = 0
    for seed, variant in enumerate(islice(cycle(load_variants()), trials)):
        rng = np.random.default_rng([11, seed])
        k92 = math.exp(-4.919 * variant.velocity) * (1 + 0.05 * rng.standard_normal())
        run = simulate_k92(variant, ROBOT, draw_soil(rng), k92)
        motion, trial, _, _ = made_up_trial(variant, k92, seed=seed, run=run)
        fit = fit_k92(motion, trial, ROBOT, SOIL, trajectory=trajectory)
        low, high = (fit.k92_trajectory if trajectory else fit.k92).interval()
        inside += low <= k92 <= high
    assert least <= inside <= most


A_THETA, TENTH = 4.7, 0.1


@cache
def good() -> TruthTrial:
    run = simulate_truth(variant_of(0.5), a_theta=A_THETA, settle=2.0, after=3.0)
    return log_run(3, run, clock_offset=0.003)


def fitted(trial: Trial, robot: Robot) -> K92Fit:
    clean, motion = correct(trial, robot)
    return fit_k92(motion, clean, robot, load_soil())


@made_once
def plain() -> K92Fit:
    return fitted(good().trial, robot())


def apart(found: K92Fit) -> tuple[float, float]:
    """Difference to the good trial's k_92 by slip and by trajectory, over its std."""
    pairs = (found.k92, plain().k92), (found.k92_trajectory, plain().k92_trajectory)
    return tuple(abs(one.value - other.value) / other.std for one, other in pairs)


def test_good_trial_has_the_k92_of_the_simulator() -> None:
    for k92 in (plain().k92, plain().k92_trajectory):
        assert k92.value == pytest.approx(np.exp(-A_THETA * 0.5), abs=2 * k92.std)


@pytest.mark.parametrize(
    ("fault", "mounting"),
    sampled([
        pytest.param(lambda t: faults.turned(t, faults.SIDEWAYS), {"forward": "find"}, id="IMU axes found"),
        pytest.param(lambda t: faults.imu_restart(t, 0.8, gap=0.1), {}, id="restart at rest"),
    ]),
)  # fmt: skip
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


@pytest.mark.parametrize("by", [0.03, -0.03] if SOAK else [0.03])
@pytest.mark.xfail(reason="estimation leaves such an offset in the stamps: 0.7 to 0.9 std")
def test_an_offset_that_nobody_states_is_gone(by: float) -> None:
    assert max(apart(fitted(faults.late(good().trial, -by), robot()))) < TENTH
