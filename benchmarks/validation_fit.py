"""The contact model held against measured wheels: as given, with k_92 fitted, and with library effects."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from scipy.integrate import trapezoid
from scipy.optimize import brentq, least_squares

from benchmarks.validation_data import SPEED, Row, Series
from granite_lab.effects import get
from granite_lab.errors import EstimateError
from granite_lab.model.effect import activate
from granite_lab.model.single_wheel import Ratio, SingleWheel, WheelPoint, rolling
from granite_lab.parameters import load_paper

Array = npt.NDArray[np.float64]
Law = Callable[[float], float]

PULL, SINKAGE = 0.05, 2.0
"""What counts as agreement: drawbar pull within 5 % of the load, torque within 5 % of load times radius,
sinkage within 2 mm. Residuals are divided by these, so that the three count alike."""

LOST = 10.0
"""Residual of a wheel that sinks to its axle, in units of the tolerance."""

GRID = np.linspace(0, 1, 101)


def paper_law(_: float) -> float:
    """Return the paper's k_92 at the speed of the tests, (27)."""
    return math.exp(-load_paper().a_theta * SPEED)


def constant(value: float) -> Law:
    """Return a k_92 that does not depend on slip."""
    return lambda _: value


def linear(b0: float, b1: float) -> Law:
    """Return (3), k_92 = b0 + b1 |λ|, between 0 and 1, where (7) ends."""
    return lambda slip: float(np.clip(b0 + b1 * abs(slip), 0, 1))


@dataclass(frozen=True)
class Setup:
    """What the model is computed with.

    Attributes:
        law: slip to k_92.
        effects: id of an effect to its parameters.
        radius: added to the wheel's radius [m].
        tyre_friction: μ_s, or None for the series' own.
    """

    law: Law
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    radius: float = 0.0
    tyre_friction: float | None = None


def model(series: Series, row: Row, setup: Setup) -> WheelPoint | None:
    """Return the model's wheel at the slip and load of a row; None where it sinks to its axle.

    Quasi-static, (6)-(16) do not depend on speed; the model is taken above its floor of 0.02 m/s.
    """
    wheels = replace(series.wheels, radius=series.wheels.radius + setup.radius)
    soil = series.soil
    if setup.tyre_friction is not None:
        soil = replace(soil, tyre_friction=setup.tyre_friction)
    active = [activate(get(name), values) for name, values in setup.effects.items()]
    try:
        return SingleWheel(wheels, soil, active).at_load(
            row.load, rolling(row.slip, wheels.radius), Ratio(setup.law(row.slip))
        )
    except EstimateError:
        return None


def numbers(point: WheelPoint | None) -> Array:
    """Return drawbar pull [N], torque [N m] and sinkage [mm]; not numbers where there is no point."""
    if point is None:
        return np.full(3, np.nan)
    return np.array([point.drawbar_pull, point.torque, 1000 * point.sinkage])


def measured(row: Row) -> Array:
    """Return the same of a row."""
    return np.array([row.pull, row.torque, row.sinkage])


def residuals(series: Series, rows: Sequence[Row], setup: Setup) -> Array:
    """Return (rows, 3) model less measured over the tolerance; NaN where nothing was measured."""
    found = []
    for row in rows:
        scale = np.array([PULL * row.load, PULL * row.load * series.wheels.radius, SINKAGE])
        off = (numbers(model(series, row, setup)) - measured(row)) / scale
        found.append(np.where(np.isnan(off) & ~np.isnan(measured(row)), LOST, off))
    return np.array(found)


def total(off: Array) -> float:
    """Return the root mean square of all residuals."""
    return float(np.sqrt(np.nanmean(off**2)))


@dataclass(frozen=True)
class Needed:
    """k_92 that one slip needs.

    Attributes:
        row: means of the runs at this slip.
        best: k_92 nearest to each of drawbar pull, torque and sinkage; NaN where not measured.
        reached: whether that is within the tolerance.
        common: smallest and largest k_92 that satisfy all that was measured; None if there is none.
        joint: k_92 of the least sum of squares, and its residuals (3,) over the tolerance.
    """

    row: Row
    best: Array
    reached: tuple[bool, ...]
    common: tuple[float, float] | None
    joint: float
    joint_residuals: Array


def needed(series: Series, row: Row) -> Needed:
    """Scan k_92 from 0 to 1: for each quantity alone, and for all at once."""
    off = np.array([residuals(series, [row], Setup(constant(float(k))))[0] for k in GRID])
    there = ~np.isnan(off[0])
    best = np.full(3, np.nan)
    for c in np.flatnonzero(there):
        best[c] = _crossing(off[:, c])
    reached = tuple(bool(there[c] and np.abs(off[:, c]).min() <= 1) for c in range(3))
    good = GRID[(np.abs(off[:, there]) <= 1).all(axis=1)]
    k = int(np.nansum(off**2, axis=1).argmin())
    common = (float(good[0]), float(good[-1])) if good.size else None
    return Needed(row, best, reached, common, float(GRID[k]), off[k])


