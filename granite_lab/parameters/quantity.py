"""Numbers with unit and bounds, and TOML: the only place that reads it, and that writes its values."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import numbers
import re
import tomllib
import types
import typing
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from granite_lab.errors import InputError, at, nearest
from granite_lab.files import readable, refuse_special

T = TypeVar("T")

_HEADER = re.compile(r"\s*(\[\[?)([^\]]+)\]")

IRREGULAR = {
    "Hz": "hz",
    "1/rev": "per_rev",
    "m/s^2/sqrt(Hz)": "mps2_rthz",
    "rad/s/sqrt(Hz)": "radps_rthz",
    "Pa/m^(n-1)": "Pa_mn1",
    "Pa/m^n": "Pa_mn",
}
"""Units that a key does not end in as `key_of` writes the others."""


def quantity(
    unit: str, low: float, high: float, meaning: str, symbol: str = "", default: Any = dataclasses.MISSING
) -> Any:
    """Declare a dataclass field that holds a number in a unit between two bounds (both allowed)."""
    metadata = {"unit": unit, "low": low, "high": high, "meaning": meaning, "symbol": symbol}
    return dataclasses.field(default=default, metadata=metadata)


def key_of(field: dataclasses.Field[Any]) -> str:
    """Return the TOML key of a field: its name with the unit behind it, as ``gain_d_Vsprad`` for V s/rad."""
    unit = field.metadata.get("unit", "")
    suffix = IRREGULAR.get(unit, unit.replace(" ", "").replace("/", "p").replace("^", ""))
    return f"{field.name}_{suffix}" if suffix else field.name


_files: ContextVar[dict[Path, str] | None] = ContextVar("files", default=None)


@contextmanager
def noting_files() -> Iterator[dict[Path, str]]:
    """Note the TOML files that the block reads, with the SHA-256 of what was read.

    Records of the catalogue are remembered once read; `catalogue.clear_cache` before the block makes
    it read them.
    """
    files: dict[Path, str] = {}
    token = _files.set(files)
    try:
        yield files
    finally:
        _files.reset(token)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        InputError: the file is missing, unreadable, not UTF-8 or not TOML.
    """
    refuse_special(path)
    try:
        data = path.read_bytes()
        if (files := _files.get()) is not None:
            files[path] = hashlib.sha256(data).hexdigest()
        return parse_toml(data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n"), path)
    except OSError as error:
        raise readable(error, path) from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not UTF-8 text", "a parameter file is UTF-8 TOML") from None


def parse_toml(text: str, path: Path | str) -> dict[str, Any]:
    """Parse TOML text that stands in `path`.

    Raises:
        InputError: the text is not TOML; the message carries the line.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}", "see https://toml.io for the syntax") from None


def toml(value: object) -> str:
    """Return a number, flag, text, list or dictionary as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, numbers.Integral):
        return repr(int(value))
    if isinstance(value, numbers.Real):
        return repr(float(str(value)))  # a number of single precision keeps its digits
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(toml_line(str(k), v) for k, v in value.items())} }}"
    # JSON escapes what TOML wants escaped, except DEL.
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def toml_line(key: str, value: object) -> str:
    """Return ``key = value`` as TOML, the key in quotes where it needs them."""
    return f"{key if re.fullmatch(r'[A-Za-z0-9_-]+', key) else toml(key)} = {toml(value)}"


def unknown_key(where: str, key: str, keys: list[str]) -> InputError:
    """Say that a key is not known and which known one it resembles."""
    hint = nearest(key, keys, 0.5) or f"allowed here: {', '.join(sorted(keys))}"
    return InputError(f"{where}: unknown key '{key}'", hint)


def check_number(where: str, key: str, value: Any, unit: str, low: float, high: float) -> float:
    """Return the number if it is finite and within its bounds.

    Raises:
        InputError: naming file, key, value, unit and allowed range.
    """
    allowed = f"expected a number from {low:g} to {high:g}" + (f" {unit}" if unit else "")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{where}: {key} = {value!r} is not a number", allowed)
    if not math.isfinite(value) or not low <= value <= high:
        raise InputError(f"{where}: {key} = {value:g} is out of range", allowed)
    return float(value)


