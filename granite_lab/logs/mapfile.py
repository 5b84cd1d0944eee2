"""Write column maps, for a user to edit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from granite_lab.logs.dialect import Dialect


@dataclass(frozen=True)
class Entry:
    """One column of a map to be written; without channels it becomes a comment.

    Attributes:
        name: of the column in the file.
        place: where it stands, counted from 0.
        to: the channels it feeds.
        unit: its unit.
        settings: other keys of the entry.
        note: written above it.
    """

    name: str
    place: int
    to: tuple[str, ...]
    unit: str
    settings: tuple[tuple[str, object], ...] = ()
    note: str = ""


def quoted(text: str) -> str:
    """Write a text as TOML."""
    escaped = "".join(
        f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else "\\" + c if c in '"\\' else c for c in text
    )
    return f'"{escaped}"'


def map_toml(
    name: str,
    title: str,
    dialect: Dialect | None,
    entries: Sequence[Entry],
    head: Sequence[tuple[str, object]] = (),
) -> str:
    """Return a column map as TOML text.

    Args:
        name, title: of the map.
        dialect: how the text is laid out, written where a reader could not see it again; None: no text.
        entries: the columns.
        head: further keys for the top of the map.
    """
    lines = [
        "# A column map: edit it, then read the log with --map THIS_FILE.",
        "# Channels: t, t_add, imu_ax … imu_az, imu_gx … imu_gz, enc_fl … enc_rr, cur_fl … cur_rr, v_cmd,",
        "# ref_x, ref_y, ref_v, ref_lat, ref_lon. A wrong sign is scale = -1.",
        f"name = {quoted(re.sub(r'[^A-Za-z0-9_]+', '_', name) or 'log')}",
        f"title = {quoted(title)}",
    ]
    lines += [f"{key} = {_value(value)}" for key, value in head]
    if dialect is not None:
        lines += [
            "",
            "[table]",
            f"delimiter = {quoted(dialect.delimiter_name)}",
            f"decimal = {quoted(dialect.decimal)}",
        ]
    if dialect is not None and (not dialect.headers or dialect.header_line == 0):
        names = ", ".join(quoted(entry.name) for entry in sorted(entries, key=lambda e: e.place))
        lines.append(f"names = [{names}]")
    for entry in entries:
        lines.append("")
        if entry.note:
            lines.append(f"# {_one_line(entry.note)}")
        prefix = "" if entry.to else "# "
        body = ["[[column]]", _which(entry)]
        body.append(f"to = [{', '.join(quoted(channel) for channel in entry.to)}]")
        if entry.unit or entry.to:
            body.append(f"unit = {quoted(entry.unit)}")
        body += [f"{key} = {_value(value)}" for key, value in entry.settings]
        lines += [prefix + line for line in body]
    return "\n".join(lines) + "\n"


def _which(entry: Entry) -> str:
    """Name the column; one without a name is matched by an empty pattern."""
    return f"name = {quoted(entry.name)}" if entry.name else "pattern = '()'"


def _value(value: object) -> str:
    """Write a value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, (int, float)) else quoted(str(value))


def _one_line(text: str) -> str:
    """Keep a comment on its line."""
    return re.sub(r"[\x00-\x1f\x7f]+", " ", text)
