"""Sets and laboratories of virtual trials: readable, repeatable, telling nothing of what is hidden."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granite_lab.api.hidden import hide, reveal
from granite_lab.errors import EstimateError, UsageError
from granite_lab.hidden.catalogue import LAWS, LIBRARY, OUTSIDE, TWINS, influence, model_of
from granite_lab.hidden.command import trapezoid
from granite_lab.hidden.gaps import LEAST
from granite_lab.hidden.lab import Filed, Lab, bench, drives, lab_of, wild
from granite_lab.hidden.making import make_set
from granite_lab.hidden.mixture import motion_of, share_closed
from granite_lab.hidden.model import Setup
from granite_lab.hidden.parts import exponential_k92
from granite_lab.hidden.sealed import open_answer
from granite_lab.hidden.sensors import Logger, felt_at, read_imu, with_noise
from granite_lab.hidden.simulator import body_from_states
from granite_lab.hidden.spec import SAND_OFF, Spec, chosen, drawn, sand
from granite_lab.logs import read_trial
from granite_lab.logs.trial import Trial
from granite_lab.parameters import Variant, load_robot, load_soil
from tests.corpus.cli import lab as command
from tests.running.processes import two_variants
from tests.truth.simulator import body_from_run, simulate

SHORT = (Variant(velocity=0.3, acceleration=1.2, distance=0.4),)


@lru_cache
def one(effect: str, seed: int = 11, lab: str = "bench", **given: Any) -> tuple[Trial, dict[str, Any]]:
    spec = Spec(effect, seed, sizes=dict(given.pop("sizes", ())), repetitions=1, variants=SHORT, **given)
    ((trial, _),), answer = make_set(spec, lab_of(lab, seed, load_robot(), load_soil()))
    return trial, answer


def stamps(trial: Trial) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return trial.imu.t, trial.wheels.t, trial.currents.t


def test_lots_fall_where_they_may_but_always_the_same_way() -> None:
    assert chosen(Spec("none", 1)) == ()
    singles = {chosen(Spec("random", seed)) for seed in range(300)}
    assert singles == {(name,) for name in LIBRARY}
    assert {chosen(Spec("outside", seed)) for seed in range(150)} == {(name,) for name in OUTSIDE}
    pairs = [chosen(Spec("pair", seed)) for seed in range(60)]
    assert all(len(pair) == 2 and frozenset(pair) not in TWINS for pair in pairs)
    assert pairs == [chosen(Spec("pair", seed)) for seed in range(60)]
    assert chosen(Spec("tyre_windup + drive_reaction", 1)) == ("drive_reaction", "tyre_windup")


def test_a_strength_scales_how_much_and_not_how() -> None:
    base, double = (
        drawn(Spec("tyre_windup", 4, strength=x), ("tyre_windup",))["tyre_windup"] for x in (1, 2)
    )
    assert double["compliance"] == pytest.approx(2 * base["compliance"])
    assert double["retardation"] == base["retardation"]
    signs = {np.sign(drawn(Spec("imu_tilt", seed), ("imu_tilt",))["imu_tilt"]["tilt"]) for seed in range(20)}
    assert signs == {-1.0, 1.0}


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        (Spec("tyre_windap", 0), "unknown hidden effect 'tyre_windap'"),
        (Spec("imu_tilt+imu_tilt", 0), "named twice"),
        (Spec("imu_tilt", 0, sizes={"tlit": 1.0}), "no hidden effect has such a parameter"),
        (Spec("none", 0, sizes={"tilt": 1.0}), "no hidden effect has such a parameter"),
        (Spec("imu_tilt", 0, sizes={"tilt": 100.0}), "out of range"),
    ],
)
def test_what_cannot_be_hidden_is_said(spec: Spec, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        drawn(spec, chosen(spec))


def test_sand_off_its_file_is_off_by_five_to_twenty_percent_either_way() -> None:
    soil = load_soil()
    assert sand(Spec("none", 0), soil) == (soil, {})
    factors = np.array(
        [[sand(Spec("none", s, sand_off=True), soil)[1][k] for k in SAND_OFF] for s in range(50)]
    )
    off = np.abs(factors - 1)
    assert off.min() >= 0.05
    assert off.max() <= 0.20
    assert ((factors > 1).mean(axis=0) > 0.2).all()
    assert ((factors < 1).mean(axis=0) > 0.2).all()
    there, known = sand(Spec("none", 3, sand_off=True), soil)
    assert there.friction_angle == pytest.approx(soil.friction_angle * known["friction_angle"])


def test_a_robot_that_digs_itself_in_or_has_no_drive_is_not_logged() -> None:
    spec = Spec("bulldozing", 1, sizes={"strength": 8.0}, repetitions=1, variants=SHORT)
    with pytest.raises(EstimateError, match="sinks to its axles"):
        make_set(spec, bench(load_robot(), load_soil()))
    with pytest.raises(UsageError, match="cannot be simulated"):
        lab_of("bench", 0, load_robot("husky"), load_soil())


def test_each_trial_has_sand_and_phases_of_its_own_and_the_set_has_one_size() -> None:
    spec = Spec("wheel_eccentricity", 2, repetitions=2, variants=SHORT)
    _, answer = make_set(spec, bench(load_robot(), load_soil()))
    first, second = answer["trials"].values()
    assert first["raking"] != second["raking"]
    size = answer["effects"][0]["parameters"]["amplitude_front"]["value"]
    for trial in (first, second):
        sizes = trial["sizes"]["wheel_eccentricity"]
        assert np.hypot(sizes["cos_front"], sizes["sin_front"]) == pytest.approx(size)
    assert first["sizes"] != second["sizes"]


def test_late_stamps_are_late_and_nothing_else() -> None:
    (base, _), (late, _) = one("none"), one("clock_offset", sizes=(("offset", 0.02),))
    imu, wheels, currents = stamps(base)
    other_imu, other_wheels, other_currents = stamps(late)
    assert (imu == other_imu).all()
    assert other_wheels - wheels == pytest.approx(0.02, abs=2e-6)
    assert other_currents - currents == pytest.approx(0.022, abs=2e-6)  # their message follows
    assert (late.wheels.angle == base.wheels.angle).all()


def test_a_wrong_radius_scales_the_angles_and_nothing_else() -> None:
    (base, _), (wrong, _) = one("none"), one("wheel_radius_error", sizes=(("error", -0.02),))
    angle, other = base.wheels.angle, wrong.wheels.angle
    sides = np.array([17, 15, 17, 15]) / 16  # the left wheels' error is larger
    assert other[-1] == pytest.approx((1 - 0.02 * sides) * angle[-1], abs=2e-4)
    assert (base.imu.specific_force == wrong.imu.specific_force).all()


def test_tilt_and_scale_are_felt_as_gravity_says() -> None:
    felt = {}
    for name, sizes in (
        ("none", ()),
        ("imu_tilt", (("tilt", 2.0),)),
        ("accel_scale_error", (("x", 0.03), ("z", 0.01))),
    ):
        trial, _ = one(name, sizes=sizes)
        felt[name] = trial.imu.specific_force[trial.imu.t < 1.2].mean(axis=0)
    g = 9.81
    tilted = [-g * np.sin(np.radians(2)), g * np.sin(np.radians(0.5)), -6e-3]
    assert felt["imu_tilt"] - felt["none"] == pytest.approx(tilted, abs=5e-3)
    scaled = [0.003 * g, 0, 0.01 * g]  # a tenth of x's error comes across from z
    assert felt["accel_scale_error"] - felt["none"] == pytest.approx(scaled, abs=5e-3)


def test_a_slope_is_felt_at_rest_by_its_share_of_gravity() -> None:
    sizes = {"ground_slope": {"slope": 1.5}}
    law, command = exponential_k92(4.919), trapezoid(0.3, 1.2, 0.4)
    felt = []
    for names in ((), ("ground_slope",)):
        truth = model_of(names, Setup(load_robot(), load_soil(), law), command, sizes)
        t = np.asarray(1e-3 * np.arange(-200, 0))
        force, _ = felt_at(body_from_states(truth, t, np.tile(truth.rest(), (t.size, 1))), 0.1, 0.12)
        felt.append(force[100])
    turned = np.arctan2(felt[1][0], felt[1][2]) - np.arctan2(felt[0][0], felt[0][2])
    assert np.degrees(turned) == pytest.approx(1.5, abs=0.02)  # but for the squat under the slope's moment
    assert np.linalg.norm(felt[1]) == pytest.approx(9.81)


def test_louder_sensors_are_as_much_louder_at_rest_and_in_motion() -> None:
    quiet, loud = one("none")[0], one("none", noise=3.0)[0]
    for part in (slice(20, 200), slice(400, 550)):
        spread = [np.diff(t.imu.specific_force[part, 1]).std() for t in (quiet, loud)]
        assert spread[1] / spread[0] == pytest.approx(3.0, rel=0.1)
    robot = load_robot()
    assert with_noise(robot, 1.0) == robot
    kept = with_noise(robot, 3.0).imu_grade
    assert kept.accel_bias == robot.imu_grade.accel_bias


def test_the_trial_stands_still_at_both_ends_at_unknown_instants() -> None:
    starts = []
    for seed in (1, 2, 3):
        trial, _ = one("none", seed=seed)
        _, t, _ = stamps(trial)
        moving = np.abs(np.diff(trial.wheels.angle[:, 0])) > 2e-4
        starts.append(t[np.argmax(moving)])
        assert t[-1] - t[1:][moving][-1] > 1.5
    assert min(starts) > 1.4
    assert np.ptp(starts) > 0.05


HIDE = ("hide", "--effect", "random", "--seed", 21, "--repetitions", 1, "--quiet")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One repetition of two variants with a random effect, written by the command."""
    out = tmp_path_factory.mktemp("hidden") / "set"
    with pytest.MonkeyPatch.context() as patch:
        two_variants(patch)
        assert command(*HIDE, "--out", out).code == 0
    return out


