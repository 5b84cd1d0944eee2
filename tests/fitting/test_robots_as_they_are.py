"""A towed load, wheels of several radii, motors of a side, from files and logs to k_92. All is virtual."""

import dataclasses
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granite_lab.chain import corrected, read, with_simulation_input
from granite_lab.errors import EstimateError, InputError
from granite_lab.fitting import fit_k92, with_drive_input
from granite_lab.fitting.tow import KEY, with_towed_load
from granite_lab.hidden.command import trapezoid
from granite_lab.inference.observation import observe
from granite_lab.logs import write_canonical
from granite_lab.logs.trial import Series, Trial
from granite_lab.model import Accuracy, Run, simulate
from granite_lab.model.command import alike, hauling
from granite_lab.model.virtual import virtual_trial
from granite_lab.options import Options
from granite_lab.parameters import (
    Course,
    Robot,
    Tow,
    is_driven,
    load_robot,
    load_soil,
    variant_of,
)
from tests.corpus.cli import lab
from tests.soak import sampled

ROBOT, SOIL, A_THETA = load_robot(), load_soil(), 4.5
FORCE, HEIGHT = 12.0, 0.1
FINE = Accuracy(1e-7, 1e-9, 0.0025)


@cache
def run(force: float = FORCE, height: float = HEIGHT) -> Run:
    variant = hauling(variant_of(0.5), ((0.0, force), (math.inf, force)), height)
    return simulate(variant, ROBOT, SOIL, a_theta=A_THETA, accuracy=FINE)


def level(signals: Run, name: str) -> float:
    t1, t2 = signals.steady
    return float(np.interp(np.linspace(t1, t2, 200), signals.t, signals[name]).mean())


def written(folder: Path, of: Run, robot: Robot = ROBOT, **extra: str) -> Path:
    """Write the log of a run, as if of the trapezoid of 0.5 m/s; `extra` into its head."""
    trial = virtual_trial(dataclasses.replace(of, robot=robot), 1, "towing")[0]
    info = dataclasses.replace(
        trial.info, v_desired=0.5, a_max=1.2, distance=2.5, extra={**trial.info.extra, **extra}
    )
    path = folder / "towing.csv"
    write_canonical(path, dataclasses.replace(trial, info=info, command=None))
    return path


def test_a_trapezoid_without_a_load_runs_as_the_course_that_it_is() -> None:
    plain = simulate(variant_of(0.5), ROBOT, SOIL, a_theta=A_THETA, accuracy=FINE)
    assert run(0.0, 0.0)["v_mps"] == pytest.approx(plain["v_mps"], abs=1e-6)
    assert run(0.0).slip_ratio == pytest.approx(plain.slip_ratio, abs=1e-6)


def test_the_ground_carries_the_load_and_the_pitch_its_moment() -> None:
    """Forces balance in steady motion: thrust of four wheels is the load; its moment shifts weight back.

    The wheels of the paper's model push at their centres, (22).
    """
    for height in (0.0, HEIGHT):
        loaded, empty = run(height=height), run(0.0)
        pulls = [2 * (level(r, "force_x_f_N") + level(r, "force_x_r_N")) for r in (loaded, empty)]
        assert pulls[0] - pulls[1] == pytest.approx(FORCE, abs=0.02)
        shift = [2 * level(r, "force_z_r_N") for r in (loaded, empty)]
        assert ROBOT.chassis is not None
        assert shift[0] - shift[1] == pytest.approx(FORCE * height / ROBOT.chassis.wheel_base, abs=0.05)
    assert run().slip_ratio > run(0.0).slip_ratio + 0.02


def test_a_load_is_slack_at_rest() -> None:
    still = run()["v_mps"][run().t < 0]
    assert np.abs(still).max() < 1e-6


def test_a_force_that_changes_acts_when_it_acts() -> None:
    tow = ((0.0, 0.0), (2.0, 0.0), (2.2, 12.0), (9.0, 12.0))
    course = hauling(variant_of(0.3), tow, 0.0)
    assert {2.0, 2.2} < {t for t, _ in course.path}
    loaded, plain = (
        simulate(c, ROBOT, SOIL, a_theta=A_THETA, accuracy=FINE) for c in (course, variant_of(0.3))
    )
    early, late = plain.t < 2.0, (plain.t > 2.6) & (plain.t < 6.0)
    assert loaded["v_mps"][early] == pytest.approx(plain["v_mps"][early], abs=1e-5)
    assert (loaded["v_mps"] - plain["v_mps"])[late].max() < -0.003