def build(cls: type[T], table: dict[str, Any], where: str, label: str = "") -> T:
    """Build a frozen record from a TOML table.

    Args:
        cls: a dataclass whose fields are numbers (`quantity`), texts, lists or further dataclasses.
        table: the parsed table.
        where: file (and table) for messages.
        label: the table's dotted name inside the file.

    Raises:
        InputError: unknown or missing key, wrong type, number out of bounds.
    """
    hints = _hints(cls)  # type: ignore[arg-type]
    fields = {key_of(f): f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    place = f"{where}: [{label}]" if label else where
    for key in table:
        if key not in fields:
            raise at_line(unknown_key(place, key, list(fields)), where, label, key)
    values: dict[str, Any] = {}
    for key, field in fields.items():
        if key not in table:
            if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
                unit = field.metadata.get("unit", "")
                meaning = ", in ".join(filter(None, (field.metadata.get("meaning", ""), unit)))
                raise InputError(
                    f"{place}: '{key}' is missing", f"add {key} = …" + (f" ({meaning})" if meaning else "")
                )
            continue
        try:
            values[field.name] = _convert(hints[field.name], field, key, table[key], where, place, label)
        except InputError as error:
            raise at_line(error, where, label, key) from None
    return cls(**values)


def table_of(record: Any) -> Any:
    """Return a record as the table of which `build` makes it."""
    if dataclasses.is_dataclass(record):
        fields = ((key_of(f), getattr(record, f.name)) for f in dataclasses.fields(record))
        return {key: table_of(value) for key, value in fields if value is not None}
    return [table_of(value) for value in record] if isinstance(record, tuple) else record


def at_line(error: InputError, where: str, label: str, key: str) -> InputError:
    """Return an error about a key of a table with the line of the key, where a file has it in a line."""
    line = _line_of(where, label, key) if error.message.startswith(f"{where}: ") else None
    return InputError(at(where, line) + error.message.removeprefix(where), error.hint) if line else error


def _line_of(where: str, label: str, key: str) -> int | None:
    """Return the line of a TOML file in which a key of a table stands, or the header of a table so called."""
    if not where.endswith(".toml"):
        return None
    try:
        text = Path(where).read_text(encoding="utf-8-sig")
    except (OSError, ValueError):
        return None
    wanted, table, rows = f"{label}.{key}" if label else key, "", Counter[str]()
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = header[2].strip()
            if table == wanted:
                return number
            if header[1] == "[[":
                rows[table] += 1
                table = f"{table}.{rows[table]}"
        elif table == label and re.match(rf"""\s*(["']?){re.escape(key)}\1\s*=""", line):
            return number
    return None


def _interval(place: str, key: str, pair: Any) -> tuple[float, float]:
    """Check one [start, end] of a list of intervals."""
    if not isinstance(pair, list) or len(pair) != 2:
        raise InputError(f"{place}: {key}: {pair!r} is no interval", f"write {key} = [[start, end], …] [s]")
    start, end = (check_number(place, key, x, "s", -1e12, 1e12) for x in pair)
    if not start < end:
        raise InputError(f"{place}: {key}: {start:g} to {end:g} s is no interval", "the start comes first")
    return start, end


@cache
def _hints(cls: type[Any]) -> dict[str, Any]:
    """Return the types of a record's fields."""
    return typing.get_type_hints(cls)


def _convert(
    hint: Any, field: dataclasses.Field[Any], key: str, value: Any, where: str, place: str, label: str
) -> Any:
    """Check one value of a table against the type and bounds of its field."""
    if isinstance(hint, types.UnionType):  # an optional sub-table
        hint = next(a for a in typing.get_args(hint) if a is not type(None))
    if dataclasses.is_dataclass(hint):
        if not isinstance(value, dict):
            raise InputError(f"{place}: '{key}' must be a table", f"write [{key}] above its keys")
        return build(typing.cast(type, hint), value, where, f"{label}.{key}" if label else key)
    if "unit" in field.metadata:
        m = field.metadata
        return check_number(place, key, value, m["unit"], m["low"], m["high"])
    if hint is str:
        if not isinstance(value, str):
            raise InputError(f"{place}: {key} = {value!r} is not a text", 'write it in quotes: "…"')
        choices = field.metadata.get("choices")
        if choices and value not in choices:
            raise InputError(f"{place}: {key} = {value!r} is not known", f"one of: {', '.join(choices)}")
        return value
    if hint is bool:
        if not isinstance(value, bool):
            raise InputError(f"{place}: {key} = {value!r} is neither true nor false", "write true or false")
        return value
    if typing.get_origin(hint) is tuple:
        return _convert_list(typing.get_args(hint)[0], field, key, value, where, place)
    raise AssertionError(f"field {field.name} has a type the reader does not know: {hint}")


def _convert_list(
    item: Any, field: dataclasses.Field[Any], key: str, value: Any, where: str, place: str
) -> tuple[Any, ...]:
    """Check a list of items of one type: tables, intervals, numbers or texts."""
    if dataclasses.is_dataclass(item):
        if not isinstance(value, list) or not all(isinstance(row, dict) for row in value):
            raise InputError(f"{place}: '{key}' must be a list of tables", f"write [[{key}]] above each")
        rows = enumerate(value, 1)
        return tuple(build(typing.cast(type, item), row, where, f"{key}.{i}") for i, row in rows)
    if not isinstance(value, list):
        raise InputError(f"{place}: {key} = {value!r} is not a list", "write it as [a, b, …]")
    if typing.get_origin(item) is tuple:
        return tuple(_interval(place, key, pair) for pair in value)
    if item is float:
        m = field.metadata
        if tuple(value) != field.default and len(value) != m.get("length", len(value)):
            raise InputError(f"{place}: {key} has {len(value)} numbers", f"expected {m['length']}")
        return tuple(check_number(place, key, v, "", m.get("low", -1e9), m.get("high", 1e9)) for v in value)
    return tuple(str(v) for v in value)
