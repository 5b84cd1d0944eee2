"""Small systems of linear equations, by Gauss with row exchanges; matrices are stored by columns.

The functions are written in what `granite_lab.model.native.translate` understands.
"""

from __future__ import annotations

from granite_lab.model.native.translate import Floats


def factor(n: int, a: Floats, pivots: Floats) -> int:
    """Split a matrix into L and U with row exchanges; return 0 where it is singular."""
    for k in range(n):
        best = k
        size = abs(a[k + n * k])
        for i in range(k + 1, n):
            if abs(a[i + n * k]) > size:
                size = abs(a[i + n * k])
                best = i
        pivots[k] = best
        if not size > 0.0:
            return 0
        if best != k:
            for j in range(n):
                kept = a[k + n * j]
                a[k + n * j] = a[best + n * j]
                a[best + n * j] = kept
        scale = 1.0 / a[k + n * k]
        a[k + n * k] = scale
        for i in range(k + 1, n):
            a[i + n * k] = a[i + n * k] * scale
        for j in range(k + 1, n):
            share = a[k + n * j]
            if share != 0.0:
                for i in range(k + 1, n):
                    a[i + n * j] = a[i + n * j] - a[i + n * k] * share
    return 1


def solve(n: int, a: Floats, pivots: Floats, b: Floats) -> None:
    """Replace b by the solution, with what `factor` left."""
    for k in range(n):
        best = int(pivots[k])
        kept = b[best]
        b[best] = b[k]
        b[k] = kept
    for k in range(n):
        share = b[k]
        if share != 0.0:
            for i in range(k + 1, n):
                b[i] = b[i] - a[i + n * k] * share
    k = n - 1
    while k >= 0:
        share = b[k] * a[k + n * k]
        b[k] = share
        for i in range(k):
            b[i] = b[i] - a[i + n * k] * share
        k = k - 1
