"""The answers of a report: each number is computed and rounded here, and all outputs print it from here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from granite_lab.columns import FilledTable
from granite_lab.discovery.finding import SIMULATES_WORSE, UNCONVERGED, Finding
from granite_lab.discovery.words import waving
from granite_lab.estimate import mean_over
from granite_lab.estimation.motion import no_slip_is_known
from granite_lab.estimation.plausibility import BY_RADIUS
from granite_lab.fitting.fit import TRIALS, AThetaFit, View, ViewName, views_of
from granite_lab.inference.constants import FEWEST_SPEEDS
from granite_lab.parameters import by_speed, load_paper
from granite_lab.reporting.channels import AGREES, SMALL, ChannelAnswer, judged_channels
from granite_lab.reporting.driven import lead, of_simulator
from granite_lab.reporting.names import (
    MUCH,
    Step,
    capital,
    describe,
    in_plain_words,
    listed,
    next_steps,
    plain,
    sensor,
    strained_in_words,
    together,
    twins_of,
)
from granite_lab.reporting.speeds import (
    REMEDY,
    Speed,
    first_table,
    published_at,
    reach_in_words,
    speeds_of,
    velocities_of,
    why_no_k92,
)
from granite_lab.results import StudyResult, pooled_misfits
from granite_lab.rounding import (
    Number,
    chance,
    interval,
    percent,
    plural,
    rounded,
    significant,
    times,
    with_unit,
)  # fmt: skip

MODEL_QUESTION = "Does the paper's model explain the measurements?"

LAW = "k_92 falls with the desired velocity v as exp(−a_θ v)."

DISAGREES = 3.0
"""Difference of two numbers, in standard deviations, above which they disagree."""


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
        a_theta_agrees: the paper's value lies in the interval as printed; None with too few speeds, or where
            the interval holds 0.
        channels: of the comparison of measured and simulated motion.
        slip_unknown: no slip ratio is known well enough for k_92, a comparison with the model or a search.
    """

    lead: str
    virtual: str
    questions: tuple[Answer, ...]
    steps: tuple[Step, ...]
    speeds: tuple[Speed, ...] = ()
    a_theta: Number | None = None
    a_theta_agrees: bool | None = None
    channels: tuple[ChannelAnswer, ...] = ()
    slip_unknown: bool = False

    @property
    def table(self) -> FilledTable | None:
        """Slip and k_92 by speed, beside the answers; None where it would hold nothing that is known."""
        return first_table(self.speeds, slip_unknown=self.slip_unknown, virtual=bool(self.virtual))


def of_study(result: StudyResult, model: Path | str | None = None, folder: str = "") -> Answers:
    """Compute the answers of a study, or of a search alone, which has a finding and no trials.

    Args:
        result: the study.
        model: path of the model file, for the commands that use it.
        folder: of the report, for the same; by default the name of the study.
    """
    finding, speeds = result.finding, speeds_of(result)
    a_theta, agrees = a_theta_of(result.a_theta)
    channels = judged_channels(pooled_misfits(result.trials), finding)
    questions, no_k92 = [], why_no_k92(result)
    if slip_unknown := no_slip_is_known([r.motion for r in result.trials]):
        speeds = tuple(replace(s, k92_note="not known") for s in speeds)
        questions = [_slip(speeds), _k92_answer(no_k92)]
    elif speeds:
        unknown = no_k92 and not (finding and finding.a_theta)
        law = _k92_answer(no_k92) if unknown else law_answer(result.a_theta, finding)
        questions = [_slip(speeds), law, model_answer(channels, finding)]
    elif finding is not None:
        verdict, tone, sensors = explained(finding)
        text = f"{sensors} {_differ(finding, gap_pair(finding)[0])}"
        questions = [Answer("model", MODEL_QUESTION, verdict, text, tone)]
        questions += [law_answer(None, finding)] if finding.a_theta else []
    questions += [] if slip_unknown else [missing_answer(finding, result.unsearched)]
    questions += [closes_answer(finding)] if finding else []
    questions.append(_trust(result, finding))
    user_effects = dict(result.source.options).get("effects", "")
    steps: tuple[Step, ...] = (Step(REMEDY),) if slip_unknown else ()
    if finding is not None:
        steps = next_steps(finding, model, folder or result.name, user_effects)
    if steps:
        questions.append(Answer("next", "What to do next?", "", steps[0].text, command=steps[0].command))
    return Answers(
        lead(result, speeds), of_simulator(result), tuple(questions), steps, speeds, a_theta, agrees,
        channels, slip_unknown,
    )  # fmt: skip


