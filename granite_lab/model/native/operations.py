"""CasADi's operations in LLVM's text."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

from granite_lab.model.native.writer import ELEMENTARY, Writer

_PLAIN = {ca.OP_ADD: "fadd", ca.OP_SUB: "fsub", ca.OP_MUL: "fmul", ca.OP_DIV: "fdiv"}
_COMPARED = {ca.OP_LT: "olt", ca.OP_LE: "ole", ca.OP_EQ: "oeq", ca.OP_NE: "une"}


def _named(*names: str) -> dict[int, str]:
    """Return CasADi's operations to the names that they have in lower case."""
    return {getattr(ca, f"OP_{name.upper()}"): name for name in names}


_ELEMENTARY = _named("exp", "log", "sin", "cos", "pow") | {ca.OP_CONSTPOW: "pow"}
_LLVM = _named("sqrt", "fabs", "floor", "ceil", "copysign")
_LIBRARY = _named("tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "log1p", "expm1", "atan2", "hypot")


def operation(w: Writer, op: int, arguments: Sequence[str]) -> str:
    """Write one operation of CasADi and return the name of its result.

    Raises:
        NotImplementedError: no text is known for it.
    """
    a, b = arguments[0], arguments[-1]
    zero, one = w.constant(0.0), w.constant(1.0)
    if op in _PLAIN:
        return w.arithmetic(_PLAIN[op], a, b)
    if op in _COMPARED:
        return w.truth(w.compare(_COMPARED[op], a, b))
    if op in _ELEMENTARY:
        return w.elementary(_ELEMENTARY[op], *arguments)
    if op in _LLVM:
        return w.call(_LLVM[op], *arguments)
    if op in _LIBRARY:
        return _by_lane(w, _LIBRARY[op], arguments)
    written: dict[int, Callable[[], str]] = {
        ca.OP_NEG: lambda: w.new(f"fneg {w.real} {a}"),
        ca.OP_SQ: lambda: w.arithmetic("fmul", a, a),
        ca.OP_TWICE: lambda: w.arithmetic("fadd", a, a),
        ca.OP_INV: lambda: w.arithmetic("fdiv", one, a),
        ca.OP_SIGN: lambda: w.select(w.compare("une", a, zero), w.call("copysign", one, a), zero),
        ca.OP_FMIN: lambda: w.select(w.compare("ole", a, b), a, b),
        ca.OP_FMAX: lambda: w.select(w.compare("oge", a, b), a, b),
        ca.OP_IF_ELSE_ZERO: lambda: w.select(w.compare("une", a, zero), b, zero),
        ca.OP_NOT: lambda: w.truth(w.compare("oeq", a, zero)),
        ca.OP_AND: lambda: w.arithmetic("fmul", *(w.truth(w.compare("une", x, zero)) for x in (a, b))),
        ca.OP_OR: lambda: w.truth(
            w.compare("une", w.arithmetic("fadd", w.call("fabs", a), w.call("fabs", b)), zero)
        ),
    }
    if op not in written:
        raise NotImplementedError(f"instruction {op} cannot be compiled")
    return written[op]()


def _by_lane(w: Writer, name: str, arguments: Sequence[str]) -> str:
    """Call a function of the C library for each lane."""
    if not w.lanes:
        return w.new(f"call double @{name}({', '.join(f'double {a}' for a in arguments)})")
    result = "poison"
    for lane in range(w.lanes):
        parts = [w.new(f"extractelement {w.real} {a}, i32 {lane}") for a in arguments]
        value = w.new(f"call double @{name}({', '.join(f'double {a}' for a in parts)})")
        result = w.new(f"insertelement {w.real} {result}, double {value}, i32 {lane}")
    return result


LIBRARY = tuple(_LIBRARY.values())
"""Functions of the C library that the text may call."""
assert set(_ELEMENTARY.values()) == set(ELEMENTARY)
