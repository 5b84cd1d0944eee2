"""Slip and k_92 over speed, and k_92 over slip, beside the paper."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from granite_lab.comparison.compare import Comparison
from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.parameters import load_paper
from granite_lab.reporting import canvas
from granite_lab.reporting.answers import Answers
from granite_lab.reporting.canvas import Canvas, Figure
from granite_lab.reporting.speeds import Speed
from granite_lab.rounding import significant

VELOCITY, SLIP, RATIO = "desired velocity [m/s]", "robot slip ratio [%]", "contact-angle ratio k₉₂ [–]"
APART, WIDE = 0.008, 0.05
"""Abscissae of the trials of a speed [m/s]: from one to the next, and from first to last at most."""
CROWD = 12
"""Largest number of trials of a speed that are drawn at full size; more are drawn smaller and fainter."""
DASHED, UNDER = (0, (4, 1.5)), 2.8
"""Line of the paper, and width of the fitted one below it [pt]: both are seen where they coincide."""

Point = tuple[Estimate, Estimate, int]
"""x and y of a trial, and the number of trials at its speed."""


def slip_figure(answers: Answers) -> Figure:
    """Draw λ_R over the desired velocity: each trial, the means with their intervals, and the paper."""
    with_slip = [s for s in answers.speeds if s.slip_is_known]
    rising = all(a.slip.value < b.slip.value for a, b in pairwise(with_slip))
    title = "Slip grows with speed" if rising else "Slip does not grow steadily with speed"
    if len(with_slip) < 2:
        title = (
            "".join(f"{s.slip.quantity} slip at {s.velocity:g} m/s" for s in with_slip)
            or "No slip ratio known"
        )
    judged = [s for s in with_slip if s.agrees is not None]
    if judged:
        inside = sum(bool(s.agrees) for s in judged)
        where = f"in the interval at {inside} of {len(judged)} speeds"
        if len(judged) == 1:
            where = f"{'in' if inside else 'outside'} the interval"
        title += f"; the paper's experiment is {where}"

    def draw(axis: Axes) -> None:
        alone = all(s.trials == 1 for s in with_slip)
        points = _over_speed(answers.speeds, lambda c: c.motion.slip_ratio)
        _trials(axis, [] if alone else points, (1.0, 100.0), color=canvas.MEASURED_LIGHT)
        label = f"{'one trial' if alone else 'mean'}, 95 %"
        for k, s in enumerate(with_slip):
            bars = [[_bar(s.slip.value - s.slip.low)], [_bar(s.slip.high - s.slip.value)]]
            axis.errorbar(
                s.velocity, s.slip.value, yerr=bars, color=canvas.MEASURED, marker="D", markersize=4.5,
                capsize=4, linewidth=1.4, label=label if k == 0 else None,
            )  # fmt: skip
        _published(axis, [(p.velocity, 100 * p.slip_measured) for p in load_paper().table3])
        axis.set_xlim(left=0)
        axis.set_ylim(bottom=min(0.0, axis.get_ylim()[0]))

    caption = (
        "Robot slip ratio λ_R over the steady part of each trial, its mean with the 95 % interval, and the "
        "experiment of the paper."
    )
    make = partial(_panel, draw, VELOCITY, SLIP)
    return Figure("slip_over_speed", title, caption, make, bool(answers.virtual))


def k92_figure(answers: Answers, fit: AThetaFit | None) -> Figure:
    """Draw k_92 over the desired velocity with the fitted law and the paper's: Fig. 3 of the paper."""
    number = answers.a_theta
    title = "k_92 by trial; the law could not be fitted"
    if number is not None:
        where = {
            True: "the paper's {:g} s/m lies in the interval",
            False: "the paper's {:g} s/m lies outside the interval",
            None: "these trials do not test the law",
        }[answers.a_theta_agrees].format(load_paper().a_theta)
        title = f"a_θ = {number.with_std} s/m; {where}"
    points, law = _over_speed(answers.speeds, lambda c: _usable(c.fit)), fit if number is not None else None
    draw = partial(_k92_panel, points, [s.velocity for s in answers.speeds], law)
    caption = (
        "Ratio of the rear to the front contact angle, fitted to the slip of each trial, with the law "
        "k_92 = exp(−a_θ v) and its 95 % interval. Dashed: the law of the paper (as in its Fig. 3)."
    )
    make = partial(_panel, draw, VELOCITY, RATIO)
    return Figure("k92_over_velocity", title, caption, make, bool(answers.virtual))


def fits_figure(
    fits: Sequence[tuple[float, Estimate]], virtual: bool, law: AThetaFit | None = None
) -> Figure:
    """Draw (velocity [m/s], k_92) of each trial beside the paper, with a fitted law where there is one."""
    points = [(Estimate(v, 0.0), k92, 1) for v, k92 in fits]
    draw = partial(_k92_panel, points, [v for v, _ in fits], law)
    return Figure("k92", "k_92 by trial", "", partial(_panel, draw, VELOCITY, RATIO), virtual)


def _k92_panel(points: Sequence[Point], speeds: Sequence[float], fit: AThetaFit | None, axis: Axes) -> None:
    """Draw k_92 of trials, the fitted law with its interval, and law and values of the paper."""
    paper = load_paper()
    top = max([*speeds, *(p.velocity for p in paper.table3)]) * 1.1
    v = np.linspace(0, top, 200)
    if fit is not None:
        if all(map(math.isfinite, fit.ci95)):
            low, high = (np.exp(-a * v) for a in fit.ci95)
            axis.fill_between(v, low, high, color=canvas.FITTED, alpha=0.25, linewidth=0)
        axis.plot(v, np.exp(-fit.a_theta.value * v), color=canvas.FITTED, linewidth=UNDER, label="law, 95 %")
    axis.plot(v, np.exp(-paper.a_theta * v), color=canvas.PAPER, linestyle=DASHED)
    _trials(axis, points, (1.0, 1.0))
    _published(axis, [(p.velocity, p.k92) for p in paper.table3])
    axis.set(xlim=(0, top), ylim=(-0.03, 1.03))


