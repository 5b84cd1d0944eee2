"""What mechanics demands of an effect, by the library's formula and by the hidden one: other code each."""

from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from granite_lab.effects import get
from granite_lab.hidden.catalogue import model_of
from granite_lab.hidden.command import trapezoid
from granite_lab.hidden.model import Setup
from granite_lab.hidden.parts import exponential_k92
from granite_lab.model import Accuracy, simulate
from granite_lab.model.effect import activate
from granite_lab.parameters import GRAVITY, Variant
from tests.effects.runs import CHASSIS, DRIVE, ROBOT, SOIL
from tests.soak import sampled
from tests.truth.simulator import Result, integrate

WEIGHT = CHASSIS.total_mass * GRAVITY
BOTH_AXLES = {
    "sinkage": "sinkage_{}_m", "normal": "force_z_{}_N", "F": "force_x_{}_N", "torque": "torque_{}_Nm",
    "current": "current_{}_A", "omega": "omega_{}_radps", "slip": "slip_{}",
}  # fmt: skip
SHAPES = {"contact_angle_lag": {"exponent": 0.0}}
"""Numbers of hidden effects that the library's do not have."""


def by_library(command: Variant, effect: str, values: dict[str, float]) -> Result:
    effects = (activate(get(effect), values),) if effect else ()
    run = simulate(command, ROBOT, SOIL, effects=effects, accuracy=Accuracy(1e-7, 1e-9, 0.0025))
    pairs = {name: np.stack([run[s.format(a)] for a in "fr"], axis=1) for name, s in BOTH_AXLES.items()}
    k92 = run["angle_rear_f_rad"] / run["angle_front_f_rad"]
    x, v, pitch, up = (run[name] for name in ("x_m", "v_mps", "pitch_rad", "imu_az_mps2"))
    pull = np.stack([run[f"thrust_{a}_N"] + run[f"resistance_{a}_N"] for a in "fr"], axis=1)
    return Result(t=run.t, x=x, v=v, pitch=pitch, up=up, k92=k92, pull=pull, **pairs)


def by_hidden(command: Variant, effect: str, values: dict[str, float]) -> Result:
    given = trapezoid(command.velocity, command.acceleration, command.distance)
    sizes = {effect: values | SHAPES.get(effect, {})} if effect else {}
    truth = model_of(tuple(sizes), Setup(ROBOT, SOIL, exponential_k92(4.919)), given, sizes)
    run = integrate(truth, np.arange(-0.5, 2.9, 0.0025), rtol=1e-5, atol=1e-7)
    run.pull, run.F, run.up = run.F + run.R, run.F + run.R, run.acceleration[:, 1]
    return run


@lru_cache
def seen(by: Any, effect: str = "", speed: float = 0.5, **values: float) -> Result:
    return by(Variant(velocity=speed, acceleration=1.2, distance=2.8 * speed), effect, values)


def steady(r: Result, name: str) -> np.ndarray:
    """Mean over the last 0.8 s before the brake, at 2.8 s."""
    return np.asarray(getattr(r, name))[(r.t > 2.0) & (r.t < 2.8)].mean(axis=0)


def resting(r: Result, name: str) -> np.ndarray:
    return r.at(-0.3, name)


pytestmark = pytest.mark.parametrize("by", [by_library, by_hidden], ids=["library", "hidden"])


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("rolling_drag", {"force": 12.0, "exponent": 1.5}),
        ("bulldozing", {"strength": 0.5}),
        ("ground_slope", {"slope": 1.5}),
    ],
)
def test_what_resists_costs_speed_and_current(by: Any, effect: str, values: dict[str, float]) -> None:
    plain, r = seen(by), seen(by, effect, **values)
    assert steady(r, "v") < steady(plain, "v") - 5e-3
    assert (steady(r, "current") > steady(plain, "current") + 0.01).all()


@pytest.mark.parametrize("exponent", sampled([0.0, 1.0, 1.5, 2.0]))
def test_drag_is_as_large_as_stated_and_grows_with_the_chosen_power(by: Any, exponent: float) -> None:
    """What the wheels pull with, less what the robot gains."""
    by = by if exponent else by_library  # the hidden one has no constant part
    r = seen(by, "rolling_drag", force=20.0, exponent=exponent)
    left = 2 * r.pull.sum(axis=1) - CHASSIS.total_mass * np.gradient(r.v, r.t)
    late = (r.t > 2.0) & (r.t < 2.8)
    u = r.v[late] / 0.5
    share = u**exponent if by is by_library else (2 - exponent) * u + (exponent - 1) * u**2
    assert left[late] == pytest.approx(20.0 * share, abs=0.05)


def test_a_slope_costs_the_weight_s_part_along_it(by: Any) -> None:
    plain, r = seen(by), seen(by, "ground_slope", slope=1.5)
    more = 2 * (steady(r, "F") - steady(plain, "F")).sum()
    assert more == pytest.approx(WEIGHT * np.sin(np.radians(1.5)), rel=1e-3)
    assert np.abs(r.v[r.t < 0]).max() < 1e-6


