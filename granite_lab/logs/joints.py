"""Which wheel a joint of a ROS robot is, by its name."""

from __future__ import annotations

import re
from collections.abc import Sequence

from granite_lab.parameters import WHEELS

_SIDES = {"left": "l", "l": "l", "right": "r", "r": "r"}
_AXLES = {"front": "f", "f": "f", "fore": "f", "rear": "r", "back": "r", "hind": "r", "aft": "r", "b": "r"}
_BOTH = {"fl": "fl", "lf": "fl", "fr": "fr", "rf": "fr", "rl": "rl", "bl": "rl", "lb": "rl", "lr": "rl"}
_BOTH |= {"rr": "rr", "br": "rr", "rb": "rr"}
_OTHER = {"steer", "steering", "caster", "castor", "arm", "gripper", "middle", "mid", "pan", "tilt"}


def wheels_of(joint: str) -> tuple[str, ...]:
    """Return the wheels that a joint turns: one, both of a side where the name says no axle, or none.

    Names are read word by word, as in ``front_left_wheel_joint``, ``wheel_FL`` or ``LeftWheel``.
    """
    text = re.sub(r"([a-z])([A-Z])", r"\1_\2", joint)
    words = [word for word in re.split(r"[^A-Za-z]+", text) if word]
    words = [word.casefold() for word in words]
    if any(word in _OTHER for word in words):
        return ()
    for word in words:
        if word in _BOTH:
            return (_BOTH[word],)
        split = re.fullmatch(r"(front|rear|back)(left|right)|(left|right)(front|rear|back)", word)
        if split:
            one, other = (part for part in split.groups() if part)
            words += [one, other]
    side = next((_SIDES[word] for word in words if word in _SIDES and len(word) > 1), None) or next(
        (_SIDES[word] for word in words if word == "l" or (word == "r" and "wheel" in words)), None
    )
    axle = next((_AXLES[word] for word in words if word in _AXLES), None)
    if side is None:
        return ()
    if axle is not None:
        return (axle + side,)
    return tuple(wheel for wheel in WHEELS if wheel[1] == side) if "wheel" in "_".join(words) else ()


def assign(joints: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return joint to wheels, each wheel from one joint; a joint that says its axle goes first.

    Several joints that claim one wheel leave it to the one that calls itself a wheel, else to the first.
    """
    taken: dict[str, str] = {}
    claims = [(joint, wheels_of(joint)) for joint in joints]
    order = sorted(claims, key=lambda claim: (len(claim[1]), "wheel" not in claim[0].casefold()))
    for joint, wheels in order:
        for wheel in wheels:
            taken.setdefault(wheel, joint)
    return {
        joint: mine
        for joint, _ in claims
        if (mine := tuple(wheel for wheel in WHEELS if taken.get(wheel) == joint))
    }
