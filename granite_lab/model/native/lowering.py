"""From the instructions of a graph to LLVM's text.

Two forms: `point` evaluates a function once, with all that the places of the contact arc have in
common in vectors; `column` evaluates it over many samples, as many at once as a vector has lanes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import casadi as ca

from granite_lab.model.native.program import LANES, SUM, Node, Program, read, schedule, used
from granite_lab.model.native.writer import ELEMENTARY, Writer, symbol

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
        SUM: lambda: _total(w, list(arguments)),
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


def _total(w: Writer, terms: list[str]) -> str:
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


class _Point:
    """Writes a program whose groups are vectors and whose other nodes are numbers."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.groups = schedule(program)
        self.lane = used(self.groups)
        self.one = Writer()
        # both writers fill one function
        self.all = Writer(LANES, self.one.lines)
        self.value: dict[int, str] = {}
        self.vector: dict[int, str] = {}

    def new(self, text: str) -> str:
        return self.one.new(text)

    def write(self) -> None:
        for g, group in enumerate(self.groups):
            node = self.program.nodes[group[0]]
            if len(group) > 1:
                columns = zip(*(self.program.nodes[k].operands for k in group), strict=True)
                arguments = [self.gather(list(column)) for column in columns]
                self.vector[g] = self.shared(partial(operation, self.all, node.op, arguments))
            elif node.op == ca.OP_CONST:
                self.value[group[0]] = self.one.constant(node.value)
            elif node.op == ca.OP_INPUT:
                self.value[group[0]] = self.load(node)
            elif node.op == SUM:
                self.value[group[0]] = self.sum(list(node.operands))
            else:
                self.value[group[0]] = operation(self.one, node.op, [self.number(o) for o in node.operands])

    def shared(self, write: Callable[[], str]) -> str:
        """Let the writer of vectors go on counting where that of numbers stands, and back."""
        self.all._count = self.one._count
        name = write()
        self.one._count = self.all._count
        return name

    def load(self, node: Node) -> str:
        argument, entry = node.place
        if argument == 0:
            return "%t"
        place = self.new(f"getelementptr double, ptr %{'_xp'[argument]}, i64 {entry}")
        return self.new(f"load double, ptr {place}")

    def number(self, k: int) -> str:
        """Return a node as a number."""
        if k not in self.value:
            g, lane = self.lane[k]
            self.value[k] = self.new(f"extractelement {self.all.real} {self.vector[g]}, i32 {lane}")
        return self.value[k]

    def gather(self, nodes: list[int]) -> str:
        """Return nodes as the lanes of a vector."""
        real = self.all.real
        if all(self.program.nodes[k].op == ca.OP_CONST for k in nodes):
            texts = [self.number(k) for k in nodes]
            return Writer.constants(texts + texts[-1:] * (LANES - len(texts)))
        if len(set(nodes)) == 1:
            first = self.new(f"insertelement {real} poison, double {self.number(nodes[0])}, i32 0")
            return self.new(f"shufflevector {real} {first}, {real} poison, <{LANES} x i32> zeroinitializer")
        if all(k in self.lane for k in nodes):
            sources = list(dict.fromkeys(self.lane[k][0] for k in nodes))
            lanes = [self.lane[k][1] for k in nodes]
            if len(sources) == 1 and lanes == list(range(len(nodes))):
                return self.vector[sources[0]]
            if len(sources) <= 2:
                mask = [
                    lane + LANES * sources.index(self.lane[k][0])
                    for k, lane in zip(nodes, lanes, strict=True)
                ]
                mask += mask[-1:] * (LANES - len(mask))
                listed = ", ".join(f"i32 {m}" for m in mask)
                a, b = self.vector[sources[0]], self.vector[sources[-1]]
                return self.new(f"shufflevector {real} {a}, {real} {b}, <{LANES} x i32> <{listed}>")
        vector = "poison"
        for lane, k in enumerate(nodes):
            vector = self.new(f"insertelement {real} {vector}, double {self.number(k)}, i32 {lane}")
        return vector

    def sum(self, nodes: list[int]) -> str:
        """Return a sum; of terms that are all lanes of one vector at once."""
        terms, rest = [], list(nodes)
        for g in dict.fromkeys(self.lane[k][0] for k in nodes if k in self.lane):
            if (
                len(self.groups[g]) == LANES
                and set(self.groups[g]) <= set(rest)
                and len(set(rest)) == len(rest)
            ):
                rest = [k for k in rest if k not in set(self.groups[g])]
                terms.append(self.shared(partial(_across, self.all, self.vector[g])))
        return _total(self.one, terms + [self.number(k) for k in rest])


def _across(w: Writer, vector: str) -> str:
    """Return the sum of all lanes of a vector."""
    kind = f"v{w.lanes}f64"
    return w.new(f"call reassoc double @llvm.vector.reduce.fadd.{kind}(double -0.0, {w.real} {vector})")


