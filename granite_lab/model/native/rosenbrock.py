"""A stiff integrator: the Rosenbrock method RODASP2, stiffly accurate, of order 4, estimate of order 3.

Sources: Steinebach, Improvement of Rosenbrock-Wanner method RODASP, in Progress in Differential-
Algebraic Equations II, Springer 2020, 165-184 (coefficients: it keeps its order where a part is all
but rigid, as gears without play are); Hairer and Wanner, Solving Ordinary Differential Equations II,
2nd ed., Springer 1996, section IV.7 and for the dense output VI.4. Without multiplications by the
Jacobian J each stage u_i solves

    (I/(h γ) − J) u_i = f(t + α_i h, y + Σ a_ij u_j) + Σ (c_ij / h) u_j + γ_i h ∂f/∂t

The functions are written in what `granite_lab.model.native.translate` understands; matrices are
stored by columns.
"""

from __future__ import annotations

import numpy as np

from granite_lab.model.native.translate import Equations, Floats, power, sqrt

GAMMA = 0.25
A = (
    (3.0,),
    (0.906377755268814, -0.189707390391685),
    (3.758617027739064, 1.161741776019525, -0.849258085312803),
    (7.089566927282776, 4.573591406461604, -8.423496976860259, -0.959280113459775),
)
"""a_ij of the stages 2 to 5. Stage 6 starts where stage 5 did, plus u_5; plus u_6 that is the result."""

C = (
    (-12.0,),
    (-6.354581592719008, 0.338972550544623),
    (-8.575016317114033, -7.606483992117508, 12.22499765012482),
    (-5.888975457523102, -8.157396617841821, 24.805546872612922, 12.790401512796979),
    (-4.408651676063871, -6.692003137674639, 24.625568527593117, 16.627521966636085, -5.714285714285718),
)
ALPHA = (0.0, 0.75, 0.321448134013046, 0.519745732277726, 1.0, 1.0)
TIMES = (0.25, -0.5, -0.189532918363016, 0.085612108792769, 0.0, 0.0)
"""γ_i, the weights of ∂f/∂t."""

DENSE = (
    (-5.323528268423303, -10.042123754867493, 17.175254928256965, -5.079931171878093, -0.016185991706112),
    (6.984505741529879, 6.914061169603662, -0.849178943070653, 18.104410789349338, -3.516963011559032),
)

TABLE: Floats = np.zeros(84)
"""a_ij, c_ij as 6 rows of 5 each, α_i, γ_i, the two rows of the dense output, and 1."""
for _i, _row in enumerate(A):
    TABLE[5 * (_i + 1) : 5 * (_i + 1) + len(_row)] = _row
for _i, _row in enumerate(C):
    TABLE[30 + 5 * (_i + 1) : 30 + 5 * (_i + 1) + len(_row)] = _row
TABLE[60:66], TABLE[66:72], TABLE[72:77], TABLE[77:82] = ALPHA, TIMES, *DENSE
TABLE[82] = 1.0

TOO_MANY, TOO_SMALL, NO_NUMBER = -1, -2, -3
"""Reasons to give up: the number of steps, their size, or a right-hand side that is not a number."""

LEAST_STEP = 1e-11
"""Shortest step [s]."""

HOPELESS = 1e30
"""Error of a step whose equations have no solution."""

AFTER = 1e-9
"""The next piece begins so much after a corner [s], where derivatives in time are those of the next piece."""

FIRST = 1e-4
"""First step of a run, and after a jump of the equations [s]."""


N, SAMPLES, PIECES, RELATIVE, ABSOLUTE, MOST, NOW, END = range(8)
SAMPLE, STEPS, STRIDE, SMOOTH, NEXT, REPEATS, TAKEN, COEFFICIENTS = range(8, 16)
"""Places in the record of a run, which is an array because the machine code knows no other record: numbers of
states, of instants and of pieces, tolerances, most steps; where the run is: t and end of the piece [s],
instants written, steps tried; how far apart the parameters of the pieces are, 0 where all have the same;
1 where the equations do not jump from piece to piece, else 0; the next step [s]; 1 where the run repeats the
steps of another one, else 0; steps taken; and behind them `TABLE` and the steps."""

LENGTHS = COEFFICIENTS + TABLE.size
"""Place of the steps in the record, each as a share of its piece."""


