"""From the instructions of a graph to LLVM's text.

Two forms: `point` evaluates a function once, with all that the places of the contact arc have in
common in vectors; `column` evaluates it over many samples, as many at once as a vector has lanes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

import casadi as ca

from granite_lab.model.native.operations import LIBRARY, operation
from granite_lab.model.native.program import LANES, Node, Program, schedule, used
from granite_lab.model.native.writer import ELEMENTARY, Writer, symbol


class _Point:
    """Writes a program whose groups are vectors and whose other nodes are numbers."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.groups = schedule(program)
        self.lane = used(self.groups)
        self.scalar = Writer()
        self.vector = Writer(LANES, self.scalar.lines, self.scalar.numbers)  # both fill one function
        self.values: dict[int, str] = {}  # node to number
        self.vectors: dict[int, str] = {}  # group to vector
        for g, group in enumerate(self.groups):
            self.write(g, group)

    def write(self, g: int, group: list[int]) -> None:
        """Write what one operation gives, for one node or for all of a group."""
        first, node = group[0], self.program.nodes[group[0]]
        if node.op == ca.OP_CONST:
            self.values[first] = self.scalar.constant(node.value)
        elif node.op == ca.OP_INPUT:
            self.values[first] = self.load(node)
        elif len(group) == 1:
            self.values[first] = operation(self.scalar, node.op, [self.number(o) for o in node.operands])
        else:
            columns = zip(*(self.program.nodes[k].operands for k in group), strict=True)
            self.vectors[g] = operation(self.vector, node.op, [self.gather(column) for column in columns])

    def load(self, node: Node) -> str:
        argument, entry = node.place
        if argument == 0:
            return "%t"
        address = self.scalar.new(f"getelementptr double, ptr %{'_xp'[argument]}, i64 {entry}")
        return self.scalar.new(f"load double, ptr {address}")

    def number(self, k: int) -> str:
        """Return a node as a number."""
        if k not in self.values:
            g, lane = self.lane[k]
            self.values[k] = self.scalar.new(
                f"extractelement {self.vector.real} {self.vectors[g]}, i32 {lane}"
            )
        return self.values[k]

    def gather(self, nodes: Sequence[int]) -> str:
        """Return nodes as the lanes of a vector."""
        real = self.vector.real
        if all(k in self.lane for k in nodes):
            sources = list(dict.fromkeys(self.lane[k][0] for k in nodes))
            lanes = [self.lane[k][1] for k in nodes]
            vectors = [self.vectors[g] for g in sources]
            if len(sources) == 1 and lanes == list(range(len(nodes))):
                return vectors[0]
            if len(sources) <= 2:
                mask = [
                    lane + LANES * sources.index(self.lane[k][0])
                    for k, lane in zip(nodes, lanes, strict=True)
                ]
                listed = ", ".join(f"i32 {m}" for m in mask + mask[-1:] * (LANES - len(mask)))
                return self.scalar.new(
                    f"shufflevector {real} {vectors[0]}, {real} {vectors[-1]}, <{LANES} x i32> <{listed}>"
                )
        texts = [self.number(k) for k in nodes]
        if not any(text.startswith("%") for text in texts):
            return Writer.constants(texts + texts[-1:] * (LANES - len(texts)))
        if len(set(texts)) == 1:
            first = self.scalar.new(f"insertelement {real} poison, double {texts[0]}, i32 0")
            return self.scalar.new(
                f"shufflevector {real} {first}, {real} poison, <{LANES} x i32> zeroinitializer"
            )
        vector = "poison"
        for lane, text in enumerate(texts):
            vector = self.scalar.new(f"insertelement {real} {vector}, double {text}, i32 {lane}")
        return vector


