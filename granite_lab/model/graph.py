"""The right-hand side of the equations of motion and all outputs, as one CasADi expression graph.

The graph reads top to bottom like the paper: command, kinematics, contact, drives, body, sensors.
Effects rewrite single quantities on the way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import lru_cache
from typing import Any, TypeVar

import casadi as ca

from granite_lab.model import body as bd
from granite_lab.model.command import (
    TURNED,
    V_FLOOR,
    Kind,
    contact_angle_ratio,
    desired_distance,
    desired_velocity,
    smoothstep,
)
from granite_lab.model.contact import (
    ArcLaws,
    ContactAngles,
    WheelForces,
    WheelState,
    arc_stresses,
    contact_angles,
    wheel_forces,
)
from granite_lab.model.drive import control_voltage, current_rate, drive_torque
from granite_lab.model.effect import Axle, Effect, Hooks, Shaft, Symbols
from granite_lab.model.pieces import desired, pulled, spin, symbols_of_piece
from granite_lab.model.symbols import ModelParameters, paper_symbols, symbols_of
from granite_lab.parameters import Soil, Turning

BODY_STATES = ("x_cm", "z_cm", "pitch", "x_cm_rate", "z_cm_rate", "pitch_rate")
AXLE_STATES = ("angle", "rate", "current")
STATES = BODY_STATES + tuple(f"{name}_{axle}" for axle in "fr" for name in AXLE_STATES)
"""Of the paper's model; where the wheels are turned, the body alone has states."""


@dataclass(frozen=True, eq=False)
class Graph:
    """The built graph.

    Attributes:
        t, x, p: symbols of time, state and parameters.
        u: symbols of the piece of a course, as `pieces` names them; none where a trapezoid is driven.
        rates: time derivative of the state.
        outputs: name to expression; the columns of a run.
        states: names of the states, the effects' extra ones last.
        delays: sensor signal to how far its stamps lag [s], where an effect delays it.
    """

    t: Any
    x: Any
    p: Any
    u: Any
    rates: Any
    outputs: dict[str, Any]
    states: tuple[str, ...]
    delays: dict[str, Any]


def model_states(kind: Kind) -> tuple[str, ...]:
    """Return the names of the states without those of effects."""
    return BODY_STATES if kind in TURNED else STATES


@lru_cache(maxsize=64)
def build_graph(effects: tuple[Effect, ...] = (), kind: Kind = "trapezoid") -> Graph:
    """Build the graph of the paper's model with effects, in the order in which their hooks apply.

    Every number is a symbol, so that one graph serves all robots, soils and motions of a kind.
    """
    t = ca.SX.sym("t")
    paper = paper_symbols()
    names = model_states(kind) + tuple(f"{e.id}.{name}" for e in effects for name in e.states)
    x = ca.SX.sym("x", len(names))
    state: dict[str, Any] = dict(zip(names, ca.vertsplit(x), strict=True))
    column, piece = symbols_of_piece(kind)
    hooks = hooks_of(effects, state, t, paper)
    p = hooks.rewritten(Effect.system, paper)

    # command: (5), section 4; of a piece of a course, or else of the trapezoid
    v_d, s_d = (
        desired(t, piece) if piece else (desired_velocity(t, p.variant), desired_distance(t, p.variant))
    )
    v_k92 = v_d if kind == "trapezoid" else ca.fmax(0, v_d)
    body = bd.BodyState(*(state[name] for name in BODY_STATES))
    reference = bd.point(body, p.chassis, 0, 0)  # R
    v, _ = bd.to_robot(body.pitch, reference.x_rate, reference.z_rate)
    k92 = contact_angle_ratio(hooks.rewritten(Effect.desired_velocity, v_k92, v), p)

    turned = {name: spin(t, piece, name) for name in "fr"} if kind in TURNED else {}
    splits = {name: spin(t, piece, f"split_{name}") for name in "fr"} if kind == "sides" else {}
    for name, wheel in turned.items():
        state |= {f"angle_{name}": wheel.angle, f"rate_{name}": wheel.rate}
    free = [_axle(*_wheel(n, state, body, p, k92, v_d), splits.get(n), p, hooks) for n in "fr"]
    if turned:
        axles = [_turned(a, turned[n].acceleration, p, hooks) for n, a in zip("fr", free, strict=True)]
    else:
        axles = [_driven(a, state[f"current_{n}"], p, hooks) for n, a in zip("fr", free, strict=True)]

    load = bd.ground_load(
        body, p.chassis, [(a.position, a.forces.longitudinal, a.forces.normal) for a in axles]
    )
    if kind != "trapezoid":
        force, height = pulled(t, piece)
        load = bd.towed(load, p.chassis, force * smoothstep(v / V_FLOOR), height)  # the rope is slack at rest
    load = hooks.rewritten(Effect.body_load, load, body, (axles[0], axles[1]), p)
    acceleration = bd.accelerations(p.chassis, load)

    drives = _unasked(axles, p, hooks) if kind in TURNED else _drives(axles, s_d, v_d, p, hooks)
    front, rear = (drive.axle for drive in drives)
    rates = _body_rates(body, acceleration)
    outputs = _shown(reference, v, body) | {"v_desired_mps": v_d, "s_desired_m": s_d, "k92": k92}
    for drive in drives:
        rates |= _axle_rates(drive, p, hooks)
        outputs |= _axle_outputs(drive, p.wheels.radius)
    for e, sym in hooks:
        rates |= {f"{e.id}.{name}": value for name, value in e.rates((front, rear), p, sym).items()}
    f_x, f_z = bd.specific_force(body, acceleration, load, p.chassis, p.imu.x, p.imu.z)
    imu = {"imu_ax_mps2": f_x, "imu_az_mps2": f_z, "imu_gy_radps": body.pitch_rate}
    sensors, delays = _sensors(imu, drives, p, hooks)
    parameters = ca.vertcat(symbols_of(paper), effect_parameters(hooks))
    change_of = ca.vertcat(*map(rates.__getitem__, names))
    return Graph(t, x, parameters, column, change_of, outputs | sensors, names, delays)


