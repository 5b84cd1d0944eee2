"""What a report answers: every number decided and rounded here, and printed from here everywhere."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from granite_lab.discovery.finding import Finding
from granite_lab.fitting.fit import TRIALS, AThetaFit, View, views_of
from granite_lab.parameters import by_speed, load_paper
from granite_lab.reporting.channels import ChannelAnswer, channels_of
from granite_lab.reporting.names import (
    MUCH,
    capital,
    describe,
    in_plain_words,
    listed,
    next_steps,
    plain,
    together,
)
from granite_lab.reporting.speeds import Speed, speeds_of, velocities_of
from granite_lab.results import StudyResult, gaps
from granite_lab.rounding import (
    Number,
    chance,
    decided,
    interval,
    percent,
    significant,
    times,
    with_unit,
)  # fmt: skip

SPEEDS = 3
"""A law over speed is tested by at least so many speeds."""


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
class Answers:
    """All that the first screen, the tables, the captions, the terminal and the JSON file state.

    Attributes:
        lead: what was measured.
        virtual: what a reader must know about simulated data; empty for a real experiment.
        questions: in the order of the first screen.
        steps: what to do next, most useful first.
        speeds: slow ones first; empty for a search alone.
        a_theta: exponent of k_92 = exp(−a_θ v) [s/m]; None where it could not be fitted.
        a_theta_agrees: the paper's value lies in the interval as printed; None with too few speeds.
        channels: of the comparison of measured and simulated motion.
        a_theta_paper: of the paper [s/m].
    """

    lead: str
    virtual: str
    questions: tuple[Answer, ...]
    steps: tuple[str, ...]
    speeds: tuple[Speed, ...] = ()
    a_theta: Number | None = None
    a_theta_agrees: bool | None = None
    channels: tuple[ChannelAnswer, ...] = ()
    a_theta_paper: float = math.nan


def of_study(result: StudyResult, model: Path | str | None = None, folder: str = "") -> Answers:
    """Decide what a study answers; without trials and with a finding, what the search alone does.

    `model` and `folder` are named in commands, the folder by default by the name of the study.
    """
    paper, finding = load_paper(), result.finding
    speeds = speeds_of(result, paper)
    a_theta, agrees = a_theta_of(result.a_theta)
    channels = channels_of(gaps([r.comparison for r in result.trials]))
    questions = []
    if speeds:
        questions = [_slip(speeds), law_answer(result.a_theta, finding), model_answer(channels, finding)]
    elif finding is not None:
        alike, differ = finding.verdict == "none", _differ(finding, gap_pair(finding)[0])
        verdict, tone = ("Yes", "good") if alike else ("No", "fair")
        questions = [Answer("model", "Does the paper's model explain the sensors?", verdict, differ, tone)]
        questions += [law_answer(None, finding)] if finding.a_theta else []
    questions.append(missing_answer(finding, result.unsearched))
    questions += [closes_answer(finding)] if finding else []
    questions.append(_trust(result, finding))
    own = dict(result.source.options).get("effects", "")
    steps = next_steps(finding, model, folder or result.name, own) if finding else ()
    return Answers(
        _lead(result, speeds), _virtual(result), (*questions, *_next(steps)), steps, speeds, a_theta, agrees,
        channels, paper.a_theta,
    )  # fmt: skip


def _differ(finding: Finding, gap: float) -> str:
    """Say how far the sensors are from the model without effects."""
    text = (
        f"Sensors and model differ by {times(gap)} times what noise and a tolerance of "
        f"{percent(finding.tolerance)} of each sensor's rms explain, {gap_pair(finding)[2]}."
    )
    return text + (" Repetitions of a command differ from each other by more." if finding.scatter else "")


def _drove(trials: int, robots: Sequence[str], soils: Sequence[str], speeds: Sequence[float]) -> str:
    """Say what was driven; titles of robots and soils may repeat, and the most frequent ones come first."""
    # A title stands inside a sentence; an acronym keeps its capitals.
    small = [s[0].lower() + s[1:] if s[1:2].islower() else s for s in soils]
    robot, soil = (
        listed([name for name, _ in Counter(titles).most_common()])
        for titles in ([r.split(",")[0] for r in robots], small)
    )
    velocities = listed([f"{v:g}" for v in speeds])
    return f"{plural(trials, 'trial')} of {robot} driving straight on {soil} at {velocities} m/s"


def _lead(result: StudyResult, speeds: Sequence[Speed]) -> str:
    if not result.trials and result.finding is not None:
        robot, soil = result.finding.robot.title, result.finding.soil.title
        driven = {r.trial: r.variant for r in result.finding.residuals}
        return f"{_drove(len(driven), [robot], [soil], sorted(set(driven.values())))}."
    if not result.trials:
        return f"None of {len(result.failures)} trials could be used. The reasons are listed below."
    runs = [r.comparison.run for r in result.trials]
    robots, soils = [r.robot.title for r in runs], [r.soil.title for r in runs]
    counts = {len(s.results) for s in speeds}
    each = f" ({counts.pop()} at each speed)" if len(counts) == 1 and len(speeds) > 1 else ""
    excluded = sum(f.excluded for f in result.failures)
    failed = len(result.failures) - excluded
    left_out = f" {plural(failed, 'more trial')} could not be used." if failed else ""
    left_out += f" {plural(excluded, 'more trial')} excluded by the user." if excluded else ""
    return f"{_drove(len(runs), robots, soils, [s.velocity for s in speeds])}{each}.{left_out}"


def _virtual(result: StudyResult) -> str:
    if not result.trials and result.finding is not None and result.finding.virtual:
        return (
            "A simulator wrote the sensor logs of these trials; no robot was driven. Nothing here is about "
            "real sand."
        )
    count, n = (
        sum(r.trial.info.virtual or r.comparison.motion.virtual for r in result.trials),
        len(result.trials),
    )
    which = "All trials are" if count == n else f"{count} of {n} trials are"
    text = (
        f"{which} virtual: a simulator wrote the sensor logs and no robot was driven. “Measured” means "
        "estimated from the virtual sensors. Nothing here is about real sand."
    )
    return text if count else ""


def _slip(speeds: Sequence[Speed]) -> Answer:
    known = [s for s in speeds if math.isfinite(s.slip.value)]
    inside, outside = ([f"{s.velocity:g}" for s in known if s.agrees is agrees] for agrees in (True, False))
    verdict = " to ".join(
        f"{s.slip.quantity} at {s.velocity:g} m/s" for s in dict.fromkeys(known[:1] + known[-1:])
    )
    tone = "fair" if outside else "good"
    if not known:
        verdict, text, tone = "Not known", "No trial has a steady part with a slip ratio.", "bad"
    elif not inside and not outside:
        text, tone = "The paper has no experiment to compare with.", ""
    elif inside and outside:
        text = (
            f"The paper's experiment lies in the 95 % interval at {listed(inside)} m/s, and outside at "
            f"{listed(outside)} m/s."
        )
    else:
        every = " at every speed" if len(inside) + len(outside) > 1 else ""
        text = f"The paper's experiment lies {'outside' if outside else 'in'} the 95 % interval{every}."
    if alone := [f"{s.velocity:g}" for s in known if s.trials == 1]:
        text += (
            f" The interval of a single trial ({listed(alone)} m/s) leaves out the scatter between trials."
        )
    return Answer("slip", "How much does the robot slip?", verdict, text, tone)


def a_theta_of(fit: AThetaFit | None) -> tuple[Number | None, bool | None]:
    """Return a_θ as printed, and whether its interval holds the paper's; None with too few speeds."""
    if fit is None or not math.isfinite(fit.a_theta.value):
        return None, None
    number = decided(fit.a_theta.value, fit.a_theta.std, *fit.ci95, unit="s/m")
    return number, number.holds(fit.published) if _speeds_of(fit) >= SPEEDS else None


