"""Triangles of the robot and the sand, as plain arrays: what the 3D view draws.

Axes as in frame R: x forward, y left, z up, origin midway between the axles at wheel-centre height.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from granite_lab.parameters import Chassis, Wheels

Floats = npt.NDArray[np.float32]
Indices = npt.NDArray[np.uint32]
Colour = tuple[int, int, int]

TYRE: Colour = (38, 38, 40)
LUG: Colour = (66, 66, 70)
DARK: Colour = (45, 47, 52)
WHITE: Colour = (235, 235, 235)


@dataclass(frozen=True, eq=False)
class Shape:
    """A coloured triangle mesh with a normal per vertex, so that edges stay sharp.

    Attributes:
        vertices: (V, 3) [m].
        triangles: (T, 3) indices of vertices.
        normals: (V, 3) unit vectors.
        colours: (V, 3) red, green, blue, 0 to 255.
    """

    vertices: Floats
    triangles: Indices
    normals: Floats
    colours: npt.NDArray[np.uint8]


def merge(*shapes: Shape) -> Shape:
    """Return the shapes as one."""
    offsets = np.cumsum([0] + [len(s.vertices) for s in shapes[:-1]])
    return Shape(
        np.concatenate([s.vertices for s in shapes]),
        np.concatenate([s.triangles + o for s, o in zip(shapes, offsets, strict=True)]).astype(np.uint32),
        np.concatenate([s.normals for s in shapes]),
        np.concatenate([s.colours for s in shapes]),
    )


def _faces(quads: npt.NDArray[np.float64], colour: Colour) -> Shape:
    """Return quadrilaterals (Q, 4, 3), counter-clockwise seen from outside, each flat."""
    normal = np.cross(quads[:, 1] - quads[:, 0], quads[:, 2] - quads[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    first = 4 * np.arange(len(quads))[:, None]
    triangles = np.concatenate([first + np.array(corner) for corner in ((0, 1, 2), (0, 2, 3))])
    return Shape(
        quads.reshape(-1, 3).astype(np.float32),
        triangles.astype(np.uint32),
        np.repeat(normal, 4, axis=0).astype(np.float32),
        np.tile(np.array(colour, np.uint8), (4 * len(quads), 1)),
    )


def box(low: tuple[float, float, float], high: tuple[float, float, float], colour: Colour) -> Shape:
    """Return an upright box between two corners [m]."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    quads = [
        [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)],
        [(x1, y1, z0), (x0, y1, z0), (x0, y1, z1), (x1, y1, z1)],
        [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
        [(x0, y1, z0), (x0, y0, z0), (x0, y0, z1), (x0, y1, z1)],
        [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
        [(x0, y1, z0), (x1, y1, z0), (x1, y0, z0), (x0, y0, z0)],
    ]
    return _faces(np.array(quads, float), colour)


def _ring(radius: float, steps: int) -> npt.NDArray[np.float64]:
    """Return (steps + 1, 2) points x, z on a circle, turning the way a wheel rolls forward."""
    a = np.linspace(0, 2 * np.pi, steps + 1)
    return radius * np.column_stack([np.sin(a), np.cos(a)])


def disc(radius: float, y: float, side: int, colour: Colour, steps: int = 48) -> Shape:
    """Return a disc in the plane y = const [m] that faces to the left (side 1) or right (side -1)."""
    rim = _ring(radius, steps)[::side]
    rim3 = np.insert(rim, 1, y, axis=1)
    vertices = np.concatenate([[[0.0, y, 0.0]], rim3])
    k = np.arange(1, steps + 1)
    triangles = np.column_stack([np.zeros(steps), k, k + 1])
    return Shape(
        vertices.astype(np.float32),
        triangles.astype(np.uint32),
        np.tile(np.array([0, side, 0], np.float32), (len(vertices), 1)),
        np.tile(np.array(colour, np.uint8), (len(vertices), 1)),
    )


def tread(radius: float, half_width: float, colours: tuple[Colour, Colour], lugs: int) -> Shape:
    """Return the running surface, every second lug in the second colour, so that it is seen to turn."""
    steps = max(2 * lugs, 32)
    rim = _ring(radius, steps)
    left, right = (np.insert(rim, 1, y, axis=1) for y in (half_width, -half_width))
    quads = np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1)
    even = np.arange(steps) % 2 == 0
    return merge(_faces(quads[even], colours[0]), _faces(quads[~even], colours[1]))


