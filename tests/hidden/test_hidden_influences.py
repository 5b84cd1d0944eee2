"""What is hidden obeys mechanics: balances and directions worked out here, not taken from the library.

What mechanics demands of the library's effects, too, stands in `tests/effects/test_mechanics.py`.
"""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import pytest

from granite_lab.hidden.catalogue import LAWS, LIBRARY, OUTSIDE, influence, model_of
from granite_lab.hidden.command import trapezoid
from granite_lab.hidden.contact import NearRest, contact, oida
from granite_lab.hidden.controller import CONTROLLERS
from granite_lab.hidden.model import ANGLE, OMEGA, VX, Setup, Truth
from granite_lab.hidden.parts import exponential_k92
from granite_lab.hidden.random_numbers import generator
from granite_lab.parameters import load_robot, load_soil
from tests.soak import sampled
from tests.truth.simulator import Result, integrate

V, A, DISTANCE = 0.5, 1.2, 1.4
A_THETA = 4.919
RESTRUCTURED = ("tyre_windup", "gear_backlash", "contact_angle_lag", "command_staircase")
"""Influences whose neutral value is a limit: another structure, stiff or fast without bound."""


def sizes_of(name: str, scale: float = 1.0, given: Mapping[str, float] = {}) -> dict[str, float]:
    kind = influence(name)
    sizes = {
        s.name: given.get(s.name, 0.5 * (s.low + s.high) * (1.0 if s.kind == "shape" else scale))
        for s in kind.declared
    }
    return kind.of_trial(sizes, np.random.default_rng(3)) | dict(given)


def model(*names: str, v: float = V, distance: float = DISTANCE, scale: float = 1.0, **given: float) -> Truth:
    sizes = {name: sizes_of(name, scale, given) for name in names}
    law = exponential_k92(A_THETA)
    return model_of(names, Setup(load_robot(), load_soil(), law), trapezoid(v, A, distance), sizes)


def run_of(truth: Truth, after: float = 1.0) -> Result:
    t = np.asarray(np.arange(-0.5, truth.command.end + after, 0.0025))
    return integrate(truth, t, rtol=3e-5, atol=1e-6)


@lru_cache
def plain() -> Result:
    return run_of(model())


@lru_cache
def brief() -> Result:
    """The plain run over 0.3 m."""
    return run_of(model(distance=0.3), after=0.2)


@lru_cache
def typical(name: str, **given: float) -> tuple[Truth, Result]:
    truth = model(name, **given)
    return truth, run_of(truth)


def steady(r: Result) -> np.ndarray:
    stop = DISTANCE / V + V / A - V / A
    return (r.t > stop - 0.8) & (r.t < stop)


def mean(r: Result, name: str) -> np.ndarray:
    return np.asarray(getattr(r, name))[steady(r)].mean(axis=0)


def widened(truth: Truth, y: np.ndarray) -> np.ndarray:
    """Put a state of the plain model into one with further states, as they are at rest."""
    full = truth.at_rest()
    full[:12] = y
    return full


@pytest.mark.parametrize("name", sorted((LIBRARY | OUTSIDE | LAWS).keys() - set(RESTRUCTURED)))
def test_without_size_the_rates_are_those_of_the_plain_model(name: str) -> None:
    truth, base, r = model(name, scale=0.0), model(), plain()
    for t in (-0.3, 0.05, 0.3, 1.5, 2.7, 3.3):
        y = r.state[np.searchsorted(r.t, t)]
        full = widened(truth, y)
        assert truth.derivative(t, full)[:12] == pytest.approx(base.derivative(t, y), rel=1e-9, abs=1e-9)
    wrong = truth.misreading()
    assert (wrong.accel == np.eye(3)).all()
    assert (wrong.gyro == np.eye(3)).all()
    assert (wrong.encoder == 1).all()
    assert (wrong.late, truth.rise, truth.bank) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", sampled(RESTRUCTURED[:3], 3))
