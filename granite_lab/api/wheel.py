"""`wheel`: one wheel on one soil, by the contact model (4), (6)-(17)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from granite_lab.api.calls import checked
from granite_lab.effects import get, library, load_effects
from granite_lab.effects.model_file import load_model
from granite_lab.errors import UsageError
from granite_lab.model.effect import Active, activate
from granite_lab.model.single_wheel import Ratio, SingleWheel, WheelPoint, acts, rolling
from granite_lab.parameters import GRAVITY, Robot, Soil, Wheels, load_paper, load_robot, load_soil
from granite_lab.parameters.catalogue import forget
from granite_lab.parameters.quantity import build, key_of

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T", Wheels, Soil)


@dataclass(frozen=True, eq=False)
class WheelRun:
    """One wheel at one or more slips.

    Attributes:
        points: the wheel at each slip, in the order of the slips.
        wheels, soil: what rolls on what.
        effects: effects that act on the wheel, with their values.
        left_out: ids of effects that cannot act on a single wheel.
    """

    points: tuple[WheelPoint, ...]
    wheels: Wheels
    soil: Soil
    effects: tuple[Active, ...]
    left_out: tuple[str, ...]

    @property
    def fades(self) -> bool:
        """Whether some motion is so slow that the model reduces its slip."""
        return any(p.rolling.fades for p in self.points)

    def to_frame(self) -> pd.DataFrame:
        """Return forces, torque, sinkage and angles, one row a slip."""
        import pandas as pd  # noqa: PLC0415

        return pd.DataFrame(
            [
                {
                    "slip": p.slip, "v_mps": p.rolling.velocity, "omega_radps": p.rolling.rate, "k92": p.k92,
                    "load_N": p.load, "drawbar_pull_N": p.drawbar_pull, "torque_Nm": p.torque,
                    "thrust_N": p.thrust, "resistance_N": p.resistance, "sinkage_mm": 1000 * p.sinkage,
                    "angle_front_deg": math.degrees(p.angle_front),
                    "angle_rear_deg": math.degrees(p.angle_rear),
                }
                for p in self.points
            ]
        )  # fmt: skip

    def arcs(self) -> pd.DataFrame:
        """Return the stresses over the contact arc, one row a slip and place from back to front."""
        import pandas as pd  # noqa: PLC0415

        return pd.concat(
            pd.DataFrame(
                {
                    "slip": p.slip, "angle_deg": p.angle * 180 / math.pi,
                    "normal_stress_Pa": p.normal_stress, "shear_stress_Pa": p.shear_stress,
                }
            )
            for p in self.points
        ).reset_index(drop=True)  # fmt: skip


@checked
def wheel(
    slip: float | Sequence[float],
    *,
    load: float | None = None,
    sinkage: float | None = None,
    k92: float | None = None,
    a_theta: float | None = None,
    omega: float | None = None,
    v: float | None = None,
    angle: float = 0.0,
    robot: str | Path | Robot | None = None,
    radius: float | None = None,
    width: float | None = None,
    soil: str | Path | Soil | None = None,
    soil_values: Mapping[str, float] | None = None,
    model: str | Path | None = None,
    effects: str | Path | None = None,
    active: Mapping[str, Mapping[str, float]] | None = None,
) -> WheelRun:
    """Roll one wheel on one soil, at a load or at a sinkage, by the contact model (4), (6)-(17).

    The larger of ω r and the velocity is 0.1 m/s where neither is given; the equations do not depend on it
    above 0.02 m/s, effects may.

    Args:
        slip: slip ratio λ of (1), one or several; negative where the wheel brakes.
        load: vertical load [N]; a quarter of the robot's weight by default.
        sinkage: z_0 [m] instead of a load.
        k92: ϑ_2 / ϑ_1; by default (5), k_92 = exp(-a_θ v), at the larger of ω r and the velocity.
        a_theta: a_θ [s/m]; the paper's by default.
        omega: angular velocity [rad/s].
        v: velocity of the wheel's centre [m/s].
        angle: of the wheel [rad], for effects that depend on it.
        robot, soil: names or files of the catalogue, or records.
        radius, width: of the wheel instead of the robot's [m].
        soil_values: values instead of the soil's, by the keys of its file, as ``{"cohesion_Pa": 500}``.
        model: model.toml, the paper's model with effects switched on.
        effects: your own effect file (.py). It is run: use only code you trust.
        active: effects to switch on, id to its parameters.

    Raises:
        UsageError: unknown name, or arguments that do not fit together.
        InputError: a number out of its bounds, or a file that cannot be used.
        EstimateError: the wheel sinks to its axle.
    """
    if k92 is not None and a_theta is not None:
        raise UsageError("--k92 and --a-theta exclude each other", "give one of the two")
    if load is not None and sinkage is not None:
        raise UsageError("--load and --sinkage exclude each other", "give one of the two")
    forget()
    base = load_model(Path(model), Path(effects) if effects else None) if model else None
    known = library() | (load_effects(Path(effects)) if effects and not model else {})
    switched = tuple(activate(get(name, known), values) for name, values in (active or {}).items())
    switched = (base.effects if base else ()) + switched
    body = robot if isinstance(robot, Robot) else load_robot(robot or (base.robot if base else "granite"))
    ground = soil if isinstance(soil, Soil) else load_soil(soil or (base.soil if base else "dry_sand"))
    rim = changed(body.wheels, {"radius_m": radius, "width_m": width})
    ground = changed(ground, soil_values or {})
    if k92 is None and a_theta is None and base:
        k92, a_theta = base.k92, base.a_theta
    ratio = Ratio(k92, load_paper().a_theta if a_theta is None else a_theta)
    _check(ratio, load)
    if load is None and sinkage is None:
        if body.chassis is None:
            raise UsageError("the load is not given", "add --load or --sinkage")
        load = body.chassis.total_mass * GRAVITY / 4
    it = SingleWheel(rim, ground, switched, body.chassis)
    points = []
    for one in [slip] if isinstance(slip, (int, float)) else slip:
        motion = rolling(float(one), rim.radius, omega=omega, velocity=v, angle=angle)
        if sinkage is not None:
            points.append(it.at_sinkage(sinkage, motion, ratio))
        else:
            points.append(it.at_load(load or 0.0, motion, ratio))
    left_out = tuple(e.id for e in switched if not acts(e.effect))
    return WheelRun(tuple(points), rim, ground, it.effects, left_out)


def _check(ratio: Ratio, load: float | None) -> None:
    """Refuse numbers that mean nothing.

    Raises:
        UsageError: k_92, a_θ or the load is out of range.
    """
    if ratio.k92 is not None and not 0 <= ratio.k92 <= 1:
        raise UsageError(f"--k92 {ratio.k92:g} is out of range", "expected a number from 0 to 1")
    if not 0 <= ratio.a_theta <= 100:
        raise UsageError(f"--a-theta {ratio.a_theta:g} is out of range", "expected 0 to 100 s/m")
    if load is not None and not 0 < load < 1e6:
        raise UsageError(f"--load {load:g} is out of range", "expected a number above 0 and below 1e6 N")


def changed(record: T, values: Mapping[str, float | None]) -> T:
    """Return a record of a file with some values replaced, by their keys in the file.

    Raises:
        InputError: unknown key, or a number out of its bounds.
    """
    given = {key: value for key, value in values.items() if value is not None}
    if not given:
        return record
    table: dict[str, Any] = {key_of(f): getattr(record, f.name) for f in dataclasses.fields(record)}
    return build(type(record), table | given, "command line")
