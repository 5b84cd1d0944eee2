"""From logs of another program to a finding, whatever is wrong with the logs or goes wrong on the way."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granite_lab import study_folder
from granite_lab.api.model import simulate as by_command
from granite_lab.discovery import discover as module
from granite_lab.discovery.discover import SimulationOptions, discover
from granite_lab.discovery.finding import Finding
from granite_lab.effects import get, library
from granite_lab.effects.model_file import load_model
from granite_lab.errors import EstimateError
from granite_lab.estimation import correct
from granite_lab.inference.constants import TOLERANCE
from granite_lab.inference.pool import SAND, SIGNALS, Scenario, Task
from granite_lab.logs import read_trial
from granite_lab.logs.trial import Trial
from granite_lab.model import simulate
from granite_lab.model.command import duration
from granite_lab.model.effect import Effect
from granite_lab.model.simulator import integrate
from granite_lab.model.symbols import model_parameters
from granite_lab.options import Options
from granite_lab.parameters import Robot, load_robot, load_soil, variant_of
from tests.soak import SOAK, sampled, whole
from tests.truth import faults

OUTSIDE = Path(__file__).parent.parent / "data" / "outside"
FEW = {id_: get(id_) for id_ in ("drive_reaction", "tyre_windup")}
ALONE = {"drive_reaction": FEW["drive_reaction"]}
"""Where it is not asked which effect is named but what else can go wrong."""

PAIR = ("0.5_1", "0.5_2")
"""Two trials of one speed, which take the least time."""

FOUR = ("0.2_1", *PAIR, "0.7_1")
"""The fewest trials whose finding is not provisional: three speeds, one of them repeated."""


log, corrected = cache(read_trial), cache(correct)
"""A log, and what estimation makes of it, each once."""


def logs(name: str, trials: Sequence[str] = ()) -> list[Trial]:
    paths = sorted((OUTSIDE / name).glob("trial_*.csv"))
    return [log(p) for p in paths if not trials or p.stem.removeprefix("trial_") in trials]


def found(trials: Sequence[Trial], effects: dict[str, Effect], robot: Robot | None = None) -> Finding:
    robot = robot or load_robot()
    rows = [corrected(trial, robot) for trial in trials]
    return discover([r[0] for r in rows], [r[1] for r in rows], load_robot(), load_soil(), effects)


def effects_of(finding: Finding) -> list[str]:
    return [e.id for e in finding.effects]


@pytest.fixture(scope="module")
def good() -> Finding:
    return found(logs("o03", PAIR), FEW)


def candidates() -> dict[str, Effect]:
    """A twentieth of the library with the few; all of it in `make soak` and in `make outside`."""
    return dict(sampled(library().items(), 20)) | FEW


@whole
@pytest.mark.slow
def test_nothing_is_missing_from_the_trials_of_another_program() -> None:
    finding = found(logs("o01"), candidates())
    assert finding.verdict == "none"
    assert finding.sentence.startswith("The model explains")
    assert finding.effects == ()
    assert finding.gap.held_out[0] == pytest.approx(1.0, abs=0.03)
    assert finding.discrepancy < TOLERANCE
    assert finding.provisional == ()
    assert finding.failures == ()
    assert 0.0 < finding.latency.value < 0.008  # as the program's own answer says


@pytest.mark.slow
def test_what_another_program_added_is_named_among_other_effects_and_closes_the_gap() -> None:
    finding = found(logs("o03", () if SOAK else FOUR), candidates())
    assert finding.verdict == "named"
    (effect,) = finding.effects
    assert (effect.id, effect.twins) == ("drive_reaction", ())
    assert effect.closes.value > 0.8
    assert finding.remainder < 0.2
    assert finding.gap.held_out[0] > 1.3
    assert finding.gap.held_out[1] == pytest.approx(1.0, abs=0.05)
    (share,) = effect.parameters
    assert abs(share.estimate.value - 0.8) < 3 * share.estimate.std
    assert finding.sentence.startswith("Missing from the model: drive_reaction. On trials that were left out")
    assert finding.where
    assert len(finding.trials_left_out) == (6 if SOAK else len(FOUR))
    assert len(finding.speeds_left_out) == 3
    assert all(row.after < row.before for row in (*finding.trials_left_out, *finding.speeds_left_out))
    assert not finding.virtual


def test_two_trials_of_one_speed_are_provisional_and_no_speed_is_left_out(good: Finding) -> None:
    assert good.sentence.startswith("Provisional (1 of at least 3 speeds")
    assert len(good.trials_left_out) == 2
    assert good.speeds_left_out == ()
    assert effects_of(good) == ["drive_reaction"]
    assert good.dropped == ()


def test_trials_without_repetition_do_not_take_what_is_missing_for_noise() -> None:
    finding = found(logs("o03", ("0.5_1", "0.7_1")), FEW)
    assert finding.sentence.startswith("Provisional (no command was repeated")
    assert effects_of(finding) == ["drive_reaction"]
    assert finding.effects[0].parameters[0].estimate.value == pytest.approx(0.8, abs=0.05)


def test_logs_that_end_soon_after_the_stop_are_analysed() -> None:
    def cut(trial: Trial) -> Trial:
        _, motion = corrected(trial, load_robot())
        return faults.cut(trial, stop=motion.t_start.value + duration(motion.variant) + 0.4)

    finding = found([cut(t) for t in logs("o03", PAIR)], ALONE)
    assert effects_of(finding) == ["drive_reaction"]
    assert finding.failures == ()
    for row in finding.residuals:
        driven = np.isin(row.phase, ("accelerate", "steady", "brake"))
        assert np.isfinite(row.measured[driven]).all()
        assert np.isnan(row.measured[-20:]).all()
    assert np.isfinite(finding.gap.train).all()
    assert len(finding.trials_left_out) == 2


def turned_imu(trial: Trial) -> Trial:
    return faults.turned(trial, faults.SIDEWAYS)


def late_stamps(trial: Trial) -> Trial:
    return faults.late(trial, 0.03)


def blocked(trial: Trial) -> Trial:
    """The encoders stop in the middle of the run."""
    angle = trial.wheels.angle.copy()
    middle = angle.shape[0] // 2
    angle[middle:] = angle[middle]
    return replace(trial, wheels=replace(trial.wheels, angle=angle))


def mislabelled(trial: Trial) -> Trial:
    """The log says that it is one of 0.5 m/s."""
    info = read_trial(OUTSIDE / "o03" / "trial_0.5_1.csv").info
    told = replace(trial.info, v_desired=info.v_desired, a_max=info.a_max, distance=info.distance)
    return replace(trial, info=told)


@pytest.mark.parametrize("spoil", sampled([blocked, mislabelled]))
def test_a_trial_that_nothing_fits_is_left_out_and_said(
    spoil: Callable[[Trial], Trial], good: Finding
) -> None:
    trials = [spoil(t) if t.name == "trial_0.7_1" else t for t in logs("o03", (*PAIR, "0.7_1"))]
    finding = found(trials, ALONE)
    ((name, reason),) = finding.dropped
    assert name == "trial_0.7_1"
    assert "times those of the others" in reason
    assert {r.trial for r in finding.residuals} == {"trial_0.5_1", "trial_0.5_2"}
    assert effects_of(finding) == ["drive_reaction"]
    (alone,), (first,) = finding.effects[0].parameters, good.effects[0].parameters
    assert abs(alone.estimate.value - first.estimate.value) < 0.2 * first.estimate.std


def test_a_trial_alone_is_provisional_and_a_defect_after_the_search_does_not_lose_the_finding(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("of our own")

    monkeypatch.setattr(module, "detectable", broken)
    finding = found(logs("o03", PAIR[:1]), ALONE)
    assert effects_of(finding) == ["drive_reaction"]
    (line,) = finding.failures
    assert "ZeroDivisionError: of our own" in line
    assert "\n" not in line
    assert "Traceback" in finding.tracebacks[0]
    assert finding.detectable == ()
    assert finding.confusion is None
    assert finding.sentence.startswith("Provisional (no command was repeated")
    assert "trials that were left out" not in finding.sentence
    assert finding.trials_left_out == ()
    assert finding.speeds_left_out == ()
    assert np.isnan(finding.gap.held_out).all()


def test_a_robot_that_cannot_be_simulated_is_refused() -> None:
    trials = [corrected(t, load_robot()) for t in logs("o03", ("0.5_1",))]
    with pytest.raises(EstimateError, match="cannot be simulated"):
        discover(
            [t for t, _ in trials], [m for _, m in trials], load_robot(), load_soil(), FEW,
            simulating=SimulationOptions(respond=lambda _, tasks: [None] * len(tasks)),
        )  # fmt: skip


@pytest.mark.parametrize(("spoil", "within"), sampled([(turned_imu, 0.1), (late_stamps, 0.5)]))
def test_sensors_that_estimation_puts_right_do_not_change_the_finding(
    spoil: Callable[[Trial], Trial],
    within: float,
    good: Finding,
) -> None:
    """Late stamps move the estimate of the start, and so the bins: other noise is in each of them."""
    robot = load_robot()
    if spoil is turned_imu:
        robot = replace(robot, imu=replace(robot.imu, forward="find"))
    finding = found([spoil(t) for t in logs("o03", PAIR)], ALONE, robot)
    assert finding.verdict == good.verdict
    assert effects_of(finding) == effects_of(good) == ["drive_reaction"]
    (first,), (second,) = good.effects[0].parameters, finding.effects[0].parameters
    assert abs(second.estimate.value - first.estimate.value) < within * first.estimate.std
    assert second.estimate.std == pytest.approx(first.estimate.std, rel=0.1)
    late = 0.03 if spoil is late_stamps else 0.0
    moved = good.latency.value - finding.latency.value
    assert abs(moved - late) < 3 * good.latency.std + 0.1e-3


def test_a_latency_that_no_logger_has_is_named() -> None:
    clock = ALONE | {"clock_offset": get("clock_offset")}
    plain, late = (
        found([spoil(t) for t in logs("o01", PAIR)], clock) for spoil in (lambda t: t, late_stamps)
    )
    assert (plain.verdict, effects_of(plain)) == ("none", [])
    assert (late.verdict, effects_of(late)) == ("named", ["clock_offset"])
    (offset,) = late.effects[0].parameters
    std = float(np.hypot(offset.estimate.std, plain.latency.std))
    assert abs(offset.estimate.value + plain.latency.value - 0.03) < 3 * std


def test_the_saved_model_simulates_what_the_fit_predicts(good: Finding, tmp_path: Path) -> None:
    """Sand, a_θ and all terms come back from the file, so that responses and `simulate` are the same."""
    trials = [corrected(trial, load_robot())[0] for trial in logs("o03", PAIR)]
    path = study_folder.save_model_of(good, Options(), trials, tmp_path)
    model, command = load_model(path), variant_of(0.5)
    assert good.active
    assert all(abs(good.sand[name].value) > 0 for name in ("a_theta", "shear_modulus"))
    scenario = Scenario(good.robot, good.soil, (command,), library())
    sand = tuple(good.sand[name].value for name in SAND)
    fitted = scenario.respond(Task(0, sand, tuple((a.id, a.values) for a in good.active)))
    assert fitted is not None
    p = model_parameters(load_robot(model.robot), model.ground, command, a_theta=model.a_theta or 0.0)
    signals = integrate(p, model.effects, scenario.accuracy, SIGNALS)
    for row, name in zip(fitted, SIGNALS, strict=True):
        assert signals[name] == pytest.approx(row, abs=1e-6 * float(np.abs(row).max()))
    run = by_command(0.5, model=path)
    assert run.soil.friction_angle == pytest.approx(good.fitted_sand["friction_angle"].value, rel=1e-12)
    straight = simulate(command, good.robot, run.soil, a_theta=model.a_theta, effects=good.active)
    assert run["v_mps"] == pytest.approx(straight["v_mps"], abs=1e-6)
