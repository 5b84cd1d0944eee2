"""The 3D view: the measured robot, the simulated one as its ghost, cut-away sand, forces and torques."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from granite_lab.comparison.record import Comparison
from granite_lab.logs.trial import Array
from granite_lab.parameters import WHEELS, Chassis, Robot
from granite_lab.reporting.recording import shapes
from granite_lab.reporting.recording.signals import MOST_ROWS, SIMULATED, command_start
from granite_lab.reporting.recording.stream import Writer, thinned

STEP = 0.03
"""Spacing of the poses [s]; forces and torques have twice that."""
FORCE_SCALE = 0.0022
"""Length of a force arrow [m/N]."""
TORQUE_SCALE = 0.35
"""Sweep of a torque's arc [rad/(N m)]."""
FORCES = {
    "ground_reaction": ((240, 90, 200), "ground reaction"),
    "thrust": ((0, 190, 140), "thrust F, (14)"),
    "resistance": ((235, 60, 50), "motion resistance R, (13)"),
}
VIEWPOINT = "scene/viewpoint"
SAND, SAND_CUT, TICK = (214, 184, 132), (181, 148, 97), (110, 84, 48)
TORQUE_MEASURED = (150, 215, 255)
PAINT = (52, 120, 178)


@dataclass(frozen=True, eq=False)
class Pose:
    """How one robot moves, over (N,) times.

    Attributes:
        x, z: position of R along the ground and above its surface [m].
        pitch: [rad], positive nose down.
        spin: (N, 4) wheel angles [rad].
    """

    x: Array
    z: Array
    pitch: Array
    spin: Array

    def every(self, n: int) -> Pose:
        """Return every n-th sample."""
        return Pose(self.x[::n], self.z[::n], self.pitch[::n], self.spin[::n])


def _at(t: Array, known_t: Array, known: Array) -> Array:
    """Return known samples at other times; gaps are bridged, ends are held, and nothing known is zero."""
    good = np.isfinite(known)
    return np.interp(t, known_t[good], known[good]) if good.any() else np.zeros_like(t)


def poses(comparison: Comparison, t: Array) -> tuple[Pose, Pose]:
    """Return the measured and the simulated pose at times since command start [s].

    Sinkage cannot be measured: the measured robot takes its mean from the simulation, and its pitch
    tips the axles from there. Wheel angles of the measured robot are the integral of the wheel velocity.
    """
    motion, run = comparison.motion, comparison.run
    r = run.robot.wheels.radius
    sinkage = (run["sinkage_f_m"] + run["sinkage_r_m"]) / 2
    z = r - _at(t, run.t, sinkage)
    τ = motion.t - command_start(comparison)
    x0 = float(_at(np.zeros(1), τ, motion.x)[0])
    rate = np.column_stack([_at(t, τ, motion.v_wheel[:, i]) for i in range(4)]) / r
    steps = (rate[1:] + rate[:-1]) / 2 * np.diff(t)[:, None]
    spin = np.concatenate([np.zeros((1, 4)), np.cumsum(steps, axis=0)])
    measured = Pose(_at(t, τ, motion.x) - x0, z, _at(t, τ, motion.pitch), spin)
    x_run0 = float(_at(np.zeros(1), run.t, run["x_m"])[0])
    angle = [_at(t, run.t, run[f"theta_{axle}_rad"]) for axle in "ffrr"]
    simulated = Pose(
        _at(t, run.t, run["x_m"]) - x_run0, z, _at(t, run.t, run["pitch_rad"]), np.column_stack(angle)
    )
    return measured, simulated


def write_scene(writer: Writer, comparison: Comparison) -> None:
    """Write the scene of one trial."""
    robot = comparison.run.robot
    assert robot.chassis is not None  # or there were no run
    t = thinned(comparison.motion.t - command_start(comparison), STEP, MOST_ROWS)
    measured, simulated = poses(comparison, t)
    writer.static("scene", rr.ViewCoordinates.FLU)
    # The view's origin travels with the robot, but neither pitches nor sinks: what does is then seen.
    along = np.column_stack([measured.x, np.zeros_like(t), np.zeros_like(t)])
    writer.rows(VIEWPOINT, t, rr.Transform3D.columns(translation=along))
    travel = np.concatenate([measured.x, simulated.x])
    _write_sand(writer, robot, robot.chassis, float(travel.min()), float(travel.max()))
    _write_solid(writer, "scene/measured", robot, robot.chassis, t, measured)
    _write_ghost(writer, "scene/simulated", robot, robot.chassis, t, simulated)
    _write_forces(writer, comparison, robot.chassis, t[::2], measured.every(2))
    _write_torques(writer, comparison, robot.chassis, t[::2])


