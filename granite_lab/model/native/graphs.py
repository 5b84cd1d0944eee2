"""The model's graphs as machine code: runs by `rosenbrock.integrate`, outputs over columns of samples."""

from __future__ import annotations

import ctypes
import inspect
import os
from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from llvmlite import binding

from granite_lab.logs.trial import Array
from granite_lab.model import interpreted
from granite_lab.model.command import Kind, corners, kind_of
from granite_lab.model.effect import Effect
from granite_lab.model.graph import build_graph
from granite_lab.model.instants import Accuracy, instants
from granite_lab.model.limits import most_steps, not_converged
from granite_lab.model.native import (
    lowering,
    machine,
    operations,
    program,
    rosenbrock,
    translate,
    writer,
)
from granite_lab.model.pieces import numbers_at, pieces
from granite_lab.parameters import Variant
from granite_lab.stored import machine_code

_POINTER, _WHOLE = ctypes.c_void_p, ctypes.c_int64

FAST, SPEED, BEST = range(3)
"""Efforts of `machine.compiled`."""

OFTEN = 200
"""Runs of a graph in a process from which on its code is compiled for speed: that takes 0.3 s, and a run is
1.5 ms shorter."""

LARGE = 3_000_000
"""Numbers in a block of memory larger than those of any usual run."""


@cache
def _version() -> str:
    """Return the text of all that makes machine code of a graph: other text, other code."""
    return "".join(
        inspect.getsource(m) for m in (program, writer, operations, lowering, translate, rosenbrock)
    )


def _library(name: str, names: Sequence[str], text: Callable[[], str], effort: int) -> machine.Library:
    """Return machine code, from the store where it is kept; its text is only made where it is not.

    Args:
        name: of the code in the store.
        names: of the routines in the code.
        text: makes the text.
        effort: as of `machine.compiled`.
    """
    store = machine_code()
    code = store.read(f"{name}.o")
    if code is None:
        code = machine.compiled(text(), effort=effort)
        store.keep(f"{name}.o", code)
    return machine.Library(code, names)


@cache
def _routines() -> machine.Library:
    """Return what all graphs share: the integrator, and the elementary functions for their code."""
    # the C library of Linux gives blocks back to the system, and new pages cost more than a run, until
    # it has once seen a block as large as this one is freed; the block itself is never touched
    np.empty(LARGE)
    mathematics = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
    for name in operations.LIBRARY:
        binding.add_symbol(name, ctypes.cast(getattr(mathematics, name), _POINTER).value)

    def text() -> str:
        functions = [writer.elementary_functions(lanes) for lanes in (0, program.LANES)]
        return "\n".join(
            [lowering.declarations(functions=False), *functions, translate.translate(*rosenbrock.ROUTINES)]
        )

    symbols = [writer.symbol(name, lanes) for name in writer.ELEMENTARY for lanes in (0, program.LANES)]
    library = _library(machine.key(_version()), [*symbols, "integrate"], text, BEST)
    for name in symbols:
        binding.add_symbol(name, library.address[name])
    return library


def _places(expression: Any) -> list[int]:
    """Return where the nonzero entries of a matrix stand, counted by columns."""
    rows, columns = expression.sparsity().get_triplet()
    return [row + expression.size1() * column for row, column in zip(rows, columns, strict=True)]


class Equations:
    """``rates`` and ``slopes`` of a graph; the numbers of a piece stand behind the parameters.

    They are compiled fast at first, and for speed once a process has run them often. Both codes give the same
    results to the last bit.

    Args:
        effects, kind: of the graph.
    """

    def __init__(self, effects: tuple[Effect, ...], kind: Kind) -> None:
        self._graph, self._runs = build_graph(effects, kind), 0
        serialized = self._function(self._graph.rates).serialize()
        self._keys = [machine.key(_version(), str(effort), serialized) for effort in (FAST, SPEED)]
        kept = machine_code().read(f"{self._keys[SPEED]}.o") is not None
        self._effort = SPEED if kept else FAST
        self._library = self._compiled()

    def _function(self, of: Any) -> Any:
        g = self._graph
        return ca.Function("rates", [g.t, g.x, ca.vertcat(g.p, g.u)], [of])

    def _text(self) -> str:
        rates = ca.cse(self._graph.rates)
        by_state, by_time = (ca.jacobian(rates, x) for x in (self._graph.x, self._graph.t))
        routines = {"rates": rates, "slopes": ca.cse(ca.horzcat(by_state, by_time, rates))}
        points = [
            lowering.point(name, program.read(self._function(of)), _places(of))
            for name, of in routines.items()
        ]
        return "\n".join([lowering.declarations(), *points])

    def _compiled(self) -> machine.Library:
        _routines()
        return _library(self._keys[self._effort], ("rates", "slopes"), self._text, self._effort)

    def addresses(self) -> tuple[int, int]:
        """Return where ``rates`` and ``slopes`` stand, for one run."""
        self._runs += 1
        if self._effort == FAST and self._runs > OFTEN:
            self._effort = SPEED
            self._library = self._compiled()
        return self._library.address["rates"], self._library.address["slopes"]


