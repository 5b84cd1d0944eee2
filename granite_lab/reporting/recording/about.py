"""The page beside the log: what this trial is, what came out, and how to read the 3D view."""

from __future__ import annotations

from typing import Any

import rerun as rr

from granite_lab import __version__
from granite_lab.comparison.record import Comparison
from granite_lab.estimate import Estimate
from granite_lab.logs.trial import Trial

KEY = """
### The 3D view

| what | how it is drawn |
|---|---|
| measured robot | blue, solid: distance and pitch as estimated, wheels as their encoders read |
| simulated robot | orange edges and a translucent body; hidden inside the measured one where both agree |
| sinkage | **simulated, for both robots**: nothing on the robot measures it |
| sand | cut away in front of its near edge; lines on the cut 10, 20 and 30 mm deep, a tick each 0.25 m |
| ground reaction | magenta arrow at the near wheels, simulated, 22 mm for 10 N |
| thrust F (14), resistance R (13) | green and red arrow, simulated, same scale |
| drive torque | light blue arc on the near wheels as measured, orange if only simulated; 20° for 1 N m |

The white spoke shows how far a wheel has turned. All plots share their time axis: zero is the start of
the command. All numbers are in SI units.
"""


def _plain(text: str) -> str:
    """Return text that cannot break out of a Markdown table or heading."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>#|!~" else c for c in " ".join(text.split()))


def _show(estimate: Estimate, digits: int, unit: str = "") -> str:
    return f"{estimate.value:.{digits}f} ± {estimate.std:.{digits}f}{unit}"


def about(trial: Trial, comparison: Comparison) -> Any:
    """Return the page of one trial as a Markdown document."""
    motion, run, fit = comparison.motion, comparison.run, comparison.fit
    kind = "**virtual**: its log was written by a simulator" if motion.virtual else "real"
    v = motion.variant
    rows = [
        ("trial", kind),
        ("robot, soil", f"{_plain(run.robot.title)}; {_plain(run.soil.title)}"),
        (
            "desired motion",
            f"{v.velocity:g} m/s, {v.acceleration:g} m/s², {v.distance:g} m ({motion.variant_source})",
        ),
        ("slip ratio λ_R (2), measured", _show(motion.slip_ratio, 4)),
        ("slip ratio λ_R (2), simulated", f"{run.slip_ratio:.4f}"),
        ("distance, measured", _show(motion.distance, 3, " m")),
        ("k_92 by steady slip", f"{_show(fit.k92, 4)} ({fit.status.replace('_', ' ')})"),
        (
            "k_92 by whole trajectory",
            f"{_show(fit.k92_trajectory, 4)} ({fit.status_trajectory.replace('_', ' ')})",
        ),
        (
            "simulated with",
            f"{run.k92_law} k_92 law, {run.k92_value:.4g}; effects: {', '.join(run.effects) or 'none'}",
        ),
        ("filter", _plain(motion.health.verdict)),
        ("written by", f"granite-lab {__version__}"),
    ]
    text = [
        f"# {_plain(trial.name)}",
        "",
        "| what | value |",
        "|---|---|",
        *(f"| {a} | {b} |" for a, b in rows),
    ]
    text += ["", "### Simulated minus measured, whole trial", "", "| channel | rms | mean | largest | unit |"]
    text += ["|---|---|---|---|---|"]
    text += [
        f"| {_plain(m.channel)} | {m.rms:.3g} | {m.bias:.3g} | {m.peak:.3g} | {m.unit or '-'} |"
        for m in comparison.misfits
        if m.phase == "all"
    ]
    if motion.warnings:
        text += ["", "### Warnings", "", *(f"- {_plain(w)}" for w in motion.warnings)]
    return rr.TextDocument("\n".join(text) + "\n" + KEY, media_type="text/markdown")


def properties(trial: Trial, comparison: Comparison) -> Any:
    """Return what a program should know of a trial without reading its samples; units in the names."""
    motion, run, fit = comparison.motion, comparison.run, comparison.fit
    return rr.AnyValues(
        name=trial.name,
        virtual=motion.virtual,
        version=__version__,
        robot=run.robot.name,
        soil=run.soil.name,
        variant_mps=motion.variant.velocity,
        acceleration_mps2=motion.variant.acceleration,
        distance_m=motion.variant.distance,
        command_start_s=motion.t_start.value,
        slip_ratio_measured=motion.slip_ratio.value,
        slip_ratio_measured_std=motion.slip_ratio.std,
        slip_ratio_simulated=run.slip_ratio,
        k92=fit.k92.value,
        k92_std=fit.k92.std,
        k92_status=fit.status,
        k92_trajectory=fit.k92_trajectory.value,
        k92_trajectory_std=fit.k92_trajectory.std,
        effects=list(run.effects) or ["none"],
        inputs_sha256=[file.sha256 for file in trial.inputs] or ["none"],
    )
