"""Words for channels, effects and their sizes, and the next steps after a finding."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlencode

import numpy as np

from granite_lab.discovery.finding import EffectFinding, Finding, FittedParameter, Status
from granite_lab.effects.library import met
from granite_lab.estimate import Estimate
from granite_lab.model.effect import EffectParameter
from granite_lab.rounding import plus_minus, rounded, significant, tidy_unit, with_unit

SENSORS = {
    "accel_x": "forward acceleration",
    "accel_z": "vertical acceleration",
    "pitch_rate": "pitch rate",
    "wheel": "mean wheel angle",
    "wheel_split": "front − rear wheel angle",
    "current_f": "front motor current",
    "current_r": "rear motor current",
    "current_side": "motor current of a side",
}
"""Channels of a search, in the order of the report, as a reader calls them."""

STATUS: Mapping[Status, str] = {
    "named": "named",
    "twin": "fits as well as the named one",
    "small": "small",
    "described": "described",
    "less likely": "less likely",
    "screened": "screened out",
    "at a bound": "ended at a limit",
}
"""What became of a candidate, as a reader calls it."""

SAND = {
    "a_theta": ("a_θ", "a_θ"),
    "frictional_modulus": ("k_φ", "frictional modulus k_φ"),
    "cohesion": ("c", "cohesion c"),
    "shear_modulus": ("K", "shear modulus K"),
    "friction_angle": ("φ", "friction angle φ"),
    "exponent": ("n", "exponent n"),
    "tyre_friction": ("μ_s", "tyre friction μ_s"),
}
"""Symbols of the numbers of the sand, alone and with their names."""

SCALES = {
    "a_theta": ("a_θ, from raking to raking", "%", 100.0),
    "frictional_modulus": ("k_φ, from raking to raking", "%", 100.0),
    "cohesion": ("c, from raking to raking", "%", 100.0),
    "start": ("start of the command", "ms", 1000.0),
    "tilt": ("tilt of the IMU", "°", 180 / math.pi),
    "accel_x gain": ("gain of the accelerometer", "%", 100.0),
    "wheel gain": ("wheel radius, mean of all", "%", 100.0),
    "wheel_split gain": ("wheel radius, front against rear", "%", 100.0),
    "current_f gain": ("gain of the front motor currents", "%", 100.0),
    "current_r gain": ("gain of the rear motor currents", "%", 100.0),
    "current_side gain": ("gain of the motor currents of a side", "%", 100.0),
}
"""Numbers that differ from trial to trial: words, unit, and factor to it."""

LINES = "explore.html"
"""Page on which each line can be zoomed into."""

PREFIXED = ("s", "m", "rad", "m/N", "rad/(N m)")
"""Units that take a milli or a micro in front."""

TYPICAL = 0.5
"""Speed at which a model is simulated first where it can be [m/s]: within those of Table 2."""

MUCH = 0.2
"""Share of the gap that is left from which on something else may be missing."""


def sensor(channel: str) -> str:
    """Return a channel of a search as a reader calls it."""
    return SENSORS.get(channel, channel)


def sensors_of(finding: Finding) -> list[str]:
    """Return the channels that the search used, in the order of the report."""
    used = {r.channel for r in finding.residuals}
    return [c for c in SENSORS if c in used] + sorted(used - set(SENSORS))


def plain(effect_id: str) -> str:
    """Return an effect's id as words."""
    effect = met(effect_id)
    return (effect.name if effect else "") or effect_id.replace("_", " ")


def twins_of(effect: EffectFinding) -> str:
    """Return the effects that explain the trials as well in the place of one, as words."""
    return listed([plain(t) for t in effect.twins], "or")


def outlook(key: str) -> str:
    """Return what a plan improves as words: "effect.number", "effect from effect", a number of the sand."""
    if key in SAND:
        return SAND[key][1]
    effect, _, number = key.partition(".")
    if number:
        return f"{plain(effect)}, {number.replace('_', ' ')}"
    return " from ".join(map(plain, key.split(" from ")))


def declared(effect_id: str, name: str) -> EffectParameter | None:
    """Return a number of an effect as the effect declares it; None where nothing is known of either."""
    effect = met(effect_id)
    return next((p for p in effect.parameters if p.name == name), None) if effect else None


