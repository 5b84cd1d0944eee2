"""The checks that every effect must pass, in the library and in a user's file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from granite_lab.columns import Column, Table, words
from granite_lab.effects.library import neutral_gap
from granite_lab.errors import EstimateError, InputError, LabError
from granite_lab.model import Accuracy, interpreted, simulate
from granite_lab.model.effect import Active, Effect, activate
from granite_lab.model.engine import engine_of
from granite_lab.model.graph import STATES, build_graph
from granite_lab.model.simulator import parameter_vector, rest_state
from granite_lab.model.symbols import model_parameters, vector_of
from granite_lab.parameters import load_paper, load_robot, load_soil, load_variants, variant_of

FINE = Accuracy(1e-8, 1e-10)
"""Tolerances of runs that are compared."""

SAME_RUN = 2e-7
"""Largest difference of two runs that differ by the steps of the integrator only [m/s, m, rad]."""

SAME_NUMBER = 1e-9
"""Largest relative difference of one formula computed in two ways."""

SAME_STATES = 1e-4
"""Largest difference of two integrators at `FINE`, as a share of the largest value of a state."""

SEEN = 1e-6
"""Least change of some channel at a typical size, as a share of the channel's largest value."""

PROPORTIONAL = 0.1
"""Largest relative rms by which the trace of a parameter declared linear differs from a proportional one."""

CHANNELS = ("imu_ax_mps2", "imu_az_mps2", "imu_gy_radps", "enc_f_rad", "enc_r_rad", "cur_f_A", "cur_r_A")
"""What the sensors read."""


@dataclass(frozen=True)
class Check:
    """One check.

    Attributes:
        name: what is checked.
        passed: None where it cannot be checked here, or does not apply.
        detail: what was found.
    """

    name: str
    passed: bool | None
    detail: str


CHECKS = Table[Check](
    "checks",
    "Checks of an effect",
    Column("", lambda c: {True: "ok", False: "FAILED", None: "-"}[c.passed]),
    Column("check", lambda c: c.name),
    Column("found", lambda c: words(c.detail)),
)


def typical(effect: Effect) -> Active:
    """Switch an effect on at a value in the middle of what the literature leads to expect.

    A parameter that may have either sign stands halfway up its positive side, a shape at its start.
    """
    values = {}
    for p in effect.parameters:
        if p.shape:
            values[p.name] = p.neutral
        elif p.prior_low < p.neutral:
            values[p.name] = (p.neutral + p.prior_high) / 2
        else:
            values[p.name] = (p.prior_low + p.prior_high) / 2
    return activate(effect, values)


def contract(effect: Effect) -> list[Check]:
    """Check an effect; a check that fails with an error of the effect's code is a failed check.

    What the effect declares (id, texts, hooks, bounds in order) is checked when its file is read, see
    `granite_lab.effects.library.check_declaration`.
    """
    checks: tuple[tuple[str, Callable[[Effect], tuple[bool | None, str]]], ...] = (
        ("title and signature are given", _texts),
        ("source is given", _source),
        ("parameters have unit, meaning, bounds and an expected range", _parameters),
        ("neutral values give the paper's model", _neutral),
        ("a neutral run equals the paper's", _neutral_run),
        ("shape parameters alone change nothing", _shapes),
        ("derivatives are finite", _derivatives),
        ("a typical size changes the readings", _seen),
        ("traces of parameters declared linear are proportional", _linear),
        ("runs over the expected range converge", _expected_range),
        ("runs at the bounds converge or are refused with a reason", _bounds),
        ("machine code gives the same run", _compiled),
    )
    return [_checked(name, check, effect) for name, check in checks]


def refuse_failed(results: Mapping[str, Sequence[Check]], where: str) -> None:
    """Refuse effects of which a check failed.

    Raises:
        InputError: naming the file or id `where`, the effect and its first failed check.
    """
    for name, checks in results.items():
        failed = [c for c in checks if c.passed is False]
        if failed:
            raise InputError(
                f"{where}: effect '{name}': {len(failed)} of {len(checks)} checks failed, first: "
                f"{failed[0].name}: {failed[0].detail}",
                "docs/how-to-effect.md shows an effect; docs/effects.md lists the hooks",
            )


def _checked(name: str, check: Callable[[Effect], tuple[bool | None, str]], effect: Effect) -> Check:
    try:
        return Check(name, *check(effect))
    except LabError as error:
        return Check(name, False, error.message)
    except Exception as error:  # the effect's code is anyone's
        return Check(name, False, f"{type(error).__name__}: {error}")


