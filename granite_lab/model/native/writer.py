"""LLVM's text for arithmetic on numbers or on vectors of numbers, elementary functions included.

The C library knows `exp`, `sin` and the like for one number only. Here they are written with
arithmetic, so that they work on all lanes at once; errors are some units in the last place.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import count


def symbol(name: str, lanes: int) -> str:
    """Return the name of one of `ELEMENTARY` among all symbols of a process."""
    return f"granite_{name}_{lanes}"


def number(value: float) -> str:
    """Return a constant as LLVM reads it, to the last bit."""
    return "0x" + struct.pack(">d", value).hex().upper()


@dataclass
class Writer:
    """Writes instructions of one function, each working on `lanes` numbers (0: no vector).

    Attributes:
        lanes: of every value; 0 for plain numbers.
        lines: the instructions so far; two writers may share them, and the numbers of their results.
        numbers: of results to come.
    """

    lanes: int = 0
    lines: list[str] = field(default_factory=list)
    numbers: Iterator[int] = field(default_factory=count)
    _known: dict[str, str] = field(default_factory=dict)

    @property
    def real(self) -> str:
        """Type of a value."""
        return self.of("double")

    def of(self, plain: str) -> str:
        """Return the type of as many of `plain` as there are lanes."""
        return f"<{self.lanes} x {plain}>" if self.lanes else plain

    def constant(self, value: float | int, plain: str = "double") -> str:
        """Return a constant, the same in all lanes."""
        text = number(value) if plain == "double" else str(int(value))
        return self.constants([text] * self.lanes, plain) if self.lanes else text

    @staticmethod
    def constants(texts: Sequence[str], plain: str = "double") -> str:
        """Return a vector of constants."""
        return "<" + ", ".join(f"{plain} {text}" for text in texts) + ">"

    def new(self, text: str) -> str:
        """Write an instruction and return the name of its result; one that is known is not repeated."""
        if text not in self._known:
            self._known[text] = f"%v{next(self.numbers)}"
            self.lines.append(f"  {self._known[text]} = {text}")
        return self._known[text]

    def arithmetic(self, name: str, a: str, b: str) -> str:
        """Return the result of fadd, fsub, fmul or fdiv, not fused: the same bits at any effort."""
        return self.new(f"{name} {self.real} {a}, {b}")

    def integer(self, name: str, a: str, b: str | int) -> str:
        """Return the result of an operation on integers."""
        other = b if isinstance(b, str) else self.constant(b, "i64")
        return self.new(f"{name} {self.of('i64')} {a}, {other}")

    def fma(self, a: str, b: str, c: str) -> str:
        """Return a b + c, by one instruction where the machine has it."""
        return self.call("fmuladd", a, b, c)

    def call(self, name: str, *arguments: str) -> str:
        """Return the result of one of LLVM's own functions."""
        kind = f"v{self.lanes}f64" if self.lanes else "f64"
        listed = ", ".join(f"{self.real} {a}" for a in arguments)
        return self.new(f"call {self.real} @llvm.{name}.{kind}({listed})")

    def compare(self, relation: str, a: str, b: str) -> str:
        """Return where a relation holds; `ole` and the like, `une` for unequal or not a number."""
        return self.new(f"fcmp {relation} {self.real} {a}, {b}")

    def select(self, where: str, a: str, b: str) -> str:
        """Return a where a condition holds, otherwise b."""
        return self.new(f"select {self.of('i1')} {where}, {self.real} {a}, {self.real} {b}")

    def truth(self, where: str) -> str:
        """Return 1 where a condition holds, otherwise 0."""
        return self.select(where, self.constant(1.0), self.constant(0.0))

    def bits(self, a: str) -> str:
        """Return the bits of a number as an integer."""
        return self.new(f"bitcast {self.real} {a} to {self.of('i64')}")

    def from_bits(self, a: str) -> str:
        """Return the number of which these are the bits."""
        return self.new(f"bitcast {self.of('i64')} {a} to {self.real}")

    def polynomial(self, x: str, coefficients: Sequence[float]) -> str:
        """Return a polynomial by Horner's scheme, the constant term first."""
        total = self.constant(coefficients[-1])
        for c in reversed(coefficients[:-1]):
            total = self.fma(total, x, self.constant(c))
        return total

    def elementary(self, name: str, *arguments: str) -> str:
        """Return the result of one of `ELEMENTARY`, which stand in the module as functions."""
        listed = ", ".join(f"{self.real} {a}" for a in arguments)
        return self.new(f"call {self.real} @{symbol(name, self.lanes)}({listed})")


_SHIFT = 1.5 * 2.0**52
"""Added to a number it leaves the rounded number in the last bits."""


def _rounded(w: Writer, x: str) -> tuple[str, str]:
    """Return x rounded, as a number and as the integer in the bits of x + `_SHIFT`."""
    shifted = w.arithmetic("fadd", x, w.constant(_SHIFT))
    return w.arithmetic("fsub", shifted, w.constant(_SHIFT)), w.bits(shifted)


def _without(w: Writer, x: str, k: str, parts: Sequence[float]) -> str:
    """Return x - k (sum of parts), each part with so few digits that nothing is lost."""
    for part in parts:
        x = w.fma(k, w.constant(-part), x)
    return x


def _split(value: float, rest: float) -> tuple[float, float, float]:
    """Return a number in three parts; the first two have 33 bits. `rest` is what a float cannot hold."""

    def short(x: float) -> float:
        return float(
            struct.unpack(">d", struct.pack(">Q", struct.unpack(">Q", struct.pack(">d", x))[0] & ~0xFFFFF))[0]
        )

    first = short(value)
    second = short(value - first)
    return first, second, value - first - second + rest