def test_a_set_can_be_read_and_says_that_it_is_virtual(folder: Path) -> None:
    files = sorted(folder.glob("*.csv"))
    assert [f.stem for f in files] == [f"hidden_v{v}_r1" for v in ("0.5", "0.7")]
    for file in files:
        assert "# virtual = true\n" in file.read_text(encoding="utf-8")
        trial = read_trial(file)
        assert trial.info.virtual
        assert not trial.warnings
        assert (trial.info.robot, trial.info.soil, trial.info.repetition) == ("granite", "dry_sand", 1)
        assert trial.info.v_desired == float(file.stem.split("_")[1][1:])
        assert trial.wheels.angle[-1].mean() * 0.0965 == pytest.approx(trial.info.distance, rel=0.05)


def test_no_file_of_a_set_names_what_is_hidden(folder: Path) -> None:
    for file in folder.iterdir():
        text = file.read_bytes().decode().lower()
        assert not [name for name in (*LIBRARY, *OUTSIDE) if name in text or name.replace("_", " ") in text]
    heads = {
        tuple(line.split("=")[0] for line in file.read_text(encoding="utf-8").splitlines() if line[0] == "#")
        for file in folder.glob("*.csv")
    }
    assert len(heads) == 1
    assert not any("seed" in line for line in heads.pop())


