"""The integrator, run as plain Python on equations with known solutions."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.model.native import rosenbrock
from granite_lab.model.native.translate import Equations, Floats

STIFF = 1e4


def forced(t: float, x: Floats, p: Floats, out: Floats) -> None:
    """x0' = -k (x0 - cos t) - sin t, solved by cos t; x1' = -x0 x1, solved by exp(-sin t)."""
    out[0] = -p[0] * (x[0] - np.cos(t)) - np.sin(t)
    out[1] = -x[0] * x[1]


def forced_slopes(t: float, x: Floats, p: Floats, out: Floats) -> None:
    out[0], out[1], out[2], out[3] = -p[0], -x[1], 0.0, -x[0]
    out[4], out[5] = -p[0] * np.sin(t) - np.cos(t), 0.0
    forced(t, x, p, out[6:])


def run(
    rates: Equations,
    slopes: Equations,
    t: Floats,
    start: list[float],
    *,
    k: float = STIFF,
    tolerance: float = 1e-6,
) -> tuple[int, Floats]:
    n, out = len(start), np.full((len(start), t.size), np.nan)
    status = rosenbrock.run(
        n, rates, slopes, np.array([t[-1]]), 1, np.append(t, np.inf), t.size, np.array(start), np.array([k]),
        tolerance, tolerance, 2000, rosenbrock.TABLE, np.zeros(rosenbrock.work_size(n)), out.ravel(),
    )  # fmt: skip
    return status, out


@pytest.mark.parametrize("k", [1.0, STIFF])
def test_errors_are_of_the_size_of_the_tolerance_also_between_the_steps(k: float) -> None:
    t = np.linspace(0, 5, 301)
    for tolerance, most in ((1e-4, 60), (1e-7, 300)):
        steps, x = run(forced, forced_slopes, t, [1.0, 1.0], k=k, tolerance=tolerance)
        assert 0 < steps < most
        # between the steps the polynomial follows a fast state less closely than the steps do
        assert np.abs(x[0] - np.cos(t)).max() < (10 if k == 1 else 50) * tolerance
        assert np.abs(x[1] - np.exp(-np.sin(t))).max() < 10 * tolerance
        assert np.abs(x[:, -1] - [np.cos(5), np.exp(-np.sin(5))]).max() < 3 * tolerance


def test_halved_steps_cut_the_error_by_sixteen_and_between_the_steps_by_sixteen_too() -> None:
    """Order 4 at the ends of the steps; the polynomial of order 3 has a local error of order 4."""
    worst, last, p, table = [], [], np.ones(1), rosenbrock.TABLE
    for count in (8, 16, 32):
        h, y, errors = 2 / count, np.ones(2), []
        jacobian, w, u, at, inside = np.zeros(8), np.zeros(8), np.zeros(12), np.zeros(2), np.zeros(2)
        for now in h * np.arange(count):
            forced_slopes(now, y, p, jacobian)
            rosenbrock.step(2, forced, now, h, y, p, 1.0, 1.0, table, jacobian, w, u, at)
            for part in (0.25, 0.5, 0.75, 1.0):
                rosenbrock.between(2, part, y, at, table, u, inside, 1)
                t = now + part * h
                errors.append(np.hypot(inside[0] - np.cos(t), inside[1] - np.exp(-np.sin(t))))
            y = at.copy()
        worst.append(np.sqrt(np.mean(np.square(errors))))
        last.append(errors[-1])
    for errors in (worst, last):
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        assert (orders > 3.6).all(), (errors, orders)


def test_what_cannot_be_integrated_ends_with_a_reason() -> None:
    t = np.linspace(0, 2, 11)

    def explodes(_t: float, x: Floats, _p: Floats, out: Floats) -> None:
        out[0] = x[0] ** 2  # infinite at t = 1

    def explodes_slopes(_t: float, x: Floats, _p: Floats, out: Floats) -> None:
        out[0], out[1], out[2] = 2 * x[0], 0.0, x[0] ** 2

    with np.errstate(all="ignore"):
        status, x = run(explodes, explodes_slopes, t, [1.0])
        assert status in (rosenbrock.TOO_SMALL, rosenbrock.TOO_MANY, rosenbrock.NO_NUMBER)
        np.testing.assert_allclose(x[0, :4], 1 / (1 - t[:4]), rtol=1e-4)

        def nothing(_t: float, _x: Floats, _p: Floats, out: Floats) -> None:
            out[:] = np.nan

        assert run(nothing, nothing, t, [1.0])[0] == rosenbrock.NO_NUMBER


def test_a_matrix_is_factored_with_exchanges_and_a_singular_one_is_told() -> None:
    rng = np.random.default_rng(0)
    for n in (1, 3, 12):
        a, b = rng.normal(size=(n, n)), rng.normal(size=n)
        a[0, 0] = 0.0 if n > 1 else 2.0
        w, pivots, x = a.T.ravel().copy(), np.zeros(n), b.copy()
        assert rosenbrock.factor(n, w, pivots) == 1
        rosenbrock.solve(n, w, pivots, x)
        np.testing.assert_allclose(a @ x, b, atol=1e-10)
    assert rosenbrock.factor(2, np.ones(4), np.zeros(2)) == 0
