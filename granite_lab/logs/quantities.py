"""Quantities of a log: units as loggers write them, their factors to SI, and the sensors that use them."""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass

from granite_lab.parameters import WHEELS

STANDARD_GRAVITY = 9.80665
"""The g of accelerometer data sheets [m/s^2]."""


@dataclass(frozen=True)
class Unit:
    """A unit: what it measures and how many SI units one of it is.

    `factor` is NaN for counts, whose size depends on the encoder.
    """

    name: str
    quantity: str
    factor: float


DATE = "date"
"""The unit of stamps that are written as dates (ISO 8601); they are read as seconds since 1970."""

_DEG = math.pi / 180
_TURN = 2 * math.pi

_TABLE: dict[str, dict[str, tuple[float, str]]] = {
    "time": {
        "s": (1.0, "s sec secs second seconds"),
        "ms": (1e-3, "ms msec millis milliseconds"),
        "us": (1e-6, "us µs μs usec micros microseconds"),
        "ns": (1e-9, "ns nsec nsecs nanos nanosec nanosecs nanoseconds"),
        DATE: (1.0, "date datetime iso iso8601"),
    },
    "acceleration": {
        "m/s^2": (1.0, "mps2 m/s^2 m/s2 m/s² m/s/s ms^-2 ms-2 m_s2 m/ss"),
        "cm/s^2": (1e-2, "cmps2 cm/s^2 cm/s2 gal"),
        "g": (STANDARD_GRAVITY, "g gs g0"),
        "mg": (STANDARD_GRAVITY * 1e-3, "mg milli-g"),
    },
    "angular rate": {
        "rad/s": (1.0, "radps rad/s rads^-1 rads-1 rad_s rads"),
        "deg/s": (_DEG, "dps degps deg/s °/s degs^-1 degs-1 deg_s º/s deg/sec"),
        "rpm": (_TURN / 60, "rpm 1/min"),
        "rev/s": (_TURN, "revps rev/s rps"),
        "counts/s": (math.nan, "countsps counts/s ticks/s tickps"),
    },
    "angle": {
        "rad": (1.0, "rad radians"),
        "deg": (_DEG, "deg ° degrees"),
        "rev": (_TURN, "rev revs turn turns rotations"),
        "counts": (math.nan, "counts count ticks tick cnt pulses"),
    },
    "length": {
        "m": (1.0, "m metre metres meter meters"),
        "cm": (1e-2, "cm"),
        "mm": (1e-3, "mm"),
    },
    "speed": {
        "m/s": (1.0, "mps m/s m_s"),
        "cm/s": (1e-2, "cmps cm/s"),
        "mm/s": (1e-3, "mmps mm/s mm_s"),
        "km/h": (1 / 3.6, "kmph km/h kph"),
    },
    "current": {
        "A": (1.0, "A amp amps ampere"),
        "mA": (1e-3, "mA milliamp"),
    },
}

_UNITS: dict[str, Unit] = {
    spelling: Unit(name, quantity, factor)
    for quantity, units in _TABLE.items()
    for name, (factor, spellings) in units.items()
    for spelling in spellings.split()
}
_FOLDED = {spelling.casefold(): unit for spelling, unit in _UNITS.items()}


def find_unit(text: str) -> Unit | None:
    """Return the unit a text names, or None: ``mps2``, ``[m s^-2]``, ``(rad/s)``, ``°/s``."""
    bare = re.sub(r"[\s\[\]()*·]", "", text)
    return _UNITS.get(bare) or _FOLDED.get(bare.casefold())


def factors(quantity: str) -> dict[str, float]:
    """Return the units of a quantity with the number of SI units that one is."""
    return {name: factor for name, (factor, _) in _TABLE[quantity].items()}


def si_unit(quantity: str) -> str:
    """Return the SI unit of a quantity."""
    return next(iter(_TABLE[quantity]))


def spellings(*quantities: str) -> str:
    """List how the units of some quantities are written, for messages."""
    names = [name for quantity in quantities for name in _TABLE[quantity]]
    return ", ".join(names)


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
    slowest: float = 0.0


SENSORS: dict[str, Sensor] = {
    "time": Sensor("clock", ("t", "t_add"), ("time",)),
    "currents": Sensor(
        "motor currents", tuple(f"cur_{wheel}" for wheel in WHEELS), ("current",),
        "current cur amps curr iq amp",
    ),
    "acceleration": Sensor(
        "accelerometer", ("imu_ax", "imu_ay", "imu_az"), ("acceleration",),
        "accelerometer acceleration accel acc a linacc force", slowest=4.0,
    ),
    "rate": Sensor(
        "gyroscope", ("imu_gx", "imu_gy", "imu_gz"), ("angular rate",),
        "gyroscope gyro gyr omega angular w rate g rot", slowest=4.0,
    ),
    "wheels": Sensor(
        "encoders", tuple(f"enc_{wheel}" for wheel in WHEELS), ("angle", "angular rate", "speed", "length"),
        "encoder enc ticks tick wheel odo pos counts count vel speed rpm", slowest=0.5,
    ),
    "command": Sensor("command", ("v_cmd",), ("speed",)),
    "reference_x": Sensor("reference", ("ref_x", "ref_y"), ("length",)),
    "reference_v": Sensor("reference", ("ref_v",), ("speed",)),
    "globe": Sensor("reference", ("ref_lat", "ref_lon"), ("angle",)),
}  # fmt: skip
"""What a log may hold. Of words the more telling ones come first. `t_add` is added to `t`, as nanoseconds
beside seconds. `ref_x` alone is a distance along the path; with `ref_y`, or as latitude and longitude, it is
a place in the plane whose path is followed."""

CHANNELS = {channel: sensor.quantities for sensor in SENSORS.values() for channel in sensor.channels}
"""Channel to the quantities that may feed it."""

ACCELERATION = SENSORS["acceleration"].channels
RATE = SENSORS["rate"].channels
ENCODERS = SENSORS["wheels"].channels
CURRENTS = SENSORS["currents"].channels
