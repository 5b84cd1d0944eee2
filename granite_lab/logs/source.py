"""A file of a trial once it was read, whatever its kind."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from granite_lab.errors import at
from granite_lab.logs.dialect import Dialect
from granite_lab.logs.matching import Binding, Match
from granite_lab.logs.metadata import Metadata
from granite_lab.logs.table import line_of
from granite_lab.logs.trial import Array, InputFile


@dataclass(frozen=True, eq=False)
class Source:
    """A file that was read.

    Attributes:
        path: where it is.
        dialect: how its text is laid out.
        match: the layout it has.
        columns: place of a column to its (N,) values, in the file's units.
        kept: (N,) the row of data each value came from.
        metadata: what the file and its sidecar say.
        inputs: the file and its sidecar.
        doubts: what the reader was not sure of.
    """

    path: Path
    dialect: Dialect
    match: Match
    columns: dict[int, Array]
    kept: Array
    metadata: Metadata
    inputs: tuple[InputFile, ...]
    doubts: tuple[str, ...]

    def bindings(self, *channels: str) -> list[Binding]:
        """Return the bindings of some channels."""
        return [b for b in self.match.bindings if b.channel in channels]

    def place(self, row: int) -> str:
        """Name the place in the file of a row of `columns`."""
        if self.dialect.data_line == 0:
            return f"{self.path}: message {int(self.kept[row]) + 1}"
        return at(self.path, line_of(self.path, self.dialect, int(self.kept[row])) or None)
