"""What a report answers: every number decided and rounded here, and printed from here everywhere."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from granite_lab.discovery.finding import Finding
from granite_lab.fitting.fit import AThetaFit
from granite_lab.parameters import load_paper
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.names import (
    MUCH,
    capital,
    describe,
    listed,
    next_steps,
    percent,
    plain,
    times,
    together,
    with_found,
)
from granite_lab.reporting.rounding import Number, decided, shown_as, significant, tidy_unit, with_unit
from granite_lab.reporting.summary import IN_PHASE, Gap, Speed, by_speed, gaps, worst_phase

SPEEDS = 3
"""A law over speed is tested by at least so many speeds."""

NOISE, CLEAR = 1.5, 3.0
"""Difference over noise up to which a channel agrees, and above which it differs clearly."""

SMALL, UNSEEN = 0.01, 0.2
"""Shares of a channel's largest value: a difference below the first is small; noise above the second is
too large for a judgement."""


@dataclass(frozen=True)
class Answer:
    """A question of the first screen with its answer.

    Attributes:
        id: for JSON.
        question: as printed.
        verdict: the answer in a few words.
        text: the numbers and conditions behind it.
        tone: "good", "fair", "bad" or "" for the colour beside the verdict.
        command: what to type next; empty where there is nothing.
    """

    id: str
    question: str
    verdict: str
    text: str
    tone: str = ""
    command: str = ""


@dataclass(frozen=True)
class ChannelAnswer:
    """How well the model explains one quantity over whole trials.

    Attributes:
        channel: as in `Comparison.measured`; "wheels" are all four.
        name: as a reader calls it.
        unit: of the three numbers, as printed.
        rms: of simulated minus measured.
        noise: std of the measurement.
        largest: largest simulated magnitude.
        verdict, tone: in words.
        worst: phase in which the difference is largest against the noise.
    """

    channel: str
    name: str
    unit: str
    rms: float
    noise: float
    largest: float
    verdict: str
    tone: str
    worst: str

    @property
    def size(self) -> str:
        """The difference with its unit."""
        return with_unit(significant(self.rms, 2), self.unit)


@dataclass(frozen=True)
class Answers:
    """All that the first screen, the tables, the captions, the terminal and the JSON file state.

    Attributes:
        lead: what was measured.
        virtual: what a reader must know about simulated data; empty for a real experiment.
        speeds: slow ones first; empty for a search alone.
        a_theta: exponent of k_92 = exp(−a_θ v) [s/m]; None where it could not be fitted.
        a_theta_paper: of the paper [s/m].
        a_theta_agrees: the paper's value lies in the interval as printed; None with too few speeds.
        channels: of the comparison of measured and simulated motion.
        questions: in the order of the first screen.
        steps: what to do next, most useful first.
    """

    lead: str
    virtual: str
    speeds: tuple[Speed, ...]
    a_theta: Number | None
    a_theta_paper: float
    a_theta_agrees: bool | None
    channels: tuple[ChannelAnswer, ...]
    questions: tuple[Answer, ...]
    steps: tuple[str, ...]

    def question(self, id_: str) -> Answer | None:
        """Return a question by its id."""
        return next((q for q in self.questions if q.id == id_), None)


def of_study(result: StudyResult, model: Path | str | None = None, folder: str = "") -> Answers:
    """Decide what a study answers.

    Args:
        result: the study.
        model: path of the model file with what was found, as the report names it.
        folder: of the report, as a shell takes it; the name of the study by default.
    """
    paper, finding = load_paper(), result.finding
    speeds = by_speed(result, paper)
    a_theta, agrees = a_theta_of(result.a_theta)
    channels = channels_of(gaps([r.comparison for r in result.trials]))
    questions = [
        *((_slip(speeds),) if speeds else ()),
        *((law_answer(result.a_theta, finding),) if speeds else ()),
        *((model_answer(channels, finding),) if speeds else ()),
        missing_answer(finding, result.unsearched),
        *((closes_answer(finding),) if finding else ()),
        _trust(result, finding),
    ]
    steps = next_steps(finding, model, folder or result.name) if finding else ()
    return Answers(
        _lead(result, speeds), _virtual(result), speeds, a_theta, paper.a_theta, agrees, channels,
        (*questions, *_next(steps)), steps,
    )  # fmt: skip


def of_search(finding: Finding, model: Path | str | None = None, folder: str = "") -> Answers:
    """Decide what a search for a missing effect answers; arguments as in `of_study`."""
    trials = {r.trial: r.variant for r in finding.residuals}
    speeds = listed([f"{v:g}" for v in sorted(set(trials.values()))])
    robot, soil = finding.robot.title.split(",")[0], _lower(finding.soil.title)
    lead = f"{_plural(len(trials), 'trial')} of {robot} driving straight on {soil} at {speeds} m/s."
    steps = next_steps(finding, model, folder or "FOLDER")
    virtual = (
        "A simulator wrote the sensor logs of these trials; no robot was driven. Nothing here is about "
        "real sand."
    )
    questions = (
        _explained(finding), missing_answer(finding), closes_answer(finding), _trust(None, finding),
        *_next(steps),
    )  # fmt: skip
    return Answers(
        lead, virtual if finding.virtual else "", (), None, load_paper().a_theta, None, (), questions, steps
    )


def _lead(result: StudyResult, speeds: Sequence[Speed]) -> str:
    if not result.trials:
        return f"None of {len(result.failures)} trials could be used. The reasons are listed below."
    robots = _most(r.comparison.run.robot.title.split(",")[0] for r in result.trials)
    soils = _most(_lower(r.comparison.run.soil.title) for r in result.trials)
    counts = {len(s.results) for s in speeds}
    each = f" ({counts.pop()} at each speed)" if len(counts) == 1 and len(speeds) > 1 else ""
    velocities = listed([f"{s.velocity:g}" for s in speeds])
    failed = len(result.failures)
    left_out = f" {_plural(failed, 'more trial')} could not be used." if failed else ""
    return (
        f"{_plural(len(result.trials), 'trial')} of {robots} driving straight on {soils} at {velocities} "
        f"m/s{each}.{left_out}"
    )


def _virtual(result: StudyResult) -> str:
    count = sum(r.trial.info.virtual or r.comparison.motion.virtual for r in result.trials)
    if not count:
        return ""
    which = "All trials are" if count == len(result.trials) else f"{count} of {len(result.trials)} trials are"
    return (
        f"{which} virtual: a simulator wrote the sensor logs and no robot was driven. “Measured” means "
        "estimated from the virtual sensors. Nothing here is about real sand."
    )


def _slip(speeds: Sequence[Speed]) -> Answer:
    question = "How much does the robot slip?"
    known = [s for s in speeds if math.isfinite(s.slip.value)]
    if not known:
        return Answer("slip", question, "Not known", "No trial has a steady part with a slip ratio.", "bad")
    ends = [known[0]] if len(known) == 1 else [known[0], known[-1]]
    verdict = " to ".join(f"{s.slip.quantity} at {s.velocity:g} m/s" for s in ends)
    inside = [f"{s.velocity:g}" for s in known if s.agrees]
    outside = [f"{s.velocity:g}" for s in known if s.agrees is False]
    if not inside and not outside:
        return Answer("slip", question, verdict, "The paper has no experiment to compare with.")
    if not outside or not inside:
        where = "outside" if outside else "in"
        every = " at every speed" if len(inside) + len(outside) > 1 else ""
        text = f"The paper's experiment lies {where} the 95 % interval{every}."
    else:
        text = (
            f"The paper's experiment lies in the 95 % interval at {listed(inside)} m/s, and outside at "
            f"{listed(outside)} m/s."
        )
    return Answer("slip", question, verdict, text, "fair" if outside else "good")


def a_theta_of(fit: AThetaFit | None) -> tuple[Number | None, bool | None]:
    """Return a_θ as printed, and whether its interval holds the paper's; None with too few speeds."""
    if fit is None or not math.isfinite(fit.a_theta.value):
        return None, None
    number = decided(fit.a_theta.value, fit.a_theta.std, *fit.ci95, unit="s/m")
    enough = len({round(velocity, 2) for _, velocity, _, _ in fit.points}) >= SPEEDS
    return number, number.holds(fit.published) if enough else None