def _speeds_of(fit: AThetaFit) -> int:
    return len({round(velocity, 2) for _, velocity, _, _ in fit.points})


def law_answer(fit: AThetaFit | None, finding: Finding | None = None) -> Answer:
    """Say whether a_θ agrees with the paper's; a finding says whether the model lacks something."""
    number, agrees = a_theta_of(fit)
    question = f"Does a_θ agree with the paper's {load_paper().a_theta:g} s/m?"
    views = finding.a_theta if finding is not None and finding.a_theta else views_of(fit) if fit else ()
    depends = _depends(views)
    if fit is None or number is None:
        text = depends or "a_θ needs a trial in which k_92 could be fitted."
        return Answer("a_theta", question, "See below" if depends else "Not known", text)
    text = (
        f"By the files of soil and robot as they are, a_θ = {number.with_std} s/m, 95 % interval "
        f"{number.interval} s/m, from {plural(len(fit.points), 'trial')}.{depends}"
    )
    if agrees is None:
        few = _speeds_of(fit)
        text += f" A test of the law k_92 = exp(−a_θ v) needs {SPEEDS} speeds; these trials have {few}."
        return Answer("a_theta", question, "Not tested", text)
    if agrees:
        return Answer("a_theta", question, "Yes", text, "good")
    way = "above" if number.value > fit.published else "below"
    text += f" By the files it is {percent(abs(number.value / fit.published - 1))} {way} the paper's."
    if finding is not None and finding.effects:
        text += " k_92 is fitted with the paper's model there, so that what is missing can cause this."
    held = any(v.ci95[0] <= fit.published <= v.ci95[1] for v in views if v.by != "files")
    return Answer("a_theta", question, "Not by these files alone" if held else "No", text, "fair")