def explained(finding: Finding) -> tuple[str, str, str]:
    """Say whether the model explains the sensors it was fitted to: verdict, its tone, and how many agree."""
    within = sum(g.train[0] <= 1.0 for g in finding.gaps)
    text = f"Once the model is fitted to all sensors, {within} of {len(finding.gaps)} sensors agree with it."
    if finding.verdict == "none":
        return "Yes", "good", text
    return ("In part", "fair", text) if within else ("No", "bad", text)


def _differ(finding: Finding, gap: float) -> str:
    """Say how far the sensors are from the model without effects."""
    text = f"Gap {gap_pair(finding)[2]}: {times(gap)}. {scale_of_gap(finding)}"
    return text + (
        " Repetitions of a command differ more than that from each other." if finding.scatter else ""
    )


def _slip(speeds: Sequence[Speed]) -> Answer:
    with_slip = [s for s in speeds if s.slip_is_known]
    inside, outside = (
        [f"{s.velocity:g}" for s in with_slip if s.agrees is agrees] for agrees in (True, False)
    )
    verdict = " to ".join(
        f"{with_unit(s.slip.with_std, s.slip.unit)} at {s.velocity:g} m/s"
        for s in dict.fromkeys(with_slip[:1] + with_slip[-1:])
    )
    tone = "fair" if outside else "good"
    if not with_slip:
        text = "No trial has a steady part with a slip ratio that is known."
        verdict, tone = "Not known", "bad"
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
    if alone := [f"{s.velocity:g}" for s in with_slip if s.trials == 1]:
        text += (
            f" The interval of a single trial ({listed(alone)} m/s) does not include the scatter between "
            "trials."
        )
    text = " ".join(filter(None, (text, reach_in_words(speeds))))
    return Answer("slip", "How much does the robot slip?", verdict, text, tone)


def _k92_answer(why: str) -> Answer:
    return Answer("k92", "Which k_92 do the trials have?", "None", why, "bad")


def a_theta_of(fit: AThetaFit | None) -> tuple[Number | None, bool | None]:
    """Return a_θ as printed, and whether its interval holds the paper's; None where it cannot be tested."""
    if fit is None or not math.isfinite(fit.a_theta.value):
        return None, None
    number = rounded(fit.a_theta.value, fit.a_theta.std, *fit.ci95, unit="s/m")
    return number, number.holds(fit.published) if _speeds_of(fit) >= FEWEST_SPEEDS and fit.ci95[
        0
    ] > 0 else None


def _k92_off(fit: AThetaFit) -> dict[float, float]:
    """Return the speeds at which the mean k_92 differs from the paper's, and by how many of its std."""
    distances = {}
    for velocity, positions in by_speed(v for _, v, _, _ in fit.points).items():
        k92 = mean_over(fit.points[i][2] for i in positions)
        published = published_at(velocity)
        distances[velocity] = (
            abs(k92.value - published.k92) / k92.std if published and k92.std > 0 else math.nan
        )
    return {velocity: far for velocity, far in distances.items() if far > DISAGREES}


def _speeds_of(fit: AThetaFit) -> int:
    return len(by_speed(velocity for _, velocity, _, _ in fit.points))


