"""CasADi's operations and their derivatives in LLVM's text."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

from granite_lab.model.native.program import SUM
from granite_lab.model.native.writer import ELEMENTARY, Writer

_PLAIN = {ca.OP_ADD: "fadd", ca.OP_SUB: "fsub", ca.OP_MUL: "fmul", ca.OP_DIV: "fdiv"}
_COMPARED = {ca.OP_LT: "olt", ca.OP_LE: "ole", ca.OP_EQ: "oeq", ca.OP_NE: "une"}
_ELEMENTARY = {
    ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
}  # fmt: skip
_LLVM = {
    ca.OP_SQRT: "sqrt", ca.OP_FABS: "fabs", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil",
    ca.OP_COPYSIGN: "copysign",
}  # fmt: skip
_LIBRARY = {
    ca.OP_TAN: "tan", ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan", ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh", ca.OP_TANH: "tanh", ca.OP_LOG1P: "log1p", ca.OP_EXPM1: "expm1",
    ca.OP_ATAN2: "atan2", ca.OP_HYPOT: "hypot",
}  # fmt: skip


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
        SUM: lambda: total(w, list(arguments)),
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


def total(w: Writer, terms: list[str]) -> str:
    """Return the sum of terms, in pairs, so that they need not wait for each other."""
    while len(terms) > 1:
        pairs = [w.arithmetic("fadd", *terms[k : k + 2]) for k in range(0, len(terms) - 1, 2)]
        terms = pairs + terms[len(terms) - len(terms) % 2 :]
    return terms[0]


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

_FLAT = {
    ca.OP_SIGN, ca.OP_FLOOR, ca.OP_CEIL, ca.OP_NOT, ca.OP_AND, ca.OP_OR, *_COMPARED,
}  # fmt: skip
"""Operations whose derivative is zero wherever they have one."""

_Partial = Callable[[Writer, str, str], str]
_PARTIAL: dict[int, _Partial] = {
    ca.OP_SQ: lambda w, a, r: w.arithmetic("fadd", a, a),
    ca.OP_INV: lambda w, a, r: w.new(f"fneg {w.real} {w.arithmetic('fmul', r, r)}"),
    ca.OP_SQRT: lambda w, a, r: w.arithmetic("fdiv", w.constant(0.5), r),
    ca.OP_EXP: lambda w, a, r: r,
    ca.OP_EXPM1: lambda w, a, r: w.arithmetic("fadd", r, w.constant(1.0)),
    ca.OP_LOG: lambda w, a, r: w.arithmetic("fdiv", w.constant(1.0), a),
    ca.OP_LOG1P: lambda w, a, r: w.arithmetic(
        "fdiv", w.constant(1.0), w.arithmetic("fadd", a, w.constant(1.0))
    ),
    ca.OP_SIN: lambda w, a, r: w.elementary("cos", a),
    ca.OP_COS: lambda w, a, r: w.new(f"fneg {w.real} {w.elementary('sin', a)}"),
    ca.OP_TAN: lambda w, a, r: w.fma(r, r, w.constant(1.0)),
    ca.OP_ASIN: lambda w, a, r: _on_circle(w, a, 1.0),
    ca.OP_ACOS: lambda w, a, r: _on_circle(w, a, -1.0),
    ca.OP_ATAN: lambda w, a, r: w.arithmetic("fdiv", w.constant(1.0), w.fma(a, a, w.constant(1.0))),
    ca.OP_SINH: lambda w, a, r: _by_lane(w, "cosh", [a]),
    ca.OP_COSH: lambda w, a, r: _by_lane(w, "sinh", [a]),
    ca.OP_TANH: lambda w, a, r: w.fma(w.new(f"fneg {w.real} {r}"), r, w.constant(1.0)),
    ca.OP_FABS: lambda w, a, r: w.call("copysign", w.constant(1.0), a),
}
"""∂r/∂a of an operation r of one argument a."""


def _on_circle(w: Writer, a: str, sign: float) -> str:
    """Return the derivative of the arcsine, or of the arccosine."""
    rest = w.fma(w.new(f"fneg {w.real} {a}"), a, w.constant(1.0))
    return w.arithmetic("fdiv", w.constant(sign), w.call("sqrt", rest))


def derivative(
    w: Writer, op: int, arguments: Sequence[str], r: str, inner: Sequence[str | None]
) -> str | None:
    """Write the derivative of an operation in one direction; None where it is zero.

    Args:
        w: where to write it.
        op: the operation.
        arguments: its arguments.
        r: its result.
        inner: derivatives of the arguments; None where they are zero.

    Raises:
        NotImplementedError: no text is known for it.
    """
    parts = [d for d in inner if d is not None]
    if op in _FLAT or not parts:
        return None
    if op == SUM:
        return total(w, parts)
    if op == ca.OP_NEG:
        return w.new(f"fneg {w.real} {parts[0]}")
    if op == ca.OP_TWICE:
        return w.arithmetic("fadd", parts[0], parts[0])
    if op in _PARTIAL:
        return w.arithmetic("fmul", _PARTIAL[op](w, arguments[0], r), parts[0])
    return _of_two(w, op, (arguments[0], arguments[1]), r, (inner[0], inner[1]))


def _of_two(
    w: Writer, op: int, arguments: tuple[str, str], r: str, inner: tuple[str | None, str | None]
) -> str | None:
    (a, b), (da, db) = arguments, inner
    zero = w.constant(0.0)
    if op == ca.OP_ADD:
        return w.arithmetic("fadd", da, db) if da and db else da or db
    if op == ca.OP_SUB:
        return w.arithmetic("fsub", da or zero, db) if db else da
    if op in (ca.OP_FMIN, ca.OP_FMAX):
        where = w.compare("ole" if op == ca.OP_FMIN else "oge", a, b)
        return w.select(where, da or zero, db or zero)
    if op == ca.OP_IF_ELSE_ZERO:
        return w.select(w.compare("une", a, zero), db, zero) if db else None
    by_a, by_b = _PARTIALS[op] if op in _PARTIALS else _unknown(op)
    if da and db:
        return w.fma(by_a(w, a, b, r), da, w.arithmetic("fmul", by_b(w, a, b, r), db))
    return (
        w.arithmetic("fmul", by_a(w, a, b, r), da)
        if da
        else w.arithmetic("fmul", by_b(w, a, b, r), db or zero)
    )


def _unknown(op: int) -> tuple[_Partials, _Partials]:
    raise NotImplementedError(f"instruction {op} cannot be differentiated")


_Partials = Callable[[Writer, str, str, str], str]


def _power_by_base(w: Writer, a: str, b: str, r: str) -> str:
    less = w.arithmetic("fsub", b, w.constant(1.0))
    return w.arithmetic("fmul", b, w.elementary("pow", a, less))


def _power_by_exponent(w: Writer, a: str, b: str, r: str) -> str:
    value = w.arithmetic("fmul", r, w.elementary("log", a))
    return w.select(w.compare("ogt", a, w.constant(0.0)), value, w.constant(0.0))


def _share(w: Writer, a: str, b: str, r: str) -> str:
    return w.arithmetic("fdiv", a, r)


def _angle(w: Writer, a: str, b: str, sign: float) -> str:
    """Return ± b / (a² + b²)."""
    squares = w.fma(a, a, w.arithmetic("fmul", b, b))
    return w.arithmetic("fdiv", w.arithmetic("fmul", w.constant(sign), b), squares)


def _inverse(w: Writer, a: str, b: str, r: str) -> str:
    return w.arithmetic("fdiv", w.constant(1.0), b)


_PARTIALS: dict[int, tuple[_Partials, _Partials]] = {
    ca.OP_MUL: (lambda w, a, b, r: b, lambda w, a, b, r: a),
    ca.OP_DIV: (
        _inverse,
        lambda w, a, b, r: w.new(f"fneg {w.real} {w.arithmetic('fmul', r, _inverse(w, a, b, r))}"),
    ),
    ca.OP_POW: (_power_by_base, _power_by_exponent),
    ca.OP_CONSTPOW: (_power_by_base, _power_by_exponent),
    ca.OP_HYPOT: (_share, lambda w, a, b, r: _share(w, b, a, r)),
    ca.OP_ATAN2: (lambda w, a, b, r: _angle(w, a, b, 1.0), lambda w, a, b, r: _angle(w, b, a, -1.0)),
    ca.OP_COPYSIGN: (
        lambda w, a, b, r: w.call(
            "copysign", w.constant(1.0), w.arithmetic("fmul", w.call("copysign", w.constant(1.0), a), r)
        ),
        lambda w, a, b, r: w.constant(0.0),
    ),
}
"""∂r/∂a and ∂r/∂b of an operation r of two arguments a and b."""
