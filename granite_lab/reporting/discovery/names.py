"""Channels and effects of a finding as a reader calls them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from granite_lab.discovery.finding import Finding, FoundEffect
from granite_lab.reporting.discovery.amounts import in_words

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

STATUS = {
    "evaluated": "fitted in full",
    "screened only": "first look only",
    "at a bound": "ended at a bound",
    "not converged": "did not converge",
    "related": "may only mend a formula",
    "uneven": "of another size in each trial",
}
"""How far a candidate was tried, as a reader is told."""


def channel_name(channel: str) -> str:
    """Return a channel as a reader calls it."""
    return CHANNELS.get(channel, channel)


def spoken(channel: str) -> str:
    """Return a channel as it stands inside a sentence."""
    return SPOKEN.get(channel, channel_name(channel))


def describe(effect: FoundEffect) -> str:
    """Name an effect with its sizes and with what cannot be told from it."""
    title, sizes = in_words(effect)
    twins = (
        f"; these trials cannot tell it from {either([plain(t) for t in effect.twins])}"
        if effect.twins
        else ""
    )
    return f"{title} ({sizes}{twins})"


def quantities(effect: FoundEffect) -> str:
    """List the quantities that an empirical law adds, inside a sentence."""
    used = [name for key, name in LAW.items() if any(p.name.startswith(f"{key}_") for p in effect.parameters)]
    return listed([f"a {name.split(',')[0]}" for name in used]) if used else "nothing"


def with_found(finding: Finding) -> str:
    """Say what the model has more than the paper's, as a legend does."""
    return "with the empirical law" if finding.verdict == "unknown" else "with what was found"


def what_found(finding: Finding) -> str:
    """Say what was found, inside a sentence."""
    return "the empirical law" if finding.verdict == "unknown" else "what was found"


def effects_in_words(finding: Finding) -> str:
    """Say the verdict in one line."""
    if finding.verdict == "none":
        return "search for a missing effect: these trials show none"
    if finding.verdict == "named":
        return f"missing from the model: {listed([describe(e) for e in finding.effects])}"
    return "something is missing from the model that no candidate explains"


def listed(parts: Sequence[str]) -> str:
    """Join parts with commas and "and"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def either(parts: Sequence[str]) -> str:
    """Join parts with commas and "or"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} or {parts[-1]}"


NAMES = {
    "accel_scale_error": "accelerometer scale error",
    "com_offset": "centre-of-mass offset",
    "imu_tilt": "IMU tilt",
    "tyre_windup": "tyre wind-up",
}
"""Effects whose id alone does not read as words."""


def plain(effect_id: str) -> str:
    """Return an effect's id as words."""
    return NAMES.get(effect_id, effect_id.replace("_", " "))


def in_plain_words(note: str, finding: Finding) -> str:
    """Return a note of the search with the effects and channels in it as words."""
    ids = {c.id for found in finding.rounds for c in found} | {d.effect for d in finding.detectable}
    for id_ in sorted((i for i in ids if "_" in i), key=len, reverse=True):
        note = re.sub(rf"\b{re.escape(id_)}\b", plain(id_), note)
    for channel in CHANNELS:
        if "_" in channel:
            note = re.sub(rf"\b{channel}\b", spoken(channel), note)
    return note[:1].upper() + note[1:]


def short(name: str, most: int = 25) -> str:
    """Return a trial's name on one line, cut where it is too long for a row of a figure."""
    flat = " ".join(name.split())
    return flat if len(flat) <= most else f"{flat[: most - 1]}…"
