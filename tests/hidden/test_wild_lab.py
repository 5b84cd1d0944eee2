"""Laboratories drawn by a seed: repeatable, within their ranges, and such that a robot drives there."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granite_lab.api.hidden import hide, reveal
from granite_lab.errors import UsageError
from granite_lab.hidden.contact import faster, forces_by_loops, forces_of_arrays
from granite_lab.hidden.lab import Lab, bench, drives, lab_of, wild
from granite_lab.hidden.making import make_set
from granite_lab.hidden.sealed import open_answer
from granite_lab.hidden.sensors import read_imu
from granite_lab.hidden.wish import Wish
from granite_lab.logs import read_trial
from granite_lab.parameters import Variant, load_robot, load_soil
from tests.corpus import cli
from tests.truth.simulator import body_from_run, simulate

SHORT = (Variant(velocity=0.3, acceleration=1.2, distance=0.4),)


@lru_cache
def labs() -> tuple[Lab, ...]:
    return tuple(wild(seed, load_robot(), load_soil()) for seed in range(80))


def test_a_seed_is_one_laboratory_and_another_seed_is_another() -> None:
    assert wild(3, load_robot(), load_soil()) == labs()[3]
    assert len({lab.late for lab in labs()}) == len(labs())
    with pytest.raises(UsageError, match="unknown laboratory 'wlid'"):
        lab_of("wlid", 0, load_robot(), load_soil())


def test_on_the_bench_all_is_as_filed() -> None:
    lab = bench(load_robot(), load_soil())
    assert (lab.robot, lab.soil) == (lab.filed, lab.filed_soil) == (load_robot(), load_soil())
    assert (lab.files(), lab.radius, lab.drawn) == ({}, 0.0, {})


def test_loggers_fill_the_ranges_that_are_documented() -> None:
    def values(pick: Any) -> np.ndarray:
        return np.array([pick(lab) for lab in labs()])

    assert set(values(lambda x: x.robot.imu_grade.rate)) == {100, 125, 200, 250, 400}
    assert set(values(lambda x: x.robot.encoders.rate)) == {50, 100, 200}
    assert set(values(lambda x: x.repetitions)) == {2, 3, 4}
    for pick, low, high in (
        (lambda x: x.late, 0.0, 0.008),
        (lambda x: x.radius, 5e-4, 4e-3),
        (lambda x: x.robot.currents.gain, 0.01, 0.04),
        (lambda x: x.robot.imu.tilt, 0.2, 1.2),
        (lambda x: x.scatter["frictional_modulus"], 0.04, 0.10),
        (lambda x: x.scatter["cohesion"], 0.03, 0.07),
        (lambda x: x.scatter["a_theta"], 0.02, 0.05),
        (lambda x: x.before[0], 0.7, 3.5),
        (lambda x: x.after[0], 0.7, 3.5),
    ):
        found = values(pick)
        assert low <= found.min() < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < found.max() <= high
    arms = values(lambda x: x.robot.imu.x - x.filed.imu.x)
    assert arms.std() == pytest.approx(0.01, rel=0.3)
    locks = values(lambda x: x.near_rest.holds_below > 0)
    assert 0.3 < locks.mean() < 0.7


def test_every_robot_can_drive_and_two_fifths_are_others() -> None:
    assert all(drives(lab) for lab in labs())
    others = [lab for lab in labs() if lab.robot_name == "robot.toml"]
    assert 0.25 < len(others) / len(labs()) < 0.6
    for key in ("radius", "width", "length", "mass"):
        factors = np.array([lab.drawn["robot"][key] for lab in others])
        assert 0.5 <= factors.min() < 0.75
        assert 1.6 < factors.max() <= 2.0
    names = {lab.filed_soil.name for lab in labs()}
    assert names == {"dry_sand", "dry_sand_lll", "lete_sand", "hit_simulant", "regolith_simulant"}
    buried = replace(labs()[0], soil=replace(labs()[0].soil, frictional_modulus=1e5, cohesive_modulus=0.0))
    assert not drives(buried)


def test_another_robot_keeps_top_speed_and_time_constants() -> None:
    base = load_robot()
    for lab in labs():
        ch, d, own, drive = base.chassis, base.drive, lab.filed.chassis, lab.filed.drive
        assert ch and d and own and drive  # noqa: PT018
        top = drive.voltage_max / (drive.emf_constant * drive.gear_ratio) * lab.filed.wheels.radius
        assert top == pytest.approx(d.voltage_max / (d.emf_constant * d.gear_ratio) * base.wheels.radius)
        assert drive.inductance / drive.resistance == pytest.approx(d.inductance / d.resistance)
        assert drive.gain_p / drive.gain_d == pytest.approx(d.gain_p / d.gain_d)
        assert own.contact_damping / own.total_mass == pytest.approx(ch.contact_damping / ch.total_mass)


def test_stamps_at_the_end_of_the_interval_are_late_by_half_of_it_and_the_latency() -> None:
    run = simulate(SHORT[0], a_theta=4.919)
    body, robot = body_from_run(run, steady=(0.3, 0.4)), load_robot()
    given = [
        read_imu(np.random.default_rng(1), body, robot, scale_error=0.0, jitter=0.0, late=late)[0]
        for late in (None, 0.006)
    ]
    assert given[1].t - given[0].t == pytest.approx(np.full(given[0].t.size, 0.006 + 0.5 / 200))
    assert (given[0].specific_force == given[1].specific_force).all()


def test_the_trials_of_a_seed_share_the_laboratory_whatever_is_hidden() -> None:
    made = [
        make_set(Wish(effect, 5, lab="wild"), load_robot(), load_soil(), repetitions=1, variants=SHORT)
        for effect in ("none", "torque_constant_error")
    ]
    (one, other) = (answer for _, answer in made)
    assert one["lab"] == other["lab"]
    (a, b) = (answer["trials"]["hidden_v0.3_r1"] for answer in (one, other))
    assert (a["raking"], a["radii"]) == (b["raking"], b["radii"])
    assert np.std(a["radii"]) < 4 * one["lab"]["wheels"]["radius"]
    first, second = (trials[0].wheels for trials, _ in made)
    assert first.t.size == second.t.size  # it stands still as long


def test_wheels_roll_by_their_radii_or_are_counted_by_them() -> None:
    for rolls in (True, False):
        seed = next(seed for seed, lab in enumerate(labs()) if lab.rolls == rolls and lab.radius > 0.002)
        (trial,), answer = make_set(
            Wish("none", seed, lab="wild"), load_robot(), load_soil(), repetitions=1, variants=SHORT
        )
        radii = np.array(answer["trials"]["hidden_v0.3_r1"]["radii"])
        angle = trial.wheels.angle[-1]
        apart = np.ptp(angle) / angle.mean()
        assert apart == pytest.approx(0.0 if rolls else np.ptp(1 / radii), abs=1e-4)


@pytest.mark.parametrize("name", ["numba", None])
def test_without_a_compiler_arrays_are_used(name: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    if name:
        monkeypatch.setitem(sys.modules, name, None)
    chosen = faster.__wrapped__(forces_by_loops, forces_of_arrays)
    assert (chosen is forces_of_arrays) == (name is not None)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set with a robot and a sand of its own."""
    own = (
        seed
        for seed, lab in enumerate(labs())
        if {lab.robot_name, lab.soil_name} == {"robot.toml", "soil.toml"}
    )
    out = tmp_path_factory.mktemp("wild") / "set"
    hide("none", out, seed=next(own), lab="wild", repetitions=1)
    return out


