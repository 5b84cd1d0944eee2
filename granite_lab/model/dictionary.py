"""What describes a missing cause that no effect of the library is: corrections a · φ of physical quantities.

Each term is an effect with one number a and a closed formula. φ is made of dimensionless groups.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations_with_replacement
from typing import Any, ClassVar, NamedTuple

import casadi as ca

from granite_lab.model.body import BodyLoad, BodyState, to_ground
from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.model.contact import ContactAngles, WheelState, stiffer, stronger
from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import GRAVITY, Soil

PREFIX = "term"
"""The ids of all terms begin with it and a dot."""

SIZES = (0.3, 0.1)
"""Expected sizes of a correction: of a factor, as formulas of terramechanics are off by 10 to 30 % (Wong
2008); of a force over the weight, a third of the resistance of 10 to 30 % of the weight on loose sand."""

FURTHEST = 10
"""Bound of a correction over its expected size."""


@dataclass(frozen=True)
class Motion:
    """What the groups are made of, expressions or arrays.

    Attributes:
        slip: λ [-].
        sinkage: z_0 [m].
        velocity: v [m/s].
        travel: x [m].
        place: of the wheel on the ground, from the middle of the robot at its start [m].
        angle: θ [rad].
        torque: T of the motor on one wheel [N m]; None where a formula cannot know it.
    """

    slip: Any
    sinkage: Any
    velocity: Any
    travel: Any
    place: Any
    angle: Any
    torque: Any = None


class Group(NamedTuple):
    """A dimensionless group: its formula, its typical size in motion, and in words."""

    formula: str
    size: float
    words: str
    of: Callable[[Motion, ModelParameters], Any]


GROUPS = {
    "slip": Group("λ", 0.2, "slip", lambda m, _: m.slip),
    "slip_size": Group("|λ|", 0.2, "slip without sign", lambda m, _: ca.fabs(m.slip)),
    "sinkage": Group("z/r", 0.1, "sinkage", lambda m, p: m.sinkage / p.wheels.radius),
    "speed": Group(
        "v/√(g r)", 0.5, "speed", lambda m, p: m.velocity / ca.sqrt(GRAVITY * p.wheels.radius)
    ),
    "torque": Group(
        "T/(W r)", 0.2, "driving torque",
        lambda m, p: m.torque / (p.chassis.total_mass * GRAVITY / 4 * p.wheels.radius),
    ),
    "distance": Group("x/L", 3.0, "distance", lambda m, p: m.travel / p.chassis.wheel_base),
    "sin_angle": Group("sin θ", 1.0, "sine of the wheel's angle", lambda m, _: ca.sin(m.angle)),
    "cos_angle": Group("cos θ", 1.0, "cosine of the wheel's angle", lambda m, _: ca.cos(m.angle)),
}  # fmt: skip
"""L is the wheel base, W the load of a wheel."""


def _at(number: int) -> Group:
    """Return a bump about one place of the ground; those of neighbouring places add up to a smooth course."""
    return Group(
        f"exp(−(4 x_w/L − {number})²/2)", 1.0, f"{number / 4:g} wheel bases from the start",
        lambda m, p: ca.exp(-((4 * m.place / p.chassis.wheel_base - number) ** 2) / 2),
    )  # fmt: skip


PLACES = {f"at_{number}": _at(number) for number in range(48)}
"""Places of the ground, a quarter of the wheel base apart, up to 12 wheel bases (convention); x_w is where
the wheel stands."""

_EVERY = GROUPS | PLACES


class Quantity(NamedTuple):
    """What is corrected.

    Attributes:
        formula: with {} in place of a · φ.
        words: what it is.
        factor: it is multiplied by exp(a φ); a force is added otherwise.
    """

    formula: str
    words: str
    factor: bool


QUANTITIES = {
    "modulus": Quantity("k · exp({})", "soil's modulus k", True),
    "exponent": Quantity("n · exp({})", "sinkage exponent n", True),
    "shear_modulus": Quantity("K · exp({})", "shear modulus K", True),
    "strength": Quantity("τ_max · exp({})", "shear strength", True),
    "ratio": Quantity("k_92 · exp({})", "contact angle ratio k_92", True),
    "drive": Quantity("T · exp({})", "torque of the motors at the rims", True),
    "force": Quantity("F_x + 4 W · {}", "force along the robot", False),
    "lift": Quantity("F_z + 4 W · {}", "lift", False),
    "moment": Quantity("M_y + 4 W r · {}", "moment on the body, nose down", False),
    "torque_f": Quantity("M_front − W r · {}", "torque against each front wheel", False),
    "torque_r": Quantity("M_rear − W r · {}", "torque against each rear wheel", False),
}
"""Those of the soil cannot depend on T, which follows from them where wheels are turned."""

LOCAL = ("modulus", "strength", "force", "lift", "moment")
"""Quantities that may differ at one place of the ground."""


class Term(Effect):
    """One correction; `term` makes the class of each.

    Class attributes:
        quantity: key of `QUANTITIES`.
        groups: keys of `GROUPS` or `PLACES` whose product is φ; none: φ = 1.
    """

    quantity: ClassVar[str]
    groups: ClassVar[tuple[str, ...]]

    def __reduce__(self) -> tuple[Callable[[str], Effect], tuple[str]]:
        """Give back the one object of its id: graphs are kept by it."""
        return term, (self.id,)

    def soil(self, soil: Soil, state: WheelState, sym: Symbols) -> Soil:
        """Correct k, n, K or τ_max."""
        if self.quantity not in ("modulus", "exponent", "shear_modulus", "strength"):
            return soil
        factor = self._factor(state, sym)
        if self.quantity == "modulus":
            return stiffer(soil, factor)
        if self.quantity == "strength":
            return stronger(soil, factor)
        changes: dict[str, Any] = {self.quantity: getattr(soil, self.quantity) * factor}
        return replace(soil, **changes)

    def contact_angles(self, angles: ContactAngles, state: WheelState, sym: Symbols) -> ContactAngles:
        """Correct k_92."""
        if self.quantity != "ratio":
            return angles
        return replace(angles, rear=angles.rear * self._factor(state, sym))

    def drive_torque(self, torque: Any, state: WheelState, sym: Symbols) -> Any:
        """Correct what arrives of the motors' torque."""
        return torque * self._factor(state, sym) if self.quantity == "drive" else torque

    def rim_acceleration(self, acceleration: Any, axle: Axle, p: ModelParameters, sym: Symbols) -> Any:
        """Add a torque against a wheel."""
        if self.quantity != f"torque_{axle.state.letter}":
            return acceleration
        arm = p.chassis.total_mass * GRAVITY / 4 * p.wheels.radius
        return acceleration - arm * sym.p["a"] * self._phi(axle, p) / p.chassis.wheel_inertia

    def body_load(
        self, load: BodyLoad, body: BodyState, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols
    ) -> BodyLoad:
        """Add a force or a moment; φ is the mean of both axles."""
        if self.quantity not in ("force", "lift", "moment"):
            return load
        weight = p.chassis.total_mass * GRAVITY
        size = weight * sym.p["a"] * (self._phi(axles[0], p) + self._phi(axles[1], p)) / 2
        if self.quantity == "moment":
            return replace(load, moment=load.moment + p.wheels.radius * size)
        x, z = to_ground(body.pitch, size, 0) if self.quantity == "force" else to_ground(body.pitch, 0, size)
        return replace(load, x=load.x + x, z=load.z + z)

    def _factor(self, state: WheelState, sym: Symbols) -> Any:
        return ca.exp(sym.p["a"] * _moving(state) * phi(self.groups, _motion(state, sym.model), sym.model))

    def _phi(self, axle: Axle, p: ModelParameters) -> Any:
        return _moving(axle.state) * phi(self.groups, _motion(axle.state, p, axle.drive_torque), p)