def _texts(effect: Effect) -> tuple[bool, str]:
    short = [name for name in ("title", "signature") if len(str(getattr(effect, name)).split()) < 2]
    if short:
        return False, f"{' and '.join(short)}: one word, expected a few"
    return True, f"{effect.title}"


def _source(effect: Effect) -> tuple[bool, str]:
    words = effect.source.split()
    good = len(words) >= 3 and words[0].lower() not in ("none", "todo", "unknown", "tbd")
    return good, effect.source if good else f"'{effect.source}' does not say where the formula is from"


def _parameters(effect: Effect) -> tuple[bool, str]:
    names = [p.name for p in effect.parameters]
    for p in effect.parameters:
        numbers = (p.low, p.high, p.neutral, p.prior_low, p.prior_high)
        if not all(map(math.isfinite, numbers)):
            return False, f"{p.name}: a bound is not finite"
        if not p.name.isidentifier() or names.count(p.name) > 1:
            return False, f"{p.name}: not a valid name, or used twice"
        if not p.meaning.strip() or p.unit != p.unit.strip():
            return False, f"{p.name}: the meaning is missing or the unit is not valid"
    return True, ", ".join(f"{p.name} [{p.unit or '-'}] {p.low:g} to {p.high:g}" for p in effect.parameters)


def _neutral(effect: Effect) -> tuple[bool, str]:
    gap = neutral_gap(effect)
    return gap <= SAME_NUMBER, f"largest relative difference of rates and signals {gap:.1g}"


def _neutral_run(effect: Effect) -> tuple[bool, str]:
    gap = _difference(activate(effect, {}))
    return gap <= SAME_RUN, f"largest difference {gap:.1g}"


def _shapes(effect: Effect) -> tuple[bool | None, str]:
    shapes = {p.name: p.prior_high for p in effect.parameters if p.shape}
    if not shapes:
        return None, "no shape parameters"
    gap = _difference(activate(effect, shapes))
    return gap <= SAME_RUN, f"largest difference {gap:.1g} with {', '.join(shapes)} at the end of the range"


def _difference(active: Active) -> float:
    """Return how far a run at 0.7 m/s is from the paper's."""
    robot, soil, variant = load_robot(), load_soil(), variant_of(0.7)
    plain, run = (simulate(variant, robot, soil, accuracy=FINE, effects=e) for e in ((), (active,)))
    names = ("v_mps", "x_m", "pitch_rad", "enc_f_rad", "enc_r_rad")
    return max(float(np.abs(run[name] - plain[name]).max()) for name in names)


def _derivatives(effect: Effect) -> tuple[bool, str]:
    """Look at rest and in motion, at neutral and at a typical size, by every state and parameter."""
    graph = build_graph((effect,))
    p = model_parameters(load_robot(), load_soil(), variant_of(0.5), a_theta=load_paper().a_theta)
    expressions = ca.vertcat(graph.rates, *graph.outputs.values(), *graph.delays.values())
    derivative = ca.Function(
        "d",
        [graph.t, graph.x, graph.p],
        [ca.jacobian(expressions, graph.x), ca.jacobian(expressions, graph.p)],
    )
    for active in (activate(effect, {}), typical(effect)):
        rest = rest_state(p, (active,))
        moving = rest.copy()
        moving[: len(STATES)] += [0.8, 0, 0, 0.4, 0, 0.01, 9, 5.0, 4.0, 9, 5.0, 4.0]
        for where, t, x in (("at rest", -0.5, rest), ("in motion", 2.0, moving)):
            for part in derivative(t, x, vector_of(p) + list(active.values)):
                if not np.isfinite(part.full()).all():
                    return False, f"{where} with {_in_words(active)}: a derivative is not a number"
    return True, "at rest and in motion, by every state and parameter"


def _seen(effect: Effect) -> tuple[bool, str]:
    active, robot, soil, variant = typical(effect), load_robot(), load_soil(), variant_of(0.5)
    plain, run = (simulate(variant, robot, soil, effects=e) for e in ((), (active,)))
    changes = {c: float(np.abs(run[c] - plain[c]).max() / np.abs(plain[c]).max()) for c in CHANNELS}
    best = max(changes, key=changes.__getitem__)
    detail = f"{_in_words(active)} changes {best} by {100 * changes[best]:.2g} % of its largest value"
    return changes[best] > SEEN, detail


