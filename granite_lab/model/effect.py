"""What an effect is: a physical influence that the paper's model leaves out, as hooks into the graph.

An effect declares its parameters and rewrites one or more quantities of the expression graph.
With every parameter at its neutral value each hook returns what it was given, so that the model is
the paper's. A hook gets the quantity, what it may depend on, and the effect's own symbols.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, TypeVarTuple

from granite_lab.columns import Column, Table, words
from granite_lab.errors import InputError
from granite_lab.model.body import BodyLoad, BodyState
from granite_lab.model.contact import ContactAngles, WheelForces, WheelState
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import Drive, Soil
from granite_lab.rounding import tidy_unit

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")
Given = TypeVarTuple("Given")
"""A quantity that hooks rewrite, and what they may depend on."""


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes:
        name, unit, meaning: for people and files.
        low, high: physical bounds.
        neutral: the value at which the effect vanishes.
        prior_low, prior_high: the range that the literature leads to expect.
        shape: True where the parameter says how, not how much: once every other parameter is
            neutral the model does not depend on it, and `neutral` is only where a search starts.
        kinds: of a shape that divides an effect into kinds: the values at which a search looks; empty where
            that is the neutral one.
        per_trial: True where the value changes from trial to trial, as a phase of the wheels does.
        moving: True where the trace of another size comes at another time, so that sizes are probed closely.
        linear: True where its trace is proportional to it over the prior's range, so that one size is probed.
        relative: True for a relative error, which a reader gets in percent.
        signs: the effect in words where the value is above and below zero; empty where a sign tells nothing.
    """

    name: str
    unit: str
    meaning: str
    low: float
    high: float
    neutral: float
    prior_low: float
    prior_high: float
    shape: bool = False
    kinds: tuple[float, ...] = ()
    per_trial: bool = False
    moving: bool = False
    linear: bool = False
    relative: bool = False
    signs: tuple[str, str] = ("", "")


def turning_parameters(
    unit: str, what: str, bound: float, expected: float, end: str = ""
) -> tuple[EffectParameter, ...]:
    """Return the parameters of what turns with the wheels: a cosine and a sine part of each wheel pair.

    They replace amplitude and phase, which keeps the model linear near zero. The initial angles of front and
    rear wheels are unknown, hence the numbers for each trial.

    Args:
        unit, what: of either part.
        bound, expected: of its magnitude.
        end: of the names, as in ``cos_front`` + end.
    """
    return tuple(
        EffectParameter(f"{part}_{axle}{end}", unit, f"{word} part of the {what}, {axle} wheels",
                        -bound, bound, 0.0, -expected, expected, per_trial=True)
        for axle in ("front", "rear") for part, word in (("cos", "cosine"), ("sin", "sine"))
    )  # fmt: skip


EFFECT_PARAMETERS = Table[EffectParameter](
    "effect",
    "Parameters of an effect",
    Column("parameter", lambda p: p.name),
    Column("unit", lambda p: words(tidy_unit(p.unit))),
    Column("neutral", lambda p: p.neutral, "neutral", form="g"),
    Column("allowed", lambda p: f"{p.low:g} … {p.high:g}"),
    Column("expected", lambda p: f"{p.prior_low:g} … {p.prior_high:g}"),
    Column("meaning", lambda p: p.meaning),
)


@dataclass(frozen=True)
class Symbols:
    """An effect's own symbols inside the graph.

    Attributes:
        p: parameter name to value.
        x: name of an extra state to its value.
        t: time since the start of the command [s].
        model: the parameters of the model without effects.
    """

    p: Mapping[str, Any]
    x: Mapping[str, Any]
    t: Any
    model: ModelParameters


@dataclass(frozen=True)
class Shaft:
    """Motion of a motor's shaft divided by the gear ratio: angle [rad] and rate [rad/s]."""

    angle: Any
    rate: Any


@dataclass(frozen=True)
class Axle:
    """All that is known of one wheel pair once its forces are.

    Attributes:
        position: of the axle in R [m].
        state, angles, forces: of one wheel of the pair.
        current: of one motor [A].
        drive_torque: T of one wheel [N m].
        rim_load: torque of tyre and ground on one rim [N m].
        voltage: that the controller asks of one motor [V]; only `Effect.rates` knows it.
    """

    position: Any
    state: WheelState
    angles: ContactAngles
    forces: WheelForces
    current: Any
    drive_torque: Any
    rim_load: Any
    voltage: Any = 0.0

    def rim_acceleration(self, inertia: Any) -> Any:
        """Return the angular acceleration of a rim of some inertia [rad/s^2], (23)."""
        return (self.drive_torque + self.rim_load) / inertia


