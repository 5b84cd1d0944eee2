"""One wheel that rolls steadily on soil: the contact model (4), (6)-(17) without a robot around it.

The equations are those of `granite_lab.model.graph.on_ground`; here they are solved for the sinkage at
which they bear a load.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import scipy

from granite_lab.columns import Column, Table
from granite_lab.errors import EstimateError, InputError, UsageError
from granite_lab.logs.trial import Array
from granite_lab.model.command import V_FLOOR, contact_angle_ratio
from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Active, Axle, Effect
from granite_lab.model.graph import OnGround, effect_parameters, hooks_of, on_ground
from granite_lab.model.symbols import ModelParameters, paper_symbols, symbols_of, vector_of
from granite_lab.parameters import Chassis, Drive, Soil, Wheels, load_robot, load_variants

NODES = 101
"""Places of the contact arc at which stresses are told."""

TRAVEL = 10.0
"""How far the wheel has come [m]: what builds up behind a start is complete; convention."""

HOOKS = (
    "desired_velocity", "wheel", "soil", "contact_angles", "bearing", "corner", "pressure", "shear",
    "wheel_forces",
)  # fmt: skip
"""Hooks by which an effect acts on a single wheel; the others need a robot, motors or sensors."""


@dataclass(frozen=True)
class Rolling:
    """How the wheel moves.

    Attributes:
        slip: λ of (1), from -1 (locked) to 1 (spinning on the spot).
        velocity: of the wheel's centre [m/s].
        rate: angular velocity [rad/s].
        speed: the larger of the velocity and of that of the circumference [m/s].
        angle: of the wheel [rad], for effects that depend on it.
    """

    slip: float
    velocity: float
    rate: float
    speed: float
    angle: float = 0.0

    @property
    def fades(self) -> bool:
        """Whether the wheel is so slow that the model reduces slip and shear displacement."""
        return self.speed < V_FLOOR


@dataclass(frozen=True)
class Ratio:
    """The law of k_92: constant where `k92` is a number, else (5).

    Attributes:
        k92: ϑ_2 / ϑ_1 [-], or None.
        a_theta: a_θ of (5) [s/m].
    """

    k92: float | None = None
    a_theta: float = 0.0


@dataclass(frozen=True, eq=False)
class WheelPoint:
    """One wheel at one slip.

    Attributes:
        rolling: how it moves.
        k92: ϑ_2 / ϑ_1.
        load: vertical force of the soil [N].
        drawbar_pull: F_Tx, (16) with what effects add [N].
        torque: that turns the wheel, -M_ω of (15) [N m].
        thrust, resistance: F (14) and R (13) [N].
        sinkage: z_0 [m].
        angle_front, angle_rear: ϑ_1, ϑ_2 [rad].
        angle: (N,) places on the arc from -ϑ_2 to ϑ_1 [rad].
        normal_stress, shear_stress: (N,) σ and τ there [Pa].
    """

    rolling: Rolling
    k92: float
    load: float
    drawbar_pull: float
    torque: float
    thrust: float
    resistance: float
    sinkage: float
    angle_front: float
    angle_rear: float
    angle: Array
    normal_stress: Array
    shear_stress: Array

    @property
    def slip(self) -> float:
        """λ of (1)."""
        return self.rolling.slip


WHEEL_POINTS = Table[WheelPoint](
    "wheel",
    "One wheel at each slip",
    Column("slip", lambda p: p.slip, "slip", form="g"),
    Column("drawbar pull", lambda p: p.drawbar_pull, "drawbar_pull", unit="N", form=".2f"),
    Column("torque", lambda p: p.torque, "torque", unit="N m", form=".3f"),
    Column("sinkage", lambda p: p.sinkage, "sinkage", unit="mm", scale=1000, form=".2f"),
    Column("load", lambda p: p.load, "load", unit="N", form=".1f"),
    Column("k_92", lambda p: p.k92, "k92", form=".3f"),
    Column("front", lambda p: p.angle_front, "angle_front", unit="°", scale=180 / math.pi, form=".1f"),
    Column("rear", lambda p: p.angle_rear, "angle_rear", unit="°", scale=180 / math.pi, form=".1f"),
    Column("σ max", lambda p: p.normal_stress.max(), "stress", unit="kPa", scale=1e-3, form=".1f"),
)


def rolling(
    slip: float, radius: float, *, velocity: float | None = None, speed: float = 0.1, angle: float = 0.0
) -> Rolling:
    """Return the motion with a slip ratio λ by (1).

    Args:
        slip: λ, from -1 to 1.
        radius: of the wheel [m].
        velocity: of the wheel's centre [m/s], or None.
        speed: where it is not given, the larger of ω r and the velocity [m/s]. The equations (6)-(16) do not
            depend on it above 0.02 m/s.
        angle: of the wheel [rad].

    Raises:
        UsageError: slip outside its range, a speed that is not positive, or no such motion.
    """
    if not -1 <= slip <= 1:
        raise UsageError(f"slip {slip:g} is out of range", "expected a number from -1 (locked) to 1")
    if velocity is not None:
        if slip == 1:
            raise UsageError("slip 1 does not fit --v", "a wheel that spins on the spot has no velocity")
        speed = velocity / min(1, 1 - slip)
    if not 0 < speed < math.inf:
        raise UsageError("the speed of the wheel must be positive", "use a negative slip for braking")
    return Rolling(slip, speed * min(1, 1 - slip), speed * min(1, 1 + slip) / radius, speed, angle)


def acts(effect: Effect) -> bool:
    """Tell whether an effect can change what a single wheel does."""
    return any(getattr(type(effect), name) is not getattr(Effect, name) for name in HOOKS)


class SingleWheel:
    """A wheel on a soil.

    Args:
        wheels, soil: the wheel and the soil.
        effects: added to the paper's model; those that need a robot are left out.
        chassis: of the robot, for effects that depend on it.

    Raises:
        InputError: an effect needs the chassis and there is none.
    """

    def __init__(
        self, wheels: Wheels, soil: Soil, effects: Sequence[Active] = (), chassis: Chassis | None = None
    ) -> None:
        self.wheels, self.soil = wheels, soil
        self.effects = tuple(e for e in effects if acts(e.effect))
        body, drive = chassis or _nothing(Chassis), _nothing(Drive)
        imu, variant = load_robot().imu, load_variants()[0]
        self._parameters = ModelParameters(wheels, body, drive, imu, soil, variant, 0.0, 0.0, 1.0)
        self._chosen = tuple(e.effect for e in self.effects)
        self._effect_values = [x for e in self.effects for x in e.values]
        self._states = sum(len(e.states) for e in self._chosen)
        forces = _functions(self._chosen)[0]
        self._buffer = np.empty(forces.numel_out(0))
        self._places, self._evaluate = forces.buffer()
        self._places.set_res(0, self._buffer.data)

    def at_load(self, load: float, motion: Rolling, ratio: Ratio) -> WheelPoint:
        """Return the wheel at the smallest sinkage that bears a load [N].

        Raises:
            EstimateError: the wheel sinks to its axle.
        """
        vector = self._vector(motion, ratio)
        self.at_sinkage(self.wheels.radius / 10, motion, ratio)  # tells what is missing
        depths = np.geomspace(1e-5, 0.999, 40) * self.wheels.radius
        low, start = 0.0, np.zeros(self._states)
        for high in depths:
            start = self._settled(high, vector, start)
            if self._forces(high, start, vector)[0] >= load:
                break
            low = high
        else:
            raise EstimateError(
                f"the wheel sinks to its axle under {load:g} N at slip {motion.slip:g}",
                "choose a smaller load, a larger wheel or firmer soil",
            )

        def missing(z: float) -> float:
            return float(self._forces(z, self._settled(z, vector, start), vector)[0]) - load

        z = high if low == 0 else float(scipy.optimize.brentq(missing, low, high, xtol=1e-12, rtol=1e-12))
        return self.at_sinkage(z, motion, ratio)

    def at_sinkage(self, sinkage: float, motion: Rolling, ratio: Ratio) -> WheelPoint:
        """Return the wheel at a sinkage z_0 [m].

        Raises:
            UsageError: the sinkage is not between zero and the radius.
            EstimateError: an effect's states find no equilibrium.
        """
        if not 0 < sinkage < self.wheels.radius:
            raise UsageError(
                f"sinkage {1000 * sinkage:g} mm is out of range",
                f"expected a number above 0 and below the radius, {1000 * self.wheels.radius:g} mm",
            )
        vector = self._vector(motion, ratio)
        states = self._settled(sinkage, vector, np.zeros(self._states))
        values = self._sound(self._forces(sinkage, states, vector))
        load, pull, torque, thrust, resistance, front, rear = values.tolist()
        arc = _functions(self._chosen)[1](sinkage, states, vector).full()
        return WheelPoint(
            motion, rear / front, load, pull, torque, thrust, resistance, sinkage, front, rear, *arc.T
        )  # fmt: skip

    def _vector(self, motion: Rolling, ratio: Ratio) -> Array:
        """Return all numbers but the sinkage and the states, in the order of `_functions`."""
        p = dataclasses.replace(
            self._parameters,
            k92_constant=0.0 if ratio.k92 is None else float(ratio.k92),
            a_theta=float(ratio.a_theta),
            k92_is_constant=0.0 if ratio.k92 is None else 1.0,
        )
        return np.array([motion.velocity, motion.rate, motion.angle, *vector_of(p), *self._effect_values])

    def _forces(self, sinkage: float, states: Array, vector: Array) -> Array:
        """Return forces and angles, see `_functions`; the array is overwritten by the next call."""
        given = (np.array([sinkage]), states, vector)
        for k, numbers in enumerate(given):
            self._places.set_arg(k, numbers.data)
        self._evaluate()
        return self._buffer

    def _sound(self, values: Array) -> Array:
        """Return numbers that are finite.

        Raises:
            InputError: they are not, for want of a chassis.
        """
        if not np.isfinite(values).all():
            names = ", ".join(e.id for e in self.effects)
            raise InputError(
                f"the wheel forces cannot be computed with the effects {names}",
                "give a robot whose file has [chassis]",
            )
        return values

    def _settled(self, sinkage: float, vector: Array, start: Array) -> Array:
        """Return the effects' own states at rest."""
        if not self._states:
            return start
        rates = _functions(self._chosen)[2]

        self._sound(rates(sinkage, start, vector).full())

        def unbalanced(x: Array) -> Array:
            changes: Array = rates(sinkage, x, vector).full()[:, 0]
            return changes

        equilibrium = scipy.optimize.root(unbalanced, start)
        if not equilibrium.success:
            raise EstimateError("the effects have no steady state on a single wheel", "use fewer effects")
        settled: Array = equilibrium.x
        return settled