def describe(effect: EffectFinding) -> str:
    """Name an effect with its sizes; a sign that has a direction is said, not printed."""
    title, sizes = effect.title, [f"{p.name.replace('_', ' ')} {amount(effect, p)}" for p in _shown(effect)]
    if effect.empirical:
        title, sizes = plain(effect.id), [amount(effect, p) for p in effect.parameters]
    for p in (p for p in effect.parameters if not p.per_trial):
        declaration = declared(effect.id, p.name)
        if declaration and declaration.signs[0]:
            away = replace(p, estimate=Estimate(abs(p.estimate.value), p.estimate.std))
            title, sizes = declaration.signs[p.estimate.value < 0], [f"by {amount(effect, away)}"]
    return f"{title} ({', '.join(sizes)})" if sizes else title


def _shown(effect: EffectFinding) -> list[FittedParameter]:
    """Return the numbers, cosine and sine that differ in each trial as the amplitude that they share."""
    named = {p.name: p for p in effect.parameters}
    shown = []
    for p in effect.parameters:
        part, _, rest = p.name.partition("_")
        pair = {"cos": f"sin_{rest}", "sin": f"cos_{rest}"}
        other = named.get(pair.get(part, "")) if p.per_trial else None
        if other is None:
            shown.append(p)
        elif part == "cos":
            c, s = p.estimate, other.estimate
            size = float(np.hypot(c.value, s.value))
            std = float(np.hypot(c.value * c.std, s.value * s.std)) / size if size else c.std
            shown.append(FittedParameter(f"amplitude_{rest}", p.unit, Estimate(size, std)))
    return shown


def with_effects(finding: Finding) -> str:
    """Say what the model has more than the paper's, as a legend does."""
    if not finding.effects:
        return "with the description"
    return "with the effect found" if len(finding.effects) == 1 else "with the effects found"


def latency_in_words(latency: Estimate) -> str:
    """Say by how much the stamps of the IMU come later than the others; empty where that is not known."""
    if not math.isfinite(latency.value):
        return ""
    side = "behind" if latency.value >= 0 else "ahead of"
    size = plus_minus(Estimate(abs(latency.value), latency.std), "ms", 1e3)
    return f"IMU stamps {size} {side} those of wheels and currents"


def listed(parts: Sequence[str], last: str = "and") -> str:
    """Join parts with commas, the last one with "and" or another word."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}"


def together(names: Sequence[str]) -> str:
    """Join names of quantities; those of both axles become one."""
    merged = list(names)
    for name in names:
        front, rear = name, f"rear {name.removeprefix('front ')}"
        if name.startswith("front ") and rear in merged:
            merged[merged.index(front)] = f"{name.removeprefix('front ')}s"
            merged.remove(rear)
    return listed(merged)


def shared(lines: Sequence[tuple[str, Sequence[str]]]) -> tuple[str, ...]:
    """Merge equal notes of several trials; each line is a trial's name and its notes."""
    trials_of: dict[str, list[str]] = {}
    for trial, notes in lines:
        for line in dict.fromkeys(notes):
            trials_of.setdefault(line, []).append(trial)
    everybody = len(lines)
    return tuple(
        f"all {everybody} trials: {line}" if len(trials) == everybody > 1 else f"{', '.join(trials)}: {line}"
        for line, trials in trials_of.items()
    )


def lines_link(trial: str = "", speed: float = math.nan, quantity: str = "motion") -> str:
    """Return where lines stand on the page to zoom into: of a trial, or of all at a speed."""
    at = {"trial": trial} if trial else {"trial": "", "speed": f"{speed:.3g}"}
    return f"{LINES}#{urlencode(at | {'quantity': quantity})}"


def speed_stem(speed: float) -> str:
    """Return a speed of `parameters.by_speed` [m/s] as part of a file's name, which no other speed has."""
    whole, _, decimals = f"{speed:.3g}".partition(".")
    return f"{whole}p{decimals:0<2}"


def strained_in_words(finding: Finding) -> list[str]:
    """Return a line on the numbers that lie at a bound, or far from file or range; no line without any."""
    numbers = [_strained(finding, name) for name in finding.strained]
    are = "is" if len(numbers) == 1 else "are"
    where = "at a bound of the fit, or over 2 std from the file or the usual range"
    return [f"{listed(numbers)} {are} {where}"] if numbers else []