def law_answer(fit: AThetaFit | None, finding: Finding | None = None) -> Answer:
    """Say whether a_θ agrees with the paper's; a finding says whether the model lacks something."""
    number, agrees = a_theta_of(fit)
    question = f"Does a_θ agree with the paper's {load_paper().a_theta:g} s/m?"
    if fit is None or number is None:
        text = "a_θ of k_92 = exp(−a_θ v) needs at least two trials in which k_92 could be fitted."
        return Answer("a_theta", question, "Not known", text)
    text = (
        f"a_θ = {number.with_std} s/m, 95 % interval {number.interval} s/m, from "
        f"{_plural(len(fit.points), 'trial')}."
    )
    if agrees is None:
        speeds = len({round(velocity, 2) for _, velocity, _, _ in fit.points})
        text += f" The law k_92 = exp(−a_θ v) needs {SPEEDS} speeds to be tested; here are {speeds}."
        return Answer("a_theta", question, "Not tested", text)
    if agrees:
        return Answer("a_theta", question, "Yes", text, "good")
    off = abs(number.value / fit.published - 1)
    way = "above" if number.value > fit.published else "below"
    text += f" It is {percent(off)} {way} the paper's."
    if finding is not None and finding.effects:
        text += " k_92 is fitted with the paper's model, so that what is missing can cause this."
    return Answer("a_theta", question, "No", text, "fair")


