"""Quantities of a log: units as loggers write them, the sensors that use them, and names of columns.

They are listed in `granite_lab/catalogue/quantities.toml`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, NamedTuple

from granite_lab.parameters import CATALOGUE, WHEELS
from granite_lab.parameters.quantity import build, parse_toml, quantity

STANDARD_GRAVITY = 9.80665  # the g of accelerometer data sheets [m/s^2]
DATE = "date"  # the unit of stamps that are written as dates (ISO 8601), read as seconds since 1970


class Unit(NamedTuple):
    """A unit: what it measures and how many SI units it is (NaN for counts, which depend on the encoder)."""

    name: str
    quantity: str
    factor: float


@dataclass(frozen=True)
class Sensor:
    """What a trial may hold of one kind."""

    name: str
    channels: tuple[str, ...]  # what columns of a log can feed
    quantities: tuple[str, ...]  # of which such a column may be; the first is usual
    words: str = ""  # in names of columns; "" if its columns are recognised in another way
    slowest: float = quantity("", 0, 100, "lowest plausible sampling rate [Hz]", default=0.0)


_PATH = CATALOGUE / "quantities.toml"
_LISTED = parse_toml(_PATH.read_text(encoding="utf-8"), _PATH)
_TABLE: dict[str, dict[str, tuple[float, str]]] = _LISTED["units"]
_UNITS: dict[str, Unit] = {
    spelling: Unit(name, quantity, factor)
    for quantity, units in _TABLE.items()
    for name, (factor, texts) in units.items()
    for spelling in texts.split()
}
_FOLDED = {spelling.casefold(): unit for spelling, unit in _UNITS.items()}

# What a log may hold.
SENSORS = {kind: build(Sensor, table, str(_PATH)) for kind, table in _LISTED["sensors"].items()}
# What a name speaks of, to the words that say so.
WORDS: dict[str, frozenset[str]] = {key: frozenset(text.split()) for key, text in _LISTED["words"].items()}
# What a topic can be taken for, to the types of its messages, and their fields with unit and channels.
ROS: dict[str, dict[str, Any]] = _LISTED["ros"]
# Channel to the quantities that may feed it.
CHANNELS = {channel: sensor.quantities for sensor in SENSORS.values() for channel in sensor.channels}
ACCELERATION, RATE, ENCODERS, CURRENTS, _GLOBE = (
    SENSORS[kind].channels for kind in ("acceleration", "rate", "wheels", "currents", "globe")
)


def find_unit(text: str) -> Unit | None:
    """Return the unit a text names, or None: ``mps2``, ``[m s^-2]``, ``(rad/s)``, ``°/s``."""
    bare = re.sub(r"[\s\[\]()*·]", "", text)
    return _UNITS.get(bare) or _FOLDED.get(bare.casefold())


def factors(kind: str) -> dict[str, float]:
    """Return the units of a quantity with their factors to the SI unit, which comes first."""
    return {name: factor for name, (factor, _) in _TABLE[kind].items()}


def spellings(*quantities: str) -> list[str]:
    """List what loggers call the units of some quantities."""
    return [spelling for spelling, unit in _UNITS.items() if unit.quantity in quantities]


def gravity_unit(size: float, within: float) -> str:
    """Return the unit in which a specific force of this size is gravity within a share of it, or nothing."""
    sizes = factors("acceleration")
    ratios = {unit: size * sizes[unit] / STANDARD_GRAVITY for unit in ("m/s^2", "g", "mg")}
    return next((unit for unit, ratio in ratios.items() if abs(ratio - 1) < within), "")


@dataclass(frozen=True)
class ColumnReport:
    """What a column is, or seems to be."""

    name: str  # what the file calls it
    place: int = 0  # where it stands, counted from 0
    to: tuple[str, ...] = ()  # the channels it feeds; none: not recognised, or of no use
    unit: str = ""
    confidence: float = 0.0  # how sure that is, 0 to 1
    why: str = "not recognised"
    low: float = math.nan  # range of the values; NaN for texts
    high: float = math.nan
    filled: float = 0.0  # share of the cells that hold a number
    assumed: bool = True  # nothing in the name says the unit
    settings: tuple[tuple[str, object], ...] = ()  # further keys of its entry in a column map

    def as_json(self) -> dict[str, object]:
        """Return what is told about it as plain data."""
        return {key: value for key, value in vars(self).items() if key not in ("assumed", "settings")}


def words(name: str) -> tuple[list[str], str]:
    """Split a column's name into words and the unit it may end in: ``gyrX (°/s)``, ``accel_x_g``."""
    unit = ""
    inside = max(name.rfind("["), name.rfind("("))
    if name.rstrip()[-1:] in ("]", ")") and find_unit(name[inside + 1 :]):
        unit, name = name[inside + 1 :].rstrip()[:-1], name[:inside]
    else:
        parts = name.split("_")
        for count in (2, 1):
            tail = "_".join(parts[-count:])
            # A single `a` is an acceleration, a single `n` no force.
            if len(parts) > count and find_unit(tail) and tail not in ("a", "n"):
                unit, name = tail, "_".join(parts[:-count])
                break
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|(?<=\d)(?=[A-Za-z])", " ", name)
    return [w for w in re.split(r"[^A-Za-z0-9]+", spaced.lower()) if w], unit