def _mesh(shape: shapes.Shape, tint: tuple[int, ...] | None = None) -> Any:
    return rr.Mesh3D(
        vertex_positions=shape.vertices,
        triangle_indices=shape.triangles,
        vertex_normals=shape.normals,
        vertex_colors=shape.colours if tint is None else None,
        albedo_factor=tint,
    )


def _mount(chassis: Chassis) -> dict[str, tuple[float, float]]:
    """Return where the wheels sit in R: name to x, y [m]."""
    x, y = chassis.wheel_base / 2, chassis.track / 2
    return dict(zip(WHEELS, ((x, y), (x, -y), (-x, y), (-x, -y)), strict=True))


def _quaternion(angle: Array) -> Array:
    """Return turns about y as (N, 4) quaternions x, y, z, w."""
    zero = np.zeros_like(angle)
    return np.column_stack([zero, np.sin(angle / 2), zero, np.cos(angle / 2)])


def _write_pose(writer: Writer, entity: str, t: Array, pose: Pose) -> None:
    place = np.column_stack([pose.x, np.zeros_like(t), pose.z])
    writer.rows(entity, t, rr.Transform3D.columns(translation=place, quaternion=_quaternion(pose.pitch)))


def _write_solid(writer: Writer, entity: str, robot: Robot, chassis: Chassis, t: Array, pose: Pose) -> None:
    """Write the measured robot: body and four wheels, each with its own spin."""
    _write_pose(writer, entity, t, pose)
    writer.static(f"{entity}/body", _mesh(shapes.body(chassis, robot.wheels, PAINT)))
    tyre = _mesh(shapes.wheel(robot.wheels, PAINT))
    for i, (wheel, (x, y)) in enumerate(_mount(chassis).items()):
        writer.static(f"{entity}/{wheel}", rr.Transform3D(translation=(x, y, 0)))
        spin = f"{entity}/{wheel}/tyre"
        writer.static(spin, tyre)
        writer.rows(spin, t, rr.Transform3D.columns(quaternion=_quaternion(pose.spin[:, i])))


def _write_ghost(writer: Writer, entity: str, robot: Robot, chassis: Chassis, t: Array, pose: Pose) -> None:
    """Write the simulated robot: translucent, a little smaller, its edges drawn, wheels in pairs.

    It hides inside the solid robot where the two agree, and comes out where they do not.
    """
    tint, wheels, half = (*SIMULATED, 70), robot.wheels, chassis.track / 2
    _write_pose(writer, entity, t, pose)
    body = shapes.shrunk(shapes.body(chassis, wheels, PAINT), 0.985)
    writer.static(f"{entity}/body", _mesh(body, tint))
    writer.static(f"{entity}/body/edges", _edges(shapes.body_edges(chassis, wheels)))
    tyre = shapes.shrunk(shapes.wheel(wheels, PAINT, spokes=False), 0.985)
    pair = shapes.merge(*(shapes.moved(tyre, (0, y, 0)) for y in (half, -half)))
    rims = [e + np.array([0, y, 0], np.float32) for e in shapes.wheel_edges(wheels) for y in (half, -half)]
    for i, axle, x in ((0, "front", chassis.wheel_base / 2), (2, "rear", -chassis.wheel_base / 2)):
        writer.static(f"{entity}/{axle}", rr.Transform3D(translation=(x, 0, 0)))
        spin = f"{entity}/{axle}/tyres"
        writer.static(spin, _mesh(pair, tint))
        writer.static(f"{spin}/edges", _edges(rims))
        writer.rows(spin, t, rr.Transform3D.columns(quaternion=_quaternion(pose.spin[:, i])))


def _edges(strips: list[shapes.Floats]) -> Any:
    return rr.LineStrips3D(strips, colors=SIMULATED, radii=0.0012)


