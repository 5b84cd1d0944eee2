"""Slip and k_92 over speed, and k_92 over slip, beside the paper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import AThetaFit
from granite_lab.parameters import Paper
from granite_lab.reporting import canvas
from granite_lab.reporting.answers import Answers
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.rounding import significant
from granite_lab.reporting.summary import Speed

PANEL = [2.6]
APART, WIDE = 0.008, 0.05
"""Abscissae of the trials of a speed [m/s]: from one to the next, and from first to last at most."""
CROWD = 12
"""So many trials of a speed are drawn in full; more are drawn smaller and fainter."""
PAPER: dict[str, Any] = {"color": canvas.PAPER, "marker": "+", "markersize": 10, "markeredgewidth": 1.8}


def slip_figure(answers: Answers, speeds: Sequence[Speed], paper: Paper) -> Figure:
    """Draw λ_R over the desired velocity: each trial, the means with their intervals, and the paper."""
    known = [s for s in answers.speeds if math.isfinite(s.slip.value)]
    title = "Slip ratio at the speed of the trials"
    if len(known) > 1:
        rising = all(a.slip.value < b.slip.value for a, b in pairwise(known))
        title = "Slip grows with speed" if rising else "Slip does not grow steadily with speed"
    judged = [s for s in known if s.agrees is not None]
    if judged:
        inside = sum(bool(s.agrees) for s in judged)
        title += f"; the paper's experiment is in the interval at {inside} of {len(judged)} speeds"
    return Figure(
        "slip_over_speed", title,
        "Robot slip ratio λ_R over the steady part of each trial, its mean with the 95 % interval, and the "
        "experiment of the paper.",
        "Robot slip ratio over desired velocity: trials, means with 95 % intervals, and the paper's "
        "experiment.",
        partial(_slip, answers, speeds, paper), bool(answers.virtual),
    )  # fmt: skip


def _slip(answers: Answers, speeds: Sequence[Speed], paper: Paper) -> Canvas:
    figure, (axis,) = canvas.stacked(PANEL, [1])
    with canvas.styled():
        for i, speed in enumerate(speeds):
            estimates = [r.comparison.motion.slip_ratio for r in speed.results]
            for j, (x, slip) in enumerate(zip(spread(speed), estimates, strict=True)):
                if math.isfinite(slip.value):
                    axis.errorbar(
                        x, 100 * slip.value, yerr=196 * _bar(slip.std), color=canvas.MEASURED_LIGHT,
                        marker="o",
                        linestyle="none", label="one trial" if i + j == 0 else None, **dress(len(estimates)),
                    )  # fmt: skip
        means = [s for s in answers.speeds if math.isfinite(s.slip.value)]
        for k, s in enumerate(means):
            bars = [[_bar(s.slip.value - s.slip.low)], [_bar(s.slip.high - s.slip.value)]]
            axis.errorbar(
                s.velocity, s.slip.value, yerr=bars, color=canvas.MEASURED, marker="D", markersize=4.5,
                capsize=4,
                linewidth=1.4, label="mean, 95 %" if k == 0 else None,
            )  # fmt: skip
        axis.plot(
            [p.velocity for p in paper.table3], [100 * p.slip_measured for p in paper.table3],
            linestyle="none",
            label="paper", zorder=5, **PAPER,
        )  # fmt: skip
        _frame(axis, "desired velocity [m/s]", "robot slip ratio [%]")
        axis.set_xlim(left=0)
        axis.set_ylim(bottom=min(0.0, axis.get_ylim()[0]))
        canvas.legend_above(axis)
        canvas.mark_virtual(figure, bool(answers.virtual))
    return figure


def k92_figure(answers: Answers, result: StudyResult, speeds: Sequence[Speed], paper: Paper) -> Figure:
    """Draw k_92 over the desired velocity with the fitted law and the paper's: Fig. 3 of the paper."""
    number = answers.a_theta
    title = "k_92 by trial; the law could not be fitted"
    if number is not None:
        where = {
            True: "the paper's {:g} s/m lies in the interval",
            False: "the paper's {:g} s/m lies outside the interval",
            None: "fewer than three speeds do not test the law",
        }[answers.a_theta_agrees].format(answers.a_theta_paper)
        title = f"a_θ = {number.with_std} s/m; {where}"
    return Figure(
        "k92_over_velocity", title,
        "Ratio of the rear to the front contact angle, fitted to the slip of each trial, with the law "
        "k_92 = exp(−a_θ v) and its 95 % interval (as Fig. 3 of the paper).",
        "Contact-angle ratio k92 over desired velocity: trials, fitted exponential law with its 95 % "
        "interval, "
        "the paper's law and values.",
        partial(_k92, answers, result, speeds, paper), bool(answers.virtual),
    )  # fmt: skip


