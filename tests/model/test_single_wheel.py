"""One wheel by the contact model: closed forms, another quadrature, the robot's own wheels, and limits."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from granite_lab.effects import get
from granite_lab.errors import EstimateError, InputError, UsageError
from granite_lab.model import Accuracy, simulate
from granite_lab.model.effect import Effect, activate
from granite_lab.model.single_wheel import Ratio, SingleWheel, WheelPoint, _functions, acts, rolling
from granite_lab.parameters import GRAVITY, Soil, Wheels, load_robot, load_soil, variant_of
from tests.corpus.cli import SAND as SAND_FILE
from tests.corpus.cli import succeeded
from tests.truth.simulator import forces

ROBOT, SAND = load_robot(), load_soil()
RIM = ROBOT.wheels
R, B = RIM.radius, RIM.width
SLICK = dataclasses.replace(SAND, exponent=1.0, cohesion=0.0, friction_angle=0.0)
RULE = 3e-4
"""Error of four places on each branch as a share of the load, as docs/model.md states it."""
K = SLICK.cohesive_modulus / B + SLICK.frictional_modulus


def at(sinkage: float, slip: float, k92: float, soil: Soil = SAND) -> WheelPoint:
    return SingleWheel(RIM, soil).at_sinkage(sinkage, rolling(slip, R), Ratio(k92))


@pytest.mark.parametrize("z", [0.003, 0.015, 0.04])
def test_without_shear_load_and_resistance_are_the_closed_forms(z: float) -> None:
    """k_92 = 0 and n = 1: W = b r² k (ϑ/2 - sin 2ϑ/4); R is Bekker's work of compaction, b k z²/2."""
    p, front = at(z, 0.3, 0.0, SLICK), math.acos(1 - z / R)
    assert p.load == pytest.approx(B * R**2 * K * (front / 2 - math.sin(2 * front) / 4), rel=RULE)
    assert p.drawbar_pull == pytest.approx(-B * K * z**2 / 2, rel=RULE)
    assert p.torque == pytest.approx(0, abs=1e-12)  # [N m], rounding
    assert (p.angle_front, p.angle_rear) == (pytest.approx(front), 0)
    assert at(z, 0.3, 1.0, SLICK).drawbar_pull == pytest.approx(0, abs=1e-9)  # a symmetric arc
    assert at(z, 0.3, 1.0).resistance == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("slip", [-0.9, -0.4, 0.0, 0.15, 0.5, 1.0])
@pytest.mark.parametrize(("z", "k92"), [(0.004, 0.9), (0.015, 0.33), (0.035, 0.0)])
def test_forces_are_those_of_an_adaptive_quadrature(z: float, k92: float, slip: float) -> None:
    p, motion = at(z, slip, k92), rolling(slip, R)
    load, resistance, thrust, moment = forces(RIM, SAND, v_o=motion.rate * R, v=motion.velocity, z=z, k92=k92)
    assert (p.load, p.drawbar_pull) == pytest.approx((load, thrust + resistance), abs=RULE * load)
    assert p.torque == pytest.approx(-moment, abs=RULE * load * R)


@pytest.mark.parametrize("slip", [-1.0, -0.3, 0.0, 0.4, 1.0])
def test_the_sinkage_bears_the_load(slip: float) -> None:
    p = SingleWheel(RIM, SAND).at_load(105.0, rolling(slip, R), Ratio(0.3))
    assert p.load == pytest.approx(105.0, abs=1e-8)
    again = at(p.sinkage, slip, 0.3)
    assert again.drawbar_pull == p.drawbar_pull
    assert p.drawbar_pull == pytest.approx(p.thrust + p.resistance, rel=1e-12)


def test_stresses_over_the_arc_integrate_to_the_forces() -> None:
    p = at(0.015, 0.25, 0.4)
    assert (p.angle[0], p.angle[-1]) == pytest.approx((-p.angle_rear, p.angle_front))
    sin, cos = np.sin(p.angle), np.cos(p.angle)
    load = B * R * np.trapezoid(p.normal_stress * cos + p.shear_stress * sin, p.angle)
    torque = B * R**2 * np.trapezoid(p.shear_stress, p.angle)
    assert (p.load, p.torque) == (pytest.approx(load, rel=2e-3), pytest.approx(torque, rel=2e-3))


