"""Quantities of a log: units as loggers write them, their factors to SI, and the sensors that use them.

They are listed in `granite_lab/catalogue/quantities.toml`.
"""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from typing import Any

from granite_lab.parameters import CATALOGUE
from granite_lab.parameters.quantity import build, parse_toml, quantity

STANDARD_GRAVITY = 9.80665
"""The g of accelerometer data sheets [m/s^2]."""

DATE = "date"
"""The unit of stamps that are written as dates (ISO 8601); they are read as seconds since 1970."""


@dataclass(frozen=True)
class Unit:
    """A unit: what it measures and how many SI units one of it is.

    `factor` is NaN for counts, whose size depends on the encoder.
    """

    name: str
    quantity: str
    factor: float


@dataclass(frozen=True)
class Sensor:
    """What a trial may hold of one kind.

    Attributes:
        name: in messages.
        channels: what columns of a log can feed.
        quantities: of which such a column may be; the first is usual.
        words: in names of columns; "" if its columns are recognised in another way.
        slowest: the lowest plausible sampling rate [Hz]; 0: any.
    """

    name: str
    channels: tuple[str, ...]
    quantities: tuple[str, ...]
    words: str = ""
    slowest: float = quantity("", 0, 100, "lowest plausible sampling rate [Hz]", default=0.0)


_PATH = CATALOGUE / "quantities.toml"
_LISTED = parse_toml(_PATH.read_text(encoding="utf-8"), _PATH)
_TABLE: dict[str, dict[str, tuple[float, str]]] = _LISTED["units"]
_UNITS: dict[str, Unit] = {
    spelling: Unit(name, quantity, factor)
    for quantity, units in _TABLE.items()
    for name, (factor, spellings) in units.items()
    for spelling in spellings.split()
}
_FOLDED = {spelling.casefold(): unit for spelling, unit in _UNITS.items()}

SENSORS = {kind: build(Sensor, table, str(_PATH)) for kind, table in _LISTED["sensors"].items()}
"""What a log may hold."""

WORDS: dict[str, frozenset[str]] = {key: frozenset(text.split()) for key, text in _LISTED["words"].items()}
"""What a name speaks of, to the words that say so."""

ROS: dict[str, dict[str, Any]] = _LISTED["ros"]
"""What a topic can be taken for, to the types of its messages, and their fields with unit and channels."""

CHANNELS = {channel: sensor.quantities for sensor in SENSORS.values() for channel in sensor.channels}
"""Channel to the quantities that may feed it."""

ACCELERATION = SENSORS["acceleration"].channels
RATE = SENSORS["rate"].channels
ENCODERS = SENSORS["wheels"].channels
CURRENTS = SENSORS["currents"].channels


def find_unit(text: str) -> Unit | None:
    """Return the unit a text names, or None: ``mps2``, ``[m s^-2]``, ``(rad/s)``, ``°/s``."""
    bare = re.sub(r"[\s\[\]()*·]", "", text)
    return _UNITS.get(bare) or _FOLDED.get(bare.casefold())


def factors(quantity: str) -> dict[str, float]:
    """Return the units of a quantity, that of SI first, with the number of SI units that one is."""
    return {name: factor for name, (factor, _) in _TABLE[quantity].items()}


def spellings(*quantities: str) -> str:
    """List how the units of some quantities are written, for messages."""
    return ", ".join(name for quantity in quantities for name in _TABLE[quantity])


def resembling(text: str, *quantities: str) -> str:
    """Return the known unit of some quantities that `text` resembles, or nothing."""
    known = [spelling for spelling, unit in _UNITS.items() if unit.quantity in quantities]
    close = difflib.get_close_matches(text, known, n=1, cutoff=0.5)
    return close[0] if close else ""


def gravity_unit(size: float, within: float) -> str:
    """Return the unit in which a specific force of this size is gravity, or nothing.

    Args:
        size: of the specific force at rest, as logged.
        within: relative deviation from gravity that is allowed.
    """
    sizes = factors("acceleration")
    ratios = {unit: size * sizes[unit] / STANDARD_GRAVITY for unit in ("m/s^2", "g", "mg")}
    return next((unit for unit, ratio in ratios.items() if abs(ratio - 1) < within), "")
