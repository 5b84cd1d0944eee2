"""Soil and vehicle effects act in the direction, and by the amount, that physics says."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from granite_lab.effects import get
from granite_lab.effects.bulldozing import UNIT_WEIGHT
from granite_lab.model.contact import ContactAngles, WheelState, contact_angles, wheel_forces
from granite_lab.model.effect import Axle, Own
from granite_lab.model.symbols import model_parameters
from granite_lab.parameters import GRAVITY, variant_of
from tests.effects.runs import CHASSIS, ROBOT, SOIL, at, mean, run

MODEL = model_parameters(ROBOT, SOIL, variant_of(0.5), a_theta=4.919)


def steady_force(r: object, name: str) -> float:
    """Return the sum over the four wheels at the end of the steady part."""
    t = r.steady[1]
    return 2 * (at(r, t, f"{name}_f_N") + at(r, t, f"{name}_r_N"))


def test_pushing_sand_ahead_costs_slip_and_the_passive_pressure_of_rankine() -> None:
    plain, changed = run(), run("bulldozing", strength=0.5)
    assert changed.slip_ratio > plain.slip_ratio + 0.01
    t = plain.steady[1]
    for a in "fr":
        z = at(changed, t, f"sinkage_{a}_m")
        K_p = (1 + np.sin(np.radians(30))) / (1 - np.sin(np.radians(30)))
        F_b = ROBOT.wheels.width * (2 * SOIL.cohesion * np.sqrt(K_p) * z + UNIT_WEIGHT * K_p * z**2 / 2)
        added = at(changed, t, f"force_x_{a}_N") - (
            at(changed, t, f"thrust_{a}_N") + at(changed, t, f"resistance_{a}_N")
        )
        assert added == pytest.approx(-0.5 * F_b, rel=1e-6)


def test_slip_makes_the_wheels_sink_deeper_and_standstill_does_not() -> None:
    plain, changed = run(v=0.7), run("slip_sinkage", v=0.7, growth=0.4)
    assert at(changed, -0.5, "sinkage_f_m") == pytest.approx(at(plain, -0.5, "sinkage_f_m"), abs=1e-9)
    slow = run("slip_sinkage", v=0.2, growth=0.4)
    deeper = [
        mean(c, "sinkage_r_m", *p.steady) - mean(p, "sinkage_r_m", *p.steady)
        for c, p in ((slow, run(v=0.2)), (changed, plain))
    ]
    assert 0 < deeper[0] < 0.3 * deeper[1]


def test_the_rear_wheels_rise_once_they_reach_the_rut_of_the_front_wheels() -> None:
    plain, changed = run(), run("multi_pass", pressure=0.5, shear=0.2)
    before = plain["x_m"] < CHASSIS.wheel_base - 0.05
    np.testing.assert_allclose(changed["sinkage_r_m"][before], plain["sinkage_r_m"][before], atol=1e-6)
    late = float(np.interp(CHASSIS.wheel_base + 0.2, plain["x_m"], plain.t))
    assert at(changed, late, "sinkage_r_m") < at(plain, late, "sinkage_r_m") - 1e-3
    assert at(changed, late, "pitch_rad") > at(plain, late, "pitch_rad")  # nose down


def test_soil_that_stiffens_with_speed_carries_the_faster_robot_higher() -> None:
    rise = []
    for v in (0.2, 0.7):
        plain, changed = run(v=v), run("rate_dependent_soil", v=v, stiffening=0.5)
        rise.append(mean(plain, "sinkage_f_m", *plain.steady) - mean(changed, "sinkage_f_m", *plain.steady))
        assert at(changed, -0.5, "sinkage_f_m") == pytest.approx(at(plain, -0.5, "sinkage_f_m"), abs=1e-9)
    assert 0 < rise[0] < rise[1]


def test_the_lugs_ripple_stands_in_the_spectrum_at_lugs_times_wheel_rate() -> None:
    r, plain = run("tread_ripple", cos_front=0.1, cos_rear=0.1), run()
    inside = (r.t > r.steady[0]) & (r.t < r.steady[1])
    ripple = (r["imu_az_mps2"] - plain["imu_az_mps2"])[inside]
    power = np.abs(np.fft.rfft((ripple - ripple.mean()) * np.hanning(ripple.size))) ** 2
    loudest = np.fft.rfftfreq(ripple.size, r.t[1] - r.t[0])[power.argmax()]
    expected = ROBOT.wheels.lugs * mean(r, "omega_f_radps", *r.steady) / (2 * np.pi)
    assert loudest == pytest.approx(expected, rel=0.03)


def test_a_run_out_of_the_wheels_heaves_the_body_by_as_much() -> None:
    """Slow wheels in step: the axles follow the rim's height, the soil yields only a little to it."""
    e = 1e-3
    r, plain = run("wheel_eccentricity", v=0.2, cos_front=e, cos_rear=e), run(v=0.2)
    inside = (r.t > r.steady[0] - 1.5) & (r.t < r.steady[1])
    heave = (r["z_m"] - plain["z_m"])[inside]
    swing = np.cos(r["theta_f_rad"][inside])
    slope = np.polyfit(swing, heave, 1)[0]
    # the wheel's centre is above the axle by e cos θ: the axle goes down when the centre is up
    assert slope == pytest.approx(-e, rel=0.1)


