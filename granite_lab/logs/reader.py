"""`read_trial`: one file or several to a Trial."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from granite_lab.errors import InputError
from granite_lab.logs.clocks import describe_gaps
from granite_lab.logs.lies import check_sensors
from granite_lab.logs.metadata import fill, trial_info
from granite_lab.logs.named import name_of
from granite_lab.logs.plausibility import check_imu
from granite_lab.logs.source import Source
from granite_lab.logs.sources import given_maps, open_source, refuse_unused
from granite_lab.logs.streams import Parts, Samples, interval, read_streams
from granite_lab.logs.stretches import look
from granite_lab.logs.trial import Array, ImuStream, InputFile, Trial, TrialInfo
from granite_lab.logs.wheelcheck import check_wheels
from granite_lab.parameters import Robot, load_robot

_ROLES: dict[str, tuple[str, ...]] = {
    "imu": ("acceleration", "rate"),
    "encoders": ("wheels", "currents", "command"),
    "currents": ("currents",),
    "reference": ("reference_x", "reference_v"),
}
"""What is taken from a file that was given for one purpose."""

Maps = str | Path | Sequence[str | Path] | None


def read_trial(
    path: str | Path,
    *,
    imu: str | Path | None = None,
    encoders: str | Path | None = None,
    currents: str | Path | None = None,
    reference: str | Path | None = None,
    map: Maps = None,  # noqa: A002  # the option is called --map
    robot: str | Path | None = None,
    info: TrialInfo | None = None,
    rows: str | None = None,
    topics: Mapping[str, str] | None = None,
    window: tuple[float, float] | None = None,
) -> Trial:
    """Read a trial from its log.

    Args:
        path: the log, or the first of its files; it gives the trial its name.
        imu, encoders, currents, reference: further files; each counts before `path` for its sensors.
            Motor currents and commands may stand in the encoders' file.
        map: column maps by name or path, where the layout is not recognised. Each file takes the one
            that fits it.
        robot: name or file of the robot; without it the log, then the column map says which.
        info: metadata that count before the log's.
        rows: which rows to take, as ``run_id = 4``.
        topics: of a bag, ``imu``, ``joints`` and ``odom`` to the name of a topic.
        window: begin and end [s, the log's time] of what is taken, infinite where open.

    Returns:
        the trial in SI, every doubt in its warnings.

    Raises:
        InputError: a file cannot be used, or its wheels do not turn in the window.
        UsageError: unknown robot or column map.
    """
    first = Path(path)
    maps = given_maps(map)
    extra = {"imu": imu, "encoders": encoders, "currents": currents, "reference": reference}
    sources = {"": open_source(first, maps, rows, topics)}
    for role, other in extra.items():
        if other is not None and Path(other) != first:
            sources[role] = open_source(Path(other), maps, None, topics)
    refuse_unused(list(sources.values()), maps)
    trial = assemble(sources, robot, info, window=window)
    if window is None or trial.wheels is None:
        return trial
    if look(trial, load_robot(robot or trial.info.robot or "granite")) is None:
        raise InputError(
            f"{first}: no motion {interval(window)}: the wheels do not turn there",
            "granite-lab inspect --plot FILE.png shows when they do; choose --from and --to around it",
        )
    return trial


def assemble(
    sources: dict[str, Source],
    robot: str | Path | None = None,
    info: TrialInfo | None = None,
    *,
    whole: bool = True,
    window: tuple[float, float] | None = None,
) -> Trial:
    """Turn the files of a trial, by what each was given for ("" for the first), into a Trial.

    With `whole`, a trial must hold an IMU or encoders. Of a `window`, only its samples are taken.

    Raises:
        InputError: the samples cannot be used.
        UsageError: unknown robot.
    """
    first = sources[""].path
    doubts: list[str] = []
    name, the_robot = _robot(sources, robot, info, doubts)
    parts = {role: read_streams(source, the_robot, window) for role, source in sources.items()}
    for one in parts.values():
        doubts += one.doubts
    merged = _merge(sources, parts)
    metadata = fill(
        [
            dataclasses.replace(source.metadata, soil=_beside(source, source.metadata.soil))
            for source in sources.values()
        ]
    )
    stream = _imu(merged, first, doubts)
    if stream is not None:
        stream, more = check_imu(stream, the_robot, str(first), _declared(merged))
        doubts += more
    wheels = merged.wheels
    if wheels is not None:
        wheels, more = check_wheels(wheels, stream, the_robot, str(first), merged.declared.get("wheels", ""))
        doubts += more
    if whole and stream is None and wheels is None:
        raise InputError(f"{first}: neither IMU nor encoder samples", "a trial needs at least one of them")
    trial = Trial(
        name=name_of(first),
        info=trial_info(metadata, info, name),
        imu=stream,
        wheels=wheels,
        currents=merged.currents,
        command=merged.command,
        reference_x=merged.reference_x,
        reference_v=merged.reference_v,
        inputs=_inputs(sources),
        layout=" + ".join(dict.fromkeys(s.match.layout.name for s in sources.values())),
    )
    names: dict[str, str] = {}
    for source in sources.values():
        for binding in source.match.bindings:
            names.setdefault(binding.channel, binding.name)
    if whole:
        trial, more = check_sensors(trial, the_robot, str(first), names)
        doubts += more
    doubts += _across(trial)
    return dataclasses.replace(trial, warnings=tuple(dict.fromkeys(doubts)))


def _robot(
    sources: dict[str, Source], given: str | Path | None, info: TrialInfo | None, doubts: list[str]
) -> tuple[str | None, Robot]:
    """Decide which robot the log is of; without a word from anyone it is the laboratory's own."""
    said = given or (info.robot if info else None)
    for source in sources.values():
        said = said or _beside(source, source.metadata.robot)
    for source in sources.values():
        said = said or source.match.layout.robot
    if said:
        return str(said), load_robot(str(said))
    doubts.append("the log does not name its robot: taken as 'granite'")
    return None, load_robot("granite")


def _beside(source: Source, name: str) -> str:
    """Return the path of a TOML file that lies in the log's folder, any other name as it is."""
    path = source.path.parent / name
    return str(path) if name.endswith(".toml") and path.is_file() else name


def _merge(sources: dict[str, Source], parts: dict[str, Parts]) -> Parts:
    """Take each sensor from the file that was given for it, else from the first file that has it."""
    merged = Parts()
    for role, one in parts.items():
        kinds = _ROLES.get(role, tuple(k for kinds in _ROLES.values() for k in kinds))
        found = [kind for kind in kinds if getattr(one, kind) is not None]
        if role and not found:
            raise InputError(
                f"{sources[role].path}: given as --{role}, but nothing in it is of that kind",
                f"its layout was taken as '{sources[role].match.layout.name}'",
            )
        for kind in found:
            setattr(merged, kind, getattr(one, kind))
        merged.declared |= {kind: unit for kind, unit in one.declared.items() if kind in found}
        if one.gravity_removed and "acceleration" in found:
            merged.gravity_removed = True
    return merged


def _imu(parts: Parts, path: Path, doubts: list[str]) -> ImuStream | None:
    """Put accelerometer and gyroscope on common stamps."""
    acc, gyro = parts.acceleration, parts.rate
    if acc is None and gyro is None:
        return None
    if acc is None or gyro is None:
        present = acc or gyro
        assert present is not None
        doubts.append(f"no {'gyroscope' if gyro is None else 'accelerometer'} in the log")
        nothing = np.full_like(present.values, np.nan)
        force, rate = (nothing, present.values) if acc is None else (present.values, nothing)
        return ImuStream(present.t, force, rate, parts.gravity_removed)
    for what, samples in (("accelerometer", acc), ("gyroscope", gyro)):
        absent = [
            axis for axis, column in zip("xyz", samples.values.T, strict=True) if np.isnan(column).all()
        ]
        if absent:
            doubts.append(f"{what}: no axis {', '.join(absent)} in the log")
    if len(acc.t) == len(gyro.t) and (acc.t == gyro.t).all():
        return ImuStream(acc.t, acc.values, gyro.values, parts.gravity_removed)
    both = np.intersect1d(acc.t, gyro.t)
    if len(both) > 0.5 * min(len(acc.t), len(gyro.t)):
        a, g = np.isin(acc.t, both), np.isin(gyro.t, both)
        return ImuStream(both, acc.values[a], gyro.values[g], parts.gravity_removed)
    inside = (acc.t >= gyro.t[0]) & (acc.t <= gyro.t[-1])
    if np.count_nonzero(inside) < 2:
        raise InputError(
            f"{path}: accelerometer ({acc.t[0]:.3f} to {acc.t[-1]:.3f} s) and gyroscope ({gyro.t[0]:.3f} to "
            f"{gyro.t[-1]:.3f} s) have no time in common",
            "both need stamps of the same clock",
        )
    doubts.append("the gyroscope has stamps of its own; interpolated to the accelerometer's")
    return ImuStream(
        acc.t[inside], acc.values[inside], _interpolate(acc.t[inside], gyro), parts.gravity_removed
    )


def _declared(parts: Parts) -> tuple[str, str]:
    """Return the units that the accelerometer and the gyroscope were said to have."""
    return parts.declared.get("acceleration", "m/s^2"), parts.declared.get("rate", "rad/s")


def _interpolate(t: Array, samples: Samples) -> Array:
    """Interpolate each axis linearly to other stamps."""
    return np.column_stack([np.interp(t, samples.t, column) for column in samples.values.T])


def _inputs(sources: dict[str, Source]) -> tuple[InputFile, ...]:
    """List every file that was read once."""
    return tuple(dict.fromkeys(file for source in sources.values() for file in source.inputs))


def _across(trial: Trial) -> list[str]:
    """Check streams against each other and for gaps.

    Raises:
        InputError: sensors whose stamps have no time in common.
    """
    streams = {"IMU": trial.imu, "encoders": trial.wheels, "motor currents": trial.currents}
    found = {what: stream.t for what, stream in streams.items() if stream is not None}
    doubts = [text for what, t in found.items() if (text := describe_gaps(t, what))]
    base = next(iter(found.items()), ("", np.zeros(0)))
    for what, t in list(found.items())[1:]:
        shared = min(t[-1], base[1][-1]) - max(t[0], base[1][0])
        if shared <= 0:
            raise InputError(
                f"{trial.inputs[0].path}: {base[0]} ({base[1][0]:.3f} to {base[1][-1]:.3f} s) and {what} "
                f"({t[0]:.3f} to {t[-1]:.3f} s) have no time in common",
                "both need stamps of the same clock; correct one in its file or choose another time column",
            )
        if shared < 0.5 * min(np.ptp(t), np.ptp(base[1])):
            doubts.append(f"{base[0]} and {what} have only {shared:.2f} s in common")
    return doubts
