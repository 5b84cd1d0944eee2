"""Machine code gives the numbers of the graph and integrates them; else the graph is interpreted."""

import ctypes
import dataclasses
import os
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from granite_lab.effects import get, library
from granite_lab.errors import EstimateError
from granite_lab.model import Accuracy, engine, interpreted
from granite_lab.model.effect import Effect, EffectParameter, activate
from granite_lab.model.graph import build_graph
from granite_lab.model.native import graphs, lowering, machine, program, rosenbrock
from granite_lab.model.native.translate import Equations, Floats
from granite_lab.model.simulator import integrate, parameter_vector, rest_state
from granite_lab.model.symbols import model_parameters
from granite_lab.parameters import Variant, load_paper, load_robot, load_soil, load_variants, variant_of
from granite_lab.stored import FOLDER
from tests.corpus.cli import succeeded
from tests.soak import in_turn

PAPER = model_parameters(load_robot(), load_soil(), variant_of(0.5), a_theta=4.919)


class Strange(Effect):
    """An effect with an operation that is not compiled."""

    id = "strange"
    title = equation = source = signature = ""
    parameters = (EffectParameter("size", "", "", -1.0, 1.0, 0.0, 0.0, 1.0),)

    def desired_velocity(self, v_desired: Any, v: Any, own: Any) -> Any:
        return v_desired + own.p["size"] * ca.erf(v)


def call(address: int, t: float, *arrays: np.ndarray) -> None:
    kinds = [ctypes.c_double, *[ctypes.c_void_p] * len(arrays)]
    ctypes.CFUNCTYPE(None, *kinds)(address)(t, *(a.ctypes.data for a in arrays))


def over_lanes(expression: Any, x: Any, states: np.ndarray) -> np.ndarray:
    """Compile an expression of x, and evaluate it on columns of samples, a multiple of the lanes."""
    f = ca.Function("f", [ca.SX.sym("t"), x, ca.SX.sym("p")], [expression])
    graphs._routines()
    code = lowering.declarations() + lowering.column("f", program.read(f), list(range(expression.numel())))
    address = machine.Library(machine.compiled(code, effort=0), ["f"]).address["f"]
    samples = states.shape[1]
    found = np.empty((expression.numel(), samples))
    arrays = [np.zeros(samples), states, np.zeros(1), found]
    kinds = [ctypes.c_int64] * 2 + [ctypes.c_void_p] * 4
    ctypes.CFUNCTYPE(None, *kinds)(address)(
        samples // program.LANES, samples, *(z.ctypes.data for z in arrays)
    )
    return found


def near_rest(effects: tuple[Effect, ...], seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    active = [
        activate(e, {q.name: float(rng.uniform(q.prior_low, q.prior_high)) for q in e.parameters})
        for e in effects
    ]
    x = rest_state(PAPER, active)
    away = rng.normal(0, 0.02, x.size) * np.r_[1, 0.05, 0.2, np.ones(x.size - 3)]
    return x + away, parameter_vector(PAPER, active)


@pytest.mark.parametrize("name", ["", *sorted(library())])
def test_rates_and_their_derivatives_are_those_of_the_graph(name: str) -> None:
    effects = (get(name),) if name else ()
    graph = build_graph(effects)
    by_x, by_t = (ca.densify(ca.jacobian(graph.rates, z)) for z in (graph.x, graph.t))
    truth = ca.Function("f", [graph.t, graph.x, graph.p], [ca.densify(graph.rates), by_x, by_t])
    (at_rates, at_slopes), n = graphs.equations(effects).addresses(), graph.x.numel()
    for seed, t in enumerate((-0.5, 0.1, 0.9, 3.0)):
        x, p = near_rest(effects, seed)
        rates, jacobian, by_time = (np.array(part) for part in truth(t, x, p))
        alone, together = np.zeros(n), np.zeros(n * (n + 2))
        call(at_rates, t, x, p, alone)
        call(at_slopes, t, x, p, together)
        scale = np.abs(rates).max()
        np.testing.assert_allclose(alone, rates[:, 0], rtol=1e-9, atol=1e-12 * scale)
        np.testing.assert_allclose(together[n * n + n :], alone, rtol=1e-11, atol=1e-13 * scale)
        got = together[: n * n].reshape(n, n).T
        np.testing.assert_allclose(got, jacobian, rtol=1e-7, atol=1e-11 * np.abs(jacobian).max())
        np.testing.assert_allclose(
            together[n * n : n * n + n], by_time[:, 0], rtol=1e-7, atol=1e-11 * (1 + np.abs(by_time).max())
        )


@pytest.mark.parametrize("names", [(), ("stress_ahead", "multi_pass", "tyre_windup")])
def test_code_that_is_used_often_is_compiled_anew_and_gives_the_same_bits(
    names: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path))
    monkeypatch.setattr(graphs, "OFTEN", 1)
    effects = tuple(get(name) for name in names)
    equations, given = graphs.Equations(effects, "trapezoid"), [near_rest(effects, seed) for seed in range(8)]
    n = given[0][0].size
    results, addresses = [], []
    for _ in range(2):
        addresses.append(equations.addresses())
        results.append(np.zeros((len(given), n * (n + 3))))
        for (x, p), row in zip(given, results[-1], strict=True):
            call(addresses[-1][0], 0.9, x, p, row[:n])
            call(addresses[-1][1], 0.9, x, p, row[n:])
    assert addresses[0] != addresses[1] == equations.addresses()
    assert results[0].tobytes() == results[1].tobytes() != bytes(results[0].nbytes)
    assert graphs.Equations(effects, "trapezoid").addresses()  # from what is kept
    assert len(list((tmp_path / "machine-code").glob("*.o"))) in (2, 3)