def test_a_hundredth_of_the_size_moves_the_robot_by_less_than_a_fifth_of_the_whole(name: str) -> None:
    """A fifth, not a hundredth: a motor takes up its play in a time that goes with the root of it."""
    little, whole = (
        np.abs(run_of(model(name, scale=scale, distance=0.3), after=0.2).v - brief().v).max()
        for scale in (0.01, 1.0)
    )
    assert whole > 2e-3
    assert little < 0.2 * whole


@pytest.mark.parametrize("names", [(), *((name,) for name in sorted(LIBRARY | OUTSIDE | LAWS))], ids="+".join)
def test_the_robot_rests_until_it_is_told_to_move(names: tuple[str, ...]) -> None:
    truth = model(*names)
    rates = truth.derivative(-1.0, truth.rest())
    assert np.abs(rates[:12]).max() < 1e-6


@pytest.mark.parametrize(
    ("names", "controller"),
    [*(((name,), "") for name in sorted(LIBRARY | OUTSIDE | LAWS)), *(((), c) for c in ("", *CONTROLLERS))],
)
def test_the_rates_of_many_states_at_once_are_those_of_each(names: tuple[str, ...], controller: str) -> None:
    gains = CONTROLLERS[controller].drawn(generator(3), load_robot()) if controller else {}
    setup = Setup(
        load_robot(), load_soil(), exponential_k92(A_THETA), NearRest("parabola", 0.02, 0.002), (1.01, 0.997),
        controller=controller, gains=gains,
    )  # fmt: skip
    truth = model_of(names, setup, trapezoid(V, A, DISTANCE), {name: sizes_of(name) for name in names})
    y = truth.rest()[:, None] + 1e-3 * np.random.default_rng(1).standard_normal((truth.order, 5))
    y[VX] += [0.0, 0.01, 0.3, -0.2, 0.6]
    y[OMEGA] += y[VX] / truth.r
    for t in (0.3, 3.4):
        one_by_one = np.transpose([truth.derivative(t, one) for one in y.T])
        np.testing.assert_allclose(truth.derivative(t, y), one_by_one, rtol=1e-9, atol=1e-9)


def test_sand_that_sticks_costs_speed_and_current_in_the_steady_part() -> None:
    _, r = typical("soil_adhesion")
    assert mean(r, "v") < mean(plain(), "v") - 1e-4
    assert (mean(r, "current") > mean(plain(), "current") + 0.01).all()


def test_a_sagging_supply_lets_the_wheels_fall_behind() -> None:
    truth, r = typical("supply_sag", resistance=0.2)
    late = np.flatnonzero(steady(r))
    drawn = np.array([truth.drawn(r.t[k], r.state[k]) for k in late])
    bus = truth.drive.voltage_max - 0.2 * (0.85 * drawn + 0.15 * r.state[late, -1])
    power = 2 * (r.voltage * r.current)[late].sum(axis=1)  # of four motors: ideal bridges lose none
    assert power == pytest.approx(bus * drawn, rel=1e-6)
    assert r.state[late[-1], -1] == pytest.approx(drawn[-1], rel=0.15)  # polarised after some seconds
    behind, before = (x.s_d[late][-1] - x.rolled[late][-1] for x in (r, plain()))
    assert (behind > before).all()


def test_a_wound_up_tyre_twists_by_its_torque() -> None:
    _, r = typical("tyre_windup", compliance=2e-3, retardation=0.02)
    twist = r.state[steady(r)][:, 12:14].mean(axis=0)
    assert twist == pytest.approx(2e-3 * -mean(r, "M"), rel=0.02)