def k92_over_slip(answers: Answers, fit: AThetaFit | None) -> Figure:
    """Draw k_92 over the robot slip ratio with the fitted line and the paper's: Fig. 4 of the paper."""
    line, paper = fitted_line(fit), load_paper()
    root = significant(-100 * paper.fig4_intercept / paper.fig4_slope, 3)
    title = f"The paper's line reaches k_92 = 0, the limit of the model, at {root} % slip"
    if line is not None and line[1] < 0:
        fitted_root = significant(-100 * line[0] / line[1], 3)
        title = f"k_92 = 0, the limit of the model, is reached at {fitted_root} % slip; {root} % in the paper"
    slips = [p.slip_measured for p in paper.table3] + [s.slip.value / 100 for s in answers.speeds]
    x = np.linspace(0, max(0.25, 1.1 * max(s for s in slips if math.isfinite(s))), 2)

    def draw(axis: Axes) -> None:
        if line is not None:
            fitted = line[0] + line[1] * x
            axis.plot(100 * x, fitted, color=canvas.FITTED, linewidth=UNDER, label="fitted line")
        fits = [(r.fit, len(s.results)) for s in answers.speeds for r in s.results]
        _trials(axis, [(f.slip_measured, _usable(f), n) for f, n in fits], (100.0, 1.0))
        axis.plot(100 * x, paper.fig4_intercept + paper.fig4_slope * x, color=canvas.PAPER, linestyle=DASHED)
        _published(axis, [(100 * p.slip_measured, p.k92) for p in paper.table3])
        axis.axhline(0, color=canvas.INK, linewidth=0.6)
        axis.set_xlim(0, 100 * x[-1])

    caption = "k_92 of each trial over its slip ratio. Dashed: the line of the paper (as in its Fig. 4)."
    make = partial(_panel, draw, SLIP, RATIO)
    return Figure("k92_over_slip", title, caption, make, bool(answers.virtual))


def _usable(fit: K92Fit) -> Estimate:
    """Return k_92 of a trial where it is known, else NaN, which is not drawn."""
    return fit.k92 if fit.k92_known else Estimate(math.nan)


def _panel(draw: Callable[[Axes], None], x: str, y: str) -> Canvas:
    figure, (axis,) = canvas.panels([2.6])
    draw(axis)
    axis.set(xlabel=x, ylabel=y)
    canvas.legend(axis)
    return figure


def _over_speed(speeds: Sequence[Speed], value: Callable[[Comparison], Estimate]) -> list[Point]:
    return [
        (Estimate(x, 0.0), value(r), len(s.results))
        for s in speeds
        for x, r in zip(abscissae(s), s.results, strict=True)
    ]


def _trials(
    axis: Axes, points: Sequence[Point], scale: tuple[float, float], color: str = canvas.MEASURED
) -> None:
    """Draw the trials that have both numbers, with their 95 % intervals."""
    there = [p for p in points if math.isfinite(p[0].value + p[1].value)]
    for k, (x, y, n) in enumerate(there):
        axis.errorbar(
            scale[0] * x.value, scale[1] * y.value, xerr=1.96 * scale[0] * _bar(x.std) or None,
            yerr=1.96 * scale[1] * _bar(y.std), color=color, marker="o", linestyle="none",
            label="one trial, 95 %" if k == 0 else None, **_dress(n),
        )  # fmt: skip


def _published(axis: Axes, points: Sequence[tuple[float, float]]) -> None:
    """Draw values of the paper, below what was measured."""
    axis.plot(
        *zip(*points, strict=True), color=canvas.PAPER, marker="+", markersize=10, markeredgewidth=1.8,
        linestyle="none", label="paper", zorder=1.9,
    )  # fmt: skip


def fitted_line(fit: AThetaFit | None) -> tuple[float, float] | None:
    """Return intercept and slope (per unit of slip ratio) of the fitted line of Fig. 4, if there is one."""
    law = next((law for law in fit.laws if law.id == "linear_slip"), None) if fit else None
    if law is None or len(law.parameters) < 2:
        return None
    intercept, slope = list(law.parameters)[:2]
    scale = 100.0 if "%" in law.units.get(slope, "") else 1.0
    return law.parameters[intercept].value, scale * law.parameters[slope].value


def abscissae(speed: Speed) -> list[float]:
    """Return the abscissae of a speed's trials, side by side, all of them close to the speed [m/s]."""
    n = len(speed.results)
    step = min(APART, WIDE / max(1, n - 1))
    return [speed.velocity + step * (i - (n - 1) / 2) for i in range(n)]


def _dress(trials: int) -> dict[str, Any]:
    """Return sizes of a point and its bar, so that those of many trials do not become one blot."""
    if trials <= CROWD:
        return {"markersize": 3.5, "linewidth": 0.9}
    return {"markersize": 2.5, "linewidth": 0.5, "alpha": max(0.4, CROWD / trials), "markeredgewidth": 0}


def _bar(half: float) -> float:
    """Return the half length of a bar, zero where it is not known."""
    return half if math.isfinite(half) and half > 0 else 0.0
