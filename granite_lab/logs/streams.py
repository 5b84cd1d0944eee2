"""The sensors in one file: rows of a table to streams with their own stamps, in SI."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.counters import Mask, integral, runs
from granite_lab.logs.layouts import Binding
from granite_lab.logs.quantities import ENCODERS, SENSORS
from granite_lab.logs.sensors.clock import one_line, row_stamps, sampled
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.encoders import Wheel, convert
from granite_lab.logs.sensors.stamps import tidy
from granite_lab.logs.source import Source
from granite_lab.logs.trial import Array, CurrentStream, Series, WheelStream, is_bag, part
from granite_lab.parameters import Robot

WINDOW = 5  # samples through which a line is laid to get a speed
_MANY = 100  # an axis that is zero in fewer samples than these may just be at rest
_A, _E2 = 6378137.0, 6.69437999014e-3  # semi-major axis [m] and squared eccentricity of WGS 84

# What a file may hold besides its clock.
_TIMED = ("acceleration", "rate", "wheels")  # of which the estimate needs each sample's time
_OUTSIDE = ("globe", "reference_x", "reference_v")
_KINDS = (*_TIMED, "currents", "command", "tow", *_OUTSIDE)


class Samples(NamedTuple):
    """Stamps (N,) [s] and values (N, K), and by how much all stamps may be off [s]."""

    t: Array
    values: Array
    std: float = 0.0
    gravity_removed: bool = False  # the logger took gravity out of an acceleration


Streams = dict[str, Any]
"""What one file, or all files of a trial, hold, by the kind of sensor. `acceleration` and `rate` of the IMU
are `Samples`, still apart, for their stamps may differ; the others are as in a `Trial`."""


def read_streams(source: Source, robot: Robot, window: tuple[float, float] | None) -> Streams:
    """Turn the columns of a file into streams; of a window [s, the log's time], only its samples are taken.

    The robot gives wheel radius and counts per revolution where units need them. What had to be done is added
    to the source's doubts; clock, samples or units that cannot be used are refused.
    """
    t = row_stamps(source)
    if window is not None:
        with suppress(InputError):  # a step of the clock outside the window does not matter
            t = one_line(source, t)[0]
        inside = (t >= window[0]) & (t <= window[1])
        if not inside.any():
            runs_from = f"the log runs from {np.nanmin(t):.10g} to {np.nanmax(t):.10g} s"
            hint = "--from and --to are seconds of the log's own time, as granite-lab inspect shows it"
            raise source.refuse(f"no sample {window_in_words(window)}, {runs_from}", hint)
        source, t = source.only(inside), t[inside]
    t, doubts = one_line(source, t)
    source.doubts.extend(doubts)
    streams, by_stamps = Streams(), dict[Doubt, list[str]]()
    for kind in _KINDS:
        samples = _samples(source, t, kind, by_stamps)
        if samples is not None and kind in ("acceleration", "rate"):
            samples = _complete(source, samples, kind)
        if samples is None:
            continue
        if kind == "wheels":
            streams[kind] = _wheels(source, samples, robot)
        elif kind == "currents":
            streams[kind] = CurrentStream(samples.t, samples.values)
        elif kind in ("command", "tow"):
            streams[kind] = _series(samples)
        else:
            streams[kind] = samples
    source.doubts.extend(d.of(f"{source.path.name}: {', '.join(names)}") for d, names in by_stamps.items())
    outside = [streams.pop(kind, None) for kind in _OUTSIDE]
    return streams | _reference(source, *outside)


def _series(samples: Samples) -> Series:
    return Series(samples.t, samples.values[:, 0])


def window_in_words(window: tuple[float, float]) -> str:
    """Return a window in words: ``between 2 and 9 s``, ``after 2 s``, ``before 9 s``."""
    start, end = (f"{x:.10g}" for x in window)
    if math.isinf(window[0]):
        return f"before {end} s"
    return f"after {start} s" if math.isinf(window[1]) else f"between {start} and {end} s"


def _samples(source: Source, t: Array, kind: str, by_stamps: dict[Doubt, list[str]]) -> Samples | None:
    """Return the samples of a sensor in the order of time, NaN for what was not logged.

    Encoders stay in the file's units, for a wrap is a number of counts. Doubts about stamps are added to
    `by_stamps`, each with the sensors that it is about.
    """
    name, channels = SENSORS[kind].name, SENSORS[kind].channels
    bindings = source.bindings(*channels)
    if not bindings:
        return None
    places = np.flatnonzero(sampled(source, channels))
    if len(places) == 0:
        source.doubt("all cells are empty", name)
        return None
    values = np.full((len(places), len(channels)), np.nan)
    for binding in bindings:
        column = source.columns[binding.place][places]
        if kind != "wheels":
            column = column * binding.factor
            column = np.nancumsum(column) if binding.spec.increment else column
        values[:, channels.index(binding.channel)] = column
    doubts: list[Doubt] = []

    def where(row: int) -> str:
        return source.place(int(places[row]))

    try:
        stamps = tidy(t[places], values, name, where, doubts)
    except InputError:
        if kind in _TIMED:
            raise
        doubts.clear()
        stamps = tidy(t[places], values, name, where, doubts, spread=False)
    for doubt in doubts:
        by_stamps.setdefault(doubt, []).append(name)
    removed = source.match.layout.gravity_removed or bool(source.metadata.get("imu_gravity_removed"))
    return Samples(stamps.t, values[stamps.rows], stamps.std, kind == "acceleration" and removed)


def _complete(source: Source, samples: Samples, kind: str) -> Samples | None:
    """Return the samples of a sensor of the IMU that hold all axes that it measures.

    An axis that is zero from beginning to end is not measured: so messages of ROS say it. A sample in which
    an axis is missing that is logged elsewhere is left out.
    """
    name, channels, t, values = SENSORS[kind].name, SENSORS[kind].channels, samples.t, samples.values
    idle = [k for k, axis in enumerate(values.T) if (axis == 0).all()]
    if len(t) >= _MANY and idle and (kind != "acceleration" or len(idle) == len(channels)):
        columns = ", ".join(f"'{source.bindings(channels[k])[0].name}'" for k in idle)
        # messages of ROS have places for more than a sensor measures
        dead = not is_bag(source.path)
        source.doubt("every sample is 0", f"{name}: {columns}", "taken as not measured", dead=dead)
        if len(idle) == len(channels):
            return None
        values = values.copy()
        values[:, idle] = np.nan
    logged = np.isfinite(values).any(axis=0)
    holes = np.asarray(np.isnan(values[:, logged]).any(axis=1))
    count = int(np.count_nonzero(holes))
    if count == 0:
        return samples._replace(values=values)
    if len(t) - count < 2:
        few = f"{len(t) - count} samples have all their axes, expected at least two"
        raise source.refuse(f"{name}: {few}", "the axes of a sensor belong in one row")
    first, last = _longest(holes, t)
    axis = source.bindings(channels[int(np.flatnonzero(logged & np.isnan(values[first]))[0])])[0].name
    stretch = f"the longest stretch from t = {t[first]:.3f} s to {t[last]:.3f} s"
    source.doubt(f"{count} samples without '{axis}' were left out, {stretch}", name)
    return samples._replace(t=t[~holes], values=values[~holes])


def _longest(flags: Mask, t: Array) -> tuple[int, int]:
    """Return the first and last sample of the stretch of flags that lasts longest."""
    return max(((begin, end - 1) for begin, end in runs(flags)), key=lambda run: t[run[1]] - t[run[0]])


def _wheels(source: Source, samples: Samples, robot: Robot) -> WheelStream:
    """Return wheel angles and rates."""
    angle, rate = (np.full(samples.values.shape, np.nan) for _ in range(2))
    resolution, spans = [0.0] * len(ENCODERS), [0.0] * len(ENCODERS)
    for binding in source.bindings(*ENCODERS):
        column = f"column '{binding.name}'"
        wheel = ENCODERS.index(binding.channel)
        raw = samples.values[:, wheel]
        seen = np.isfinite(raw)
        if not seen.any():
            source.doubt(f"{column} is empty", remedy="that wheel is taken as without encoder")
            continue
        limits = Wheel.of(robot, _counts(source, binding, robot))
        doubts: list[Doubt] = []
        try:
            decoded = convert(samples.t[seen], raw[seen], binding.unit, binding.spec, limits, doubts)
        except InputError as error:
            raise source.refuse(f"{column}: {error.message}", error.hint) from None
        angle[seen, wheel], resolution[wheel], spans[wheel] = decoded.angle, decoded.resolution, decoded.span
        rate[seen, wheel] = np.nan if decoded.rate is None else decoded.rate
        source.doubts.extend(doubt.of(f"{source.path.name}: {column}") for doubt in doubts)
        if not seen.all():
            first, last = _longest(~seen, samples.t)
            begin, end = samples.t[first], samples.t[last]
            # In a log where each wheel has rows of its own, holes are the rule and short.
            if end - begin > 0.1 and (last - first) > 0.02 * len(seen):
                source.doubt(f"no sample from t = {begin:.3f} s to {end:.3f} s", column)
    rates = np.isfinite(rate).any()
    if stated := source.metadata.get("enc_step_radps" if rates else "enc_step_rad"):
        resolution = [stated] * len(ENCODERS)
    wheels = WheelStream(
        samples.t, angle, rate if rates else None, tuple(resolution), tuple(spans), stamp_std=samples.std
    )
    known = np.isfinite(angle).any(axis=1)
    return wheels if known.all() else part(wheels, known)


def _counts(source: Source, binding: Binding, robot: Robot) -> float:
    """Return the counts per wheel revolution: of the log, the column map, or the robot."""
    counts: float = binding.spec.counts_per_rev or robot.encoders.counts
    counts = source.metadata.get("enc_counts", counts)
    if binding.unit.name.startswith("counts") and not counts:
        hint = "give '# enc_counts_per_rev = …' in the log, or counts_per_rev in the robot's file or map"
        raise source.refuse(f"column '{binding.name}': counts per wheel revolution are not known", hint)
    return counts


def _reference(
    source: Source, globe: Samples | None, plane: Samples | None, speed: Samples | None
) -> dict[str, Series]:
    """Return the external reference as distance and speed along the path."""
    place, path = globe or (plane if source.bindings("ref_y") else None), dict[str, Series]()
    if place is not None:
        whole = np.isfinite(place.values).all(axis=1)
        if np.count_nonzero(whole) < 2:
            source.doubt("reference: no two places with both coordinates")
            return {}
        stamps, (x, y) = place.t[whole], place.values[whole].T
        if globe is not None:
            x, y = _metres(latitude=x, longitude=y)
        # Speed over a few samples in each direction: the noise of places at rest adds up to no distance.
        speeds = np.hypot(slope_of_line(stamps, x), slope_of_line(stamps, y))
        way, along = (Series(stamps, s, WINDOW) for s in (integral(stamps, speeds), speeds))
        path = {"reference_x": way, "reference_v": along}
    elif plane is not None:
        path["reference_x"] = way = _series(plane)
        if len(plane.t) > WINDOW:
            path["reference_v"] = Series(way.t, slope_of_line(way.t, way.value), WINDOW)
    return path if speed is None else path | {"reference_v": _series(speed)}


def slope_of_line(t: Array, x: Array) -> Array:
    """Return the slope (N,) of a line through `WINDOW` neighbouring samples.

    Of values (N,) at stamps (N,) [s]; at the ends the last sample counts again.
    """
    half = WINDOW // 2
    weights = np.arange(half, -half - 1, -1)
    rise, run = (np.convolve(np.pad(values, half, "edge"), weights, "valid") for values in (x, t))
    return np.asarray(rise / run)


def _metres(latitude: Array, longitude: Array) -> tuple[Array, Array]:
    """Return [m] east and north of the first place, from (N,) [rad] by WGS 84, in an area of some kilometres.

    Source: radii of curvature of the ellipsoid in the meridian and the prime vertical.
    """
    w = 1 - _E2 * np.sin(latitude[0]) ** 2
    meridian, vertical = _A * (1 - _E2) / w**1.5, _A / np.sqrt(w)
    return (longitude - longitude[0]) * vertical * np.cos(latitude[0]), (latitude - latitude[0]) * meridian