def test_backlash_lets_the_motor_lead_by_half_the_play_and_the_wheel_start_late() -> None:
    for play, twist in sampled([(2.0, 0.02), (0.02, 5e-4)]):  # the teeth's twist is a small part of it
        truth, r = typical("gear_backlash", play=play)
        lead = np.degrees(truth.shaft(r.state.T)[0].T - r.state[:, ANGLE])
        assert lead[steady(r)] == pytest.approx(play / 2, abs=twist)
    _, r = typical("gear_backlash", play=2.0)
    assert r.read_rate[steady(r)] == pytest.approx(r.omega[steady(r)], rel=1e-3)
    moved = [
        t[np.argmax(angle > 1e-3)] for t, angle in ((r.t, r.angle[:, 0]), (plain().t, plain().angle[:, 0]))
    ]
    assert moved[0] > moved[1] + 0.02


def test_the_motor_overcomes_friction_behind_play_as_well() -> None:
    _, play = typical("gear_backlash", play=2.0)
    truth = model("gear_backlash", "drivetrain_friction", play=2.0, coulomb=0.8, viscous=0.0)
    more = mean(run_of(truth), "current") - mean(play, "current")
    d = truth.drive
    torque = d.gear_efficiency * d.gear_ratio * d.torque_constant * more
    assert torque == pytest.approx(np.full(2, 0.8), rel=0.05)


def test_the_wedge_weighs_as_much_as_passive_pressure_at_the_sinkage_of_reference() -> None:
    truth, soil = model("bulldozing", strength=0.5), load_soil()
    passive = np.tan(np.radians(45 + soil.friction_angle / 2)) ** 2
    wall = truth.ground.b * (
        2 * soil.cohesion * np.sqrt(passive) * 0.016 + 1600 * 9.81 * passive * 0.016**2 / 2
    )
    y = plain().state[np.searchsorted(plain().t, 2.0)]
    with_it, without = truth.contact(2.0, y), model().contact(2.0, y)
    lost = without.R - with_it.R
    assert lost[0] < lost[1] == pytest.approx(0.5 * wall, rel=0.35)  # the rear runs deeper
    assert (with_it.F == without.F).all()


def test_a_wheel_out_of_true_lifts_the_robot_once_a_revolution() -> None:
    truth = model("wheel_eccentricity", cos_front=1e-3, sin_front=0.0, cos_rear=1e-3, sin_rear=0.0)
    y = truth.rest()
    lifted = y[1] - model().rest()[1]
    assert lifted == pytest.approx(-1.25e-3, abs=1e-5)  # the radius is shorter below, so the axle is lower
    turned = y.copy()
    turned[ANGLE] = np.pi
    assert truth.stance(0.0, turned).z0 - truth.stance(0.0, y).z0 == pytest.approx(2e-3)
    turned[ANGLE], turned[OMEGA] = 0.5, 4.0
    a, b = truth.stance(0.0, turned), truth.stance(0.0, turned + np.eye(12)[6] * 4e-6 + np.eye(12)[7] * 4e-6)
    assert (b.z0 - a.z0) / 1e-6 == pytest.approx(a.dz0, rel=1e-3)  # the rate is the derivative


def test_the_angle_of_the_actual_speed_is_its_law_of_the_last_centimetres() -> None:
    _, r = typical("contact_angle_actual_speed", weight=1.0)
    at_once = np.exp(-A_THETA * np.abs(r.v))
    assert r.k92[steady(r)] == pytest.approx(at_once[steady(r)], rel=1e-3)
    ramp = (r.t > 0.15) & (r.t < V / A)
    assert (r.k92[ramp] > at_once[ramp]).all()
    for k in np.flatnonzero(ramp)[::20]:
        past = slice(np.searchsorted(r.t, 0.0), k + 1)
        weight = np.exp((r.x[past] - r.x[k]) / 0.02)  # what the last centimetres count
        mean_speed = np.trapezoid(r.v[past] * weight, r.x[past]) / 0.02
        assert r.k92[k] == pytest.approx(np.exp(-A_THETA * mean_speed), rel=0.02)


