"""The graph without machine code: CVODES (SUNDIALS) through CasADi."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from granite_lab.logs.trial import Array
from granite_lab.model.command import Kind, kind_of
from granite_lab.model.effect import Effect
from granite_lab.model.graph import build_graph
from granite_lab.model.instants import Accuracy, instants
from granite_lab.model.limits import MAX_STEPS, not_converged
from granite_lab.model.pieces import numbers_at, pieces
from granite_lab.parameters import Course, Variant


@lru_cache(maxsize=64)
def _equations(effects: tuple[Effect, ...], course: Course | None) -> dict[str, Any]:
    """Return the equations along a course; without one those of all trapezoids, whose numbers enter."""
    if course is None:
        graph = build_graph(effects)
        return {"t": graph.t, "x": graph.x, "p": graph.p, "ode": ca.cse(graph.rates)}
    graph = build_graph(effects, kind_of(course))
    corners, table = pieces(course)
    rates = ca.Function("rates", [graph.t, graph.x, graph.p, graph.u], [ca.cse(graph.rates)])
    t, x, p = (
        ca.MX.sym(name, size) for name, size in (("t", 1), ("x", graph.x.numel()), ("p", graph.p.numel()))
    )
    # the number of the piece: how many corners have passed
    passed = ca.sum1(ca.DM(corners) <= t)
    return {"t": t, "x": x, "p": p, "ode": rates(t, x, p, ca.MX(ca.DM(table.T))[:, passed])}


@lru_cache(maxsize=256)
def _integrator(effects: tuple[Effect, ...], variant: Variant, accuracy: Accuracy) -> Any:
    grid = instants(variant, accuracy)
    return ca.integrator(
        "run",
        "cvodes",
        _equations(effects, variant if isinstance(variant, Course) else None),
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
    effects: tuple[Effect, ...],
    variant: Variant,
    accuracy: Accuracy,
    start: Array,
    vector: Array,
    steps: Array | None = None,  # noqa: ARG001, CVODES chooses its own
) -> tuple[Array, Array | None]:
    """Integrate by CVODES; see `engine.Engine`."""
    try:
        after = _integrator(effects, variant, accuracy)(x0=start, p=vector)["xf"]
    except RuntimeError as error:
        raise not_converged(str(error)) from None
    return np.column_stack([start, after.full()]), None


@lru_cache(maxsize=128)
def _columns(effects: tuple[Effect, ...], kind: Kind, names: tuple[str, ...]) -> Any:
    graph = build_graph(effects, kind)
    stacked = ca.densify(ca.vertcat(*(graph.outputs[name] for name in names)))
    return ca.Function("outputs", [graph.t, graph.x, graph.p, graph.u], [stacked])


def outputs(
    effects: tuple[Effect, ...],
    variant: Variant,
    names: tuple[str, ...],
    t: Array,
    states: Array,
    vector: Array,
) -> Array:
    """Return outputs; see `engine.Engine`."""
    columns = _columns(effects, kind_of(variant), names)
    return np.array(columns(t[None], states, vector, numbers_at(t, variant)))
