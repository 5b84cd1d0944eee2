"""Trials as canonical CSV text, and what can go wrong in such a file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from granite_lab.hidden.contact import Array
from granite_lab.logs.trial import Trial
from granite_lab.parameters import WHEELS

IMU_COLUMNS = [f"imu_a{axis}_mps2" for axis in "xyz"] + [f"imu_g{axis}_radps" for axis in "xyz"]
ENCODER_COLUMNS = [f"enc_{wheel}_rad" for wheel in WHEELS]
CURRENT_COLUMNS = [f"cur_{wheel}_A" for wheel in WHEELS]

Rows = list[list[str]]


def to_csv(trial: Trial) -> str:
    """Return the trial as one canonical CSV: a row per stamp of any sensor, other cells empty."""
    blocks: list[tuple[list[str], Array, Array]] = []
    if trial.imu is not None:
        blocks.append(
            (IMU_COLUMNS, trial.imu.t, np.hstack([trial.imu.specific_force, trial.imu.angular_rate]))
        )
    if trial.wheels is not None:
        blocks.append((ENCODER_COLUMNS, trial.wheels.t, trial.wheels.angle))
    if trial.currents is not None:
        blocks.append((CURRENT_COLUMNS, trial.currents.t, trial.currents.current))
    for name, series in (("ref_x_m", trial.reference_x), ("ref_v_mps", trial.reference_v)):
        if series is not None:
            blocks.append(([name], series.t, series.value[:, None]))
    columns = [name for names, _, _ in blocks for name in names]
    rows, done = [], 0
    for names, t, values in blocks:
        left, right = [""] * done, [""] * (len(columns) - done - len(names))
        for stamp, sample in zip(t, values, strict=True):
            cells = ["" if np.isnan(value) else f"{value:.9g}" for value in sample]
            rows.append((float(stamp), [f"{stamp:.6f}", *left, *cells, *right]))
        done += len(names)
    rows.sort(key=lambda row: row[0])
    info = trial.info
    known = {
        "robot": f'"{info.robot}"' if info.robot else None,
        "soil": f'"{info.soil}"' if info.soil else None,
        "v_desired_mps": info.v_desired,
        "a_max_mps2": info.a_max,
        "distance_m": info.distance,
        "repetition": info.repetition,
    }
    head = [f"# {key} = {value}" for key, value in known.items() if value is not None]
    return "\n".join([*head, ",".join(["t_s", *columns]), *(",".join(cells) for _, cells in rows), ""])


def split(text: str) -> tuple[list[str], list[str], Rows]:
    """Return comment lines, column names and rows of a canonical CSV."""
    lines = text.splitlines()
    head = [line for line in lines if line.startswith("#")]
    body = [line.split(",") for line in lines if not line.startswith("#")]
    return head, body[0], body[1:]


def join(head: list[str], columns: list[str], rows: Rows) -> str:
    """Return the text of the parts."""
    return "\n".join([*head, ",".join(columns), *(",".join(row) for row in rows), ""])


def converted(text: str, prefix: str, factor: float, suffix: str | None = None) -> str:
    """Multiply the columns that begin with `prefix`; the unit in their name becomes `suffix`, if given.

    Without `suffix` the name lies about the unit, as after a mistake in the logger's settings.
    """
    head, columns, rows = split(text)
    hit = [i for i, name in enumerate(columns) if name.startswith(prefix)]
    new = [
        f"{name.rsplit('_', 1)[0]}_{suffix}" if suffix and i in hit else name
        for i, name in enumerate(columns)
    ]
    changed = [
        [f"{float(cell) * factor:.12g}" if i in hit and cell else cell for i, cell in enumerate(row)]
        for row in rows
    ]
    return join(head, new, changed)


def wrapped_counts(text: str, counts_per_rev: int, bits: int, start: int = 0) -> str:
    """Write the encoders as unsigned counters of some bits that begin near `start` and wrap."""
    head, columns, rows = split(text)
    hit = [i for i, name in enumerate(columns) if name.startswith("enc_")]
    new = [f"{name.rsplit('_', 1)[0]}_counts" if i in hit else name for i, name in enumerate(columns)]

    def count(cell: str) -> str:
        return str((start + round(float(cell) * counts_per_rev / (2 * np.pi))) % 2**bits)

    changed = [[count(cell) if i in hit and cell else cell for i, cell in enumerate(row)] for row in rows]
    return join([*head, f"# enc_counts_per_rev = {counts_per_rev}"], new, changed)


def with_rows(text: str, change: Callable[[Rows], Rows]) -> str:
    """Apply a change to the rows."""
    head, columns, rows = split(text)
    return join(head, columns, change(rows))


def duplicated(text: str, every: int, disturb: float = 0.0) -> str:
    """Repeat every so many rows under the same stamp; the copy is off by `disturb` in all its values."""

    def change(rows: Rows) -> Rows:
        out: Rows = []
        for i, row in enumerate(rows):
            out.append(row)
            if i % every == every - 1:
                out.append([row[0], *(f"{float(cell) + disturb:.9g}" if cell else cell for cell in row[1:])])
        return out

    return with_rows(text, change)


def unsorted(text: str, seed: int, reach: int = 5) -> str:
    """Shuffle the rows within a window of `reach` rows, as loggers with several threads do."""
    rng = np.random.default_rng(seed)

    def change(rows: Rows) -> Rows:
        keys = np.arange(len(rows)) + rng.uniform(0, reach, len(rows))
        return [rows[i] for i in np.argsort(keys)]

    return with_rows(text, change)


def backwards(text: str) -> str:
    """Write the rows in reverse order of time."""
    return with_rows(text, lambda rows: rows[::-1])


def with_gap_of_nan(text: str, column: str, start: float, stop: float) -> str:
    """Write NaN into a column between two stamps [s]."""
    head, columns, rows = split(text)
    at = columns.index(column)
    for row in rows:
        if start <= float(row[0]) <= stop and row[at]:
            row[at] = "NaN"
    return join(head, columns, rows)
