"""Trials of any command, or with a controller that nobody knows, from the log to k_92. All are virtual."""

import dataclasses
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granite_lab import estimation, logs
from granite_lab.comparison.compare import compare
from granite_lab.discovery.discover import _observable
from granite_lab.effects import library
from granite_lab.errors import EstimateError, InputError
from granite_lab.estimation.motion import Motion
from granite_lab.estimation.outcome import find_phases
from granite_lab.fitting import fit_a_theta, fit_k92, simulate_k92, with_drive_input
from granite_lab.fitting.drive import FOLLOW, OBEYS, deviation, mistaken
from granite_lab.inference.setup import trial_models
from granite_lab.logs import write_canonical
from granite_lab.logs.trial import Trial, TrialInfo
from granite_lab.model import Accuracy, simulate
from granite_lab.model.virtual import virtual_trial
from granite_lab.parameters import Course, course_of, is_driven, load_robot, load_soil, variant_of
from tests.soak import sampled

ROBOT, SOIL = load_robot(), load_soil()
A_THETA = 4.5
JOYSTICK = course_of(
    np.array([0.0, 0.5, 2.5, 2.8, 4.5, 5.2, 7.0, 8.0]), np.array([0.0, 0.5, 0.5, 0.25, 0.3, 0.6, 0.6, 0.0])
)
HUMP = course_of(np.array([0.0, 2.0, 2.3, 5.0]), np.array([0.0, 0.5, 0.3, 0.0]))
"""Never steady."""


@cache
def logged(course: Course, *, gains: float = 1.0, command: bool = True, seed: int = 1) -> tuple[Trial, float]:
    """Return the log of a virtual run and when its command began; `gains` over those of the robot's file."""
    assert ROBOT.drive is not None
    drive = dataclasses.replace(
        ROBOT.drive, gain_p=gains * ROBOT.drive.gain_p, gain_d=gains * ROBOT.drive.gain_d
    )
    of = dataclasses.replace(ROBOT, drive=drive)
    run = simulate(course, of, SOIL, a_theta=A_THETA, accuracy=Accuracy(1e-6, 1e-8, 0.0025))
    trial, truth = virtual_trial(dataclasses.replace(run, robot=ROBOT), seed, f"joystick {gains:g}")
    return trial if command else dataclasses.replace(trial, command=None), float(truth.attrs["t_start_s"])


@cache
def seen(course: Course, *, gains: float = 1.0, command: bool = True, seed: int = 1) -> tuple[Trial, Motion]:
    return estimation.correct(logged(course, gains=gains, command=command, seed=seed)[0], ROBOT)


@cache
def plain() -> tuple[Trial, Motion]:
    """Return a trial of the trapezoid of 0.5 m/s."""
    run = simulate(variant_of(0.5), ROBOT, SOIL, a_theta=A_THETA)
    return estimation.correct(virtual_trial(run, 1, "plain")[0], ROBOT)


def exponent(motion: Motion, trial: Trial) -> tuple[float, float]:
    """Return a_θ by the k_92 of the trial, and its std [s/m]."""
    fit = fit_k92(motion, trial, ROBOT, SOIL, trajectory=False)
    assert fit.status == "ok"
    k92, v = fit.k92, motion.variant.velocity
    return -math.log(k92.value) / v, k92.std / k92.value / v


def test_a_logged_command_is_taken_as_it_is() -> None:
    trial, motion = seen(JOYSTICK)
    course = motion.variant
    assert motion.variant_source == "logged"
    assert isinstance(course, Course)
    start = logged(JOYSTICK)[1]
    assert abs(motion.t_start.value - start) < 2 * motion.t_start.std < 0.05
    t = np.linspace(-0.5, 9.0, 500)
    late = motion.t_start.value - start
    assert course.velocity_at(t) == pytest.approx(JOYSTICK.velocity_at(t + late), abs=0.01)
    assert with_drive_input(motion, ROBOT, "auto") is motion
    a, std = exponent(motion, trial)
    assert abs(a - A_THETA) < 2 * std < 0.6


