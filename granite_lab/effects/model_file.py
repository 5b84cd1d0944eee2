"""`model.toml`: the paper's model as fitted, sand, a_θ and effects, and where the numbers come from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from granite_lab.effects.library import get, library, load_effects
from granite_lab.errors import InputError, LabError
from granite_lab.estimate import Estimate
from granite_lab.files import write_text
from granite_lab.model.dictionary import dictionary
from granite_lab.model.effect import Active, Effect, activate
from granite_lab.parameters import Robot, Soil, load_robot, load_soil
from granite_lab.parameters.changes import Changes, checked
from granite_lab.parameters.quantity import check_number, key_of, read_toml, toml_line, unknown_key

SCHEMA = "granite-lab/model/3"
OLD = ("granite-lab/model/1", "granite-lab/model/2")
"""Schemas without `sand`, which are read, too."""

LAWS = ("exponential", "constant")


@dataclass(frozen=True)
class FittedEffect:
    """An effect with the values that a fit found.

    Attributes:
        effect: the effect.
        values: parameter name to value and standard deviation, in the parameter's unit; every
            parameter of the effect.
        twins: ids of effects that the data could not tell from it.
    """

    effect: Effect
    values: Mapping[str, Estimate]
    twins: tuple[str, ...] = ()

    @property
    def active(self) -> Active:
        """The effect switched on."""
        return activate(self.effect, {name: e.value for name, e in self.values.items()})


@dataclass(frozen=True)
class ModelFile:
    """A baseline with effects.

    Attributes:
        robot, soil: names of the catalogue or paths.
        law: "exponential", k_92 = exp(-a_θ v_d), or "constant".
        law_value: a_θ [s/m] or the constant k_92 [-].
        fitted: the effects, in the order in which their hooks apply.
        provenance: whatever tells where the values come from: version, inputs, seed.
        sand: fitted numbers of the soil, in place of those of its file; name of the field of `Soil` to value
            and std.
        lugs: number of lugs as found; None: as the robot's file says.
        changes: numbers of robot and soil that were set in place of those of their files.
    """

    robot: str
    soil: str
    law: str
    law_value: Estimate
    fitted: tuple[FittedEffect, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    sand: Mapping[str, Estimate] = field(default_factory=dict)
    lugs: float | None = None
    changes: Changes = ()

    @property
    def machine(self) -> Robot:
        """The robot with the number of lugs that was found; raises as `load_robot` does."""
        return self.with_lugs(load_robot(self.robot, changes=self.changes))

    @property
    def ground(self) -> Soil:
        """The soil with the fitted numbers; raises as `load_soil` does."""
        fitted: dict[str, Any] = {name: e.value for name, e in self.sand.items()}
        return replace(load_soil(self.soil, self.changes), **fitted)

    def with_lugs(self, robot: Robot) -> Robot:
        """Return a robot with the number of lugs that was found."""
        return robot if self.lugs is None else replace(robot, wheels=replace(robot.wheels, lugs=self.lugs))

    @property
    def effects(self) -> tuple[Active, ...]:
        """The effects switched on."""
        return tuple(f.active for f in self.fitted)

    @property
    def mean_effects(self) -> tuple[Active, ...]:
        """The effects of a trial whose phases are not known: what changes from trial to trial is neutral."""
        return tuple(
            activate(
                f.effect, {p.name: f.values[p.name].value for p in f.effect.parameters if not p.per_trial}
            )
            for f in self.fitted
        )

    @property
    def k92(self) -> float | None:
        """The constant k_92, or None under the exponential law."""
        return self.law_value.value if self.law == "constant" else None

    @property
    def a_theta(self) -> float | None:
        """a_θ [s/m], or None under a constant k_92."""
        return self.law_value.value if self.law == "exponential" else None


def load_model(path: Path | str, code: Path | str | None = None) -> ModelFile:
    """Read a model file.

    Args:
        path: the file; robot and soil files it names by path are looked for beside it.
        code: a user's own effect file, which is run, for effects that are not in the package.

    Raises:
        InputError: the file, or a key in it, cannot be used; the message names both and what is allowed.
    """
    file = Path(path)
    table = read_toml(file)
    where = str(file)
    _refuse_unknown(
        where, table, ("schema", "robot", "soil", "lugs", "changes", "sand", "k92", "provenance", "effect")
    )
    if table.get("schema") not in (SCHEMA, *OLD):
        raise InputError(
            f"{where}: schema = {table.get('schema')!r} is not that of a model file", f'expected "{SCHEMA}"'
        )
    effects = library() | dictionary() | (load_effects(code) if code else {})
    rows = table.get("effect", [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{where}: 'effect' must be a list of tables", "write [[effect]] above each")
    fitted = tuple(_read_effect(f"{where}: [[effect]] {i}", row, effects) for i, row in enumerate(rows, 1))
    ids = [f.effect.id for f in fitted]
    for name in ids:
        if ids.count(name) > 1:
            raise InputError(f"{where}: effect '{name}' is listed twice", "keep one of the two")
    provenance = table.get("provenance", {})
    if not isinstance(provenance, dict):
        raise InputError(f"{where}: 'provenance' must be a table", "write [provenance] above its keys")
    law, value = _read_law(where, table.get("k92"))
    robot = _catalogued(file, table, "robot", load_robot)
    soil = _catalogued(file, table, "soil", load_soil)
    lugs = check_number(where, "lugs", table["lugs"], "", 0, 200) if "lugs" in table else None
    sand = _read_sand(where, table.get("sand", {}))
    changes = table.get("changes", {})
    if not isinstance(changes, dict):
        raise InputError(f"{where}: 'changes' must be a table", "write [changes] above its keys")
    changes = checked(changes, f"{where}: [changes]")
    return ModelFile(robot, soil, law, value, fitted, provenance, sand, lugs, changes)


def _read_sand(where: str, table: Any) -> dict[str, Estimate]:
    place = f"{where}: [sand]"
    if not isinstance(table, dict) or not all(isinstance(row, dict) for row in table.values()):
        raise InputError(f"{place}: is not a table of numbers", "write key = { value = …, std = … }")
    of = {key_of(f): f for f in fields(Soil) if "unit" in f.metadata}
    _refuse_unknown(place, table, tuple(of))
    sand = {}
    for key, row in table.items():
        m, entry = of[key].metadata, f"{place}: {key}"
        _refuse_unknown(entry, row, ("value", "std"))
        sand[of[key].name] = _read_estimate(entry, row, m["unit"], m["low"], m["high"])
    return sand


def _refuse_unknown(where: str, table: dict[str, Any], keys: tuple[str, ...]) -> None:
    for key in table:
        if key not in keys:
            raise unknown_key(where, key, list(keys))


def _catalogued(file: Path, table: dict[str, Any], key: str, load: Any) -> str:
    """Return the name or path of a robot or a soil, which must exist."""
    name = table.get(key)
    if not isinstance(name, str):
        raise InputError(f"{file}: '{key}' is missing", f'add {key} = "<name or path>"')
    if name.endswith(".toml") and not Path(name).is_absolute():
        name = str(file.parent / name)
    try:
        load(name)
    except LabError as error:
        raise InputError(f"{file}: {key}: {error.message}", error.hint) from None
    return name


def _read_law(where: str, table: Any) -> tuple[str, Estimate]:
    if not isinstance(table, dict):
        raise InputError(f"{where}: [k92] is missing", "add [k92] with law, value and std")
    place = f"{where}: [k92]"
    _refuse_unknown(place, table, ("law", "value", "std"))
    law = table.get("law")
    if law not in LAWS:
        raise InputError(f"{place}: law = {law!r} is not known", f"one of: {', '.join(LAWS)}")
    unit, high = ("", 2.0) if law == "constant" else ("s/m", 100.0)
    return law, _read_estimate(place, table, unit, 0.0, high)


def _read_estimate(place: str, table: dict[str, Any], unit: str, low: float, high: float) -> Estimate:
    if "value" not in table:
        raise InputError(f"{place}: 'value' is missing", f"add value = … ({unit or 'a number'})")
    value = check_number(place, "value", table["value"], unit, low, high)
    if "std" not in table:
        return Estimate(value)
    return Estimate(value, check_number(place, "std", table["std"], unit, 0.0, 1e12))


def _read_effect(place: str, row: dict[str, Any], effects: Mapping[str, Effect]) -> FittedEffect:
    _refuse_unknown(place, row, ("id", "parameters", "indistinguishable_from"))
    name = row.get("id")
    if not isinstance(name, str):
        raise InputError(f"{place}: 'id' is missing", 'add id = "<effect>"')
    try:
        effect = get(name, effects)
    except LabError as error:
        hint = f"{error.hint}; an effect of your own needs --effects FILE"
        raise InputError(f"{place}: {error.message}", hint) from None
    place = f"{place} ({name})"
    given = row.get("parameters", {})
    if not isinstance(given, dict) or not all(isinstance(v, dict) for v in given.values()):
        raise InputError(
            f"{place}: 'parameters' must hold a table for each parameter",
            'write name = { value = …, std = …, unit = "…" } below [effect.parameters]',
        )
    _refuse_unknown(f"{place}: parameters", given, tuple(p.name for p in effect.parameters))
    values = {}
    for p in effect.parameters:
        if p.name not in given:
            values[p.name] = Estimate(p.neutral)
            continue
        table, where = given[p.name], f"{place}: {p.name}"
        _refuse_unknown(where, table, ("value", "std", "unit"))
        if table.get("unit", p.unit) != p.unit:
            raise InputError(f"{where}: unit = {table['unit']!r} does not fit", f"expected {p.unit!r}")
        values[p.name] = _read_estimate(where, table, p.unit, p.low, p.high)
    twins = row.get("indistinguishable_from", [])
    if not isinstance(twins, list) or not all(isinstance(t, str) for t in twins):
        raise InputError(f"{place}: 'indistinguishable_from' is not a list of ids", 'write ["<id>", …]')
    return FittedEffect(effect, values, tuple(twins))


def save_model(model: ModelFile, path: Path | str) -> None:
    """Write a model file, whole or not at all; `load_model` gives back what was written.

    Raises:
        LabError: the file cannot be written.
    """
    lines = [
        "# The paper's model as fitted, with effects switched on. Use it with --model.",
        toml_line("schema", SCHEMA),
        toml_line("robot", model.robot),
        toml_line("soil", model.soil),
        *([] if model.lugs is None else [f"{toml_line('lugs', model.lugs)}  # as found, not as filed"]),
        "",
        "[k92]",
        toml_line("law", model.law),
        *(toml_line(k, v) for k, v in _number(model.law_value).items()),
    ]
    if model.changes:
        lines += ["", "[changes]  # as set, in place of the files of robot and soil"]
        lines += [toml_line(key, value) for key, value in model.changes]
    if model.sand:
        lines += ["", "[sand]  # as fitted, in place of the soil's file"]
        keys = {f.name: f for f in fields(Soil)}
        lines += [
            f"{toml_line(key_of(keys[name]), _number(e))}  # {keys[name].metadata['meaning']}"
            for name, e in model.sand.items()
        ]
    if model.provenance:
        lines += ["", "[provenance]"]
        lines += [toml_line(k, v) for k, v in model.provenance.items() if v is not None]
    for item in model.fitted:
        lines += ["", "[[effect]]", f"{toml_line('id', item.effect.id)}  # {item.effect.title}"]
        if item.twins:
            lines.append(toml_line("indistinguishable_from", item.twins))
        lines.append("[effect.parameters]")
        for p in item.effect.parameters:
            if p.name in item.values:
                body = _number(item.values[p.name]) | {"unit": p.unit}
                lines.append(f"{toml_line(p.name, body)}  # {p.meaning}")
    write_text(Path(path), "\n".join(lines) + "\n")


def _number(e: Estimate) -> dict[str, float]:
    """Return value and std as the file holds them; an unknown std is left out."""
    return {"value": float(e.value)} | ({"std": float(e.std)} if math.isfinite(e.std) else {})
