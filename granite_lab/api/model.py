"""`simulate`, `wheel`, `params`, `robot`, `list_effects`, `show_effect`: the model and its numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from granite_lab.api.arguments import Changes, File, options, path, refuse_outside
from granite_lab.api.project import FILE, project_in
from granite_lab.api.records import Records
from granite_lab.effects import get, library
from granite_lab.effects.model_file import load_model
from granite_lab.errors import InputError, UsageError
from granite_lab.files import is_folder, write_text
from granite_lab.fitting.tow import constant
from granite_lab.logs import write_canonical
from granite_lab.model import Accuracy, Run
from granite_lab.model import simulate as run_model
from granite_lab.model.command import hauling
from granite_lab.model.effect import Active, Effect, activate
from granite_lab.model.single_wheel import Ratio, SingleWheel, WheelPoint, acts, rolling
from granite_lab.parameters import (
    GRAVITY,
    Robot,
    Soil,
    Variant,
    Wheels,
    course_of,
    load_paper,
    load_robot,
    load_soil,
    parse_path,
    variant_of,
)
from granite_lab.parameters.analyses import Allowed, allowed_by
from granite_lab.parameters.catalogue import Provenance, clear_cache, in_force
from granite_lab.parameters.changes import OPTION, changed, checked
from granite_lab.parameters.new_robot import text_of
from granite_lab.parameters.quantity import build
from granite_lab.shown import Shown, frame

if TYPE_CHECKING:
    import pandas as pd


Switched = Mapping[str, Mapping[str, float]] | None
"""Effects that are switched on: id to its parameters."""


class _Model(NamedTuple):
    """The model that was asked for; of k_92 and a_θ at most one is given."""

    robot: Robot
    soil: Soil
    effects: tuple[Active, ...]
    k92: float | None
    a_theta: float | None


def _model(
    robot: File | Robot,
    soil: File | Soil,
    k92: float | None,
    a_theta: float | None,
    model: File,
    effects: File,
    active: Switched,
    changes: Changes,
) -> _Model:
    """Return the model that was asked for; what is given replaces numbers of the model file."""
    if k92 is not None and a_theta is not None:
        raise UsageError("--k92 and --a-theta exclude each other", "give one of the two")
    refuse_outside("k92", k92, 0, 1)
    refuse_outside("a-theta", a_theta, 0, 100)
    clear_cache()
    base = load_model(Path(model), path(effects)) if model else None
    of_file = library(None if model else effects)
    switched = tuple(activate(get(name, of_file), values) for name, values in (active or {}).items())
    if not isinstance(robot, Robot):
        robot = base.machine if base and robot is None else load_robot(robot or "granite")
    if not isinstance(soil, Soil):
        soil = base.ground if base and soil is None else load_soil(soil or "dry_sand")
    if base and k92 is None and a_theta is None:
        k92, a_theta = base.k92, base.a_theta
    numbers = checked(changes or {})
    robot, soil = changed(robot, "robot", numbers), changed(soil, "soil", numbers)
    return _Model(robot, soil, (base.effects if base else ()) + switched, k92, a_theta)


def simulate(
    variant: float | Variant | None = None,
    *,
    v: float | None = None, a: float | None = None, distance: float | None = None,
    command: str | Sequence[tuple[float, float]] | None = None, wheels: File = None,
    column_map: File = None, log: File = None, seed: int = 0,
    k92: float | None = None, a_theta: float | None = None, robot: File | Robot = None,
    soil: File | Soil = None, changes: Changes = None,
    model: File = None, effects: File = None, active: Switched = None,
) -> Run:  # fmt: skip
    """Simulate one run by equations (1)-(26), with k_92 = exp(-a_θ v) or a constant `k92`.

    Args:
        variant: variant of Table 2, named by its velocity [m/s].
        v: desired velocity [m/s] instead of a variant; needs `a` and `distance`.
        a: largest acceleration [m/s²] (with `v`).
        distance: total distance [m] (with `v`).
        command: any desired velocity, linear between times, as ``0:0, 1:0.3, 5:0.3, 6:0`` in s and m/s.
        wheels: a log whose measured wheel speeds drive the simulation; its robot and soil are used.
        column_map: column map of that log, as in `ingest`.
        log: file for the log of virtual sensors (CSV).
        seed: seed of the random numbers of the sensors.
        k92: constant k_92, 0 to 1; by default the law (5), k_92 = exp(-a_θ v).
        a_theta: exponent a_θ of the law (5) [s/m], 0 to 100; the paper's by default.
        robot, soil: names of the catalogue, .toml files or records; granite and dry_sand by default.
        changes: numbers of robot and soil in place of those of their files, as in `ingest`.
        model: file (model.toml) of the paper's model with effects switched on.
        effects: your own effect file (.py). It is executed: use only code you trust.
        active: effects to switch on, id to its parameters, as ``{"drive_reaction": {"share": 1.0}}``.

    Returns:
        the run; its table has a row for each instant.

    Raises:
        UsageError: unknown name, or arguments that do not fit together.
        InputError: a number out of its bounds, or a file that cannot be used.
        EstimateError: the robot finds no rest on this soil, or the simulation does not converge.
    """
    refuse_outside("seed", seed, 0)
    trapezoid = (variant, v, a, distance)
    given = [any(x is not None for x in trapezoid), command is not None, wheels is not None]
    if sum(given) > 1:
        others = "--variant, --v, --a and --distance"
        raise UsageError(f"--wheels and --command exclude each other, {others}", "give one of them")
    if wheels is not None:
        course, robot, soil = _of_log(Path(wheels), robot, soil, changes, column_map)
    else:
        course = _trapezoid(*trapezoid) if command is None else _commanded(command)
    chosen = _model(robot, soil, k92, a_theta, model, effects, active, changes)
    if chosen.robot.tow is not None and wheels is None:
        course = hauling(course, constant(chosen.robot), chosen.robot.tow.height)
    run = run_model(
        course, chosen.robot, chosen.soil,
        k92=chosen.k92, a_theta=chosen.a_theta, effects=chosen.effects,
        accuracy=Accuracy(1e-6, 1e-8, 0.0025) if log else Accuracy(),
    )  # fmt: skip
    if log:
        from granite_lab.model.virtual import virtual_trial  # noqa: PLC0415, heavy

        write_canonical(Path(log), virtual_trial(run, seed, Path(log).stem)[0])
    return run


def _of_log(
    log: Path, robot: File | Robot, soil: File | Soil, changes: Changes, column_map: File
) -> tuple[Variant, File | Robot, File | Soil]:
    """Return the motion of a log's wheels, with robot and soil: as given, else those of the log."""
    from granite_lab.chain import with_simulation_input  # noqa: PLC0415, heavy

    of_robot, of_soil = (None if isinstance(x, (Robot, Soil)) else x for x in (robot, soil))
    given = options(robot=of_robot, soil=of_soil, drive="wheels", changes=changes, column_map=column_map)
    trial, of_log, motion = with_simulation_input(log, given)
    return motion.variant, robot or of_log, soil or trial.info.soil


