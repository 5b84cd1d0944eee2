"""Where a report comes from: version, command, parameters in force, files that were read."""

from __future__ import annotations

from granite_lab.reporting.content import Source
from granite_lab.reporting.document import Block, Fold, Section, Words
from granite_lab.reporting.json_report import shown_path
from granite_lab.reporting.rounding import tidy_unit
from granite_lab.reporting.table import Cell, Table, columns, words

LONGEST = 1000
"""So many characters of a command are shown: where logs were named one by one, it may have no end."""


def provenance_section(source: Source) -> Section:
    """Return the section that says how to make a report again."""
    blocks: list[Block] = [Words(f"Made by granite-lab {source.version}: {_shortened(source.command)}")]
    if source.parameters:
        blocks.append(Fold("Parameters in force", (parameter_table(source),)))
    if source.inputs:
        blocks.append(Fold("Files that were read", (input_table(source),)))
    return Section("provenance", "Parameters and provenance", tuple(blocks))


def _shortened(command: str) -> str:
    """Return a command of bearable length: its start, and its end with the options."""
    if len(command) <= LONGEST:
        return command
    return f"{command[: LONGEST // 2]} … {command[-LONGEST // 2 :]} (shortened)"


def parameter_table(source: Source) -> Table:
    """Return every parameter in force and its origin."""
    rows = tuple(
        (words(key), Cell(value, (value,)), words(tidy_unit(unit)), words(origin))
        for key, value, unit, origin in source.parameters
    )
    return Table(
        "parameters", "Parameters in force", "Each with the file it was read from.",
        columns("parameter", ("value", ("value",)), "unit", "origin"), rows,
    )  # fmt: skip


def input_table(source: Source) -> Table:
    """Return the files that were read; of an absolute path only the name."""
    rows = tuple((words(shown_path(i.path)), words(i.sha256)) for i in source.inputs)
    return Table(
        "inputs",
        "Files that were read",
        "With them and the parameters the report can be made again.",
        columns("file", "SHA-256"),
        rows,
    )
