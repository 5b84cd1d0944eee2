"""What an influence is: a variation of the truth's model, with a size and where it comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from granite_lab.hidden.contact import Array
from granite_lab.hidden.model import PITCH, Truth
from granite_lab.hidden.parts import CompleteRobot

Kind = Literal["exact", "equivalent", "shape", "amplitude"]


@dataclass(frozen=True)
class Size:
    """One parameter of an influence.

    Attributes:
        name, unit, meaning: for people and files.
        low, high: of the magnitude drawn at strength 1.
        least, most: what a strength may not exceed.
        signed: the sign is drawn, too.
        kind: "exact" where the library's effect of the same name means the same number;
            "equivalent" where it has another formula, and the number is only comparable; "shape"
            where the strength leaves it alone; "amplitude" of something whose phase changes from
            trial to trial.
    """

    name: str
    unit: str
    meaning: str
    low: float
    high: float
    least: float = 0.0
    most: float = np.inf
    signed: bool = False
    kind: Kind = "exact"


def amplitudes(unit: str, meaning: str, low: float, high: float, most: float) -> tuple[Size, ...]:
    """Return the sizes, front and rear, of what turns with the wheels; arguments as of `Size`."""
    return tuple(
        Size(f"amplitude_{axle}", unit, f"{meaning}, {axle}", low, high, 0, most, kind="amplitude")
        for axle in ("front", "rear")
    )


class Influence(Truth):
    """A variation of the truth's model. Subclasses override its methods, call `super()`, and so combine.

    Class attributes:
        id: the id of the library's effect, or the influence's own.
        title: a few words.
        account: how it is made here, and after whom.
        declared: its parameters.
        phased: each trial has a phase of its own [rad].
        predictable: trials show when it acts in another one; not so of a gust.
    """

    id: ClassVar[str]
    title: ClassVar[str]
    account: ClassVar[str]
    declared: ClassVar[tuple[Size, ...]]
    phased: ClassVar[bool] = False
    predictable: ClassVar[bool] = True

    @classmethod
    def altered(cls, robot: CompleteRobot, sizes: Mapping[str, float]) -> CompleteRobot:  # noqa: ARG003
        """Return the robot as it really is."""
        return robot

    @classmethod
    def of_trial(cls, sizes: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Return the parameters of one trial: those of the set, and what changes from trial to trial.

        Each `amplitude_<axle>` is split into `cos_<axle>` and `sin_<axle>` under a random phase: a trial
        begins with the wheels as they stand.
        """
        changed = dict(sizes)
        for size in cls.declared:
            if size.kind == "amplitude":
                phase, axle = rng.uniform(0, 2 * np.pi), size.name.removeprefix("amplitude_")
                changed[f"cos_{axle}"] = sizes[size.name] * float(np.cos(phase))
                changed[f"sin_{axle}"] = sizes[size.name] * float(np.sin(phase))
        if cls.phased:
            changed["phase"] = float(rng.uniform(0, 2 * np.pi))
        return changed

    @classmethod
    def has_phase(cls) -> bool:
        """Tell whether each trial has a phase of its own."""
        return cls.phased or any(size.kind == "amplitude" for size in cls.declared)

    @staticmethod
    def opposite(sizes: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters of a trial that begins half a period later."""
        turned = {name: -x if name.startswith(("cos_", "sin_")) else x for name, x in sizes.items()}
        return turned | ({"phase": sizes["phase"] + np.pi} if "phase" in sizes else {})

    def drag(self, y: Array, force: float | Array) -> Array:
        """Return the push of a resistance [N] along R's x at wheel-centre height; none on a robot at rest."""
        f = -np.sign(self.velocity(y)) * self.fade(y) * force
        return np.array([f * np.cos(y[PITCH]), -f * np.sin(y[PITCH]), f * self.arm_z])


def pairs(sizes: Mapping[str, float]) -> tuple[Array, Array]:
    """Return cosine and sine amplitudes of front and rear, (2,) each."""
    return (
        np.array([sizes["cos_front"], sizes["cos_rear"]]),
        np.array([sizes["sin_front"], sizes["sin_rear"]]),
    )