def _body_rates(body: bd.BodyState, acceleration: bd.BodyAcceleration) -> dict[str, Any]:
    """Return the derivatives of the body's states."""
    speed = body.x_rate, body.z_rate, body.pitch_rate
    change = acceleration.x, acceleration.z, acceleration.pitch
    return dict(zip(BODY_STATES, (*speed, *change), strict=True))


def _shown(reference: bd.PointMotion, v: Any, body: bd.BodyState) -> dict[str, Any]:
    """Name what a run shows of the body."""
    return {
        "x_m": reference.x,
        "z_m": reference.z,
        "v_mps": v,
        "v_z_mps": reference.z_rate,
        "pitch_rad": body.pitch,
        "pitch_rate_radps": body.pitch_rate,
    }


@dataclass(frozen=True)
class _Drive:
    """One wheel pair as its motors drive it.

    Attributes:
        axle: kinematics and contact, with the voltage that its controller asks for.
        shaft, reading: motion of the motor's shaft, and what the encoder reads of it.
        voltage: that arrives at the motor [V].
    """

    axle: Axle
    shaft: Shaft
    reading: Shaft
    voltage: Any


def _drives(
    axles: Sequence[Axle], s_d: Any, v_d: Any, p: ModelParameters, hooks: Hooks
) -> tuple[_Drive, ...]:
    """Control the motors, (25), (26)."""
    moving = [_shaft_and_reading(axle, hooks) for axle in axles]
    radius = p.wheels.radius
    front, rear = (control_voltage(p.drive, s_d / radius - r.angle, v_d / radius - r.rate) for _, r in moving)
    axles = [replace(axle, voltage=voltage) for axle, voltage in zip(axles, (front, rear), strict=True)]
    currents = axles[0].current, axles[1].current
    voltages = hooks.rewritten(Effect.voltages, (front, rear), currents, p.drive)
    return tuple(map(_Drive, axles, *zip(*moving, strict=True), voltages))


def _unasked(axles: Sequence[Axle], p: ModelParameters, hooks: Hooks) -> tuple[_Drive, ...]:
    """Return the motors of wheels that are turned, with the voltage that (24) needs for a steady current."""
    drives = []
    for axle in axles:
        shaft, reading = _shaft_and_reading(axle, hooks)
        emf = p.drive.emf_constant * p.drive.gear_ratio * shaft.rate
        voltage = emf + p.drive.resistance * axle.current
        drives.append(_Drive(axle, shaft, reading, voltage))
    return tuple(drives)


def _driven(axle: Axle, current: Any, p: ModelParameters, hooks: Hooks) -> Axle:
    """Return a wheel pair whose motors have a current [A], (24)."""
    torque = hooks.rewritten(Effect.drive_torque, drive_torque(p.drive, current), axle.state)
    return replace(axle, current=current, drive_torque=torque)