def point(name: str, program: Program, rows: Sequence[int]) -> str:
    """Return a function ``void name(double t, double *x, double *p, double *out)``.

    Args:
        name: of the function.
        program: of (t, x, p), with one output.
        rows: where in `out` its nonzero entries go.

    Raises:
        NotImplementedError: an instruction cannot be compiled.
    """
    body = _Point(program)
    for _, entry, k in program.results:
        value, target = body.number(k), body.scalar.new(f"getelementptr double, ptr %out, i64 {rows[entry]}")
        body.scalar.lines.append(f"  store double {value}, ptr {target}")
    head = f"define void @{name}(double %t, ptr noalias %x, ptr noalias %p, ptr noalias %out) {{"
    return "\n".join([head, *body.scalar.lines, "  ret void", "}"])


def column(name: str, program: Program, rows: Sequence[int]) -> str:
    """Return a function ``void name(i64 blocks, i64 stride, double *t, double *x, double *p, double *out)``.

    Args:
        name: of the function; it evaluates ``blocks`` times `LANES` samples. State i begins at
            ``x + i stride``, output row r at ``out + r stride``.
        program: of (t, x, p), with one output.
        rows: where in `out` its nonzero entries go.

    Raises:
        NotImplementedError: an instruction cannot be compiled.
    """
    numbers = count()
    invariant, varying = Writer(LANES, numbers=numbers), Writer(LANES, numbers=numbers)
    fixed: list[bool] = []
    value: list[str] = []
    for node in program.nodes:
        same = node.place[0] == 2 if node.op == ca.OP_INPUT else all(fixed[o] for o in node.operands)
        fixed.append(same)
        w = invariant if same else varying
        if node.op == ca.OP_CONST:
            value.append(w.constant(node.value))
        elif node.op == ca.OP_INPUT:
            value.append(_column_load(w, node))
        else:
            value.append(operation(w, node.op, [value[o] for o in node.operands]))
    for _, entry, k in program.results:
        row = varying.new(f"mul i64 %stride, {rows[entry]}")
        start = varying.new(f"getelementptr double, ptr %out, i64 {row}")
        target = varying.new(f"getelementptr double, ptr {start}, i64 %at")
        varying.lines.append(f"  store {varying.real} {value[k]}, ptr {target}, align 8")
    head = (
        f"define void @{name}(i64 %blocks, i64 %stride, ptr noalias %t, ptr noalias %x, "
        "ptr noalias %p, ptr noalias %out) {"
    )
    return "\n".join([
        head, "entry:", *invariant.lines, f"  %end = mul i64 %blocks, {LANES}", "  br label %loop", "loop:",
        "  %at = phi i64 [0, %entry], [%next, %loop]", *varying.lines,
        f"  %next = add i64 %at, {LANES}", "  %more = icmp slt i64 %next, %end",
        "  br i1 %more, label %loop, label %done", "done:", "  ret void", "}",
    ])  # fmt: skip


def _column_load(w: Writer, node: Node) -> str:
    argument, entry = node.place
    if argument == 2:
        address = w.new(f"getelementptr double, ptr %p, i64 {entry}")
        single = w.new(f"load double, ptr {address}")
        first = w.new(f"insertelement {w.real} poison, double {single}, i32 0")
        return w.new(f"shufflevector {w.real} {first}, {w.real} poison, <{LANES} x i32> zeroinitializer")
    start = "%t"
    if argument == 1:
        row = w.new(f"mul i64 %stride, {entry}")
        start = w.new(f"getelementptr double, ptr %x, i64 {row}")
    address = w.new(f"getelementptr double, ptr {start}, i64 %at")
    return w.new(f"load {w.real}, ptr {address}, align 8")


def declarations(*, functions: bool = True) -> str:
    """Return declarations of external functions, for the head of a module.

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
        known = (("sqrt", 1), ("fabs", 1), ("floor", 1), ("ceil", 1), ("copysign", 2), ("fmuladd", 3))
        outside = [(f"llvm.{name}.{kind}", arity) for name, arity in known]
        if functions:
            outside += [(symbol(name, lanes), arity) for name, (_, arity) in ELEMENTARY.items()]
        texts += [f"declare {w.real} @{name}({', '.join([w.real] * arity)})" for name, arity in outside]
    return "\n".join(texts) + "\n"
