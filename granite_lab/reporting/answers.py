"""What a report answers: every number decided and rounded here, and printed from here everywhere."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granite_lab.discovery.finding import Finding
from granite_lab.estimate import mean_over
from granite_lab.fitting.fit import AThetaFit
from granite_lab.parameters import Paper, by_speed, load_paper
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
from granite_lab.reporting.rounding import (
    Number,
    chance,
    decided,
    percent,
    shown_as,
    significant,
    tidy_unit,
    times,
    with_unit,
)  # fmt: skip
from granite_lab.reporting.words import PHASES, quantity, said
from granite_lab.results import Gap, StudyResult, TrialResult, gaps

NOISE, CLEAR = 1.5, 3.0
"""Difference over noise up to which a channel agrees, and above which it differs clearly."""

SMALL, UNSEEN = 0.01, 0.2
"""Shares of a channel's largest value: a difference below the first is small; noise above the second is
too large for a judgement."""


@dataclass(frozen=True, eq=False)
class Speed:
    """All trials at one desired velocity.

    Attributes:
        velocity: desired velocity [m/s].
        results: the trials.
        trials: how many have a slip ratio.
        slip: mean λ_R over the trials [%], with its standard error and 95 % interval.
        k92: mean of k_92 fitted to the steady slip [–], likewise.
        k92_note: stands in place of k_92 where no trial has an inner optimum.
        paper_slip: λ_R of the paper's experiment [%] as printed there; NaN where it has none.
        paper_k92: k_92 of the paper; NaN likewise.
    """

    velocity: float
    results: tuple[TrialResult, ...]
    trials: int
    slip: Number
    k92: Number
    k92_note: str
    paper_slip: float
    paper_k92: float

    @property
    def agrees(self) -> bool | None:
        """Whether the paper's slip lies in the interval as printed; None where that cannot be said."""
        return self.slip.holds(self.paper_slip)

    @property
    def typical(self) -> TrialResult:
        """The trial whose λ_R is in the middle; the one that is drawn."""
        slips = np.array([r.comparison.motion.slip_ratio.value for r in self.results])
        ranked = np.argsort(slips)  # NaN last
        return self.results[int(ranked[max(int(np.isfinite(slips).sum()) - 1, 0) // 2])]


def speeds_of(result: StudyResult, paper: Paper) -> tuple[Speed, ...]:
    """Group the trials by desired velocity (`parameters.by_speed`)."""
    from granite_lab.fitting.atheta import k92_interval  # noqa: PLC0415, heavy

    rows = []
    for velocity, positions in by_speed(_velocities(result)).items():
        trials = [result.trials[i] for i in positions]
        fits = [t.comparison.fit for t in trials]
        inner = [f for f in fits if f.status == "ok"]
        *slip, count = mean_over(t.comparison.motion.slip_ratio for t in trials)
        k92 = mean_over(f.k92 for f in inner)
        # The interval is by the likelihood where the covariance is not enough.
        ends = k92_interval(inner, (k92.low, k92.high))
        own = next((p for p in paper.table3 if abs(p.velocity - velocity) < 0.005), None)
        rows.append(
            Speed(
                velocity, tuple(trials), count, decided(*slip, unit="%", scale=100),
                decided(k92.value, k92.std, *ends),
                "at its limit" if all(f.status.endswith("bound") for f in fits) else "",
                # The paper prints three digits; the tail of 100 times a fraction is none of them.
                round(100 * own.slip_measured, 6) if own else math.nan, own.k92 if own else math.nan,
            )
        )  # fmt: skip
    return tuple(rows)


def _velocities(result: StudyResult) -> list[float]:
    return [trial.comparison.motion.variant.velocity for trial in result.trials]


@dataclass(frozen=True)
class ChannelAnswer:
    """How well the model explains one quantity over whole trials.

    Attributes:
        channel, name: as in `Gap`, and as a reader calls it.
        unit: of `rms`, `noise` (std of the measurement) and `largest` (simulated magnitude), as printed.
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
    def differs(self) -> bool:
        """Whether simulation and measurement differ by more than the noise."""
        return self.tone in ("fair", "bad")


def channels_of(found: dict[tuple[str, str], Gap]) -> tuple[ChannelAnswer, ...]:
    """Judge each channel over whole trials."""
    judged = []
    for gap in (g for g in found.values() if g.phase == "all"):
        unit, scale = shown_as(gap.unit)
        noise = gap.rms / gap.normalised if gap.normalised > 0 else math.nan
        phases = [found[gap.channel, p] for p in PHASES if (gap.channel, p) in found]
        known = [g for g in phases if math.isfinite(g.normalised)]
        worst = PHASES[max(known, key=lambda g: g.normalised).phase] if known else ""
        sizes = (gap.rms * scale, noise * scale, gap.size * scale)
        judged.append(
            ChannelAnswer(
                gap.channel, quantity(gap.channel), tidy_unit(unit), *sizes, *_judge(gap, noise), worst
            )
        )
    return tuple(judged)


def _judge(gap: Gap, noise: float) -> tuple[str, str]:
    if not math.isfinite(gap.normalised):
        return "not judged, noise not known", ""
    if gap.normalised <= NOISE:
        if gap.size > 0 and noise > UNSEEN * gap.size:
            return "not judged, too noisy", ""
        return "agrees", "good"
    if gap.size > 0 and gap.rms < SMALL * gap.size:
        return f"differs by under {with_unit(significant(100 * SMALL, 1), '%')}", "good"
    return ("differs", "fair") if gap.normalised <= CLEAR else ("differs clearly", "bad")


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
        questions = [Answer("model", said("questions", "sensors"), verdict, differ, tone)]
    questions.append(missing_answer(finding, result.unsearched))
    questions += [closes_answer(finding)] if finding else []
    questions.append(_trust(result, finding))
    steps = next_steps(finding, model, folder or result.name) if finding else ()
    return Answers(
        _lead(result, speeds), _virtual(result), (*questions, *_next(steps)), steps, speeds, a_theta, agrees,
        channels, paper.a_theta,
    )  # fmt: skip


def _differ(finding: Finding, gap: float) -> str:
    """Say how far the sensors are from the model without effects."""
    where = gap_pair(finding)[2]
    text = said("answers", "differ", gap=times(gap), tolerance=percent(finding.tolerance), where=where)
    return text + (said("answers", "repetitions") if finding.scatter else "")


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
        return said("page", "virtual_search")
    count, n = (
        sum(r.trial.info.virtual or r.comparison.motion.virtual for r in result.trials),
        len(result.trials),
    )
    which = "All trials are" if count == n else f"{count} of {n} trials are"
    return said("page", "virtual_study", which=which) if count else ""


def _slip(speeds: Sequence[Speed]) -> Answer:
    known = [s for s in speeds if math.isfinite(s.slip.value)]
    inside, outside = ([f"{s.velocity:g}" for s in known if s.agrees is agrees] for agrees in (True, False))
    verdict = " to ".join(
        f"{s.slip.quantity} at {s.velocity:g} m/s" for s in dict.fromkeys(known[:1] + known[-1:])
    )
    tone = "fair" if outside else "good"
    if not known:
        verdict, text, tone = "Not known", said("answers", "no_slip"), "bad"
    elif not inside and not outside:
        text, tone = said("answers", "no_experiment"), ""
    elif inside and outside:
        text = said("answers", "slip_in_part", inside=listed(inside), outside=listed(outside))
    else:
        every = " at every speed" if len(inside) + len(outside) > 1 else ""
        text = said("answers", "slip", place="outside" if outside else "in", every=every)
    if alone := [f"{s.velocity:g}" for s in known if s.trials == 1]:
        text += said("answers", "one_trial", speeds=listed(alone))
    return Answer("slip", said("questions", "slip"), verdict, text, tone)


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
    question = said("questions", "a_theta", paper=load_paper().a_theta)
    if fit is None or number is None:
        return Answer("a_theta", question, "Not known", said("answers", "no_law"))
    text = said("answers", "law", number=number, trials=plural(len(fit.points), "trial"))
    if agrees is None:
        text += said("answers", "law_untested", least=SPEEDS, speeds=_speeds_of(fit))
        return Answer("a_theta", question, "Not tested", text)
    if agrees:
        return Answer("a_theta", question, "Yes", text, "good")
    way = "above" if number.value > fit.published else "below"
    text += said("answers", "law_off", by=percent(abs(number.value / fit.published - 1)), way=way)
    if finding is not None and finding.effects:
        text += said("answers", "law_missing")
    return Answer("a_theta", question, "No", text, "fair")


def model_answer(channels: Sequence[ChannelAnswer], finding: Finding | None = None) -> Answer:
    """Say how well the model explains the measured motion."""
    agree = [c for c in channels if c.tone == "good"]
    differ = sorted((c for c in channels if c.differs), key=lambda c: -c.rms / c.noise)
    unseen = [c.name for c in channels if not c.tone]
    question = said("questions", "model")
    if not agree and not differ:
        return Answer("model", question, "Not known", said("answers", "no_noise"))
    text = f"{len(agree)} of {plural(len(channels), 'quantity')} agree with the simulation."
    if differ:
        worst, names = differ[0], capital(together([c.name for c in differ]))
        text += said(
            "answers", "worst", names=names, verb="differs" if len(differ) == 1 else "differ",
            worst=worst.name, rms=with_unit(significant(worst.rms, 2), worst.unit),
            over=significant(worst.rms / worst.noise, 2),
        )  # fmt: skip
    if unseen:
        text += f" Not judged: {listed(unseen)}."
    missing = finding is not None and finding.verdict != "none"
    verdict, tone = "In part", "fair"
    if not differ and missing:
        text += said("answers", "sensors_more")
    elif not differ:
        verdict, tone = "Yes", "good"
    elif finding is not None and not missing:
        verdict, tone = "Yes, once the sand is fitted", "good"
        text = said("answers", "sand_fitted", text=text)
    elif not agree:
        verdict, tone = "No", "bad"
    return Answer("model", question, verdict, text, tone)


def missing_answer(finding: Finding | None, reason: str = "") -> Answer:
    """Say which effect the model lacks, with its sizes; `reason` says why nothing was searched."""
    question = said("questions", "missing")
    if finding is None:
        text = reason and f"{capital(reason).rstrip('.')}."
        return Answer("missing", question, "Not searched", text or said("answers", "not_searched"))
    if finding.verdict == "none":
        tone = "fair" if finding.provisional else "good"
        return Answer("missing", question, "Nothing that these trials show", said("answers", "nothing"), tone)
    sizes = "; ".join(describe(e) for e in finding.effects)
    if finding.verdict == "unknown":
        text = f"{said('answers', 'unknown')} An empirical law stands in for it: {sizes}."
        text = text if finding.effects else in_plain_words(finding.sentence, finding)
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
    if math.isfinite(finding.gap.held_out[0]):
        return (*finding.gap.held_out, "on trials that were left out of the fit")
    return (*finding.gap.train, "in the fit")


def closes_answer(finding: Finding) -> Answer:
    """Say how much of the gap between sensors and model closes with what was found."""
    question = said("questions", "closes")
    before, after, where = gap_pair(finding)
    if not finding.effects:
        verdict = "No gap" if finding.verdict == "none" else "Nothing"
        return Answer("closes", question, verdict, _differ(finding, before))
    text = said(
        "answers", "closes", where=capital(where), before=times(before), after=times(after),
        tolerance=percent(finding.tolerance),
    )  # fmt: skip
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
        speeds = by_speed(_velocities(result))
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
            doubts.append(said("answers", "no_prediction"))
    doubt = [f"Doubts: {'; '.join(doubts)}."] if doubts else []
    text = " ".join([*grounds, *doubt, said("answers", "valid")]) + (said("answers", "radius") if n else "")
    verdict, tone = ("With care", "fair") if doubts else ("Well, for trials like these", "good")
    return Answer("trust", said("questions", "trust"), verdict, text, tone)


def _next(steps: Sequence[str]) -> tuple[Answer, ...]:
    if not steps:
        return ()
    text, command = parted(steps[0])
    return (Answer("next", said("questions", "next"), "", text, command=command),)


def parted(step: str) -> tuple[str, str]:
    """Return the sentence of a step and its command, empty where there is none."""
    text, _, command = step.partition(": granite-lab ")
    return f"{text.rstrip('.')}.", f"granite-lab {command.rstrip('.')}" if command else ""


def plural(n: int, what: str) -> str:
    """Return a number of things in words: "1 trial", "2 quantities"."""
    many = f"{what[:-1]}ies" if what.endswith("ity") else f"{what}s"
    return f"{n} {what if n == 1 else many}"
