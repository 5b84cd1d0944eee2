"""All influences by id, and the model of a trial under some of them."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence

from granite_lab.errors import UsageError
from granite_lab.hidden import drive, outside_forces, outside_machine, soil, tyre, vehicle
from granite_lab.hidden.command import Trapezoid
from granite_lab.hidden.contact import FLOOR, NearRest
from granite_lab.hidden.influence import Influence
from granite_lab.hidden.model import Truth
from granite_lab.hidden.parts import Law, Sizes
from granite_lab.parameters import Robot, Soil

LIBRARY: dict[str, type[Influence]] = {
    kind.id: kind
    for kind in (
        soil.Bulldozing,
        soil.SlipSinkage,
        soil.MultiPass,
        soil.RateDependentSoil,
        soil.TreadRipple,
        soil.ContactAngleLag,
        soil.ContactAngleActualSpeed,
        soil.SandThrow,
        tyre.TyreWindup,
        tyre.RadialTyreCompliance,
        drive.DrivetrainFriction,
        drive.GearBacklash,
        drive.SupplySag,
        drive.TorqueConstantError,
        drive.EncoderEccentricity,
        tyre.WheelEccentricity,
        vehicle.DriveReaction,
        vehicle.ComOffset,
        vehicle.PayloadMass,
        vehicle.GroundSlope,
        vehicle.RollingDrag,
        vehicle.ImuTilt,
        vehicle.ClockOffset,
        vehicle.WheelRadiusError,
        vehicle.AccelScaleError,
    )
}
"""Influences under the id of the library's effect that should be found."""

OUTSIDE: dict[str, type[Influence]] = {
    kind.id: kind
    for kind in (
        outside_forces.MoistureGradient,
        outside_forces.SoilAdhesion,
        outside_forces.Washboard,
        outside_forces.CableDrag,
        outside_forces.WindGust,
        outside_forces.StrapDrag,
        outside_machine.WarmMotor,
        outside_machine.CommandStaircase,
        outside_machine.SwingingLoad,
    )
}
"""Influences that no effect of the library describes."""

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
    known = LIBRARY | OUTSIDE
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        raise UsageError(
            f"no hidden effect is called '{name}'",
            (f"did you mean '{close[0]}'? " if close else "") + f"known: {', '.join(known)}",
        )
    return known[name]


def model_of(
    names: Sequence[str],
    robot: Robot,
    soil_: Soil,
    command: Trapezoid,
    law: Law,
    sizes: Mapping[str, Sizes],
    intervals: int = 32,
    near_rest: NearRest = FLOOR,
    radii: tuple[float, float] = (1.0, 1.0),
) -> Truth:
    """Return the truth's model under the named influences.

    Args:
        names: ids, in any order.
        robot, soil_, command, law, intervals, near_rest, radii: as for `Truth`.
        sizes: parameters of each influence by id, phases included.
    """
    kinds = [influence(name) for name in sorted(names)]
    for kind in kinds:
        robot = kind.altered(robot, sizes[kind.id])
    combined = type("Combined", (*kinds, Truth), {})
    model: Truth = combined(robot, soil_, command, law, intervals, sizes, near_rest, radii)
    return model