def test_all_operations_are_casadi_s() -> None:
    x = ca.SX.sym("x", 3)
    a, b, c = ca.vertsplit(x)
    unary = [
        -a, a**2, ca.sqrt(a), 2 * a, 1 / a, ca.fabs(a - 1), ca.sign(a - 1), ca.exp(a), ca.log(a), ca.log1p(a),
        ca.expm1(a), ca.sin(a), ca.cos(a), ca.tan(a), ca.asin(a / 9), ca.acos(a / 9), ca.atan(a), ca.sinh(a),
        ca.cosh(a), ca.tanh(a), ca.floor(a), ca.ceil(a), ca.logic_not(a),
    ]  # fmt: skip
    binary = [
        a + b, a - b, a * b, a / b, a**b, a**3, ca.fmin(a, b), ca.fmax(a, b), ca.atan2(a, b), ca.hypot(a, b),
        ca.copysign(a, -b), a < b, a <= b, ca.eq(a, b), ca.ne(a, b), ca.logic_and(a - 1, b),
        ca.logic_or(a - 1, b - 2), ca.if_else(a < b, a * c, b * c), a + b + c + a * b + b * c + c * a,
    ]  # fmt: skip
    y = ca.vertcat(*unary, *binary)
    t, p = ca.SX.sym("t"), ca.SX.sym("p")
    f = ca.Function("f", [t, x, p], [y])
    rows = list(range(y.numel()))
    graphs._routines()
    n = y.numel()
    code = lowering.declarations() + lowering.point("all", program.read(f), rows)
    library_ = machine.Library(machine.compiled(code, effort=0), ["all"])
    points = np.random.default_rng(0).uniform(0.2, 3.0, (3, 16))
    lanes = over_lanes(y, x, points)
    for k in range(16):
        point, out = points[:, k].copy(), np.zeros(n)
        call(library_.address["all"], 0.0, point, np.zeros(1), out)
        truth = np.array(f(0, point, 0))[:, 0]
        np.testing.assert_allclose(out, truth, rtol=1e-13, atol=1e-14)
        np.testing.assert_allclose(lanes[:, k], truth, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("name", ["exp", "log", "sin", "cos"])
def test_elementary_functions_are_right_to_a_few_units_in_the_last_place(name: str) -> None:
    rng = np.random.default_rng(1)
    x = {
        "exp": np.r_[rng.uniform(-700, 700, 2000), rng.normal(0, 1e-3, 200), 0.0, -1e4, 1e4, np.nan],
        "log": np.r_[
            np.exp(rng.uniform(-700, 700, 2000)), rng.uniform(0.9, 1.1, 500), 1.0, 0.0, np.inf, -1.0
        ],
    }.get(name, np.r_[rng.uniform(-10, 10, 2000), rng.uniform(-1e5, 1e5, 2000), 0.0, np.nan])
    x = x[: x.size // 8 * 8].copy() if name in ("sin", "cos") else np.r_[x, np.ones(-x.size % 8)]
    symbol = ca.SX.sym("x")
    (got,) = over_lanes(getattr(ca, name)(symbol), symbol, x[None])
    with np.errstate(all="ignore"):
        want = getattr(np, name)(x)
    np.testing.assert_allclose(got, want, rtol=2e-15, atol=4e-16 if name in ("sin", "cos") else 0)


def test_powers_are_right_for_any_sign() -> None:
    base = np.array([2.0, 0.5, 0.0, 0.0, 1e-12, -2.0, -2.0, -2.0, 3.0, 0.0, 7.0, -1.5, 1e9, 1e-300, 1.0, 9.0])
    exponent = np.array([0.5, -3.0, 0.9, 0.0, 1.3, 3.0, 2.0, 0.5, 1e9, -1.0, 0.0, -1.0, 3.3, 1.0, 1e5, 0.5])
    x = ca.SX.sym("x", 2)
    (got,) = over_lanes(x[0] ** x[1], x, np.vstack([base, exponent]))
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(got, base**exponent, rtol=2e-13)


def test_a_graph_that_cannot_be_compiled_is_interpreted() -> None:
    strange = Strange()
    assert engine.engine_of((strange,)) is interpreted
    plain, same = integrate(PAPER), integrate(PAPER, [activate(strange, {})])
    assert np.abs(plain["v_mps"] - same["v_mps"]).max() < 1e-4
    assert np.abs(plain["v_mps"] - integrate(PAPER, [activate(strange, {"size": 0.5})])["v_mps"]).max() > 1e-3


def test_on_request_nothing_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(engine.INTERPRETED, "1")
    engine._native.cache_clear()
    engine.engine_of.cache_clear()
    try:
        assert engine.engine_of(()) is interpreted
    finally:
        monkeypatch.undo()
        engine._native.cache_clear()
        engine.engine_of.cache_clear()
    assert engine.engine_of(()) is graphs


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
def test_a_command_makes_code_anew_with_one_warning_where_others_could_have_written_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path))
    kept_in = tmp_path / "machine-code"
    kept_in.mkdir()
    kept_in.chmod(0o777)
    done = succeeded("simulate", "--variant", "0.5", cwd=tmp_path)
    assert done.err.count("machine code is made anew") == done.err.count("warning: ") == 1
    assert not list(kept_in.iterdir())


