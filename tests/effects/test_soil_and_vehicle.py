"""Soil, vehicle and sensor effects act in the direction, and by the amount, that physics says."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from granite_lab.effects import get
from granite_lab.model.contact import ContactAngles, WheelState, contact_angles, wheel_forces
from granite_lab.model.effect import Axle, Own
from granite_lab.model.symbols import model_parameters
from granite_lab.parameters import GRAVITY, variant_of
from tests.effects.runs import ROBOT, SOIL, at, run

MODEL = model_parameters(ROBOT, SOIL, variant_of(0.5), a_theta=4.919)


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


# effect: (its values, the readings that are scaled, and by how much)
SENSOR_EFFECTS: dict[str, tuple[dict[str, float], dict[str, float]]] = {
    "imu_tilt": ({"tilt": 1.0}, {}),
    "clock_offset": ({"offset": 0.02}, {}),
    "wheel_radius_error": ({"error": 0.02}, {"enc_f_rad": 1.02, "enc_r_rad": 1.02}),
    "accel_scale_error": ({"x": 0.02, "z": 0.01}, {"imu_ax_mps2": 1.02, "imu_az_mps2": 1.01}),
}


@pytest.mark.parametrize("effect_id", SENSOR_EFFECTS)
def test_readings_are_scaled_as_said_and_what_the_robot_does_stays_as_it_was(effect_id: str) -> None:
    values, scaled = SENSOR_EFFECTS[effect_id]
    plain, changed = run(), run(effect_id, **values)
    for name in plain.signals:
        if name in scaled or name[:4] not in ("imu_", "enc_", "cur_"):
            expected = plain[name] * scaled.get(name, 1.0)
            np.testing.assert_allclose(changed[name], expected, rtol=1e-12, atol=1e-9, err_msg=name)


def test_late_stamps_shift_encoders_and_currents_and_not_the_imu() -> None:
    plain, changed = run(step=0.001), run("clock_offset", step=0.001, offset=0.013)
    t = np.linspace(-0.5, 6, 400)
    for name in ("enc_f_rad", "enc_r_rad", "cur_f_A", "cur_r_A"):
        expected = np.interp(t - 0.013, plain.t, plain[name])
        np.testing.assert_allclose(np.interp(t, changed.t, changed[name]), expected, atol=0.003)
        assert np.abs(np.interp(t, plain.t, plain[name]) - expected).max() > 0.05
    np.testing.assert_array_equal(changed["imu_ax_mps2"], plain["imu_ax_mps2"])
    early = run("clock_offset", offset=-0.013)
    assert at(early, 0.3, "enc_f_rad") > at(plain, 0.3, "enc_f_rad") > at(changed, 0.3, "enc_f_rad")


def test_a_tilted_imu_reads_a_part_of_gravity_along_x() -> None:
    """Nose down, x of the sensor points into the ground a little: at rest it reads -g sin(tilt)."""
    plain, changed = run(), run("imu_tilt", tilt=1.0)
    shift = at(changed, -0.5, "imu_ax_mps2") - at(plain, -0.5, "imu_ax_mps2")
    assert shift == pytest.approx(-GRAVITY * np.sin(np.radians(1.0)), rel=1e-3)


def test_an_encoder_out_of_true_sends_the_wheel_ahead_and_behind_once_a_revolution() -> None:
    """The controller keeps the reading even, so that it is the wheel that swings."""
    c, s = 0.02, 0.01
    plain, changed = run(), run("encoder_eccentricity", cos_front=c, sin_front=s)
    angle = changed["theta_f_rad"]
    error = changed["enc_f_rad"] - angle
    np.testing.assert_allclose(error, c * np.sin(angle) + s * (np.cos(angle) - 1), atol=1e-12)
    even = np.gradient(changed["enc_f_rad"], changed.t)
    steady = (changed.t > changed.steady[0]) & (changed.t < changed.steady[1])
    swing, left = np.ptp(changed["omega_f_radps"][steady]), np.ptp(even[steady])
    assert swing == pytest.approx(2 * np.hypot(c, s) * 0.5 / ROBOT.wheels.radius, rel=0.2)
    assert left < 0.2 * swing  # the back-EMF is the wheel's, so that a little is left
    np.testing.assert_array_equal(changed["enc_r_rad"], changed["theta_r_rad"])
    assert np.ptp(plain["omega_f_radps"][steady]) < 0.05 * swing
