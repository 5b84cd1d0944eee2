"""Channels and effects of a finding as a reader calls them."""

from __future__ import annotations

from collections.abc import Sequence

from granite_lab.discovery.finding import Finding, FoundEffect
from granite_lab.reporting.rounding import plus_minus, tidy_unit

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


STATUS = {
    "evaluated": "fitted in full",
    "screened only": "first look only",
    "at a bound": "ended at a bound",
    "not converged": "did not converge",
}
"""How far a candidate was tried, as a reader is told."""


def channel_name(channel: str) -> str:
    """Return a channel as a reader calls it."""
    return CHANNELS.get(channel, channel)


def describe(effect: FoundEffect) -> str:
    """Name an effect with its sizes and with what cannot be told from it."""
    sizes = ", ".join(
        f"{p.name.replace('_', ' ')} {plus_minus(p.estimate, tidy_unit(p.unit))}" for p in effect.parameters
    )
    twins = (
        f"; these trials cannot tell it from {either([plain(t) for t in effect.twins])}"
        if effect.twins
        else ""
    )
    return f"{effect.title} ({sizes}{twins})"


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


def plain(effect_id: str) -> str:
    """Return an effect's id as words."""
    return effect_id.replace("_", " ")


def short(name: str, most: int = 25) -> str:
    """Return a trial's name on one line, cut where it is too long for a row of a figure."""
    flat = " ".join(name.split())
    return flat if len(flat) <= most else f"{flat[: most - 1]}…"