def law_answer(fit: AThetaFit | None, finding: Finding | None = None) -> Answer:
    """Say whether a_θ agrees with the paper's; a finding says whether the model lacks something."""
    number, agrees = a_theta_of(fit)
    question = f"Does a_θ agree with the paper's {load_paper().a_theta:g} s/m?"
    stated = finding.a_theta if finding is not None and finding.a_theta else views_of(fit) if fit else ()
    views = {view.by: view for view in stated}
    depends = _depends(views)
    if fit is None or number is None:
        if views:
            return _by_views(question, views, depends)
        return Answer("a_theta", question, "Not known", "a_θ needs a trial in which k_92 could be fitted.")
    text = (
        f"{LAW} With soil and robot as in their files, a_θ = {number.with_std} s/m, 95 % interval "
        f"{number.interval} s/m, from {plural(len(fit.points), 'trial')}.{depends}"
    )
    speeds = _speeds_of(fit)
    if agrees is None and speeds >= FEWEST_SPEEDS:
        text += " The interval holds 0: these trials do not show that k_92 falls with the velocity."
        return Answer("a_theta", question, "Not known", text)
    if agrees is None:
        text += f" A test of this law needs {FEWEST_SPEEDS} speeds; these trials have {speeds}."
        return Answer("a_theta", question, "Not tested", text)
    if agrees:
        but, more = _limits(fit, views)
        return Answer("a_theta", question, f"Yes{but}", f"{text}{more}", "fair" if but else "good")
    way = "above" if number.value > fit.published else "below"
    text += f" It is {percent(abs(number.value / fit.published - 1))} {way} the paper's."
    if finding is not None and finding.effects:
        text += (
            " This k_92 is fitted with the paper's model; what is missing from the model can cause the "
            "difference."
        )
    inside = any(_holds(view, fit.published) for by, view in views.items() if by != "files")
    return Answer("a_theta", question, "Not by these files alone" if inside else "No", text, "fair")


def _holds(view: View, a_theta: float) -> bool:
    """Say whether the interval of a view holds a value [s/m]."""
    return view.ci95[0] <= a_theta <= view.ci95[1]


def _limits(fit: AThetaFit, views: Mapping[ViewName, View]) -> tuple[str, str]:
    """Return what limits the answer that a_θ agrees by the files, and the numbers of it."""
    but, more = "", ""
    if off := _k92_off(fit):
        where, far = listed([f"{v:g}" for v in off]), listed([significant(x, 2) for x in off.values()])
        but = f", but not k_92 at {where} m/s"
        more = f" k_92 itself lies {far} std from the paper's at {where} m/s."
    if "found" in views and not _holds(views["found"], fit.published):
        but = " by these files, but not with what was found"
    return but, more


def _by_views(question: str, views: Mapping[ViewName, View], depends: str) -> Answer:
    """Answer of a search alone: by the model with what was found."""
    *_, last = views.values()
    agrees = _holds(last, load_paper().a_theta)
    text = f"With soil and robot as in their files: {_stated(views['files'])}" if "files" in views else ""
    verdict, tone = ("Yes, with what was found", "good") if agrees else ("No", "fair")
    return Answer("a_theta", question, verdict, f"{LAW} {text.strip()}{depends}", tone)


def _stated(view: View) -> str:
    """Return a_θ by a view, with its std and its interval."""
    number = rounded(view.a_theta.value, view.a_theta.std, *view.ci95)
    return f"{number.with_std} s/m, {number.interval} s/m."


def _depends(views: Mapping[ViewName, View]) -> str:
    """Say how far a_θ depends on the files of soil and robot, and on what was found; empty if not known."""
    text = ""
    if (wide := views.get("uncertain")) is not None:
        most = next(part.name for part in wide.parts if part.name != TRIALS).replace(",", "")
        ends = interval(*wide.ci95, "s/m")
        text += f" With the uncertainty of soil and wheel radius, mostly from {most}, the interval is {ends}."
    if "found" in views:
        added = "With the soil fitted to all sensors and what was found added to the model:"
        text += f" {added} {_stated(views['found'])}"
    return text