def _depends(views: Sequence[View]) -> str:
    """Say how far a_θ depends on the files of soil and robot, and on what was found; empty if not known."""
    by = {v.by: v for v in views}
    text = ""
    if (wide := by.get("uncertain")) is not None:
        most = next(part.name for part in wide.parts if part.name != TRIALS)
        ends = interval(*wide.ci95, "s/m")
        text += f" With the uncertainty of soil and wheel radius, most of it of {most}: {ends}."
    if (found := by.get("found")) is not None:
        number = decided(found.a_theta.value, found.a_theta.std, *found.ci95)
        text += (
            " With the soil fitted to all sensors and what was found in the model: "
            f"{number.with_std} s/m, {number.interval} s/m."
        )
    return text


def model_answer(channels: Sequence[ChannelAnswer], finding: Finding | None = None) -> Answer:
    """Say how well the model explains the measured motion."""
    agree = [c for c in channels if c.tone == "good"]
    differ = sorted((c for c in channels if c.differs), key=lambda c: -c.rms / c.noise)
    unseen = [c.name for c in channels if not c.tone]
    question = "Does the paper's model explain the measurements?"
    if not agree and not differ:
        return Answer("model", question, "Not known", "The noise of the measured quantities is not known.")
    text = f"{len(agree)} of {plural(len(channels), 'quantity')} agree with the simulation."
    if differ:
        worst, names = differ[0], capital(together([c.name for c in differ]))
        text += (
            f" {names} {'differs' if len(differ) == 1 else 'differ'}; largest against its noise: "
            f"{worst.name}, {with_unit(significant(worst.rms, 2), worst.unit)} rms, "
            f"{significant(worst.rms / worst.noise, 2)} times the noise."
        )
    if unseen:
        text += f" Not judged: {listed(unseen)}."
    missing = finding is not None and finding.verdict != "none"
    verdict, tone = "In part", "fair"
    if not differ and missing:
        text += " The readings of the sensors show more: see what is missing."
    elif not differ:
        verdict, tone = "Yes", "good"
    elif finding is not None and not missing:
        verdict, tone = "Yes, once the sand is fitted", "good"
        text = f"With the sand of the parameter file: {text} With the sand fitted, the sensors agree too."
    elif not agree:
        verdict, tone = "No", "bad"
    return Answer("model", question, verdict, text, tone)


def missing_answer(finding: Finding | None, reason: str = "") -> Answer:
    """Say which effect the model lacks, with its sizes; `reason` says why nothing was searched."""
    question = "What is missing from the model?"
    if finding is None:
        text = reason and f"{capital(reason).rstrip('.')}."
        return Answer("missing", question, "Not searched", text or "No search for a missing effect was run.")
    if finding.verdict == "none":
        tone = "fair" if finding.provisional else "good"
        text = "No effect of the library and no other disagreement exceeds noise and tolerance."
        return Answer("missing", question, "Nothing that these trials show", text, tone)
    sizes = "; ".join(describe(e) for e in finding.effects)
    more = "; ".join(describe(e) for e in finding.description)
    describes = [f"A description of the rest, not its cause: {more}."] if more else []
    if finding.verdict == "unknown":
        text = f"No effect of the library explains the disagreement. {' '.join(describes)}"
        text = text if describes else in_plain_words(finding.sentence, finding)
        return Answer("missing", question, "Something unknown", text, "bad")
    twins = [
        f"These trials cannot tell {plain(e.id)} from {listed([plain(t) for t in e.twins], 'or')}."
        for e in finding.effects
        if e.twins
    ]
    whole = finding.verdict == "named"
    verdict = capital(listed([plain(e.id) for e in finding.effects] + ([] if whole else ["more"])))
    tone = "fair" if twins or finding.provisional or finding.remainder > MUCH or not whole else "good"
    return Answer("missing", question, verdict, " ".join([f"{capital(sizes)}.", *twins, *describes]), tone)


