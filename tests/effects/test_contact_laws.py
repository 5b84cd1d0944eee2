"""Contact laws other than the paper's: the stresses their papers give, integrated by another quadrature."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from granite_lab.effects import get
from granite_lab.effects.contact_angle_lag import FASTEST
from granite_lab.inference.constants import BIN
from granite_lab.model import Accuracy, simulate
from granite_lab.model.command import V_FLOOR
from granite_lab.model.dictionary import dictionary
from granite_lab.model.effect import Symbols, activate
from granite_lab.model.single_wheel import Ratio, SingleWheel, rolling
from granite_lab.model.symbols import model_parameters
from granite_lab.parameters import variant_of
from tests.effects.runs import ROBOT, SOIL, run

RIM = ROBOT.wheels
R, B = RIM.radius, RIM.width


def wong_reece(z: float, slip: float, k92: float, c1: float, c2: float) -> tuple[float, float, float]:
    """Return load [N], drawbar pull [N] and torque [N m] by Wong and Reece's stresses, (6), (10)-(15)."""
    θ1 = math.acos(1 - z / R)
    θ2, θm = -k92 * θ1, (c1 + c2 * slip) * θ1
    k = SOIL.cohesive_modulus / B + SOIL.frictional_modulus

    def σ(θ: float) -> float:
        front = θ if θ >= θm else θ1 - (θ - θ2) / (θm - θ2) * (θ1 - θm)
        return float(k * (R * (math.cos(front) - math.cos(θ1))) ** SOIL.exponent)

    def τ(θ: float) -> float:
        j = R * (θ1 - θ - (1 - slip) * (math.sin(θ1) - math.sin(θ)))
        strength = min(
            SOIL.tyre_friction * σ(θ), SOIL.cohesion + math.tan(math.radians(SOIL.friction_angle)) * σ(θ)
        )
        return float(strength * (1 - math.exp(-j / SOIL.shear_modulus)))

    def over(f: Callable[[float], float]) -> float:
        return B * R * sum(float(quad(f, a, b, epsabs=1e-9)[0]) for a, b in ((θ2, θm), (θm, θ1)))

    load = over(lambda θ: σ(θ) * math.cos(θ) + τ(θ) * math.sin(θ))
    pull = over(lambda θ: τ(θ) * math.cos(θ) - σ(θ) * math.sin(θ))
    return load, pull, R * over(τ)


@pytest.mark.parametrize(("z", "slip", "k92"), [(0.008, 0.1, 0.9), (0.015, 0.2, 0.4), (0.03, 0.5, 0.1)])
def test_stress_ahead_is_the_law_of_wong_and_reece(z: float, slip: float, k92: float) -> None:
    law = activate(get("stress_ahead"), {"share": 1.0, "c1": 0.18, "c2": 0.32})
    p = SingleWheel(RIM, SOIL, [law]).at_sinkage(z, rolling(slip, R), Ratio(k92))
    load, pull, torque = wong_reece(z, slip, k92, 0.18, 0.32)
    # four places on each side of ϑm
    assert p.load == pytest.approx(load, rel=2e-4)
    assert p.drawbar_pull == pytest.approx(pull, abs=2e-4 * load)
    assert p.torque == pytest.approx(torque, abs=2e-4 * load * R)


def test_stress_ahead_leaves_a_wheel_that_does_not_move_forward_alone() -> None:
    wheels = [SingleWheel(RIM, SOIL, on) for on in ([activate(get("stress_ahead"), {"share": 1.0})], [])]
    spinning = rolling(1.0, R)
    one, other = (w.at_sinkage(0.015, spinning, Ratio(0.4)) for w in wheels)
    assert one.load == pytest.approx(other.load, rel=1e-12)
    assert one.drawbar_pull == pytest.approx(other.drawbar_pull, rel=1e-12)


@pytest.mark.parametrize("j", [1e-4, 0.01, 0.05, 1.0])
def test_shear_falls_from_its_peak_to_the_residual_share(j: float) -> None:
    effect, model = get("shear_softening"), model_parameters(ROBOT, SOIL, variant_of(0.5), a_theta=4.919)
    own = Symbols({"loss": 0.4, "peak": 0.02}, {}, 0.0, model)
    share = float(effect.shear(1.0, j, own))
    assert 0.6 - 1e-12 <= share <= 1
    assert share == pytest.approx(1.0, abs=1e-4) or j > 1e-3
    assert share == pytest.approx(0.6, abs=1e-3) or j < 0.05
    assert np.all(np.diff([float(effect.shear(1.0, x, own)) for x in np.linspace(0, 0.2, 50)]) <= 0)