def model_answer(channels: Sequence[ChannelAnswer], finding: Finding | None = None) -> Answer:
    """Say how well the model explains the measured motion."""
    agree = [c for c in channels if c.tone == "good"]
    differ = sorted((c for c in channels if c.differs), key=lambda c: -c.rms / c.noise)
    unseen = [c.name for c in channels if not c.tone]
    question = MODEL_QUESTION
    if not agree and not differ:
        return Answer("model", question, "Not known", "The noise of the measured quantities is not known.")
    nearly = f" or differ by under {percent(SMALL)}" if any(c.verdict != AGREES for c in agree) else ""
    text = f"{len(agree)} of {plural(len(channels), 'quantity')} agree with the simulation{nearly}."
    if differ:
        worst, names = differ[0], capital(together([c.name for c in differ]))
        text += (
            f" {names} {'differs' if len(differ) == 1 else 'differ'}. Largest relative to its noise: "
            f"{worst.name}, {with_unit(significant(worst.rms, 2), worst.unit)} rms, "
            f"{significant(worst.rms / worst.noise, 2)} times the noise."
        )
    if unseen:
        text += f" Not judged: {listed(unseen)}."
    verdict, tone = "In part", "fair"
    if finding is not None and finding.verdict != "none":
        verdict, tone, sensors = explained(finding)
        text += f" {sensors}"
    elif not differ:
        verdict, tone = "Yes", "good"
    elif finding is not None:
        verdict, tone = "Yes, once the sand is fitted", "good"
        text = f"With the sand of the parameter file: {text} With the sand fitted, all sensors agree."
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
    describes = _described(finding)
    if finding.verdict == "unknown":
        likely = [plain(e.id) for e in finding.likely]
        verdict = f"Likely {listed(likely)}, but not for certain" if likely else "Something unknown"
        first = "No effect is sure enough to be named." if likely else "No effect of the library explains it."
        text = " ".join([first, *describes])
        text = text if finding.description else in_plain_words(finding.sentence, finding)
        return Answer("missing", question, verdict, text, "bad")
    sizes = "; ".join(describe(e) for e in finding.effects)
    twins = [
        f"These trials cannot tell {plain(e.id)} from {twins_of(e)}." for e in finding.effects if e.twins
    ]
    whole, rest = finding.verdict == "named", "waves of the ground" if finding.ground_wave else "more"
    verdict = capital(listed([plain(e.id) for e in finding.effects] + ([] if whole else [rest])))
    tone = "fair" if twins or finding.provisional or finding.remainder > MUCH or not whole else "good"
    return Answer("missing", question, verdict, " ".join([f"{capital(sizes)}.", *twins, *describes]), tone)


def _described(finding: Finding) -> list[str]:
    """Return a sentence each on what is likely, on what only describes, and on waves of the ground."""
    likely = [f"{describe(e)}, {chance(e.probability)}" for e in finding.likely]
    rest = [describe(e) for e in finding.causeless]
    described = []
    if likely:
        described.append(f"Likely, but not sure: {'; '.join(likely)}.")
    if rest:
        described.append(f"A description of the rest, not its cause: {'; '.join(rest)}.")
    if not described:
        several = len(finding.effects) > 1
        described.append(
            "All are effects, none a description." if several else "It is an effect, not a description."
        )
    if finding.ground_wave:
        described.append(in_plain_words(waving(finding.ground_wave), finding))
    return described


def gap_pair(finding: Finding) -> tuple[float, float, str]:
    """Return the gap without and with what was found, on trials left out where there are, and say where."""
    if math.isfinite(finding.gap.held_out[0]):
        return (*finding.gap.held_out, "on trials that were left out of the fit")
    return (*finding.gap.train, "in the fit")


def scale_of_gap(finding: Finding) -> str:
    """Say what the size of a gap means."""
    return (
        f"1 means that noise and a tolerance of {percent(finding.tolerance)} of each sensor's rms explain "
        "the difference between sensors and model."
    )