def test_a_lagging_contact_angle_follows_the_desired_one_late_and_ends_there() -> None:
    plain, changed = run(), run("contact_angle_lag", time=0.2)
    ratio = changed["angle_rear_f_rad"] / changed["angle_front_f_rad"]
    ramp = plain.variant.velocity / plain.variant.acceleration
    assert float(np.interp(ramp, changed.t, ratio)) > at(changed, ramp, "k92") + 0.1
    end = plain.steady[1]
    assert float(np.interp(end, changed.t, ratio)) == pytest.approx(at(changed, end, "k92"), abs=1e-4)
    assert changed.slip_ratio == pytest.approx(plain.slip_ratio, abs=2e-4)


def test_a_contact_angle_that_follows_the_actual_speed_is_that_of_the_actual_speed() -> None:
    changed = run("contact_angle_actual_speed", weight=1.0)
    moving = changed["v_mps"] > 0.1
    np.testing.assert_allclose(
        changed["k92"][moving], np.exp(-4.919 * changed["v_mps"][moving]), rtol=0, atol=3e-3
    )


def test_thrown_sand_costs_slip_where_the_wheels_slip_fast() -> None:
    more = [run("sand_throw", v=v, loss=0.1).slip_ratio - run(v=v).slip_ratio for v in (0.2, 0.7)]
    assert 0 < more[0] < 0.001
    assert more[1] > 0.01


def test_a_slope_costs_the_weight_s_part_along_it() -> None:
    plain, changed = run(), run("ground_slope", slope=1.0)
    more = steady_force(changed, "force_x") - steady_force(plain, "force_x")
    assert more == pytest.approx(CHASSIS.total_mass * GRAVITY * np.sin(np.radians(1.0)), rel=0.01)
    assert changed.slip_ratio > plain.slip_ratio


def test_a_payload_sinks_the_robot_and_loads_the_wheels_with_its_weight() -> None:
    plain, changed = run(), run("payload_mass", mass=4.0)
    assert steady_force(changed, "force_z") - steady_force(plain, "force_z") == pytest.approx(
        4.0 * GRAVITY, rel=1e-3
    )
    for a in "fr":
        assert at(changed, -0.5, f"sinkage_{a}_m") > at(plain, -0.5, f"sinkage_{a}_m") + 5e-4


