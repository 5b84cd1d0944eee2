"""Expected standard deviations, Bayes factors and conditions agree with theory, full fits and a robot."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from granite_lab.effects import library
from granite_lab.errors import InputError
from granite_lab.inference.conditions import PLAIN, STAGING, Conditions, StagedScenario, conditions_of
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.noise import FLOOR
from granite_lab.inference.normal import posterior
from granite_lab.inference.pool import ACCURACY, SAND, Setting, SimulationPool, Task
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Trial, TrialInfo
from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.model.instants import instants
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import GRAVITY, Variant, load_robot, load_soil
from granite_lab.planning.design import Design, Driven, NamedEffect, NamedNumber, Noise
from granite_lab.planning.plan import plan_next
from granite_lab.planning.stage import Stage, explanations, fitted, question, whitener_of
from tests.planning.test_plan_next import design_of, driven_of

ROBOT, SOIL = load_robot(), load_soil()
SLOW = Variant(velocity=0.3, acceleration=1.2, distance=0.9)
OTHER = Variant(velocity=0.4, acceleration=1.2, distance=1.2)
TURNED = Conditions(turned=True)
LEVEL = 0.05
WEAK = (("hum", (1e-3,)),)  # so weak that the gain of the sensor does not matter
MIDDLE, HALF = 1.75, 1.25  # of the time for which the sine lasts [s]


class Hum(Effect):
    """A current that nothing else resembles: a sine while the robot drives."""

    id = "hum"
    title = equation = source = signature = "test"
    frequency = 4.0
    parameters = (EffectParameter("size", "A", "amplitude", -1e3, 1e3, 0.0, -1e3, 1e3),)

    def shape(self, t: Any) -> Any:
        return ca.sin(2 * np.pi * self.frequency * t)

    def sensors(self, signals: dict[str, Any], p: ModelParameters, own: Symbols) -> dict[str, Any]:  # noqa: ARG002
        away = own.t - MIDDLE
        added = own.p["size"] * ca.if_else(ca.fabs(away) < HALF, self.shape(away), 0.0)
        return signals | {"cur_r_A": signals["cur_r_A"] + added}


class Swell(Hum):
    """A current so smooth that the discrepancy of the model can look like it."""

    id = "swell"

    def shape(self, t: Any) -> Any:
        return (1 + ca.cos(np.pi * t / HALF)) / 2


def driven_once(variant: Variant = SLOW, level: float = LEVEL, **told: Any) -> Driven:
    noise = (Noise(channel="current_r", rest=float(np.sqrt(level**2 - FLOOR["current_r"] ** 2))),)
    return Driven(**{"variant": variant, "noise": noise, **told})


@pytest.fixture
def stages() -> Iterator[Any]:
    with ExitStack() as stack:

        def stage(design: Design, *more: Variant, formula: float = 1e-9) -> Stage:
            variants = (*(d.variant for d in design.driven), *more)
            effects = library() | STAGING | {"hum": Hum(), "swell": Swell()}
            scenario = StagedScenario(
                ROBOT, SOIL, variants, effects, conditions=(Conditions(),) * len(variants)
            )
            found = Stage(
                design, stack.enter_context(SimulationPool(scenario)), [design.driven[0]] * len(more)
            )
            found.scales = replace(found.scales, formula=formula)
            return found

        yield stage


def std_of(information: np.ndarray) -> float:
    return float(np.sqrt(fitted(information, 0).covariance[-1, -1]))


@pytest.mark.parametrize("count", [1, 3])
def test_the_std_of_a_sine_in_white_noise_is_that_of_its_fisher_information(stages: Any, count: int) -> None:
    stage = stages(design_of(driven_once(count=count), share=0.0))
    bins = 2 * HALF / 0.02
    mean_over_bin = np.sinc(Hum.frequency * 0.02)
    expected = LEVEL / np.sqrt(count * bins / 2) / mean_over_bin
    now = stage.at_hand(WEAK)
    assert std_of(now) == pytest.approx(expected, rel=0.03)
    more = stage.further_trial(0, WEAK, ())
    assert std_of(now + more) / std_of(now) == pytest.approx(np.sqrt(count / (count + 1)), rel=1e-3)


def test_repetitions_share_the_discrepancy_of_the_model_and_another_command_does_not(stages: Any) -> None:
    stage = stages(design_of(driven_once(level=0.006, count=3), share=0.02), OTHER)
    model = (("swell", (1e-3,)),)
    now = stage.at_hand(model)
    again = stage.further_trial(0, model, ())
    other = stage.further_trial(1, model, ())
    assert std_of(now + again) / std_of(now) > 0.97
    assert std_of(now + other) / std_of(now) < 0.85


def test_no_number_of_trials_beats_the_error_of_an_effects_formula(stages: Any) -> None:
    many = design_of(driven_once(count=50), share=0.0)
    exact = std_of(stages(many).at_hand((("hum", (0.5,)),)))
    about = std_of(stages(many, formula=0.1).at_hand((("hum", (0.5,)),)))
    assert about > 2 * exact


TILT = (NamedNumber(name="tilt", value=1e-3),)
SLOPE = design_of(
    driven_of(SLOW, count=3), verdict="named", scales=TILT,
    named=(NamedEffect(id="ground_slope", values=(1.0,), twins=("imu_tilt",)),),
)  # fmt: skip


def test_a_run_in_the_other_direction_tells_a_slope_from_a_tilted_sensor() -> None:
    plan = plan_next(SLOPE, library(), room=0.9)
    ((pair, now),) = plan.now.items()
    assert pair == "imu_tilt from ground_slope"
    best = plan.proposals[0]
    assert best.worth
    assert best.trial.conditions == TURNED
    repeated = next(p for p in plan.proposals if p.trial.repeats)
    assert best.after[pair] - now > 3 * (repeated.after[pair] - now)
    assert plan.models[1][0] == ("imu_tilt", (pytest.approx(-1.0, abs=0.15),))


def test_the_expected_bayes_factor_is_what_a_full_fit_to_such_trials_loses() -> None:
    """Trials with a slope, there and back, are written without noise and fitted with a tilted sensor."""
    design = replace(SLOPE, driven=(driven_of(SLOW), driven_of(SLOW, conditions=TURNED)))
    scenario = StagedScenario(ROBOT, SOIL, (SLOW, SLOW), library() | STAGING, conditions=(PLAIN, TURNED))
    with SimulationPool(scenario) as pool:
        stage = Stage(design, pool)
        models = explanations(stage, question(design, library()))
        expected = fitted(stage.at_hand(models[1], models[:1]), 1).misfit / 2
        trials = []
        for k, _ in enumerate(design.driven):
            one = stage.problem(k)
            point = stage.point(one, models[0])
            response = pool.run([one.centre(point, 0)])[0]
            trial = one.trials[0]
            trial.measured = trial.predict(response, point.trials[0], point.sensors)
            trials.append(trial)
        problem = Problem(trials, pool)
        whiteners = [[whitener_of(n, t.observation, 0.3) for n in design.driven[0].noise] for t in trials]
        point = problem.with_effect(problem.neutral(), "imu_tilt", (0.0,))
        misfit = np.inf
        for _ in range(4):
            derivatives = differentiate(problem, point)
            runs = problem.respond([problem.task(point, i) for i in range(2)])
            problem.set_noise(whiteners, point, derivatives)
            normal = problem.normal(point, derivatives, problem.residuals(point, runs))
            std, mean = problem.prior(point, stage.scales)
            found = posterior(*normal.marginal(stage.scales), std**-2.0, mean - point.vector)
            point, misfit = problem.stepped(point, found.step), found.misfit
    assert expected > 3.0
    assert misfit / 2 == pytest.approx(expected, rel=0.1)


def steady(conditions: Conditions, setting: Setting = ()) -> np.ndarray:
    """What the sensors read at constant speed."""
    scenario = StagedScenario(ROBOT, SOIL, (SLOW,), library() | STAGING, conditions=(conditions,))
    response = scenario.respond(Task(0, (0.0,) * len(SAND), setting))
    return np.asarray(response[:, np.searchsorted(instants(SLOW, ACCURACY), 1.8)])


def test_a_raised_box_pulls_by_the_weight_times_the_sine_of_its_slope_and_a_payload_costs_current() -> None:
    assert steady(Conditions(payload=5.0))[5] > 1.05 * steady(PLAIN)[5]
    up, down = (steady(Conditions(slope=s)) for s in (3.0, -3.0))
    assert up[0] - down[0] == pytest.approx(2 * GRAVITY * np.sin(np.radians(3)), rel=0.02)
    assert up[5] > steady(PLAIN)[5] > down[5]


def test_a_slope_changes_its_sign_for_a_robot_that_is_turned_round_and_nothing_else_does() -> None:
    slope = (("ground_slope", (2.0,)),)
    assert steady(PLAIN, slope)[0] > 0.2 > -0.2 > steady(TURNED, slope)[0]
    assert np.allclose(steady(TURNED), steady(PLAIN))


def test_wheels_in_the_air_need_the_friction_of_their_drives_alone() -> None:
    spun = steady(Conditions(wheels_up=True), (("drivetrain_friction", (1.0, 0.0, 0.005)),))
    drive = ROBOT.drive
    torque = drive.torque_constant * drive.gear_ratio * drive.gear_efficiency
    assert spun[5] == pytest.approx(1.0 / torque, rel=0.02)
    assert spun[:3] == pytest.approx([0, GRAVITY, 0], abs=1e-6)


def test_a_rut_is_what_multi_pass_says_under_all_wheels() -> None:
    rut = (("multi_pass", (0.5, 0.5, 0.005, 1.0, 0.0, 0.06)),)
    again = steady(Conditions(same_rut=True), rut)
    assert again[5] < steady(PLAIN, rut)[5] < steady(PLAIN)[5]
    assert np.allclose(steady(Conditions(same_rut=True)), steady(PLAIN))


@pytest.mark.parametrize(
    "under", [PLAIN, TURNED, Conditions(payload=5.0, slope=-3.0), Conditions(same_rut=True)]
)
def test_a_log_says_under_which_conditions_it_was_driven(under: Conditions) -> None:
    said = dict(line.lstrip("# ").split(" = ") for line in under.lines)
    assert conditions_of(Trial("t", TrialInfo(extra=said))) == under


@pytest.mark.parametrize(("key", "text"), [("payload_kg", "heavy"), ("turned", "yes")])
def test_conditions_that_cannot_be_used_are_refused(key: str, text: str) -> None:
    with pytest.raises(InputError, match=f"{key} = {text} cannot be used"):
        conditions_of(Trial("t", TrialInfo(extra={key: text})))
