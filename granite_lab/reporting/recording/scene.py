"""The 3D view: the measured robot, the simulated one as an outline, cut-away sand, and forces.

Axes as in frame R: x forward, y left, z up, origin midway between the axles at wheel-centre height.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
from scipy.integrate import cumulative_trapezoid

from granite_lab.comparison.compare import Comparison
from granite_lab.logs.trial import Array
from granite_lab.parameters import WHEELS, Chassis, Wheels
from granite_lab.reporting.recording.lines import MOST_ROWS, SIMULATED, Rgb
from granite_lab.reporting.recording.stream import Writer

STEP = 0.04
"""Spacing of the poses [s]."""
FORCE_SCALE = 0.0022
"""Length of an arrow [m/N]."""
FORCES = {"ground_reaction": (240, 90, 200), "thrust": (0, 190, 140), "resistance": (235, 60, 50)}
PARTS = (
    ("ground_reaction", 0, "force_x_{}_N"), ("ground_reaction", 2, "force_z_{}_N"),
    ("thrust", 0, "thrust_{}_N"), ("resistance", 0, "resistance_{}_N"),
)  # fmt: skip
"""Arrow, its axis, and the signal that gives its length."""
VIEWPOINT = "scene/viewpoint"
SAND, SAND_CUT, TICK, DEPTH = (214, 184, 132), (181, 148, 97), (110, 84, 48), (150, 118, 72)
PAINT, DARK, WHITE = (52, 120, 178), (45, 47, 52), (235, 235, 235)
TYRE, LUG, RIM = (38, 38, 40), (72, 72, 76), (58, 58, 62)
EDGE = 0.0016
"""Radius of the simulated robot's outlines [m]."""
Block = tuple[tuple[float, float, float], tuple[float, float, float], Rgb]
"""A box: lowest corner and highest corner [m], colour."""


class Pose(NamedTuple):
    """(N,) x and z of R above the ground [m], pitch, nose down [rad], and (N, 4) wheel angles [rad]."""

    x: Array
    z: Array
    pitch: Array
    spin: Array


def _at(t: Array, sample_t: Array, samples: Array) -> Array:
    """Return known samples at other times; gaps are bridged, ends are held, and nothing known is zero."""
    good = np.isfinite(samples)
    return np.interp(t, sample_t[good], samples[good]) if good.any() else np.zeros_like(t)


def poses(comparison: Comparison, t: Array) -> tuple[Pose, Pose]:
    """Return the measured and the simulated pose at times since command start [s].

    Sinkage cannot be measured: the measured robot takes its mean from the simulation, and its pitch
    tips the axles from there. Wheel angles of the measured robot are the integral of the wheel velocity.
    """
    motion, run = comparison.motion, comparison.run
    r = run.robot.wheels.radius
    sinkage = (run["sinkage_f_m"] + run["sinkage_r_m"]) / 2
    z = r - _at(t, run.t, sinkage)
    τ = motion.t - comparison.start
    x0 = float(_at(np.zeros(1), τ, motion.x)[0])
    rate = np.column_stack([_at(t, τ, motion.v_wheel[:, i]) for i in range(4)]) / r
    spin = cumulative_trapezoid(rate, t, axis=0, initial=0)
    measured = Pose(_at(t, τ, motion.x) - x0, z, _at(t, τ, motion.pitch), spin)
    x_run0 = float(_at(np.zeros(1), run.t, run["x_m"])[0])
    angle = [_at(t, run.t, run[f"theta_{axle}_rad"]) for axle in "ffrr"]
    x, pitch = _at(t, run.t, run["x_m"]) - x_run0, _at(t, run.t, run["pitch_rad"])
    return measured, Pose(x, z, pitch, np.column_stack(angle))


