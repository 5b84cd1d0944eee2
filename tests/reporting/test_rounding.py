from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from granite_lab.estimate import Estimate
from granite_lab.reporting.rounding import decimals_for, interval, plus_minus, significant

NAN = math.nan


@pytest.mark.parametrize(
    ("value", "std", "expected"),
    [
        # Examples of the rounding rule in the Review of Particle Physics, section 5.3.
        (0.827, 0.119, "0.83 ± 0.12"),
        (0.827, 0.367, "0.8 ± 0.4"),
        (4.9234, 0.0521, "4.92 ± 0.05"),
        (0.2561, 0.0123, "0.256 ± 0.012"),
        (1.0, 0.0096, "1.000 ± 0.010"),
        (-0.0001, 0.12, "0.00 ± 0.12"),
        (-1.26, 0.4, "−1.3 ± 0.4"),
        (1234.0, 210.0, "1230 ± 210"),
        (0.1234, NAN, "0.123"),
        (0.1234, 0.0, "0.123"),
        (NAN, 0.1, "–"),
        (math.inf, 0.1, "–"),
        (1.23e-8, 4e-10, "(1.23 ± 0.04)·10⁻⁸"),
        (2.5e7, 1.2e6, "(2.50 ± 0.12)·10⁷"),
    ],
)
def test_value_and_std_are_rounded_to_the_std(value: float, std: float, expected: str) -> None:
    assert plus_minus(Estimate(value, std)) == expected


def test_units_stay_with_their_number() -> None:
    assert plus_minus(Estimate(0.1649, 0.0031), "%", scale=100) == "16.49 ± 0.31\u00a0%"
    assert plus_minus(Estimate(NAN), "m/s") == "–"


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0, "0"), (9.996, "10.0"), (0.099996, "0.100"), (1.2345, "1.23"), (-0.0123456, "−0.0123"),
    (123456, "123000"),
     (1.5e-7, "1.50·10⁻⁷"), (9.9999e7, "1.00·10⁸"), (NAN, "–"), (-math.inf, "−∞")],
)  # fmt: skip
def test_significant_digits(value: float, expected: str) -> None:
    assert significant(value) == expected


def test_an_interval_has_equal_digits_at_both_ends() -> None:
    assert interval(4.8161, 5.0442, "s/m") == "4.82 to 5.04\u00a0s/m"
    assert interval(NAN, 1.0) == "–"
    assert interval(2.0, 2.0) == "2.00"


@given(st.floats(-1e5, 1e5), st.floats(1e-5, 1e4))
def test_rounding_never_moves_a_value_by_more_than_a_fifth_of_its_std(value: float, std: float) -> None:
    printed = plus_minus(Estimate(value, std)).replace("−", "-").replace("(", "")
    if "·10" in printed:
        return
    shown = float(printed.split(" ± ")[0])
    # One unit of the last place is at most a tenth of 0.355 of the leading decade of the std.
    assert abs(shown - value) <= 0.5 * 10.0 ** -decimals_for(std) * (1 + 1e-9)
    assert 10.0 ** -decimals_for(std) <= std / 0.949 * 1.0001 or std < 1e-4