def _strained(finding: Finding, name: str) -> str:
    """Name a strained number, and say by how much it is off where a table does not."""
    effect, _, number = name.partition(".")
    if number:
        return f"{plain(effect)} {number.replace('_', ' ')}"
    if name in SAND:
        log = finding.sand[name].value if name in finding.sand else math.nan
        off, words, unit = math.expm1(log) * 100, SAND[name][1], "%"
    else:
        words, unit, factor = SCALES.get(name, (name, "", 1.0))
        off, words = finding.own_means.get(name, math.nan) * factor, f"the {words}"
    return f"{words} (off by {with_unit(significant(abs(off), 2), unit)})" if math.isfinite(off) else words


def _measure_soil(finding: Finding) -> list[Step]:
    """Return the step to measure the soil where the fit moves its numbers far."""
    far = [words for name, (_, words) in SAND.items() if name in finding.strained and name != "a_theta"]
    if not far:
        return []
    them = "it" if len(far) == 1 else "them"
    measure = f"Measure {listed(far)} of this soil and write {them} into its file, then search again"
    return [Step(f"{measure}. The fit moves {them} more than 2 std from the file.")]


def _calibrate(finding: Finding) -> list[Step]:
    """Return the step to check what all trials ask to change alike: gains and tilts."""
    off = [f"the {SCALES[name][0]}" for name in finding.strained if name in SCALES and name not in SAND]
    return [Step(f"Check {listed(off)}: all trials ask for another value alike.")] if off else []


def capital(text: str) -> str:
    """Return a text with a capital letter in front."""
    return text[:1].upper() + text[1:]


def inside(title: str) -> str:
    """Return a title as it stands inside a sentence; an acronym keeps its capitals."""
    return title[0].lower() + title[1:] if title[1:2].islower() else title


def in_plain_words(note: str, finding: Finding) -> str:
    """Return a sentence of the search with the effects and channels in it as words."""
    ids = {c.id for c in finding.candidates} | {d.effect for d in finding.detectable}
    for e in (*finding.terms, *finding.small):
        ids |= {e.id, *e.twins}
    for id_ in sorted((i for i in ids if "_" in i), key=len, reverse=True):
        note = re.sub(rf"\b{re.escape(id_)}\b", plain(id_), note)
    return capital(sensors_in_words(note))


def sensors_in_words(note: str) -> str:
    """Return a sentence with the channels in it as words."""
    return re.sub(r"\b\w+_\w+\b", lambda m: SENSORS.get(m[0], m[0]), note)


def scale_of(effect_id: str, name: str, unit: str, size: float) -> tuple[str, float]:
    """Return the unit in which a number of an effect is printed, and the factor to it.

    Relative errors are percent; small sizes of some units are thousandths, as ms for 0.027 s.
    """
    declaration = declared(effect_id, name)
    if declaration and declaration.relative:
        return "%", 100.0
    if unit not in PREFIXED or size == 0 or abs(size) >= 0.1:
        return tidy_unit(unit), 1.0
    return (f"m{tidy_unit(unit)}", 1e3) if abs(size) >= 1e-4 else (f"µ{tidy_unit(unit)}", 1e6)


def amount(effect: EffectFinding, parameter: FittedParameter) -> str:
    """Return a fitted number ± std with its unit."""
    return plus_minus(parameter.estimate, *scale_of_fitted(effect, parameter))


def scale_of_fitted(effect: EffectFinding, parameter: FittedParameter) -> tuple[str, float]:
    """Return the unit in which a fitted number, its std and its interval are printed, as `scale_of`."""
    size = max(abs(parameter.estimate.value), abs(parameter.estimate.std))
    return scale_of(effect.id, parameter.name, parameter.unit, size)


def in_units(effect_id: str, values: Mapping[str, float]) -> str:
    """Return the numbers of an effect that is switched on, as `name = value unit`."""
    texts = []
    for name, value in values.items():
        declaration = declared(effect_id, name)
        unit, scale = scale_of(effect_id, name, declaration.unit if declaration else "", value)
        texts.append(f"{name} = {with_unit(f'{value * scale:.4g}', unit)}")
    return ", ".join(texts)