def _linear(effect: Effect) -> tuple[bool | None, str]:
    """Compare the change by the largest expected size with that by a quarter of it, channel by channel."""
    declared = [p for p in effect.parameters if p.linear]
    if not declared:
        return None, "no parameter is declared linear"
    robot, soil, variant = load_robot(), load_soil(), variant_of(0.5)
    plain = simulate(variant, robot, soil)
    worst, where = 0.0, ""
    for p in declared:
        sizes = (p.neutral + share * (p.prior_high - p.neutral) for share in (0.25, 1.0))
        few, many = (
            simulate(variant, robot, soil, effects=(activate(effect, {p.name: size}),)) for size in sizes
        )
        traces = np.array([[run[c] - plain[c] for c in CHANNELS] for run in (few, many)])
        weight = np.array([np.abs(plain[c]).max() for c in CHANNELS])[:, None]
        left = np.linalg.norm((4 * traces[0] - traces[1]) / weight)
        gap = float(left / np.linalg.norm(traces[1] / weight))
        if gap >= worst:
            worst, where = gap, p.name
    return worst <= PROPORTIONAL, f"{where}: differs from proportional by {100 * worst:.2g} %"


def _expected_range(effect: Effect) -> tuple[bool, str]:
    """Simulate all four variants at both ends of the expected range and at two places in it."""
    rng = np.random.default_rng(list(effect.id.encode()))
    n, runs = len(effect.parameters), 0
    for share in (np.zeros(n), np.ones(n), *rng.uniform(size=(2, n))):
        values = {
            p.name: float(p.prior_low + s * (p.prior_high - p.prior_low))
            for p, s in zip(effect.parameters, share, strict=True)
        }
        active = activate(effect, values)
        for variant in load_variants():
            try:
                run = simulate(variant, load_robot(), load_soil(), effects=(active,))
            except EstimateError as error:
                return False, f"{_in_words(active)} at {variant.velocity:g} m/s: {error.message}"
            if not 0.15 * variant.distance < run["x_m"][-1] < 1.1 * variant.distance:
                return False, f"{_in_words(active)}: the robot does not cover the distance"
            runs += 1
    return True, f"{runs} runs, all four variants"


def _bounds(effect: Effect) -> tuple[bool, str]:
    usual, refused, runs = typical(effect).as_dict(), "", 0
    ends = [(p, bound) for p in effect.parameters for bound in (p.low, p.high)]
    for p, bound in ends:
        active = activate(effect, usual | {p.name: bound})
        runs += 1
        try:
            simulate(variant_of(0.5), load_robot(), load_soil(), effects=(active,))
        except EstimateError as error:
            refused = refused or f"; {p.name} = {bound:g} is refused: {error.message}"
    return True, f"{runs} runs{refused}"


def _compiled(effect: Effect) -> tuple[bool | None, str]:
    """Compare states of a run, and all outputs at the same states."""
    if engine_of(()) is interpreted:
        return None, "no compiler on this machine"
    engine = engine_of((effect,))
    if engine is interpreted:
        return (
            False,
            "a function in it is not compiled; use +, *, /, **, sqrt, exp, log, sin, tanh, fmax, if_else",
        )
    active, variant = typical(effect), variant_of(0.5)
    p = model_parameters(load_robot(), load_soil(), variant, a_theta=load_paper().a_theta)
    start, vector = rest_state(p, (active,)), parameter_vector(p, (active,))
    compiled, plain = (e.run((effect,), variant, FINE, start, vector)[0] for e in (engine, interpreted))
    scale = np.abs(plain).max(axis=1) + 1e-6
    gap = float((np.abs(compiled - plain).max(axis=1) / scale).max())
    names = tuple(build_graph((effect,)).outputs)
    t = np.linspace(0.0, 1.0, plain.shape[1])
    a, b = (e.outputs((effect,), variant, names, t, plain, vector) for e in (engine, interpreted))
    same = float((np.abs(a - b) / np.fmax(1, np.abs(b))).max())
    good = gap <= SAME_STATES and same <= SAME_NUMBER
    return good, f"states within {gap:.1g} of their largest values, outputs within {same:.1g}"


def _in_words(active: Active) -> str:
    return ", ".join(f"{name} = {value:.3g}" for name, value in active.as_dict().items())
