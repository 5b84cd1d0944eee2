"""Effects of the library act in the direction, and by the amount, that mechanics demands."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.signal import lfilter

from granite_lab.effects import get
from granite_lab.effects.contract import typical
from granite_lab.effects.gear_backlash import GIVE, ROUND, SEATING
from granite_lab.model.contact import ContactAngles, WheelState, contact_angles, wheel_forces
from granite_lab.model.effect import Axle, Symbols
from granite_lab.model.simulator import rest_state
from granite_lab.model.symbols import model_parameters
from granite_lab.parameters import GRAVITY, load_soil, variant_of
from tests.effects.runs import CHASSIS, DRIVE, ROBOT, SOIL, at, run

MODEL = model_parameters(ROBOT, SOIL, variant_of(0.5), a_theta=4.919)
SOILS = ("dry_sand", "dry_sand_lll", "hit_simulant", "lete_sand", "regolith_simulant")
WHEEL = WheelState(
    front=True, travel=1.0, angle=1.0, rate=0.0, tread_rate=0.0, velocity=0.0, sinkage=0.02, v_desired=0.0,
    sinkage_rate=0.0, radius=ROBOT.wheels.radius, width=ROBOT.wheels.width,
)  # fmt: skip


@pytest.mark.parametrize("heavy", [1.0, 2.0])
@pytest.mark.parametrize(
    "soil", ["dry_sand", "dry_sand_lll", "hit_simulant", "lete_sand", "regolith_simulant"]
)
@pytest.mark.parametrize(
    "effect_id",
    ["contact_angle_actual_speed", "contact_angle_lag", "drivetrain_friction", "gear_backlash",
     "slip_sinkage", "supply_sag", "tyre_windup"],
)  # fmt: skip
def test_an_effect_that_only_motion_shows_leaves_the_rest_of_the_robot(
    effect_id: str, soil: str, heavy: float
) -> None:
    """Whatever the states of the effect are at the start of the iteration."""
    robot = replace(ROBOT, chassis=replace(CHASSIS, body_mass=heavy * CHASSIS.body_mass))
    p = model_parameters(robot, load_soil(soil), variant_of(0.5), a_theta=4.919)
    active = typical(get(effect_id))
    height, pitch = rest_state(p)[1:3]
    assert rest_state(p, (active,))[1:3] == pytest.approx([height, pitch], rel=1e-9, abs=1e-12)


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


def test_the_work_of_an_oval_wheel_is_that_of_its_motor() -> None:
    """Forces F_x, F_z on a wheel of radius r − h(θ) do the work −h F_x + h' F_z more than on a round one."""
    effect, θ = get("wheel_eccentricity"), np.linspace(0, 2 * np.pi, 721)
    numbers = {"cos_front": 4e-4, "sin_front": -7e-4, "oval_front": 0.3, "oval_sin_front": -0.2}
    sym = Symbols(numbers, {}, 0.0, MODEL)
    of_wheel = [replace(WHEEL, angle=angle, rate=2.0, tread_rate=2.0) for angle in θ]
    heights = np.array([float(WHEEL.sinkage - effect.wheel(w, sym).sinkage) for w in of_wheel])
    angles = contact_angles(WHEEL, 0.5)
    given = replace(wheel_forces(WHEEL, angles, SOIL, 1000.0), moment=0.0)
    F_x, F_z = float(given.longitudinal), float(given.normal)
    moments = [float(effect.wheel_forces(given, w, angles, SOIL, sym).moment) for w in of_wheel]
    slope = np.gradient(heights, θ, edge_order=2)
    assert np.allclose(moments, F_x * heights + F_z * slope, atol=2e-4 * max(np.abs(moments)))
    ψ = θ - np.arctan2(-7e-4, 4e-4)
    expected = np.hypot(4e-4, 7e-4) * (np.cos(ψ) + 0.3 * np.cos(2 * ψ) - 0.2 * np.sin(2 * ψ))
    assert np.allclose(heights, expected, atol=1e-8)


