"""The records of an inspection: what a log seems to be, and how sure that is; and the column map of it."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granite_lab.errors import InputError
from granite_lab.logs.dialect import Table
from granite_lab.logs.named import name_of
from granite_lab.logs.stretches import MotionGuess
from granite_lab.logs.trial import Trial

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ColumnReport:
    """One column.

    Attributes:
        name: what the file calls it.
        place: where it stands, counted from 0.
        to: the channels it feeds.
        unit: its unit.
        confidence: how sure that is, 0 to 1.
        why: in a few words.
        low, high: range of the values; NaN for texts.
        filled: share of the cells that hold a number.
        settings: further keys of its entry in a column map.
    """

    name: str
    place: int
    to: tuple[str, ...]
    unit: str
    confidence: float
    why: str
    low: float = math.nan
    high: float = math.nan
    filled: float = math.nan
    settings: tuple[tuple[str, object], ...] = ()


@dataclass(frozen=True)
class StreamReport:
    """The clock of one sensor: [s] and [Hz]; jitter is the std of the steps."""

    what: str
    samples: int
    start: float
    end: float
    rate: float
    jitter: float
    gaps: int
    longest_gap: float


@dataclass(frozen=True)
class FileReport:
    """One file.

    Attributes:
        path: where it is.
        dialect: how its text is laid out; None if it is no text.
        layout: the column map that fits; "" if none does and columns were guessed.
        confidence: in the layout as a whole, 0 to 1.
        columns: what the columns are.
        entries: the same in the order of a column map, where of several clocks the first counts.
        head: what a column map says about the file as a whole.
        streams: clocks of the sensors.
        rests: standstills [s].
        motion: a first look at the motion; None without wheels.
        doubts: everything the reader was not sure of, wraps and saturation included.
        problem: why the file cannot be read as it is; "".
        trial: the samples, in SI; None if they cannot be read.
    """

    path: Path
    dialect: Table | None = None
    layout: str = ""
    confidence: float = 0.0
    columns: tuple[ColumnReport, ...] = ()
    entries: tuple[ColumnReport, ...] = ()
    head: tuple[tuple[str, object], ...] = ()
    streams: tuple[StreamReport, ...] = ()
    rests: tuple[tuple[float, float], ...] = ()
    motion: MotionGuess | None = None
    doubts: tuple[str, ...] = ()
    problem: str = ""
    trial: Trial | None = field(default=None, compare=False, repr=False)

    def to_map_toml(self) -> str:
        """Return a column map of what was recognised, which reads the file when given as ``--map``.

        Raises:
            InputError: the file is no table.
        """
        if not self.entries:
            raise InputError(self.problem, "only a table of numbers can be mapped")
        lines = [
            "# A column map: edit it, then read the log with --map THIS_FILE.",
            "# Channels: t, t_add, imu_ax … imu_az, imu_gx … imu_gz, enc_fl … enc_rr, cur_fl … cur_rr,",
            "# v_cmd, ref_x, ref_y, ref_v, ref_lat, ref_lon. A wrong sign is scale = -1.",
            f"name = {_toml(re.sub(r'[^A-Za-z0-9_]+', '_', name_of(self.path)) or 'log')}",
            f"title = {_toml(f'written from {self.path.name}')}",
            *_pairs(self.head),
        ]
        if self.dialect is not None:
            said: list[tuple[str, object]] = [
                ("delimiter", self.dialect.delimiter_name), ("decimal", self.dialect.decimal),
            ]  # fmt: skip
            if self.dialect.header_line == 0:
                said.append(("names", [column.name for column in self.columns]))
            lines += ["", "[table]", *_pairs(said)]
        for column in self.entries:
            lines += ["", *_entry(column)]
        return "\n".join(lines) + "\n"

    def as_json(self) -> dict[str, Any]:
        """Return the report as plain data."""
        table, motion = self.dialect, self.motion
        columns = [dataclasses.asdict(column) for column in self.columns]
        for column in columns:
            del column["settings"]
        return {
            "path": str(self.path),
            "layout": self.layout or None,
            "confidence": self.confidence,
            "text": table
            and {
                "encoding": table.encoding,
                "delimiter": table.delimiter_name,
                "decimal": table.decimal,
                "header_line": table.header_line,
                "first_row": table.data_line,
            },
            "columns": columns,
            "streams": [dataclasses.asdict(stream) for stream in self.streams],
            "standstills_s": [list(interval) for interval in self.rests],
            "motion": motion
            and {
                "velocity_mps": motion.velocity,
                "acceleration_mps2": motion.acceleration,
                "distance_m": motion.distance,
                "variant_mps": motion.variant.velocity if motion.variant else None,
                "confidence": motion.confidence,
            },
            "doubts": list(self.doubts),
            "problem": self.problem or None,
        }


@dataclass(frozen=True)
class Inspection:
    """What was recognised in some logs, file by file."""

    files: tuple[FileReport, ...]

    def to_map_toml(self, index: int = 0) -> str:
        """Return the column map of one of the files.

        Raises:
            InputError: the file is no table.
        """
        return self.files[index].to_map_toml()

    def as_json(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {"schema": "granite-lab/inspect/1", "files": [report.as_json() for report in self.files]}

    def to_frame(self) -> pd.DataFrame:
        """Return one row a column of each file: what it feeds, in which unit, and how sure that is."""
        import pandas as pd  # noqa: PLC0415

        rows = [
            (str(f.path), c.name, " ".join(c.to), c.unit, c.confidence, c.low, c.high, c.filled)
            for f in self.files
            for c in f.columns
        ]
        names = ["path", "column", "channels", "unit", "confidence", "low", "high", "filled"]
        return pd.DataFrame(rows, columns=names)


def _entry(column: ColumnReport) -> list[str]:
    """Return the lines of one column in a map; without channels they are comments."""
    lines = []
    if column.why:
        span = f"; values from {column.low:.6g} to {column.high:.6g}" if column.filled > 0 else ""
        sure = f"{column.confidence:.0%} sure, " if column.to else ""
        lines = [re.sub(r"[\x00-\x1f\x7f]+", " ", f"# {sure}{column.why}{span}")]
    # One without a name is matched by an empty pattern.
    named = f"name = {_toml(column.name)}" if column.name else "pattern = '()'"
    body = ["[[column]]", named, f"to = {_toml(column.to)}"]
    body += _pairs((("unit", column.unit), *column.settings) if column.unit or column.to else ())
    return lines + [line if column.to else f"# {line}" for line in body]


def _pairs(pairs: Sequence[tuple[str, object]]) -> list[str]:
    return [f"{key} = {_toml(value)}" for key, value in pairs]


def _toml(value: object) -> str:
    """Write a number, flag, text or list of texts as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_toml(item) for item in value)}]"
    escaped = (
        f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else "\\" + c if c in '"\\' else c
        for c in str(value)
    )
    return f'"{"".join(escaped)}"'