@pytest.mark.usefixtures("two_variants")
def test_a_seed_gives_the_same_bytes_which_nothing_overwrites_unasked(folder: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    assert command(*HIDE, "--out", again, "--jobs", 2).code == 0
    files = sorted(file.name for file in folder.iterdir())
    assert files == sorted(file.name for file in again.iterdir())
    assert command("hide", "--effect", "none", "--out", folder, "--quiet").code == 2
    for name in files:
        assert (folder / name).read_bytes() == (again / name).read_bytes()


@pytest.mark.usefixtures("two_variants")
def test_a_laboratory_is_drawn_once_for_a_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Lab] = []

    def watched(drawn: Lab) -> bool:
        seen.append(drawn)
        return drives(drawn)

    monkeypatch.setattr("granite_lab.hidden.lab.drives", watched)
    hide("none", tmp_path, lab="wild", seed=3, repetitions=1)
    refused, taken = seen[:-1], seen[-1]
    assert not any(drives(one) for one in refused)
    assert drives(taken)
    assert open_answer(tmp_path)["lab_a_theta"] == taken.a_theta


@lru_cache
def labs() -> tuple[Lab, ...]:
    return tuple(wild(seed, load_robot(), load_soil()) for seed in range(80))


def test_a_seed_is_one_laboratory_and_another_seed_is_another() -> None:
    assert wild(3, load_robot(), load_soil()) == labs()[3]
    assert len({lab.logger.late for lab in labs()}) == len(labs())
    at_home = bench(load_robot(), load_soil())  # where all is as filed
    assert at_home.robot == Filed("granite", load_robot(), load_robot())
    assert at_home.soil == Filed("dry_sand", load_soil(), load_soil())
    assert (at_home.files(), at_home.radius) == ({}, 0.0)
    with pytest.raises(UsageError, match="unknown laboratory 'wlid'"):
        lab_of("wlid", 0, load_robot(), load_soil())


