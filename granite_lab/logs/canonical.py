"""The canonical log: what it says about itself, and how a trial is written as one."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granite_lab.errors import InputError, at, nearest
from granite_lab.files import write_text, writing
from granite_lab.logs.quantities import ACCELERATION, CURRENTS, ENCODERS, RATE
from granite_lab.logs.rows import uncommented
from granite_lab.logs.trial import Stated, Trial, TrialInfo, over, unsaid
from granite_lab.parameters import parse_path
from granite_lab.parameters.quantity import (
    at_line,
    build,
    key_of,
    parse_toml,
    quantity,
    read_toml,
    toml_line,
    unknown_key,
)

if TYPE_CHECKING:
    import pandas as pd

_LINE = re.compile(r'\s*(?:[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*")\s*=')

Metadata = dict[str, Any]
"""What a log says of itself: fields of `Known` to their values, and `extra`, other keys to their texts."""


@dataclass(frozen=True, kw_only=True)
class Known(Stated):
    """Keys that mean something to the reader of a log, with their bounds."""

    robot: str = ""
    virtual: bool = False
    imu_gravity_removed: bool = False
    enc_counts: float = quantity("1/rev", 1e-3, 1e9, "counts per wheel revolution", "", math.nan)
    enc_step_rad: float = quantity("", 0, 10, "smallest step of the wheel angle [rad]", "", math.nan)
    enc_step_radps: float = quantity("", 0, 100, "smallest step of the wheel rate [rad/s]", "", math.nan)


_KEYS = {key_of(f): f.name for f in dataclasses.fields(Known)}

CONDITIONS = ("payload_kg", "turned", "slope_deg", "same_rut", "wheels_up", "tow_N")
"""Keys of the conditions under which a trial was driven, which later stages read."""

MADE_BY = "made_by"
"""Key by which a log that a program wrote names it."""

NOTES = "notes"
"""Table of a sidecar for all that the reader need not understand."""


def collect(
    comments: Iterable[tuple[int, str]], path: Path, warnings: list[str], sidecars: Sequence[Path] = ()
) -> Metadata:
    """Read the metadata of a log: of its numbered comment lines, and of TOML files, of which the last counts.

    Comment lines may be a logger's own; a sidecar was written for the reader: an unknown key in it is wrong.

    Raises:
        InputError: a known key with a value that is not allowed; a sidecar that cannot be read, or with a key
            that is not known.
    """
    lines = [(at(path, line), uncommented(text)) for line, text in comments]
    above = ((where, _parse(bare, where), False) for where, bare in lines if _LINE.match(bare))
    beside = ((str(sidecar), read_toml(sidecar), True) for sidecar in sidecars)
    metadata: Metadata = {"extra": {}}
    for where, table, strict in chain(above, beside):
        for key, value in table.items():
            if key in _KEYS:
                metadata[_KEYS[key]] = getattr(build(Known, {key: value}, where), _KEYS[key])
                if key == "command":
                    _refuse_path(where, metadata[key])
                continue
            if key == NOTES and isinstance(value, dict):
                metadata["extra"] |= {name: str(note) for name, note in value.items()}
                continue
            if strict and key not in (*CONDITIONS, MADE_BY):
                unknown = at_line(unknown_key(where, key, [*_KEYS, *CONDITIONS]), where, "", key)
                end = "" if unknown.hint.endswith("?") else "."
                notes = f"{unknown.hint}{end} Notes of your own stand below [{NOTES}]."
                raise InputError(unknown.message, notes)
            metadata["extra"][key] = str(value)
            if guess := nearest(key, _KEYS, 0.8):
                warnings.append(f"{where}: metadata key '{key}' is not known; {guess}")
    return metadata


def _refuse_path(where: str, text: str) -> None:
    """Raise an InputError for a command that is no list of times and velocities."""
    try:
        parse_path(text)
    except ValueError:
        raise InputError(
            f"{where}: command = '{text}' is not valid",
            'write times [s] and velocities [m/s], as command = "0:0, 1:0.3, 5:0.3, 6:0", two or more',
        ) from None


def _parse(text: str, where: str) -> dict[str, Any]:
    """Parse one line; what is not TOML is text, unless its key means a number to the reader."""
    key, _, value = (part.strip() for part in text.partition("="))
    try:
        return parse_toml(text, where)
    except InputError:
        if key in _KEYS and key not in ("robot", "soil", "command"):
            hint = "write it as TOML, e.g. # v_desired_mps = 0.3"
            raise InputError(f"{where}: {key} = {value} is not valid", hint) from None
        return {key: value.strip("\"'")}


def trial_info(sources: Sequence[Metadata], given: TrialInfo | None, robot: str | None) -> TrialInfo:
    """Merge what the files say, the first that says something, with what is given, which goes first.

    The robot is decided already.
    """
    known = {f.name for f in dataclasses.fields(TrialInfo)}
    said = [TrialInfo(**{k: x for k, x in s.items() if k in known and not unsaid(x)}) for s in sources]
    merged = reduce(over, said, given or TrialInfo())
    repetition = None if merged.repetition is None else int(merged.repetition)
    return dataclasses.replace(merged, robot=robot, repetition=repetition)


def write_canonical(path: Path, trial: Trial) -> None:
    """Write a trial as the canonical CSV, whole or not at all.

    Reading the file gives the same stamps and values to the last bit. Columns that were not logged and
    samples with no number are left out. The trial's name, warnings and inputs are not part of the format.

    Raises:
        LabError: the file cannot be written.
    """
    head = "".join(f"# {line}\n" for line in _comments(trial))
    with writing(Path(path)) as file:
        file.write(head.encode("utf-8"))
        _table(trial).to_csv(file, index_label="t_s", lineterminator="\n", encoding="utf-8")


def _comments(trial: Trial) -> list[str]:
    """Return the metadata as lines of TOML."""
    wheels, values = trial.wheels, {key: getattr(trial.info, name, None) for key, name in _KEYS.items()}
    values["imu_gravity_removed"] = trial.imu is not None and trial.imu.gravity_removed
    if wheels is not None and wheels.step > 0:
        values["enc_step_rad" if wheels.rate is None else "enc_step_radps"] = wheels.step
    stated = {key: value for key, value in values.items() if not unsaid(value)}
    return [toml_line(key, value) for key, value in (stated | trial.info.extra).items()]


def _table(trial: Trial) -> pd.DataFrame:
    """Merge all streams into one table, a row per stamp of any of them."""
    import pandas as pd  # noqa: PLC0415, heavy

    rates = trial.wheels is not None and trial.wheels.rate is not None
    logged = (
        (trial.imu, "specific_force", ACCELERATION, "_mps2"),
        (trial.imu, "angular_rate", RATE, "_radps"),
        (trial.wheels, *(("rate", ENCODERS, "_radps") if rates else ("angle", ENCODERS, "_rad"))),
        (trial.currents, "current", CURRENTS, "_A"),
        (trial.command, "value", ("v_cmd",), "_mps"),
        (trial.tow, "value", ("tow",), "_N"),
        (trial.reference_x, "value", ("ref_x",), "_m"),
        (trial.reference_v, "value", ("ref_v",), "_mps"),
    )
    frames = [
        pd.DataFrame(getattr(stream, values), stream.t, [name + unit for name in names]).dropna(how="all")
        for stream, values, names, unit in logged
        if stream is not None
    ]
    return pd.concat(frames or [pd.DataFrame()], axis=1, sort=True).dropna(axis=1, how="all")


def write_truth(path: Path, motion: pd.DataFrame) -> None:
    """Keep the true motion of a virtual trial aside: CSV, with the attributes as comment lines.

    Raises:
        LabError: the file cannot be written.
    """
    metadata = {"virtual": True, **motion.attrs}
    header = "".join(f"# {key} = {json.dumps(value)}\n" for key, value in metadata.items())
    write_text(path, header + motion.to_csv(index=False, float_format="%.7g"))