@pytest.mark.parametrize("gains", sampled([0.3, 1.0]))
def test_wheels_drive_where_no_command_is_known(gains: float) -> None:
    trial, motion = seen(JOYSTICK, gains=gains, command=False)
    turned = with_drive_input(motion, ROBOT, "auto")
    assert turned.variant_source == "wheels"
    assert is_driven(turned.variant)
    assert "no command is stated" in turned.warnings[-1]
    assert "the mean of r ω" in turned.warnings[-1]
    a, std = exponent(turned, trial)
    assert abs(a - A_THETA) < 2 * std < 0.6


def test_the_fit_finds_by_how_much_a_command_that_is_not_stated_leads() -> None:
    """By (24), (26) it is k_e n_d / k_P of the acceleration, whose transients are left out."""
    gains, drive = 0.4, ROBOT.drive
    assert drive is not None
    trial, motion = seen(JOYSTICK, gains=gains, command=False)
    fit = fit_k92(with_drive_input(motion, ROBOT, "auto"), trial, ROBOT, SOIL)
    (note,) = [n for n in fit.notes if "leads the wheels" in n]
    lead, std = (float(x) for x in note.split(" by ")[1].removesuffix(" ms.").split(" ± "))
    assert abs(lead - 1e3 * drive.emf_constant * drive.gear_ratio / (gains * drive.gain_p)) < 3 * std < 120


@pytest.mark.parametrize("apart", [0.0, 0.01, -0.03, 0.03])
def test_sides_at_different_speed_are_told_and_turn_apart(apart: float) -> None:
    motion = seen(JOYSTICK, command=False)[1]
    turned = motion.v_wheel * np.array([1 - apart, 1 + apart, 1 - apart, 1 + apart])
    found = with_drive_input(dataclasses.replace(motion, v_wheel=turned), ROBOT, "wheels")
    told = [line for line in found.warnings if "faster than the others: each side is simulated" in line]
    assert len(told) == (abs(apart) > 0.02)
    assert not told or f"the {'right' if apart > 0 else 'left'} wheels are 6 % faster" in told[0]
    assert isinstance(found.variant, Course)
    assert bool(found.variant.split) == bool(told)
    for (_, *axles), split in zip(found.variant.wheels, found.variant.split, strict=bool(told)):
        for mean, half in zip(axles, split, strict=True):
            assert half.rate == pytest.approx(apart * mean.rate, abs=0.01)
            assert half.angle == pytest.approx(apart * mean.angle, abs=0.05)


@pytest.mark.parametrize("known", [[0, 1], [2, 3]])
def test_an_axle_without_encoders_turns_as_the_other_on_both_sides(known: list[int]) -> None:
    motion = seen(JOYSTICK, command=False)[1]
    v = np.full_like(motion.v_wheel, np.nan)
    v[:, known] = motion.v_wheel[:, known] * [0.95, 1.05]
    found = with_drive_input(dataclasses.replace(motion, v_wheel=v), ROBOT, "wheels").variant
    assert isinstance(found, Course)
    assert found.split
    assert all(front == rear for front, rear in found.split)


def test_sides_that_no_axle_tells_turn_alike() -> None:
    """The left wheel in front and the right one at the rear: who knows which axle is faster?"""
    motion = seen(JOYSTICK, command=False)[1]
    v = motion.v_wheel * [0.95, np.nan, np.nan, 1.05]
    found = with_drive_input(dataclasses.replace(motion, v_wheel=v), ROBOT, "wheels").variant
    assert isinstance(found, Course)
    assert not found.split


def test_wheels_drive_where_they_do_not_follow_the_command() -> None:
    _, motion = seen(JOYSTICK, gains=0.3)
    assert deviation(motion, motion.variant) > FOLLOW > 1.5 * deviation(seen(JOYSTICK)[1], JOYSTICK)
    turned = with_drive_input(motion, ROBOT, "auto")
    assert "deviate from the command" in turned.warnings[-1]
    assert "v_d of (5) is the command" in turned.warnings[-1]
    assert with_drive_input(motion, ROBOT, "command") is motion
    assert isinstance(turned.variant, Course)
    assert turned.variant.commanded


