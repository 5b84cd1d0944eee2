"""A small part of Python as LLVM's text: loops and arithmetic on numbers and arrays of numbers.

An algorithm stays readable and can be run as plain Python, on NumPy arrays, too. Allowed are
functions with annotated arguments (`int`, `float`, `Floats`, `Equations`), assignments, `while`,
`for … in range(…)`, `if`, `return` of a value, arithmetic, comparisons, `and`, `not`, `min`, `max`, `abs`,
`int`, `sqrt`, `power`, `a[k]`, `a[k:]` and calls of other functions of the same kind. Both sides of `and`
are evaluated.
"""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from granite_lab.model.native.writer import number, symbol

Floats = npt.NDArray[np.float64]
"""An array; in the machine code a pointer."""

Equations = Callable[[float, Floats, Floats, Floats], None]
"""A function of (t, x, p, out)."""

sqrt = math.sqrt


def power(a: float, b: float) -> float:
    """Return a^b for a > 0."""
    return float(a**b)


_KINDS = {"int": "i64", "float": "double", "Floats": "ptr", "Equations": "ptr", "None": "void"}
_FLOAT = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
_INTEGER = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
_RELATION = {
    ast.Lt: ("olt", "slt"), ast.LtE: ("ole", "sle"), ast.Gt: ("ogt", "sgt"), ast.GtE: ("oge", "sge"),
    ast.Eq: ("oeq", "eq"), ast.NotEq: ("une", "ne"),
}  # fmt: skip
Value = tuple[str, str]
"""Type and name."""