def test_loggers_fill_the_ranges_that_are_documented() -> None:
    def values(pick: Any) -> np.ndarray:
        return np.array([pick(lab) for lab in labs()])

    assert set(values(lambda x: x.robot.real.imu_grade.rate)) == {100, 125, 200, 250, 400}
    assert set(values(lambda x: x.robot.real.encoders.rate)) == {50, 100, 200}
    assert set(values(lambda x: x.repetitions)) == {2, 3, 4}
    for pick, low, high in (
        (lambda x: x.logger.late, 0.0, 0.008),
        (lambda x: x.radius, 5e-4, 4e-3),
        (lambda x: x.robot.real.currents.gain, 0.01, 0.04),
        (lambda x: x.robot.real.imu.tilt, 0.2, 1.2),
        (lambda x: x.scatter["frictional_modulus"], 0.04, 0.10),
        (lambda x: x.scatter["cohesion"], 0.03, 0.07),
        (lambda x: x.scatter["a_theta"], 0.02, 0.05),
        (lambda x: x.before[0], 0.7, 3.5),
        (lambda x: x.after[0], 0.7, 3.5),
    ):
        found = values(pick)
        assert low <= found.min() < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < found.max() <= high
    arms = values(lambda x: x.robot.real.imu.x - x.robot.filed.imu.x)
    assert arms.std() == pytest.approx(0.01, rel=0.3)
    locks = values(lambda x: x.near_rest.holds_below > 0)
    assert 0.3 < locks.mean() < 0.7


def test_every_robot_can_drive_and_two_fifths_are_others() -> None:
    assert all(drives(lab) for lab in labs())
    others = [lab for lab in labs() if lab.robot.name == "robot.toml"]
    assert 0.25 < len(others) / len(labs()) < 0.6
    base = load_robot()
    for measure in (
        lambda robot: robot.wheels.radius,
        lambda robot: robot.wheels.width,
        lambda robot: robot.chassis.track,
        lambda robot: robot.chassis.total_mass,
    ):
        factors = np.array([measure(lab.robot.filed) / measure(base) for lab in others])
        assert 0.5 <= factors.min() < 0.75
        assert 1.6 < factors.max() <= 2.0
    names = {lab.soil.filed.name for lab in labs()}
    assert names == {"dry_sand", "dry_sand_lll", "lete_sand", "hit_simulant", "regolith_simulant"}
    mud = replace(labs()[0].soil.real, frictional_modulus=1e5, cohesive_modulus=0.0)
    buried = replace(labs()[0], soil=replace(labs()[0].soil, real=mud))
    assert not drives(buried)


def test_another_robot_keeps_top_speed_and_time_constants() -> None:
    base = load_robot()
    for lab in labs():
        ch, d, own, drive = base.chassis, base.drive, lab.robot.filed.chassis, lab.robot.filed.drive
        assert ch and d and own and drive  # noqa: PT018
        top = drive.voltage_max / (drive.emf_constant * drive.gear_ratio) * lab.robot.filed.wheels.radius
        assert top == pytest.approx(d.voltage_max / (d.emf_constant * d.gear_ratio) * base.wheels.radius)
        assert drive.inductance / drive.resistance == pytest.approx(d.inductance / d.resistance)
        assert drive.gain_p / drive.gain_d == pytest.approx(d.gain_p / d.gain_d)
        assert own.contact_damping / own.total_mass == pytest.approx(ch.contact_damping / ch.total_mass)


