"""What a laboratory knows about a trial, and an external reference that enters as a measurement."""

import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from granite_lab.errors import EstimateError
from granite_lab.estimation import Motion
from granite_lab.logs.trial import Series, Trial, part
from granite_lab.parameters import load_robot
from tests.soak import in_turn, sampled
from tests.truth.motion import estimate
from tests.truth.trials import TruthTrial, generate

STD = {"v": 0.008, "x": 0.004}


@cache
def truth() -> TruthTrial:
    return generate(71, velocity=0.3, grade="consumer", clock_offset=0.02, reference=True)


@cache
def noisy() -> Trial:
    """The trial with a reference of 50 Hz whose noise has the std that is stated."""
    rng, trial = np.random.default_rng(3), truth().trial
    t = trial.imu.t[0] + np.arange(0.013, np.ptp(trial.imu.t), 0.02)
    v, x = (Series(t, truth().at(t, k) + STD[k] * rng.standard_normal(t.size)) for k in ("v", "x"))
    return replace(trial, reference_v=v, reference_x=replace(x, value=x.value + 12.3))


def run(trial: Trial, **known: Any) -> Motion:
    return estimate(replace(trial, info=replace(trial.info, **known)), load_robot("granite", "consumer"))


@cache
def plain() -> Motion:
    """The estimate that no reference enters."""
    return run(noisy())


def between(trial: Trial, begin: float, end: float) -> Trial:
    streams = ("imu", "wheels", "reference_v", "reference_x")
    held = {name: getattr(trial, name) for name in streams}
    return replace(trial, **{n: part(s, (s.t >= begin) & (s.t <= end)) for n, s in held.items()})


def true_slip(motion: Motion) -> float:
    """λ_R by (2) with the true way over the wheels' own."""
    i, j = np.searchsorted(motion.t, motion.steady)
    own = motion.distance_wheels.value - motion.distance.value
    x, inside = truth().at(motion.t, "x"), slice(i, j)
    wheel = np.nanmean(motion.v_wheel[inside], axis=1)
    assert np.isfinite(own)
    return 1.0 - (x[j - 1] - x[i]) / float(np.trapezoid(wheel, motion.t[inside]))


KNOWN = {"velocity": {"ref_v_std": STD["v"]}, "place": {"ref_x_std": STD["x"]}}
KNOWN["both"] = KNOWN["velocity"] | KNOWN["place"]


@pytest.mark.parametrize("what", sampled(KNOWN))
def test_a_reference_makes_the_estimate_surer_and_better(what: str) -> None:
    motion = run(noisy(), use_reference=True, **KNOWN[what])
    before, after = (np.sqrt(np.mean((m.v - truth().at(m.t, "v")) ** 2)) for m in (plain(), motion))
    assert after < 0.5 * before
    assert motion.v_std.mean() < 0.5 * plain().v_std.mean()
    assert motion.slip_ratio.std < 0.4 * plain().slip_ratio.std
    assert abs(motion.slip_ratio.value - true_slip(motion)) < 3 * motion.slip_ratio.std + 1e-3
    within = np.abs(motion.v - truth().at(motion.t, "v")) <= 2 * motion.v_std
    assert within.mean() > 0.9
    assert motion.health.good
    total = np.sqrt(sum(part.contribution**2 for part in motion.slip_parts))
    assert total == pytest.approx(motion.slip_ratio.std, rel=1e-3)
    assert "external reference" in {part.name for part in motion.slip_parts[:3]}


@pytest.mark.parametrize("what", sampled(["place", "velocity"]))
def test_a_reference_takes_the_place_of_standstills(what: str) -> None:
    begin, end = plain().steady
    piece = between(noisy(), begin - 0.5, end)
    alone, motion = run(piece), run(piece, use_reference=True, **KNOWN[what])
    assert alone.health.grade == "poor"
    assert motion.health.grade == "fair"
    assert motion.slip_ratio.std < 0.01 < alone.slip_ratio.std
    assert abs(motion.slip_ratio.value - true_slip(motion)) < 3 * motion.slip_ratio.std
    assert "anchored by the external reference" in motion.health.verdict


def test_a_reference_that_contradicts_the_sensors_is_told() -> None:
    wrong = replace(noisy(), reference_v=Series(noisy().reference_v.t, 1.4 * noisy().reference_v.value))
    motion = run(wrong, use_reference=True, ref_v_std=0.005)
    assert not motion.health.good
    assert "reference" in motion.health.verdict


