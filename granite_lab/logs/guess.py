"""What the columns of an unknown log seem to be, from their names and their values."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.logs.layouts import ACCELERATION, CHANNELS, ENCODERS, RATE
from granite_lab.logs.trial import Array
from granite_lab.logs.units import DATE, STANDARD_GRAVITY, Unit, find_unit


@dataclass(frozen=True)
class Guess:
    """What a column seems to be.

    Attributes:
        name: of the column.
        to: channels it may feed; none: not recognised.
        unit: its unit.
        confidence: 0 to 1.
        why: in a few words.
        assumed: nothing in the name says the unit.
    """

    name: str
    to: tuple[str, ...]
    unit: str
    confidence: float
    why: str
    assumed: bool = True


_WHEELS = {
    "fl": ("fl", "leftfront", "frontleft", "lf", "1"),
    "fr": ("fr", "rightfront", "frontright", "rf", "2"),
    "rl": ("rl", "bl", "leftrear", "rearleft", "backleft", "leftback", "lr", "lb", "3"),
    "rr": ("rr", "br", "rightrear", "rearright", "backright", "rightback", "rb", "4"),
}
_SIDES = {"left": ("fl", "rl"), "l": ("fl", "rl"), "right": ("fr", "rr"), "r": ("fr", "rr")}
_TIME = ("time", "timestamp", "stamp", "t", "seconds", "millis", "micros", "sec", "clock", "ts")
_KINDS = {  # order matters: the more telling words first
    "cur": ("current", "cur", "amps", "curr", "iq", "amp"),
    "a": ("accelerometer", "acceleration", "accel", "acc", "a", "linacc", "force"),
    "g": ("gyroscope", "gyro", "gyr", "omega", "angular", "w", "rate", "g", "rot"),
    "enc": ("encoder", "enc", "ticks", "tick", "wheel", "odo", "pos", "counts", "count", "vel", "speed"),
}
_COMMAND = ("cmd", "command", "desired", "setpoint", "setspeed", "target")
_REFERENCE = ("ref", "mocap", "vicon", "optitrack", "gps", "truth", "groundtruth")
_DEFAULT = {
    "t": "s",
    "a": "m/s^2",
    "g": "rad/s",
    "cur": "A",
    "enc": "rad",
    "v_cmd": "m/s",
    "ref_v": "m/s",
    "ref_x": "m",
}


def words(name: str) -> tuple[list[str], str]:
    """Split a column's name into words and the unit it may end in: ``gyrX (°/s)``, ``accel_x_g``."""
    unit = ""
    inside = re.search(r"[\[(]([^\])]*)[\])]\s*$", name)
    if inside and find_unit(inside.group(1)):
        unit, name = inside.group(1), name[: inside.start()]
    else:
        parts = name.split("_")
        for count in (2, 1):
            tail = "_".join(parts[-count:])
            if len(parts) > count and find_unit(tail) and tail not in ("a", "g", "m", "s"):
                unit, name = tail, "_".join(parts[:-count])
                break
        else:
            # A single letter is a unit only where something else already says what is measured.
            if len(parts) > 1 and parts[-1] in ("g", "s", "m", "A"):
                unit, name = parts[-1], "_".join(parts[:-1])
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|(?<=\d)(?=[A-Za-z])", " ", name)
    return [w for w in re.split(r"[^A-Za-z0-9]+", spaced.lower()) if w], unit


def by_name(name: str) -> Guess | None:
    """Guess from the name alone."""
    parts, unit_text = words(name)
    unit = find_unit(unit_text) if unit_text else None
    joined = "".join(parts)
    if any(word in parts for word in _COMMAND):
        return _checked(name, ("v_cmd",), unit, "v_cmd", 0.7)
    if any(word in parts for word in _REFERENCE):
        speed = (unit is not None and unit.quantity == "speed") or "v" in parts or "vel" in parts
        return _checked(name, ("ref_v",) if speed else ("ref_x",), unit, "ref_v" if speed else "ref_x", 0.5)
    wheels = _wheels(parts, joined)
    for kind, hints in _KINDS.items():
        # `ax`, `gyrx`, `accz`: the axis may hang on to the word.
        axis = next((a for a in "xyz" if a in parts or any(joined.endswith(h + a) for h in hints)), "")
        named = any(h in parts or (axis and h + axis in parts) or (len(h) > 2 and h in joined) for h in hints)
        if not named:
            continue
        if kind in ("a", "g") and axis:
            return _checked(name, (f"imu_{kind}{axis}",), unit, kind, 0.9)
        if kind in ("cur", "enc") and wheels:
            return _checked(name, tuple(f"{kind}_{w}" for w in wheels), unit, kind, 0.8)
    if parts and (parts[0] in _TIME or parts[-1] in _TIME):
        return _checked(name, ("t",), unit, "t", 0.9)
    return None