def wheels_named(parts: Collection[str]) -> tuple[str, ...]:
    """Return the wheels that the words of a name speak of: one, both of a side, or none."""
    terms = set(re.sub(r"front|rear|back|left|right", r" \g<0> ", " ".join(parts)).split())
    if single := next((wheel for wheel in WHEELS if terms & WORDS[wheel]), ""):
        return (single,)
    side = next((key[0] for key in ("left", "right") if terms & WORDS[key]), "")
    axle = next((key for key in ("f", "r") if terms & WORDS[key]), "")
    return tuple(wheel for wheel in WHEELS if side and wheel[1] == side and axle in ("", wheel[0]))


def by_name(name: str, place: int = 0) -> ColumnReport:
    """Guess from the name alone; a unit of the wrong quantity lowers the confidence."""
    parts, unit_text = words(name.removesuffix(".data"))  # of a message of one number
    unit = find_unit(unit_text) if unit_text else None
    to, confidence = _meaning(parts, unit)
    if not to:
        if WORDS["attitude"] & set(parts) or re.fullmatch(
            r"(?i).*(^|[^A-Za-z])q[._ ]?[wxyz0-4]", name.strip()
        ):
            attitude = "attitude: recognised, not used"
            return ColumnReport(name, place, unit=unit.name if unit else "", why=attitude)
        return ColumnReport(name, place)
    if unit is not None and unit.quantity in CHANNELS[to[0]]:
        sure = min(confidence + 0.1, 0.98)
        return ColumnReport(name, place, to, unit.name, sure, "name and unit in it", assumed=False)
    turns = to[0] in ENCODERS and bool(WORDS["rates"] & set(parts))
    usual = "deg" if to[0] in _GLOBE else next(iter(factors("angular rate" if turns else CHANNELS[to[0]][0])))
    return ColumnReport(name, place, to, usual, confidence * (0.6 if unit else 0.9), "name; unit assumed")


def _meaning(parts: list[str], unit: Unit | None) -> tuple[tuple[str, ...], float]:
    """Return channels that the words of a name mean, and how sure that is."""
    terms = set(parts)
    single = (("v_cmd", "command", 0.7), ("tow", "tow", 0.7), *((c, c, 0.8) for c in _GLOBE))
    for channel, words_of_it, sure in single:
        if terms & WORDS[words_of_it]:
            return (channel,), sure
    if terms & WORDS["reference"]:
        speed = (unit is not None and unit.quantity == "speed") or terms & {"v", "vel"}
        return () if "z" in terms else ("ref_v" if speed else "ref_y" if "y" in terms else "ref_x",), 0.5
    joined, wheels = "".join(parts), wheels_named(parts)
    if not wheels and WORDS["numbered"] & terms:
        wheels = tuple(wheel for number, wheel in enumerate(WHEELS, 1) if str(number) in parts)
    for sensor in SENSORS.values() if "covariance" not in terms else ():
        hints = sensor.words.split()
        # `ax`, `gyrx`, `accz`: the axis may hang on to the word.
        axis = next((a for a in "xyz" if a in parts or any(joined.endswith(h + a) for h in hints)), "")
        named = any(h in parts or (axis and h + axis in parts) or (len(h) > 2 and h in joined) for h in hints)
        if sensor.channels == RATE and not axis:
            axis = next((a for a in "xyz" if WORDS[a] & terms), "")
        turning = sensor.channels == ENCODERS and unit is not None and unit.name == "rpm"
        ends = wheels if sensor.channels[0].endswith(WHEELS[0]) else tuple(axis)
        if ends and (named or turning):
            channels = tuple(channel for channel in sensor.channels if channel.endswith(ends))
            return channels, 0.8 if ends == wheels else 0.9
    return (("t",), 0.9) if {*parts[:1], *parts[-1:]} & WORDS["time"] else ((), 0.0)
