"""Stamps: order, duplicates, wraps, units, gaps; resets are refused, repeated blocks are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granite_lab.errors import InputError
from granite_lab.logs.counters import describe_gaps, tidy, unit_factor
from tests.logs import make

T = np.arange(1000) / 100


def tidied(t: np.ndarray, values: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, list[str]]:
    doubts: list[str] = []
    values = np.zeros((len(t), 1)) if values is None else values
    return (*tidy(t, values, "x", lambda row: f"row {row}", doubts), doubts)


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_late_and_double_samples_are_sorted_and_the_first_is_kept(data: st.DataObject) -> None:
    seed = data.draw(st.integers(0, 10_000))
    reach = data.draw(st.integers(1, 6))
    rng = np.random.default_rng(seed)
    order = np.argsort(np.arange(len(T)) + rng.uniform(0, reach, len(T)), kind="stable")
    order = np.insert(order, 500, order[480:486])  # too few for a new start
    t, rows, _ = tidied(T[order], rng.normal(size=(len(order), 2)))
    np.testing.assert_array_equal(t, T)
    # The first row of the file that has the stamp.
    np.testing.assert_array_equal(rows, [int(np.flatnonzero(order == k)[0]) for k in range(len(T))])


def test_blocks_in_the_wrong_order_are_sorted() -> None:
    order = np.concatenate((np.arange(500, 1000), np.arange(500)))
    np.testing.assert_array_equal(tidied(T[order])[0], T)


def test_a_block_written_twice_is_read_once_but_a_new_start_is_refused() -> None:
    twice = np.concatenate((T[:600], T[400:]))
    values = np.sin(twice * 7)[:, None]
    np.testing.assert_array_equal(tidied(twice, values)[0], T)
    other = values.copy()
    other[600:] += 1
    with pytest.raises(InputError, match=r"row 600: x: time runs backwards by .* and starts over"):
        tidied(twice, other)
    with pytest.raises(InputError, match=r"row 600: .*starts over"):
        tidied(np.concatenate((T[:600], T[:300] + 0.003)))


@pytest.mark.parametrize("bits", [16, 32])
def test_a_clock_of_fixed_width_is_unwrapped_but_not_one_that_was_reset(bits: int, tmp_path: Path) -> None:
    """[ms], 100 Hz; the other clock starts over a second before its wrap."""
    header, *rows = make.lines()
    wrapped = np.mod(2**bits - 3000 + 10 * np.arange(len(rows)), 2**bits)
    for offset in (0, 1000):
        stamps = np.where(wrapped > 2**15, wrapped - offset, wrapped)
        cells = [f"{k},{row.partition(',')[2]}" for k, row in zip(stamps, rows, strict=True)]
        trial = make.read(tmp_path, "\n".join([header.replace("t_s", "t_ms"), *cells]))
        even = np.allclose(np.diff(trial.imu.t), 0.01, atol=1e-9)
        said = any(f"the clock wrapped 1 times at {2**bits}" in line for line in trial.warnings)
        assert even == said == (offset == 0)


@given(
    rate=st.floats(5, 1500),
    true=st.sampled_from([1.0, 1e-3, 1e-6, 1e-9]),
    declared=st.sampled_from([1.0, 1e-3, 1e-6, 1e-9]),
)
@settings(max_examples=200, deadline=None)
def test_a_unit_is_corrected_refused_or_right_but_never_wrong_by_thousands(
    rate: float, true: float, declared: float
) -> None:
    raw = np.arange(50) / rate / true
    try:
        factor, doubt = unit_factor(raw, declared, 4.0)
    except InputError:
        return
    assert (doubt == "") == (factor == declared)
    # Where a wrong unit passes, its rate is one that sensors have: only those lie within a thousand.
    assert factor == true or 4 <= rate * true / factor <= 20_000


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_dates_name_their_own_unit(unit: str, scale: float) -> None:
    raw = (1.7e9 + T) * scale
    factor, doubt = unit_factor(raw, 1.0, 4.0)
    assert factor == 1 / scale
    assert f"stamps are in {unit}" in doubt


def test_gaps_are_counted_from_three_periods_on() -> None:
    t = np.delete(T, [100, 101, 500, 501, 502, 503])
    assert describe_gaps(np.delete(T, [100]), "x") == ""
    text = describe_gaps(t, "x")
    assert "the longest 0.050 s at t = 4.990 s" in text