def test_a_contact_angle_that_follows_the_actual_speed_is_that_of_the_actual_speed() -> None:
    changed = run("contact_angle_actual_speed", weight=1.0, length=0.05)
    v, x = changed["v_mps"], changed["x_m"]
    instants = np.flatnonzero((v > 0.1) & (changed.t < changed.steady[1]))[::50]
    assert instants.size > 3
    for k in instants:
        past = np.exp((x[: k + 1] - x[k]) / 0.05)  # what the way so far counts
        mean = np.trapezoid(v[: k + 1] * past, x[: k + 1]) / 0.05
        assert changed["k92"][k] == pytest.approx(np.exp(-4.919 * mean), rel=0.02)


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
        own = Symbols(values, sliding, 0.0, MODEL)
        state = replace(
            WHEEL, rate=rate, tread_rate=rate, velocity=v, sinkage=rng.uniform(0.005, 0.03), v_desired=abs(v)
        )
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
        state = replace(WHEEL, rate=ω)
        own = Symbols(values, {"held_f": held, "held_r": 0.0}, 0.0, MODEL)
        work -= float(effect.drive_torque(0.0, state, own)) * ω * (t[1] - t[0])
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


def _tyre(κ: float, T_r: float, share: float, T: float, resist: float, t: np.ndarray) -> np.ndarray:
    """Return rim rate, u and u̇ (3, n) by the effect's hooks: a torque T at once, a soil that resists."""
    effect, p = get("tyre_windup"), SimpleNamespace(chassis=CHASSIS)
    values = {"compliance": κ, "retardation": T_r, "tread_share": share}

    def rates(_: float, x: np.ndarray) -> list[float]:
        states = dict(zip(effect.states, [x[1], x[2], 0.0, 0.0], strict=True))
        own = Symbols(values, states, 0.0, None)
        state = effect.wheel(replace(WHEEL, rate=x[0], tread_rate=x[0]), own)
        moment = -resist * state.tread_rate
        axle = SimpleNamespace(
            state=state, forces=SimpleNamespace(moment=moment),
            rim_acceleration=lambda inertia: (T + moment) / inertia,
        )  # fmt: skip
        found = effect.rates((axle, axle), p, own)
        rigid = axle.rim_acceleration(CHASSIS.wheel_inertia)
        turning = effect.rim_acceleration(rigid, axle, p, own)
        return [turning, found["torque_f"], found["torque_rate_f"]]

    run = solve_ivp(rates, (0, t[-1]), [0.0] * 3, t_eval=t, method="LSODA", rtol=1e-10, atol=1e-12)
    return np.asarray(run.y)


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5])
def test_rim_and_tread_are_two_masses_with_a_spring_and_a_damper_between(share: float) -> None:
    κ, T_r, T, resist = 4e-3, 0.01, 6.0, 3.0
    t = np.linspace(0, 0.2, 400)
    tread, rim = share * CHASSIS.wheel_inertia, (1 - share) * CHASSIS.wheel_inertia

    def masses(_: float, x: np.ndarray) -> list[float]:
        passed = x[2] / κ + T_r / κ * (x[0] - x[1])
        return [(T - passed) / rim, (passed - resist * x[1]) / tread, x[0] - x[1]]

    reference = solve_ivp(masses, (0, t[-1]), [0.0] * 3, t_eval=t, method="Radau", rtol=1e-10, atol=1e-12).y
    omega, u, _ = _tyre(κ, T_r, share, T, resist, t)
    assert κ * u.max() > 0.02
    np.testing.assert_allclose(κ * u, reference[2], atol=0.005 * reference[2].max())
    np.testing.assert_allclose(omega, reference[0], atol=0.005 * reference[0].max())


def test_a_softer_tyre_lowers_the_axles_by_load_over_stiffness_at_rest() -> None:
    """At standstill axle depth = sinkage of the soil + W/k_r."""
    κ = 2.5e-5
    r = run("radial_tyre_compliance", compliance=κ)
    for sign, a in ((1, "f"), (-1, "r")):
        depth = ROBOT.wheels.radius - (
            at(r, -0.5, "z_m") - sign * CHASSIS.wheel_base / 2 * np.sin(at(r, -0.5, "pitch_rad"))
        )
        load = at(r, -0.5, f"load_{a}_N")
        assert depth - at(r, -0.5, f"sinkage_{a}_m") == pytest.approx(κ * load, rel=1e-3)
    plain = run()
    assert at(r, -0.5, "sinkage_f_m") < at(plain, -0.5, "sinkage_f_m")
    assert at(r, -0.5, "load_f_N") == pytest.approx(at(plain, -0.5, "load_f_N"), rel=1e-3)


