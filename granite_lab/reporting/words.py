"""The words of the report, ``templates/words.toml``: what a reader calls things, titles and captions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from granite_lab.parameters.quantity import parse_toml

FILE = Path(__file__).parent / "templates" / "words.toml"
WORDS: dict[str, Any] = parse_toml(FILE.read_text(encoding="utf-8"), FILE)

SENSORS: dict[str, str] = WORDS["sensors"]
"""Channels of a finding, in the order of the report, as a reader calls them."""

QUANTITIES: dict[str, str] = WORDS["quantities"]
"""Channels of a comparison, likewise; "wheels" are all four."""

PHASES: dict[str, str] = WORDS["phases"]
"""Phases of a motion, with their preposition."""


def sensor(channel: str) -> str:
    """Return a channel of a finding as a reader calls it."""
    return SENSORS.get(channel, channel)


def quantity(channel: str) -> str:
    """Return a channel of a comparison as a reader calls it."""
    return QUANTITIES.get(channel, channel)


def said(section: str, key: str, **parts: object) -> str:
    """Return a sentence of the page or the caption of a figure, its braces filled in."""
    return str(WORDS[section][key].format(**parts))