def channels_of(found: dict[tuple[str, str], Gap]) -> tuple[ChannelAnswer, ...]:
    """Judge each channel over whole trials."""
    judged = []
    for gap in (g for g in found.values() if g.phase == "all"):
        unit, scale = shown_as(gap.unit)
        noise = gap.rms / gap.normalised if gap.normalised > 0 else math.nan
        worst = worst_phase(g for g in found.values() if g.channel == gap.channel)
        verdict, tone = _judge(gap, noise)
        judged.append(
            ChannelAnswer(
                gap.channel, gap.name, tidy_unit(unit), gap.rms * scale, noise * scale, gap.size * scale,
                verdict, tone, IN_PHASE.get(worst, ""),
            )
        )  # fmt: skip
    return tuple(judged)


def _judge(gap: Gap, noise: float) -> tuple[str, str]:
    if not math.isfinite(gap.normalised):
        return "not judged, noise not known", ""
    if gap.normalised <= NOISE:
        if gap.size > 0 and noise > UNSEEN * gap.size:
            return "not judged, noise too large", ""
        return "agrees", "good"
    if gap.size > 0 and gap.rms < SMALL * gap.size:
        return f"differs by less than {percent(SMALL)}", "good"
    return ("differs", "fair") if gap.normalised <= CLEAR else ("differs clearly", "bad")


def model_answer(channels: Sequence[ChannelAnswer], finding: Finding | None = None) -> Answer:
    """Say how well the model explains the measured motion."""
    question = "Does the paper's model explain the measurements?"
    agree = [c for c in channels if c.tone == "good"]
    differ = sorted((c for c in channels if c.tone in ("fair", "bad")), key=lambda c: -c.rms / c.noise)
    unseen = [c.name for c in channels if not c.tone]
    if not agree and not differ:
        return Answer("model", question, "Not known", "The noise of the measured quantities is not known.")
    text = f"{len(agree)} of {_plural(len(channels), 'quantity')} agree with the simulation."
    if differ:
        worst = differ[0]
        text += (
            f" {capital(together([c.name for c in differ]))} {_verb(differ)}; largest against its noise: "
            f"{worst.name}, {worst.size} rms, {significant(worst.rms / worst.noise, 2)} times the noise."
        )
    if unseen:
        text += f" Not judged: {listed(unseen)}."
    if not differ and finding is not None and finding.verdict != "none":
        text += " The readings of the sensors show more: see what is missing."
        return Answer("model", question, "In part", text, "fair")
    if not differ:
        return Answer("model", question, "Yes", text, "good")
    if finding is not None and finding.verdict == "none":
        text = f"With the sand of the parameter file: {text} With the sand fitted, the sensors agree too."
        return Answer("model", question, "Yes, once the sand is fitted", text, "good")
    return Answer("model", question, "In part" if agree else "No", text, "fair" if agree else "bad")


def _verb(items: Sequence[object]) -> str:
    return "differs" if len(items) == 1 else "differ"


def _explained(finding: Finding) -> Answer:
    """Say how far the model without effects is from the sensors, for a search alone."""
    question = "Does the paper's model explain the sensors?"
    gap, _, where = gap_pair(finding)
    text = f"Sensors and model differ by {times(gap)} times {_limit(finding)}, {where}."
    if finding.verdict == "none":
        return Answer("model", question, "Yes", text, "good")
    return Answer("model", question, "No", text, "fair")


def _limit(finding: Finding) -> str:
    return f"what noise and a tolerance of {percent(finding.tolerance)} of each sensor's rms explain"


def missing_answer(finding: Finding | None, reason: str = "") -> Answer:
    """Say which effect the model lacks, with its sizes; `reason` says why nothing was searched."""
    question = "What is missing from the model?"
    if finding is None:
        text = reason and f"{capital(reason).rstrip('.')}."
        return Answer("missing", question, "Not searched", text or "No search for a missing effect was run.")
    if finding.verdict == "none":
        tone = "fair" if finding.provisional else "good"
        text = "No effect of the library, and no other disagreement, is beyond noise and tolerance."
        return Answer("missing", question, "Nothing that these trials show", text, tone)
    sizes = "; ".join(describe(e) for e in finding.effects)
    if finding.verdict == "unknown":
        text = "No effect of the library explains the disagreement."
        if finding.effects:
            text += f" An empirical law stands in for it: {sizes}."
        return Answer("missing", question, "Something unknown", text, "bad")
    twins = [
        f"These trials cannot tell {plain(e.id)} from {listed([plain(t) for t in e.twins], 'or')}."
        for e in finding.effects
        if e.twins
    ]
    verdict = capital(listed([plain(e.id) for e in finding.effects]))
    tone = "fair" if twins or finding.provisional or finding.remainder > MUCH else "good"
    return Answer("missing", question, verdict, " ".join([f"{capital(sizes)}.", *twins]), tone)