def gap_pair(finding: Finding) -> tuple[float, float, str]:
    """Return the gap without and with what was found, on trials left out where there are, and say where."""
    if math.isfinite(finding.gap.held_out[0]):
        return (*finding.gap.held_out, "on trials that were left out of the fit")
    return (*finding.gap.train, "in the fit")


def closes_answer(finding: Finding) -> Answer:
    """Say how much of the gap between sensors and model closes with what was found."""
    question = "How much of the gap does it close?"
    before, after, where = gap_pair(finding)
    if not finding.terms:
        verdict = "No gap" if finding.verdict == "none" else "Nothing"
        return Answer("closes", question, verdict, _differ(finding, before))
    text = (
        f"{capital(where)}, the difference between sensors and model falls from {times(before)} to "
        f"{times(after)} times what noise and a tolerance of {percent(finding.tolerance)} of each sensor's "
        "rms explain."
    )
    closes = 1 - finding.remainder
    verdict = capital(percent(min(max(closes, 0.0), 1.0))) if math.isfinite(closes) else "Not known"
    known = finding.remainder <= MUCH and math.isfinite(finding.gap.held_out[0])
    return Answer("closes", question, verdict, text, "good" if known else "fair")


def _trust(result: StudyResult, finding: Finding | None) -> Answer:
    """Say what speaks for the answers, and every doubt."""
    grounds, doubts = [], []
    doubtful = [r.trial.name for r in result.trials if not r.comparison.motion.health.good]
    n = len(result.trials)
    if doubtful:
        more = f" and {len(doubtful) - 3} more" if len(doubtful) > 3 else ""
        named = ", ".join(doubtful[:3])
        doubts.append(f"{len(doubtful)} of {plural(n, 'estimate')} doubtful ({named}{more})")
    elif n:
        which = {1: "The motion estimate is", 2: "Both motion estimates are"}
        grounds.append(f"{which.get(n, f'All {n} motion estimates are')} good.")
    if failed := sum(not f.excluded for f in result.failures):
        doubts.append(f"{plural(failed, 'trial')} could not be used")
    if finding is None or not finding.provisional:
        speeds = by_speed(velocities_of(result))
        doubts += [f"only {plural(len(speeds), 'speed')}"] if 0 < len(speeds) < SPEEDS else []
        doubts += ["no speed was driven twice"] if speeds and max(map(len, speeds.values())) < 2 else []
    if finding is not None:
        doubts += [reason.rstrip(".") for reason in finding.provisional]
        doubts += [f"{plain(e.id)} has a twin" for e in finding.effects if e.twins]
        if finding.dropped:
            doubts.append(f"{plural(len(finding.dropped), 'trial')} left out because no model fits")
        grounds.append(f"Probability of the finding: {chance(finding.probability)}.")
        left = ((finding.trials_left_out, "trials"), (finding.speeds_left_out, "speeds"))
        counts = [f"{sum(x.after < x.before for x in f)} of {len(f)} {what}" for f, what in left if f]
        if finding.effects and counts:
            grounds.append(f"{listed(counts)} left out of the fit are predicted better.")
        elif finding.effects:
            doubts.append("nothing could be left out of the fit, so that no prediction tests it")
    doubt = [f"Doubts: {'; '.join(doubts)}."] if doubts else []
    radius = " The slip holds no error of the wheel radius (1 % of it is 1 point of slip)." if n else ""
    text = " ".join([*grounds, *doubt, f"Valid for these speeds, this robot and this sand.{radius}"])
    verdict, tone = ("With care", "fair") if doubts else ("Well, for trials like these", "good")
    return Answer("trust", "How far can this be trusted?", verdict, text, tone)


def _next(steps: Sequence[str]) -> tuple[Answer, ...]:
    if not steps:
        return ()
    text, command = parted(steps[0])
    return (Answer("next", "What to do next?", "", text, command=command),)


def parted(step: str) -> tuple[str, str]:
    """Return the sentence of a step and its command, empty where there is none."""
    text, _, command = step.partition(": granite-lab ")
    return f"{text.rstrip('.')}.", f"granite-lab {command.rstrip('.')}" if command else ""


def plural(n: int, what: str) -> str:
    """Return a number of things in words: "1 trial", "2 quantities"."""
    many = f"{what[:-1]}ies" if what.endswith("ity") else f"{what}s"
    return f"{n} {what if n == 1 else many}"