def test_robot_and_sand_lie_beside_the_trials_and_are_found_from_anywhere(folder: Path) -> None:
    answer = open_answer(folder)
    lab = wild(answer["seed"], load_robot(), load_soil())
    for log in sorted(folder.glob("*.csv")):
        trial = read_trial(log)
        assert not trial.warnings
        assert load_robot(trial.info.robot or "") == lab.filed
        assert load_soil(trial.info.soil or "") == lab.filed_soil
        rolled = trial.wheels.angle[-1].mean() * lab.filed.wheels.radius
        assert rolled == pytest.approx(trial.info.distance, rel=0.02)
    assert lab.filed.imu.x != lab.robot.imu.x


def test_the_sealed_answer_holds_what_was_drawn(folder: Path) -> None:
    drawn = reveal(folder).answer["lab"]
    assert drawn["name"] == "wild"
    assert {"robot", "soil", "sand_off", "scatter", "imu", "wheels", "currents", "near_rest"} <= set(drawn)
    shown = cli.lab("reveal", folder).out
    assert "Nothing is hidden" in shown
    assert "near_rest: holds_below" in shown


def test_the_offset_of_the_clocks_is_told_as_the_stamps_show_it() -> None:
    """An IMU that is late itself adds to encoders that are early."""
    lab, sizes = labs()[3], {"clock_offset.offset": -0.03}
    wish = Wish("clock_offset", 3, lab="wild", sizes=sizes)
    _, answer = make_set(wish, load_robot(), load_soil(), variants=SHORT, repetitions=1)
    late = lab.late + 0.5 / lab.robot.imu_grade.rate
    told = answer["effects"][0]["parameters"]["offset"]["value"]
    assert told == pytest.approx(-0.03 - late)
    assert late > 0.001