@lru_cache(maxsize=64)
def equations(effects: tuple[Effect, ...], kind: Kind = "trapezoid") -> Equations:
    """Compile the equations of a graph, or load their code.

    Raises:
        NotImplementedError: they cannot be compiled.
        RuntimeError: LLVM does not accept them.
        OSError, AttributeError: the C library cannot be found.
    """
    return Equations(effects, kind)


def forget() -> None:
    """Let the next use of a graph compile it, or load its code, anew."""
    equations.cache_clear()
    _columns.cache_clear()
    build_graph.cache_clear()


def run(
    effects: tuple[Effect, ...],
    variant: Variant,
    accuracy: Accuracy,
    start: Array,
    vector: Array,
    steps: Array | None = None,
) -> tuple[Array, Array | None]:
    """Integrate, anew from each corner of the command on; see `engine.Engine`."""
    kind = kind_of(variant)
    rates, slopes = equations(effects, kind).addresses()
    grid, bends = instants(variant, accuracy), corners(variant)
    times = np.concatenate([grid, [np.inf], bends, grid[-1:]])
    given = vector
    if kind != "trapezoid":
        _, table = pieces(variant)
        vector = np.hstack([np.tile(vector, (len(table), 1)), table])
    record = rosenbrock.record(
        (start.size, grid.size, len(bends) + 1), (accuracy.relative, accuracy.absolute),
        most_steps(grid.size, len(bends)), 0 if kind == "trapezoid" else vector.shape[1],
        smooth=kind in ("wheels", "sides"), steps=steps,
    )  # fmt: skip
    work, out = rosenbrock.work_space(start), np.empty((start.size, grid.size))
    arrays = (array.ctypes.data for array in (record, times, vector, work, out))
    status = _integrator()(rates, slopes, *arrays)
    if status == rosenbrock.TOO_MANY and not accuracy.lean:
        # a very stiff and all but rigid part, followed very closely, is easier for CVODES
        return interpreted.run(effects, variant, accuracy, start, given)
    if status < 0:
        raise not_converged(_TROUBLE[status])
    return out, rosenbrock.taken(record)


_TROUBLE = {
    rosenbrock.TOO_MANY: "TOO_MUCH_WORK",
    rosenbrock.TOO_SMALL: "ERR_FAILURE",
    rosenbrock.NO_NUMBER: "RHSFUNC_FAIL",
}
"""Why the integrator gave up, as `limits` knows it."""


@cache
def _integrator() -> Any:
    return ctypes.CFUNCTYPE(_WHOLE, *[_POINTER] * 7)(_routines().address["integrate"])


@lru_cache(maxsize=256)
def _columns(effects: tuple[Effect, ...], kind: Kind, names: tuple[str, ...]) -> Any:
    """Return the machine code of some outputs; the numbers of the pieces stand behind the states."""
    graph = build_graph(effects, kind)
    stacked = ca.densify(ca.vertcat(*(graph.outputs[name] for name in names)))

    def function(of: Any) -> Any:
        return ca.Function("columns", [graph.t, ca.vertcat(graph.x, graph.u), graph.p], [of])

    def text() -> str:
        code = program.read(function(ca.cse(stacked)))
        return lowering.declarations() + lowering.column("columns", code, _places(stacked))

    _routines()
    name = machine.key(_version(), function(stacked).serialize())
    library = _library(name, ("columns",), text, FAST)
    return ctypes.CFUNCTYPE(None, _WHOLE, _WHOLE, *[_POINTER] * 4)(library.address["columns"])


def outputs(
    effects: tuple[Effect, ...],
    variant: Variant,
    names: tuple[str, ...],
    t: Array,
    states: Array,
    vector: Array,
) -> Array:
    """Return outputs; see `engine.Engine`."""
    evaluate, samples = _columns(effects, kind_of(variant), names), t.size
    blocks = -(-samples // program.LANES)
    stride = blocks * program.LANES
    given = np.vstack([t, states, numbers_at(t, variant)])
    table, full = np.empty((len(names), stride)), np.empty((len(given), stride))
    full[:, :samples] = given
    full[:, samples:] = full[:, samples - 1 : samples]  # the last lanes need some numbers
    evaluate(blocks, stride, full.ctypes.data, full[1:].ctypes.data, vector.ctypes.data, table.ctypes.data)
    return table[:, :samples]