def test_a_centre_of_mass_further_forward_loads_the_front_by_weight_times_shift_over_wheelbase() -> None:
    plain, changed = run(), run("com_offset", forward=0.02)
    shift = 2 * (at(changed, -0.5, "force_z_f_N") - at(plain, -0.5, "force_z_f_N"))
    weight = CHASSIS.total_mass * GRAVITY
    nose = at(changed, -0.5, "pitch_rad") - at(plain, -0.5, "pitch_rad")
    assert shift == pytest.approx(weight * (0.02 + CHASSIS.com_z * nose) / CHASSIS.wheel_base, rel=2e-3)
    assert at(changed, -0.9, "x_m") == pytest.approx(0, abs=1e-6)


def test_drag_is_as_large_as_stated_and_grows_with_the_chosen_power() -> None:
    for exponent in (1.0, 2.0):
        r = run("rolling_drag", force=8.0, exponent=exponent)
        t = r.steady[1]
        added = steady_force(r, "force_x") - steady_force(r, "thrust") - steady_force(r, "resistance")
        assert added == pytest.approx(-8.0 * (at(r, t, "v_mps") / 0.5) ** exponent, rel=5e-3)


@pytest.mark.parametrize("effect_id", ["bulldozing", "rolling_drag", "sand_throw", "drivetrain_friction"])
def test_passive_effects_never_add_power(effect_id: str) -> None:
    """At random motions, forward and backward, over the prior range: the added power is not positive."""
    effect, rng = get(effect_id), np.random.default_rng(1)
    for _ in range(300):
        v, rate = rng.uniform(-0.8, 0.8), rng.uniform(-8, 8)
        sliding = {name: float(np.sign(rate)) for name in effect.states}
        values = {p.name: rng.uniform(p.prior_low, p.prior_high) for p in effect.parameters}
        own = Own(values, sliding, 0.0, MODEL)
        state = WheelState(
            front=True, travel=1.0, angle=1.0, rate=rate, tread_rate=rate, velocity=v,
            sinkage=rng.uniform(0.005, 0.03), sinkage_rate=0.0, radius=ROBOT.wheels.radius,
            width=ROBOT.wheels.width, v_desired=abs(v),
        )  # fmt: skip
        angles: ContactAngles = contact_angles(state, rng.uniform(0, 1))
        forces = wheel_forces(state, angles, SOIL, 1000.0)
        changed = effect.wheel_forces(forces, state, angles, SOIL, own)
        added = float(changed.longitudinal - forces.longitudinal) * v
        added += float(changed.moment - forces.moment) * rate
        added += float(effect.drive_torque(0.0, state, own)) * rate
        if v < 0 < rate:  # a smaller thrust holds a robot that rolls backward less, but gives no power
            assert float(changed.thrust) * v + float(changed.moment) * rate <= 0
        else:
            assert added <= 1e-9


def test_dry_friction_gives_back_no_work_however_the_wheel_turns_and_holds_it_at_rest() -> None:
    effect, rng = get("drivetrain_friction"), np.random.default_rng(2)
    values = {"coulomb": 1.0, "viscous": 0.0, "creep": 0.005}
    knots = rng.uniform(-0.3, 0.3, 20)
    knots[-3:] = 0.0  # and stands in the end
    t = np.linspace(0, 19, 40_001)
    rate, held, work = np.interp(t, np.arange(20), knots), 0.0, 0.0
    for ω in rate:
        state = SimpleNamespace(front=True, rate=ω)
        own = Own(values, {"held_f": held, "held_r": 0.0}, 0.0, MODEL)
        work -= float(effect.drive_torque(0.0, cast("WheelState", state), own)) * ω * (t[1] - t[0])
        assert work > -1e-6
        axle = cast("Axle", SimpleNamespace(state=state))
        held += float(effect.rates((axle, axle), MODEL, own)["held_f"]) * (t[1] - t[0])
    assert work > 0.5 * float(np.abs(rate).mean()) * t[-1]
    assert abs(held) > 0.9