def _commanded(command: str | Sequence[tuple[float, float]]) -> Variant:
    """Return the motion of a list of times and velocities, which begins and ends at rest."""
    try:
        path = parse_path(command if isinstance(command, str) else " ".join(f"{t}:{v}" for t, v in command))
    except ValueError:
        hint = "write two or more times [s] and velocities [m/s], as 0:0, 1:0.3, 5:0.3, 6:0"
        raise UsageError(f"--command {command}: cannot be understood", hint) from None
    t, v = np.array(path).T
    if v.max() <= 0 or v.min() < 0:
        raise UsageError("--command: the model drives forward only", "give velocities of 0 or more")
    return course_of(t - t[0], v)


def _trapezoid(
    variant: float | Variant | None, v: float | None, a: float | None, distance: float | None
) -> Variant:
    """Return the motion that was asked for: a row of Table 2, or one given by its three numbers."""
    given: dict[str, Any] = {"velocity_mps": v, "acceleration_mps2": a, "distance_m": distance}
    if variant is not None:
        if any(value is not None for value in given.values()):
            raise UsageError("--variant excludes --v, --a and --distance", "give one or the other")
        return variant if isinstance(variant, Variant) else variant_of(variant)
    if any(value is None for value in given.values()):
        hint = "use --variant 0.5, all of --v, --a and --distance, --command or --wheels"
        raise UsageError("the motion is not given", hint)
    return build(Variant, given, "command line")


