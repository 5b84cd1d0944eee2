"""Parameter records whose numbers are CasADi symbols, and the flat vector that fills them.

The records of `granite_lab.parameters` carry expressions as well as numbers, so that an equation
reads the same whether it is evaluated or differentiated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Hashable, Iterator
from functools import cache, lru_cache
from typing import Any, TypeVar, cast

import casadi as ca

from granite_lab.errors import InputError
from granite_lab.parameters import (
    Chassis,
    Drive,
    Imu,
    Robot,
    Soil,
    Variant,
    Wheels,
    is_driven,
    load_robot,
    load_soil,
    load_variants,
)

T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class ModelParameters:
    """All numbers of the paper's model; floats outside, CasADi symbols inside the graph.

    Attributes:
        wheels, chassis, drive, imu, soil, variant: as in the catalogue.
        k92_constant: the constant k_92 [-], in force where `k92_is_constant` is 1.
        a_theta: a_θ of (5) [s/m], in force where `k92_is_constant` is 0.
        k92_is_constant: 1 or 0.
    """

    wheels: Wheels
    chassis: Chassis
    drive: Drive
    imu: Imu
    soil: Soil
    variant: Variant
    k92_constant: Any
    a_theta: Any
    k92_is_constant: Any


MOST_UNEVEN = 0.1
"""Largest difference of a wheel's radius from the one that the contact is computed with, over it: contact
angles go by √r, so that they are right within 5 %."""

DIRECT = Drive(
    inductance=1e-3, resistance=1.0, emf_constant=1.0, torque_constant=1.0, gear_ratio=1.0,
    gear_efficiency=1.0, voltage_max=1e3, gain_p=0.0, gain_d=0.0,
)  # fmt: skip
"""Stands for an unknown drive, where wheels are turned: its current is the torque."""


def model_parameters(
    robot: Robot, soil: Soil, variant: Variant, *, k92: float | None = None, a_theta: float = 0.0
) -> ModelParameters:
    """Gather all numbers of the model.

    Args:
        robot: with chassis and drive; wheels that are turned need no drive.
        soil: the ground.
        variant: the commanded trapezoid, or a course.
        k92: a constant k_92; None for the exponential law (5).
        a_theta: a_θ of (5) [s/m].

    Raises:
        InputError: the robot's file has no [chassis] or no [drive].
    """
    turned = is_driven(variant)
    for part in ("chassis",) if turned else ("chassis", "drive"):
        if getattr(robot, part) is None:
            raise InputError(
                f"robot '{robot.name}' has no [{part}] table and cannot be simulated",
                f"add [{part}] to its file; granite-lab robot FILE writes one with all keys",
            )
    if robot.motors == "side" and not turned:
        raise InputError(
            f"a motor of '{robot.name}' drives both wheels of a side: no command can be simulated",
            "let the measured wheels drive: --drive auto or wheels, simulate --wheels",
        )
    if robot.wheels.uneven > MOST_UNEVEN:
        raise InputError(
            f"the wheels of '{robot.name}' differ by {100 * robot.wheels.uneven:.0f} % from radius_m: the "
            f"model holds for up to {100 * MOST_UNEVEN:.0f} %",
            "ingest still estimates velocity and slip; there is no simulation",
        )
    assert robot.chassis is not None
    drive = robot.drive or (DIRECT if turned else None)
    assert drive is not None
    return ModelParameters(
        robot.wheels, robot.chassis, drive, robot.imu, soil, variant,
        0.0 if k92 is None else float(k92), float(a_theta), 0.0 if k92 is None else 1.0,
    )  # fmt: skip


def paper_symbols() -> ModelParameters:
    """Return a symbol for every number of the paper's model."""
    return symbolic(model_parameters(load_robot(), load_soil(), load_variants()[0]))


def _numbers(record: Any) -> Iterator[Any]:
    """Yield the numbers or symbols of a nested record, in field order."""
    for name in _names(record.__class__):
        value = getattr(record, name)
        if isinstance(value, (int, float, ca.SX)) and not isinstance(value, bool):
            yield value
        elif dataclasses.is_dataclass(value):
            yield from _numbers(value)


@cache
def _names(kind: type) -> tuple[str, ...]:
    """Return the fields of a record; every simulation asks for them."""
    return tuple(field.name for field in dataclasses.fields(kind))


@lru_cache(maxsize=256)
def _floats(record: Hashable) -> tuple[float, ...]:
    """Return the numbers of a record; many runs share their robot."""
    return tuple(float(value) for value in _numbers(record))


def vector_of(record: Any) -> list[float]:
    """Return the numbers of a record as one flat list."""
    numbers: list[float] = []
    for name in _names(record.__class__):
        value = getattr(record, name)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            numbers.append(float(value))
        elif dataclasses.is_dataclass(value):
            numbers += _floats(cast(Hashable, value))
    return numbers


def symbols_of(record: Any) -> Any:
    """Return the symbols of a symbolic record as one CasADi column, in the order of `vector_of`."""
    return ca.vertcat(*_numbers(record))


def symbolic(record: T, prefix: str = "") -> T:
    """Return the record with a CasADi symbol in place of each number, named after its place."""
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(record):  # type: ignore[arg-type]
        value = getattr(record, field.name)
        name = f"{prefix}{field.name}"
        if dataclasses.is_dataclass(value):
            changes[field.name] = symbolic(value, f"{name}.")
        elif isinstance(value, (int, float)):
            changes[field.name] = ca.SX.sym(name)
    return dataclasses.replace(record, **changes)  # type: ignore[type-var]
