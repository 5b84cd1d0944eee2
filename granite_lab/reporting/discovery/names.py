"""Channels, effects and scales of a finding as a reader calls them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from granite_lab.discovery.empirical import TARGETS
from granite_lab.discovery.finding import Candidate, Finding, FoundEffect
from granite_lab.estimate import Estimate
from granite_lab.reporting.discovery.amounts import amount, in_words
from granite_lab.reporting.rounding import plus_minus

CHANNELS = {
    "accel_x": "forward acceleration",
    "accel_z": "vertical acceleration",
    "pitch_rate": "pitch rate",
    "wheel": "wheel angle, mean",
    "wheel_split": "wheel angle, front − rear",
    "current_f": "motor current, front",
    "current_r": "motor current, rear",
}
"""Channels of a finding, in the order of the report."""

SPOKEN = {
    "wheel": "mean wheel angle",
    "wheel_split": "front − rear wheel angle",
    "current_f": "front motor current",
    "current_r": "rear motor current",
}
"""Channels whose name in the figures has a comma, inside a sentence."""

LAW = {
    "force": "force along the robot",
    "moment": "moment on the body, nose down",
    "torque_f": "torque against each front wheel",
    "torque_r": "torque against each rear wheel",
}
"""Quantities of an empirical law."""

BY = {
    "motion": "constant while moving",
    "velocity": "with the speed of the robot",
    "velocity_squared": "with the square of that speed",
    "slip": "with slip",
    "sinking": "with the rate of sinking",
    "start": "over the first 0.2 m",
    "distance": "with the distance",
    "cos_angle": "with the cosine of the wheel's angle",
    "sin_angle": "with the sine of the wheel's angle",
    "time": "with time",
}
"""Terms of an empirical law."""

STATUS = {
    "named": "named",
    "twin": "as good as a named one",
    "small": "small",
    "less likely": "less likely",
    "screened": "first look only",
    "at a bound": "ended at a bound",
}
"""What became of a candidate."""

SCALES = {
    "a_theta": ("a_θ, from raking to raking", "%", 100.0),
    "frictional_modulus": ("k_φ, from raking to raking", "%", 100.0),
    "cohesion": ("c, from raking to raking", "%", 100.0),
    "start": ("start of the command", "ms", 1e3),
    "tilt": ("tilt of the IMU", "°", 180 / math.pi),
    "accel_x gain": ("gain of the accelerometer", "%", 100.0),
    "wheel gain": ("wheel radius, mean of all", "%", 100.0),
    "wheel_split gain": ("wheel radius, front against rear", "%", 100.0),
    "current_f gain": ("gain of the front motor currents", "%", 100.0),
    "current_r gain": ("gain of the rear motor currents", "%", 100.0),
}
"""Number that differs from trial to trial: as a reader calls it, unit and factor."""

SAND = {
    "a_theta": "a_θ", "frictional_modulus": "k_φ", "cohesion": "c", "shear_modulus": "K",
    "friction_angle": "φ", "exponent": "n", "tyre_friction": "μ_s",
}  # fmt: skip
"""Parameters of the sand."""

NAMES = {
    "accel_scale_error": "accelerometer scale error",
    "com_offset": "centre-of-mass offset",
    "imu_tilt": "IMU tilt",
    "tyre_windup": "tyre wind-up",
}
"""Effects whose id alone does not read as words."""


def channel_name(channel: str) -> str:
    """Return a channel as a reader calls it."""
    return CHANNELS.get(channel, channel)


def spoken(channel: str) -> str:
    """Return a channel as it stands inside a sentence."""
    return SPOKEN.get(channel, channel_name(channel))


def channels_of(finding: Finding) -> list[str]:
    """Return the channels that the search used, in the order of the report."""
    found = {r.channel for r in finding.residuals}
    return [c for c in CHANNELS if c in found] + sorted(found - set(CHANNELS))


def term_of(effect_id: str) -> tuple[str, str] | None:
    """Return target and term of "empirical.torque_f_slip"; None for a physical effect."""
    _, _, name = effect_id.partition(".")
    target = next((t for t in TARGETS if name.startswith(f"{t}_")), None)
    return (target, name.removeprefix(f"{target}_")) if target else None


def plain(effect_id: str) -> str:
    """Return an effect's id as words."""
    term = term_of(effect_id)
    if term is not None:
        return f"{LAW[term[0]].split(',')[0]}, {BY.get(term[1], term[1])}"
    return NAMES.get(effect_id, effect_id.replace("_", " "))


def brief(effect_id: str) -> str:
    """Return an effect's id as words short enough for a row of a figure."""
    term = term_of(effect_id)
    if term is None:
        return plain(effect_id)
    axle = {"torque_f": "front torque", "torque_r": "rear torque"}
    return f"{axle.get(term[0], term[0])} by {term[1].replace('_', ' ')}"


def shown_candidates(finding: Finding) -> list[Candidate]:
    """Return the candidates, likeliest first, without terms of the empirical law that were never fitted."""
    return [c for c in finding.candidates if term_of(c.id) is None or c.status != "screened"]


def describe(effect: FoundEffect) -> str:
    """Name an effect with its sizes."""
    title, sizes = in_words(effect)
    if effect.empirical:
        title, sizes = plain(effect.id), ", ".join(amount(effect, p) for p in effect.parameters)
    return f"{title} ({sizes})" if sizes else title


def with_found(finding: Finding) -> str:
    """Say what the model has more than the paper's, as a legend does."""
    return "with the empirical law" if finding.verdict == "unknown" else "with what was found"


def effects_in_words(finding: Finding) -> str:
    """Say the verdict in one line."""
    if finding.verdict == "none":
        return "search for a missing effect: these trials show none"
    if finding.verdict == "unknown":
        return "something is missing from the model that no candidate explains"
    parts = [describe(e) for e in finding.effects]
    twins = sorted({t for e in finding.effects for t in e.twins})
    or_else = f"; these trials cannot tell it from {listed([plain(t) for t in twins], 'or')}" if twins else ""
    return f"missing from the model: {listed(parts)}{or_else}"


def latency_in_words(latency: Estimate) -> str:
    """Say by how much the stamps of the IMU come later than the others; empty where that is not known."""
    if not math.isfinite(latency.value):
        return ""
    side = "behind" if latency.value >= 0 else "ahead of"
    size = plus_minus(Estimate(abs(latency.value), latency.std), "ms", 1e3)
    return f"IMU stamps {size} {side} those of wheels and currents"


def listed(parts: Sequence[str], last: str = "and") -> str:
    """Join parts with commas, the last one with "and" or another word."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}"


def capital(text: str) -> str:
    """Return a text with a capital letter in front."""
    return text[:1].upper() + text[1:]


def in_plain_words(note: str, finding: Finding) -> str:
    """Return a sentence of the search with the effects and channels in it as words."""
    ids = {c.id for c in finding.candidates} | {d.effect for d in finding.detectable}
    for e in (*finding.effects, *finding.small):
        ids |= {e.id, *e.twins}
    for id_ in sorted((i for i in ids if "_" in i), key=len, reverse=True):
        note = re.sub(rf"\b{re.escape(id_)}\b", plain(id_), note)
    for channel in CHANNELS:
        if "_" in channel:
            note = re.sub(rf"\b{channel}\b", spoken(channel), note)
    return capital(note)


def short(name: str, most: int = 25) -> str:
    """Return a trial's name on one line, cut where it is too long for a row of a figure."""
    flat = " ".join(name.split())
    return flat if len(flat) <= most else f"{flat[: most - 1]}…"
