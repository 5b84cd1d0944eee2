"""`explore.html`: each quantity of each trial over time, to zoom into, with its values under the pointer.

The page holds the numbers of its lines and Plotly's program, so that it works from disk and offline.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from plotly.offline import get_plotlyjs  # type: ignore[import-untyped]

from granite_lab.comparison.compare import STANDSTILL, UNITS, Comparison, simulated_channels, standstill_mean
from granite_lab.discovery.finding import Finding
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array
from granite_lab.model.simulator import simulate
from granite_lab.parameters import WHEELS, by_speed
from granite_lab.processes import forked_map
from granite_lab.reporting.canvas import extremes
from granite_lab.reporting.names import SENSORS, sensor, with_effects
from granite_lab.reporting.plot_motion import shown_channel
from granite_lab.reporting.render import rendered
from granite_lab.results import CHANNELS, StudyResult
from granite_lab.rounding import axis_unit, shown_as

POINTS, FEWEST = 900, 150
"""Usual number of points of a line, and the least number where there are many trials."""
FULL = 12
"""Largest number of trials whose lines have `POINTS` points; with more trials each line has fewer."""
MOST = 120
"""Largest number of trials on the page; of each speed the first ones are taken."""

READ = ("torque_f", "torque_r", "accel", "pitch_rate")
"""Channels of a comparison that a sensor reads; the others are estimated from several."""
WHEEL_NAMES = dict(zip(WHEELS, ("front left", "front right", "rear left", "rear right"), strict=True))


class Curves(NamedTuple):
    """A quantity of a trial, in the unit of its record.

    Attributes:
        id, name, unit: of the quantity.
        read: a sensor read it; else it is estimated.
        t: (N,) time since the start of the command [s].
        measured, std, simulated: (N,); NaN where nothing is known.
        augmented: (N,) simulated by the model with what was found; None without any.
        raw: stamps and values of the sensor behind an estimate; None where there is no single one.
    """

    id: str
    name: str
    unit: str
    read: bool
    t: Array
    measured: Array
    std: Array
    simulated: Array
    augmented: Array | None = None
    raw: tuple[Array, Array] | None = None


def explore_data(result: StudyResult, jobs: int = 1) -> dict[str, Any]:
    """Return what the page shows of a study, ready for JSON; `jobs` as in `processes.forked_map`."""
    shown = _shown(result.trials)
    points = max(FEWEST, POINTS * FULL // max(FULL, len(shown)))
    rows = forked_map(_packed, (result, shown, points), len(shown), "thinned lines", jobs=jobs, few=2)
    trials = [row for row in rows if row["curves"]]
    quantities: dict[str, dict[str, Any]] = {}
    for row in trials:
        for id_, packed in row["curves"].items():
            quantities.setdefault(id_, packed.pop("about"))
    order = [*UNITS, *(f"search_{name}" for name in SENSORS), *sorted(quantities)]
    named = {id_: quantities[id_] for id_ in sorted(quantities, key=order.index)}
    left = len(result.trials) - len(trials)
    return {
        "kind": "virtual" if result.virtual else "measured", "quantities": named, "trials": trials,
        "left": left,
        "found": with_effects(result.finding) if result.finding and result.finding.terms else "",
    }  # fmt: skip


def to_explore(result: StudyResult, name: str, jobs: int = 1) -> str:
    """Return the page of a study that is called `name`; `jobs` as in `processes.forked_map`."""
    data = explore_data(result, jobs)
    script, program = Markup(as_script(data)), Markup(get_plotlyjs())
    return rendered("explore.html", name=name, data=data, script=script, plotly=program)


def _shown(trials: Sequence[Comparison]) -> list[Comparison]:
    """Return the trials of the page, slow ones first: all, or of each speed equally many."""
    speeds = by_speed(r.motion.variant.velocity for r in trials)
    each = max(1, MOST // max(1, len(speeds))) if len(trials) > MOST else len(trials)
    return [trials[i] for positions in speeds.values() for i in positions[:each]]


def _packed(given: tuple[StudyResult, Sequence[Comparison], int], k: int) -> dict[str, Any]:
    """Return trial number `k` for JSON, its lines thinned."""
    result, shown, points = given
    c = shown[k]
    curves = [*_motion_curves(c, result.finding), *_search_curves(c, result.finding)]
    steady = [x if math.isfinite(x) else None for x in c.run.steady]
    return {
        "name": c.trial.name, "speed": float(f"{c.motion.variant.velocity:.3g}"), "steady": steady,
        "good": c.motion.health.good, "curves": {signal.id: _thin(signal, points) for signal in curves},
    }  # fmt: skip


def _motion_curves(c: Comparison, finding: Finding | None) -> Iterator[Curves]:
    """Yield the channels of a comparison."""
    later = _augmented(c, finding)
    for name in (n for n in UNITS if n in c.measured):
        value, std = shown_channel(c, "measured", name)
        simulated = shown_channel(c, "simulated", name)[0]
        augmented = None if later is None else shown_channel(later, "simulated", name)[0]
        words = CHANNELS.get(name) or f"{WHEEL_NAMES[name.removeprefix('wheel_')]} wheel speed"
        raw = _raw_wheel(c, name)
        yield Curves(name, words, UNITS[name], name in READ, c.t, value, std, simulated, augmented, raw)


def _augmented(c: Comparison, finding: Finding | None) -> Comparison | None:
    """Return a comparison with the simulation by what was found, in the trial's sand; None without any."""
    if finding is None or not finding.active or not finding.terms:
        return None
    soil, a_theta = finding.sand_of(c.motion.trial)
    try:
        run = simulate(c.run.variant, finding.robot, soil, a_theta=a_theta, effects=finding.active)
    except EstimateError:
        return None
    simulated = simulated_channels(run, c.t)
    for name in STANDSTILL & c.measured.keys():  # as of the paper's model, its change is compared
        simulated[name] = simulated[name] + standstill_mean(c.t, c.measured[name] - simulated[name])[0]
    return dataclasses.replace(c, run=run, simulated=simulated)


