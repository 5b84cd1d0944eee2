"""Which hidden sets the blind benchmark makes, in which order, and how strong the effect in each is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import count
from typing import Any

import numpy as np

from granite_lab.effects import library
from granite_lab.hidden.catalogue import LIBRARY, OUTSIDE, influence
from granite_lab.hidden.influence import Size
from granite_lab.hidden.wish import Wish, chosen

Detectable = Mapping[str, Mapping[str, float | None]]
"""Smallest detectable size by effect and parameter; None where the design shows no size of it."""

REFERENCES = 5
"""Sets without an effect of which the smallest detectable sizes are the median."""

STRENGTHS = (5.0, 2.0, 20.0, 0.5)
"""Multiples of the smallest detectable size, in the order in which an effect meets them."""

ORDER = "nsdnsosnspsnslnsonsd"
"""Kinds of twenty successive sets: null, single, drawn, outside, pair, loud."""

KINDS = {"n": "null", "s": "single", "d": "drawn", "o": "outside", "p": "pair", "l": "loud"}

NULLS = ((1.0, False), (1.0, True), (4.0, False), (1.0, False), (1.0, True), (4.0, True))
"""Noise and sand off its file, of successive sets without an effect."""

LOUD = 3.0
"""Noise of the sets of kind "loud"."""

FIRST_SEED = 10_000

SENSIBLE = 3.0
"""An effect is at most this many times as large as its library entry expects: a robot, not a wreck."""

LEAST = {"gear_backlash": 0.05}
"""Least size that is hidden: teeth with less play [deg] are too stiff to be computed in reasonable time."""


@dataclass(frozen=True)
class Task:
    """One set of the schedule.

    Attributes:
        kind: one of `KINDS`.
        effect: an id, two joined by ``+``, or "none".
        strength: multiple of the smallest detectable size; None as `hide` draws it.
        seed: of the set; no two sets share one.
        noise: factor on the sensors' noise.
        sand_off: φ, K, n and μ_s are 5-20 % off the soil's file.
    """

    kind: str
    effect: str
    strength: float | None
    seed: int
    noise: float = 1.0
    sand_off: bool = False

    @property
    def key(self) -> str:
        """The set in one word."""
        strength = "drawn" if self.strength is None else f"{self.strength:g}"
        off = "/sand" if self.sand_off else ""
        return f"{self.kind}/{self.effect}/{strength}/noise{self.noise:g}{off}/{self.seed}"

    def record(self) -> dict[str, Any]:
        """Return the task as JSON holds it."""
        return asdict(self)


def schedule() -> Iterator[Task]:
    """Yield the sets without end; each kind advances in turn, so that any stretch is balanced."""
    met = dict.fromkeys(ORDER, 0)
    for index in count():
        letter = ORDER[index % len(ORDER)]
        yield _task(letter, met[letter], FIRST_SEED + index)
        met[letter] += 1


def _task(letter: str, i: int, seed: int) -> Task:
    kind, inside, outside = KINDS[letter], sorted(LIBRARY), sorted(OUTSIDE)
    # 7 has no factor in common with the counts: neighbours in the alphabet come far apart
    effect, turn = inside[7 * i % len(inside)], i // len(inside) + i % len(inside)
    match letter:
        case "n":
            noise, off = NULLS[i % len(NULLS)]
            return Task(kind, "none", None, seed, noise, off)
        case "o":
            # each once as drawn, then once at double size
            strength = 1.0 + i // len(outside) % 2
            return Task(kind, outside[7 * i % len(outside)], strength, seed)
        case "p":
            two = "+".join(chosen(Wish("pair", seed)))
            return Task(kind, two, (5.0, 20.0)[i % 2], seed)
        case "d":
            return Task(kind, effect, None, seed)
        case "l":
            return Task(kind, effect, (5.0, 2.0, 20.0)[turn % 3], seed, LOUD)
        case _:
            return Task(kind, effect, STRENGTHS[turn % len(STRENGTHS)], seed)


def wish_of(task: Task, detectable: Detectable) -> tuple[Wish, dict[str, float]]:
    """Return what is to be hidden, and by effect the strength that came of it.

    The strength is lower than asked where the size would leave the bounds of sense, and higher where
    less could not be computed.
    """
    wish = Wish(task.effect, task.seed, noise=task.noise, sand_off=task.sand_off)
    if task.kind == "outside":
        return replace(wish, strength=task.strength or 1.0), {}
    if task.effect == "none" or task.strength is None:
        return wish, {}
    sizes: dict[str, float] = {}
    reached: dict[str, float] = {}
    for place, name in enumerate(chosen(wish)):
        rng = np.random.default_rng([task.seed, 77, place])
        own, factor = sizes_of(name, task.strength, detectable[name], rng)
        sizes |= {f"{name}.{key}": value for key, value in own.items()}
        reached[name] = factor
    return replace(wish, sizes=sizes), reached


def sizes_of(
    name: str, strength: float, detectable: Mapping[str, float | None], rng: np.random.Generator
) -> tuple[dict[str, float], float]:
    """Return the sizes of an effect at a strength, and the strength that they stand for.

    With two amounts either one of them, or both at strength/√2: with signatures at right angles
    that is as easily seen. Phases are drawn with each trial, so there both are in play.

    Raises:
        ValueError: the design shows no size of this effect.
    """
    amounts = [size for size in influence(name).declared if size.kind != "shape"]
    needed = {size.name: detectable.get(counterpart(size)) for size in amounts}
    seen = [size for size in amounts if needed[size.name] is not None]
    if not seen:
        raise ValueError(f"the design shows no size of '{name}'")
    together = seen[0].kind == "amplitude" or len(seen) == 1
    lot = len(seen) if together else int(rng.integers(len(seen) + 1))
    share = [float(lot in (k, len(seen))) for k in range(len(seen))]
    norm = float(np.sqrt(sum(share)))
    sizes = dict.fromkeys((size.name for size in amounts), 0.0)
    factor = 1.0
    for size, part in zip(seen, share, strict=True):
        sign = float(rng.choice((-1.0, 1.0))) if size.signed else 1.0
        value = sign * strength * float(needed[size.name] or 0.0) * part / norm
        sizes[size.name] = value
        if value:
            factor = min(factor, limit(name, size, value) / abs(value))
            factor = max(factor, LEAST.get(name, 0.0) / abs(value))
    return {key: factor * value for key, value in sizes.items()}, factor * strength


def counterpart(size: Size) -> str:
    """Return the parameter of the library's effect that a hidden size corresponds to."""
    return size.name.replace("amplitude_", "cos_") if size.kind == "amplitude" else size.name


def limit(name: str, size: Size, value: float) -> float:
    """Return the largest sensible magnitude in the direction of a value."""
    bound = abs(size.most if value > 0 else size.least)
    own = next(p for p in library()[name].parameters if p.name == counterpart(size))
    return min(
        bound, 0.8 * (own.high if value > 0 else -own.low), SENSIBLE * max(abs(own.prior_low), own.prior_high)
    )
