"""What the catalogue holds, by name, and a user's own files, by path."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granite_lab.columns import Column, Table, words
from granite_lab.errors import InputError, UsageError, known_names
from granite_lab.parameters.changes import OPTION, Changes, changed
from granite_lab.parameters.quantity import build, key_of, read_toml, table_of
from granite_lab.parameters.records import WHEELS, Imu, ImuGrade, Paper, Robot, Soil, Variant
from granite_lab.rounding import tidy_unit
from granite_lab.shown import frame

if TYPE_CHECKING:
    import pandas as pd

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
    there = names(kind)
    if text in there:
        return CATALOGUE / kind / f"{text}.toml"
    raise UsageError(
        f"unknown {kind[:-1]} '{text}'", f"{known_names(text, there)}; or give the path of a .toml file"
    )


def own_file(kind: str, name: str, folder: Path) -> str:
    """Return the path of the user's file that a log's name stands for, any other name as it is.

    Such a file lies in the log's folder. It is the one of that name, or a robot or soil that says
    ``name = "…"``; a name of the catalogue stands for the catalogue's.
    """
    if not name or name in names(kind):
        return name
    if name.endswith(".toml"):
        return str(folder / name) if (folder / name).is_file() else name
    for path in sorted(folder.glob("*.toml")):
        with suppress(InputError):
            table = read_toml(path)
            if table.get("name") == name and ("wheels" in table) == (kind == "robots"):
                return str(path)
    return name


@lru_cache
def load_robot(name: str | Path = "granite", grade: str | None = None, changes: Changes = ()) -> Robot:
    """Read a robot and attach its IMU's grade.

    Args:
        name: a name of the catalogue or the path of a TOML file.
        grade: an IMU grade that replaces the file's.
        changes: numbers in place of those of the files.

    Raises:
        UsageError: unknown name or grade.
        InputError: the file is wrong, or lacks the part to which a number belongs.
    """
    path = find("robots", name)
    table = read_toml(path)
    wheels = table.get("wheels")
    if isinstance(wheels, dict) and (count := wheels.pop("count", len(WHEELS))) != len(WHEELS):
        raise InputError(
            f"{path}: [wheels]: count = {count}: robots with four wheels can be analysed, on two axles",
            "one with another number of wheels can be neither estimated nor simulated",
        )
    robot = build(Robot, {"imu_grade": table_of(load_grade(Imu.grade)), **table}, str(path))
    if grade is not None or "imu_grade" not in table:
        robot = dataclasses.replace(robot, imu_grade=load_grade(grade or robot.imu.grade))
    return changed(robot, "robot", changes)


def clear_cache() -> None:
    """Have robots and soils read again at their next use: a user may have edited a file."""
    load_robot.cache_clear()
    load_soil.cache_clear()


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
def load_soil(name: str | Path = "dry_sand", changes: Changes = ()) -> Soil:
    """Read a soil, by name or path, with `changes` in place of numbers of its file.

    Raises:
        UsageError: unknown name.
        InputError: the file is wrong.
    """
    path = find("soils", name)
    return changed(build(Soil, read_toml(path), str(path)), "soil", changes)


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
    return build(Paper, read_toml(path), str(path))


def variant_of(velocity: float) -> Variant:
    """Return the variant of Table 2 with this velocity [m/s].

    Raises:
        UsageError: no such variant.
    """
    for variant in load_variants():
        if abs(variant.velocity - velocity) < 1e-6:
            return variant
    velocities = ", ".join(f"{v.velocity:g}" for v in load_variants())
    raise UsageError(
        f"unknown variant '{velocity:g}'", f"known [m/s]: {velocities}; or give --v, --a and --distance"
    )


DEFAULT = "default"
"""Origin of a number that no file states."""


@dataclass(frozen=True)
class Provenance:
    """One parameter in force: where it stands, what it is worth and what it may be."""

    group: str
    key: str
    symbol: str
    value: float
    unit: str
    low: float
    high: float
    meaning: str
    origin: str

    def to_frame(self) -> pd.DataFrame:
        """Return one row."""
        return frame([dataclasses.asdict(self)])


def provenance_table(*, origin: bool) -> Table[Provenance]:
    """Return the table of parameters, with their `origin` where it is asked for."""
    return Table[Provenance](
        "in_force",
        "Parameters in force",
        Column("key", lambda p: p.key),
        Column("symbol", lambda p: p.symbol),
        Column("value", lambda p: f"{p.value:g}" if isinstance(p.value, (int, float)) else p.value, "value"),
        Column("unit", lambda p: words(tidy_unit(p.unit))),
        Column("allowed", lambda p: f"{p.low:g} … {p.high:g}"),
        Column("from", lambda p: p.origin, shown=origin),
    )


VARIANTS = Table[Variant](
    "variants",
    "Variants of motion (Table 2)",
    Column("velocity", lambda v: v.velocity, "velocity", unit="m/s", form="g"),
    Column("acceleration", lambda v: v.acceleration, "acceleration", unit="m/s²", form="g"),
    Column("distance", lambda v: v.distance, "distance", unit="m", form="g"),
)


def in_force(robot: str, soil: str, changes: Changes = ()) -> list[Provenance]:
    """List every number of a robot and a soil with its unit, bounds and origin; `changes` as in `load_robot`.

    Raises:
        UsageError: unknown robot or soil.
        InputError: a file is wrong.
    """
    rows: list[Provenance] = []
    for group, record, path in (
        ("robot", load_robot(robot, changes=changes), find("robots", robot)),
        ("soil", load_soil(soil, changes), find("soils", soil)),
    ):
        rows += _list(record, group, _short(path), read_toml(path))
    changed_keys = dict(changes)
    return [
        dataclasses.replace(p, origin=OPTION) if f"{p.group}.{p.key}" in changed_keys else p for p in rows
    ]


def _short(path: Path) -> str:
    """Name a file of the catalogue without the folders above it."""
    return str(path.relative_to(CATALOGUE.parent)) if path.is_relative_to(CATALOGUE) else str(path)


def _list(record: Any, group: str, origin: str, given: dict[str, Any]) -> Iterator[Provenance]:
    for field in dataclasses.fields(record):
        value, key = getattr(record, field.name), key_of(field)
        if field.name == "imu_grade" and key not in given:
            everything = {key_of(f): True for f in dataclasses.fields(value)}
            yield from _list(value, f"{group}.imu_grade", _short(CATALOGUE / "imu_grades.toml"), everything)
        elif dataclasses.is_dataclass(value):
            yield from _list(value, f"{group}.{field.name}", origin, given.get(key, {}))
        elif "unit" in field.metadata:
            place = origin if key in given else DEFAULT
            yield Provenance(group=group, key=key, value=value, origin=place, **field.metadata)
