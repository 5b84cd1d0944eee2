"""Anywhere in the allowed parameters a run is finite and loses no energy, or is refused with a reason."""

import dataclasses

import numpy as np
import pytest

from granite_lab.errors import EstimateError
from granite_lab.model import Accuracy, Run, simulate
from granite_lab.model.limits import MAX_SAMPLES
from granite_lab.model.simulator import rest_state
from granite_lab.model.symbols import model_parameters
from granite_lab.parameters import GRAVITY, Variant, load_variants, variant_of
from tests.model.box import ROBOT, SOIL, Draw, altered, draw, energies, grown, near, scaled, times
from tests.soak import SOAK

DRAWS = 2400 if SOAK else 64
BATCH = 16
REASONS = (
    "the robot sinks to its axles on this soil",
    "the ground pushes the robot backwards",
    "the ground would drive the robot",
    "the simulation does not converge: ",
    "the wheels do not turn in the steady part",
    "the desired velocity is never steady",
)
USUAL, FINE = Accuracy(), Accuracy(1e-6, 1e-8, 0.0005)


def run_of(d: Draw, accuracy: Accuracy = USUAL) -> Run | str:
    """Simulate a draw; return the run, or the reason why not."""
    try:
        return simulate(
            d.variant, d.robot, d.soil, k92=d.k92, a_theta=d.a_theta, effects=d.effects, accuracy=accuracy
        )
    except EstimateError as error:
        return error.message if error.hint else f"no hint: {error.message}"


