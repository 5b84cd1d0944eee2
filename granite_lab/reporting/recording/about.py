"""The pages of text: the key to colours and arrows, and what this trial is and what came out."""

from __future__ import annotations

from typing import Any

import rerun as rr

from granite_lab import __version__
from granite_lab.comparison.record import Comparison
from granite_lab.logs.trial import Trial
from granite_lab.reporting.recording.lines import SHOWN
from granite_lab.reporting.recording.stream import drawable
from granite_lab.reporting.rounding import plus_minus, significant

VIRTUAL = "**Virtual data**: a simulator wrote the log that is called measured here.\n\n"

PLOTS = """
- **0 s**: start of the command
- **slip** has no bounds while the robot starts and stops; its plots are cut there
"""

KEY = f"""
- **solid**, blue body: measured robot
- **orange outline**: simulated robot
- **white spoke**: angle of the wheel
- **magenta arrow**: ground reaction; **green**: thrust F (14); **red**: resistance R (13); \
all simulated, 22 mm for 10 N
- **light blue arc**: drive torque, 20° for 1 N m; orange where it was not measured
- **sand**: cut open; lines 10, 20, 30 mm deep; the sinkage of both robots is simulated
- **thin lines**, blue tones: measured, with a band of ± 1 standard deviation
- **wide lines**, orange tones: simulated, drawn below the measured ones
{PLOTS.strip()}
"""

STUDY_KEY = f"""
Each row is a speed. Each tab above holds the trials of one speed.

- **thin lines**, one colour a trial: measured
- **wide orange lines**: simulated, one a trial, drawn below the measured ones
{PLOTS.strip()}
"""


def page(text: str) -> Any:
    """Return a Markdown document."""
    return rr.TextDocument(drawable(text.strip()), media_type="text/markdown")


def _plain(text: str) -> str:
    """Return text that cannot break out of a Markdown table or heading."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>#|!~" else c for c in " ".join(text.split()))


def about(trial: Trial, comparison: Comparison) -> Any:
    """Return the page of one trial as a Markdown document."""
    motion, run, fit = comparison.motion, comparison.run, comparison.fit
    kind = "**virtual**: its log was written by a simulator" if motion.virtual else "real"
    v = motion.variant
    command = f"{v.velocity:g} m/s, {v.acceleration:g} m/s², {v.distance:g} m ({motion.variant_source})"
    model = f"{run.k92_law} k_92 law, {run.k92_value:.4g}; effects: {', '.join(run.effects) or 'none'}"
    whole = f"{plus_minus(fit.k92_trajectory)} ({fit.status_trajectory.replace('_', ' ')})"
    rows = [
        ("trial", kind),
        ("robot, soil", f"{_plain(run.robot.title)}; {_plain(run.soil.title)}"),
        ("desired motion", command),
        ("slip λ_R (2), measured", plus_minus(motion.slip_ratio, "%", 100)),
        ("slip λ_R (2), simulated", f"{100 * run.slip_ratio:.1f} %"),
        ("distance, measured", plus_minus(motion.distance, "m")),
        ("k_92 by steady slip", f"{plus_minus(fit.k92)} ({fit.status.replace('_', ' ')})"),
        ("k_92 by whole trajectory", whole),
        ("simulated with", _plain(model)),
        ("filter", _plain(motion.health.verdict)),
        ("written by", f"granite-lab {__version__}"),
    ]
    text = [f"# {_plain(trial.name)}", "", "| what | value |", "|---|---|"]
    text += [f"| {a} | {b} |" for a, b in rows]
    text += ["", "### Simulated minus measured, whole trial", ""]
    text += ["| channel | rms | mean | largest | unit |", "|---|---|---|---|---|"]
    for m in (m for m in comparison.misfits if m.phase == "all"):
        unit, factor = SHOWN.get(m.unit or "-", (m.unit, 1.0))
        values = " | ".join(significant(factor * value) for value in (m.rms, m.bias, m.peak))
        text.append(f"| {_plain(m.channel)} | {values} | {unit} |")
    if motion.warnings:
        text += ["", "### Warnings", "", *(f"- {_plain(w)}" for w in motion.warnings)]
    return page("\n".join(text))


def properties(trial: Trial, comparison: Comparison) -> Any:
    """Return what a program should know of a trial without reading its samples; units in the names."""
    motion, run, fit = comparison.motion, comparison.run, comparison.fit
    slip = motion.slip_ratio
    return rr.AnyValues(
        name=trial.name, virtual=motion.virtual, version=__version__,
        robot=run.robot.name, soil=run.soil.name, effects=list(run.effects) or ["none"],
        variant_mps=motion.variant.velocity, acceleration_mps2=motion.variant.acceleration,
        distance_m=motion.variant.distance, command_start_s=motion.t_start.value,
        slip_ratio_measured=slip.value, slip_ratio_measured_std=slip.std, slip_ratio_simulated=run.slip_ratio,
        k92=fit.k92.value, k92_std=fit.k92.std, k92_status=fit.status,
        k92_trajectory=fit.k92_trajectory.value, k92_trajectory_std=fit.k92_trajectory.std,
        inputs_sha256=[file.sha256 for file in trial.inputs] or ["none"],
    )  # fmt: skip
