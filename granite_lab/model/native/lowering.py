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
        self.one = Writer()
        self.all = Writer(LANES, self.one.lines, self.one.numbers)  # both fill one function
        self.values: dict[int, str] = {}  # node to number
        self.vectors: dict[int, str] = {}  # group to vector
        for g, group in enumerate(self.groups):
            self.write(g, group)

    def write(self, g: int, group: list[int]) -> None:
        """Write what one operation gives, for one node or for all of a group."""
        first, node = group[0], self.program.nodes[group[0]]
        if node.op == ca.OP_CONST:
            self.values[first] = self.one.constant(node.value)
        elif node.op == ca.OP_INPUT:
            self.values[first] = self.load(node)
        elif len(group) == 1:
            self.values[first] = operation(self.one, node.op, [self.number(o) for o in node.operands])
        else:
            columns = zip(*(self.program.nodes[k].operands for k in group), strict=True)
            self.vectors[g] = operation(self.all, node.op, [self.gather(column) for column in columns])

    def load(self, node: Node) -> str:
        argument, entry = node.place
        if argument == 0:
            return "%t"
        place = self.one.new(f"getelementptr double, ptr %{'_xp'[argument]}, i64 {entry}")
        return self.one.new(f"load double, ptr {place}")

    def number(self, k: int) -> str:
        """Return a node as a number."""
        if k not in self.values:
            g, lane = self.lane[k]
            self.values[k] = self.one.new(f"extractelement {self.all.real} {self.vectors[g]}, i32 {lane}")
        return self.values[k]

    def gather(self, nodes: Sequence[int]) -> str:
        """Return nodes as the lanes of a vector."""
        real = self.all.real
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
                return self.one.new(
                    f"shufflevector {real} {vectors[0]}, {real} {vectors[-1]}, <{LANES} x i32> <{listed}>"
                )
        texts = [self.number(k) for k in nodes]
        if not any(text.startswith("%") for text in texts):
            return Writer.constants(texts + texts[-1:] * (LANES - len(texts)))
        if len(set(texts)) == 1:
            first = self.one.new(f"insertelement {real} poison, double {texts[0]}, i32 0")
            return self.one.new(
                f"shufflevector {real} {first}, {real} poison, <{LANES} x i32> zeroinitializer"
            )
        vector = "poison"
        for lane, text in enumerate(texts):
            vector = self.one.new(f"insertelement {real} {vector}, double {text}, i32 {lane}")
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
        value, target = body.number(k), body.one.new(f"getelementptr double, ptr %out, i64 {rows[entry]}")
        body.one.lines.append(f"  store double {value}, ptr {target}")
    head = f"define void @{name}(double %t, ptr noalias %x, ptr noalias %p, ptr noalias %out) {{"
    return "\n".join([head, *body.one.lines, "  ret void", "}"])


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
    still, moving = Writer(LANES, numbers=numbers), Writer(LANES, numbers=numbers)
    fixed: list[bool] = []
    value: list[str] = []
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