def _turning(axle: Axle, p: ModelParameters, hooks: Hooks) -> Any:
    """Return the angular acceleration of a rim [rad/s^2], (23)."""
    return hooks.rewritten(Effect.rim_acceleration, axle.rim_acceleration(p.chassis.wheel_inertia), axle, p)


def _turned(axle: Axle, acceleration: Any, p: ModelParameters, hooks: Hooks) -> Axle:
    """Return a wheel pair whose motors have the current that its acceleration takes, (23), (24).

    Effects leave the acceleration a linear function of the current, so that two values tell it.
    """
    at_rest, at_one_ampere = (_turning(_driven(axle, i, p, hooks), p, hooks) for i in (0.0, 1.0))
    return _driven(axle, (acceleration - at_rest) / (at_one_ampere - at_rest), p, hooks)


def _axle_rates(drive: _Drive, p: ModelParameters, hooks: Hooks) -> dict[str, Any]:
    """Return the time derivatives of the states of one wheel pair, (23), (24)."""
    axle = drive.axle
    turning = _turning(axle, p, hooks)
    current = current_rate(p.drive, drive.voltage, drive.shaft.rate, axle.current)
    rates = {"angle": axle.state.rate, "rate": turning, "current": current}
    return {f"{name}_{axle.state.letter}": rate for name, rate in rates.items()}


