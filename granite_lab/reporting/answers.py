"""The first page in words: what was measured, how much it slips, does the paper's law hold, and the model."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from granite_lab.fitting.fit import AThetaFit
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.document import Answer
from granite_lab.reporting.rounding import interval, plus_minus, shown_as, significant, with_unit
from granite_lab.reporting.study_tables import three_digits
from granite_lab.reporting.summary import IN_PHASE, NOISE, Gap, Speed, worst_of


def lead(result: StudyResult, speeds: Sequence[Speed]) -> str:
    """Say what was measured."""
    if not result.trials:
        return f"None of {len(result.failures)} trials could be used; the reasons stand below."
    robots = _names([r.comparison.run.robot.title.split(",")[0] for r in result.trials])
    soils = _names([_lower(r.comparison.run.soil.title) for r in result.trials])
    counts = {len(s.results) for s in speeds}
    n = counts.pop() if len(counts) == 1 and len(speeds) > 1 else 0
    each = "" if n == 0 else ", one trial each" if n == 1 else f", {n} trials each"
    velocities = _and([f"{s.velocity:g}" for s in speeds])
    left_out = f" {_plural(len(result.failures), 'more trial')} could not be used." if result.failures else ""
    return (
        f"{_plural(len(result.trials), 'trial')} of {robots} driving straight on {soils} "
        f"at {velocities} m/s{each}.{left_out}"
    )


def virtual_note(result: StudyResult) -> str:
    """Say which of the data come from a simulator; empty where none do."""
    virtual = sum(r.trial.info.virtual or r.comparison.motion.virtual for r in result.trials)
    if not virtual:
        return ""
    which = (
        "All trials of this report are"
        if virtual == len(result.trials)
        else f"{virtual} of {len(result.trials)} trials are"
    )
    return (
        f"{which} virtual: a simulator wrote the sensor logs, no robot was driven. “Measured” then means "
        f"estimated "
        "from virtual sensors, and agreement with the paper says nothing about real sand."
    )


def slip_answer(speeds: Sequence[Speed]) -> Answer:
    """Say how much the robot slips at each speed, and whether the paper's experiment agrees."""
    question = "How much does the robot slip?"
    known = [s for s in speeds if math.isfinite(s.slip.value)]
    if not known:
        return Answer(
            "slip", question, "The steady slip ratio could not be had from any trial.", "unknown", "bad"
        )
    parts = [
        f"{significant(s.slip.value * 100)} % at {s.velocity:g} m/s"
        + (f" (95 %: {three_digits(s.slip.low, s.slip.high)})" if math.isfinite(s.slip.low) else "")
        for s in known
    ]
    compared = [(s, s.slip.holds(s.published.slip_measured)) for s in known if s.published]
    judged = [(s, inside) for s, inside in compared if inside is not None]
    differing = [f"{s.velocity:g}" for s, inside in judged if not inside]
    text = f"{_and(parts)}."
    if not judged:
        return Answer("slip", question, f"{text} The paper has no experiment at these speeds.")
    if not differing:
        return Answer(
            "slip",
            question,
            f"{text} The paper's experiment lies inside the interval at every speed.",
            "as in the paper",
            "good",
        )
    return Answer(
        "slip", question, f"{text} The paper's experiment lies outside the interval at {_and(differing)} "
        f"m/s.",
        "differs in part" if len(differing) < len(judged) else "differs", "fair",
    )  # fmt: skip


_STANDS_IN = " It is fitted with the paper's model, so that k_92 may stand in for what was found missing."


