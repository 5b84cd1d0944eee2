"""Single numbers of a robot or a soil that a user gives in place of those of its file (`--set`)."""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, TypeVar

from granite_lab.errors import InputError
from granite_lab.parameters.quantity import check_number, key_of
from granite_lab.parameters.records import Robot, Soil

R = TypeVar("R")

Changes = tuple[tuple[str, float], ...]
"""(key, number); the key is that of the TOML file with robot or soil before it, ``robot.wheels.radius_m``."""

OPTION = "--set"


@cache
def quantities() -> dict[str, Mapping[str, Any]]:
    """Return every key that can be set, to its unit and bounds."""
    return dict([*_of(Robot, "robot"), *_of(Soil, "soil")])


def _of(record: type[Any], group: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    hints = typing.get_type_hints(record)
    for field in dataclasses.fields(record):
        hint, key = hints[field.name], f"{group}.{key_of(field)}"
        inside = next(
            (part for part in (hint, *typing.get_args(hint)) if dataclasses.is_dataclass(part)), None
        )
        if inside is not None:
            yield from _of(typing.cast("type[Any]", inside), key)
        elif "unit" in field.metadata:
            yield key, field.metadata


def checked(given: Mapping[str, Any], where: str = OPTION) -> Changes:
    """Return changes by their keys, each within the bounds of its number.

    Args:
        given: keys to numbers, in the units that the keys name.
        where: who gives them, for messages.

    Raises:
        InputError: a key is not known (the hint names the nearest one), or a number is out of its bounds.
    """
    settable = quantities()
    for key in given:
        if key not in settable:
            (close,) = difflib.get_close_matches(key, settable, n=1, cutoff=0)
            raise InputError(f"{where}: unknown key '{key}'", f"the nearest known is '{close}'")
    bounds = {key: (m["unit"], m["low"], m["high"]) for key, m in settable.items()}
    return tuple((key, check_number(where, key, value, *bounds[key])) for key, value in given.items())


def changed(record: R, group: str, changes: Changes) -> R:
    """Return a robot or a soil (`group` says which) with the numbers that were set.

    Raises:
        InputError: the record lacks the part to which a number belongs.
    """
    for key, value in changes:
        first, *parts = key.split(".")
        if first == group:
            record = _with(record, parts, value, key)
    return record


def _with(record: Any, parts: list[str], value: float, key: str) -> Any:
    name = next(f.name for f in dataclasses.fields(record) if key_of(f) == parts[0])
    if len(parts) > 1:
        inside = getattr(record, name)
        if inside is None:
            whose = f"the file of '{record.name}' has no [{name}]"
            raise InputError(f"{OPTION} {key}: {whose}", f"add all of [{name}] to a file of your own")
        value = _with(inside, parts[1:], value, key)
    return dataclasses.replace(record, **{name: value})