def _nothing(kind: type[Any]) -> Any:
    """Return a record of numbers that are none: whatever needs them gives no number."""
    return kind(**{f.name: math.nan for f in dataclasses.fields(kind)})


@lru_cache(maxsize=64)
def _functions(effects: tuple[Effect, ...]) -> tuple[Any, Any, Any]:
    """Return functions of sinkage, states and `SingleWheel._vector`: forces, the arc, the states' rates.

    The first one gives load, drawbar pull [N], torque [N m], thrust, resistance [N], ϑ_1 and ϑ_2 [rad].
    A front wheel is shown; the rear one only completes the pair for effects with states.
    """
    z, v, rate, angle = (ca.SX.sym(name) for name in ("z", "v", "rate", "angle"))
    paper = paper_symbols()
    states = {name: ca.SX.sym(name) for e in effects for name in (f"{e.id}.{n}" for n in e.states)}
    hooks = hooks_of(effects, states, ca.SX(0.0), paper)
    model = hooks.rewritten(Effect.system, paper)
    speed = ca.fmax(ca.fabs(v), ca.fabs(rate * model.wheels.radius))
    k92 = contact_angle_ratio(hooks.rewritten(Effect.desired_velocity, speed, v), model)

    def wheel(front: bool) -> OnGround:
        state = WheelState(
            front=front, travel=ca.SX(TRAVEL), angle=angle, rate=rate, tread_rate=rate, velocity=v, sinkage=z,
            sinkage_rate=0.0, radius=model.wheels.radius, width=model.wheels.width, v_desired=speed, k92=k92,
        )  # fmt: skip
        return on_ground(state, model.soil, k92, 0.0, hooks)

    front, rear = wheel(True), wheel(False)
    forces, angles = front.forces, front.angles
    shown = ca.vertcat(
        forces.normal, forces.longitudinal, -forces.moment, forces.thrust, forces.resistance,
        angles.front, angles.rear,
    )  # fmt: skip
    ϑ = -angles.rear + (angles.front + angles.rear) * ca.DM(np.linspace(0, 1, NODES))
    σ, τ = front.stresses(ϑ)
    axles = tuple(
        Axle(0.0, g.state, g.angles, g.forces, ca.SX(0.0), -g.forces.moment, g.forces.moment)
        for g in (front, rear)
    )
    rates = [e.rates((axles[0], axles[1]), model, sym) for e, sym in hooks]
    changes = [
        rates_of_states[name] for e, rates_of_states in zip(effects, rates, strict=True) for name in e.states
    ]
    numbers = ca.vertcat(v, rate, angle, symbols_of(paper), effect_parameters(hooks))
    given: list[Any] = [z, ca.vertcat(*states.values()), numbers]
    return (
        ca.Function("forces", given, [ca.cse(ca.densify(shown))]),
        ca.Function("arc", given, [ca.cse(ca.densify(ca.horzcat(ϑ, σ, τ)))]),
        ca.Function("rates", given, [ca.cse(ca.densify(ca.vertcat(*changes)))]),
    )
