"""Counters that wrap are unwrapped exactly; resets and resolution are told apart from motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granite_lab.logs.counters import convert, quantum, unwrap
from granite_lab.logs.layouts import Column
from granite_lab.logs.quantities import find_unit
from tests.logs import make

COUNTS = find_unit("counts")
PLAIN = Column(to=())


@st.composite
def motions(draw: st.DrawFn) -> tuple[np.ndarray, int, int]:
    """True counts of a drive that is smooth from sample to sample, and the width of the counter."""
    bits = draw(st.sampled_from([16, 32]))
    speed = draw(st.integers(1, 2 ** (bits - 6)))
    count = draw(st.integers(20, 300))
    sign = draw(st.sampled_from([-1, 1]))
    wobble = np.array(draw(st.lists(st.integers(0, speed), min_size=count, max_size=count)))
    start = draw(st.integers(0, 2**bits - 1))
    return start + sign * np.cumsum(wobble), bits, sign


@given(motion=motions(), signed=st.booleans())
@settings(max_examples=150, deadline=None)
def test_every_wrap_is_undone_exactly(motion: tuple[np.ndarray, int, int], signed: bool) -> None:
    true, bits, _ = motion
    logged = np.mod(true, 2**bits)
    if signed:
        logged = np.where(logged >= 2 ** (bits - 1), logged - 2**bits, logged)
    values, wraps, width = unwrap(logged.astype(float), [2.0**16, 2.0**32])
    np.testing.assert_array_equal(values - values[0], (true - true[0]).astype(float))
    assert wraps == 0 or width == 2.0**bits


def test_a_reset_is_not_taken_for_a_wrap_but_taken_out_and_said() -> None:
    counts = np.concatenate((np.arange(0, 60_000, 50.0), np.arange(0, 5_000, 50.0)))
    assert unwrap(counts, [2.0**16, 2.0**32])[1] == 0
    t = np.arange(len(counts)) / 100
    wheel = convert(t, counts, COUNTS, PLAIN, per_rev=10_000, radius=0.1)
    assert any("starts anew" in doubt for doubt in wheel.doubts)
    np.testing.assert_allclose(np.diff(wheel.angle), 50 * 2 * np.pi / 10_000)


def test_a_reading_thrown_off_leaves_the_angle_after_it_as_it_was() -> None:
    true = np.arange(0, 60_000, 50.0)
    counts = true.copy()
    counts[[300, 700]] += 40_000, -25_000
    t = np.arange(len(counts)) / 100
    wheel = convert(t, counts, COUNTS, PLAIN, per_rev=10_000, radius=0.1)
    np.testing.assert_allclose(wheel.angle, true * 2 * np.pi / 10_000)
    assert any("2 readings thrown off" in doubt for doubt in wheel.doubts)


@pytest.mark.parametrize("width", [2 * np.pi, 2**16 * 2 * np.pi / 106_000], ids=["a turn", "counts"])
def test_an_angle_that_starts_again_is_unwrapped(width: float, tmp_path: Path) -> None:
    """After a turn, or because the logger has turned the counts of a 16-bit counter into an angle."""
    q = 2 * np.pi / 106_000
    true = q * (np.rint(3.0 * np.arange(600) / 100 / q) + 60_000)
    rows = [f"{k / 100}" + f",{np.mod(x, width):.9f}" * 4 for k, x in enumerate(true)]
    head = '# robot = "granite"\nt_s,enc_fl_rad,enc_fr_rad,enc_rl_rad,enc_rr_rad\n'
    angle = make.read(tmp_path, head + "\n".join(rows)).wheels.angle[:, 0]
    np.testing.assert_array_equal(np.rint((angle - angle[0]) / q), np.rint((true - true[0]) / q))


@given(
    step=st.floats(1e-6, 1.0),
    levels=st.lists(st.integers(-500, 500), min_size=60, max_size=200, unique=True),
)
@settings(max_examples=60, deadline=None)
def test_the_resolution_is_found(step: float, levels: list[int]) -> None:
    gaps = np.gcd.reduce(np.diff(np.sort(levels)))
    values = step * np.array(levels, dtype=float)
    found = quantum(values)
    assert found == pytest.approx(step * gaps, rel=1e-6) or found == 0.0
    # A dense grid is always found.
    assert quantum(step * np.repeat(np.arange(-50, 50.0), 4)) == pytest.approx(step, rel=1e-6)


def test_a_uniform_motion_is_no_resolution() -> None:
    assert quantum(0.0123 * np.arange(500)) == 0.0
    assert quantum(np.random.default_rng(1).normal(size=500)) == 0.0


def test_velocity_and_distance_of_the_circumference_need_the_radius() -> None:
    t = np.arange(101) / 100
    for text, raw in (("m/s", np.full(101, 0.3)), ("m", 0.3 * t), ("mm", 300 * t)):
        unit = find_unit(text)
        wheel = convert(t, raw, unit, PLAIN, per_rev=0, radius=0.1)
        assert wheel.angle[-1] == pytest.approx(3.0)
        assert (wheel.rate is None) == (text != "m/s")


def test_steps_since_the_last_row_are_added_up() -> None:
    t = np.arange(11) / 10
    said = Column(to=(), scale=-1, increment=True)
    wheel = convert(t, np.full(11, 7.0), COUNTS, said, per_rev=70, radius=0.1)
    assert wheel.angle[-1] - wheel.angle[0] == pytest.approx(-2 * np.pi)
