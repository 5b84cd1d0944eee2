"""From parameters to a Run: the state at rest, the integrated motion, the outputs, and what they give."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg.lapack import dgesv

from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array
from granite_lab.model import interpreted
from granite_lab.model.command import Kind, kind_of, steady_part
from granite_lab.model.effect import Active, Effect
from granite_lab.model.engine import engine_of
from granite_lab.model.graph import build_graph, model_states
from granite_lab.model.instants import SETTLE, USUAL, Accuracy, instants
from granite_lab.model.limits import (
    refuse_backwards,
    refuse_giving,
    refuse_standing,
    refuse_unsteady,
)
from granite_lab.model.run import Run
from granite_lab.model.symbols import ModelParameters, model_parameters, vector_of
from granite_lab.parameters import Course, Robot, Soil, Variant, load_paper


@lru_cache(maxsize=64)
def _rest_function(effects: tuple[Effect, ...], kind: Kind) -> Any:
    """Return f(q, p) -> what must vanish at standstill, its Jacobian, and the place of R.

    q holds height and pitch of the robot and the effects' extra states; what must vanish are the
    vertical and the pitch acceleration and the rates of the extra states.
    """
    graph = build_graph(effects, kind)
    paper, n = len(model_states(kind)), len(graph.states)
    q = ca.SX.sym("q", 2 + n - paper)
    x = ca.vertcat(0, q[:2], ca.SX.zeros(paper - 3), q[2:])
    given, rest = ca.vertcat(graph.x, graph.t, graph.u), ca.vertcat(x, -SETTLE, ca.SX.zeros(graph.u.numel()))
    rates = ca.substitute(graph.rates, given, rest)
    residual = ca.vertcat(rates[4:6], rates[paper:])
    place = ca.substitute(graph.outputs["x_m"], given, rest)
    slope = ca.densify(ca.jacobian(residual, q))
    return ca.Function("rest", [q, graph.p], [ca.densify(residual), slope, ca.densify(place)])


def rest_state(p: ModelParameters, effects: Sequence[Active] = ()) -> Array:
    """Return the state of the robot at rest before the command: sunk in, level forces.

    Raises:
        EstimateError: the robot finds no rest on this soil.
    """
    chosen, vector = tuple(e.effect for e in effects), parameter_vector(p, effects)
    extra = sum(len(e.states) for e in chosen)
    q = np.array([0.85 * p.wheels.radius + p.chassis.com_z, 0.0] + extra * [0.0])
    limit = np.array(2 * [0.2 * p.wheels.radius] + extra * [np.inf])
    residual, columns, place = np.empty(q.size), np.empty((q.size, q.size)), np.empty(1)
    kind = kind_of(p.variant)
    places, evaluate = _rest_function(chosen, kind).buffer()
    for k, given in enumerate((q, vector)):
        places.set_arg(k, given.data)
    for k, result in enumerate((residual, columns, place)):
        places.set_res(k, result.data)
    if extra:  # at states far from rest the wheels may carry too little: these come to rest first
        evaluate()
        q[2:] -= _solved(columns.T[2:, 2:], residual[2:])
    for _ in range(60):
        evaluate()
        if not np.isfinite(columns).all():
            break
        step = _solved(columns.T, residual)
        q -= np.clip(step, -limit, limit)
        if (np.abs(step) < 1e-12 * np.fmax(1, np.abs(q))).all():
            break
    sinkage = p.wheels.radius + p.chassis.com_z - q[0]
    if not (np.isfinite(q).all() and np.abs(residual).max() < 1e-3 and sinkage < p.wheels.radius):
        raise EstimateError(
            f"the robot sinks to its axles on this soil (sinkage {sinkage * 1000:.0f} mm, "
            f"wheel radius {p.wheels.radius * 1000:.0f} mm)",
            "check masses, wheel size and the soil's moduli",
        )
    start = -float(place[0])  # R begins at x = 0
    return np.concatenate([[start, q[0], q[1]], np.zeros(len(model_states(kind)) - 3), q[2:]])


def _solved(A: Array, b: Array) -> Array:
    """Return the solution of A x = b, by least squares where the matrix is singular."""
    *_, x, singular = dgesv(A, b)  # numpy's way to it takes five times as long
    return np.asarray(np.linalg.lstsq(A, b, rcond=None)[0] if singular else x)


def parameter_vector(p: ModelParameters, effects: Sequence[Active]) -> Array:
    """Return the (P,) numbers of a run: the model's in the order of `vector_of`, then the effects'."""
    return np.array(vector_of(p) + [value for e in effects for value in e.values], dtype=float)


Like = tuple[ModelParameters, tuple[Active, ...]]
"""Numbers of a run, and its effects that move the robot."""


def moving(effects: Sequence[Active]) -> tuple[Active, ...]:
    """Return the effects that move the robot; a run of these has the same steps."""
    return tuple(e for e in effects if e.effect.moves)


def repeats(effects: Sequence[Effect], kind: Kind = "trapezoid") -> bool:
    """Say whether a run with effects can repeat the steps of another one."""
    return engine_of(tuple(effects), kind) is not interpreted


def integrate(
    p: ModelParameters,
    effects: Sequence[Active] = (),
    accuracy: Accuracy = USUAL,
    names: tuple[str, ...] | None = None,
    like: Like | None = None,
) -> dict[str, Array]:
    """Integrate the model from rest, through the command, to rest.

    Args:
        p: all numbers.
        effects: effects added to the paper's model.
        accuracy: tolerances and output grid.
        names: which outputs of the graph are wanted; by default all.
        like: the numbers and the effects that move the robot, of a run along the same command whose steps are
            repeated. The difference of two runs with the same steps has no error of their choice (H. G.
            Bock's internal numerical differentiation, Springer Series in Chemical Physics 18, 1981, 102-125).

    Returns:
        name to (N,) array, the outputs of the graph; the first is ``t_s`` [s after command start].

    Raises:
        EstimateError: the integrator gave up, or the robot finds no rest.
    """
    chosen = tuple(e.effect for e in effects)
    t, vector = instants(p.variant, accuracy), parameter_vector(p, effects)
    movers = moving(effects)
    # sensors with other faults look at the same motion; a plain run is not kept, for it may be long
    history = (_history if len(movers) == len(effects) else _remembered)(p, movers, accuracy, like)
    kind = kind_of(p.variant)
    wanted = names or tuple(build_graph(chosen, kind).outputs)
    table = engine_of(chosen, kind).outputs(chosen, p.variant, wanted, t, history, vector)
    if not np.isfinite(table).all():
        raise EstimateError(
            "the simulation gives values that are not finite",
            "check the parameters with 'granite-lab params'",
        )
    signals = dict(zip(wanted, table, strict=True))
    return {"t_s": t} | _delayed(t, signals, chosen, vector)


def along(
    p: ModelParameters,
    effects: Sequence[Active],
    others: Sequence[Sequence[Active]],
    names: tuple[str, ...],
    accuracy: Accuracy = USUAL,
) -> tuple[Array, ...]:
    """Return what outputs would be at the states of one run if further effects acted at that instant only.

    Args:
        p, effects, accuracy: of the run, as `integrate` has them.
        others: values of the same further effects, which have no states.
        names: of the outputs.

    Returns:
        per entry of `others` the (outputs, N) table.

    Raises:
        EstimateError: of `integrate`.
    """
    t, history = instants(p.variant, accuracy), _history(p, tuple(effects), accuracy)
    kind, runs = kind_of(p.variant), []
    for more in others:
        every = (*effects, *more)
        chosen = tuple(e.effect for e in every)
        vector = parameter_vector(p, every)
        runs.append(engine_of(chosen, kind).outputs(chosen, p.variant, names, t, history, vector))
    return tuple(runs)


@lru_cache(maxsize=64)
def _lags(effects: tuple[Effect, ...]) -> Any:
    graph = build_graph(effects)
    return ca.Function("lags", [graph.p], [ca.vertcat(*graph.delays.values())])


def _delayed(
    t: Array, signals: dict[str, Array], effects: tuple[Effect, ...], vector: Array
) -> dict[str, Array]:
    """Return the signals with those that an effect delays shifted in time; before and after, at rest.

    Args:
        t: (N,) time since the start of the command [s].
        signals: name to (N,) array.
        effects: effects of the graph.
        vector: (P,) its parameters.
    """
    delays = build_graph(effects).delays
    if not delays:
        return signals
    late = {
        name: np.interp(t - lag, t, signals[name])
        for name, lag in zip(delays, _lags(effects)(vector).full()[:, 0], strict=True)
        if lag != 0 and name in signals
    }
    return signals | late


def _run(
    p: ModelParameters, effects: tuple[Active, ...], accuracy: Accuracy, steps: Array | None = None
) -> tuple[Array, Array | None]:
    """Return the (states, N) history, and the steps of the run; see `engine.Engine`.

    Raises:
        EstimateError: the integrator gave up, or the robot finds no rest.
    """
    chosen, vector = tuple(e.effect for e in effects), parameter_vector(p, effects)
    engine = engine_of(chosen, kind_of(p.variant))
    states, steps = engine.run(chosen, p.variant, accuracy, rest_state(p, effects), vector, steps)
    states.flags.writeable = False
    return states, steps


_steps: dict[tuple[ModelParameters, tuple[Active, ...], Accuracy], Array | None] = {}
"""The steps of the last runs that chose them."""

KEPT = 256
"""Number of runs whose steps are kept: those of every trial of a set, at a time."""


def _history(
    p: ModelParameters, effects: tuple[Active, ...], accuracy: Accuracy, like: Like | None = None
) -> Array:
    """Return the (states, N) history; errors as of `_run`."""
    if like is not None:
        if (*like, accuracy) not in _steps:
            _history(*like, accuracy)
        return _run(p, effects, accuracy, _steps[*like, accuracy])[0]
    states, steps = _run(p, effects, accuracy)
    _steps[p, effects, accuracy] = steps
    while len(_steps) > KEPT:
        del _steps[next(iter(_steps))]
    return states


_remembered = lru_cache(maxsize=8)(_history)


def ways(
    signals: dict[str, Array], interval: tuple[float, float], radius: float, wheels: str = "theta"
) -> tuple[float, float]:
    """Return how far the body came in an interval, and its wheels without slip [m].

    Args:
        signals: of a run.
        interval: start and end [s after command start].
        radius: of the wheels [m].
        wheels: by whose angles they turn: "theta", their own, or "enc", those that the encoders read.
    """
    names = ("x_m", f"{wheels}_f_rad", f"{wheels}_r_rad")
    body, front, rear = (
        float(np.diff(np.interp(interval, signals["t_s"], signals[name]))[0]) for name in names
    )
    return body, radius * (front + rear) / 2


def steady_slip(
    signals: dict[str, Array], variant: Variant, radius: float
) -> tuple[float, tuple[float, float]]:
    """Return λ_R by (2) over the steady part, and that part [s].

    The desired distance is the one the wheels would cover without slip. The steady part is the
    second half of the constant desired velocity: the robot settles with a time constant of about
    0.35 s after the ramp, and the first half would add up to 1.4 points.

    Raises:
        EstimateError: the wheels do not turn in the steady part.
    """
    t1, t2 = steady_part(variant)
    body, wheels = ways(signals, (t1, t2), radius)
    refuse_standing(wheels, variant, t1, t2)
    return 1 - body / wheels, (t1, t2)


def simulate(
    variant: Variant,
    robot: Robot,
    soil: Soil,
    *,
    k92: float | None = None,
    a_theta: float | None = None,
    effects: Sequence[Active] = (),
    accuracy: Accuracy = USUAL,
) -> Run:
    """Simulate one run, equations (1)-(26).

    Args:
        variant: the commanded trapezoid, or a course.
        robot: with chassis and drive.
        soil: the ground.
        k92: a constant k_92 [-]; by default k_92 = exp(-a_θ v_d(t)), (5).
        a_theta: a_θ [s/m], by default the paper's.
        effects: effects added to the paper's model.
        accuracy: tolerances and output grid.

    Raises:
        InputError: the robot's file lacks chassis or drive.
        EstimateError: the simulation does not converge, the robot finds no rest or is driven
            by the ground, or there is no steady part or no slip ratio in it.
    """
    if not isinstance(variant, Course):
        refuse_unsteady(variant, *steady_part(variant))
    exponent = load_paper().a_theta if a_theta is None else a_theta
    p = model_parameters(robot, soil, variant, k92=k92, a_theta=exponent)
    begin = time.perf_counter()
    signals = integrate(p, effects, accuracy)
    wall = time.perf_counter() - begin
    refuse_backwards(float(signals["v_mps"].min()), variant.velocity)
    slip, steady = steady_slip(signals, variant, robot.wheels.radius)
    refuse_giving(signals, p.chassis.wheel_base)
    return Run(
        variant=variant,
        robot=robot,
        soil=soil,
        k92_law="exponential" if k92 is None else "constant",
        k92_value=exponent if k92 is None else k92,
        effects={e.id: e.as_dict() for e in effects},
        signals=signals,
        slip_ratio=slip,
        steady=steady,
        wall=wall,
    )
