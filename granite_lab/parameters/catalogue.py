"""What the catalogue holds, by name, and a user's own files, by path."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from granite_lab.errors import UsageError
from granite_lab.parameters.quantity import build, key_of, read_toml
from granite_lab.parameters.records import ImuGrade, Paper, Published, Robot, Soil, Variant

CATALOGUE = Path(str(files("granite_lab") / "catalogue"))


def names(kind: str) -> list[str]:
    """Return the names in a folder of the catalogue: ``robots``, ``soils`` or ``loggers``."""
    return sorted(path.stem for path in (CATALOGUE / kind).glob("*.toml"))


def find(kind: str, name: str | Path) -> Path:
    """Return the file of a catalogue entry, or the user's own file if a path is given.

    Raises:
        UsageError: neither a known name nor a path to a TOML file.
    """
    text = str(name)
    if text.endswith(".toml") or "/" in text:
        return Path(text)
    known = names(kind)
    if text in known:
        return CATALOGUE / kind / f"{text}.toml"
    close = difflib.get_close_matches(text, known, n=1)
    hint = f"did you mean '{close[0]}'? " if close else ""
    raise UsageError(
        f"unknown {kind[:-1]} '{text}'", f"{hint}known: {', '.join(known)}; or give the path of a .toml file"
    )


@lru_cache
def load_robot(name: str | Path = "granite", grade: str | None = None) -> Robot:
    """Read a robot and attach its IMU's grade.

    Args:
        name: a name of the catalogue or the path of a TOML file.
        grade: an IMU grade that replaces the file's.

    Raises:
        UsageError: unknown name or grade.
        InputError: the file is wrong.
    """
    path = find("robots", name)
    robot = build(Robot, read_toml(path), str(path))
    if grade is None and robot.imu_grade is not None:
        return robot
    return dataclasses.replace(robot, imu_grade=load_grade(grade or robot.imu.grade))


@lru_cache
def load_grade(name: str) -> ImuGrade:
    """Read an IMU grade of the catalogue.

    Raises:
        UsageError: unknown grade.
    """
    path = CATALOGUE / "imu_grades.toml"
    table = read_toml(path)
    if name not in table:
        raise UsageError(f"unknown IMU grade '{name}'", f"known: {', '.join(table)}")
    return build(ImuGrade, table[name], str(path), name)


@lru_cache
def load_soil(name: str | Path = "dry_sand") -> Soil:
    """Read a soil, by name or path.

    Raises:
        UsageError: unknown name.
        InputError: the file is wrong.
    """
    path = find("soils", name)
    return build(Soil, read_toml(path), str(path))


@lru_cache
def load_variants() -> tuple[Variant, ...]:
    """Read Table 2, ordered by velocity."""
    path = CATALOGUE / "variants.toml"
    rows = [
        build(Variant, row, str(path), f"variant.{i}") for i, row in enumerate(read_toml(path)["variant"], 1)
    ]
    return tuple(sorted(rows, key=lambda row: row.velocity))


@lru_cache
def load_paper() -> Paper:
    """Read the published figures: a_θ, the line of Fig. 4 and Table 3."""
    path = CATALOGUE / "paper.toml"
    table = dict(read_toml(path))
    rows = tuple(
        build(Published, row, str(path), f"table3.{i}") for i, row in enumerate(table.pop("table3"), 1)
    )
    return dataclasses.replace(build(Paper, table, str(path)), table3=rows)


def variant_of(velocity: float) -> Variant:
    """Return the variant of Table 2 with this velocity [m/s].

    Raises:
        UsageError: no such variant.
    """
    for variant in load_variants():
        if abs(variant.velocity - velocity) < 1e-6:
            return variant
    known = ", ".join(f"{v.velocity:g}" for v in load_variants())
    raise UsageError(
        f"unknown variant '{velocity:g}'", f"known [m/s]: {known}; or give --v, --a and --distance"
    )


@dataclass(frozen=True)
class Provenance:
    """One parameter in force: where it stands, what it is worth and what it may be."""

    group: str
    key: str
    symbol: str
    value: float | str
    unit: str
    low: float
    high: float
    meaning: str
    origin: str


def provenance(record: Any, group: str, origin: str, given: dict[str, Any]) -> Iterator[Provenance]:
    """List every parameter of a record with its unit, bounds and origin.

    Args:
        record: a dataclass of `granite_lab.parameters.records`.
        group: name of the record in the list, as ``robot``.
        origin: the file the record was read from.
        given: the parsed file; what is absent there is a default.
    """
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        key = key_of(field)
        if dataclasses.is_dataclass(value):
            source = f"{CATALOGUE.name}/imu_grades.toml" if field.name == "imu_grade" else origin
            inner = given.get(key)
            filled = {key_of(f): True for f in dataclasses.fields(value)} if inner is None else inner
            yield from provenance(
                value, f"{group}.{field.name}", source, filled if field.name == "imu_grade" else inner or {}
            )
        elif "unit" in field.metadata:
            m = field.metadata
            yield Provenance(
                group, key, m["symbol"], value, m["unit"], m["low"], m["high"], m["meaning"],
                origin if key in given else "default",
            )  # fmt: skip