def point(name: str, f: Any, places: Sequence[Sequence[int]]) -> str:
    """Return a function ``void name(double t, double *x, double *p, double *out)``.

    Args:
        name: of the function.
        f: SX function of (t, x, p).
        places: of each output, where in `out` its nonzero entries go.

    Raises:
        NotImplementedError: an instruction cannot be compiled.
    """
    program = read(f)
    body = _Point(program)
    body.write()
    for output, entry, k in program.results:
        target = body.new(f"getelementptr double, ptr %out, i64 {places[output][entry]}")
        body.one.lines.append(f"  store double {body.number(k)}, ptr {target}")
    head = f"define void @{name}(double %t, ptr noalias %x, ptr noalias %p, ptr noalias %out) {{"
    return "\n".join([head, *body.one.lines, "  ret void", "}"])


def column(name: str, f: Any, rows: Sequence[int]) -> str:
    """Return a function ``void name(i64 blocks, i64 stride, double *t, double *x, double *p, double *out)``.

    Args:
        name: of the function; it evaluates ``blocks`` times `LANES` samples. State i begins at
            ``x + i stride``, output row r at ``out + r stride``.
        f: SX function of (t, x, p) with one output.
        rows: where in `out` its nonzero entries go.

    Raises:
        NotImplementedError: an instruction cannot be compiled.
    """
    program = read(f)
    still, moving = Writer(LANES), Writer(LANES)
    fixed: list[bool] = []
    value: list[str] = []
    moving._count = 1_000_000  # names of their own
    for node in program.nodes:
        same = node.place[0] == 2 if node.op == ca.OP_INPUT else all(fixed[o] for o in node.operands)
        fixed.append(same)
        w = still if same else moving
        if node.op == ca.OP_CONST:
            value.append(w.constant(node.value))
        elif node.op == ca.OP_INPUT:
            value.append(_column_load(w, node))
        else:
            value.append(operation(w, node.op, [value[o] for o in node.operands]))
    for _, entry, k in program.results:
        row = moving.new(f"mul i64 %stride, {rows[entry]}")
        start = moving.new(f"getelementptr double, ptr %out, i64 {row}")
        target = moving.new(f"getelementptr double, ptr {start}, i64 %at")
        moving.lines.append(f"  store {moving.real} {value[k]}, ptr {target}, align 8")
    head = (
        f"define void @{name}(i64 %blocks, i64 %stride, ptr noalias %t, ptr noalias %x, "
        "ptr noalias %p, ptr noalias %out) {"
    )
    return "\n".join([
        head, "entry:", *still.lines, f"  %end = mul i64 %blocks, {LANES}", "  br label %loop", "loop:",
        "  %at = phi i64 [0, %entry], [%next, %loop]", *moving.lines,
        f"  %next = add i64 %at, {LANES}", "  %more = icmp slt i64 %next, %end",
        "  br i1 %more, label %loop, label %done", "done:", "  ret void", "}",
    ])  # fmt: skip


def _column_load(w: Writer, node: Node) -> str:
    argument, entry = node.place
    if argument == 2:
        place = w.new(f"getelementptr double, ptr %p, i64 {entry}")
        single = w.new(f"load double, ptr {place}")
        first = w.new(f"insertelement {w.real} poison, double {single}, i32 0")
        return w.new(f"shufflevector {w.real} {first}, {w.real} poison, <{LANES} x i32> zeroinitializer")
    start = "%t"
    if argument == 1:
        row = w.new(f"mul i64 %stride, {entry}")
        start = w.new(f"getelementptr double, ptr %x, i64 {row}")
    place = w.new(f"getelementptr double, ptr {start}, i64 %at")
    return w.new(f"load {w.real}, ptr {place}, align 8")


def declarations(*, functions: bool = True) -> str:
    """Return declarations of what stands outside of the text, for a module's head.

    Args:
        functions: those of `ELEMENTARY`, too.
    """
    texts = [
        f"declare double @{name}({'double, double' if name in ('atan2', 'hypot') else 'double'})"
        for name in LIBRARY
    ]
    for lanes in (0, LANES):
        w = Writer(lanes)
        kind = f"v{lanes}f64" if lanes else "f64"
        known = (("sqrt", 1), ("fabs", 1), ("floor", 1), ("ceil", 1), ("copysign", 2), ("fma", 3))
        outside = [(f"llvm.{name}.{kind}", count) for name, count in known]
        if functions:
            outside += [(symbol(name, lanes), count) for name, (_, count) in ELEMENTARY.items()]
        texts += [f"declare {w.real} @{name}({', '.join([w.real] * count)})" for name, count in outside]
    texts.append(f"declare double @llvm.vector.reduce.fadd.v{LANES}f64(double, <{LANES} x double>)")
    return "\n".join(texts) + "\n"


LIBRARY = tuple(_LIBRARY.values())
"""Functions of the C library that the text may call."""
assert set(_ELEMENTARY.values()) == set(ELEMENTARY)