def test_the_paper_s_model_and_another_program_agree_on_a_towed_load() -> None:
    """The independent simulator with the same force at its drag: slip ratio and velocity."""
    from granite_lab.hidden.contact import Array, Contact
    from granite_lab.hidden.model import PITCH, Setup, Truth
    from granite_lab.hidden.parts import exponential_k92
    from tests.truth.simulator import integrate

    class Hauling(Truth):
        def push(self, t: float, y: Array, wheel: Contact) -> Array:
            push, force = super().push(t, y, wheel), FORCE * self.fade(y)
            push[0] -= force
            push[2] -= force * (HEIGHT - self.chassis.com_z) * np.cos(y[PITCH])
            return push

    truth = Hauling(Setup(ROBOT, SOIL, exponential_k92(A_THETA)), trapezoid(0.5, 1.2, 2.5))
    other = integrate(truth, np.asarray(np.arange(-0.2, truth.command.end, 0.0025)), rtol=1e-6, atol=1e-8)
    assert np.interp(other.t, run().t, run()["v_mps"]) == pytest.approx(other.v, abs=5e-4)


@pytest.mark.parametrize("source", sampled(["log", "robot", "list"]))
def test_k92_of_a_trial_that_tows_is_right_if_the_load_is_said(source: str, tmp_path: Path) -> None:
    extra = {"log": f"{FORCE:g}", "list": f"0:{FORCE:g}, 30:{FORCE:g}"}.get(source)
    path = written(tmp_path, run(height=0.0), **({KEY: extra} if extra else {}))
    trial, robot, motion = with_simulation_input(path, Options())
    if source == "robot":
        motion = with_towed_load(motion, trial, dataclasses.replace(robot, tow=Tow(force=FORCE)))
    assert "a towed load of 12 N is in the model" in motion.warnings[-1]
    assert isinstance(motion.variant, Course)
    fit = fit_k92(motion, trial, robot, SOIL, trajectory=source == "log")
    a, std = -math.log(fit.k92.value) / 0.5, fit.k92.std / fit.k92.value / 0.5
    assert abs(a - A_THETA) < 2 * std < 0.6
    if source == "log":
        off = -math.log(fit.k92_trajectory.value) / motion.variant.velocity - A_THETA
        assert abs(off) < 0.3
    bare = corrected(path, Options())[2]
    slip = fit_k92(bare, trial, robot, SOIL, trajectory=False).k92.value
    assert slip < 0.8 * fit.k92.value  # what a towed load does is taken for k_92 otherwise


def test_a_load_stays_where_wheels_drive(tmp_path: Path) -> None:
    path = written(tmp_path, run(height=0.0), **{KEY: "12"})
    trial, robot, motion = with_simulation_input(path, dataclasses.replace(Options(), drive="wheels"))
    assert is_driven(motion.variant)
    fit = fit_k92(motion, trial, robot, SOIL, trajectory=False)
    assert -math.log(fit.k92.value) / motion.variant.velocity == pytest.approx(A_THETA, abs=0.3)


@pytest.mark.parametrize("text", ["heavy", "-5", "2:1", "3:1, 2:4", "0:0, 5:-3"])
def test_a_force_that_is_none_is_refused(text: str, tmp_path: Path) -> None:
    trial, robot, motion = corrected(written(tmp_path, run(height=0.0)), Options())
    said = dataclasses.replace(trial.info, extra={**trial.info.extra, KEY: text})
    with pytest.raises(InputError, match=f"{KEY} = .* cannot be used"):
        with_towed_load(motion, dataclasses.replace(trial, info=said), robot)


def test_a_list_of_forces_needs_the_start_of_the_command(tmp_path: Path) -> None:
    trial, robot, motion = corrected(written(tmp_path, run(height=0.0)), Options())
    trial = dataclasses.replace(
        trial, info=dataclasses.replace(trial.info, extra={**trial.info.extra, KEY: "0:1, 9:1"})
    )
    lost = dataclasses.replace(motion, t_start=dataclasses.replace(motion.t_start, value=math.nan))
    with pytest.raises(EstimateError, match="the towing force has no time"):
        with_towed_load(lost, trial, robot)


@cache
def growing() -> Run:
    course = hauling(variant_of(0.3), ((0.0, 2.0), (3.0, 2.0), (3.3, 12.0), (9.0, 12.0)), 0.0)
    return simulate(course, ROBOT, SOIL, a_theta=A_THETA, accuracy=FINE)


def logged_force(folder: Path, unit: str, factor: float) -> tuple[Path, float]:
    """Write the log of a run whose load grows, with a load cell; return when its command begins, too."""
    course = growing().variant
    assert isinstance(course, Course)
    trial, truth = virtual_trial(growing(), 1, "growing")
    start = float(truth.attrs["t_start_s"])
    t = np.arange(0.1, start + course.distance / 0.3 + 2, 0.0125)
    force = np.interp(t - start, *np.array([p[:2] for p in course.tow]).T)
    force += 0.3 * np.random.default_rng(1).standard_normal(t.size)
    info = dataclasses.replace(trial.info, v_desired=0.3, a_max=1.2, distance=2.0)
    path = folder / "growing.csv"
    write_canonical(path, dataclasses.replace(trial, info=info, command=None, tow=Series(t, factor * force)))
    path.write_text(path.read_text("utf-8").replace("tow_N", f"tow_{unit}"), encoding="utf-8")
    return path, start