LEAN = Accuracy(relative=5e-5, absolute=1e-7, travel=0.0018, lean=True, order=3)
WITHIN = {
    "v_mps": 2e-5, "imu_ax_mps2": 4e-3, "imu_az_mps2": 4e-3, "imu_gy_radps": 5e-5, "enc_f_rad": 3e-5,
    "cur_f_A": 4e-3,
}  # fmt: skip
SETS = (
    (), ("tyre_windup",), ("gear_backlash",), ("radial_tyre_compliance", "rate_dependent_soil"),
    ("slip_sinkage", "drivetrain_friction", "supply_sag"),
)  # fmt: skip


@pytest.mark.parametrize(("ids", "variant"), in_turn(SETS, load_variants()[::3]))
def test_signals_are_those_of_cvodes_at_a_fine_tolerance(ids: tuple[str, ...], variant: Variant) -> None:
    p = model_parameters(load_robot(), load_soil(), variant, a_theta=load_paper().a_theta)
    active = [
        activate(get(i), {q.name: (q.prior_low + 3 * q.prior_high) / 4 for q in get(i).parameters})
        for i in ids
    ]
    effects, vector = tuple(e.effect for e in active), parameter_vector(p, active)
    fine = dataclasses.replace(LEAN, relative=1e-9, absolute=1e-11, order=5)
    start = rest_state(p, active)
    got = integrate(p, active, LEAN, tuple(WITHIN))
    states, _ = interpreted.run(effects, variant, fine, start, vector)
    truth = interpreted.outputs(effects, variant, tuple(WITHIN), got["t_s"], states, vector)
    for (name, limit), row in zip(WITHIN.items(), truth, strict=True):
        assert np.abs(got[name] - row).max() < limit, name


def test_a_run_without_solution_ends_with_a_reason_in_either_engine() -> None:
    start, vector = rest_state(PAPER), parameter_vector(PAPER, ())
    start[4] = np.nan
    for one in (graphs, interpreted):
        with pytest.raises(EstimateError, match=r"does not converge: .*not a number"):
            one.run((), PAPER.variant, LEAN, start, vector)


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
    record: Floats | None = None,
) -> tuple[int, Floats]:
    out = np.full((len(start), t.size), np.nan)
    begun = record_of(t, tolerance, len(start)) if record is None else record
    times, work = np.concatenate([t, [np.inf], t[-1:]]), rosenbrock.work_space(np.array(start))
    status = rosenbrock.integrate(rates, slopes, begun, times, np.array([k]), work, out.ravel())
    return status, out


def record_of(t: Floats, tolerance: float, states: int = 2, steps: Floats | None = None) -> Floats:
    return rosenbrock.record((states, t.size, 1), (tolerance, tolerance), 2000, steps=steps)


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


def test_a_run_repeats_the_steps_of_another_one() -> None:
    """x0 = cos t + (x0(0) - 1) exp(-k t); the difference of two runs with equal steps is its derivative."""
    t, k, h = np.linspace(0, 5, 301), 3.0, 1e-5
    first = record_of(t, 1e-5)
    count, base = run(forced, forced_slopes, t, [1.0, 1.0], k=k, record=first)
    steps = rosenbrock.taken(first)
    assert 10 < steps.size <= count
    assert steps.sum() == pytest.approx(1.0)
    again = [run(forced, forced_slopes, t, [x, 1.0], k=k, record=record_of(t, 1e-5, steps=steps))
             for x in (1.0, 1.0 + h)]  # fmt: skip
    assert [number for number, _ in again] == [steps.size] * 2
    assert np.abs(again[0][1] - base).max() < 1e-12
    assert np.abs((again[1][1][0] - base[0]) / h - np.exp(-k * t)).max() < 1e-3


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
    assert rosenbrock.factor(2, np.ones(4), np.zeros(2)) == 0  # a singular matrix
