"""The integrator of a run: machine code where it can be compiled, otherwise the interpreted graph."""

from __future__ import annotations

import os
from functools import cache, lru_cache
from types import ModuleType
from typing import Protocol, cast

from granite_lab.logs.trial import Array
from granite_lab.model import interpreted
from granite_lab.model.command import Kind
from granite_lab.model.effect import Effect
from granite_lab.model.instants import Accuracy
from granite_lab.parameters import Variant

INTERPRETED = "GRANITE_LAB_INTERPRETED"
"""Environment variable: not empty, nothing is compiled."""


class Engine(Protocol):
    """What the modules `granite_lab.model.interpreted` and `granite_lab.model.native.graphs` both offer."""

    def run(
        self,
        effects: tuple[Effect, ...],
        variant: Variant,
        accuracy: Accuracy,
        start: Array,
        vector: Array,
        steps: Array | None = None,
    ) -> tuple[Array, Array | None]:
        """Integrate the equations of motion.

        Args:
            effects: of the graph.
            variant: the commanded trapezoid, or a course.
            accuracy: tolerances and output grid.
            start: (S,) state at the first instant.
            vector: (P,) parameters.
            steps: of a run along as many corners, to be repeated.

        Returns:
            (S, N) states, and the steps of the run; None where no run can repeat them.

        Raises:
            EstimateError: the integrator gave up.
        """

    def outputs(
        self,
        effects: tuple[Effect, ...],
        variant: Variant,
        names: tuple[str, ...],
        t: Array,
        states: Array,
        vector: Array,
    ) -> Array:
        """Return (rows, N) outputs of the graph.

        Args:
            effects: of the graph.
            variant: as in `run`.
            names: of the outputs.
            t: (N,) instants [s].
            states: (S, N) at them.
            vector: (P,) parameters.
        """


@cache
def _native() -> ModuleType | None:
    """Return the module of compiled graphs; None where no machine code can be compiled at all."""
    if os.environ.get(INTERPRETED):
        return None
    try:
        from granite_lab.model.native import graphs  # noqa: PLC0415, without llvmlite there is none

        graphs.equations(())
    except (ImportError, NotImplementedError, OSError, RuntimeError, AttributeError):
        return None
    return graphs


@lru_cache(maxsize=256)
def engine_of(effects: tuple[Effect, ...], kind: Kind = "trapezoid") -> Engine:
    """Return what integrates this graph; one that cannot be compiled is interpreted."""
    graphs = _native()
    if graphs is not None:
        try:
            graphs.equations(effects, kind)
            return cast(Engine, graphs)
        except (NotImplementedError, RuntimeError):
            pass
    return cast(Engine, interpreted)
