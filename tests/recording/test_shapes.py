"""The shapes of the 3D view are closed, turned outward and where the parameters put them."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.parameters import load_robot
from granite_lab.reporting.recording import shapes

ROBOT = load_robot()
assert ROBOT.chassis is not None
SHAPES = {
    "box": shapes.box((0, 0, 0), (1, 2, 3), (1, 2, 3)),
    "wheel": shapes.wheel(ROBOT.wheels, (1, 2, 3)),
    "body": shapes.body(ROBOT.chassis, ROBOT.wheels, (1, 2, 3)),
}


def _volume(shape: shapes.Shape) -> float:
    """Volume enclosed by the triangles, by the divergence theorem."""
    a, b, c = (shape.vertices[shape.triangles[:, k]].astype(float) for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_triangles_wind_the_way_their_normals_point(shape: shapes.Shape) -> None:
    a, b, c = (shape.vertices[shape.triangles[:, k]].astype(float) for k in range(3))
    winding = np.cross(b - a, c - a)
    normals = shape.normals[shape.triangles[:, 0]]
    assert ((winding * normals).sum(axis=1) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(shape.normals, axis=1), 1, atol=1e-6)


def test_a_box_encloses_its_volume() -> None:
    assert _volume(SHAPES["box"]) == pytest.approx(6.0)


def test_a_wheel_without_spokes_is_a_cylinder() -> None:
    r, b = ROBOT.wheels.radius, ROBOT.wheels.width
    tread = shapes.tread(r, b / 2, ((0, 0, 0), (1, 1, 1)), 24)
    sides = [shapes.disc(r, side * b / 2, side, (0, 0, 0)) for side in (1, -1)]
    closed = shapes.merge(tread, *sides)
    polygon = 24 * r**2 * np.sin(2 * np.pi / 48)  # 48 lugs and gaps
    assert _volume(closed) == pytest.approx(polygon * b, rel=1e-4)


def test_the_wheel_is_as_large_as_its_parameters_say() -> None:
    extent = np.ptp(SHAPES["wheel"].vertices, axis=0)
    np.testing.assert_allclose(extent[[0, 2]], 2 * ROBOT.wheels.radius, rtol=1e-3)
    assert ROBOT.wheels.width <= extent[1] < ROBOT.wheels.width + 0.01


def test_a_positive_turn_rolls_forward() -> None:
    top = shapes.Shape(
        np.array([[0, 0, 1]], np.float32),
        np.zeros((0, 3), np.uint32),
        np.array([[0, 0, 1]], np.float32),
        np.zeros((1, 3), np.uint8),
    )
    np.testing.assert_allclose(shapes.turned(top, np.pi / 2).vertices, [[1, 0, 0]], atol=1e-6)


def test_a_torque_that_drives_forward_bends_its_arrow_forward() -> None:
    arcs = shapes.arc_arrow(2.0, np.array([np.pi / 2, -np.pi / 2, 0.0], np.float32))
    tips = arcs[:, -2]
    np.testing.assert_allclose(tips, [[2, 0, 0], [-2, 0, 0], [0, 0, 2]], atol=1e-6)
    assert np.isfinite(arcs).all()
    barb = arcs[0, -1]  # the head points back from the tip: up at the front of the wheel
    assert barb[2] > 0.1