class _Function:
    def __init__(
        self, tree: ast.FunctionDef, signatures: dict[str, tuple[str, list[str]]], numbers: dict[str, Any]
    ) -> None:
        self.signatures, self.numbers = signatures, numbers
        self.lines: list[str] = []
        self.places: dict[str, str] = {}  # variable to type
        self.count = 0
        self.closed = False
        self.equations = {a.arg for a in tree.args.args if ast.unparse(a.annotation or tree) == "Equations"}
        self.result, kinds = signatures[tree.name]
        names = [a.arg for a in tree.args.args]
        for kind, name in zip(kinds, names, strict=True):
            self.places[name] = kind
            self.lines.append(f"  store {kind} %{name}, ptr %{name}.at")
        for statement in tree.body:
            self.statement(statement)
        if not self.closed:
            self.lines.append("  ret void" if self.result == "void" else "  unreachable")
        listed = ", ".join(f"{kind} %{name}" for kind, name in zip(kinds, names, strict=True))
        slots = [f"  %{name}.at = alloca {kind}" for name, kind in self.places.items()]
        self.text = "\n".join([f"define {self.result} @{tree.name}({listed}) {{", *slots, *self.lines, "}"])

    def new(self, kind: str, text: str) -> Value:
        self.count += 1
        self.lines.append(f"  %r{self.count} = {text}")
        return kind, f"%r{self.count}"

    def label(self) -> str:
        self.count += 1
        return f"l{self.count}"

    def go(self, text: str) -> None:
        if not self.closed:
            self.lines.append(f"  {text}")
        self.closed = True

    def block(self, label: str) -> None:
        self.lines.append(f"{label}:")
        self.closed = False

    def real(self, value: Value) -> str:
        kind, name = value
        return name if kind == "double" else self.new("double", f"sitofp i64 {name} to double")[1]

    def statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Expr(value=ast.Constant()):
                pass
            case ast.Expr(value=ast.Call() as call):
                self.expression(call)
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                self.assign(name, self.expression(value))
            case ast.Assign(targets=[ast.Subscript() as target], value=value):
                result = self.real(self.expression(value))
                self.lines.append(f"  store double {result}, ptr {self.address(target)}")
            case ast.If(test=test, body=body, orelse=orelse):
                then, other, after = self.label(), self.label(), self.label()
                self.go(f"br i1 {self.condition(test)}, label %{then}, label %{other}")
                for label, part in ((then, body), (other, orelse)):
                    self.block(label)
                    for inner in part:
                        self.statement(inner)
                    self.go(f"br label %{after}")
                self.block(after)
            case ast.While(test=test, body=body):
                self.loop(test, body, [])
            case ast.For(target=ast.Name(id=name), iter=ast.Call(args=bounds), body=body):
                low, high = (ast.Constant(value=0), bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
                self.assign(name, self.expression(low))
                here = ast.Name(id=name)
                step = ast.Assign(
                    targets=[here], value=ast.BinOp(left=here, op=ast.Add(), right=ast.Constant(value=1))
                )
                self.loop(ast.Compare(left=here, ops=[ast.Lt()], comparators=[high]), body, [step])
            case ast.Return(value=ast.expr() as value):
                kind, name = self.expression(value)
                self.go(f"ret {kind} {name}")
            case _:
                raise NotImplementedError(ast.unparse(node))

    def loop(self, test: ast.expr, body: list[ast.stmt], after: list[ast.stmt]) -> None:
        head, inside, end = self.label(), self.label(), self.label()
        self.go(f"br label %{head}")
        self.block(head)
        self.go(f"br i1 {self.condition(test)}, label %{inside}, label %{end}")
        self.block(inside)
        for inner in body + after:
            self.statement(inner)
        self.go(f"br label %{head}")
        self.block(end)

    def assign(self, name: str, value: Value) -> None:
        kind = self.places.setdefault(name, value[0])
        result = self.real(value) if kind == "double" else value[1]
        self.lines.append(f"  store {kind} {result}, ptr %{name}.at")

    def address(self, node: ast.Subscript) -> str:
        base, index = self.expression(node.value)[1], node.slice
        if isinstance(index, ast.Slice):
            assert index.lower is not None
            index = index.lower
        return self.new("ptr", f"getelementptr double, ptr {base}, i64 {self.expression(index)[1]}")[1]

    def condition(self, node: ast.expr) -> str:
        match node:
            case ast.Compare(left=left, ops=[relation], comparators=[right]):
                a, b = self.expression(left), self.expression(right)
                words = _RELATION[type(relation)]
                if a[0] == b[0] == "i64":
                    return self.new("i1", f"icmp {words[1]} i64 {a[1]}, {b[1]}")[1]
                return self.new("i1", f"fcmp {words[0]} double {self.real(a)}, {self.real(b)}")[1]
            case ast.BoolOp(op=ast.And(), values=values):
                total = self.condition(values[0])
                for value in values[1:]:
                    total = self.new("i1", f"and i1 {total}, {self.condition(value)}")[1]
                return total
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self.new("i1", f"xor i1 {self.condition(operand)}, true")[1]
        raise NotImplementedError(ast.unparse(node))

    def expression(self, node: ast.expr) -> Value:  # noqa: PLR0911, one for each kind of expression
        match node:
            case ast.Constant(value=bool() | str()):
                pass
            case ast.Constant(value=int() as value):
                return "i64", str(value)
            case ast.Constant(value=float() as value):
                return "double", number(value)
            case ast.Name(id=name) if name in self.places:
                kind = self.places[name]
                return self.new(kind, f"load {kind}, ptr %{name}.at")
            case ast.Name(id=name):
                return self.expression(ast.Constant(value=self.numbers[name]))
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
                return self.expression(ast.Constant(value=-value))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self.new("double", f"fneg double {self.real(self.expression(operand))}")
            case ast.BinOp(left=left, op=op, right=right):
                a, b = self.expression(left), self.expression(right)
                if a[0] == b[0] == "i64" and type(op) in _INTEGER:
                    return self.new("i64", f"{_INTEGER[type(op)]} i64 {a[1]}, {b[1]}")
                return self.new(
                    "double", f"{_FLOAT[type(op)]} contract double {self.real(a)}, {self.real(b)}"
                )
            case ast.IfExp(test=test, body=body, orelse=orelse):
                where, yes, no = self.condition(test), self.expression(body), self.expression(orelse)
                kind = "i64" if yes[0] == no[0] == "i64" else "double"
                names = (yes[1], no[1]) if kind == "i64" else (self.real(yes), self.real(no))
                return self.new(kind, f"select i1 {where}, {kind} {names[0]}, {kind} {names[1]}")
            case ast.Subscript(slice=ast.Slice()):
                return "ptr", self.address(node)
            case ast.Subscript():
                return self.new("double", f"load double, ptr {self.address(node)}")
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return self.call(name, [self.expression(a) for a in arguments])
        raise NotImplementedError(ast.unparse(node))

    def call(self, name: str, arguments: list[Value]) -> Value:
        intrinsics = {
            "sqrt": "llvm.sqrt.f64",
            "abs": "llvm.fabs.f64",
            "min": "llvm.minnum.f64",
            "max": "llvm.maxnum.f64",
        }
        if name in intrinsics or name == "power":
            listed = ", ".join(f"double {self.real(a)}" for a in arguments)
            return self.new("double", f"call double @{intrinsics.get(name, symbol('pow', 0))}({listed})")
        if name == "int":
            return self.new("i64", f"fptosi double {arguments[0][1]} to i64")
        if name in self.equations:
            function = self.expression(ast.Name(id=name))[1]
            kinds = ["double", "ptr", "ptr", "ptr"]
            result = "void"
        else:
            function = f"@{name}"
            result, kinds = self.signatures[name]
        values = [
            self.real(v) if kind == "double" else v[1] for kind, v in zip(kinds, arguments, strict=True)
        ]
        listed = ", ".join(f"{kind} {value}" for kind, value in zip(kinds, values, strict=True))
        if result == "void":
            self.lines.append(f"  call void {function}({listed})")
            return "void", ""
        return self.new(result, f"call {result} {function}({listed})")


def translate(*functions: Callable[..., Any]) -> str:
    """Return functions as LLVM's text; each may call those before it.

    Raises:
        NotImplementedError: something beyond the small part of Python that is understood.
    """
    signatures: dict[str, tuple[str, list[str]]] = {}
    texts = []
    for function in functions:
        tree = ast.parse(inspect.getsource(function)).body[0]
        assert isinstance(tree, ast.FunctionDef)
        assert tree.returns is not None
        kinds = [_KINDS[ast.unparse(a.annotation)] for a in tree.args.args if a.annotation is not None]
        signatures[tree.name] = _KINDS[ast.unparse(tree.returns)], kinds
        texts.append(_Function(tree, signatures, function.__globals__).text)
    heads = [f"declare double @llvm.{n}.f64(double, double)" for n in ("minnum", "maxnum")]
    return "\n".join([*heads, *texts])