def test_wheels_drive_where_the_stated_drive_would_turn_them_otherwise() -> None:
    """A controller with 0.4 of the gains, on a command so gentle that the wheels follow it within 6 %."""
    gentle = course_of(np.array([0.0, 3.0, 6.0, 9.0]), np.array([0.0, 0.4, 0.4, 0.0]))
    motion, other = (seen(gentle, gains=gains)[1] for gains in (1.0, 0.4))
    assert deviation(other, gentle) < FOLLOW
    assert mistaken(motion, ROBOT, SOIL) < OBEYS / 2 < OBEYS < mistaken(other, ROBOT, SOIL)
    assert with_drive_input(motion, ROBOT, "auto", SOIL) is motion
    turned = with_drive_input(other, ROBOT, "auto", SOIL)
    assert "the drive of the robot's file would turn them" in turned.warnings[-1]
    assert is_driven(turned.variant)
    assert with_drive_input(other, ROBOT, "auto") is other


def test_a_theta_over_trials_goes_by_the_mean_speed_of_a_course_not_by_its_fastest() -> None:
    trial, motion = seen(JOYSTICK)
    fit = fit_k92(motion, trial, ROBOT, SOIL, trajectory=False)
    assert motion.variant.velocity < 0.95 * 0.6
    (point,) = fit_a_theta([fit]).points
    assert point[1] == motion.variant.velocity
    assert fit_a_theta([fit]).a_theta.value == pytest.approx(exponent(motion, trial)[0], rel=1e-6)


def test_a_run_by_hand_that_looks_like_a_variant_is_none() -> None:
    """With the fastest speed, the way and about the ramps of the variant of 0.5 m/s, but a dip in between."""
    times = np.array([0.0, 0.4, 2.2, 2.5, 3.8, 4.2, 5.9, 6.3])
    dip = course_of(times, np.array([0, 0.5, 0.5, 0.2, 0.2, 0.5, 0.5, 0]))
    motion = seen(dip, command=False)[1]
    like = dataclasses.replace(motion, variant=variant_of(0.5), variant_source="recognised")
    turned = with_drive_input(like, ROBOT, "auto")
    assert "no command is stated" in turned.warnings[-1]
    assert "the mean of r ω" in turned.warnings[-1]
    assert isinstance(turned.variant, Course)
    assert not turned.variant.commanded
    t = np.linspace(0.5, 6.0, 100)
    late = turned.t_start.value - logged(dip, command=False)[1]
    assert turned.variant.velocity_at(t - late) == pytest.approx(
        dip.velocity_at(t), abs=0.06
    )  # they follow a little late


def test_a_robot_without_drive_is_driven_by_its_wheels() -> None:
    trial, motion = seen(JOYSTICK)
    bare = dataclasses.replace(ROBOT, drive=None)
    turned = with_drive_input(motion, bare, "auto")
    assert "has no [drive]" in turned.warnings[-1]
    fit = fit_k92(turned, trial, bare, SOIL, trajectory=False)
    a = -math.log(fit.k92.value) / turned.variant.velocity
    assert abs(a - A_THETA) < 0.5
    found = compare(turned, trial, fit, simulate_k92(turned.variant, bare, SOIL, fit.k92.value))
    assert "torque_f" not in found.measured
    assert found.simulated["velocity"] == pytest.approx(found.measured["velocity"], abs=0.03)


def test_a_drive_that_is_never_steady_has_a_k92() -> None:
    trial, motion = seen(HUMP)
    assert any("never steady" in line for line in motion.warnings)
    a, std = exponent(motion, trial)
    assert abs(a - A_THETA) < 2 * std
    turned = with_drive_input(motion, ROBOT, "wheels")
    a, std = exponent(turned, trial)
    assert abs(a - A_THETA) < 2 * std