def _motion(s: WheelState, p: ModelParameters, torque: Any = None) -> Motion:
    place = place_of(s.travel, s.front, p)
    return Motion(s.slip, s.sinkage, s.velocity, s.travel, place, s.angle, torque)


def place_of(travel: Any, front: bool, p: ModelParameters) -> Any:
    """Return where a wheel stands on the ground, see `Motion.place` [m]."""
    return travel + p.chassis.wheel_base / 2 * (1 if front else -1)


def _moving(state: WheelState) -> Any:
    """Fade a term out at standstill, where the model's laws are not defined."""
    return smoothstep(ca.fabs(state.circumferential_velocity) / (2 * V_FLOOR))


def phi(groups: tuple[str, ...], motion: Motion, p: ModelParameters) -> Any:
    """Return the product of some groups, expressions or arrays as the motion has them."""
    value: Any = 1.0
    for name in groups:
        value = value * _EVERY[name].of(motion, p)
    return value


def products() -> list[tuple[str, ...]]:
    """Return the groups of each φ of any quantity: none, one, and the products of two."""
    names = list(GROUPS)
    same = (("slip_size", "slip_size"), ("sin_angle", "sin_angle"))  # λ² is |λ|², sin² is 1 − cos²
    dropped = {*same, ("torque", "torque")}  # the current must enter in no higher power
    pairs = [pair for pair in combinations_with_replacement(names, 2) if pair not in dropped]
    return [(), *((n,) for n in names), *pairs]


@cache
def dictionary() -> dict[str, Effect]:
    """Return every term by its id."""
    terms: dict[str, Effect] = {}
    for quantity, of in QUANTITIES.items():
        local = [(name,) for name in PLACES] if quantity in LOCAL else []
        for groups in [*products(), *local]:
            if of.factor and "torque" in groups:
                continue
            made = _term(quantity, groups)
            terms[made.id] = made
    return terms


def term(id_: str) -> Effect:
    """Return one term."""
    return dictionary()[id_]


def is_term(id_: str) -> bool:
    """Tell a term of the dictionary from an effect."""
    return id_.startswith(f"{PREFIX}_")


def _term(quantity: str, groups: tuple[str, ...]) -> Term:
    of, factors = QUANTITIES[quantity], [_EVERY[name] for name in groups]
    size = SIZES[0 if of.factor else 1]
    for group in factors:
        size /= group.size
    formula = " · ".join(["a", *(group.formula for group in factors)])
    words, id_ = " times ".join(group.words for group in factors), "_and_".join(groups)
    if groups and groups[0] in PLACES:
        words = f"at {words}"
    elif groups:
        words, id_ = f"by {words}", f"by_{id_}"
    fields = {
        "__module__": __name__,
        "id": "_".join(filter(None, [PREFIX, quantity, id_])),
        "title": f"{of.words}, {words or 'constant while moving'}",
        "equation": of.formula.format(formula),
        "source": "fitted to the trials; sparse regression as in Brunton, Proctor, Kutz, PNAS 113, 2016",
        "name": f"{of.words}, {words or 'constant'}",
        "signature": "no cause: it describes what the candidates do not explain",
        "quantity": quantity,
        "groups": groups,
        "parameters": (
            EffectParameter(
                "a", "", "coefficient", -FURTHEST * size, FURTHEST * size, 0.0, -size, size, linear=True
            ),
        ),
    }
    made: Term = type(f"Term_{quantity}_{'_'.join(groups)}", (Term,), fields)()
    return made