class Effect:
    """A missing effect; a subclass overrides the hooks it needs and leaves the others alone.

    Class attributes:
        id: name in files and on the command line.
        title: a few words.
        name: as a sentence calls it, where the id with spaces does not read as words.
        fault: True for an error of the measurement, which no model lacks.
        law: True for another law of the soil in place of the paper's.
        follows: True where it acts on what all others give, as a lag does.
        by_lugs: True where the number of lugs of the tread is in its formula.
        by_command: True where k_92 goes by the history of the command.
        of_encoders: True for an error of the wheel angles that no hook shows.
        equation: the formula, as text.
        source: where the formula comes from.
        signature: what an observer sees, in words.
        parameters: the effect's parameters.
        states: names of extra states; they start where they rest while the robot stands still.
        circles: pairs of parameters per trial that are cosine and sine of a size that all trials share.
    """

    id: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]
    source: ClassVar[str]
    signature: ClassVar[str]
    parameters: ClassVar[tuple[EffectParameter, ...]]
    name: ClassVar[str] = ""
    fault: ClassVar[bool] = False
    law: ClassVar[bool] = False
    follows: ClassVar[bool] = False
    by_lugs: ClassVar[bool] = False
    by_command: ClassVar[bool] = False
    of_encoders: ClassVar[bool] = False
    states: ClassVar[tuple[str, ...]] = ()
    circles: ClassVar[tuple[tuple[str, str], ...]] = ()

    def __repr__(self) -> str:
        return f"{self.id}: {self.title}"

    def to_frame(self) -> pd.DataFrame:
        """Return its parameters, one row each; `neutral` is the value at which the effect vanishes."""
        import pandas as pd  # noqa: PLC0415, heavy

        names = ("unit", "meaning", "low", "high", "neutral")
        rows = [
            {"effect": self.id, "title": self.title, "parameter": p.name}
            | {name: getattr(p, name) for name in names}
            for p in self.parameters
        ]
        return pd.DataFrame(rows)

    @property
    def moves(self) -> bool:
        """Whether it can change the motion; one that only rewrites what sensors show cannot."""
        of_sensors = {"sensors", "delays", "as_logged"}
        hooks = {name for name, hook in vars(Effect).items() if callable(hook)} - of_sensors
        return bool(self.states) or any(getattr(type(self), h) is not getattr(Effect, h) for h in hooks)

    def system(self, p: ModelParameters, sym: Symbols) -> ModelParameters:
        """Rewrite the parameters of the whole model."""
        return p

    def desired_velocity(self, v_desired: Any, v: Any, sym: Symbols) -> Any:
        """Rewrite the desired velocity [m/s] that k_92 follows; `v` is the actual one."""
        return v_desired

    def wheel(self, state: WheelState, sym: Symbols) -> WheelState:
        """Rewrite the motion of a wheel as the soil meets it."""
        return state

    def soil(self, soil: Soil, state: WheelState, sym: Symbols) -> Soil:
        """Rewrite the soil under a wheel."""
        return soil

    def contact_angles(self, angles: ContactAngles, state: WheelState, sym: Symbols) -> ContactAngles:
        """Rewrite the ends of the contact arc."""
        return angles

    def bearing(self, angle: Any, angles: ContactAngles, state: WheelState, sym: Symbols) -> Any:
        """Rewrite the angle [rad] whose depth sets the pressure at one place of the contact arc."""
        return angle

    def corner(self, angle: Any, angles: ContactAngles, state: WheelState, sym: Symbols) -> Any:
        """Rewrite the angle [rad] at which the pressure along the contact arc has a corner."""
        return angle

    def pressure(self, pressure: Any, angle: Any, state: WheelState, sym: Symbols) -> Any:
        """Rewrite the pressure [Pa] at one place of the contact arc, `angle` ϑ [rad] ahead of the lowest."""
        return pressure

    def shear(self, share: Any, displacement: Any, sym: Symbols) -> Any:
        """Rewrite the share of the shear strength that a shear displacement [m] mobilises, (11)."""
        return share

    def wheel_forces(
        self, forces: WheelForces, state: WheelState, angles: ContactAngles, soil: Soil, sym: Symbols
    ) -> WheelForces:
        """Rewrite the forces and the moment of the ground on a wheel."""
        return forces

    def shaft(self, shaft: Shaft, axle: Axle, sym: Symbols) -> Shaft:
        """Rewrite the motion of a motor's shaft; back-EMF and encoder follow it."""
        return shaft

    def reading(self, shaft: Shaft, axle: Axle, sym: Symbols) -> Shaft:
        """Rewrite what the encoder makes of the motion of a motor's shaft; controller and log follow it."""
        return shaft

    def voltages(
        self, voltages: tuple[Any, Any], currents: tuple[Any, Any], drive: Drive, sym: Symbols
    ) -> tuple[Any, Any]:
        """Rewrite the voltages of a front and a rear motor [V], given their currents [A]."""
        return voltages

    def drive_torque(self, torque: Any, state: WheelState, sym: Symbols) -> Any:
        """Rewrite the driving torque at a rim [N m]."""
        return torque

    def rim_load(self, load: Any, state: WheelState, sym: Symbols) -> Any:
        """Rewrite the torque of tyre and ground on a rim [N m], M_ω in the paper's model."""
        return load

    def rim_acceleration(self, acceleration: Any, axle: Axle, p: ModelParameters, sym: Symbols) -> Any:
        """Rewrite the angular acceleration of a rim [rad/s^2], (23)."""
        return acceleration

    def body_load(
        self, load: BodyLoad, body: BodyState, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols
    ) -> BodyLoad:
        """Rewrite the forces and the moment on the body."""
        return load

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Return the time derivative of each extra state."""
        return {}

    def sensors(self, signals: dict[str, Any], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Rewrite what the sensors read: the signals named ``imu_…``, ``enc_…`` and ``cur_…``."""
        return signals

    def as_logged(self, value: float, scaled: float) -> float:
        """Return a number of it relative to the log, whose specific force was divided by `scaled`."""
        return value

    def delays(self, sym: Symbols) -> dict[str, Any]:
        """Return by how much the stamps of sensors lag [s], by the first part of their signals' names.

        A delay is not a function of the state at one instant, so it is applied to the finished
        run: the signal ``enc_f_rad`` at t becomes what it was at t minus the delay of ``enc``.
        """
        return {}