def test_a_payload_sinks_the_robot_and_loads_the_wheels_with_its_weight(by: Any) -> None:
    plain, r = seen(by), seen(by, "payload_mass", mass=5.0, place=0.0)
    for state in (resting, steady):
        more = 2 * (state(r, "normal") - state(plain, "normal")).sum()
        assert more == pytest.approx(5.0 * GRAVITY, rel=1e-3)
        assert (state(r, "sinkage") > state(plain, "sinkage") + 8e-4).all()


def test_a_payload_ahead_of_the_middle_loads_the_axles_by_its_levers(by: Any) -> None:
    """Moments about the middle between the axles; a nose that sinks carries the centre of mass, too."""
    plain, r = seen(by), seen(by, "payload_mass", mass=5.0, place=0.1)
    front, rear = 2 * (resting(r, "normal") - resting(plain, "normal"))
    tilt = WEIGHT * CHASSIS.com_z * (resting(r, "pitch") - resting(plain, "pitch"))
    assert front + rear == pytest.approx(5.0 * GRAVITY, rel=1e-3)
    assert (front - rear) * CHASSIS.wheel_base / 2 == pytest.approx(5.0 * GRAVITY * 0.1 + tilt, rel=1e-2)


def test_a_centre_of_mass_further_forward_loads_the_front_by_its_lever(by: Any) -> None:
    plain, r = seen(by), seen(by, "com_offset", forward=0.03)
    front, rear = 2 * (resting(r, "normal") - resting(plain, "normal"))
    lever = 0.03 + CHASSIS.com_z * (resting(r, "pitch") - resting(plain, "pitch"))
    assert front == pytest.approx(WEIGHT * lever / CHASSIS.wheel_base, rel=2e-3)
    assert front + rear == pytest.approx(0, abs=1e-4)


def test_the_drives_reaction_moves_the_load_rearward_by_torque_over_wheelbase(by: Any) -> None:
    """Moments about the rear axle; the nose that rises carries the centre of mass back a little, too."""
    plain, r = seen(by), seen(by, "drive_reaction", share=1.0)
    torque = 2 * steady(r, "torque").sum()
    tilt = WEIGHT * CHASSIS.com_z * (steady(plain, "pitch") - steady(r, "pitch"))
    shift = (torque + tilt) / CHASSIS.wheel_base
    assert 2 * (steady(r, "normal") - steady(plain, "normal")) == pytest.approx([-shift, shift], rel=3e-3)
    assert tilt < 0.03 * torque
    assert resting(r, "normal") == pytest.approx(resting(plain, "normal"), abs=1e-5)


def test_friction_in_the_gears_costs_current_and_not_speed(by: Any) -> None:
    plain, r = seen(by), seen(by, "drivetrain_friction", coulomb=1.0, viscous=0.1)
    per_ampere = DRIVE.gear_efficiency * DRIVE.gear_ratio * DRIVE.torque_constant
    more = steady(r, "current") - steady(plain, "current")
    assert more == pytest.approx((1.0 + 0.1 * steady(r, "omega")) / per_ampere, rel=2e-3)
    assert steady(r, "v") == pytest.approx(steady(plain, "v"), abs=1e-4)


def test_a_wrong_torque_constant_scales_the_currents_alone(by: Any) -> None:
    plain, r = seen(by), seen(by, "torque_constant_error", error=-0.1)
    i = steady(r, "current")
    share = 1.0 if by is by_library else 0.8 + 0.4 * i / (i + 4.0)
    assert i * (1 - 0.1 * share) == pytest.approx(steady(plain, "current"), rel=1e-3)
    assert steady(r, "v") == pytest.approx(steady(plain, "v"), abs=1e-5)
    assert steady(r, "torque") == pytest.approx(steady(plain, "torque"), rel=1e-3)


def change_by_speed(by: Any, effect: str, **values: float) -> list[np.ndarray]:
    """Change of the sinkage at 0.2 and at 0.7 m/s; there is none at rest."""
    found = []
    for speed in (0.2, 0.7):
        plain, r = seen(by, speed=speed), seen(by, effect, speed=speed, **values)
        assert resting(r, "sinkage") == pytest.approx(resting(plain, "sinkage"), abs=1e-9)
        found.append(steady(r, "sinkage") - steady(plain, "sinkage"))
    return found


def test_slip_makes_the_wheels_sink_deeper_and_standstill_does_not(by: Any) -> None:
    slow, fast = change_by_speed(by, "slip_sinkage", growth=0.4)
    assert (fast > 1e-3).all()
    assert ((slow > 0) & (slow < 0.5 * fast)).all()


