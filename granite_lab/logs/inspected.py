"""The records of an inspection: what a log seems to be, and how sure that is."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granite_lab.errors import InputError
from granite_lab.logs.dialect import Dialect
from granite_lab.logs.mapfile import Entry, map_toml
from granite_lab.logs.named import name_of
from granite_lab.logs.stretches import MotionGuess
from granite_lab.logs.trial import Trial

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ColumnReport:
    """One column: what it feeds, in which unit, how sure (0 to 1) and why; NaN range for texts."""

    name: str
    place: int
    to: tuple[str, ...]
    unit: str
    confidence: float
    why: str
    low: float = math.nan
    high: float = math.nan
    filled: float = math.nan


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
        streams: clocks of the sensors.
        rests: standstills [s].
        motion: a first look at the motion; None without wheels.
        doubts: everything the reader was not sure of, wraps and saturation included.
        problem: why the file cannot be read as it is; "".
        trial: the samples, in SI; None if they cannot be read.
    """

    path: Path
    dialect: Dialect | None
    layout: str
    confidence: float
    columns: tuple[ColumnReport, ...] = ()
    streams: tuple[StreamReport, ...] = ()
    rests: tuple[tuple[float, float], ...] = ()
    motion: MotionGuess | None = None
    doubts: tuple[str, ...] = ()
    problem: str = ""
    entries: tuple[Entry, ...] = ()
    head: tuple[tuple[str, object], ...] = ()
    trial: Trial | None = dataclasses.field(default=None, compare=False, repr=False)

    def to_map_toml(self) -> str:
        """Return a column map of what was recognised, which reads the file when given as ``--map``.

        Raises:
            InputError: the file is no table.
        """
        if self.dialect is None and not self.entries:
            raise InputError(self.problem, "only a table of numbers can be mapped")
        title = f"written from {self.path.name}"
        return map_toml(name_of(self.path), title, self.dialect, self.entries, self.head)


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
        return {"schema": "granite-lab/inspect/1", "files": [_plain(report) for report in self.files]}

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


def _plain(report: FileReport) -> dict[str, Any]:
    """Return a report as plain data."""
    dialect = report.dialect
    motion = report.motion
    return {
        "path": str(report.path),
        "layout": report.layout or None,
        "confidence": report.confidence,
        "text": None
        if dialect is None
        else {
            "encoding": dialect.encoding,
            "delimiter": dialect.delimiter_name,
            "decimal": dialect.decimal,
            "header_line": dialect.header_line,
            "first_row": dialect.data_line,
        },
        "columns": [dataclasses.asdict(column) for column in report.columns],
        "streams": [dataclasses.asdict(stream) for stream in report.streams],
        "standstills_s": [list(interval) for interval in report.rests],
        "motion": None
        if motion is None
        else {
            "velocity_mps": motion.velocity,
            "acceleration_mps2": motion.acceleration,
            "distance_m": motion.distance,
            "variant_mps": motion.variant.velocity if motion.variant else None,
            "confidence": motion.confidence,
        },
        "doubts": list(report.doubts),
        "problem": report.problem or None,
    }
