"""Sizes of effects as a reader says them: in units that fit, and in words where a sign has a direction."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from granite_lab.discovery.finding import FoundEffect, FoundParameter
from granite_lab.estimate import Estimate
from granite_lab.model.effect import Effect
from granite_lab.reporting.rounding import plus_minus, tidy_unit

PREFIXED = ("s", "m", "rad", "m/N", "rad/(N m)")
"""Units that take a milli or a micro in front."""

RELATIVE = {
    ("accel_scale_error", "x"), ("accel_scale_error", "z"), ("torque_constant_error", "error"),
    ("wheel_radius_error", "error"),
}  # fmt: skip
"""Effect and number that are relative errors, said in percent."""

DIRECTIONS = {
    "clock_offset": (
        "offset",
        "stamps of encoders and currents late against the IMU's",
        "stamps of encoders and currents early against the IMU's",
    ),
    "com_offset": ("forward", "centre of mass shifted to the front", "centre of mass shifted to the rear"),
    "ground_slope": ("slope", "ground that rises", "ground that falls"),
    "imu_tilt": ("tilt", "IMU mounted nose down", "IMU mounted nose up"),
    "torque_constant_error": (
        "error",
        "torque constant or gear efficiency above that of the robot's file",
        "torque constant or gear efficiency below that of the robot's file",
    ),
    "wheel_radius_error": ("error", "wheel angles read too large", "wheel angles read too small"),
}
"""Effect to the number whose sign has a direction, and the effect in words for either sign."""


def unit_for(unit: str, size: float) -> tuple[str, float]:
    """Return the unit in which a size is printed, and the factor to it: ms for 0.027 s."""
    if unit not in PREFIXED or size == 0 or abs(size) >= 0.1:
        return tidy_unit(unit), 1.0
    return (f"m{tidy_unit(unit)}", 1e3) if abs(size) >= 1e-4 else (f"µ{tidy_unit(unit)}", 1e6)


def scale_of(effect_id: str, name: str, unit: str, size: float) -> tuple[str, float]:
    """Return unit and factor of a number of an effect; relative errors are percent."""
    return ("%", 100.0) if (effect_id, name) in RELATIVE else unit_for(unit, size)


def amount(effect: FoundEffect, parameter: FoundParameter) -> str:
    """Return a fitted number ± std with its unit."""
    unit, scale = scale_of(effect.id, parameter.name, parameter.unit, parameter.estimate.value)
    return plus_minus(parameter.estimate, unit, scale)


def in_words(effect: FoundEffect) -> tuple[str, str]:
    """Return an effect in words, and its sizes; a sign that has a direction is said, not printed."""
    if effect.id in DIRECTIONS:
        name, above, below = DIRECTIONS[effect.id]
        own = next((p for p in effect.parameters if p.name == name), None)
        if own is not None and not own.per_trial:
            away = FoundParameter(
                own.name, own.unit, Estimate(abs(own.estimate.value), own.estimate.std), own.per_trial
            )
            return above if own.estimate.value >= 0 else below, f"by {amount(effect, away)}"
    sizes = ", ".join(f"{p.name.replace('_', ' ')} {amount(effect, p)}" for p in _with_amplitudes(effect))
    return effect.title, sizes


def _with_amplitudes(effect: FoundEffect) -> list[FoundParameter]:
    """Return the numbers, cosine and sine that differ in each trial as the amplitude that they share."""
    named = {p.name: p for p in effect.parameters}
    shown = []
    for p in effect.parameters:
        part, _, rest = p.name.partition("_")
        pair = {"cos": f"sin_{rest}", "sin": f"cos_{rest}"}
        other = named.get(pair.get(part, "")) if p.per_trial else None
        if other is None:
            shown.append(p)
        elif part == "cos":
            c, s = p.estimate, other.estimate
            size = float(np.hypot(c.value, s.value))
            std = float(np.hypot(c.value * c.std, s.value * s.std)) / size if size else c.std
            shown.append(FoundParameter(f"amplitude_{rest}", p.unit, Estimate(size, std)))
    return shown


def meaning(effect_id: str, name: str, known: Mapping[str, Effect]) -> str:
    """Say what a number of an effect is, and which way its sign goes; empty where that is not known."""
    effect = known.get(effect_id)
    declared = {p.name: p.meaning for p in effect.parameters} if effect is not None else {}
    text = declared.get(name, "")
    direction = DIRECTIONS.get(effect_id)
    if text and direction is not None and direction[0] == name and "positive" not in text:
        return f"{text}; below zero: {direction[2]}"
    return text