def test_thrown_sand_costs_thrust_and_no_torque_and_nothing_without_slip() -> None:
    truth, base = model("sand_throw", loss=0.2), model()
    y = plain().state[np.searchsorted(plain().t, 2.0)]
    lossy, whole = truth.contact(2.0, y), base.contact(2.0, y)
    assert (lossy.F < whole.F).all()
    assert (lossy.F > 0.8 * whole.F).all()
    assert (lossy.M == whole.M).all()


def test_a_soft_tyre_gives_by_its_load_and_sinks_less() -> None:
    truth, base = model("radial_tyre_compliance", compliance=2.5e-5), model()
    y = truth.rest()
    wheel = truth.contact(-1.0, y)
    assert y[12:14] == pytest.approx(2.5e-5 * wheel.W, rel=0.01)
    rigid = base.contact(-1.0, base.rest())
    assert (wheel.sinkage < rigid.sinkage).all()
    assert y[1] < base.rest()[1] - 1e-4  # the axle is lower all the same
    _, r = typical("radial_tyre_compliance")
    assert (mean(r, "current") < mean(plain(), "current")).all()


def test_moister_sand_carries_better_further_on() -> None:
    truth = model("moisture_gradient", gradient=0.3)
    y = plain().state[np.searchsorted(plain().t, 2.0)].copy()
    softer = model().contact(2.0, y)
    y[0] = 1.0
    firm = truth.contact(2.0, y)
    assert pytest.approx([1.36, 1.24], abs=0.02) == firm.W / softer.W


def test_waves_lift_both_axles_in_turn() -> None:
    truth = model("washboard", height=2e-3, wavelength=0.3, phase=0.0)
    y = widened(truth, plain().state[np.searchsorted(plain().t, 1.5)])
    there = truth.places(y)
    lift = truth.stance(1.5, y).z0 - model().stance(1.5, y).z0
    assert lift == pytest.approx(2e-3 * np.sin(2 * np.pi * there / 0.3))
    ahead = y.copy()
    ahead[0] += 0.3
    assert pytest.approx(truth.contact(1.5, y).W) == truth.contact(1.5, ahead).W


def test_a_cable_pulls_by_the_way_it_lies() -> None:
    truth, r = typical("cable_drag", weight=15.0)
    pull = 2 * (r.F + r.R).sum(axis=1) - truth.mass * np.gradient(r.state[:, VX], r.t)
    late = steady(r)
    assert pull[late] == pytest.approx(15.0 * r.x[late], abs=0.3)


@pytest.mark.parametrize("name", ["wind_gust", "strap_drag"])
def test_what_comes_and_goes_takes_the_impulse_that_it_has(name: str) -> None:
    truth, r = typical(name)
    moving = (r.t > 0.3) & (r.t < DISTANCE / V)
    pull = 2 * (r.F + r.R).sum(axis=1)
    taken = np.trapezoid(pull[moving], r.t[moving]) - truth.mass * np.diff(r.state[moving, VX][[0, -1]])[0]
    sizes = truth.sizes[name]
    t = r.t[moving]
    force = (
        sizes["force"]
        * np.exp(-(((t - sizes["instant"] * truth.command.end) / (0.5 * sizes["duration"])) ** 2))
        if name == "wind_gust"
        else sizes["force"] * np.maximum(0, np.sin(2 * np.pi * t / sizes["period"] + sizes["phase"])) ** 2
    )
    assert taken == pytest.approx(np.trapezoid(force, t), rel=0.02)


def test_a_warming_lead_holds_the_heat_of_its_current() -> None:
    truth, r = typical("warm_motor", rise=0.005)
    heat = np.trapezoid(r.current**2, r.t, axis=0)
    assert r.state[-1, 12:14] == pytest.approx(heat, rel=0.02)
    warm = truth.resistance(r.state[-1])
    assert warm == pytest.approx(truth.drive.resistance * (1 + 0.005 * r.state[-1, 12:14]))