def _write_sand(writer: Writer, robot: Robot, chassis: Chassis, start: float, end: float) -> None:
    """Write the sand: a solid box, cut off behind the near (right) wheels so that they are seen to sink."""
    half = chassis.wheel_base / 2 + 3 * robot.wheels.radius
    near = -(chassis.track - robot.wheels.width) / 2 + 0.004
    far, depth = chassis.track / 2 + 2.5 * robot.wheels.radius, 1.1 * robot.wheels.radius
    low, high = start - half - 0.1, end + half + 0.1
    top = shapes.box((low, near, -depth), (high, far, 0.0), SAND)
    cut = shapes.box((low, near - 0.001, -depth), (high, near, -0.0005), SAND_CUT)
    writer.static("scene/sand", _mesh(shapes.merge(top, cut)))
    face = near - 0.003
    tick = 0.25 * 10.0 ** max(0, np.ceil(np.log10((end - start + 0.1) / 25)))
    marks = tick * np.arange(np.ceil(start / tick), end / tick + 1) + 0.0  # no "-0 m"
    named = marks[np.isclose(np.remainder(marks / tick, 2), 0)]
    ticks = [[(x, face, 0), (x, face, -(0.03 if x in named else 0.018))] for x in marks]
    writer.static("scene/sand/distance", rr.LineStrips3D(ticks, colors=TICK, radii=0.0012))
    writer.static(
        "scene/sand/distance_names",
        rr.Points3D(
            [(x, face, -0.09) for x in named],
            labels=[f"{x:g} m" for x in named],
            colors=(240, 235, 225), radii=0.0005, show_labels=True,
        ),
    )  # fmt: skip
    depths = np.arange(0.01, 0.031, 0.01)
    strata = [[(low, face + 0.001, -z), (high, face + 0.001, -z)] for z in depths]
    writer.static(
        "scene/sand/depth_10_20_30_mm", rr.LineStrips3D(strata, colors=(150, 118, 72), radii=0.0006)
    )


def _write_forces(writer: Writer, comparison: Comparison, chassis: Chassis, t: Array, pose: Pose) -> None:
    """Write the simulated forces of the ground on the near wheels, drawn at the measured robot."""
    run = comparison.run
    y = -(chassis.track + run.robot.wheels.width) / 2 - 0.012
    rows = {name: np.zeros((len(t), 2, 3)) for name in FORCES}
    origins = np.zeros((len(t), 2, 3))
    for k, (axle, side) in enumerate((("f", 1), ("r", -1))):
        arm = side * chassis.wheel_base / 2
        bottom = pose.z - arm * np.sin(pose.pitch) - run.robot.wheels.radius
        origins[:, k] = np.column_stack([pose.x + arm * np.cos(pose.pitch), np.full_like(t, y), bottom])
        for signal, name, axis in (
            (f"force_x_{axle}_N", "ground_reaction", 0),
            (f"force_z_{axle}_N", "ground_reaction", 2),
            (f"thrust_{axle}_N", "thrust", 0),
            (f"resistance_{axle}_N", "resistance", 0),
        ):
            rows[name][:, k, axis] = FORCE_SCALE * _at(t, run.t, run[signal])
    for name, (colour, _) in FORCES.items():
        entity = f"scene/force_{name}"
        writer.static(entity, rr.Arrows3D.from_fields(colors=colour, radii=0.005))
        columns = rr.Arrows3D.columns(vectors=rows[name].reshape(-1, 3), origins=origins.reshape(-1, 3))
        writer.rows(entity, t, columns.partition([2] * len(t)))


def _write_torques(writer: Writer, comparison: Comparison, chassis: Chassis, t: Array) -> None:
    """Write the drive torques as arcs on the near wheels: as measured where currents were, else simulated."""
    run = comparison.run
    y = -run.robot.wheels.width / 2 - 0.008  # does not turn with the wheel
    for axle, wheel in (("f", "fr"), ("r", "rr")):
        mount = _mount(chassis)[wheel]
        offset = np.array([mount[0], mount[1] + y, 0.0])
        measured = comparison.measured.get(f"torque_{axle}", np.full(1, np.nan))
        known = bool(np.isfinite(measured).any())
        torque = _at(t, comparison.t, measured) if known else _at(t, run.t, run[f"torque_{axle}_Nm"])
        sweep = np.clip(TORQUE_SCALE * torque, -2.8, 2.8).astype(np.float32)
        strips = shapes.arc_arrow(0.84 * run.robot.wheels.radius, sweep) + offset.astype(np.float32)
        entity = f"scene/measured/{wheel}_torque"
        writer.static(
            entity, rr.LineStrips3D.from_fields(colors=TORQUE_MEASURED if known else SIMULATED, radii=0.003)
        )
        writer.rows(entity, t, rr.LineStrips3D.columns(strips=list(strips)))