@pytest.mark.parametrize(("unit", "factor"), sampled([("kN", 1e-3), ("N", 1.0)]))
def test_a_logged_force_enters_as_it_was_measured(unit: str, factor: float, tmp_path: Path) -> None:
    path, start = logged_force(tmp_path, unit, factor)
    trial, robot, motion = with_simulation_input(path, Options())
    assert "N is in the model" in motion.warnings[-1]
    assert isinstance(motion.variant, Course)
    t = np.linspace(0.2, 6.0, 100)
    wanted = np.interp(t, (3.0, 3.3), (2.0, 12.0))
    pulled = motion.variant.pull_at(t + start - motion.t_start.value)
    level = np.abs(t - 3.15) > 0.25
    assert pulled[level] == pytest.approx(wanted[level], abs=0.4)
    assert pulled == pytest.approx(wanted, abs=1.5)  # the ramp, averaged over 0.05 s
    fit = fit_k92(motion, trial, robot, SOIL, trajectory=False)
    assert -math.log(fit.k92.value) / 0.3 == pytest.approx(A_THETA, abs=3 * fit.k92.std / fit.k92.value / 0.3)
    bare = corrected(path, Options())[2]
    assert fit_k92(bare, trial, robot, SOIL, trajectory=False).k92.value < 0.95 * fit.k92.value


def test_a_stated_force_counts_before_a_logged_one_and_a_logged_one_is_checked(tmp_path: Path) -> None:
    path, _ = logged_force(tmp_path, "kN", 1e-3)
    trial, robot, motion = corrected(path, Options())
    stated = dataclasses.replace(trial, info=dataclasses.replace(trial.info, extra={KEY: "7"}))
    assert "a towed load of 7 N" in with_towed_load(motion, stated, robot).warnings[-1]
    assert trial.tow is not None
    turned = dataclasses.replace(trial, tow=dataclasses.replace(trial.tow, value=-trial.tow.value))
    with pytest.raises(InputError, match="negative while the robot is driven"):
        with_towed_load(motion, turned, robot)
    late = dataclasses.replace(trial, tow=dataclasses.replace(trial.tow, t=trial.tow.t + 100))
    with pytest.raises(InputError, match="no samples while the robot is driven"):
        with_towed_load(motion, late, robot)


def test_trials_under_other_loads_are_no_repetitions() -> None:
    light, heavy = (hauling(variant_of(0.3), ((0.0, f), (math.inf, f)), 0.0) for f in (5.0, 12.0))
    assert not alike(light, heavy)
    assert alike(light, light)
    assert alike(hauling(variant_of(0.3), (), 0.0), variant_of(0.3))


def changed_robot(folder: Path, *lines: str, wheels: str = "") -> Path:
    """Write the paper's robot with more lines."""
    text = (Path(__file__).parents[2] / "granite_lab/catalogue/robots/granite.toml").read_text("utf-8")
    text = text.replace('title = "', "\n".join(lines) + '\ntitle = "', 1).replace(
        "lugs = 24", f"lugs = 24\n{wheels}"
    )
    path = folder / "own.toml"
    path.write_text(text, encoding="utf-8")
    return path


def uneven(trial: Trial, radii: tuple[float, ...]) -> Trial:
    """Return the log of a robot whose wheels roll as far, with other radii."""
    assert trial.wheels is not None
    by = ROBOT.wheels.radius / np.array(radii)
    return dataclasses.replace(trial, wheels=dataclasses.replace(trial.wheels, angle=trial.wheels.angle * by))


@pytest.mark.parametrize(
    "radii", sampled([(0.0965, 0.0965, 0.1, 0.1), (0.095, 0.098, 0.095, 0.098)]), ids=str
)
def test_wheels_of_several_radii_give_the_slip_of_wheels_that_are_alike(
    radii: tuple[float, ...], tmp_path: Path
) -> None:
    plain = virtual_trial(run(0.0), 1, "plain")[0]
    info = dataclasses.replace(plain.info, v_desired=0.5, a_max=1.2, distance=2.5)
    plain = dataclasses.replace(plain, info=info, command=None)
    slips = []
    robot = changed_robot(tmp_path, wheels=f"radii_m = {list(radii)}")
    for name, trial, said in (("a", plain, None), ("b", uneven(plain, radii), str(robot))):
        write_canonical(tmp_path / f"{name}.csv", trial)
        _, found, motion = with_simulation_input(
            tmp_path / f"{name}.csv", dataclasses.replace(Options(), robot=said)
        )
        slips.append(motion.slip_ratio)
    assert slips[0].value == pytest.approx(slips[1].value, abs=0.001)
    assert "for its wheels have several radii" in motion.warnings[-1]
    assert any("angles are those of wheels of 96.5 mm" in line for line in motion.warnings)
    trial = read(tmp_path / "b.csv", dataclasses.replace(Options(), robot=said))[0]
    fit = fit_k92(motion, trial, found, SOIL, trajectory=False)
    assert -math.log(fit.k92.value) / motion.variant.velocity == pytest.approx(A_THETA, abs=0.4)