def test_a_command_in_steps_goes_where_the_ramps_go() -> None:
    truth = model("command_staircase", period=0.1)
    for t in np.linspace(0.01, truth.command.end + 0.3, 57):
        s, v = truth.demand(float(t))
        assert abs(v - truth.command.velocity(float(t))) <= A * 0.1 + 1e-9
        assert abs(s - truth.command.position(float(t))) < 0.1 * V  # the way of one step
    fine = np.linspace(0, truth.command.end + 0.2, 200001)
    v = np.array([truth.demand(float(t))[1] for t in fine])
    assert truth.demand(float(fine[-1]))[0] == pytest.approx(np.trapezoid(v, fine), abs=1e-4)


def test_an_encoder_out_of_true_reads_evenly_while_the_wheel_does_not_turn_so() -> None:
    truth, r = typical("encoder_eccentricity", amplitude_front=0.03, amplitude_rear=0.02)
    late, sizes = steady(r), truth.sizes["encoder_eccentricity"]
    read = np.array([truth.reading(y)[1] for y in r.state[late]])
    assert read == pytest.approx(V / 0.0965, rel=6e-3)  # the back-EMF, that of the wheel, still swings
    assert (np.ptp(read, axis=0) < 0.2 * np.ptp(r.omega[late], axis=0)).all()
    for axle, place in (("front", 0), ("rear", 1)):
        error = sizes[f"cos_{axle}"] + 1j * sizes[f"sin_{axle}"]
        once = (error * np.exp(1j * r.angle[late][:, place])).real
        assert r.omega[late][:, place] == pytest.approx(read[:, place] / (1 + once), rel=1e-3)


def test_an_encoder_out_of_true_counts_whole_revolutions_right_and_its_rate_is_that_of_its_angle() -> None:
    truth, r = typical("encoder_eccentricity", amplitude_front=0.2, amplitude_rear=0.1)
    y = np.tile(r.state[-1], (4001, 1))
    y[:, ANGLE] = np.linspace(0, 4 * np.pi, 4001)[:, None]
    angle, rate = truth.reading(y.T)
    assert angle[:, [0, 2000, 4000]] == pytest.approx(np.outer([1, 1], [0, 2 * np.pi, 4 * np.pi]), abs=1e-12)
    slope = np.gradient(angle, y[:, 6], axis=1)[:, 1:-1]
    np.testing.assert_allclose(rate[:, 1:-1], slope * r.omega[-1][:, None], rtol=1e-4)
    assert np.ptp(angle[0] - y[:, 6]) == pytest.approx(2 * np.arcsin(0.2), rel=1e-5)  # as geometry has it


def test_a_swinging_load_shares_the_force_by_newtons_law() -> None:
    truth = model("swinging_load", mass=4.0, frequency=1.5)
    y = widened(truth, plain().state[np.searchsorted(plain().t, 0.3)])
    y[12:] = 0.02, -0.1
    dy, wheel = truth.derivative(0.3, y), truth.contact(0.3, y)
    load = dy[VX] + dy[13]  # acceleration of the load over ground
    assert (truth.mass - 4.0) * dy[VX] + 4.0 * load == pytest.approx(2 * (wheel.F + wheel.R).sum())


def test_a_pair_holds_both() -> None:
    truth = model("tyre_windup", "drive_reaction", share=1.0, compliance=2e-3, retardation=0.02)
    assert truth.order == 18
    y = widened(truth, plain().state[np.searchsorted(plain().t, 1.0)])
    y[14:16] = y[OMEGA]
    alone = model("tyre_windup", compliance=2e-3, retardation=0.02)
    both, one = truth.derivative(1.0, y), alone.derivative(1.0, y)
    assert both[6:] == pytest.approx(one[6:])
    turned = 2 * (truth.torque(y) + 0.2 * truth.chassis.wheel_inertia * one[OMEGA]).sum()
    assert one[5] - both[5] == pytest.approx(turned / truth.chassis.pitch_inertia)


