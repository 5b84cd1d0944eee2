"""How surely a share or a mean is known from so many trials."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2_contingency

Interval = tuple[float, float]

NORMAL = 1.96
"""Half the width of a 95 % interval, in std."""


def wilson(share: float, trials: int) -> Interval:
    """Return the 95 % interval of a share by Wilson (1927): true to small numbers and to shares near 1."""
    if trials == 0:
        return float("nan"), float("nan")
    z2 = NORMAL**2 / trials
    centre = (share + 0.5 * z2) / (1.0 + z2)
    half = NORMAL * float(np.sqrt(share * (1.0 - share) / trials + 0.25 * z2 / trials)) / (1.0 + z2)
    return max(centre - half, 0.0), min(centre + half, 1.0)


def ratio(hits: int, total: int, of: str = " of ") -> str:
    """Return a share in percent with its interval after Wilson; a dash where there is nothing to count.

    Args:
        hits, total: how many of how many.
        of: what stands between these two.
    """
    if not total:
        return "–"
    low, high = wilson(hits / total, total)
    return f"{hits}{of}{total} = {100 * hits / total:.0f} % ({100 * low:.0f}–{100 * high:.0f})"


def around(mean: float, error: float, low: float = -np.inf, high: float = np.inf) -> Interval:
    """Return the 95 % interval of a mean with its standard error, within what is possible."""
    return max(mean - NORMAL * error, low), min(mean + NORMAL * error, high)


def excludes(interval: Interval, aim: Interval) -> bool:
    """Whether a range of values that fit the trials has none in common with the aim."""
    return interval[1] < aim[0] or interval[0] > aim[1]


def alike(shares: Sequence[float], trials: Sequence[int]) -> float:
    """Return how likely shares scatter at least as much if one true share is behind them all (χ²)."""
    hits = np.round(np.multiply(shares, trials))
    table = np.stack([hits, np.subtract(trials, hits)])
    return float(chi2_contingency(table).pvalue) if table.sum(axis=1).all() else 1.0
