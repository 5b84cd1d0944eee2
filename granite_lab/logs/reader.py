"""`read_trial`: one file or several to a Trial."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.canonical import trial_info
from granite_lab.logs.layouts import Binding, Log, Maps, given_maps, not_used
from granite_lab.logs.quantities import SENSORS
from granite_lab.logs.sensors.aliasing import resolve_aliases
from granite_lab.logs.sensors.doubt import Doubt, some_of
from granite_lab.logs.sensors.imu import check_units, refuse_axes, with_forward_axis
from granite_lab.logs.sensors.repeats import read_once, without_blanks, without_fill, without_held
from granite_lab.logs.sensors.stamps import doubt_gaps, gaps_in, outside_gaps
from granite_lab.logs.sensors.standstill import (
    LONGEST_GAP,
    rolls,
    standstills,
    travel_of,
    unbridged,
)
from granite_lab.logs.sensors.wheels import (
    check_currents,
    check_wheels,
    doubt_whole_rates,
    look,
    refuse_counts_and_speed,
    report_absent,
    without_free_wheels,
)
from granite_lab.logs.source import Source, read_source, recognise
from granite_lab.logs.streams import Samples, Streams, read_streams, window_in_words
from granite_lab.logs.trial import Array, ImuStream, Trial, TrialInfo, name_of, part, parts_of, sidecar
from granite_lab.parameters import Robot, load_robot
from granite_lab.parameters.catalogue import own_file

# What a trial takes as a file holds it.
_BESIDE = ("currents", "command", "tow", "reference_x", "reference_v")

# What is taken from a file that was given for one purpose.
_ROLES: dict[str, tuple[str, ...]] = {
    "imu": ("acceleration", "rate"),
    "encoders": ("wheels", "currents", "command", "tow"),
    "currents": ("currents",),
    "reference": ("reference_x", "reference_v"),
    "": ("acceleration", "rate", "wheels", *_BESIDE),
}
_STREAMS = ("imu", "wheels", *_BESIDE)

# The files of a trial, with what each was given for ("": for nothing in particular).
Files = Sequence[tuple[str, Source]]


@dataclasses.dataclass(frozen=True)
class Excerpt:
    """Which part of a log is taken.

    Attributes:
        rows: of the table, as ``run_id = 4``; None: all.
        window: begin and end [s, the log's time], infinite where open; None: from beginning to end.
    """

    rows: str | None = None
    window: tuple[float, float] | None = None


WHOLE = Excerpt()


def read_trial(
    path: str | Path,
    beside: Mapping[str, str | Path | None] | None = None,
    *,
    map: Maps = None,  # noqa: A002  # the option is called --map
    robot: str | Path | None = None,
    info: TrialInfo | None = None,
    topics: Mapping[str, str] | None = None,
    excerpt: Excerpt = WHOLE,
) -> Trial:
    """Read a trial from its log.

    Args:
        path: the log, the first of its files, or a folder with a file a sensor; it gives the trial its name.
        beside: further files by their purpose: ``imu``, ``encoders``, ``currents`` or ``reference``.
            Each counts before `path` for its sensors; the encoders' may hold motor currents and commands.
        map: column maps by name or path, or folders of them, where the layout is not recognised. Each file
            takes the one that fits it.
        robot: name or file of the robot; without it the log, then the column map says which.
        info: metadata that count before the log's.
        topics: of a bag, ``imu``, ``joints`` and ``odom`` to the name of a topic.
        excerpt: which part of the log is taken.

    Returns:
        the trial in SI, every doubt in its warnings.

    Raises:
        InputError: a file cannot be used, or its wheels do not turn in the window.
        UsageError: unknown robot or column map.
    """
    first, maps, window = Path(path), given_maps(map), excerpt.window
    given = [("", file) for file in parts_of(first) or [first]]
    others = [(role, Path(file)) for role, file in (beside or {}).items() if file is not None]
    given += [(role, file) for role, file in others if file != first]
    files: list[tuple[str, Source]] = []
    for role, file in given:
        # What is said of the whole trial goes with its first file.
        of_all = (excerpt.rows if file == first else None, None if files else sidecar(first))
        channels = [channel for kind in _ROLES[role] if role for channel in SENSORS[kind].channels]
        files.append((role, read_source(recognise(file, maps, topics, channels), *of_all)))
    for layout in given_maps(map, folders=False):
        if all(source.match.layout != layout for _, source in files):
            raise not_used(layout, [source.match for _, source in files])
    trial = assemble(first, files, robot, info, window=window)
    if window is None or trial.wheels is None:
        return trial
    if look(trial, load_robot(robot or trial.info.robot or "granite", changes=trial.info.changes)) is None:
        hint = "granite-lab inspect --plot FILE.png shows when they do; choose --from and --to around it"
        raise InputError(f"{first}: no motion {window_in_words(window)}: the wheels do not turn there", hint)
    return trial


def assemble(
    path: Path,
    files: Files,
    robot: str | Path | None = None,
    info: TrialInfo | None = None,
    *,
    whole: bool = True,
    window: tuple[float, float] | None = None,
) -> Trial:
    """Turn the files of a trial into a Trial; of a `window`, only its samples are taken.

    With `whole`, a trial must hold an IMU or encoders, and sensors that lie are refused.

    Raises:
        InputError: the samples cannot be used.
        UsageError: unknown robot.
    """
    doubts: list[Doubt] = []
    sources = [source for _, source in files]
    name, the_robot = _robot(sources, robot, info, doubts)
    streams, columns = _merge(files, [read_streams(source, the_robot, window) for source in sources])
    doubts += [doubt for source in sources for doubt in source.doubts]
    log = Log(
        the_robot, str(path), columns, doubts, {k: u for s in reversed(sources) for k, u in s.units.items()}
    )
    metadata = [
        s.metadata | {"soil": own_file("soils", s.metadata.get("soil", ""), s.path.parent)} for s in sources
    ]
    imu, wheels, clean = _imu(streams, path, doubts), streams.get("wheels"), None
    if imu is not None:
        imu, clean = check_units(with_forward_axis(imu, log) if whole else imu, log)
    if wheels is not None:
        report_absent(log)
        wheels = check_wheels(resolve_aliases(wheels, imu, log), imu, log)
    beside: dict[str, Any] = {kind: streams.get(kind) for kind in _BESIDE}
    trial = Trial(
        name=name_of(path),
        info=trial_info(metadata, info, name),
        imu=imu,
        wheels=wheels,
        **beside,
        inputs=tuple(dict.fromkeys(file for source in sources for file in source.inputs)),
        layout=" + ".join(dict.fromkeys(source.match.layout.name for source in sources)),
        units=log.units,
    )
    trial = _checked(trial, clean, log) if whole else trial
    doubts += _across(trial)
    if whole and window is None:
        _refuse_rests_outside(trial, log)
    trial = _longest_stretch(trial, the_robot, doubts) if whole else trial
    return dataclasses.replace(trial, doubts=tuple(dict.fromkeys(doubts)))


def _checked(trial: Trial, clean: ImuStream | None, log: Log) -> Trial:
    """Refuse columns that cannot be what they are called; `clean` is the IMU without spikes."""
    imu, wheels, currents = trial.imu, trial.wheels, trial.currents
    if clean is None and wheels is None:
        hint = "a trial needs at least one of them; a column map (inspect --write-map) names columns"
        raise InputError(f"{log.where}: neither IMU nor encoder samples", hint)
    if wheels is not None:
        called = tuple(channel for channel in log.columns if channel.startswith("imu_"))
        if clean is None and called:
            raise log.refuse(called, ": every cell is empty, expected an IMU's samples")
        refuse_counts_and_speed(wheels, log)
        doubt_whole_rates(wheels, log)
        angle = wheels.angle[np.isfinite(wheels.angle)]
        if clean is not None and len(clean.t) > 100 and len(angle) and np.ptp(angle) > 1.0:
            still = standstills(dataclasses.replace(trial, imu=clean), log.robot)
            rolling = rolls(travel_of(wheels, log.robot), clean.t)
            refuse_axes(clean, still, rolling, log)
            if imu is not None:
                imu = without_held(imu, rolling, log.doubts)
        wheels = without_free_wheels(wheels, log)
    currents = None if currents is None else check_currents(currents, trial.wheels, log)
    return dataclasses.replace(trial, imu=imu, wheels=wheels, currents=currents)


def _robot(
    sources: Sequence[Source], given: str | Path | None, info: TrialInfo | None, doubts: list[Doubt]
) -> tuple[str | None, Robot]:
    """Return the robot of the log: as given, else as the log says, else granite."""
    named = [own_file("robots", s.metadata.get("robot", ""), s.path.parent) for s in sources]
    named += [source.match.layout.robot for source in sources]
    changes = info.changes if info else ()
    chosen = given or (info.robot if info else None) or next(filter(None, named), None)
    if chosen:
        return str(chosen), load_robot(str(chosen), changes=changes)
    doubts.append(Doubt("the log does not name its robot", remedy="taken as 'granite'"))
    return None, load_robot("granite", changes=changes)


def _merge(files: Files, parts: Sequence[Streams]) -> tuple[Streams, dict[str, Binding]]:
    """Take each sensor from the file that was given for it, else from the first file that has it."""
    merged = Streams()
    columns = {b.channel: b for _, s in reversed(files) for b in reversed(s.match.bindings)}
    for (role, source), streams in zip(files, parts, strict=True):
        kinds = [kind for kind in _ROLES[role] if kind in streams]
        if role and not kinds:
            hint = f"its layout was taken as '{source.match.layout.name}'"
            raise source.refuse(f"given as --{role}, but nothing in it is of that kind", hint)
        for kind in kinds:
            before, found = merged.get(kind), streams[kind]
            # An acceleration with gravity in it is worth more than one without.
            better = (
                kind == "acceleration" and before and before.gravity_removed and not found.gravity_removed
            )
            if role or better or before is None:
                merged[kind] = found
                columns |= {b.channel: b for b in reversed(source.bindings(*SENSORS[kind].channels))}
    return merged, columns


def _imu(streams: Streams, path: Path, doubts: list[Doubt]) -> ImuStream | None:
    """Put accelerometer and gyroscope on common stamps."""
    names = {"accelerometer": "acceleration", "gyroscope": "rate"}
    sensors: dict[str, Samples | None] = {name: streams.get(kind) for name, kind in names.items()}
    present = {name: samples for name, samples in sensors.items() if samples is not None}
    if not present:
        return None
    for name, samples in sensors.items():
        if samples is None:
            doubts.append(Doubt(f"no {name} in the log"))
        elif absent := [axis for axis, v in zip("xyz", samples.values.T, strict=True) if np.isnan(v).all()]:
            doubts.append(Doubt(f"no axis {', '.join(absent)} in the log", name))
    acc, gyro = (sensors[name] or next(iter(present.values())) for name in sensors)
    both, a, g = np.intersect1d(acc.t, gyro.t, assume_unique=True, return_indices=True)
    if len(both) > 0.5 * min(len(acc.t), len(gyro.t)):
        t, force, rate = both, acc.values[a], gyro.values[g]
    else:
        inside = (acc.t >= gyro.t[0]) & (acc.t <= gyro.t[-1])
        if np.count_nonzero(inside) < 2:
            raise _nothing_in_common(path, "accelerometer", acc.t, "gyroscope", gyro.t)
        apart = "the gyroscope has stamps of its own"
        doubts.append(Doubt(apart, remedy="interpolated to the accelerometer's"))
        inside &= outside_gaps(acc.t, gyro.t)
        t, force = acc.t[inside], acc.values[inside]
        rate = np.column_stack([np.interp(t, gyro.t, column) for column in gyro.values.T])
    force = force if "accelerometer" in present else np.full_like(force, np.nan)
    rate = rate if "gyroscope" in present else np.full_like(rate, np.nan)
    late = max(acc.std, gyro.std)
    imu = ImuStream(t, force, rate, acc.gravity_removed, stamp_std=late)
    return without_fill(read_once(without_blanks(imu, doubts), doubts), doubts)


def _nothing_in_common(path: Path, name: str, t: Array, other: str, s: Array) -> InputError:
    """Return the error of two sensors that were never logged at the same time."""
    first, second = (f"({x[0]:.3f} to {x[-1]:.3f} s)" for x in (t, s))
    hint = "both need stamps of the same clock; correct one in its file or choose another time column"
    return InputError(f"{path}: {name} {first} and {other} {second} have no time in common", hint)


def _across(trial: Trial) -> list[Doubt]:
    """Return doubts about gaps and about sensors that hardly overlap; with no time in common, refuse them."""
    streams = {"IMU": trial.imu, "encoders": trial.wheels, "motor currents": trial.currents}
    stamps = {name: stream.t for name, stream in streams.items() if stream is not None}
    doubts = [doubt for name, t in stamps.items() if (doubt := doubt_gaps(t, name))]
    first, base = next(iter(stamps.items()), ("", np.zeros(0)))
    for name, t in list(stamps.items())[1:]:
        shared = min(t[-1], base[-1]) - max(t[0], base[0])
        if shared <= 0:
            raise _nothing_in_common(trial.inputs[0].path, first, base, name, t)
        if shared < 0.5 * min(np.ptp(t), np.ptp(base)):
            doubts.append(Doubt(f"{first} and {name} have only {shared:.2f} s in common"))
    return doubts


def _refuse_rests_outside(trial: Trial, log: Log) -> None:
    """Refuse standstills named by hand in which nothing was logged: their stamps are not the log's."""
    logged = [stream.t for stream in (trial.imu, trial.wheels) if stream is not None]
    first, last = (float(end) for end in (min(t[0] for t in logged), max(t[-1] for t in logged)))
    for begin, end in (*trial.info.rests, *trial.info.body_rests):
        if end <= first or begin >= last:
            raise InputError(
                f"{log.where}: the standstill named from {begin:g} s to {end:g} s lies outside of the log, "
                f"{first:.2f} s to {last:.2f} s",
                "standstills are in the log's time, as granite-lab inspect lists them",
            )


def _longest_stretch(trial: Trial, robot: Robot, doubts: list[Doubt]) -> Trial:
    """Cut a trial at gaps in its IMU that are too long to bridge; keep the longest stretch with a rest."""
    if trial.imu is None:
        return trial
    t, gaps = trial.imu.t, gaps_in(trial.imu.t, LONGEST_GAP)
    still = standstills(trial, robot) if gaps else []
    wheels = travel_of(trial.wheels, robot) if trial.wheels is not None and trial.wheels.t.size > 2 else None
    gaps = unbridged(gaps, still, wheels)
    if not gaps:
        return trial
    stretches = zip([float(t[0]), *(b for _, b in gaps)], [*(a for a, _ in gaps), float(t[-1])], strict=True)

    def worth(stretch: tuple[float, float]) -> tuple[bool, float]:
        resting = any(min(end, stretch[1]) - max(begin, stretch[0]) > LONGEST_GAP for begin, end in still)
        return resting, stretch[1] - stretch[0]

    begin, end = max(stretches, key=worth)
    missing = some_of([f"{a:.3f} to {b:.3f} s" for a, b in gaps], 3)
    used = (
        f"the log is cut there and only its longest stretch with a rest is used, {begin:.3f} to {end:.3f} s"
    )
    lost = f"no IMU samples while the robot moved: {missing}"
    doubts.append(Doubt(lost, remedy=f"{used}; --from and --to choose another"))
    logged = {name: stream for name in _STREAMS if (stream := getattr(trial, name)) is not None}
    inside = {name: (stream.t >= begin) & (stream.t <= end) for name, stream in logged.items()}
    kept: dict[str, Any] = dict.fromkeys(_STREAMS)  # hardly any sample is none
    kept |= {name: part(logged[name], keep) for name, keep in inside.items() if np.count_nonzero(keep) > 1}
    return dataclasses.replace(trial, **kept)