def wheel(wheels: Wheels, paint: Colour, *, spokes: bool = True) -> Shape:
    """Return a wheel about its own centre: tread with lugs, rim, spokes (one of them marked)."""
    r, half = wheels.radius, wheels.width / 2
    parts = [tread(r, half, (TYRE, LUG), round(wheels.lugs) or 24)]
    for side in (1, -1):
        face = side * half
        parts += [
            disc(r, face, side, TYRE),
            disc(0.72 * r, face + side * 0.001, side, (58, 58, 62)),
            disc(0.22 * r, face + side * 0.004, side, paint),
        ]
        low, high = sorted((face + side * 0.001, face + side * 0.003))
        for k in range(5 if spokes else 0):
            colour = WHITE if k == 0 else paint
            bar = box((-0.05 * r, low, 0.15 * r), (0.05 * r, high, 0.72 * r), colour)
            parts.append(turned(bar, 2 * np.pi * k / 5))
    return merge(*parts)


def moved(shape: Shape, offset: tuple[float, float, float]) -> Shape:
    """Return the shape moved by an offset [m]."""
    return replace(shape, vertices=shape.vertices + np.array(offset, np.float32))


def turned(shape: Shape, angle: float) -> Shape:
    """Return the shape turned about y by an angle [rad], positive the way a wheel rolls forward."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]], np.float32)
    return Shape(shape.vertices @ turn.T, shape.triangles, shape.normals @ turn.T, shape.colours)


def _hull(chassis: Chassis, wheels: Wheels) -> tuple[float, float, float, float]:
    """Return the half length, half width, bottom and top of the body [m]."""
    r = wheels.radius
    x, y = chassis.wheel_base / 2 + 0.35 * r, chassis.track / 2 - wheels.width / 2 - 0.12 * r
    return x, y, -0.25 * r, 1.45 * r


def body(chassis: Chassis, wheels: Wheels, paint: Colour) -> Shape:
    """Return the robot's body between its wheels, with axles, a deck and a bow that tells the front."""
    r = wheels.radius
    x, y, low, high = _hull(chassis, wheels)
    parts = [
        box((-x, -y, low), (x, y, high), paint),
        box((-0.8 * x, -0.8 * y, high), (0.45 * x, 0.8 * y, high + 0.12 * r), DARK),
        box((0.62 * x, -0.55 * y, high), (0.8 * x, 0.55 * y, high + 0.5 * r), DARK),
        box((x, -0.6 * y, low + 0.5 * r), (x + 0.1 * r, 0.6 * y, high - 0.45 * r), WHITE),
    ]
    for axle in (-chassis.wheel_base / 2, chassis.wheel_base / 2):
        half = chassis.track / 2
        parts.append(box((axle - 0.1 * r, -half, -0.1 * r), (axle + 0.1 * r, half, 0.1 * r), DARK))
    return merge(*parts)


def shrunk(shape: Shape, factor: float) -> Shape:
    """Return the shape scaled about the middle of its extent."""
    middle = (shape.vertices.min(axis=0) + shape.vertices.max(axis=0)) / 2
    return replace(shape, vertices=(middle + factor * (shape.vertices - middle)).astype(np.float32))


def body_edges(chassis: Chassis, wheels: Wheels) -> list[Floats]:
    """Return the edges of the body as line strips [m]."""
    x, y, low, high = _hull(chassis, wheels)
    corners = [(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)]
    rings = [np.array([(*c, z) for c in corners], np.float32) for z in (low, high)]
    return rings + [np.array([(*c, low), (*c, high)], np.float32) for c in corners[:4]]


def wheel_edges(wheels: Wheels) -> list[Floats]:
    """Return both rims of a wheel and one spoke on each side as line strips [m]."""
    strips = []
    for y in (-1.04 * wheels.width / 2, 1.04 * wheels.width / 2):
        rim = _ring(wheels.radius, 40)
        strips.append(np.insert(rim, 1, y, axis=1).astype(np.float32))
        strips.append(np.array([(0, y, 0), (0, y, wheels.radius)], np.float32))
    return strips


def arc_arrow(radius: float, sweep: Floats, steps: int = 7) -> Floats:
    """Return arcs with an arrow head in the plane y = 0, one per sweep angle.

    Args:
        radius: of the arc [m].
        sweep: (N,) angle from the top [rad], positive the way a wheel rolls forward.

    Returns:
        (N, steps + 3, 3) points of one line strip each [m].
    """
    a = sweep[:, None] * np.linspace(0, 1, steps)[None, :]
    points = radius * np.stack([np.sin(a), np.zeros_like(a), np.cos(a)], axis=-1)
    tip, end = points[:, -1], sweep
    forward = np.sign(end)[:, None] * np.stack([np.cos(end), np.zeros_like(end), -np.sin(end)], axis=-1)
    outward = np.stack([np.sin(end), np.zeros_like(end), np.cos(end)], axis=-1)
    head = 0.22 * radius * np.minimum(1, np.abs(end) / 0.3)[:, None]
    barbs = [tip - head * forward + 0.6 * side * head * outward for side in (1, -1)]
    strip = [points, barbs[0][:, None], tip[:, None], barbs[1][:, None]]
    return np.concatenate(strip, axis=1).astype(np.float32)