def _raw_wheel(c: Comparison, name: str) -> tuple[Array, Array] | None:
    """Return the speed of a wheel by the differences of its encoder's angle [m/s]."""
    if not name.startswith("wheel_") or c.trial.wheels is None:
        return None
    k, wheels = WHEELS.index(name.removeprefix("wheel_")), c.trial.wheels
    late = c.motion.clock_left.value if math.isfinite(c.motion.clock_left.value) else 0.0
    t = wheels.t + late - (c.motion.t[0] - c.t[0])
    radius = c.run.robot.wheels.radius
    if wheels.rate is not None:
        return t, radius * wheels.rate[:, k]
    there = np.isfinite(wheels.angle[:, k])
    t, angle = t[there], wheels.angle[there, k]
    return ((t[1:] + t[:-1]) / 2, radius * np.diff(angle) / np.diff(t)) if t.size > 1 else None


def _search_curves(c: Comparison, finding: Finding | None) -> Iterator[Curves]:
    """Yield the sensors as the search fitted them; of wheel angles the difference to the paper's model."""
    for r in finding.residuals if finding else ():
        if r.trial != c.motion.trial:
            continue
        zero = r.before if r.unit == "rad" else np.zeros_like(r.before)
        t, name = r.t + r.t_start - c.start, sensor(r.channel)
        name += ", minus the paper's model" if r.unit == "rad" else ""
        later = r.after - zero if finding and finding.terms else None
        yield Curves(
            f"search_{r.channel}", name, r.unit, True, t, r.measured - zero, np.full(len(t), np.nan),
            r.before - zero, later,
        )  # fmt: skip


def _thin(signal: Curves, points: int) -> dict[str, Any]:
    """Return the lines of a quantity for JSON, with the extremes of each between neighbouring points."""
    later = () if signal.augmented is None else (signal.augmented, signal.augmented - signal.measured)
    lines = (signal.measured, signal.simulated, signal.simulated - signal.measured, *later)
    kept = extremes(lines, points)
    unit, scale = axis_unit(signal.unit)
    gap_unit, gap_scale = shown_as(signal.unit)
    about = {
        "name": signal.name, "unit": unit, "read": signal.read, "gap": gap_unit,
        "factor": gap_scale / scale, "search": signal.id.startswith("search_"),
    }  # fmt: skip
    packed: dict[str, Any] = {"about": about, "t": _base64(signal.t[kept])}
    drawn = (signal.measured, signal.std, signal.simulated, signal.augmented)
    for key, values in zip("mesf", drawn, strict=True):
        if values is not None and np.isfinite(values).any():
            packed[key] = _base64(scale * values[kept])
    if signal.raw is not None and signal.raw[0].size:
        few = extremes((signal.raw[1],), points)
        packed |= {"rt": _base64(signal.raw[0][few]), "r": _base64(scale * signal.raw[1][few])}
    return packed


def _base64(values: Array) -> str:
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()


def as_script(data: dict[str, Any]) -> str:
    """Return data as JSON that no name in it can leave, within an element of a page."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