@pytest.mark.parametrize("slip", [-0.8, -0.2, 0.0, 0.1, 0.3, 0.9])
@pytest.mark.parametrize("k92", [0.0, 0.3, 1.0])
def test_soil_gains_no_energy_from_nothing(slip: float, k92: float) -> None:
    """What the axle puts in beyond the pull is spent in the soil, and never negative."""
    motion, p = rolling(slip, R), at(0.015, slip, k92)
    assert p.torque * motion.rate - p.drawbar_pull * motion.velocity > 0


def test_the_wheels_of_a_driving_robot_are_such_wheels() -> None:
    run = simulate(variant_of(0.5), ROBOT, SAND, k92=0.2, accuracy=Accuracy(1e-8, 1e-10))
    k = int(np.searchsorted(run.t, run.steady[1]))
    for axle in "fr":
        slip, rate = run[f"slip_{axle}"][k], run[f"omega_{axle}_radps"][k]
        motion = rolling(slip, R, speed=rate * R)
        p = SingleWheel(RIM, SAND).at_sinkage(run[f"sinkage_{axle}_m"][k], motion, Ratio(0.2))
        assert p.load == pytest.approx(run[f"load_{axle}_N"][k], rel=1e-6)
        assert p.drawbar_pull == pytest.approx(run[f"force_x_{axle}_N"][k], rel=1e-6)
        assert p.torque == pytest.approx(-run[f"moment_{axle}_Nm"][k], rel=1e-6)


@pytest.mark.parametrize("slip", [-1.0, -0.5, 0.0, 0.3, 1.0])
def test_speeds_belong_to_the_slip(slip: float) -> None:
    motions = [rolling(slip, R, speed=0.3)]
    motions += [rolling(slip, R, velocity=0.2)] if slip < 1 else []
    for m in motions:
        rim = m.rate * R
        assert (rim - m.velocity) / max(rim, m.velocity) == pytest.approx(slip)
        assert m.speed == pytest.approx(max(rim, m.velocity))


def test_forces_do_not_depend_on_the_speed_above_the_floor_of_the_model() -> None:
    it = SingleWheel(RIM, SAND)
    slow, fast = (it.at_load(100.0, rolling(0.2, R, speed=v), Ratio(0.3)) for v in (0.02, 2.0))
    assert slow.drawbar_pull == pytest.approx(fast.drawbar_pull, rel=1e-9)
    assert not slow.rolling.fades
    assert rolling(0.2, R, speed=0.01).fades


def test_an_effect_acts_as_its_formula_says() -> None:
    """Bulldozing: Rankine's pressure on the face; slip sinkage: n = n0 + n1 (√(λ² + 1e-4) - 0.01)."""
    z, slip, fast = 0.015, 0.3, rolling(0.3, R, speed=1.0)
    plain = at(z, slip, 0.4)
    passive = math.tan(math.pi / 4 + math.radians(15)) ** 2
    pushed = B * (2 * SAND.cohesion * math.sqrt(passive) * z + 15_000 * passive * z**2 / 2)
    held = SingleWheel(RIM, SAND, [activate(get("bulldozing"), {"strength": 0.5})])
    p = held.at_sinkage(z, fast, Ratio(0.4))
    assert plain.drawbar_pull - p.drawbar_pull == pytest.approx(0.5 * pushed, rel=1e-3)
    assert p.torque == pytest.approx(plain.torque, rel=1e-12)

    softer = dataclasses.replace(SAND, exponent=1.1 + 0.5 * (math.hypot(slip, 0.01) - 0.01))
    grown = SingleWheel(RIM, SAND, [activate(get("slip_sinkage"), {"growth": 0.5})])
    p = grown.at_sinkage(z, rolling(slip, R), Ratio(0.4))
    assert p.load == pytest.approx(at(z, slip, 0.4, softer).load, rel=1e-12)


NO_WHEEL = {"to_frame", "system", "rates"}
"""Of an effect: no hook, one for the robot, and one for states that do nothing without another hook."""
HOOKS = {name for name, hook in vars(Effect).items() if callable(hook) and name[0] != "_"} - NO_WHEEL