@pytest.mark.parametrize(("z", "slip", "root"), [(0.008, 0.1, 0.2), (0.015, 0.2, 0.6), (0.03, 0.5, 1.0)])
def test_exit_by_sinkage_is_the_wheel_whose_rear_angle_is_that_of_the_risen_sand(
    z: float, slip: float, root: float
) -> None:
    law = activate(get("exit_by_sinkage"), {"share": 1.0, "onset": 0.005})
    risen = SingleWheel(RIM, SOIL, [law]).at_sinkage(z, rolling(slip, R), Ratio(root))
    ratio = math.acos(1 - root**2 * z / R) / math.acos(1 - z / R)
    paper = SingleWheel(RIM, SOIL).at_sinkage(z, rolling(slip, R), Ratio(ratio))
    for name in ("load", "drawbar_pull", "torque"):
        assert getattr(risen, name) == pytest.approx(getattr(paper, name), rel=1e-6)


@pytest.mark.parametrize("v", [0.2, 0.7])
def test_exit_by_sinkage_does_not_go_by_the_velocity(v: float) -> None:
    law = activate(get("exit_by_sinkage"), {"share": 1.0, "onset": 0.005})
    own = SingleWheel(RIM, SOIL, [law]).at_sinkage(0.015, rolling(0.2, R, speed=v), Ratio(a_theta=4.919))
    paper = SingleWheel(RIM, SOIL).at_sinkage(0.015, rolling(0.2, R, speed=0.4), Ratio(a_theta=4.919))
    assert own.angle_rear == pytest.approx(paper.angle_rear, rel=0.02)  # √κ is k_92 for small angles


def test_exit_by_sinkage_leaves_equal_angles_to_a_wheel_that_does_not_move_forward() -> None:
    law = activate(get("exit_by_sinkage"), {"share": 1.0})
    at_rest = SingleWheel(RIM, SOIL, [law]).at_sinkage(0.015, rolling(1.0, R), Ratio(0.4))
    assert at_rest.angle_rear == pytest.approx(at_rest.angle_front, rel=1e-12)


@pytest.mark.parametrize("turned", [0.0, 0.05])
def test_lugs_that_shear_more_or_less_sand_scale_the_shear_stress_of_the_whole_arc(turned: float) -> None:
    ripple = activate(get("tread_ripple"), {"cos_front_strength": 0.2, "sin_front_strength": 0.1})
    factor = 1 + 0.2 * math.cos(RIM.lugs * turned) + 0.1 * math.sin(RIM.lugs * turned)
    plain, p = (
        SingleWheel(RIM, SOIL, on).at_sinkage(0.015, rolling(0.2, R, angle=turned), Ratio(0.4))
        for on in ([], [ripple])
    )
    assert p.torque == pytest.approx(factor * plain.torque, rel=1e-9)
    assert p.thrust == pytest.approx(factor * plain.thrust, rel=1e-9)
    assert p.resistance == pytest.approx(plain.resistance, rel=1e-9)


def test_sinkage_follows_the_slip_of_the_last_way() -> None:
    """The growth of sinkage with 10 cm of memory is that without, averaged over the way of the tread."""
    plain = run()
    quick, late = (run("slip_sinkage", growth=0.4, length=length) for length in (0.002, 0.1))
    way = np.abs(quick["omega_f_radps"]) * R
    grown = quick["sinkage_f_m"] - np.interp(quick.t, plain.t, plain["sinkage_f_m"])
    mean = solve_ivp(
        lambda t, s: (np.interp(t, quick.t, grown) - s) * np.interp(t, quick.t, way) / 0.1,
        (quick.t[0], quick.t[-1]), [0.0], t_eval=quick.t, max_step=0.01,
    ).y[0]  # fmt: skip
    found = np.interp(quick.t, late.t, late["sinkage_f_m"] - np.interp(late.t, plain.t, plain["sinkage_f_m"]))
    ramp = (quick.t > 0.1) & (quick.t < 1.0)
    assert np.max(np.abs(grown - mean)[ramp]) > 5e-4
    assert np.max(np.abs(found - mean)[ramp]) < 0.2 * np.max(np.abs(grown - mean)[ramp])


def test_the_soil_ahead_of_a_wheel_piles_up_over_a_length() -> None:
    """The force that is missing over the first way is strength F_b exp(-x / length)."""
    piled, ready = (run("bulldozing", strength=0.5, length=length) for length in (0.1, 0.002))
    for r in (piled, ready):
        z, x = r["sinkage_f_m"], r["x_m"]
        passive = math.tan(math.radians(45 + SOIL.friction_angle / 2)) ** 2
        pushed = B * (2 * SOIL.cohesion * math.sqrt(passive) * z + 15_000 * passive * z**2 / 2)
        length = 0.1 if r is piled else 0.002
        extra = r["force_x_f_N"] - r["thrust_f_N"] - r["resistance_f_N"]
        moving = (r["v_mps"] > 0.05) & (x > 0.01)
        expected = -0.5 * pushed * (1 - np.exp(-x / length))
        assert np.allclose(extra[moving], expected[moving], atol=0.03 * np.max(pushed))


