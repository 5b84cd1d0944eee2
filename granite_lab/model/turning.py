"""Measured wheel speeds as the input of a run: smoothed by cubics, as finely as their std allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import UnivariateSpline

from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array
from granite_lab.model.pieces import turnings
from granite_lab.parameters import Course, Turning, course_of

FINEST = 1e-6
"""Least std that a wheel's speed is taken to have [m/s], as of a simulation."""

PATH = 0.02
"""Spacing at which a desired velocity is read off the wheels [s]."""

AHEAD = 0.2
"""Standstill before and after the motion that helps to fit it [s]."""


def turned(
    t: Array,
    v: tuple[Array, Array],
    std: tuple[Array, Array],
    radius: float,
    *,
    stretch: tuple[float, float] | None = None,
    command: Course | None = None,
    split: tuple[Array, Array] | None = None,
) -> Course:
    """Return a run whose wheels turn as measured, from rest to rest.

    Each axle's speed is the cubic spline with the fewest knots that stays within the std of each sample
    (Dierckx, Curve and Surface Fitting with Splines, Oxford 1993, ch. 5).

    Args:
        t: (N,) instants [s]; the wheels set off at 0 or later and stand in the end.
        v: (N,) r ω of front and rear [m/s].
        std: (N,) of them.
        radius: r [m].
        stretch: over which λ_R is taken [s]; by default all that moves.
        command: what was commanded; by default v_d is the mean of r ω.
        split: (N,) half of what r ω of the right wheel is above that of the left one, front and rear [m/s];
            it has the same std. By default the sides turn alike.

    Raises:
        EstimateError: the wheels' speeds are too few.
    """
    if t.size < 8:
        raise EstimateError(f"the wheels have {t.size} speeds only", "a log of more samples is needed")
    splines = [_spline(t, y, s) for y, s in zip((*v, *(split or ())), std * (2 if split else 1), strict=True)]
    begin, end = float(t[0]), float(t[-1])
    if command is None:
        fine = np.linspace(begin, end, max(round((end - begin) / PATH), 2) + 1)
        mean = np.maximum((splines[0](fine) + splines[1](fine)) / 2, 0.0)
        mean[[0, -1]] = 0.0
        course = course_of(fine, mean, stretch)
    else:
        course = command if stretch is None else course_of(*command.corners, stretch)
    inner = np.concatenate([course.corners[0], *(s.get_knots() for s in splines)])
    knots = np.unique(np.concatenate([[begin, end], inner[(inner > begin) & (inner < end)]]).round(6))
    front, rear, *apart = (_axle(knots, spline, radius) for spline in splines)
    wheels = tuple(zip(knots.tolist(), front, rear, strict=True))
    return replace(
        course, commanded=command is not None, stamped=command is None or command.stamped, wheels=wheels,
        split=tuple(zip(*apart, strict=True)) if split else (),
    )  # fmt: skip


def _spline(t: Array, v: Array, std: Array) -> UnivariateSpline:
    """Smooth less until no sample is missed by more than its std: a sum of squares would miss the corners."""
    weight, squares = 1 / np.maximum(std, FINEST), float(t.size)
    while True:
        spline = UnivariateSpline(t, v, w=weight, k=3, s=squares)
        if np.abs(weight * (spline(t) - v)).max() <= 1 or squares < 1:
            return spline
        squares /= 2


def _axle(knots: Array, spline: UnivariateSpline, radius: float) -> list[Turning]:
    """Return how an axle turns at the knots; it stands at both ends."""
    ω, α = spline(knots) / radius, spline.derivative()(knots) / radius
    ω[[0, -1]] = α[[0, -1]] = 0.0
    h = np.diff(knots)
    turned = h * (ω[1:] + ω[:-1]) / 2 + h**2 * (α[:-1] - α[1:]) / 12
    θ = np.concatenate([[0.0], np.cumsum(turned)])
    return turnings(θ, ω, α)