def _wheels(parts: Sequence[str], joined: str) -> tuple[str, ...]:
    """Return the wheels a name speaks of."""
    for wheel, hints in _WHEELS.items():
        if any(h in parts or (len(h) > 2 and h in joined) for h in hints):
            return (wheel,)
    for side, wheels in _SIDES.items():
        if side in parts or (len(side) > 1 and side in joined):
            return wheels
    return ()


def _checked(name: str, to: tuple[str, ...], unit: Unit | None, kind: str, confidence: float) -> Guess:
    """Make a guess; a unit of the wrong quantity lowers the confidence."""
    fits = unit is not None and unit.quantity in CHANNELS[to[0]]
    if unit is not None and fits:
        return Guess(name, to, unit.name, min(confidence + 0.1, 0.98), "name and unit in it", assumed=False)
    return Guess(name, to, _DEFAULT[kind], confidence * (0.6 if unit else 0.9), "name; unit assumed")


def guess(columns: Mapping[str, Array], dates: Sequence[str] = ()) -> list[Guess]:
    """Guess what each column of a log is.

    Args:
        columns: name to (N,) values, NaN where empty.
        dates: names of columns that are written as dates; their values are seconds since 1970.

    Returns:
        one guess a column, in their order.
    """
    found = {name: by_name(name) or Guess(name, (), "", 0.0, "not recognised") for name in columns}
    for name in dates:
        fine = bool((np.diff(columns[name]) != 0).mean() > 0.5) if len(columns[name]) > 1 else False
        found[name] = Guess(name, ("t",), DATE, 0.95 if fine else 0.3, "dates", assumed=False)
    _seconds_and_parts(found, columns)
    _first_only(found)
    _time(found, columns)
    _triples(found, columns)
    _encoders(found, columns)
    return [found[name] for name in columns]


_SECONDS = re.compile(r"(?P<stem>(?:.*[^A-Za-z])?)s(?:ec(?:ond)?s?)?[\])]?", re.IGNORECASE)
_PARTS = re.compile(
    r"(?P<stem>(?:.*[^A-Za-z])?)(?P<unit>n|nano|u|micro|m|milli)s?(?:ec(?:ond)?s?)?[\])]?", re.IGNORECASE
)
_A_SECOND = {"n": ("ns", 1e9), "u": ("us", 1e6), "mic": ("us", 1e6), "m": ("ms", 1e3), "mil": ("ms", 1e3)}


def _seconds_and_parts(found: dict[str, Guess], columns: Mapping[str, Array]) -> None:
    """Find whole seconds and the parts of a second in two columns: ``stamp.secs``, ``stamp.nsecs``."""
    for part, values in columns.items():
        hit = _PARTS.fullmatch(part.strip())
        if hit is None:
            continue
        said = hit["unit"].lower()
        unit, size = _A_SECOND.get(said[:3]) or _A_SECOND[said[0]]
        for whole, seconds in columns.items():
            other = _SECONDS.fullmatch(whole.strip())
            if other is None or other["stem"].lower() != hit["stem"].lower():
                continue
            seen = np.isfinite(values) & np.isfinite(seconds)
            s, p = seconds[seen], values[seen]
            if len(s) < 6 or (s != np.rint(s)).any() or (p < 0).any() or (p >= size).any():
                continue
            # The parts start again just where the seconds go on, and only there.
            if (
                (np.diff(s) > 0).any()
                and (np.diff(s + p / size) >= 0).mean() > 0.98
                and np.ptp(p) > 0.5 * size
            ):
                why = f"with '{part}': whole seconds and their parts"
                found[whole] = Guess(whole, ("t",), "s", 0.98, why, assumed=False)
                why = f"part of a second, belongs to '{whole}'"
                found[part] = Guess(part, ("t_add",), unit, 0.98, why, assumed=False)
                return