_LN2 = _split(math.log(2), 2.3190468138462996e-17)
_HALF_PI = _split(math.pi / 2, 6.123233995736766e-17)


def _exp(w: Writer, x: str) -> str:
    x = w.select(w.compare("ogt", x, w.constant(800.0)), w.constant(800.0), x)
    x = w.select(w.compare("olt", x, w.constant(-800.0)), w.constant(-800.0), x)
    k, raw = _rounded(w, w.arithmetic("fmul", x, w.constant(1 / math.log(2))))
    r = _without(w, x, k, _LN2)
    value = w.polynomial(r, [1 / math.factorial(n) for n in range(14)])
    # 2^k in two factors, for k may be beyond the range of one exponent
    whole = w.integer("sub", raw, struct.unpack(">q", struct.pack(">d", _SHIFT))[0])
    half = w.integer("ashr", whole, 1)
    for part in (half, w.integer("sub", whole, half)):
        value = w.arithmetic("fmul", value, w.from_bits(w.integer("shl", w.integer("add", part, 1023), 52)))
    return value


def _log(w: Writer, x: str) -> str:
    raw = w.bits(x)
    # an exponent counted from sqrt(1/2), so that the rest lies about 1
    offset = struct.unpack(">q", struct.pack(">d", math.sqrt(0.5)))[0]
    above = w.integer("sub", raw, offset)
    k = w.integer("ashr", above, 52)
    m = w.from_bits(w.integer("sub", raw, w.integer("shl", k, 52)))
    exponent = w.new(f"sitofp {w.of('i64')} {k} to {w.real}")
    one = w.constant(1.0)
    f = w.arithmetic("fsub", m, one)
    s = w.arithmetic("fdiv", f, w.arithmetic("fadd", m, one))
    q = w.arithmetic("fmul", s, s)
    rest = w.arithmetic("fmul", w.arithmetic("fmul", s, q), w.polynomial(q, [2 / n for n in range(3, 23, 2)]))
    low = w.fma(exponent, w.constant(_LN2[1] + _LN2[2]), rest)
    value = w.arithmetic("fadd", w.fma(exponent, w.constant(_LN2[0]), w.arithmetic("fadd", s, s)), low)
    value = w.select(w.compare("olt", x, w.constant(2.3e-308)), w.constant(-math.inf), value)
    value = w.select(w.compare("oeq", x, w.constant(math.inf)), x, value)
    invalid = w.compare("ult", x, w.constant(0.0))  # or not a number
    return w.select(invalid, w.constant(math.nan), value)


def _pow(w: Writer, x: str, y: str) -> str:
    """x^y; a negative x needs a whole y."""
    size = w.elementary("exp", w.arithmetic("fmul", y, w.elementary("log", w.call("fabs", x))))
    half = w.arithmetic("fmul", y, w.constant(0.5))
    odd = w.compare("one", w.call("floor", half), half)
    whole = w.compare("oeq", w.call("floor", y), y)
    signed = w.select(odd, w.new(f"fneg {w.real} {size}"), size)
    below = w.select(whole, signed, w.constant(math.nan))
    value = w.select(w.compare("olt", x, w.constant(0.0)), below, size)
    return w.select(w.compare("oeq", y, w.constant(0.0)), w.constant(1.0), value)


def _turned(w: Writer, x: str, quarters: int) -> str:
    """Return sin(x + quarters pi/2)."""
    k, raw = _rounded(w, w.arithmetic("fmul", x, w.constant(2 / math.pi)))
    r = _without(w, x, k, _HALF_PI)
    q = w.arithmetic("fmul", r, r)
    odd = [(-1) ** n / math.factorial(2 * n + 1) for n in range(1, 9)]
    even = [(-1) ** n / math.factorial(2 * n) for n in range(1, 10)]
    sine = w.fma(w.arithmetic("fmul", r, q), w.polynomial(q, odd), r)
    cosine = w.fma(q, w.polynomial(q, even), w.constant(1.0))
    turn = w.integer("add", raw, quarters)
    crossed = w.new(f"icmp ne {w.of('i64')} {w.integer('and', turn, 1)}, {w.constant(0, 'i64')}")
    value = w.select(crossed, cosine, sine)
    sign = w.integer("shl", w.integer("and", turn, 2), 62)
    value = w.from_bits(w.integer("xor", w.bits(value), sign))
    far = w.compare("ult", w.call("fabs", x), w.constant(1e9))  # further out the angle has lost its digits
    return w.select(far, value, w.constant(math.nan))


ELEMENTARY: dict[str, tuple[Callable[..., str], int]] = {
    "exp": (_exp, 1),
    "log": (_log, 1),
    "pow": (_pow, 2),
    "sin": (partial(_turned, quarters=0), 1),
    "cos": (partial(_turned, quarters=1), 1),
}
"""Functions that are written here, and of how many arguments they are."""


def elementary_functions(lanes: int) -> str:
    """Return the functions of `ELEMENTARY` for vectors of so many lanes as LLVM's text."""
    texts = []
    for name, (body, arity) in ELEMENTARY.items():
        w = Writer(lanes)
        arguments = [f"%a{k}" for k in range(arity)]
        result = body(w, *arguments)
        listed = ", ".join(f"{w.real} {a}" for a in arguments)
        texts.append(
            "\n".join(
                [
                    f"define {w.real} @{symbol(name, lanes)}({listed}) {{",
                    *w.lines,
                    f"  ret {w.real} {result}",
                    "}",
                ]
            )
        )
    return "\n".join(texts)
