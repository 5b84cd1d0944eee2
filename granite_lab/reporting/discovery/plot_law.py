"""What the missing force, moment or torque looks like where no candidate explains it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from granite_lab.discovery.empirical import TARGETS, TERMS
from granite_lab.discovery.finding import Finding, FoundEffect
from granite_lab.errors import LabError
from granite_lab.logs.trial import Array
from granite_lab.model import simulate
from granite_lab.model.run import Run
from granite_lab.parameters import Variant, load_variants
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Drawing
from granite_lab.reporting.discovery.names import LAW as NAMES
from granite_lab.reporting.rounding import significant, with_unit

BY = {
    "motion": "constant while moving",
    "velocity": "with the speed of the robot",
    "velocity_squared": "with the square of that speed",
    "slip": "with slip",
    "sinking": "with the rate of sinking",
    "start": "over the first 0.2 m",
    "distance": "with the distance",
    "cos_angle": "with the cosine of the wheel's angle",
    "sin_angle": "with the sine of the wheel's angle",
    "time": "with time",
}
FORMULAS = {
    "motion": "",
    "velocity": "v / (0.5 m/s)",
    "velocity_squared": "(v / (0.5 m/s))²",
    "slip": "s / 0.2",
    "sinking": "(dz/dt) / (20 mm/s)",
    "start": "exp(−x / 0.2 m)",
    "distance": "x / (1 m)",
    "cos_angle": "cos θ",
    "sin_angle": "sin θ",
    "time": "t / (5 s)",
}
COLOURS = (canvas.MEASURED_LIGHT, canvas.SIMULATED_LIGHT, canvas.FITTED, canvas.PAPER, canvas.MEASURED)


def law_of(finding: Finding) -> FoundEffect | None:
    """Return the empirical law of a finding, if it holds one."""
    return next((e for e in finding.effects if e.empirical), None)


def split(name: str) -> tuple[str, str]:
    """Return target and term of a parameter of the law, as in "torque_f_slip"."""
    target = next(t for t in TARGETS if name.startswith(f"{t}_"))
    return target, name.removeprefix(f"{target}_")


def law_formulas(finding: Finding) -> tuple[str, ...]:
    """Return the law as one formula per quantity, with its numbers."""
    law = law_of(finding)
    if law is None:
        return ()
    sums: dict[str, str] = {}
    for p in law.parameters:
        if p.estimate.value == 0:
            continue
        target, term = split(p.name)
        number = with_unit(significant(abs(p.estimate.value), 3), p.unit)
        sign = "−" if p.estimate.value < 0 else "+"
        part = f"{number} · {FORMULAS.get(term, term)}" if FORMULAS.get(term, term) else number
        sums[target] = f"{sums[target]} {sign} {part}" if target in sums else f"{sign.strip('+')}{part}"
    return tuple(f"{NAMES[target]} = {text}" for target, text in sums.items())


def law_drawing(finding: Finding) -> Drawing | None:
    """Draw the law over time at each speed; None where there is none or it cannot be simulated."""
    law = law_of(finding)
    if law is None:
        return None
    targets = [t for t in TARGETS if any(split(p.name)[0] == t for p in law.parameters)]
    try:
        runs = [_run(v, finding) for v in _variants(finding)]
    except LabError:
        return None
    if not targets or not runs:
        return None
    figure, axes = canvas.stacked([1.05] * len(targets), [2] + [1] * (len(targets) - 1))
    largest: dict[str, float] = {}
    with canvas.styled():
        for axis, target in zip(axes, targets, strict=True):
            own = {split(p.name)[1]: p.estimate.value for p in law.parameters if split(p.name)[0] == target}
            for run, colour in zip(runs, COLOURS, strict=False):
                values = _evaluate(run, own, "r" if target == "torque_r" else "f")
                largest[target] = max(largest.get(target, 0.0), float(np.abs(values).max()))
                axis.plot(run.t, values, color=colour, label=f"{run.variant.velocity:g} m/s")
            axis.text(0, 1.03, NAMES[target], transform=axis.transAxes, fontsize=8, va="bottom")
            axis.set_ylabel(f"[{TARGETS[target][0]}]")
            axis.yaxis.set_major_locator(MaxNLocator(4))
        axes[-1].set_xlabel("time since the start of the command [s]")
        axes[0].set_xlim(-0.5, max(float(r.t[-1]) for r in runs))
        canvas.legend_above(axes[0], 4)
        legend = axes[0].get_legend()
        assert legend is not None
        legend.set_bbox_to_anchor((-0.02, 1.0 + canvas.LEGEND_ROW / 1.05))
        canvas.align_labels(axes)
        canvas.mark_virtual(figure, finding.virtual)
    sizes = ", ".join(f"{NAMES[t]} up to {significant(v, 2)} {TARGETS[t][0]}" for t, v in largest.items())
    return Drawing(
        "found_law",
        f"What is missing, as an empirical law{canvas.data_tag(finding.virtual)}",
        f"Not a physical effect, but what would have to be added to the model to meet these trials: {sizes}.",
        "Force, moment and torques of the empirical law over time at each speed.",
        figure,
    )


def _variants(finding: Finding) -> list[Variant]:
    """Return the commands of Table 2 at the speeds of the trials."""
    speeds = {round(r.variant, 2) for r in finding.residuals}
    return [v for v in load_variants() if round(v.velocity, 2) in speeds][: len(COLOURS)]


def _run(variant: Variant, finding: Finding) -> Run:
    return simulate(variant, finding.robot, finding.soil)


def _evaluate(run: Run, amounts: dict[str, float], axle: str) -> Array:
    """Return the sum of the law's terms over a run, faded out at standstill as in the model."""
    import casadi as ca  # noqa: PLC0415

    from granite_lab.model.command import V_FLOOR, smoothstep  # noqa: PLC0415

    def row(values: Array) -> Any:
        return ca.DM(np.asarray(values)[None, :])

    sinkage = run[f"sinkage_{axle}_m"]
    state: Any = SimpleNamespace(
        velocity=row(run["v_mps"]),
        slip=row(run[f"slip_{axle}"]),
        sinkage_rate=row(np.gradient(sinkage, run.t)),
        travel=row(run["x_m"]),
        angle=row(run[f"theta_{axle}_rad"]),
    )
    moving = smoothstep(ca.fabs(row(run[f"v_wheel_{axle}_mps"])) / (2 * V_FLOOR))
    total = sum(a * TERMS[term](state, row(run.t)) for term, a in amounts.items())
    return np.asarray((moving * total).full()).ravel()
