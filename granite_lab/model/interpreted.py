"""The graph without machine code: CVODES (SUNDIALS) through CasADi, and NumPy for the outputs."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from granite_lab.errors import EstimateError
from granite_lab.model.columns import ColumnFunction
from granite_lab.model.effect import Effect
from granite_lab.model.graph import build_graph
from granite_lab.model.instants import Accuracy, instants
from granite_lab.model.limits import MAX_STEPS, not_converged
from granite_lab.parameters import Variant

Array = npt.NDArray[np.float64]


@lru_cache(maxsize=64)
def _equations(effects: tuple[Effect, ...]) -> dict[str, Any]:
    graph = build_graph(effects)
    return {"t": graph.t, "x": graph.x, "p": graph.p, "ode": ca.cse(graph.rates)}


@lru_cache(maxsize=256)
def _integrator(effects: tuple[Effect, ...], variant: Variant, accuracy: Accuracy) -> Any:
    grid = instants(variant, accuracy)
    return ca.integrator(
        "run",
        "cvodes",
        _equations(effects),
        grid[0],
        grid[1:],
        {
            "reltol": accuracy.relative,
            "abstol": accuracy.absolute,
            "max_order": accuracy.order,
            "max_num_steps": MAX_STEPS,
            "disable_internal_warnings": True,
        },
    )


def run(
    effects: tuple[Effect, ...], variant: Variant, accuracy: Accuracy, start: Array, vector: Array
) -> Array:
    """Integrate the equations of motion; the history is read without a detour over lists of numbers.

    Args:
        effects: of the graph.
        variant: the commanded trapezoid.
        accuracy: tolerances and output grid.
        start: (S,) state at the first instant.
        vector: (P,) parameters.

    Returns:
        (S, N) states.

    Raises:
        EstimateError: CVODES gave up.
    """
    integrator = _integrator(effects, variant, accuracy)
    history = np.empty((1 + integrator.size2_out("xf"), start.size))
    history[0] = start
    places, evaluate = integrator.buffer()
    places.set_arg(integrator.index_in("x0"), start.data)
    places.set_arg(integrator.index_in("p"), vector.data)
    places.set_res(integrator.index_out("xf"), history[1:].data)
    try:
        evaluate()
    except RuntimeError as error:
        raise not_converged(str(error)) from None
    return np.ascontiguousarray(history.T)


def run_many(
    effects: tuple[Effect, ...], variant: Variant, accuracy: Accuracy, starts: Array, vectors: Array
) -> list[Array]:
    """Integrate from several states with several parameters, each run with steps of its own.

    Args:
        effects: of the graph.
        variant: the commanded trapezoid.
        accuracy: tolerances and output grid.
        starts: (K, S) states at the first instant.
        vectors: (K, P) parameters.

    Returns:
        K times (S, N) states, not numbers where CVODES gave up another than the first run.

    Raises:
        EstimateError: CVODES gave up the first run.
    """
    histories = [run(effects, variant, accuracy, starts[0], vectors[0])]
    for start, vector in zip(starts[1:], vectors[1:], strict=True):
        try:
            histories.append(run(effects, variant, accuracy, start, vector))
        except EstimateError:
            histories.append(np.full_like(histories[0], np.nan))
    return histories


@lru_cache(maxsize=128)
def _columns(effects: tuple[Effect, ...], names: tuple[str, ...]) -> Callable[[Array, Array, Array], Array]:
    graph = build_graph(effects)
    inputs, stacked = [graph.t, graph.x, graph.p], ca.vertcat(*(graph.outputs[name] for name in names))
    try:
        columns = ColumnFunction(inputs, stacked)
    except NotImplementedError:  # an effect with a rare function: CasADi, sample by sample
        function = ca.Function("outputs", inputs, [ca.densify(stacked)])
        return lambda t, x, p: np.array(function(t[None], x, p))
    return lambda t, x, p: columns(t[None], x, p, samples=t.size)


def outputs(
    effects: tuple[Effect, ...], names: tuple[str, ...], t: Array, states: Array, vector: Array
) -> Array:
    """Return (rows, N) outputs of the graph.

    Args:
        effects: of the graph.
        names: of the outputs.
        t: (N,) instants [s].
        states: (S, N) at them.
        vector: (P,) parameters.
    """
    return _columns(effects, names)(t, states, vector)
