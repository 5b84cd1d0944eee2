"""How much worse an effect may explain the trials and still be named beside the best."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from granite_lab.discovery.rivals import tolerated


def test_where_only_noise_is_left_a_rival_must_explain_nearly_as_much() -> None:
    assert tolerated(10_000.0, 0.0) == pytest.approx(9 + 40)
    assert tolerated(100.0, 0.0) == pytest.approx(9.4)


def test_a_formula_that_leaves_a_hundredth_does_not_rule_out_one_that_leaves_two() -> None:
    """Hidden bulldozing: a slope leaves 1,300 of 56,000 beyond the noise, the library's bulldozing 2,000."""
    assert tolerated(56_000.0, 1_300.0) > 2_000 - 1_300
    assert tolerated(56_000.0, 1_300.0) < 4_000 - 1_300


@given(size=st.floats(0, 1e6), leaves=st.floats(0, 1e6), more=st.floats(0, 1e6))
def test_a_worse_best_rules_out_less(size: float, leaves: float, more: float) -> None:
    assert tolerated(size, leaves) <= tolerated(size, leaves + more) <= 9 + 0.02 * size