def gap_pair(finding: Finding) -> tuple[float, float, str]:
    """Return the gap without and with what was found, on trials left out where there are, and say where."""
    before, after = finding.gap.held_out
    if math.isfinite(before):
        return before, after, "on trials that were left out of the fit"
    return (*finding.gap.train, "in the fit")


def closes_answer(finding: Finding) -> Answer:
    """Say how much of the gap between sensors and model closes with what was found."""
    question = "How much of the gap does it close?"
    before, after, where = gap_pair(finding)
    limit = _limit(finding)
    if not finding.effects:
        text = f"Sensors and model differ by {times(before)} times {limit}, {where}."
        return Answer("closes", question, "No gap" if finding.verdict == "none" else "Nothing", text)
    text = (
        f"{capital(where)}, the difference between sensors and model falls from {times(before)} to "
        f"{times(after)} times {limit}."
    )
    closes = 1 - finding.remainder
    verdict = capital(percent(min(max(closes, 0.0), 1.0))) if math.isfinite(closes) else "Not known"
    return Answer("closes", question, verdict, text, "good" if finding.remainder <= MUCH else "fair")


def _trust(result: StudyResult | None, finding: Finding | None) -> Answer:
    """Say what speaks for the answers, and every doubt."""
    grounds, doubts = [], []
    if result is not None:
        doubtful = [r.trial.name for r in result.trials if not r.comparison.motion.health.good]
        n = len(result.trials)
        if n and not doubtful:
            grounds.append(
                "The motion estimate is good." if n == 1 else f"All {n} motion estimates are good."
            )
        elif n:
            doubts.append(f"{len(doubtful)} of {_plural(n, 'estimate')} doubtful ({_some(doubtful)})")
        if result.failures:
            doubts.append(f"{_plural(len(result.failures), 'trial')} could not be used")
        if finding is None or not finding.provisional:
            speeds = Counter(round(r.comparison.motion.variant.velocity, 2) for r in result.trials)
            doubts += [f"only {_plural(len(speeds), 'speed')}"] if 0 < len(speeds) < SPEEDS else []
            doubts += ["no speed was driven twice"] if speeds and max(speeds.values()) < 2 else []
    if finding is not None:
        doubts += [reason.rstrip(".") for reason in finding.provisional]
        doubts += [f"{plain(e.id)} has a twin" for e in finding.effects if e.twins]
        if finding.dropped:
            doubts.append(f"{_plural(len(finding.dropped), 'trial')} left out because no model fits")
        grounds.append(f"Posterior probability of the finding: {percent(finding.probability)}.")
        left = ((finding.trials_left_out, "trials"), (finding.speeds_left_out, "speeds"))
        counts = [f"{sum(x.after < x.before for x in f)} of {len(f)} {what}" for f, what in left if f]
        if finding.effects and counts:
            left_out = f"{listed(counts)} left out of the fit are predicted better"
            grounds.append(f"{capital(with_found(finding))}, {left_out}.")
        elif finding.effects:
            doubts.append("nothing could be left out of the fit, so that no prediction tests it")
    text = " ".join([*grounds, *([f"Doubts: {'; '.join(doubts)}."] if doubts else ())])
    text += " Valid for these speeds, this robot and this sand."
    return Answer(
        "trust", "How far can this be trusted?", "With care" if doubts else "Well, for trials like these",
        text.strip(), "fair" if doubts else "good",
    )  # fmt: skip


def _next(steps: Sequence[str]) -> tuple[Answer, ...]:
    if not steps:
        return ()
    text, _, command = steps[0].partition(": granite-lab ")
    verdict = f"granite-lab {command.rstrip('.')}" if command else ""
    return (Answer("next", "What to do next?", "", f"{text.rstrip('.')}.", command=verdict),)


def _plural(n: int, what: str) -> str:
    many = f"{what[:-1]}ies" if what.endswith("ity") else f"{what}s"
    return f"{n} {what if n == 1 else many}"


def _some(names: Sequence[str], most: int = 3) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _most(names: object) -> str:
    return listed([name for name, _ in Counter(names).most_common()])  # type: ignore[call-overload]


def _lower(title: str) -> str:
    """Write a title inside a sentence, acronyms left alone."""
    return title[0].lower() + title[1:] if title[1:2].islower() else title
