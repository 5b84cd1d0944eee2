"""All influences by id, and the model of a trial under some of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import ModuleType

from granite_lab.errors import UsageError, known_names
from granite_lab.hidden import drive, outside, soil, soil_law, tyre, vehicle
from granite_lab.hidden.command import Command
from granite_lab.hidden.controller import CONTROLLERS
from granite_lab.hidden.influence import Influence
from granite_lab.hidden.model import Setup, Truth
from granite_lab.hidden.parts import Sizes


def _held_by(*modules: ModuleType) -> dict[str, type[Influence]]:
    """Return the influences that modules define, by id."""
    kinds = [kind for module in modules for kind in vars(module).values() if isinstance(kind, type)]
    return {k.id: k for k in kinds if issubclass(k, Influence) and k is not Influence}


LIBRARY = _held_by(soil, tyre, drive, vehicle)
"""Influences under the id of the library's effect that should be found."""

OUTSIDE = _held_by(outside)
"""Influences that no effect of the library describes."""

LAWS = _held_by(soil_law)
"""Influences that stand in place of the paper's contact law."""

UNKNOWN_TO_LIBRARY = {*OUTSIDE, soil_law.BearingLimit.id}
"""Ids of all influences that no effect of the library describes."""

TWINS: tuple[frozenset[str], ...] = (
    frozenset({"contact_angle_lag", "contact_angle_actual_speed"}),
    frozenset({"ground_slope", "imu_tilt"}),
    frozenset({"com_offset", "drive_reaction"}),
    frozenset({"bulldozing", "drivetrain_friction"}),
    frozenset({"bulldozing", "rolling_drag"}),
    frozenset({"torque_constant_error", "drivetrain_friction"}),
    frozenset({"sand_throw", "rolling_drag"}),
    frozenset({"clock_offset", "tyre_windup"}),
    frozenset({"encoder_eccentricity", "wheel_eccentricity"}),
)
"""Influences close to each other, which are not hidden as a pair."""


def influence(name: str) -> type[Influence]:
    """Return an influence by its id.

    Raises:
        UsageError: there is none of that name.
    """
    known = LIBRARY | OUTSIDE | LAWS
    if name not in known:
        raise UsageError(f"unknown hidden effect '{name}'", known_names(name, known))
    return known[name]


def model_of(names: Sequence[str], setup: Setup, command: Command, sizes: Mapping[str, Sizes]) -> Truth:
    """Return the truth's model under the named influences.

    Args:
        names: ids, in any order.
        setup, command: as for `Truth`.
        sizes: parameters of each influence by id, phases included.
    """
    kinds = [influence(name) for name in sorted(names)]
    bases = (CONTROLLERS[setup.controller],) if setup.controller else (Truth,)
    robot = setup.robot
    for kind in kinds:
        robot = kind.altered(robot, sizes[kind.id])
    model: Truth = type("Combined", (*kinds, *bases), {})(replace(setup, robot=robot), command, sizes)
    return model