def test_what_turns_the_wheels_is_no_measurement_to_compare_with() -> None:
    trial, motion = seen(JOYSTICK)
    turned = with_drive_input(motion, ROBOT, "wheels")
    (plain,), _ = trial_models([trial], ROBOT, [motion])
    (model,), _ = trial_models([trial], ROBOT, [turned])
    assert set(plain.channels) - set(model.channels) == {"wheel", "wheel_split"}


def test_repeated_commands_are_one_command() -> None:
    pairs = [seen(JOYSTICK), seen(JOYSTICK, seed=2)]
    trials, motions = [t for t, _ in pairs], [m for _, m in pairs]
    assert motions[0].variant != motions[1].variant  # sampled at other instants
    models, variants = trial_models(trials, ROBOT, motions)
    assert len(variants) == 1
    assert {m.variant for m in models} == {0}


def test_wheels_of_repetitions_drive_simulations_of_their_own_under_one_command() -> None:
    pairs = [seen(JOYSTICK), seen(JOYSTICK, seed=2)]
    trials, motions = [t for t, _ in pairs], [m for _, m in pairs]
    models, variants = trial_models(trials, ROBOT, [with_drive_input(m, ROBOT, "wheels") for m in motions])
    assert len(variants) == 2
    assert {m.variant for m in models} == {0, 1}
    assert len({m.command for m in models}) == 1
    assert len({m.observation.bins for m in models}) == 1
    first, other = (m.observation.t for m in models)  # since the command, in which they agree
    assert first == pytest.approx(other)
    free = [
        with_drive_input(dataclasses.replace(m, variant_source="measured"), ROBOT, "wheels") for m in motions
    ]
    models, _ = trial_models(trials, ROBOT, free)
    assert {m.command for m in models} == {m.variant for m in models} == {0, 1}


def test_a_start_that_only_the_wheels_tell_is_put_right_by_the_fit() -> None:
    run = simulate(variant_of(0.7), ROBOT, SOIL, a_theta=A_THETA, accuracy=Accuracy(1e-6, 1e-8, 0.0025))
    written, truth = virtual_trial(run, 3, "late")
    trial, motion = estimation.correct(written, ROBOT)
    late = dataclasses.replace(motion.t_start, value=float(truth.attrs["t_start_s"]) + 0.03)
    turned = with_drive_input(dataclasses.replace(motion, t_start=late), ROBOT, "wheels")
    assert isinstance(turned.variant, Course)
    assert not turned.variant.stamped
    fit = fit_k92(turned, trial, ROBOT, SOIL)
    (note,) = [n for n in fit.notes if "leads the wheels" in n]
    lead, std = (float(x) for x in note.split(" by ")[1].removesuffix(" ms.").split(" ± "))
    wheels = 1e3 * motion.clock_offset.value  # the clocks are one; estimation takes the wheels to be late
    assert abs(lead - (30 - wheels)) < 3 * std < 10


def test_effects_that_the_wheels_replace_are_no_candidates() -> None:
    effects = dict(library(None))
    motion = seen(JOYSTICK)[1]
    free = with_drive_input(dataclasses.replace(motion, variant_source="measured"), ROBOT, "auto")
    told = with_drive_input(motion, ROBOT, "wheels")
    every, notes = _observable([motion], effects)
    assert (set(every), notes) == (set(effects) - {"clock_offset"}, [])
    fewer, notes = _observable([motion, told], effects)
    assert set(every) - set(fewer) == {
        "encoder_eccentricity", "gear_backlash", "supply_sag", "wheel_radius_error"
    }  # fmt: skip
    assert "1 of 2 trials" in notes[0]
    fewer, notes = _observable([free], effects)
    assert {"contact_angle_lag", "contact_angle_actual_speed"} < set(every) - set(fewer)
    assert len(notes) == 2


