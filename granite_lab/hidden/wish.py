"""What is to be hidden: the effect by name or by lot, its sizes, and the sand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from granite_lab.errors import UsageError
from granite_lab.hidden.catalogue import LIBRARY, OUTSIDE, TWINS, influence
from granite_lab.hidden.chance import factors, lot, magnitude, scaled
from granite_lab.hidden.influence import Size
from granite_lab.parameters import Soil, Variant

LOTS = ("random", "none", "outside", "pair")
"""What may stand in place of an id: a lot among the library's, none, a lot outside the library, two."""

SAND_OFF = ("friction_angle", "shear_modulus", "exponent", "tyre_friction")
"""φ, K, n and μ_s, which a set may have off the soil's file."""


@dataclass(frozen=True)
class Wish:
    """What to hide.

    Attributes:
        effect: an id, ids joined by ``+``, or one of `LOTS`.
        seed: of everything random.
        strength: factor on the drawn sizes.
        noise: factor on noise, vibration and jitter of the sensors.
        sand_off: φ, K, n and μ_s are 5-20 % off the soil's file.
        lab: name of the laboratory, see `granite_lab.hidden.lab`.
        sizes: parameters that are not drawn, by ``name`` or ``id.name``.
        repetitions: of each variant; None: as the laboratory says, else 3.
        variants: those of Table 2 when empty.
        label: with which the trials' names begin.
    """

    effect: str
    seed: int
    strength: float = 1.0
    noise: float = 1.0
    sand_off: bool = False
    lab: str = "bench"
    sizes: Mapping[str, float] = field(default_factory=dict)
    repetitions: int | None = None
    variants: tuple[Variant, ...] = ()
    label: str = "hidden"


def chosen(wish: Wish) -> tuple[str, ...]:
    """Return the ids that are hidden, sorted.

    Raises:
        UsageError: an id is not known, or given twice.
    """
    rng = lot(wish.seed, 1, 0)
    if wish.effect == "none":
        return ()
    if wish.effect == "random":
        return (str(rng.choice(sorted(LIBRARY))),)
    if wish.effect == "outside":
        return (str(rng.choice(sorted(OUTSIDE))),)
    if wish.effect == "pair":
        while True:
            two = sorted(str(name) for name in rng.choice(sorted(LIBRARY), 2, replace=False))
            if frozenset(two) not in TWINS:
                return tuple(two)
    names = [name.strip() for name in wish.effect.split("+")]
    if len(set(names)) < len(names):
        raise UsageError(f"--effect {wish.effect}: an effect is named twice", "name each effect once")
    return tuple(sorted(influence(name).id for name in names))


def drawn(wish: Wish, names: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the sizes of each hidden effect by id.

    Raises:
        UsageError: a given size belongs to none of them, or lies outside its bounds.
    """
    rng, given, found = lot(wish.seed, 2, 0), dict(wish.sizes), {}
    for name in names:
        sizes = {}
        for size in influence(name).declared:
            value = _draw(size, rng, wish.strength)
            for key in (size.name, f"{name}.{size.name}"):
                if key in given:
                    value = _within(size, key, given.pop(key))
            sizes[size.name] = value
        found[name] = sizes
    if given:
        known = [f"{name}.{size.name}" for name in names for size in influence(name).declared]
        raise UsageError(
            f"--size {next(iter(given))}: no hidden effect has such a parameter",
            f"known here: {', '.join(known)}" if known else "nothing is hidden, so there is no size",
        )
    return found


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


def sand(wish: Wish, soil: Soil, attempt: int = 0) -> tuple[Soil, dict[str, float]]:
    """Return the sand of the set, and by which factors it is off its file.

    `attempt` counts the draws that left the robot stuck.
    """
    if not wish.sand_off:
        return soil, {}
    rng = lot(wish.seed, 3, attempt)
    off = {name: float(1 + rng.choice((-1.0, 1.0)) * rng.uniform(0.05, 0.20)) for name in SAND_OFF}
    return scaled(soil, off), off


def raked(
    soil: Soil, a_theta: float, scatter: Mapping[str, float], rng: np.random.Generator
) -> tuple[Soil, float, dict[str, float]]:
    """Return sand and a_θ of one trial, and the factors of the raking."""
    drawn = factors(rng, scatter)
    of_soil = {name: factor for name, factor in drawn.items() if name != "a_theta"}
    return scaled(soil, of_soil), a_theta * drawn["a_theta"], drawn