@pytest.mark.parametrize("d", [1.0, 0.4])
def test_a_soft_tyre_carries_what_the_soil_does(d: float) -> None:
    """Spring and damper are in series with the soil: the axle goes down by sinkage and deflection."""
    κ, τ, step, c_t = 5e-5, 0.01, 0.001, CHASSIS.contact_damping
    shapes = {"flattening": 0.0, "retardation": τ, "damped": d}
    r = run("radial_tyre_compliance", step=step, compliance=κ, **shapes)
    carried = r["load_f_N"] + d * c_t * np.gradient(r["sinkage_f_m"], r.t)
    axle_rate = np.gradient(CHASSIS.wheel_base / 2 * np.sin(r["pitch_rad"]) - r["z_m"], r.t)
    felt = carried + (1 - d) * c_t * axle_rate
    assert r["force_z_f_N"] == pytest.approx(felt, abs=0.01 * np.ptp(felt))
    kept = np.exp(-step / τ)
    mean = np.append(carried[0], (carried[1:] + carried[:-1]) / 2)
    spring, _ = lfilter([1 - kept], [1, -kept], mean, zi=[kept * carried[0]])
    axle = CHASSIS.wheel_base / 2 * np.sin(r["pitch_rad"]) - r["z_m"]
    deflection = axle - r["sinkage_f_m"]
    assert np.ptp(deflection) > 1e-4
    assert deflection - deflection[0] == pytest.approx(κ * (spring - spring[0]), abs=1e-6)


def test_play_in_the_gears_delays_the_start_by_the_time_the_motor_needs_to_take_it_up() -> None:
    """The motor follows the command a t²/2r, so that half the play passes within √(2 r (play/2) / a)."""
    plain, changed = run(v=0.2), run("gear_backlash", v=0.2, play=2.0)
    start = (plain.t > 0) & (plain.t < 0.3)
    late = np.interp(0.02, changed["v_mps"][start], changed.t[start]) - np.interp(
        0.02, plain["v_mps"][start], plain.t[start]
    )
    takes = np.sqrt(2 * ROBOT.wheels.radius * np.radians(1.0) / plain.variant.acceleration)
    assert 0.4 * takes < late < takes
    t = plain.steady[1]
    # the encoder sits on the motor and leads the wheel by half the play, rounded off where the teeth meet
    for a in "fr":
        bite = GIVE * at(changed, t, f"torque_{a}_Nm") / SEATING
        lead = at(changed, t, f"enc_{a}_rad") - at(changed, t, f"theta_{a}_rad")
        assert lead == pytest.approx((1 + bite - ROUND**2 / (4 * bite)) * np.radians(1.0), rel=1e-3)


def test_play_in_the_gears_gives_back_no_more_energy_than_was_put_into_it() -> None:
    share = 0.4
    r = run("gear_backlash", play=3.0, motor_share=share, step=0.001)
    for a in "fr":
        motor = np.gradient(r[f"enc_{a}_rad"], r.t)
        teeth = r[f"torque_{a}_Nm"] - share * CHASSIS.wheel_inertia * np.gradient(motor, r.t)
        taken = cumulative_trapezoid(teeth * (motor - r[f"omega_{a}_radps"]), r.t, initial=0)
        assert taken[-1] > 0.05 * taken.max() > 0
        assert taken.min() > -1e-3 * taken.max()


def test_a_sagging_supply_leaves_the_wheels_behind_the_command() -> None:
    plain, changed = run(v=0.7), run("supply_sag", v=0.7, resistance=0.5)
    t = plain.steady[1]
    for a in "fr":
        assert at(changed, t, f"enc_{a}_rad") < at(plain, t, f"enc_{a}_rad") - 0.005
        # the motor needs the same voltage for the same speed and torque in the end
        assert at(changed, t, f"voltage_{a}_V") == pytest.approx(at(plain, t, f"voltage_{a}_V"), rel=2e-3)


def test_the_bus_gives_the_current_after_its_time_constant() -> None:
    """A constant draw from full charge: 1 - exp(-t/T_s) of it, by the power of ideal bridges."""
    effect, T_s, t = get("supply_sag"), 0.01, np.linspace(0, 0.05, 50)
    axles = [SimpleNamespace(voltage=u, current=i) for u, i in ((6.0, 2.0), (5.0, 3.0))]
    p = SimpleNamespace(drive=DRIVE)

    def rate(_: float, x: np.ndarray) -> float:
        own = Symbols({"time": T_s}, {"drawn": x[0]}, 0.0, None)
        return float(effect.rates((axles[0], axles[1]), p, own)["drawn"])

    drawn = solve_ivp(rate, (0, 0.05), [0.0], t_eval=t, rtol=1e-9, atol=1e-12).y[0]
    power = 2 * (6.0 * 2.0 + 5.0 * 3.0)
    np.testing.assert_allclose(drawn, power / DRIVE.voltage_max * (1 - np.exp(-t / T_s)), atol=1e-6)
