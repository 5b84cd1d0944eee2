"""What the missing force, moment or torque looks like where no candidate explains it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from granite_lab.discovery.empirical import TARGETS, TERMS
from granite_lab.discovery.finding import Finding, FoundParameter
from granite_lab.errors import LabError
from granite_lab.logs.trial import Array
from granite_lab.model import simulate
from granite_lab.model.run import Run
from granite_lab.parameters import Variant, load_variants
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import Drawing
from granite_lab.reporting.discovery.names import LAW, term_of
from granite_lab.reporting.rounding import significant, with_unit

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


def law_of(finding: Finding) -> dict[str, dict[str, FoundParameter]]:
    """Return target to term to amount of the empirical law; empty where a finding holds none."""
    law: dict[str, dict[str, FoundParameter]] = {}
    for e in finding.effects:
        term = term_of(e.id) if e.empirical else None
        if term is not None and e.parameters:
            law.setdefault(term[0], {})[term[1]] = e.parameters[0]
    return {target: law[target] for target in TARGETS if target in law}


def law_formulas(finding: Finding) -> tuple[str, ...]:
    """Return the law as one formula per quantity, with its numbers."""
    lines = []
    for target, terms in law_of(finding).items():
        text = ""
        for term, p in terms.items():
            number = with_unit(significant(abs(p.estimate.value), 3), p.unit)
            sign = "−" if p.estimate.value < 0 else "+"
            part = f"{number} · {FORMULAS[term]}" if FORMULAS.get(term) else number
            text += f" {sign} {part}" if text else f"{sign.strip('+')}{part}"
        lines.append(f"{LAW[target]} = {text}")
    return tuple(lines)


def law_drawing(finding: Finding) -> Drawing | None:
    """Draw the law over time at each speed; None where there is none or it cannot be simulated."""
    law = law_of(finding)
    if not law:
        return None
    try:
        runs = [simulate(v, finding.robot, finding.soil) for v in _variants(finding)]
    except LabError:
        return None
    if not runs:
        return None
    figure, axes = canvas.stacked([1.05] * len(law), [2] + [1] * (len(law) - 1))
    largest: dict[str, float] = {}
    with canvas.styled():
        for axis, (target, terms) in zip(axes, law.items(), strict=True):
            own = {term: p.estimate.value for term, p in terms.items()}
            for run, colour in zip(runs, COLOURS, strict=False):
                values = _evaluate(run, own, "r" if target == "torque_r" else "f")
                largest[target] = max(largest.get(target, 0.0), float(np.abs(values).max()))
                axis.plot(run.t, values, color=colour, label=f"{run.variant.velocity:g} m/s")
            axis.text(0, 1.03, LAW[target], transform=axis.transAxes, fontsize=8, va="bottom")
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
    sizes = ", ".join(f"{LAW[t]} up to {significant(v, 2)} {TARGETS[t][0]}" for t, v in largest.items())
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
