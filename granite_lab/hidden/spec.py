"""What is to be hidden: the effect, by name or drawn, its sizes, and the sand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from granite_lab.errors import UsageError
from granite_lab.hidden.catalogue import LAWS, LIBRARY, OUTSIDE, TWINS, influence
from granite_lab.hidden.influence import Size
from granite_lab.hidden.random_numbers import factors, generator, magnitude, scaled
from granite_lab.parameters import Soil, Variant

COMMANDS = ("trapezoid", "joystick", "recorded")
"""Trapezoids of Table 2; a person's stick, another one in each trial; sticks, the same in all repetitions."""

CONTROLS = ("paper", "unknown")
"""Who turns the wheels: (25), (26) by the robot's file, or a drawn controller that no file states."""

CAUSES = 2, 5
"""Fewest and most causes of a mixture."""

FOREIGN = 0.25
"""Share of the mixtures in which one cause is outside the library; an assumption."""

SAND_OFF = ("friction_angle", "shear_modulus", "exponent", "tyre_friction")
"""φ, K, n and μ_s, which a set may have off the soil's file."""


@dataclass(frozen=True)
class Spec:
    """Specification of a hidden set: what is hidden, and how its trials are made.

    Attributes:
        effect: an id, or ids joined by ``+``; or random: one of the library; outside: one that it lacks;
            pair: two of it; mixture: several; none.
        seed: of everything random.
        strength: factor on the drawn sizes.
        noise: factor on noise, vibration and jitter of the sensors.
        sand_off: φ, K, n and μ_s are 5-20 % off the soil's file.
        sizes: parameters that are not drawn, by ``name`` or ``id.name``.
        repetitions: of each variant; None: those of the laboratory, else 3.
        variants: those of Table 2 when empty.
        label: with which the trials' names begin.
        causes: of a mixture, two to five.
        soil_law: id of a contact law other than the paper's, or ``random``; empty for the paper's.
        command: one of `COMMANDS`; logged: the desired velocity is a column of the logs.
        controller: one of `CONTROLS`.
    """

    effect: str
    seed: int
    strength: float = 1.0
    noise: float = 1.0
    sand_off: bool = False
    sizes: Mapping[str, float] = field(default_factory=dict)
    repetitions: int | None = None
    variants: tuple[Variant, ...] = ()
    label: str = "hidden"
    causes: int = 3
    soil_law: str = ""
    command: str = "trapezoid"
    logged: bool = False
    controller: str = "paper"


def chosen(spec: Spec, attempt: int = 0) -> tuple[str, ...]:
    """Return the ids that are hidden, sorted; `attempt` counts the draws of a mixture that were of no use.

    Raises:
        UsageError: an id is not known, or given twice.
    """
    rng = generator(spec.seed, 1, attempt)
    names = _effects(spec, rng)
    if not spec.soil_law:
        return names
    law = str(rng.choice(sorted(LAWS))) if spec.soil_law == "random" else spec.soil_law
    if law not in LAWS:
        raise UsageError(f"unknown contact law '{law}'", f"known: {', '.join(LAWS)}, random")
    if law in names:
        raise UsageError(f"'{law}' is named twice", "name it once")
    return tuple(sorted([*names, law]))


def _effects(spec: Spec, rng: np.random.Generator) -> tuple[str, ...]:
    """Return the ids that are hidden beside a contact law."""
    if spec.effect == "none":
        return ()
    if spec.effect == "random":
        return (str(rng.choice(sorted(LIBRARY))),)
    if spec.effect == "outside":
        return (str(rng.choice(sorted(OUTSIDE))),)
    if spec.effect == "pair":
        while True:
            two = sorted(str(name) for name in rng.choice(sorted(LIBRARY), 2, replace=False))
            if frozenset(two) not in TWINS:
                return tuple(two)
    if spec.effect == "mixture":
        return _mixture(spec.causes, rng)
    names = [name.strip() for name in spec.effect.split("+")]
    if len(set(names)) < len(names):
        raise UsageError(f"--effect {spec.effect}: an effect is named twice", "name each effect once")
    return tuple(sorted(influence(name).id for name in names))


def _mixture(causes: int, rng: np.random.Generator) -> tuple[str, ...]:
    """Draw several causes of which no two are twins."""
    while True:
        names = [str(name) for name in rng.choice(sorted(LIBRARY), causes, replace=False)]
        if rng.random() < FOREIGN:
            names[0] = str(rng.choice(sorted(OUTSIDE)))
        if not any(frozenset(two) in TWINS for two in combinations(names, 2)):
            return tuple(sorted(names))


def drawn(spec: Spec, names: Sequence[str], attempt: int = 0) -> dict[str, dict[str, float]]:
    """Return the sizes of each hidden effect by id.

    Raises:
        UsageError: a given size belongs to none of them, or lies outside its bounds.
    """
    rng, given, sizes_of = generator(spec.seed, 2, attempt), dict(spec.sizes), {}
    for name in names:
        sizes = {}
        for size in influence(name).declared:
            value = _draw(size, rng, spec.strength)
            for key in (size.name, f"{name}.{size.name}"):
                if key in given:
                    value = _within(size, key, given.pop(key))
            sizes[size.name] = value
        sizes_of[name] = sizes
    if given:
        known = [f"{name}.{size.name}" for name in names for size in influence(name).declared]
        raise UsageError(
            f"--size {next(iter(given))}: no hidden effect has such a parameter",
            f"known here: {', '.join(known)}" if known else "nothing is hidden, so there is no size",
        )
    return sizes_of


def _draw(size: Size, rng: np.random.Generator, strength: float) -> float:
    if size.kind == "shape":
        return float(rng.uniform(size.low, size.high))
    value = magnitude(rng, size.low, size.high)
    sign = float(rng.choice((-1.0, 1.0))) if size.signed else 1.0
    return float(np.clip(sign * strength * value, size.least, size.most))


def _within(size: Size, key: str, value: float) -> float:
    if not size.least <= value <= size.most:
        raise UsageError(
            f"--size {key}={value:g} is out of range", f"expected {size.least:g} to {size.most:g} {size.unit}"
        )
    return value


def sand(spec: Spec, soil: Soil, attempt: int = 0) -> tuple[Soil, dict[str, float]]:
    """Return the sand of the set, and by which factors it is off its file.

    `attempt` counts the draws that left the robot stuck.
    """
    if not spec.sand_off:
        return soil, {}
    rng = generator(spec.seed, 3, attempt)
    off = {name: float(1 + rng.choice((-1.0, 1.0)) * rng.uniform(0.05, 0.20)) for name in SAND_OFF}
    return scaled(soil, off), off


def raked(
    soil: Soil, a_theta: float, scatter: Mapping[str, float], rng: np.random.Generator
) -> tuple[Soil, float, dict[str, float]]:
    """Return sand and a_θ of one trial, and the factors of the raking."""
    drawn = factors(rng, scatter)
    of_soil = {name: factor for name, factor in drawn.items() if name != "a_theta"}
    return scaled(soil, of_soil), a_theta * drawn["a_theta"], drawn