@dataclass(frozen=True, eq=False)
class WheelRun(Shown):
    """One wheel at one or more slips; `left_out` are ids of effects that cannot act on a single wheel."""

    points: tuple[WheelPoint, ...]
    wheels: Wheels
    soil: Soil
    effects: tuple[Active, ...]
    left_out: tuple[str, ...]

    def __repr__(self) -> str:
        slips = [p.slip for p in self.points]
        span = (
            f"{slips[0]:g}" if len(slips) == 1 else f"{min(slips):g} to {max(slips):g}, {len(slips)} values"
        )
        return f"WheelRun(slip ratio {span}, load {self.points[0].load:.4g} N on {self.soil.title})"

    @property
    def fades(self) -> bool:
        """Whether some motion is so slow that the model reduces its slip."""
        return any(p.rolling.fades for p in self.points)

    def to_frame(self) -> pd.DataFrame:
        """Return forces, torque, sinkage and angles, one row a slip."""
        return frame(
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


def wheel(
    slip: float | Sequence[float] = 0.2,
    *,
    load: float | None = None, sinkage: float | None = None, v: float | None = None,
    k92: float | None = None, a_theta: float | None = None, robot: File | Robot = None,
    soil: File | Soil = None, changes: Changes = None,
    model: File = None, effects: File = None, active: Switched = None,
) -> WheelRun:  # fmt: skip
    """Compute one wheel on the soil, at a load or a sinkage, by the contact model (4), (6)-(17).

    Without `v`, the larger of ω r and v is 0.1 m/s. Above 0.02 m/s only effects depend on it. The law (5) is
    evaluated at this velocity.

    Args:
        slip: slip ratio λ of (1), one or several; negative where the wheel brakes.
        load: vertical load [N], 0.001 to 100000; a quarter of the robot's weight by default.
        sinkage: z_0 [m] instead of a load.
        v: velocity of the wheel's centre [m/s].
        k92, a_theta, robot, soil, changes, model, effects, active: as in `simulate`.

    Raises:
        UsageError: unknown name, or arguments that do not fit together.
        InputError: a number out of its bounds, or a file that cannot be used.
        EstimateError: the wheel sinks to its axle.
    """
    refuse_outside("load", load, 0.001, 100_000)
    if load is not None and sinkage is not None:
        raise UsageError("--load and --sinkage exclude each other", "give one of the two")
    chosen = _model(robot, soil, k92, a_theta, model, effects, active, changes)
    rim, ground = chosen.robot.wheels, chosen.soil
    ratio = Ratio(chosen.k92, load_paper().a_theta if chosen.a_theta is None else chosen.a_theta)
    if load is None and sinkage is None:
        if chosen.robot.chassis is None:
            raise UsageError("the load is not given", "add --load or --sinkage")
        load = chosen.robot.chassis.total_mass * GRAVITY / 4
    single = SingleWheel(rim, ground, chosen.effects, chosen.robot.chassis)
    points = []
    for λ in [slip] if isinstance(slip, (int, float)) else slip:
        motion = rolling(float(λ), rim.radius, velocity=v)
        if sinkage is not None:
            points.append(single.at_sinkage(sinkage, motion, ratio))
        else:
            points.append(single.at_load(load or 0.0, motion, ratio))
    left_out = tuple(e.id for e in chosen.effects if not acts(e.effect))
    return WheelRun(tuple(points), rim, ground, single.effects, left_out)


def params(robot: File = None, soil: File = None) -> Records[Provenance]:
    """List every number in force with its unit, allowed range and origin.

    Args:
        robot, soil: names of the catalogue or .toml files; granite and dry_sand by default.

    Raises:
        UsageError: unknown robot or soil.
        InputError: a file is wrong.
    """
    clear_cache()
    return Records(in_force(str(robot or "granite"), str(soil or "dry_sand")))


def chosen_in(
    folder: Path, robot: str | Path | None = None, soil: str | Path | None = None
) -> dict[str, dict[str, str]]:  # fmt: skip
    """Return which robot and soil hold for the logs of a folder, and who says so: what is given wins over its
    `granite-lab.toml`.

    Raises:
        InputError: there is no such folder, or its file is wrong.
    """
    if not is_folder(folder):
        problem = "is not a folder" if folder.exists() else "does not exist"
        raise InputError(f"{folder}: {problem}", "give the folder in which the logs lie")
    project, chosen = project_in(folder), {}
    for key, given, default in (("robot", robot, "granite"), ("soil", soil, "dry_sand")):
        beside = getattr(project, key)
        origin = f"--{key}" if given else str(folder / FILE) if beside else "unless a log names another"
        chosen[key] = {"value": str(given or beside or default), "origin": origin}
    return chosen


@dataclass(frozen=True)
class RobotFile(Shown):
    """The file of a robot that was written, and what it allows."""

    path: Path
    analyses: tuple[Allowed, ...]

    def __repr__(self) -> str:
        allowed = ", ".join(row.analysis for row in self.analyses if row.allowed)
        return f"RobotFile('{self.path}': {allowed})"

    def to_frame(self) -> pd.DataFrame:
        """Return one row for each analysis."""
        import pandas as pd  # noqa: PLC0415, heavy

        return pd.concat([row.to_frame() for row in self.analyses], ignore_index=True)


def robot(new: str | Path, *, changes: Changes = None, like: File = None) -> RobotFile:
    """Write the file of a robot: every number with its meaning, what is not known as a comment.

    Args:
        new: the file (.toml); its stem becomes the robot's name.
        changes: numbers by their keys, as ``{"robot.wheels.radius_m": 0.1}``.
        like: a robot of the catalogue or a .toml file, whose numbers stand in for those that are not given.

    Returns:
        the path, and which analyses the file allows.

    Raises:
        UsageError: there is such a file, its name does not end in .toml, or the wheel radius is not known.
        InputError: a key is not known, or a number is out of its bounds.
        LabError: the file cannot be written.
    """
    path = Path(new)
    if path.suffix != ".toml":
        raise UsageError(f"{path}: the file of a robot ends in .toml", f"write {path.with_suffix('.toml')}")
    if path.exists():
        raise UsageError(f"{path}: exists already", "choose another name; edit the file that is there")
    given = dict(checked(changes or {}))
    if foreign := [key for key in given if not key.startswith("robot.")]:
        raise UsageError(f"{OPTION} {foreign[0]}: is no number of a robot", "a soil has a file of its own")
    text = text_of(path.stem, given, load_robot(like) if like else None)
    write_text(path, text)
    clear_cache()
    return RobotFile(path, allowed_by(in_force(str(path), "dry_sand")))


def list_effects(effects: File = None) -> Records[Effect]:
    """List every effect that can be added to the paper's model.

    Args:
        effects: your own effect file (.py). It is executed: use only code you trust.

    Raises:
        InputError: the file cannot be used.
    """
    return Records(list(library(effects).values()))


def show_effect(effect_id: str, effects: File = None) -> Effect:
    """Describe one effect: equation, source and parameters.

    Args:
        effect_id: its id.
        effects: as in `list_effects`.

    Raises:
        UsageError: no such effect.
    """
    return get(effect_id, library(effects))