@pytest.mark.parametrize("what", sampled(["place", "velocity"]))
def test_of_a_reference_that_goes_farther_than_the_imu_either_may_be_right(what: str) -> None:
    v, x = (replace(s, value=1.1 * s.value) for s in (noisy().reference_v, noisy().reference_x))
    motion = run(replace(noisy(), reference_v=v, reference_x=x), use_reference=True, **KNOWN[what])
    assert motion.health.grade != "good"
    assert "the reference goes" in motion.health.verdict
    assert "check scale" in motion.health.verdict
    assert "bias changed" not in motion.health.verdict
    assert abs(motion.slip_ratio.value - true_slip(motion)) < 3 * motion.slip_ratio.std


def test_an_imu_that_goes_farther_than_the_wheels_roll_is_blamed_and_not_the_reference() -> None:
    trial, (begin, end) = noisy(), plain().steady
    force, middle = trial.imu.specific_force.copy(), (begin + end) / 2
    force[(trial.imu.t > middle) & (trial.imu.t < middle + 1.0), 0] += 20.0
    broken = replace(trial, imu=replace(trial.imu, specific_force=force))
    verdict = run(broken, use_reference=True, **KNOWN["velocity"]).health.verdict
    assert "the reference goes" in verdict
    assert "check the IMU" in verdict
    assert "check scale" not in verdict


@pytest.mark.parametrize(("what", "late"), in_turn(["velocity", "place"], [-0.5, 0.5]))
def test_a_reference_by_another_clock_is_named(what: str, late: float) -> None:
    v, x = (replace(s, t=s.t + late) for s in (noisy().reference_v, noisy().reference_x))
    motion = run(replace(noisy(), reference_v=v, reference_x=x), use_reference=True, **KNOWN[what])
    assert motion.health.grade != "good"
    told = re.search(r"(0\.[4-6]) s (after|before) the wheels", motion.health.verdict)
    assert told
    assert (told[2] == "after") == (late > 0)
    assert abs(motion.slip_ratio.value - true_slip(motion)) < 2 * motion.slip_ratio.std


def test_places_too_rough_to_tell_a_speed_are_said_to_be_of_no_use() -> None:
    places = replace(noisy(), reference_v=replace(noisy().reference_v, places=5))
    places = replace(places, reference_x=replace(noisy().reference_x, places=5))
    assert any(
        "the reference is not used" in w for w in run(places, use_reference=True, ref_x_std=0.8).warnings
    )
    assert not any("not used" in w for w in run(places, use_reference=True, ref_x_std=STD["x"]).warnings)


def test_a_distance_by_tape_in_another_unit_is_refused() -> None:
    with pytest.raises(EstimateError, match="m that the wheels roll"):
        run(noisy(), distance_measured=205.0)


def test_speed_by_places_in_a_plane_takes_its_direction_from_the_wheels() -> None:
    back = noisy()
    wheels = replace(back.wheels, angle=-back.wheels.angle)
    force, rate = back.imu.specific_force * [-1, 1, 1], back.imu.angular_rate * [1, -1, 1]
    imu = replace(back.imu, specific_force=force, angular_rate=rate)
    v = replace(back.reference_v, places=5)
    x = replace(back.reference_x, places=5)
    back = replace(back, wheels=wheels, imu=imu, reference_v=v, reference_x=x)
    motion = run(replace(back, info=replace(back.info, ref_x_std=STD["x"])), use_reference=True)
    middle = (motion.t > motion.steady[0]) & (motion.t < motion.steady[1])
    assert motion.v[middle].max() < -0.2


@pytest.mark.parametrize(
    ("drop", "message"),
    [((), "its std is not known"), (("reference_v", "reference_x"), "there is no external reference")],
)
def test_a_reference_without_std_or_none_at_all_is_refused(drop: tuple[str, ...], message: str) -> None:
    with pytest.raises(EstimateError, match=message):
        run(replace(noisy(), **dict.fromkeys(drop)), use_reference=True)


def test_what_a_trial_says_of_itself_is_what_a_caller_may_say() -> None:
    way = float(truth().at(noisy().imu.t[-1], "x") - truth().at(noisy().imu.t[0], "x"))
    motion = run(noisy(), rests=((0.1, 1.0),), distance_measured=way)
    assert motion.distance.std < 0.006
    assert run(noisy(), distance_measured=way, distance_measured_std=0.5).distance.std > 0.01


def test_a_standstill_in_which_the_wheels_turn_is_one_of_the_body_only() -> None:
    begin, end = plain().steady
    with pytest.raises(EstimateError, match="the wheels roll") as refusal:
        run(noisy(), rests=((begin, end),))
    assert "body_rests" in refusal.value.hint