def _k92(answers: Answers, result: StudyResult, speeds: Sequence[Speed], paper: Paper) -> Canvas:
    figure, (axis,) = canvas.stacked(PANEL, [1])
    top = max([s.velocity for s in speeds] + [p.velocity for p in paper.table3]) * 1.1
    v = np.linspace(0, top, 200)
    fit = result.a_theta
    with canvas.styled():
        if fit is not None and math.isfinite(fit.a_theta.value):
            if all(map(math.isfinite, fit.ci95)):
                low, high = (np.exp(-a * v) for a in fit.ci95)
                axis.fill_between(v, low, high, color=canvas.FITTED, alpha=0.25, linewidth=0)
            axis.plot(v, np.exp(-fit.a_theta.value * v), color=canvas.FITTED, label="law, 95 %")
        axis.plot(v, np.exp(-paper.a_theta * v), color=canvas.PAPER, linestyle=(0, (4, 1.5)))
        first = True
        for speed in speeds:
            for x, trial in zip(spread(speed), speed.results, strict=True):
                k92, inner = trial.comparison.fit.k92, trial.comparison.fit.status == "ok"
                if math.isfinite(k92.value):
                    axis.errorbar(
                        x, k92.value, yerr=1.96 * _bar(k92.std), color=canvas.MEASURED,
                        marker="o" if inner else "v",
                        linestyle="none", label="one trial, 95 %" if first and inner else None,
                        **dress(len(speed.results)),
                    )  # fmt: skip
                    first = first and not inner
        axis.plot(
            [p.velocity for p in paper.table3], [p.k92 for p in paper.table3], linestyle=(0, (4, 1.5)),
            label="paper", zorder=5, linewidth=0, **PAPER,
        )  # fmt: skip
        _frame(axis, "desired velocity [m/s]", "contact-angle ratio k₉₂ [–]")
        axis.set_xlim(0, top)
        axis.set_ylim(-0.03, 1.03)
        canvas.legend_above(axis)
        canvas.mark_virtual(figure, bool(answers.virtual))
    return figure


def k92_over_slip(answers: Answers, result: StudyResult, speeds: Sequence[Speed], paper: Paper) -> Figure:
    """Draw k_92 over the robot slip ratio with the fitted line and the paper's: Fig. 4 of the paper."""
    line = fitted_line(result.a_theta)
    root = significant(-100 * paper.fig4_intercept / paper.fig4_slope, 3)
    title = f"The paper's line reaches k_92 = 0, the limit of the model, at {root} % slip"
    if line is not None and line[1].value < 0:
        own = significant(-100 * line[0].value / line[1].value, 3)
        title = f"k_92 = 0, the limit of the model, is reached at {own} % slip; {root} % in the paper"
    return Figure(
        "k92_over_slip", title, "k_92 of each trial over its slip ratio (as Fig. 4 of the paper).",
        "Contact-angle ratio k92 over robot slip ratio: trials, fitted line, the paper's line and values.",
        partial(_over_slip, answers, result, speeds, paper), bool(answers.virtual),
    )  # fmt: skip


def _over_slip(answers: Answers, result: StudyResult, speeds: Sequence[Speed], paper: Paper) -> Canvas:
    figure, (axis,) = canvas.stacked(PANEL, [1])
    line = fitted_line(result.a_theta)
    slips = [p.slip_measured for p in paper.table3] + [s.slip.value for s in speeds]
    x = np.linspace(0, max(0.25, 1.1 * max(s for s in slips if math.isfinite(s))), 2)
    with canvas.styled():
        if line is not None:
            axis.plot(100 * x, line[0].value + line[1].value * x, color=canvas.FITTED, label="fitted line")
        own = paper.fig4_intercept + paper.fig4_slope * x
        axis.plot(100 * x, own, color=canvas.PAPER, linestyle=(0, (4, 1.5)))
        first = True
        for trial, trials in ((t, len(s.results)) for s in speeds for t in s.results):
            k92, slip = trial.comparison.fit.k92, trial.comparison.fit.slip_measured
            if math.isfinite(k92.value + slip.value):
                axis.errorbar(
                    100 * slip.value, k92.value, xerr=196 * _bar(slip.std), yerr=1.96 * _bar(k92.std),
                    color=canvas.MEASURED, marker="o", linestyle="none",
                    label="one trial, 95 %" if first else None, **dress(trials),
                )  # fmt: skip
                first = False
        axis.plot(
            [100 * p.slip_measured for p in paper.table3], [p.k92 for p in paper.table3],
            linestyle=(0, (4, 1.5)),
            label="paper", zorder=5, linewidth=0, **PAPER,
        )  # fmt: skip
        axis.axhline(0, color=canvas.INK, linewidth=0.6)
        _frame(axis, "robot slip ratio [%]", "contact-angle ratio k₉₂ [–]")
        axis.set_xlim(0, 100 * x[-1])
        canvas.legend_above(axis)
        canvas.mark_virtual(figure, bool(answers.virtual))
    return figure


def fitted_line(fit: AThetaFit | None) -> tuple[Estimate, Estimate] | None:
    """Return intercept and slope (per unit of slip ratio) of the fitted line of Fig. 4, if there is one."""
    law = next((law for law in fit.laws if law.id == "linear_slip"), None) if fit else None
    if law is None or len(law.parameters) < 2:
        return None
    intercept, slope = list(law.parameters)[:2]
    scale = 100.0 if "%" in law.units.get(slope, "") else 1.0
    b1 = law.parameters[slope]
    return law.parameters[intercept], Estimate(b1.value * scale, b1.std * scale)


def spread(speed: Speed) -> list[float]:
    """Return the abscissae of a speed's trials, side by side, all of them close to the speed [m/s]."""
    n = len(speed.results)
    step = min(APART, WIDE / max(1, n - 1))
    return [speed.velocity + step * (i - (n - 1) / 2) for i in range(n)]


def dress(trials: int) -> dict[str, Any]:
    """Return sizes of a point and its bar, so that those of many trials do not become one blot."""
    if trials <= CROWD:
        return {"markersize": 3.5, "linewidth": 0.9}
    return {"markersize": 2.5, "linewidth": 0.5, "alpha": max(0.4, CROWD / trials), "markeredgewidth": 0}


def _bar(half: float) -> float:
    """Return the half length of a bar, zero where it is not known."""
    return half if math.isfinite(half) and half > 0 else 0.0


def _frame(axis: Axes, x: str, y: str) -> None:
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    canvas.align_labels([axis])