def closes_answer(finding: Finding) -> Answer:
    """Say how much of the gap between sensors and model closes with what was found."""
    question = "How much of the gap does it close?"
    before, after, where = gap_pair(finding)
    if not finding.terms:
        verdict = "No gap" if finding.verdict == "none" else "Nothing"
        return Answer("closes", question, verdict, _differ(finding, before))
    text = f"Gap {where}: {times(before)} with the paper's model, {times(after)} with what was found. "
    if finding.simulates_worse:
        own = "With numbers that each trial has of its own, and no simulation has, the gap"
        text = f"{SIMULATES_WORSE}. {own} {text.removeprefix('Gap ')}"
    text += scale_of_gap(finding)
    if finding.ground_wave:
        text += " The waves of the ground count as noise here."
    remain = sorted((g for g in finding.gaps if g.train[1] > 1.0), key=lambda g: -g.train[1])
    if remain:
        sizes = listed([f"{sensor(g.channel)} ({times(g.train[1])} times)" for g in remain])
        text += f" Still beyond the tolerance: {sizes}."
    closes = 1 - finding.remainder
    verdict = capital(percent(min(max(closes, 0.0), 1.0))) if math.isfinite(closes) else "Not known"
    tested = finding.remainder <= MUCH and math.isfinite(finding.gap.held_out[0])
    return Answer("closes", question, verdict, text, "good" if tested else "fair")


def _trust(result: StudyResult, finding: Finding | None) -> Answer:
    """Return the grounds for the answers, and every doubt."""
    grounds, doubts = [], []
    doubtful = [r.trial.name for r in result.trials if not r.motion.health.good]
    n = len(result.trials)
    if doubtful:
        more = f" and {len(doubtful) - 3} more" if len(doubtful) > 3 else ""
        named = ", ".join(doubtful[:3])
        doubts.append(f"{len(doubtful)} of {plural(n, 'estimate')} doubtful ({named}{more})")
    elif n:
        grounds.append(all_good(n))
    if failed := sum(not f.excluded for f in result.failures):
        doubts.append(f"{plural(failed, 'trial')} could not be used")
    if finding is None or not finding.provisional:
        speeds = by_speed(velocities_of(result))
        doubts += [f"only {plural(len(speeds), 'speed')}"] if 0 < len(speeds) < FEWEST_SPEEDS else []
        doubts += ["no speed was driven twice"] if speeds and max(map(len, speeds.values())) < 2 else []
    if finding is not None:
        doubts += [reason.rstrip(".") for reason in finding.provisional]
        doubts += [f"{plain(e.id)} may be {twins_of(e)}" for e in finding.effects if e.twins]
        if finding.dropped:
            doubts.append(f"{plural(len(finding.dropped), 'trial')} left out because no model fits")
        if any(note.startswith(UNCONVERGED) for note in finding.notes):
            doubts.append("the fit with what was found did not converge")
        if finding.simulates_worse:
            doubts.append(SIMULATES_WORSE[0].lower() + SIMULATES_WORSE[1:])
        doubts += strained_in_words(finding)
        grounds.append(f"Probability of the finding: {chance(finding.probability)}.")
        left = ((finding.trials_left_out, "trials"), (finding.speeds_left_out, "speeds"))
        counts = [f"{sum(x.after < x.before for x in f)} of {len(f)} {kind}" for f, kind in left if f]
        if finding.effects and counts and not finding.simulates_worse:
            grounds.append(f"{listed(counts)} left out of the fit are predicted better.")
        elif finding.effects and not counts:
            doubts.append("no trial could be left out of the fit to test a prediction")
    doubt = [f"Doubts: {'; '.join(doubts)}."] if doubts else []
    stated = any(part.name == BY_RADIUS for r in result.trials for part in r.motion.slip_parts)
    left_out = "The std of the slip leaves out the wheel radius: an error of 1 % is 1 point of slip."
    radius = f" {left_out}" if n and not stated else ""
    text = " ".join([*grounds, *doubt, f"Valid for these speeds, this robot and this sand.{radius}"])
    verdict, tone = ("With care", "fair") if doubts else ("Well, for trials like these", "good")
    return Answer("trust", "How far can this be trusted?", verdict, text, tone)


def all_good(n: int) -> str:
    """Say that all of n motion estimates are good."""
    which = {1: "The motion estimate is", 2: "Both motion estimates are"}
    return f"{which.get(n, f'All {n} motion estimates are')} good."
