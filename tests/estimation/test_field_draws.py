"""Logs of drawn field loggers: what is called usable is right within its std."""

import math

import numpy as np

from benchmarks.field import Judged, judge
from tests.remembered import made_once
from tests.soak import SOAK

DRAWS = range(7000, 7320) if SOAK else range(7000, 7005)


@made_once
def judged() -> tuple[Judged, ...]:
    return tuple(judge(seed) for seed in DRAWS)


def ratios(index: int) -> list[float]:
    """Errors in std of what is called good or fair: of slip ratios (0) or distances (1)."""
    usable = [one for one in judged() if one.usable]
    return [abs(e) / s for one in usable for e, s in one.of(index)]


def test_what_is_called_usable_is_right_within_its_std() -> None:
    for index in (0, 1):
        size = np.array(ratios(index))
        assert size.size >= len(DRAWS) // 3
        # one of a few may lie outside of two std by chance; none may lie beyond four
        share = (0.90, 0.99) if SOAK else (0.75, 1.0)
        assert share[0] <= float(np.mean(size <= 2.0)) <= share[1]
        assert size.max() <= 4.0


def test_most_samples_with_a_fast_imu_stay_usable() -> None:
    fast = [one for one in judged() if one.fast]
    assert fast
    assert sum(one.usable for one in fast) >= 0.8 * len(fast)


def test_every_draw_ends_in_a_number_with_a_std_or_in_one_line() -> None:
    for one in judged():
        if one.grade == "refused":
            assert one.message
            assert "\n" not in one.message
        else:
            assert math.isfinite(one.slip) or math.isfinite(one.distance)
            assert one.distance_std > 0.0
