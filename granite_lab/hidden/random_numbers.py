"""Random numbers, and records whose numbers they change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


def generator(*key: int) -> np.random.Generator:
    """Return the generator of a key; those of different keys are independent."""
    return np.random.default_rng(key)


def magnitude(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw between two magnitudes, each power of ten as likely."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def factors(rng: np.random.Generator, std: Mapping[str, float]) -> dict[str, float]:
    """Draw a log-normal factor of each name, whose logarithm has the given std."""
    return {name: float(np.exp(size * rng.standard_normal())) for name, size in std.items()}


def scaled(record: T, by: Mapping[str, float]) -> T:
    """Return a record with some of its numbers times a factor."""
    changed: Any = replace(record, **{name: getattr(record, name) * by[name] for name in by})  # type: ignore[type-var]
    return changed  # type: ignore[no-any-return]
