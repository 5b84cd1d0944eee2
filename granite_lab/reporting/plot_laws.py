"""The ratio k_92 over velocity and over slip, as in Figs. 3 and 4 of the paper."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from granite_lab.estimate import Estimate
from granite_lab.fitting.fit import AThetaFit, Law
from granite_lab.parameters import Paper
from granite_lab.reporting import canvas
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.points import bar, dress, frame, markers, point, spread
from granite_lab.reporting.rounding import interval, plus_minus, significant
from granite_lab.reporting.summary import Speed

PANEL = [2.6]


def k92_over_velocity(result: StudyResult, speeds: Sequence[Speed], paper: Paper) -> Figure:
    """Draw Fig. 3: k_92 over the desired velocity with the fitted law and the paper's."""
    figure, (axis,) = canvas.stacked(PANEL, [3])
    top = max([s.velocity for s in speeds] + [p.velocity for p in paper.table3]) * 1.1
    v = np.linspace(0, top, 200)
    fit = result.a_theta
    with canvas.styled():
        if fit is not None and math.isfinite(fit.a_theta.value):
            low, high = fit.ci95
            if math.isfinite(low) and math.isfinite(high):
                axis.fill_between(
                    v, np.exp(-high * v), np.exp(-low * v), color=canvas.FITTED, alpha=0.25, linewidth=0
                )
            axis.plot(v, np.exp(-fit.a_theta.value * v), color=canvas.FITTED, label="fitted law, 95 %")
        axis.plot(
            v, np.exp(-paper.a_theta * v), color=canvas.PAPER, linestyle=(0, (4, 1.5)), label="paper's law"
        )
        first = True
        for speed in speeds:
            for x, trial in zip(spread(speed), speed.results, strict=True):
                k92 = trial.comparison.fit.k92
                hit = trial.comparison.fit.status != "ok"
                point(
                    axis,
                    x,
                    k92.value,
                    1.96 * k92.std,
                    canvas.MEASURED,
                    "v" if hit else "o",
                    len(speed.results),
                    "a trial, 95 %" if first and not hit else None,
                )
                first = first and hit
        markers(
            axis, [(p.velocity, p.k92) for p in paper.table3], canvas.PAPER, "+", "paper's values", 10, 1.8
        )
        frame(axis, "desired velocity [m/s]", "contact angle ratio k₉₂ [–]")
        axis.set_xlim(0, top)
        axis.set_ylim(-0.03, 1.03)
        canvas.legend_above(axis, 2)
        canvas.mark_virtual(figure, result.virtual)
    return Figure(
        "k92_over_velocity",
        f"k_92 over desired velocity, as Fig. 3 of the paper{canvas.data_tag(result.virtual)}",
        _describe_law(fit),
        "Contact angle ratio k92 over desired velocity: trials, fitted exponential law with its 95 % "
        "band, the paper's law and values.",
        lambda: figure,
    )  # fmt: skip


def _describe_law(fit: AThetaFit | None) -> str:
    if fit is None:
        return "Too few trials for a law of their own: the paper's law is drawn alone."
    where = "inside" if fit.agrees else "outside"
    return (
        f"k_92 = exp(−a_θ v) with a_θ = {plus_minus(fit.a_theta, 's/m')}; the paper's {fit.published:g} "
        f"s/m lies {where} "
        f"the 95 % interval ({interval(*fit.ci95)})."
    )


def k92_over_slip(result: StudyResult, speeds: Sequence[Speed], paper: Paper) -> Figure:
    """Draw Fig. 4: k_92 over the robot slip ratio with the fitted line and the paper's."""
    figure, (axis,) = canvas.stacked(PANEL, [3])
    line = fitted_line(result.a_theta)
    slips = [p.slip_measured for p in paper.table3] + [
        s.slip.value for s in speeds if math.isfinite(s.slip.value)
    ]
    x = np.linspace(0, max(0.25, 1.1 * max(slips)), 2)
    with canvas.styled():
        if line is not None:
            axis.plot(100 * x, line[0].value + line[1].value * x, color=canvas.FITTED, label="fitted line")
        axis.plot(
            100 * x,
            paper.fig4_intercept + paper.fig4_slope * x,
            color=canvas.PAPER,
            linestyle=(0, (4, 1.5)),
            label="paper's line",
        )
        first = True
        for trial, trials in ((t, len(s.results)) for s in speeds for t in s.results):
            fit = trial.comparison.fit
            if math.isfinite(fit.k92.value) and math.isfinite(fit.slip_measured.value):
                axis.errorbar(
                    100 * fit.slip_measured.value, fit.k92.value, xerr=196 * bar(fit.slip_measured.std),
                    yerr=1.96 * bar(fit.k92.std),
                    color=canvas.MEASURED, marker="o", linestyle="none",
                    label="a trial, 95 %" if first else None, **dress(trials),
                )  # fmt: skip
                first = False
        markers(
            axis,
            [(100 * p.slip_measured, p.k92) for p in paper.table3],
            canvas.PAPER,
            "+",
            "paper's values",
            10,
            1.8,
        )
        axis.axhline(0, color=canvas.INK, linewidth=0.6)
        frame(axis, "robot slip ratio [%]", "contact angle ratio k₉₂ [–]")
        axis.set_xlim(0, 100 * x[-1])
        canvas.legend_above(axis, 2)
        canvas.mark_virtual(figure, result.virtual)
    return Figure(
        "k92_over_slip",
        f"k_92 over robot slip ratio, as Fig. 4 of the paper{canvas.data_tag(result.virtual)}",
        _describe_line(line, paper),
        "Contact angle ratio k92 over robot slip ratio: trials, fitted line, the paper's line and values.",
        lambda: figure,
    )  # fmt: skip


def fitted_line(fit: AThetaFit | None) -> tuple[Estimate, Estimate] | None:
    """Return intercept and slope (per unit of slip ratio) of the fitted line of Fig. 4, if there is one."""
    law: Law | None = next((law for law in fit.laws if law.id == "linear_slip"), None) if fit else None
    if law is None or len(law.parameters) < 2:
        return None
    intercept, slope = list(law.parameters)[:2]
    scale = 100.0 if "%" in law.units.get(slope, "") else 1.0
    b1 = law.parameters[slope]
    return law.parameters[intercept], Estimate(b1.value * scale, b1.std * scale)


def _describe_line(line: tuple[Estimate, Estimate] | None, paper: Paper) -> str:
    at = f"{significant(-100 * paper.fig4_intercept / paper.fig4_slope, 4)} %"
    if line is None or not line[1].value < 0:
        return f"The paper's line reaches k_92 = 0, where the model ends, at {at} slip."
    root = significant(-100 * line[0].value / line[1].value, 3)
    return f"The fitted line reaches k_92 = 0, where the model ends, at {root} % slip; the paper's at {at}."