def write_scene(writer: Writer, comparison: Comparison) -> None:
    """Write the scene of one trial."""
    robot = comparison.run.robot
    chassis = robot.chassis
    assert chassis is not None  # or there were no run
    start, end = comparison.motion.t[[0, -1]] - comparison.start
    t = np.linspace(start, end, min(MOST_ROWS, max(2, round((end - start) / STEP) + 1)))
    measured, simulated = poses(comparison, t)
    writer.static("scene", rr.ViewCoordinates.FLU)
    # The view's origin travels with the robot, but neither pitches nor sinks: what does is then seen.
    along = np.column_stack([measured.x, np.zeros_like(t), np.zeros_like(t)])
    writer.rows(VIEWPOINT, t, rr.Transform3D.columns(translation=along))
    travel = np.concatenate([measured.x, simulated.x])
    _write_sand(writer, chassis, robot.wheels, float(travel.min()), float(travel.max()))
    solid, outline = _solid(chassis, robot.wheels), _outline(chassis, robot.wheels)
    for name, pose, (body, *wheel) in (("measured", measured, solid), ("simulated", simulated, outline)):
        entity = f"scene/{name}"
        place = np.column_stack([pose.x, np.zeros_like(t), pose.z])
        turn = _quaternion(pose.pitch)
        writer.rows(entity, t, rr.Transform3D.columns(translation=place, quaternion=turn))
        writer.static(f"{entity}/body", body)
        for i, (corner, (x, y)) in enumerate(_mount(chassis).items()):
            writer.static(f"{entity}/{corner}", rr.Transform3D(translation=(x, y, 0)))
            writer.static(f"{entity}/{corner}/tyre", *wheel)
            turn = _quaternion(pose.spin[:, i])
            writer.rows(f"{entity}/{corner}/tyre", t, rr.Transform3D.columns(quaternion=turn))
    _write_forces(writer, comparison, chassis, t, measured)


def _mount(chassis: Chassis) -> dict[str, tuple[float, float]]:
    """Return where the wheels sit in R: name to x, y [m]."""
    x, y = chassis.wheel_base / 2, chassis.track / 2
    return dict(zip(WHEELS, ((x, y), (x, -y), (-x, y), (-x, -y)), strict=True))


def _quaternion(angle: Array) -> Array:
    """Return turns about y as (N, 4) quaternions x, y, z, w."""
    zero = np.zeros_like(angle)
    return np.column_stack([zero, np.sin(angle / 2), zero, np.cos(angle / 2)])


def _boxes(blocks: Sequence[Block]) -> Any:
    low, high, colours = zip(*blocks, strict=True)
    return rr.Boxes3D(mins=low, sizes=np.subtract(high, low), colors=colours, fill_mode="solid")


def _hull(chassis: Chassis, wheels: Wheels) -> tuple[float, float, float, float]:
    """Return the half length, half width, bottom and top of the body [m]."""
    r = wheels.radius
    x, y = chassis.wheel_base / 2 + 0.35 * r, chassis.track / 2 - wheels.width / 2 - 0.12 * r
    return x, y, -0.25 * r, 1.45 * r