class Hooks(tuple[tuple[Effect, Symbols], ...]):
    """The effects of a graph with their symbols; contact laws act first, what follows others last."""

    __slots__ = ()

    def rewritten(self, hook: Callable[[Effect, T, *Given, Symbols], T], quantity: T, *given: *Given) -> T:
        """Return a quantity as the effects leave it.

        Args:
            hook: of `Effect`, as ``Effect.soil``; those of the effects are called.
            quantity: as the paper's model has it.
            given: what the hook may depend on.
        """
        for effect, symbols in sorted(self, key=lambda pair: (not pair[0].law, pair[0].follows)):
            quantity = getattr(effect, hook.__name__)(quantity, *given, symbols)
        return quantity


def _with_units(effect: Effect) -> str:
    units = {p.name: "" if p.unit in ("", "-") else f" [{tidy_unit(p.unit)}]" for p in effect.parameters}
    return ", ".join(f"{name}{unit}" for name, unit in units.items())


EFFECTS = Table[Effect](
    "effects",
    "Effects",
    Column("effect", lambda e: e.id),
    Column("what it is", lambda e: e.title),
    Column("parameters", lambda e: words(_with_units(e))),
)


@dataclass(frozen=True)
class Active:
    """An effect that is switched on, with its parameter values."""

    effect: Effect
    values: tuple[float, ...]

    @property
    def id(self) -> str:
        """The effect's name."""
        return self.effect.id

    def as_dict(self) -> dict[str, float]:
        """Return parameter name to value."""
        return {p.name: v for p, v in zip(self.effect.parameters, self.values, strict=True)}


def activate(effect: Effect, values: Mapping[str, float]) -> Active:
    """Switch an effect on.

    Args:
        effect: the effect.
        values: parameter values; what is not given stays neutral.

    Raises:
        InputError: unknown parameter or a value outside its bounds.
    """
    place = f"effect '{effect.id}'"
    parameters = {p.name: p for p in effect.parameters}
    for name, value in values.items():
        if name not in parameters:
            raise InputError(f"{place}: unknown parameter '{name}'", f"known: {', '.join(parameters)}")
        p = parameters[name]
        if not math.isfinite(value) or not p.low <= value <= p.high:
            raise InputError(
                f"{place}: {name} = {value:g} is out of range",
                f"expected a number from {p.low:g} to {p.high:g} {p.unit}".rstrip(),
            )
    return Active(effect, tuple(float(values.get(p.name, p.neutral)) for p in effect.parameters))