def _crossing(off: Array) -> float:
    """Return where a residual vanishes, else where it is least."""
    change = np.flatnonzero(off[:-1] * off[1:] <= 0)
    if not change.size:
        return float(GRID[np.abs(off).argmin()])
    i = int(change[0])
    return float(np.interp(0, np.sort(off[i : i + 2]), GRID[i : i + 2][np.argsort(off[i : i + 2])]))


@dataclass(frozen=True)
class Fit:
    """A law of k_92, with effects, fitted to a series.

    Attributes:
        setup: what was found.
        values: the fitted numbers.
        off: (slips, 3) residuals over the tolerance.
        left_out: root mean square of the residuals at slips that were left out of the fit.
    """

    setup: Setup
    values: Mapping[str, float]
    off: Array
    left_out: float


@dataclass(frozen=True)
class Form:
    """What is fitted: names of the numbers, their bounds and start, and what they make."""

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    start: tuple[tuple[float, ...], ...]
    make: Callable[[Sequence[float]], Setup]


def law_forms(effects: Sequence[tuple[str, str]] = ()) -> list[Form]:
    """Return the laws of k_92, each with the same effects, given as (id, parameter)."""
    bounds = [next(q for q in get(i).parameters if q.name == name) for i, name in effects]
    more = tuple(f"{i}.{name}" for i, name in effects)
    low, high = tuple(q.low for q in bounds), tuple(q.high for q in bounds)
    start = tuple((q.prior_low + q.prior_high) / 2 for q in bounds)

    def on(x: Sequence[float]) -> dict[str, dict[str, float]]:
        return {
            i: {name: float(value)}
            for (i, name), value in zip(effects, x[len(x) - len(effects) :], strict=True)
        }

    return [
        Form(("k_92", *more), (0.0, *low), (1.0, *high), ((0.3, *start), (0.8, *start)),
             lambda x: Setup(constant(float(x[0])), on(x))),
        Form(("b0", "b1", *more), (0.0, -5.0, *low), (1.0, 5.0, *high),
             ((0.4, -0.5, *start), (0.4, 0.5, *start)),
             lambda x: Setup(linear(float(x[0]), float(x[1])), on(x))),
    ]  # fmt: skip


def fit(series: Series, form: Form, rows: Sequence[Row] | None = None, *, leave_out: bool = True) -> Fit:
    """Fit a form to the means of a series by least squares, from each of its starts; driven wheels only."""
    rows = series.driven if rows is None else rows

    def off(x: Array) -> Array:
        found = residuals(series, rows, form.make(x.tolist())).ravel()
        return found[~np.isnan(found)]

    tries = [
        least_squares(off, x0, bounds=(form.low, form.high), diff_step=[1e-4] * len(x0), x_scale=0.3)
        for x0 in form.start
    ]
    found = min(tries, key=lambda t: float(t.cost)).x.tolist()
    setup = form.make(found)
    left = math.nan
    if leave_out:
        near, held = replace(form, start=(tuple(found),)), []
        for row in rows:
            others = [other for other in rows if other is not row]
            held.append(residuals(series, [row], fit(series, near, others, leave_out=False).setup))
        left = total(np.vstack(held))
    return Fit(setup, dict(zip(form.names, found, strict=True)), residuals(series, rows, setup), left)


def bekker_wong(series: Series, row: Row) -> Array:
    """Return what a wheel after Wong and Reece (1967) does: ϑ_2 = 0, largest stress at (0.4 + 0.2 |λ|) ϑ_1.

    The rival of the page, as roverdevkit has it: lugs raise the shear stress by their share of the
    circumference, N h / (2 π r). Pull [N], torque [N m], sinkage [mm].
    """
    lift = 1 + min(0.6, series.wheels.lugs * series.lug / (2 * math.pi * series.wheels.radius))
    r, b, s = series.wheels.radius, series.wheels.width, series.soil
    k = s.cohesive_modulus / b + s.frictional_modulus

    def forces(front: float) -> tuple[float, float, float]:
        x = np.linspace(0, front, 801)
        peak = (0.4 + 0.2 * abs(row.slip)) * front
        shown = np.where(x >= peak, x, front - x / peak * (front - peak))
        σ = k * np.maximum(r * (np.cos(shown) - math.cos(front)), 0) ** s.exponent
        j = r * ((front - x) - (1 - row.slip) * (math.sin(front) - np.sin(x)))
        τ = np.sign(j) * (s.cohesion + σ * math.tan(math.radians(s.friction_angle)))
        τ = lift * τ * (1 - np.exp(-np.abs(j) / s.shear_modulus))
        load = trapezoid(σ * np.cos(x) + τ * np.sin(x), x)
        pull = trapezoid(τ * np.cos(x) - σ * np.sin(x), x)
        return float(b * r * load), float(b * r * pull), float(b * r * r * trapezoid(τ, x))

    front = float(brentq(lambda a: forces(a)[0] - row.load, 1e-3, 1.55))
    _, pull, torque = forces(front)
    return np.array([pull, torque, 1000 * r * (1 - math.cos(front))])