def test_stamps_at_the_end_of_the_interval_are_late_by_half_of_it_and_the_latency() -> None:
    run = simulate(SHORT[0], a_theta=4.919)
    body, robot = body_from_run(run, steady=(0.3, 0.4)), load_robot()
    given = [
        read_imu(np.random.default_rng(1), body, robot, Logger(late, jitter=0.0, gain=0.0))[0]
        for late in (None, 0.006)
    ]
    assert given[1].t - given[0].t == pytest.approx(np.full(given[0].t.size, 0.006 + 0.5 / 200))
    assert (given[0].specific_force == given[1].specific_force).all()


def test_the_trials_of_a_seed_share_the_laboratory_whatever_is_hidden() -> None:
    (first, plain), (second, other) = (one(e, 5, lab="wild") for e in ("none", "torque_constant_error"))
    assert plain["lab"] == other["lab"]
    (a, b) = (answer["trials"]["hidden_v0.3_r1"] for answer in (plain, other))
    assert (a["raking"], a["radii"]) == (b["raking"], b["radii"])
    assert np.std(a["radii"]) < 4 * plain["lab"]["radius"]
    assert first.wheels.t.size == second.wheels.t.size  # it stands still as long


def test_wheels_roll_by_their_radii_or_are_counted_by_them() -> None:
    for rolls in (True, False):
        seed = next(seed for seed, lab in enumerate(labs()) if lab.rolls == rolls and lab.radius > 0.002)
        trial, answer = one("none", seed, lab="wild")
        radii = np.array(answer["trials"]["hidden_v0.3_r1"]["radii"])
        angle = trial.wheels.angle[-1]
        apart = np.ptp(angle) / angle.mean()
        assert apart == pytest.approx(0.0 if rolls else np.ptp(1 / radii), abs=1e-4)


