"""What runs whole only in `make soak`."""

import os
from collections.abc import Iterable, Sequence
from itertools import cycle, product
from typing import Any, TypeVar

import pytest

T = TypeVar("T")

SOAK = bool(os.environ.get("GRANITE_SOAK"))
"""Whether the long parts run whole, as in `make soak`."""

whole = pytest.mark.skipif(not SOAK, reason="takes long: in make soak")
"""Mark of a test whose claim shorter ones show in part."""


def sampled(cases: Iterable[T], every: int = 3) -> list[T]:
    """Return each `every`-th of cases that show one thing, from the first on; all in `make soak`."""
    return list(cases)[:: 1 if SOAK else every]


def in_turn(cases: Iterable[Any], *others: Sequence[Any]) -> list[tuple[Any, ...]]:
    """Return cases with one of each other list in turn; each with all of them in `make soak`."""
    return list(product(cases, *others) if SOAK else zip(cases, *map(cycle, others), strict=False))


def examples(many: int) -> int:
    """Return how many draws of many are tried: a third, the same in each run; all in `make soak`."""
    return many if SOAK else many // 3