def test_a_command_stated_as_a_list_goes_through_the_log(tmp_path: Path) -> None:
    trial, start = logged(JOYSTICK, command=False)
    text = ", ".join(f"{t:g}:{v:g}" for t, v in JOYSTICK.path)
    stated = dataclasses.replace(trial, info=dataclasses.replace(trial.info, command=text))
    write_canonical(tmp_path / "log.csv", stated)
    back = logs.read_trial(tmp_path / "log.csv")
    assert back.info.command == text
    motion = estimation.correct(back, ROBOT)[1]
    assert motion.variant_source == "stated"
    assert isinstance(motion.variant, Course)
    assert motion.variant.path == JOYSTICK.path
    assert abs(motion.t_start.value - start) < 3 * motion.t_start.std


def test_a_command_that_is_no_list_is_refused_with_its_line(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text('# command = "0:0, fast"\nt_s,enc_fl_rad\n0,0\n')
    with pytest.raises(InputError, match=r"log.csv:1: command = '0:0, fast' is not valid"):
        logs.read_trial(log)


@pytest.mark.parametrize("period", [0.02, 0.1, 0.154, 0.3])
def test_the_start_of_a_short_ramp_is_found_within_its_std(period: float) -> None:
    """A robot that is at full speed within a sample or two, with rates as loud as of a Husky's log."""
    rng, off = np.random.default_rng(3), []
    for _ in range(60):
        begin, ramp = 2.0 + rng.uniform(0, period), 0.15
        t = np.arange(0, 12, period)
        speed = np.interp(t, [begin, begin + ramp, 9, 9.5], [0, 0.6, 0.6, 0]) + rng.normal(0, 0.003, t.size)
        found = find_phases(t, speed, [(0.0, begin - 0.3)])
        off.append((found.onset.value - begin) / found.onset.std)
        assert found.onset.std < 0.5 * period + 0.06
    assert np.mean(np.abs(off) < 2) > 0.9


def test_the_start_is_unknown_where_the_log_begins_in_motion() -> None:
    t = np.arange(0, 6, 0.1)
    speed = np.interp(t, [0, 4, 4.2], [0.6, 0.6, 0])
    assert math.isnan(find_phases(t, speed, [(4.5, 6.0)]).onset.value)


def test_a_log_without_wheels_cannot_be_driven_by_them() -> None:
    _, motion = seen(JOYSTICK)
    blind = dataclasses.replace(motion, v_wheel=np.full_like(motion.v_wheel, np.nan))
    with pytest.raises(EstimateError, match="the speeds of its wheels are not known"):
        with_drive_input(blind, ROBOT, "wheels")
    assert with_drive_input(blind, ROBOT, "auto") is blind


def test_a_stated_trapezoid_stays_unless_the_log_contradicts_it() -> None:
    _, motion = plain()
    assert (motion.variant, motion.variant_source) == (variant_of(0.5), "given")
    assert with_drive_input(motion, ROBOT, "auto") is motion
    other = logged(JOYSTICK)[0]
    told = TrialInfo(robot="granite", v_desired=0.5, a_max=1.2, distance=2.5)
    motion = estimation.correct(dataclasses.replace(other, info=told), ROBOT)[1]
    assert motion.variant_source == "logged"
    assert any("misses the stated trapezoid" in line for line in motion.warnings)


def test_a_trapezoid_gives_one_exponent_by_both_ways() -> None:
    """The same trial, driven by its command and by its wheels: a_θ differs by little of its std."""
    trial, motion = plain()
    turned = with_drive_input(motion, ROBOT, "wheels")
    (a, std), (other, _) = exponent(motion, trial), exponent(turned, trial)
    assert abs(a - other) < 0.3 * std
    assert turned.variant.velocity == pytest.approx(motion.variant.velocity, rel=0.01)


def test_wheels_that_turn_backwards_are_refused_with_when() -> None:
    _, motion = seen(JOYSTICK)
    turned = dataclasses.replace(
        motion, v_wheel=np.where(motion.t[:, None] > 5.0, -1.0, 1.0) * motion.v_wheel
    )
    with pytest.raises(EstimateError, match=r"the wheels turn backwards at 5\.0 to .* forward motion"):
        with_drive_input(turned, ROBOT, "wheels")