def _sensors(
    imu: dict[str, Any], drives: Sequence[_Drive], p: ModelParameters, hooks: Hooks
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what the sensors read, and how far their stamps lag [s]."""
    sensors, delays = dict(imu), dict[str, Any]()
    for drive in drives:
        name = drive.axle.state.letter
        sensors |= {f"enc_{name}_rad": drive.reading.angle, f"cur_{name}_A": drive.axle.current}
    sensors = hooks.rewritten(Effect.sensors, sensors, p)
    for e, sym in hooks:
        for prefix, lag in e.delays(sym).items():
            late = [name for name in sensors if name.startswith(f"{prefix}_")]
            delays |= {name: delays.get(name, 0) + lag for name in late}
    return sensors, delays


def hooks_of(effects: Sequence[Effect], state: Mapping[str, Any], t: Any, paper: ModelParameters) -> Hooks:
    """Return each effect with its own symbols; `state` names those of its states ``effect.name``."""
    hooks = []
    for e in effects:
        parameters = {q.name: ca.SX.sym(f"{e.id}.{q.name}") for q in e.parameters}
        hooks.append((e, Symbols(parameters, {n: state[f"{e.id}.{n}"] for n in e.states}, t, paper)))
    return Hooks(hooks)


def effect_parameters(hooks: Hooks) -> Any:
    """Return the symbols of all effects' parameters as one column."""
    return ca.vertcat(*(symbol for _, sym in hooks for symbol in sym.p.values()))


def _shaft_and_reading(axle: Axle, hooks: Hooks) -> tuple[Shaft, Shaft]:
    """Return the motion of a motor's shaft and what the encoder reads of it; the paper's are the rim's."""
    shaft = hooks.rewritten(Effect.shaft, Shaft(axle.state.angle, axle.state.rate), axle)
    return shaft, hooks.rewritten(Effect.reading, shaft, axle)


@dataclass(frozen=True)
class OnGround:
    """How one wheel stands on the soil, effects included; all fields are expressions.

    Attributes:
        state, soil, angles, forces: as the effects leave them.
        stresses: gives σ and τ [Pa] at an angle [rad].
    """

    state: WheelState
    soil: Soil
    angles: ContactAngles
    forces: WheelForces
    stresses: Callable[[Any], tuple[Any, Any]]


def on_ground(wheel: WheelState, soil: Soil, k92: Any, damping: Any, hooks: Hooks) -> OnGround:
    """Put a wheel on soil, (4), (6)-(17), with the hooks of effects in the order in which they apply."""
    wheel = hooks.rewritten(Effect.wheel, wheel)
    soil = hooks.rewritten(Effect.soil, soil, wheel)
    angles = hooks.rewritten(Effect.contact_angles, contact_angles(wheel, k92), wheel)
    laws = ArcLaws(
        bearing=lambda ϑ: hooks.rewritten(Effect.bearing, ϑ, angles, wheel),
        corner=hooks.rewritten(Effect.corner, ArcLaws.corner, angles, wheel),
        pressure=lambda σ, ϑ: hooks.rewritten(Effect.pressure, σ, ϑ, wheel),
        shear=lambda share, j: hooks.rewritten(Effect.shear, share, j),
    )
    forces = wheel_forces(wheel, angles, soil, damping, laws)
    forces = hooks.rewritten(Effect.wheel_forces, forces, wheel, angles, soil)
    return OnGround(wheel, soil, angles, forces, arc_stresses(wheel, angles, soil, laws))


def _wheel(
    name: str, state: dict[str, Any], body: bd.BodyState, p: ModelParameters, k92: Any, v_d: Any
) -> tuple[Any, WheelState]:
    """Return the place of an axle in R [m], and how its wheels move, (1), (18)."""
    front = name == "f"
    position = p.chassis.wheel_base / 2 * (1 if front else -1)
    centre = bd.point(body, p.chassis, position, 0)
    velocity, _ = bd.to_robot(body.pitch, centre.x_rate, centre.z_rate)
    rate = state[f"rate_{name}"]
    wheel = WheelState(
        front=front,
        travel=centre.x - position,
        angle=state[f"angle_{name}"],
        rate=rate,
        tread_rate=rate,
        velocity=velocity,
        sinkage=p.wheels.radius - centre.z,
        sinkage_rate=-centre.z_rate,
        radius=p.wheels.radius,
        width=p.wheels.width,
        v_desired=v_d,
        k92=k92,
    )
    return position, wheel


def _axle(
    position: Any,
    wheel: WheelState,
    split: Turning | None,
    p: ModelParameters,
    hooks: Hooks,
) -> Axle:
    """Contact of one wheel pair, (4)-(17), its motors without current.

    Args:
        position: of the axle in R [m].
        wheel: mean of both wheels.
        split: half of what the right one turns more than the left one, None where they turn alike.
        p, hooks: of the graph.
    """
    if split is not None:  # the body goes straight: the sides have one velocity
        left, right = (_axle(position, _side(wheel, split, sign), None, p, hooks) for sign in (-1, 1))
        return _mean(left, right)
    ground = on_ground(wheel, p.soil, wheel.k92, p.chassis.contact_damping, hooks)
    rim_load = hooks.rewritten(Effect.rim_load, ground.forces.moment, ground.state)
    return Axle(position, ground.state, ground.angles, ground.forces, 0.0, 0.0, rim_load)


def _side(wheel: WheelState, split: Turning, sign: int) -> WheelState:
    """Return the right (1) or the left (-1) wheel of a pair."""
    angle, rate = wheel.angle + sign * split.angle, wheel.rate + sign * split.rate
    return replace(wheel, angle=angle, rate=rate, tread_rate=rate)


T = TypeVar("T", Axle, WheelState, ContactAngles, WheelForces)


def _mean(left: T, right: T) -> T:
    """Return the mean of both wheels of a pair, field by field: twice its forces are those of the pair."""
    means = {}
    for entry in fields(left):
        first, second = getattr(left, entry.name), getattr(right, entry.name)
        if is_dataclass(first):
            means[entry.name] = _mean(first, second)
        else:
            means[entry.name] = first if first is second or isinstance(first, bool) else (first + second) / 2
    return replace(left, **means)


def _axle_outputs(drive: _Drive, radius: Any) -> dict[str, Any]:
    """Name what a run shows of one wheel pair; forces are those of one wheel."""
    axle = drive.axle
    s, f, name = axle.state, axle.forces, axle.state.letter
    rim = replace(s, tread_rate=s.rate)  # slip as encoders see it
    return {
        f"theta_{name}_rad": s.angle,
        f"omega_{name}_radps": s.rate,
        f"v_wheel_{name}_mps": s.rate * radius,
        f"slip_{name}": rim.slip,
        f"sinkage_{name}_m": s.sinkage,
        f"angle_front_{name}_rad": axle.angles.front,
        f"angle_rear_{name}_rad": axle.angles.rear,
        f"load_{name}_N": f.vertical,
        f"resistance_{name}_N": f.resistance,
        f"thrust_{name}_N": f.thrust,
        f"force_x_{name}_N": f.longitudinal,
        f"force_z_{name}_N": f.normal,
        f"moment_{name}_Nm": f.moment,
        f"torque_{name}_Nm": axle.drive_torque,
        f"current_{name}_A": axle.current,
        f"voltage_{name}_V": drive.voltage,
    }