@pytest.mark.parametrize("id_", ["slip_sinkage", "contact_angle_actual_speed"])
def test_the_formula_of_the_literature_without_memory_is_in_reach(id_: str) -> None:
    """At the shortest length a mean follows within a bin of the sensors, even at rest."""
    shortest = next(p for p in get(id_).parameters if p.name == "length").low
    assert shortest / V_FLOOR <= BIN / 2


def test_the_wedge_of_the_literature_is_there_from_the_start() -> None:
    shortest = next(p for p in get("bulldozing").parameters if p.name == "length").low
    r = run("bulldozing", strength=0.5, length=shortest)
    passive = math.tan(math.radians(45 + SOIL.friction_angle / 2)) ** 2
    z = r["sinkage_f_m"]
    pushed = 0.5 * B * (2 * SOIL.cohesion * math.sqrt(passive) * z + 15_000 * passive * z**2 / 2)
    extra = r["force_x_f_N"] - r["thrust_f_N"] - r["resistance_f_N"]
    moving = (r["v_mps"] > 4 * V_FLOOR) & (r["x_m"] < 0.01)
    assert moving.any()
    assert np.allclose(extra[moving], -pushed[moving], rtol=0.02)


def test_a_lag_of_the_contact_angles_also_delays_an_exit_angle_by_sinkage() -> None:
    """The ratio of the angles of a run, by the exit law and a first-order lag that another solver integrates;
    the order in which the effects are listed does not matter."""
    lag, onset = 0.3, 0.05
    exit_angle = activate(get("exit_by_sinkage"), {"share": 1.0, "onset": onset})
    late = activate(get("contact_angle_lag"), {"time": lag, "exponent": 0.0})
    fine = Accuracy(1e-7, 1e-9, 0.005)
    r, other = (
        simulate(variant_of(0.5), ROBOT, SOIL, effects=effects, accuracy=fine)
        for effects in ((late, exit_angle), (exit_angle, late))
    )
    for name in ("v_mps", "angle_rear_f_rad"):
        np.testing.assert_array_equal(r[name], other[name])
    front, recovery = r["angle_front_f_rad"], math.exp(-4.919 * 0.4) ** 2
    κ = recovery + (1 - recovery) * np.exp(-np.hypot(r["v_mps"], 1e-3) / onset)
    target = 2 * np.arcsin(np.sqrt(κ) * np.sin(front / 2)) / front
    moving = (r.t > 0.2) & (r.t < r.steady[1])  # earlier the body's velocity is not that of the wheels
    t, target, ratio = r.t[moving], target[moving], (r["angle_rear_f_rad"] / front)[moving]
    begin = ((lag + FASTEST) * ratio[0] - FASTEST * target[0]) / lag
    follows = solve_ivp(
        lambda now, x: (np.interp(now, t, target) - x) / (lag + FASTEST), (t[0], t[-1]), [begin],
        t_eval=t, rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    lagged = (target * FASTEST + follows.y[0] * lag) / (lag + FASTEST)
    assert np.abs(target - lagged).max() > 0.1  # the lag shows
    np.testing.assert_allclose(
        ratio, lagged, rtol=1e-3
    )  # wheels and body differ in velocity by the pitch rate


def test_a_lag_follows_a_term_of_the_dictionary_that_corrects_the_angles() -> None:
    """At constant speed the ratio is (5) times the correction, wherever the term is listed."""
    late = activate(get("contact_angle_lag"), {"time": 0.3, "exponent": 0.0})
    term = activate(dictionary()["term_ratio"], {"a": 0.5})
    r, other = (
        simulate(variant_of(0.5), ROBOT, SOIL, effects=effects) for effects in ((late, term), (term, late))
    )
    np.testing.assert_array_equal(r["angle_rear_f_rad"], other["angle_rear_f_rad"])
    alone = simulate(variant_of(0.5), ROBOT, SOIL, effects=(term,))
    steady = (r.t > r.steady[0] + 1.0) & (r.t < r.steady[1])
    for name in "fr":
        ratio, wanted = (x[f"angle_rear_{name}_rad"] / x[f"angle_front_{name}_rad"] for x in (r, alone))
        np.testing.assert_allclose(ratio[steady], wanted[steady], rtol=1e-3)
