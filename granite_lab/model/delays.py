"""Signals that reach the log later than they happened."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from granite_lab.model.effect import Effect
from granite_lab.model.graph import build_graph

Array = npt.NDArray[np.float64]


@lru_cache(maxsize=64)
def _lags(effects: tuple[Effect, ...]) -> Any:
    graph = build_graph(effects)
    return ca.Function("lags", [graph.p], [ca.vertcat(*graph.delays.values())])


def delayed(
    t: Array, signals: dict[str, Array], effects: tuple[Effect, ...], vector: Array
) -> dict[str, Array]:
    """Return the signals with those that an effect delays shifted in time; before and after, at rest.

    Args:
        t: (N,) time since the start of the command [s].
        signals: name to (N,) array.
        effects: effects of the graph.
        vector: (P,) its parameters.
    """
    delays = build_graph(effects).delays
    if not delays:
        return signals
    late = {
        name: np.interp(t - lag, t, signals[name])
        for name, lag in zip(delays, _lags(effects)(vector).full()[:, 0], strict=True)
        if lag != 0 and name in signals
    }
    return signals | late