def _solid(chassis: Chassis, wheels: Wheels) -> tuple[Any, Any, Any]:
    """Return the measured robot: a body whose bow marks the front, tyre and hub, and lugs and spokes."""
    r, half, width = wheels.radius, chassis.track / 2, wheels.width
    x, y, low, high = _hull(chassis, wheels)
    axles = (-chassis.wheel_base / 2, chassis.wheel_base / 2)
    body = _boxes([
        ((-x, -y, low), (x, y, high), PAINT),
        ((-0.8 * x, -0.8 * y, high), (0.45 * x, 0.8 * y, high + 0.12 * r), DARK),
        ((0.62 * x, -0.55 * y, high), (0.8 * x, 0.55 * y, high + 0.5 * r), DARK),
        ((x, -0.6 * y, low + 0.5 * r), (x + 0.1 * r, 0.6 * y, high - 0.45 * r), WHITE),
        *(((a - 0.1 * r, -half, -0.1 * r), (a + 0.1 * r, half, 0.1 * r), DARK) for a in axles),
    ])  # fmt: skip
    lying = rr.Quaternion(xyzw=[np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # a cylinder's own axis is z
    tyre = rr.Cylinders3D(
        radii=[0.99 * r, 0.72 * r, 0.22 * r], lengths=[width, width + 0.002, width + 0.010],
        quaternions=[lying] * 3, colors=[TYRE, RIM, PAINT], fill_mode="solid",
    )  # fmt: skip
    lugs = round(wheels.lugs) or 24
    at = 2 * np.pi * np.concatenate([np.arange(lugs) / lugs, np.arange(5) / 5])
    middle = np.repeat([0.985 * r, 0.45 * r], [lugs, 5])
    lug, spoke = [0.5 * np.pi * r / lugs, 0.49 * width, 0.015 * r], [0.05 * r, width / 2 + 0.003, 0.27 * r]
    bars = rr.Boxes3D(
        centers=np.column_stack([middle * np.sin(at), np.zeros_like(at), middle * np.cos(at)]),
        half_sizes=[lug] * lugs + [spoke] * 5, quaternions=_quaternion(at),
        colors=[LUG] * lugs + [WHITE] + [PAINT] * 4, fill_mode="solid",
    )  # fmt: skip
    return body, tyre, bars


def _outline(chassis: Chassis, wheels: Wheels) -> tuple[Any, Any]:
    """Return the edges of the simulated robot: of its body, and of a wheel with one spoke on each side."""
    x, y, low, high = _hull(chassis, wheels)
    body = rr.Boxes3D(
        mins=[(-x, -y, low)], sizes=[(2 * x, 2 * y, high - low)],
        colors=SIMULATED, radii=EDGE, fill_mode="majorwireframe",
    )  # fmt: skip
    angle = np.linspace(0, 2 * np.pi, 49)
    ring = np.column_stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)]) * wheels.radius
    sides = [np.array([0, side * 0.54 * wheels.width, 0]) for side in (-1, 1)]
    strips = [strip + side for side in sides for strip in (ring, np.stack([0 * ring[0], ring[0]]))]
    return body, rr.LineStrips3D(strips, colors=SIMULATED, radii=EDGE)


def _write_sand(writer: Writer, chassis: Chassis, wheels: Wheels, start: float, end: float) -> None:
    """Write the sand: a solid box, cut off behind the near (right) wheels so that they are seen to sink."""
    half = chassis.wheel_base / 2 + 3 * wheels.radius
    near = -(chassis.track - wheels.width) / 2 + 0.004
    far, depth = chassis.track / 2 + 2.5 * wheels.radius, 1.1 * wheels.radius
    low, high = start - half - 0.1, end + half + 0.1
    top: Block = ((low, near, -depth), (high, far, 0.0), SAND)
    cut: Block = ((low, near - 0.001, -depth), (high, near, -0.0005), SAND_CUT)
    writer.static("scene/sand", _boxes([top, cut]))
    face = near - 0.003
    tick = 0.25 * 10.0 ** max(0, np.ceil(np.log10((end - start + 0.1) / 25)))
    marks = tick * np.arange(np.ceil(start / tick), end / tick + 1) + 0.0
    ticks = [[(x, face, 0), (x, face, -0.02)] for x in marks]
    writer.static("scene/sand/distance", rr.LineStrips3D(ticks, colors=TICK, radii=0.0012))
    depths = np.arange(0.01, 0.031, 0.01)
    strata = [[(low, face + 0.001, -z), (high, face + 0.001, -z)] for z in depths]
    writer.static("scene/sand/depth_10_20_30_mm", rr.LineStrips3D(strata, colors=DEPTH, radii=0.0006))


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
        for name, axis, signal in PARTS:
            rows[name][:, k, axis] = FORCE_SCALE * _at(t, run.t, run[signal.format(axle)])
    for name, colour in FORCES.items():
        entity = f"scene/force_{name}"
        writer.static(entity, rr.Arrows3D.from_fields(colors=colour, radii=0.005))
        columns = rr.Arrows3D.columns(vectors=rows[name].reshape(-1, 3), origins=origins.reshape(-1, 3))
        writer.rows(entity, t, columns.partition([2] * len(t)))