@pytest.mark.parametrize("hook", sorted(HOOKS))
def test_an_effect_acts_on_a_wheel_whose_equations_ask_for_the_only_hook_that_it_has(hook: str) -> None:
    asked: list[str] = []

    def watched(_: Effect, quantity: Any, *given: Any) -> Any:
        asked.append(hook)
        return quantity

    effect = type("Watched", (Effect,), {"id": hook, "parameters": (), hook: watched})()
    _functions((effect,))
    assert acts(effect) is bool(asked)


def test_a_soft_tyre_stands_deeper_by_its_deflection() -> None:
    """The effect has a state, the load that deflects the tyre, which is solved for."""
    tyre = activate(get("radial_tyre_compliance"), {"compliance": 2e-5})
    p = SingleWheel(RIM, SAND, [tyre], ROBOT.chassis).at_load(100.0, rolling(0.2, R), Ratio(0.4))
    plain = SingleWheel(RIM, SAND).at_load(100.0, rolling(0.2, R), Ratio(0.4))
    assert plain.sinkage < p.sinkage < plain.sinkage + 100.0 * 2e-5
    assert p.load == pytest.approx(100.0, abs=1e-6)


def test_effects_of_sensors_and_body_are_left_out_and_a_missing_chassis_is_told() -> None:
    drag = activate(get("drive_reaction"), {"share": 1.0})
    assert SingleWheel(RIM, SAND, [drag]).effects == ()
    wound = SingleWheel(RIM, SAND, [activate(get("tyre_windup"), {"compliance": 1e-3})])
    with pytest.raises(InputError, match="with the effects tyre_windup"):
        wound.at_load(100.0, rolling(0.2, R), Ratio(0.4))


def test_what_cannot_be_is_refused() -> None:
    it = SingleWheel(Wheels(radius=0.05, width=0.02), SAND)
    with pytest.raises(EstimateError, match="sinks to its axle"):
        it.at_load(5000.0, rolling(0.2, 0.05), Ratio(0.3))
    with pytest.raises(UsageError, match="sinkage 60 mm"):
        it.at_sinkage(0.06, rolling(0.2, 0.05), Ratio(0.3))
    with pytest.raises(UsageError, match="does not fit"):
        rolling(1.0, 0.05, velocity=1.0)


def test_a_dollar_in_the_name_of_a_soil_begins_no_formula(tmp_path: Path) -> None:
    soil = SAND_FILE.replace('name = "dry_sand"', 'name = "$x_$"')
    (tmp_path / "soil.toml").write_text(soil, encoding="utf-8")
    assert soil != SAND_FILE
    for slip, name in (("0.2", "arc.svg"), ("0:0.4:0.2", "sweep.svg")):
        args = (
            "wheel",
            "--load",
            "60",
            "--slip",
            slip,
            "--k92",
            "0.3",
            "--soil",
            "soil.toml",
            "--plot",
            name,
        )
        succeeded(*args, cwd=tmp_path)
        assert (tmp_path / name).stat().st_size > 1000


@pytest.mark.parametrize(("apart", "most"), [(0.01, 0.3), (0.02, 0.8), (0.05, 4.5)])
def test_the_mean_of_left_and_right_stands_for_both_within_what_the_limits_say(
    apart: float, most: float
) -> None:
    """Where a body goes straight, its wheels at (1 ± apart) of their mean: how far that moves a_θ [%]."""
    assert ROBOT.chassis is not None
    load, wheel = ROBOT.chassis.total_mass * GRAVITY / 4, SingleWheel(ROBOT.wheels, SAND)

    def pull(slip: float, k92: float) -> float:
        return float(wheel.at_load(load, rolling(slip, ROBOT.wheels.radius), Ratio(k92)).drawbar_pull)

    for v in (0.2, 0.5):
        k92 = math.exp(-4.9 * v)

        def both(slip: float, k92: float = k92) -> float:
            return pull(1 - (1 - slip) / (1 - apart), k92) + pull(1 - (1 - slip) / (1 + apart), k92)

        seen = brentq(both, 0.005, 0.5)
        by_mean = brentq(lambda k, slip=seen: pull(slip, k), 1e-3, 1.0)
        assert 0 < 100 * (-math.log(by_mean) / (4.9 * v) - 1) < most