def test_rubber_that_relaxes_meets_a_fast_twist_with_twice_the_stiffness() -> None:
    truth = model("tyre_windup", compliance=2e-3, retardation=0.02)
    y = truth.rest()
    y[12:14], y[16:18] = 0.01, 0.01  # a sudden twist strains both springs
    assert truth.spring(y) == pytest.approx(np.full(2, 2 * 0.01 / 2e-3))
    y[16:18] = 0.0  # the second has relaxed
    assert truth.spring(y) == pytest.approx(np.full(2, 0.01 / 2e-3))


def test_bristles_hold_more_at_creep_than_in_sliding() -> None:
    truth = model("drivetrain_friction", coulomb=1.0, viscous=0.0)
    y = truth.rest()
    for rate, limit in ((1e-4, 1.3), (3.0, 1.0)):
        y[OMEGA], y[12:14] = rate, limit
        assert truth.derivative(1.0, y)[12:14] == pytest.approx(np.zeros(2), abs=1e-5)


def test_a_gear_that_locks_holds_the_robot_where_it_stops() -> None:
    setup = Setup(
        load_robot(), load_soil(), exponential_k92(A_THETA), near_rest=NearRest("parabola", 0.025, 0.004)
    )
    truth = Truth(setup, trapezoid(V, A, DISTANCE))
    r = run_of(truth, after=1.5)
    late = r.t > truth.command.end + 1.0
    assert np.ptp(r.x[late]) < 1e-5
    assert np.abs(r.current[late]).max() < 1e-6
    fast = (np.abs(plain().v) > 0.05) & (plain().t < truth.command.end)
    assert np.interp(plain().t, r.t, r.v)[fast] == pytest.approx(plain().v[fast], abs=3e-3)


def test_wheels_of_another_radius_roll_further_by_it() -> None:
    setup = Setup(load_robot(), load_soil(), exponential_k92(A_THETA), radii=(1.01, 1.01))
    truth = Truth(setup, trapezoid(V, A, DISTANCE))
    r = run_of(truth)
    assert mean(r, "omega") == pytest.approx(mean(plain(), "omega"), rel=1e-3)
    assert mean(r, "v") == pytest.approx(1.01 * mean(plain(), "v"), rel=2e-3)


def test_the_shear_stress_of_oida_has_its_peak_at_one_and_ends_at_the_residual_value() -> None:
    j = np.linspace(0.0, 0.05, 5001)
    share = oida(j, 0.6, 0.02)
    assert share[0] == 0.0
    assert float(oida(np.array([0.02]), 0.6, 0.02)[0]) == pytest.approx(1.0, rel=1e-12)
    assert share.max() == pytest.approx(1.0, abs=0.002)  # his peak is where j is K_w for K_r of 0.66 alone
    assert j[share.argmax()] == pytest.approx(0.02, abs=0.002)
    assert float(oida(np.array([1.0]), 0.6, 0.02)[0]) == pytest.approx(0.6, rel=1e-9)


@pytest.mark.parametrize("name", sorted(LAWS))
def test_each_contact_law_changes_the_forces(name: str) -> None:
    truth, r = typical(name)
    y = r.state[np.flatnonzero(steady(r))[50]]
    at, paper = truth.stance(1.5, y), model()
    under_law, other = (contact(m.soil(1.5, y, at), at, m.k92(1.5, y)) for m in (truth, paper))
    shares = [getattr(under_law, force) / getattr(other, force) for force in "WRFM"]
    assert np.abs(np.array(shares) - 1).max() > 0.01


def test_stress_ahead_of_the_lowest_point_resists_more_and_bounded_pressure_sinks_deeper() -> None:
    ahead, bounded = (typical(name)[1] for name in ("stress_ahead", "bearing_limit"))
    assert (mean(ahead, "current") > mean(plain(), "current")).all()
    assert (mean(bounded, "sinkage") > mean(plain(), "sinkage")).all()