def meaning(effect_id: str, name: str) -> str:
    """Say what a number of an effect is, and which way its sign goes; empty where that is not known."""
    declaration = declared(effect_id, name)
    if declaration is None:
        return ""
    complete = "positive" in declaration.meaning or not declaration.signs[1]
    return declaration.meaning if complete else f"{declaration.meaning}; below zero: {declaration.signs[1]}"


def law_formulas(finding: Finding) -> tuple[str, ...]:
    """Return the formula of each term of the dictionary in a finding, with its number."""
    formulas = []
    for e in (e for e in finding.terms if e.empirical and e.parameters):
        value = e.parameters[0].estimate
        number = rounded(abs(value.value), value.std).text
        formulas.append(re.sub(r"\ba\b", f"{'−' * (value.value < 0)}{number}", e.formula, count=1))
    return tuple(formulas)


class Step(NamedTuple):
    """What to do next, and the command that does it; empty where there is none."""

    text: str
    command: str = ""


def next_steps(
    finding: Finding, model: Path | str | None, folder: str, effects: str = ""
) -> tuple[Step, ...]:
    """Say what to do with a finding, most useful first.

    `effects` is the user's own effect file that the search was given; empty where there is none.
    """
    given = f" --effects {pasted(effects)}" if effects else ""
    plan = f"granite-lab plan-next {pasted(folder)}{given}"
    user_effect = "granite-lab discover TRIALS --effects my_effect.py"
    again = "Drive two trials or more at each of three speeds, then search again."
    steps = [Step(again)] if finding.provisional else []
    if finding.verdict == "none":
        nothing = "Nothing needs to be added. Plan a trial that shows effects too small for these trials."
        return (*steps, Step(nothing, plan))
    if finding.verdict == "unknown":
        look = Step(
            "Find what changes from trial to trial, for example uneven ground, wind or a warm motor. Then "
            "repeat the trials without it."
        )
        if finding.ground_wave:
            look = Step("Level the ground until its waves are gone, then repeat the trials.")
        elif not finding.scatter:
            see = "See where the model disagrees, and test a suspected cause as an effect of your own."
            look = Step(see, user_effect)
        return (*steps, look, Step("Plan the next trial.", plan))
    steps += [*_measure_soil(finding), *_calibrate(finding)]
    faults = [plain(e.id) for e in finding.effects if (effect := met(e.id)) and effect.fault]
    if faults:
        steps.append(
            Step(
                f"{capital(listed(faults))} is an error of the measurement, not of the model. Correct it on "
                "the robot or in the logs by the number found, and search again."
            )
        )
    twins = {plain(e.id): twins_of(e) for e in finding.effects if e.twins}
    steps += [
        Step(f"Plan the trial that separates {named} from {others}.", plan) for named, others in twins.items()
    ]
    if finding.remainder > MUCH:
        steps.append(Step("Part of the gap remains. Test an effect of your own.", user_effect))
    if model and finding.simulates and len(faults) < len(finding.effects):
        speed = min(finding.simulates, key=lambda v: abs(v - TYPICAL))
        steps.append(
            Step(
                "Simulate with what was found. At other speeds and on other sand no trial has confirmed the "
                "result.",
                f"granite-lab simulate {saved_model(model, folder, effects)} --variant {speed:g}",
            )
        )
    sharpen = Step("Plan the trial that lowers the largest std of an effect.", plan)
    return (*steps, *([] if twins else [sharpen]))


def saved_model(model: Path | str, folder: str, effects: str = "") -> str:
    """Return the options of a command that uses the model with what was found; `effects` as `next_steps`."""
    given = f" --effects {pasted(effects)}" if effects else ""
    return f"--model {pasted(f'{folder}/{Path(model).name}')}{given}"


def from_here(path: Path) -> str:
    """Return a path as a command names it: from the folder one works in where it lies there, else whole."""
    with suppress(ValueError):
        path = path.relative_to(Path.cwd())
    return path.as_posix()


def pasted(path: str) -> str:
    """Return a path as a shell takes it."""
    return shlex.quote(" ".join(path.split()))