@pytest.mark.parametrize("batch", range(DRAWS // BATCH))
def test_a_random_robot_gives_a_consistent_run_or_a_reason(batch: int) -> None:
    """Work of the motors = energy gained + lost in gears + taken by the ground, which gives none back."""
    went = 0
    for number in range(batch * BATCH, (batch + 1) * BATCH):
        d = draw(5, number)
        run = run_of(d)
        if isinstance(run, str):
            assert run.startswith(REASONS), run
            continue
        went += 1
        for name, signal in run.signals.items():
            assert np.isfinite(signal).all(), (number, name)
        assert np.isfinite(run.slip_ratio)
        if d.effects:
            assert_no_runaway(run, number)
            continue
        missing, ground = energies(run)
        if abs(missing) > 2e-3:  # fast motors or a bouncing wheel: integrate the powers more finely
            finer = run_of(d, FINE)
            assert isinstance(finer, Run)
            missing, ground = energies(finer)
        assert abs(missing) < 2e-3, (number, d.kind, missing)
        assert ground > -1e-2, (number, d.kind, ground)
    assert went >= BATCH // 3


def assert_no_runaway(run: Run, number: int) -> None:
    """With effects that change masses, radii and forces a rough bound on kinetic energy remains."""
    c, d = run.robot.chassis, run.robot.drive
    power = sum(
        2 * d.gear_ratio * d.torque_constant * run[f"current_{a}_A"] * run[f"omega_{a}_radps"] for a in "fr"
    )
    work = float(np.trapezoid(np.maximum(power, 0), run.t))
    slope = abs(run.effects.get("ground_slope", {}).get("slope", 0.0))
    given = work + c.total_mass * GRAVITY * np.sin(np.radians(slope)) * float(run["x_m"].max())
    kinetic = c.total_mass * run["v_mps"] ** 2 / 2
    assert kinetic.max() <= 2 * given + 1e-3, (number, run.effects)


def test_the_balance_sees_energy_from_nowhere() -> None:
    """The check itself: a run whose forces are falsified by one per cent does not pass it."""
    run = simulate(variant_of(0.5), ROBOT, SOIL)
    assert abs(energies(run)[0]) < 1e-3
    wrong = dataclasses.replace(run, signals=run.signals | {"moment_f_Nm": 1.01 * run["moment_f_Nm"]})
    assert abs(energies(wrong)[0]) > 1e-3


SOFT = dataclasses.replace(SOIL, tyre_friction=0.05)
HEAVY, IDLE = altered(ROBOT, chassis={"body_mass": 2e3}), altered(ROBOT, drive={"gain_p": 0.0, "gain_d": 0.0})
ODD = draw(5, 1612)
"""0.4 J of the motors, 3.4 J in the robot: its thrust drives it without the wheels."""
QUICK = Variant(velocity=3.0, acceleration=4.0, distance=0.1)
ENDLESS = Variant(velocity=0.01, acceleration=1.0, distance=1e4)
UNFIT = {
    "sinks to its axles": (variant_of(0.3), HEAVY, dataclasses.replace(SOIL, frictional_modulus=1e4), {}),
    "the ground pushes the robot backwards": (variant_of(0.7), ROBOT, SOFT, {"a_theta": 20.0}),
    "which is outside the model's range": (ODD.variant, ODD.robot, ODD.soil, {"a_theta": ODD.a_theta}),
    "the wheels do not turn": (variant_of(0.3), IDLE, SOIL, {"k92": 1.0}),
    "0.1 m are too short for 3 m/s at 4 m/s": (QUICK, ROBOT, SOIL, {}),
    "the run would last 1000000 s": (ENDLESS, ROBOT, SOIL, {}),
}


@pytest.mark.parametrize("reason", UNFIT)
def test_what_cannot_be_driven_is_refused_with_a_reason(reason: str) -> None:
    variant, robot, soil, law = UNFIT[reason]
    with pytest.raises(EstimateError, match=reason) as caught:
        simulate(variant, robot, soil, **law)
    assert caught.value.hint
    assert caught.value.hint.startswith("choose a") or variant not in (QUICK, ENDLESS)
    assert MAX_SAMPLES * Accuracy().step == 1000


@pytest.mark.parametrize("size", [0.5, 2.0, 4.0])
@pytest.mark.parametrize("number", range(3))
def test_a_robot_of_another_size_slips_alike(size: float, number: int) -> None:
    """Froude's similarity: lengths by s, masses by s³, times by √s, soil and motors to match.

    Only the floor of the slip's denominator, a fixed velocity, does not scale; it acts near standstill.
    """
    rng = np.random.default_rng([8, number])
    robot = dataclasses.replace(
        ROBOT, chassis=near(ROBOT.chassis, rng, 1.2), drive=near(ROBOT.drive, rng, 1.2)
    )
    soil, k92 = near(SOIL, rng, 1.2), float(rng.uniform(0.1, 1))
    v = load_variants()[2]
    small = simulate(v, robot, soil, k92=k92, accuracy=Accuracy(1e-7, 1e-9))
    other, ground = scaled(robot, soil, size)
    motion = Variant(velocity=v.velocity * size**0.5, acceleration=v.acceleration, distance=v.distance * size)
    large = simulate(motion, other, ground, k92=k92, accuracy=Accuracy(1e-7, 1e-9))
    assert large.slip_ratio == pytest.approx(small.slip_ratio, abs=2e-4)
    t = np.linspace(0.5, 0.9, 50) * small.steady[1]
    for name, power in (
        ("v_mps", 0.5),
        ("sinkage_f_m", 1),
        ("sinkage_r_m", 1),
        ("torque_r_Nm", 4),
        ("current_f_A", 2.5),
    ):
        got = np.interp(t * size**0.5, large.t, large[name]) / size**power
        want = np.interp(t, small.t, small[name])
        np.testing.assert_allclose(got, want, rtol=5e-3, atol=1e-3 * np.abs(small[name]).max(), err_msg=name)


@pytest.mark.parametrize("factor", [0.2, 7.0])
def test_all_forces_by_one_factor_leave_the_motion_as_it_is(factor: float) -> None:
    names = ("body_mass", "wheel_mass", "wheel_inertia", "pitch_inertia", "contact_damping")
    heavy = times(ROBOT, factor, chassis=dict.fromkeys(names, 1), drive={"torque_constant": 1})
    firm = grown(SOIL, factor, dict.fromkeys(("cohesive_modulus", "frictional_modulus", "cohesion"), 1))
    a, b = (
        simulate(variant_of(0.7), robot, soil, accuracy=Accuracy(1e-8, 1e-10))
        for robot, soil in ((ROBOT, SOIL), (heavy, firm))
    )
    assert b.slip_ratio == pytest.approx(a.slip_ratio, abs=1e-7)
    np.testing.assert_allclose(b["v_mps"], a["v_mps"], atol=1e-6)
    np.testing.assert_allclose(b["force_x_f_N"], factor * a["force_x_f_N"], atol=1e-3 * factor)


@pytest.mark.parametrize("number", range(8))
def test_front_and_rear_exchange_with_the_centre_of_mass_mirrored(number: int) -> None:
    """At rest with equal contact angles: sinkages and loads change places, the pitch its sign."""
    rng = np.random.default_rng([11, number])
    robot = dataclasses.replace(
        ROBOT, chassis=near(ROBOT.chassis, rng, 1.3), wheels=near(ROBOT.wheels, rng, 1.3)
    )
    soil = near(SOIL, rng, 1.3)
    mirrored = altered(robot, chassis={"com_x": -robot.chassis.com_x})
    here, there = (
        rest_state(model_parameters(one, soil, variant_of(0.3), k92=1.0)) for one in (robot, mirrored)
    )
    assert there[1] == pytest.approx(here[1], rel=1e-9)  # height
    assert there[2] == pytest.approx(-here[2], rel=1e-6, abs=1e-12)  # pitch


def test_on_hard_ground_sinkage_and_slip_vanish_together() -> None:
    """The same load on moduli 10 and 100 times as high: W ~ k z^(n + 1/2) gives the sinkage."""
    hard = [dataclasses.replace(SOIL, frictional_modulus=m, cohesive_modulus=0.0) for m in (1e7, 1e8, 1e9)]
    runs = [simulate(variant_of(0.3), ROBOT, soil, k92=1.0) for soil in hard]
    sinkages = [run["sinkage_f_m"][0] for run in runs]
    for harder, softer in zip(sinkages[1:], sinkages[:-1], strict=True):
        assert harder == pytest.approx(softer * 10 ** (-1 / (SOIL.exponent + 0.5)), rel=0.02)
    slips = [abs(run.slip_ratio) for run in runs]
    assert slips[2] < 1e-3
    assert runs[2]["sinkage_f_m"].max() < 1e-3