def _first_only(found: dict[str, Guess]) -> None:
    """Let each channel keep its surest column."""
    taken: dict[str, str] = {}
    for name, one in sorted(found.items(), key=lambda item: -item[1].confidence):
        if any(channel in taken for channel in one.to):
            rival = taken[next(channel for channel in one.to if channel in taken)]
            found[name] = Guess(name, (), "", 0.0, f"'{rival}' seems to be the same")
        else:
            taken.update(dict.fromkeys(one.to, name))


def _time(found: dict[str, Guess], columns: Mapping[str, Array]) -> None:
    """Find a clock by its values, if no name says so, and its unit by the rate."""
    clocks = [name for name, one in found.items() if one.to == ("t",)]
    if not clocks:
        for name, values in columns.items():
            steps = np.diff(values[np.isfinite(values)])
            # A clock ticks about evenly and never back.
            if len(steps) > 5 and (steps >= 0).mean() > 0.98 and np.median(steps) > 0:
                spread = np.quantile(steps, 0.9) / np.median(steps)
                if spread < 3 and (not found[name].to or spread < 1.5):
                    clocks = [name]
                    found[name] = Guess(name, ("t",), "s", 0.6, "increases evenly")
                    break
    for name in clocks:
        values = columns[name][np.isfinite(columns[name])]
        steps = np.diff(values)
        period = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        one = found[name]
        if period == 0 or not one.assumed:
            continue
        fits = [
            u
            for u, f in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
            if 4 <= 1 / (period * f) <= 4000
        ]
        if fits:
            found[name] = Guess(name, ("t",), fits[0], one.confidence, f"{one.why}; unit by the rate")


def _triples(found: dict[str, Guess], columns: Mapping[str, Array]) -> None:
    """Find an accelerometer by gravity, and set its unit and the gyroscope's by the values."""
    names = {channel: name for name, one in found.items() for channel in one.to}
    if not any(channel in names for channel in ACCELERATION):
        free = [name for name, one in found.items() if not one.to]
        for trio in zip(free, free[1:], free[2:], strict=False):
            scale = _gravity_unit(np.column_stack([columns[name] for name in trio]))
            if scale:
                for name, channel in zip(trio, ACCELERATION, strict=True):
                    found[name] = Guess(name, (channel,), scale, 0.5, "three columns that add up to gravity")
                break
    elif all(channel in names for channel in ACCELERATION):
        trio_names = [names[channel] for channel in ACCELERATION]
        scale = _gravity_unit(np.column_stack([columns[name] for name in trio_names]))
        for name in trio_names:
            one = found[name]
            if scale and scale != one.unit and one.assumed:
                found[name] = Guess(name, one.to, scale, one.confidence, "name; unit by gravity")
    for channel in RATE:
        if channel in names:
            name = names[channel]
            peak = float(np.nanmax(np.abs(columns[name]), initial=0.0))
            if found[name].unit == "rad/s" and found[name].assumed and peak > 20:
                found[name] = Guess(
                    name, (channel,), "deg/s", found[name].confidence, "name; too fast for rad/s"
                )


def _gravity_unit(values: Array) -> str:
    """Return the unit in which the vector is gravity most of the time."""
    whole = values[np.isfinite(values).all(axis=1)]
    if len(whole) < 5:
        return ""
    norm = float(np.median(np.linalg.norm(whole, axis=1)))
    for unit, size in (("m/s^2", STANDARD_GRAVITY), ("g", 1.0), ("mg", 1000.0)):
        if abs(norm / size - 1) < 0.1:
            return unit
    return ""


def _encoders(found: dict[str, Guess], columns: Mapping[str, Array]) -> None:
    """Tell counts, angles, rates and velocities of wheels apart by their values."""
    for name, one in found.items():
        if not one.to or one.to[0] not in ENCODERS or not one.assumed:
            continue
        values = columns[name][np.isfinite(columns[name])]
        if len(values) < 5:
            continue
        parts, _ = words(name)
        rate = any(word in parts for word in ("vel", "speed", "rate", "v", "rpm"))
        if rate:
            unit = "rad/s" if np.abs(values).max() > 3 else "m/s"
        else:
            unit = "counts" if (values == np.rint(values)).all() and np.ptp(values) > 20 else "rad"
        found[name] = Guess(name, one.to, unit, one.confidence * 0.9, "name; unit by the values")