def record(
    sizes: tuple[int, int, int],
    tolerances: tuple[float, float],
    most: int,
    stride: int = 0,
    smooth: bool = False,
    steps: Floats | None = None,
) -> Floats:
    """Return the record of a run that has not begun.

    Args:
        sizes: how many states, instants of the output, and pieces of the interval, each between two corners
            of the equations.
        tolerances: relative, absolute.
        most: steps, rejected ones included.
        stride: from the parameters of one piece to those of the next; 0 where all have the same.
        smooth: the equations do not jump from piece to piece, so that the step is kept.
        steps: of another run with as many pieces, see `taken`, to be repeated whatever their errors are.
    """
    repeats = steps is not None
    head = (*sizes, *tolerances, most, 0.0, 0.0, 0.0, 0.0, stride, smooth, FIRST, repeats, 0.0)
    return np.concatenate([np.array(head), TABLE, np.empty(most) if steps is None else steps])


def taken(run: Floats) -> Floats:
    """Return the steps of a run that has ended, each as a share of its piece."""
    return run[LENGTHS : LENGTHS + int(run[TAKEN])].copy()


def work_space(start: Floats) -> Floats:
    """Return the work space of a run from a state (n,).

    It holds, one behind the other, the state, the next one, six stages, J by columns, ∂f/∂t, f, the matrix of
    the linear equations, its row exchanges and a rate.
    """
    n = start.size
    return np.concatenate([start, np.zeros(2 * n * n + 11 * n)])


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


def combine(n: int, stages: int, scale: float, weights: Floats, u: Floats, total: Floats) -> None:
    """Add some stages with their weights to a total."""
    for j in range(stages):
        share = scale * weights[j]
        for i in range(n):
            total[i] = total[i] + share * u[n * j + i]


def factored(h: float, run: Floats, work: Floats) -> int:
    """Split I/(h γ) − J; return 0 where it is singular."""
    n = int(run[N])
    jacobian = work[8 * n :]
    w = work[n * n + 10 * n :]
    for k in range(n * n):
        w[k] = -jacobian[k]
    for k in range(n):
        w[k + n * k] = w[k + n * k] + 1.0 / (GAMMA * h)
    return factor(n, w, w[n * n :])


def stages(rates: Equations, h: float, run: Floats, p: Floats, work: Floats) -> None:
    """Write the six stages of a step, and the state at which the last one was evaluated."""
    n = int(run[N])
    table = run[COEFFICIENTS:]
    y = work[0:]
    at = work[n:]
    u = work[2 * n :]
    ft = work[n * n + 8 * n :]
    w = work[n * n + 10 * n :]
    g = work[2 * n * n + 11 * n :]
    for i in range(n):
        g[i] = ft[n + i]  # f
    for stage in range(6):
        if stage > 0:
            if stage < 5:
                for i in range(n):
                    at[i] = y[i]
                combine(n, stage, 1.0, table[5 * stage :], u, at)
            else:
                combine(n, 1, 1.0, table[82:], u[4 * n :], at)
            rates(run[NOW] + table[60 + stage] * h, at, p, g)
        part = u[n * stage :]
        slope = h * table[66 + stage]
        for i in range(n):
            part[i] = g[i] + slope * ft[i]
        combine(n, stage, 1.0 / h, table[30 + 5 * stage :], u, part)
        solve(n, w, w[n * n :], part)


def step(rates: Equations, h: float, run: Floats, p: Floats, work: Floats) -> float:
    """Try a step; leave stages and new state in the work space, return its error against the tolerances.

    Args:
        rates: f.
        h: the step [s].
        run: of `record`.
        p: parameters.
        work: of `work_space`, with J, ∂f/∂t and f at the state.
    """
    n = int(run[N])
    y = work[0:]
    at = work[n:]
    last = work[7 * n :]
    if factored(h, run, work) == 0:
        return HOPELESS
    stages(rates, h, run, p, work)
    error = 0.0
    for i in range(n):
        at[i] = at[i] + last[i]
        scaled = last[i] / (run[ABSOLUTE] + run[RELATIVE] * max(abs(y[i]), abs(at[i])))
        error = error + scaled * scaled
    error = sqrt(error / n)
    if error < HOPELESS:
        return max(error, 1e-9)
    return HOPELESS