def test_motors_of_a_side_show_the_torque_of_both_their_wheels(tmp_path: Path) -> None:
    """Power balances: a motor for each side draws what a motor for each of its wheels would, (24)."""
    path = written(tmp_path, run(0.0))
    trial = read(path, Options())[0]
    assert trial.currents is not None
    sides = trial.currents.current[:, :2] + trial.currents.current[:, 2:]
    logged = np.hstack([sides, np.full_like(sides, np.nan)])  # a column for each motor
    currents = dataclasses.replace(trial.currents, current=logged)
    write_canonical(path, dataclasses.replace(trial, currents=currents))
    robot = changed_robot(tmp_path, 'motors = "side"')
    trial, found, motion = with_simulation_input(path, dataclasses.replace(Options(), robot=str(robot)))
    assert "for a motor drives both wheels of a side" in motion.warnings[-1]
    assert any("compared with the sum of both torques" in line for line in motion.warnings)
    seen = observe(trial, found, motion.variant, motion.t_start.value)
    assert "current_side" in seen.streams
    assert not {"current_f", "current_r"} & seen.streams.keys()
    turned = simulate(motion.variant, found, SOIL, a_theta=A_THETA, accuracy=FINE)
    signals = np.zeros((8, turned.t.size))
    signals[5:7] = turned["current_f_A"], turned["current_r_A"]
    shown = seen.binned(turned.t, signals, 0.0)["current_side"]
    t1, t2 = motion.variant.stretch
    steady = (seen.t > t1) & (seen.t < t2)
    mean = float(np.nanmean(seen.values["current_side"][steady]))
    assert float(shown[steady].mean()) == pytest.approx(mean, rel=0.03)
    assert mean > 1.5 * 2  # the sum, no mean of both
    fit = fit_k92(motion, trial, found, SOIL, trajectory=False)
    assert -math.log(fit.k92.value) / motion.variant.velocity == pytest.approx(A_THETA, abs=0.4)
    with pytest.raises(InputError, match="no command can be simulated"):
        simulate(variant_of(0.5), found, SOIL)


@pytest.mark.parametrize(
    ("wheels", "said"),
    [
        ("count = 6", "count = 6: robots with four wheels can be analysed"),
        ("radii_m = [0.1, 0.1]", "radii_m has 2 numbers"),
        ("radii_m = [0.1, 0.1, 0.1, 3]", "radii_m = 3 is out of range"),
    ],
)
def test_other_wheels_are_refused_in_one_line(wheels: str, said: str, tmp_path: Path) -> None:
    done = lab("params", "--robot", changed_robot(tmp_path, wheels=wheels), cwd=tmp_path)
    assert done.code == 3
    assert said in done.error
    assert lab("params", "--robot", changed_robot(tmp_path, wheels="count = 4"), cwd=tmp_path).code == 0


def test_a_robot_whose_wheels_differ_much_has_no_simulation() -> None:
    wheels = dataclasses.replace(ROBOT.wheels, radii_m=(0.09, 0.09, 0.12, 0.12))
    with pytest.raises(InputError, match="the model holds for up to 10 %"):
        simulate(variant_of(0.5), dataclasses.replace(ROBOT, wheels=wheels), SOIL)


def test_the_command_line_simulates_a_robot_that_tows(tmp_path: Path) -> None:
    robot = changed_robot(tmp_path)
    robot.write_text(robot.read_text("utf-8") + "\n[tow]\nforce_N = 12\nheight_m = 0.1\n", encoding="utf-8")
    slips = []
    for words in (("--robot", robot), ("--robot", robot, "--set", "robot.tow.force_N=0"), ()):
        done = lab("simulate", "--variant", 0.5, *words, cwd=tmp_path)
        assert done.code == 0
        slips.append(float(done.out.split("λ_R")[1].split("%")[0].strip(" =:")))
    assert slips[0] > slips[1] + 2
    assert slips[1] == pytest.approx(slips[2], abs=0.02)


def test_driven_and_towed_leave_a_robot_without_a_load_alone(tmp_path: Path) -> None:
    trial, robot, motion = corrected(written(tmp_path, run(0.0)), Options())
    assert with_towed_load(with_drive_input(motion, robot, "auto", SOIL), trial, robot) is motion
