"""Write a trial as the canonical CSV."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd

from granite_lab.files import write_text, writing
from granite_lab.logs.layouts import ACCELERATION, CURRENTS, ENCODERS, RATE
from granite_lab.logs.trial import Array, Trial


def write_canonical(path: Path, trial: Trial) -> None:
    """Write a trial as the canonical CSV, whole or not at all.

    Reading the file gives the same stamps and values to the last bit. Columns that were not logged
    are left out; samples with no number in them are, too.

    Args:
        path: the CSV file.
        trial: what to write; its name, warnings and inputs are not part of the format.

    Raises:
        LabError: the file cannot be written.
    """
    head = "".join(f"# {line}\n" for line in _comments(trial))
    with writing(Path(path)) as file:
        file.write(head.encode("utf-8"))
        _table(trial).to_csv(file, index_label="t_s", lineterminator="\n", encoding="utf-8")


def _comments(trial: Trial) -> list[str]:
    """Return the metadata as lines of TOML."""
    info = trial.info
    known: dict[str, object] = {
        "robot": info.robot,
        "soil": info.soil,
        "v_desired_mps": info.v_desired,
        "a_max_mps2": info.a_max,
        "distance_m": info.distance,
        "repetition": info.repetition,
        "virtual": info.virtual or None,
        "clock_offset_s": info.clock_offset,
    }
    if trial.imu is not None and trial.imu.gravity_removed:
        known["imu_gravity_removed"] = True
    if trial.wheels is not None and trial.wheels.step > 0:
        known["enc_step_rad" if trial.wheels.rate is None else "enc_step_radps"] = trial.wheels.step
    lines = [f"{key} = {_toml(value)}" for key, value in known.items() if value is not None]
    lines += [f"{_key(key)} = {_toml(value)}" for key, value in info.extra.items()]
    return lines


def _toml(value: object) -> str:
    """Write a number, flag or text as TOML."""
    if isinstance(value, str):
        # JSON escapes what TOML wants escaped, except DEL.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(int(value)) if isinstance(value, (int, np.integer)) else repr(float(str(value)))


def _key(key: str) -> str:
    """Write a key, in quotes where it needs them."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _toml(key)


def _table(trial: Trial) -> pd.DataFrame:
    """Merge all streams into one table, a row per stamp of any of them."""
    columns: list[tuple[str, Array, Array]] = []

    def add(t: Array, values: Array, names: list[str]) -> None:
        columns.extend(
            (name, t, column)
            for name, column in zip(names, np.reshape(values, (len(t), -1)).T, strict=True)
            if np.isfinite(column).any()
        )

    if trial.imu is not None:
        add(trial.imu.t, trial.imu.specific_force, [f"{name}_mps2" for name in ACCELERATION])
        add(trial.imu.t, trial.imu.angular_rate, [f"{name}_radps" for name in RATE])
    if trial.wheels is not None:
        wheels = trial.wheels
        if wheels.rate is None:
            add(wheels.t, wheels.angle, [f"{name}_rad" for name in ENCODERS])
        else:
            add(wheels.t, wheels.rate, [f"{name}_radps" for name in ENCODERS])
    if trial.currents is not None:
        add(trial.currents.t, trial.currents.current, [f"{name}_A" for name in CURRENTS])
    for name, series in (
        ("v_cmd_mps", trial.command),
        ("ref_x_m", trial.reference_x),
        ("ref_v_mps", trial.reference_v),
    ):
        if series is not None:
            add(series.t, series.value, [name])
    stamps = np.unique(np.concatenate([t[np.isfinite(v)] for _, t, v in columns])) if columns else np.zeros(0)
    table = {}
    for name, t, values in columns:
        whole = np.full(len(stamps), np.nan)
        seen = np.isfinite(values)
        whole[np.searchsorted(stamps, t[seen])] = values[seen]
        table[name] = whole
    return pd.DataFrame(table, index=stamps)


def write_truth(path: Path, motion: pd.DataFrame) -> None:
    """Keep the true motion of a virtual trial aside: CSV, with the attributes as comment lines.

    Raises:
        LabError: the file cannot be written.
    """
    marks = {True: "true", False: "false"}
    header = "".join(
        f"# {key} = " + (marks[value] if isinstance(value, bool) else json.dumps(value)) + "\n"
        for key, value in {"virtual": True, **motion.attrs}.items()
    )
    write_text(path, header + motion.to_csv(index=False, float_format="%.7g"))