def between(part: float, run: Floats, work: Floats, out: Floats) -> None:
    """Write the state a part of the last step on, by the method's polynomial of order 3."""
    n = int(run[N])
    samples = int(run[SAMPLES])
    table = run[COEFFICIENTS:]
    after = work[n:]
    u = work[2 * n :]
    left = 1.0 - part
    for i in range(n):
        a = 0.0
        b = 0.0
        for j in range(5):
            a = a + table[72 + j] * u[n * j + i]
            b = b + table[77 + j] * u[n * j + i]
        out[samples * i] = work[i] * left + part * (after[i] + left * (a + part * b))


def accept(h: float, run: Floats, t: Floats, work: Floats, out: Floats) -> None:
    """Take the step that was tried: write the instants within it, and go on."""
    n = int(run[N])
    after = run[NOW] + h
    if run[END] - after < 1e-12:
        after = run[END]
    sample = int(run[SAMPLE])
    while t[sample] <= after:
        between((t[sample] - run[NOW]) / h, run, work, out[sample:])
        sample = sample + 1
    run[SAMPLE] = sample
    for i in range(n):
        work[i] = work[n + i]
    run[NOW] = after


def piece(
    rates: Equations, slopes: Equations, run: Floats, t: Floats, p: Floats, work: Floats, out: Floats
) -> int:
    """Integrate to the end of a piece; arguments and result are those of `integrate`."""
    jacobian = work[8 * int(run[N]) :]
    lengths = run[LENGTHS:]
    length = run[END] - run[NOW]
    repeats = run[REPEATS]
    h = max(FIRST, run[SMOOTH] * run[NEXT])
    last_h = 0.0
    last_error = 1.0
    rejected = 1
    slopes(run[NOW], work, p, jacobian)
    while run[NOW] < run[END]:
        run[STEPS] = run[STEPS] + 1.0
        if run[STEPS] > run[MOST]:
            return TOO_MANY
        run[NEXT] = h
        if repeats > 0.0:
            h = length * lengths[int(run[TAKEN])]
        elif run[NOW] + 1.001 * h >= run[END]:
            h = run[END] - run[NOW]
        error = step(rates, h, run, p, work)
        if repeats > 0.0:
            if error >= HOPELESS:
                return NO_NUMBER
            error = min(error, 1.0)
        grow = 0.9 * power(error, -0.25)
        if error <= 1.0:
            # the next error as the last two lead to expect it
            if last_h > 0.0:
                grow = min(grow, grow * (h / last_h) * power(last_error / error, 0.25))
            grow = max(0.2, min(grow, 1.0 if rejected == 1 and last_h > 0.0 else 6.0))
            accept(h, run, t, work, out)
            lengths[int(run[TAKEN])] = h / length
            run[TAKEN] = run[TAKEN] + 1.0
            last_h = h
            last_error = max(error, 1e-2)
            rejected = 0
            if run[NOW] < run[END]:
                slopes(run[NOW], work, p, jacobian)
        else:
            grow = max(0.1, min(grow, 0.9))
            rejected = 1
            if h < LEAST_STEP:
                return TOO_SMALL if error < HOPELESS else NO_NUMBER
        h = h * grow
    return int(run[STEPS])


def integrate(
    rates: Equations, slopes: Equations, run: Floats, t: Floats, p: Floats, work: Floats, out: Floats
) -> int:
    """Integrate, anew from each corner on.

    Args:
        rates: f.
        slopes: J, by columns, behind it ∂f/∂t, and f; zeros of J need not be written.
        run: of `record`.
        t: instants of the output [s], the first of which is the start; infinity; corners of the equations
            within the interval, in order, and its end.
        p: parameters, piece by piece where they differ.
        work: of `work_space`; the last state is left in it.
        out: (n, samples) states.

    Returns:
        number of steps, or why it gave up.
    """
    n = int(run[N])
    samples = int(run[SAMPLES])
    ends = t[samples + 1 :]
    for i in range(n):
        out[samples * i] = work[i]
    run[NOW] = t[0]
    run[SAMPLE] = 1.0
    for k in range(int(run[PIECES])):
        if k > 0:
            run[NOW] = run[NOW] + AFTER
        run[END] = ends[k]
        status = piece(rates, slopes, run, t, p[k * int(run[STRIDE]) :], work, out)
        if status < 0:
            return status
    return int(run[STEPS])


ROUTINES = (factor, solve, combine, factored, stages, step, between, accept, piece, integrate)
"""All functions, each before those that call it."""