@pytest.fixture(scope="module")
def wild_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set with a robot and a sand of its own."""
    own = (
        seed
        for seed, lab in enumerate(labs())
        if {lab.robot.name, lab.soil.name} == {"robot.toml", "soil.toml"}
    )
    out = tmp_path_factory.mktemp("wild") / "set"
    with pytest.MonkeyPatch.context() as patch:
        two_variants(patch)
        hide("none", out, seed=next(own), lab="wild", repetitions=1)
    return out


def test_robot_and_sand_lie_beside_the_trials_and_are_found_from_anywhere(wild_folder: Path) -> None:
    answer = open_answer(wild_folder)
    lab = wild(answer["seed"], load_robot(), load_soil())
    logs = sorted(wild_folder.glob("*.csv"))
    assert len(logs) == 2
    for log in logs:
        trial = read_trial(log)
        assert not trial.warnings
        assert load_robot(trial.info.robot or "") == lab.robot.filed
        assert load_soil(trial.info.soil or "") == lab.soil.filed
        rolled = trial.wheels.angle[-1].mean() * lab.robot.filed.wheels.radius
        assert rolled == pytest.approx(trial.info.distance, rel=0.02)
    assert lab.robot.filed.imu.x != lab.robot.real.imu.x


def test_the_sealed_answer_holds_what_was_drawn(wild_folder: Path) -> None:
    drawn = reveal(wild_folder).answer["lab"]
    assert drawn["name"] == "wild"
    assert {"robot", "soil", "scatter", "logger", "radius", "rolls", "near_rest"} <= set(drawn)
    shown = command("reveal", wild_folder).out
    assert "Nothing is hidden" in shown
    assert "near_rest: holds_below" in shown
    assert "wheels.radius" not in shown  # as filed


def test_the_offset_of_the_clocks_is_told_as_the_stamps_show_it() -> None:
    """An IMU that is late itself adds to encoders that are early."""
    lab = labs()[3]
    _, answer = one("clock_offset", 3, lab="wild", sizes=(("clock_offset.offset", -0.03),))
    late = lab.logger.late + 0.5 / lab.robot.real.imu_grade.rate
    told = answer["effects"][0]["parameters"]["offset"]["value"]
    assert told == pytest.approx(-0.03 - late)
    assert late > 0.001


def test_a_mixture_holds_as_many_causes_as_asked_no_twins_and_a_contact_law() -> None:
    for causes in (2, 5):
        drawings = [chosen(Spec("mixture", seed, causes=causes, soil_law="random")) for seed in range(60)]
        assert all(len(set(names) - LAWS.keys()) == causes and set(names) & LAWS.keys() for names in drawings)
        assert not [pair for names in drawings for pair in TWINS if pair <= set(names)]
        foreign = sum(bool(set(names) & OUTSIDE.keys()) for names in drawings)
        assert 5 <= foreign <= 28  # a quarter of 60, three std about it
    assert chosen(Spec("none", 1, soil_law="bearing_limit")) == ("bearing_limit",)
    with pytest.raises(UsageError, match="unknown contact law 'rock'"):
        chosen(Spec("none", 1, soil_law="rock"))


def test_each_cause_of_a_mixture_reopens_a_tenth_of_the_gap_and_a_speed_is_withheld() -> None:
    _, answer = one("mixture", seed=3, causes=2)
    ids = {effect["id"] for effect in answer["effects"]}
    assert ids == answer["reopens"].keys() == answer["reopens_after_refit"].keys()
    assert min(answer["reopens"].values()) >= LEAST
    assert min(answer["reopens_after_refit"].values()) > 0
    withheld = answer["withheld"]
    assert abs(withheld["velocity"] - SHORT[0].velocity) >= 0.04
    true = {"t_s": np.array(withheld["t"]), "v_mps": np.array(withheld["v"])}
    true["current"] = np.array(withheld["current"])
    half = {key: 0.9 * value if key != "t_s" else value for key, value in true.items()}
    quarter = {key: 0.95 * value if key != "t_s" else value for key, value in true.items()}
    assert share_closed(withheld, half, true) == 1.0
    assert share_closed(withheld, half, quarter) == pytest.approx(0.5)
    paper = true | {"v_mps": 1.001 * true["v_mps"], "current": 1.05 * true["current"]}
    model = true | {"v_mps": 1.002 * true["v_mps"]}  # worse where there is hardly a gap
    assert share_closed(withheld, paper, model) == pytest.approx(
        1 - 0.002 / 0.05, abs=0.002
    )  # averaged over 0.3 s


def test_trials_do_not_tell_when_a_gust_blows_in_another_one_and_tell_all_else() -> None:
    """What is drawn anew in each trial is a phase, which averages out, or nothing can predict it."""
    for id_ in (*LIBRARY, *OUTSIDE):
        sizes = {size.name: size.low for size in influence(id_).declared}
        drawn = [influence(id_).of_trial(sizes, np.random.default_rng(seed)) for seed in (1, 2)]
        differ = {name.split("_")[0] for name in drawn[0] if drawn[0][name] != drawn[1][name]}
        assert bool(differ - {"phase", "cos", "sin"}) is not influence(id_).predictable, id_


def test_the_mean_of_opposite_phases_has_nothing_left_of_what_turns_with_the_wheels() -> None:
    sizes = {size.name: size.low for size in influence("encoder_eccentricity").declared}
    of_trial = influence("encoder_eccentricity").of_trial(sizes, np.random.default_rng(1))
    opposite = influence("encoder_eccentricity").opposite(of_trial)
    turning = [name for name in of_trial if name.startswith(("cos_", "sin_"))]
    assert len(turning) == 4
    assert all(of_trial[name] + opposite[name] == 0 != of_trial[name] for name in turning)
    waves = influence("washboard").opposite({"height": 1e-3, "wavelength": 0.3, "phase": 1.0})
    assert np.sin(waves["phase"]) == pytest.approx(-np.sin(1.0))
    setup, variant = Setup(load_robot(), load_soil(), exponential_k92(4.919)), SHORT[0]
    command, name = (
        trapezoid(variant.velocity, variant.acceleration, variant.distance),
        "encoder_eccentricity",
    )
    one_phase, other = (model_of((name,), setup, command, {name: x}) for x in (of_trial, opposite))
    without = model_of((), setup, command, {})
    v, mean, plain = (
        np.array(motion_of(x, variant)["v"]) for x in ([one_phase], [one_phase, other], [without])
    )
    assert np.abs(v - plain).max() > 4e-4
    assert np.abs(mean - plain).max() < 0.15 * np.abs(v - plain).max()
