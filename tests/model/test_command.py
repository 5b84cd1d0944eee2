"""The desired motion is the trapezoid of section 4."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from granite_lab.model import command
from granite_lab.parameters import Variant, load_variants

variants = st.builds(
    Variant,
    velocity=st.floats(0.05, 2.0),
    acceleration=st.floats(0.1, 5.0),
    distance=st.floats(0.1, 10.0),
)


def evaluate(function: object, variant: Variant, t: np.ndarray) -> np.ndarray:
    symbol = ca.SX.sym("t")
    return np.array(ca.Function("f", [symbol], [function(symbol, variant)])(t[None, :])).ravel()


@given(variants)
def test_distance_is_reached_exactly_and_velocity_stays_inside_its_bounds(variant: Variant) -> None:
    t = np.linspace(-1, command.duration(variant) + 1, 400)
    v = evaluate(command.desired_velocity, variant, t)
    s = evaluate(command.desired_distance, variant, t)
    assert s[0] == 0
    assert s[-1] == pytest.approx(variant.distance, rel=1e-9)
    assert (np.diff(s) >= -1e-12).all()
    assert v.min() >= 0
    assert v.max() <= variant.velocity * (1 + 1e-12)
    assert np.abs(np.diff(v) / np.diff(t)).max() <= variant.acceleration * (1 + 1e-9)


@given(variants)
def test_distance_is_the_integral_of_velocity(variant: Variant) -> None:
    corners = [0.0, *command.steady_interval(variant), command.duration(variant)]
    t = np.unique(np.concatenate([corners, np.linspace(0, corners[-1], 50)]))
    v = evaluate(command.desired_velocity, variant, t)
    s = evaluate(command.desired_distance, variant, t)
    # the trapezoidal rule is exact between the corners of a trapezoid
    integral = np.concatenate([[0], np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t))])
    np.testing.assert_allclose(s, integral, atol=1e-9 * variant.distance)


@pytest.mark.parametrize("variant", load_variants())
def test_phases_follow_table_2(variant: Variant) -> None:
    ramp, brake = command.steady_interval(variant)
    assert ramp == pytest.approx(variant.velocity / variant.acceleration)
    end = command.duration(variant)
    assert end - brake == pytest.approx(ramp)
    t = np.array([-0.1, ramp / 2, (ramp + brake) / 2, brake + ramp / 2, end + 0.1])
    assert command.phase_of(t, variant) == ["rest", "accelerate", "steady", "brake", "rest"]


@given(variants)
def test_the_acceleration_jumps_at_the_corners_and_nowhere_else(variant: Variant) -> None:
    places = np.array(command.corners(variant))
    assert (np.diff(places) >= -1e-12).all()
    between = np.sort(np.concatenate([places, np.linspace(-0.5, places[-1] + 0.5, 60)]))
    level = evaluate(command.desired_velocity, variant, between)
    middle = evaluate(command.desired_velocity, variant, (between[1:] + between[:-1]) / 2)
    assert middle == pytest.approx((level[1:] + level[:-1]) / 2, abs=1e-9)