def law_answer(fit: AThetaFit | None, *, lacking: bool = False) -> Answer:
    """Say whether a_θ agrees with the paper's.

    Args:
        fit: of a_θ over the trials.
        lacking: the model was found to lack something, which k_92 may then have to stand in for.
    """
    question = "Does a_θ agree with the paper?"
    if fit is None or not math.isfinite(fit.a_theta.value):
        return Answer(
            "a_theta",
            question,
            "a_θ of k_92 = exp(−a_θ v) could not be fitted: too few usable trials.",
            "unknown",
        )
    value = (
        f"a_θ = {plus_minus(fit.a_theta, 's/m')} (95 % interval {interval(*fit.ci95)}) "
        f"from {len(fit.points)} values of k_92"
    )
    if fit.agrees:
        return Answer(
            "a_theta", question, f"{value}; the paper's {fit.published:g} s/m lies inside.", "agrees", "good"
        )
    off = (fit.a_theta.value / fit.published - 1) * 100
    way = "above" if off > 0 else "below"
    return Answer(
        "a_theta", question,
        f"{value}; the paper's {fit.published:g} s/m lies outside, the fit is {significant(abs(off), 2)} "
        f"% {way} it.{_STANDS_IN if lacking else ''}",
        "differs", "fair",
    )  # fmt: skip


def model_answer(found: dict[tuple[str, str], Gap]) -> Answer:
    """Say how well the model explains the trials, and where it fails most."""
    question = "Does the model explain the trials?"
    judged = [g for g in found.values() if g.phase == "all" and math.isfinite(g.normalised)]
    worst = worst_of(found.values())
    if not judged or worst is None:
        return Answer(
            "model",
            question,
            "The noise of the channels is not known, so the misfit cannot be judged.",
            "unknown",
        )
    within = sum(g.normalised <= NOISE for g in judged)
    small = sum(g.word == "small gap" for g in judged)
    text = f"{within} of {len(judged)} channels are met within their noise"
    text += f", {small} more to within 1 % of their largest value." if small else "."
    if worst.normalised <= NOISE:
        return Answer("model", question, text, "yes", "good")
    text += f" The largest gap is the {describe_gap(worst)}."
    if within + small == len(judged):
        return Answer("model", question, text, "nearly", "good")
    return Answer(
        "model", question, text, "in part" if within + small else "no", "fair" if within + small else "bad"
    )


def missing_answer(found: dict[tuple[str, str], Gap], reason: str = "") -> Answer:
    """Say that no search for a missing effect was run, why, and which gaps one would have to explain."""
    question = "What is missing from the model?"
    start = f"No search for a missing effect was run{f' ({reason})' if reason else ''}."
    channels = dict.fromkeys(channel for channel, _ in found)
    worst = [worst_of(g for g in found.values() if g.channel == channel) for channel in channels]
    real = [g for g in worst if g is not None and g.word in ("visible gap", "large gap")]
    ranked = sorted(real, key=lambda g: -g.normalised)[:3]
    if not ranked:
        return Answer("missing", question, f"{start} No visible gap asks for one.", "not searched")
    listed = "; ".join(describe_gap(g) for g in ranked)
    return Answer(
        "missing", question, f"{start} A missing effect would have to explain: {listed}.", "not searched"
    )


def describe_gap(gap: Gap) -> str:
    """Describe a gap: channel, phase, side, size."""
    unit, scale = shown_as(gap.unit)
    size = with_unit(significant(gap.rms * scale, 2), unit)
    side = ""
    if abs(gap.bias) > 0.5 * gap.rms:
        side = ", simulated above measured" if gap.bias > 0 else ", simulated below measured"
    phase = IN_PHASE.get(gap.phase, gap.phase)
    share = f"{significant(100 * gap.relative, 2)} % of its largest value, " if gap.size > 0 else ""
    return f"{gap.name} {phase} ({size} rms{side}; {share}{significant(gap.normalised, 2)} times the noise)"


def _plural(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _names(names: Sequence[str]) -> str:
    return _and([name for name, _ in Counter(names).most_common()])


def _lower(title: str) -> str:
    """Write a title inside a sentence, acronyms left alone."""
    return title[0].lower() + title[1:] if title[1:2].islower() else title


def _and(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