def test_soil_that_stiffens_with_speed_carries_the_faster_robot_higher(by: Any) -> None:
    slow, fast = change_by_speed(by, "rate_dependent_soil", stiffening=0.5)
    assert (slow < -5e-4).all()
    assert (fast < slow).all()


@pytest.mark.parametrize("lead", sampled([0.05, 0.0]))
def test_the_rear_wheels_rise_once_they_reach_the_rut_of_the_front_wheels(by: Any, lead: float) -> None:
    plain, r = seen(by), seen(by, "multi_pass", pressure=0.5, shear=0.2, lead=lead, depth=0.0)
    before = plain.x < CHASSIS.wheel_base - 0.05 - lead
    depth = np.stack([np.interp(plain.t, r.t, column) for column in r.sinkage.T], axis=1)
    np.testing.assert_allclose(depth[before], plain.sinkage[before], atol=1e-6)
    risen = plain.x[(plain.sinkage - depth)[:, 1] > 1e-4].min()
    assert risen == pytest.approx(CHASSIS.wheel_base - lead, abs=0.03)
    assert (steady(r, "sinkage") - steady(plain, "sinkage"))[1] < -1e-3
    assert steady(r, "pitch") > steady(plain, "pitch")  # nose down
    assert steady(r, "slip")[0] < steady(plain, "slip")[0]


def test_a_rut_that_stays_deep_lowers_the_rear_wheels_by_its_depth_and_leaves_their_load(by: Any) -> None:
    plain, r = seen(by), seen(by, "multi_pass", pressure=0.0, shear=0.0, lead=0.0, depth=0.003)
    before = plain.x < CHASSIS.wheel_base - 0.05
    up = np.interp(plain.t, r.t, r.up)
    np.testing.assert_allclose(up[before], plain.up[before], atol=1e-6)
    tilt = np.arctan2(0.003, CHASSIS.wheel_base)
    assert steady(plain, "pitch") - steady(r, "pitch") == pytest.approx(tilt, rel=0.1)  # nose up
    assert steady(r, "sinkage")[1] == pytest.approx(steady(plain, "sinkage")[1], rel=0.03)
    np.testing.assert_allclose(steady(r, "slip"), steady(plain, "slip"), atol=0.005)


@pytest.mark.parametrize("difference", sampled([0.03, -0.03]))
def test_larger_wheels_push_and_smaller_ones_brake(by: Any, difference: float) -> None:
    plain, r = seen(by), seen(by, "unequal_wheels", difference=difference)
    front, rear = np.sign(difference) * (steady(r, "current") - steady(plain, "current"))
    assert front > 0.01
    assert rear < -0.01
    tilt = np.arctan2(difference * ROBOT.wheels.radius, CHASSIS.wheel_base)
    assert resting(plain, "pitch") - resting(r, "pitch") == pytest.approx(tilt, rel=0.1)


def test_the_lugs_ripple_stands_in_the_spectrum_at_lugs_times_wheel_rate(by: Any) -> None:
    r = seen(by, "tread_ripple", cos_front=0.1, cos_rear=0.1, sin_front=0.0, sin_rear=0.0)
    ripple = (r.up - np.interp(r.t, seen(by).t, seen(by).up))[(r.t > 0.8) & (r.t < 2.8)]
    power = np.abs(np.fft.rfft((ripple - ripple.mean()) * np.hanning(ripple.size))) ** 2
    loudest = np.fft.rfftfreq(ripple.size, r.t[1] - r.t[0])[power.argmax()]
    assert loudest == pytest.approx(ROBOT.wheels.lugs * steady(r, "omega").mean() / (2 * np.pi), rel=0.03)
    assert steady(r, "v") == pytest.approx(steady(seen(by), "v"), abs=1e-3)


def test_a_lagging_contact_angle_follows_late_helps_the_start_and_ends_where_it_should(by: Any) -> None:
    plain, r = seen(by), seen(by, "contact_angle_lag", time=0.2)
    ramp = (r.t > 0.1) & (r.t < 0.5 / 1.2)
    for name, least in (("k92", 0.1), ("v", 3e-3)):
        change = getattr(r, name) - np.interp(r.t, plain.t, getattr(plain, name))
        assert change[ramp].mean() > least
        assert change[(r.t > 2.5) & (r.t < 2.8)] == pytest.approx(0, abs=5e-4)


def test_a_softer_tyre_makes_the_body_later_at_the_start_and_leaves_the_steady_speed(by: Any) -> None:
    plain, late = seen(by), [0.0]
    for compliance in sampled((1e-3, 2e-3, 4e-3)):
        r = seen(by, "tyre_windup", compliance=compliance, retardation=0.02)
        behind = np.interp(r.t, plain.t, plain.v) - r.v
        late.append(behind[(r.t > 0.02) & (r.t < 0.15)].mean())
        assert steady(r, "v") == pytest.approx(steady(plain, "v"), abs=3e-4)
    assert np.all(np.diff(late) > 5e-4)
