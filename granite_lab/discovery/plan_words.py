"""Channels, phases and conditions in plain words."""

from __future__ import annotations

import numpy as np

from granite_lab.discovery.observation import Observation
from granite_lab.discovery.plan_conditions import Conditions
from granite_lab.discovery.plan_design import Design
from granite_lab.logs.trial import Array
from granite_lab.model.command import duration, peak_velocity
from granite_lab.parameters import Variant

IN_WORDS = {
    "accel_x": "the longitudinal acceleration",
    "accel_z": "the vertical acceleration",
    "pitch_rate": "the pitch rate",
    "wheel": "the angle of the wheels",
    "wheel_split": "the difference of front and rear wheels",
    "current_f": "the front current",
    "current_r": "the rear current",
}

WHEN = {
    "rest": "at rest before the start",
    "accelerate": "while accelerating",
    "steady": "at constant speed",
    "brake": "while braking",
    "coast": "while coming to rest",
}

WINDOW = 15
"""Bins over which the strongest place of a signal is sought."""


def strongest(observation: Observation, rows: dict[str, Array]) -> tuple[str, str, float]:
    """Return channel, phase and energy of the strongest place of whitened signals."""
    best = ("", "", 0.0)
    for channel, row in rows.items():
        energy = np.convolve(row**2, np.ones(WINDOW), mode="same")
        k = int(np.argmax(energy))
        if energy[k] > best[2]:
            phase = observation.phase[k]
            phase = "coast" if phase == "rest" and observation.t[k] > 0 else phase
            best = channel, phase, float(energy[k])
    return best


def trial_words(variant: Variant, conditions: Conditions) -> str:
    """Name a trial by its command and conditions."""
    command = f"{variant.velocity:g} m/s, {variant.acceleration:g} m/s², {variant.distance:g} m"
    return f"{command}, {conditions.words}" if conditions.words else command


def why(design: Design, variant: Variant, conditions: Conditions, *, repeats: bool) -> str:
    """Say what is different about a proposed trial."""
    if repeats:
        return "repeats a command, averages noise and raking"
    parts = []
    if conditions.wheels_up:
        parts.append("without ground only the drives are seen")
    if conditions.turned:
        parts.append("the slope changes its sign, everything else stays")
    if conditions.payload:
        parts.append("more weight on the wheels, the drives stay the same")
    if conditions.slope:
        pull = "against" if conditions.slope > 0 else "along"
        parts.append(f"a known pull {pull} the way")
    if conditions.same_rut:
        parts.append("all wheels run in compacted sand from the start")
    if parts:
        return ", ".join(parts)
    speeds = [peak_velocity(d.variant) for d in design.driven]
    starts = [d.variant.acceleration for d in design.driven]
    v, a = peak_velocity(variant), variant.acceleration
    near = min(
        design.driven, key=lambda d: (abs(peak_velocity(d.variant) - v), abs(d.variant.acceleration - a))
    )
    old = near.variant
    if v > 1.01 * max(speeds):
        parts.append("faster than so far")
    elif v < 0.99 * min(speeds):
        parts.append("slower than so far")
    elif abs(v / peak_velocity(old) - 1) > 0.01:
        parts.append("a speed between those so far")
    if a > 1.01 * max(starts):
        parts.append("a sharper start than so far")
    elif a < 0.99 * min(starts):
        parts.append("a gentler start than so far")
    elif abs(a / old.acceleration - 1) > 0.01:
        parts.append(f"a {'sharper' if a > old.acceleration else 'gentler'} start at this speed")
    if not parts:
        parts.append("a longer way" if variant.distance > old.distance else "a shorter way")
    elif duration(variant) > 1.05 * max(duration(d.variant) for d in design.driven):
        parts.append("longer at constant speed")
    return ", ".join(parts)


def how(conditions: Conditions) -> str:
    """Say how a trial under conditions is driven and read."""
    if conditions.wheels_up:
        return "put the robot on a block so that no wheel touches anything, and give the command"
    if conditions.turned:
        return "turn the robot round and drive back over ground raked as before; do not move the IMU"
    if conditions.payload:
        return f"fix {conditions.payload:g} kg at the centre of mass"
    if conditions.slope:
        return (
            f"raise the {'far' if conditions.slope > 0 else 'near'} end of the box by "
            f"{abs(conditions.slope):g}°, measured with a level"
        )
    if conditions.same_rut:
        return "drive once on raked sand, lift the robot back and drive again in the same rut"
    return "rake, and drive it like the others"
