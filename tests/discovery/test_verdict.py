"""Verdicts on trials whose answer is known by construction; trials left out as by a fit without them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from granite_lab.discovery import verdict
from granite_lab.discovery.candidates import Score, rivals, scores
from granite_lab.discovery.finding import EffectFinding
from granite_lab.discovery.fitted_sets import MOST, FittedSets
from granite_lab.discovery.heldout import Equations, Predicted, closed, predict, units
from granite_lab.discovery.leaders import NOTHING_FITTED, Fitted, Screening, leaders
from granite_lab.discovery.models import Model, Search, ranked
from granite_lab.discovery.power import _by_noise_per_trial, _visible
from granite_lab.discovery.relevance import has_strained_trials, left_without
from granite_lab.discovery.remainder import remainder
from granite_lab.discovery.resampling import Competition, Predictions, by_evidence
from granite_lab.discovery.screens import Screen, rescreened, screen
from granite_lab.discovery.search import Extension, exchange, reduce, search, search_from_rivals
from granite_lab.discovery.sets import UNLIKELY, best_fits, fit_sets
from granite_lab.discovery.verdict import (
    OPEN,
    EffectEvidence,
    Judgement,
    at_bounds,
    by_posterior,
    judge,
    strained_numbers,
)
from granite_lab.discovery.words import notes, provisional, sentence
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import LEAST_GAIN, REST_SHARE
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.descent import AT_START, ROUGH, Goal
from granite_lab.inference.discrepancy import MOTION, REST
from granite_lab.inference.fit import Fit, fit, with_scales
from granite_lab.inference.noise import white
from granite_lab.inference.normal import Scales
from granite_lab.inference.point import SHARED, Point
from granite_lab.inference.problem import SECONDS, Problem
from granite_lab.inference.scales import FIRST
from granite_lab.logs.trial import Array
from granite_lab.model.effect import Effect, EffectParameter
from tests.inference.stub import COMMANDS, EFFECTS, PLACE, TRACES, MadeUp, drawn, measure, problem_of, trace
from tests.inference.test_normal import linear
from tests.soak import sampled

pytestmark = pytest.mark.usefixtures("one_blas_thread")
SIX = (0, 0, 1, 1, 2, 2)
FOUR = (1, 1, 2, 2)
"""Where two speeds show what is asked."""
CANDIDATES = ("pull", "push", "shake")
CHANNELS = ("pitch_rate", "wheel", "current_f")
"""One of each sensor, where these tell the effects apart: a search takes half the time."""
BOTH: dict[str, Any] = {"push": 0.3, "shake": 0.15, "discrepancy": 0.0, "channels": CHANNELS}
"""Two effects, as several tests search for them."""
TOLERANCE = 0.02


@dataclass(frozen=True, eq=False)
class Answer:
    problem: Problem
    search: Search
    judgement: Judgement

    @property
    def named(self) -> set[str]:
        return {n.id for n in self.judgement.named}

    @property
    def described(self) -> set[str]:
        return {n.id for n in self.judgement.described}


def trials_with(
    commands: tuple[int, ...] = SIX,
    discrepancy: float = 0.004,
    seed: int = 0,
    channels: tuple[str, ...] = tuple(PLACE),
    **put_in: float,
) -> Problem:
    """Return trials with effects of some sizes, in scattered sand, with a little discrepancy."""
    rng = np.random.default_rng(seed)
    problem = problem_of(commands, channels)
    point = drawn(problem, rng, common=0.3)
    for id_, size in put_in.items():
        point = problem.with_effect(point, id_, (size,))
        if id_ == "shake":
            trials = tuple(np.append(x[:-1], size * rng.normal()) for x in point.trials)
            point = replace(point, trials=trials)
    measure(problem, point, rng, discrepancy)
    return problem


@cache
def ask(*, candidates: tuple[str, ...] = CANDIDATES, **given: Any) -> Answer:
    """Search the trials of `trials_with`."""
    steps: list[int] = []
    problem = trials_with(**given)
    base = fit(problem, problem.neutral())
    found = search(problem, base, candidates, TOLERANCE, lambda _, step: steps.append(step))
    assert steps == sorted(steps)  # progress goes on to its end, in at most as many steps as it has
    assert steps[-1] <= MOST
    return Answer(problem, found, judge(problem, found, TOLERANCE))


@pytest.mark.parametrize(("seed", "discrepancy"), [(0, 0.004), (1, 0.5 * TOLERANCE)])
def test_nothing_is_named_where_no_more_than_the_tolerance_is_missing(seed: int, discrepancy: float) -> None:
    answer = ask(seed=seed, discrepancy=discrepancy, channels=CHANNELS)
    assert answer.judgement.verdict == "none"
    assert answer.named == set()
    assert answer.judgement.model.effects == ()
    assert np.isnan(answer.judgement.remainder)


def test_a_search_whose_time_is_over_answers_with_what_it_has_found_and_says_so() -> None:
    problem, both = trials_with(**BOTH), ("push", "shake")

    def tell(text: str, _: int) -> None:
        if text.startswith("fitting"):
            problem.pool.seconds = np.inf

    found = search(problem, fit(problem, problem.neutral()), both, TOLERANCE, tell)
    assert len(found.best.effects) == 1
    judgement = judge(problem, found, TOLERANCE)
    assert remainder(problem, found, judgement, TOLERANCE) == (judgement, None)
    minutes = SECONDS * len(SIX) / 60
    (note,) = [n for n in notes(problem, judgement, ()) if "minutes" in n]
    assert f"{minutes:.0f} minutes of processor time" in note
    assert ask(**BOTH).search.best.effects == both


@pytest.mark.parametrize(
    ("id_", "given"), [("push", {"push": 0.3}), ("shake", {"shake": 0.4, "channels": CHANNELS})]
)
def test_one_missing_effect_is_named_and_closes_the_gap(id_: str, given: dict[str, Any]) -> None:
    judgement = ask(**given).judgement
    assert judgement.verdict == "named"
    (only,) = judgement.named
    assert (only.id, only.twins) == (id_, ())
    assert only.probability > 0.95
    assert judgement.probability > 0.95
    assert only.closes.value == pytest.approx(1.0, abs=0.1)
    assert only.closes.std < 0.1
    assert judgement.remainder < 0.1


def test_effects_with_the_same_trace_are_twins() -> None:
    answer = ask(push=0.3, candidates=("pull", "push", "shove"), commands=FOUR, channels=CHANNELS)
    assert answer.judgement.verdict == "named"
    (only,) = answer.judgement.named
    assert {only.id, *only.twins} == {"push", "shove"}
    assert only.probability > 0.95
    for id_ in ("push", "shove"):
        assert by_evidence(answer.search).probability(lambda m, id_=id_: id_ in m.effects) == pytest.approx(
            0.5, abs=0.2
        )


def test_what_no_candidate_explains_is_unknown() -> None:
    answer = ask(hidden=0.3, candidates=("pull", "push"), commands=FOUR)
    assert answer.judgement.verdict == "unknown"
    assert answer.named == set()
    assert answer.judgement.remainder > 0.5


def test_what_follows_no_law_is_unknown_and_nothing_is_named() -> None:
    answer = ask(discrepancy=0.3, seed=2, channels=CHANNELS)
    assert answer.judgement.verdict == "unknown"
    assert answer.named == set()


def test_what_changes_from_trial_to_trial_by_much_is_unknown_though_repetitions_share_nothing() -> None:
    answer = ask(shake=0.4, candidates=("pull", "push"), commands=FOUR, channels=CHANNELS)
    assert (answer.judgement.verdict, answer.named) == ("unknown", set())
    assert answer.judgement.scatter
    text = sentence("unknown", (), (), answer.judgement, (), TOLERANCE)
    assert "changes from trial to trial" in text


@pytest.mark.parametrize(("factor", "expected"), [(1.1, "unknown"), (0.9, "named")])
def test_an_effect_is_named_only_where_it_changes_more_than_repetitions_differ(
    monkeypatch: pytest.MonkeyPatch, factor: float, expected: str
) -> None:
    """What changes from trial to trial acts on the mean over repetitions, too."""
    answer = ask(push=0.3)
    (push,) = answer.judgement.named
    scattered = {c: factor * moved for c, moved in push.changes.items()}
    monkeypatch.setattr("granite_lab.discovery.verdict.scatter", lambda *_: scattered)
    found = judge(answer.problem, answer.search, TOLERANCE)
    named = {"push"} if expected == "named" else set()
    assert (found.verdict, {n.id for n in found.named}) == (expected, named)


@pytest.mark.parametrize(("std", "expected"), [(0.22, "named"), (0.2, "unknown")])
def test_errors_of_formulas_cannot_explain_what_is_left_of_trials_left_out_beyond_its_standard_error(
    monkeypatch: pytest.MonkeyPatch, std: float, expected: str
) -> None:
    """Half of the gap is left, of which formulas 30 % off leave a tenth; the fit itself leaves nothing."""
    answer = ask(push=0.3)
    monkeypatch.setattr("granite_lab.discovery.verdict.closed", lambda *_: Estimate(0.5, std))
    assert judge(answer.problem, answer.search, TOLERANCE).verdict == expected


def test_where_repetitions_differ_a_change_below_the_tolerance_does_not_stand_out() -> None:
    """Channels in which they do not differ at all are no exception."""
    effect = EffectEvidence("push", (), 1.0, Estimate(1.0, 0.1), changes={"accel_x": 0.1, "accel_z": 0.01})
    assert not effect.stands_out({"accel_x": 0.2, "accel_z": 0.0}, TOLERANCE)
    assert effect.stands_out({"accel_x": 0.05, "accel_z": 0.0}, TOLERANCE)


def test_numbers_of_single_trials_must_be_needed_at_more_than_one_speed() -> None:
    """A resonance coincides with an order of the wheels at one speed."""
    problem = problem_of(SIX, CHANNELS)
    rng = np.random.default_rng(7)
    for trials, wanted in ((range(6), True), (range(2, 4), False)):
        point = problem.with_effect(drawn(problem, rng, common=0.3), "shake", (0.0,))
        own = [np.append(x[:-1], 0.6 * (-1) ** i * (i in trials)) for i, x in enumerate(point.trials)]
        measure(problem, replace(point, trials=tuple(own)), rng)
        base = fit(problem, problem.neutral())
        (score,) = scores(problem, screen(problem, base, ["shake"]), TOLERANCE)
        assert (score.gain > LEAST_GAIN) is wanted


def test_an_effect_that_the_discrepancy_has_taken_up_is_seen_under_a_tolerated_one() -> None:
    """The same equations under other scales give what a screen of a fit with those scales gives."""
    problem, rng = problem_of(SIX, CHANNELS), np.random.default_rng(3)
    put_in = problem.with_effect(drawn(problem, rng, common=0.3), "push", (0.15,))
    measure(problem, put_in, rng)
    base = fit(problem, problem.neutral())
    wide = with_scales(problem, base, Scales(1.0, 0.1, base.scales.priors))
    held = with_scales(problem, base, Scales(TOLERANCE, 0.1, base.scales.priors))
    screened = screen(problem, wide, ["push"])
    (hidden,) = scores(problem, screened, TOLERANCE)
    (seen,) = scores(problem, rescreened(problem, screened, held), TOLERANCE)
    (direct,) = scores(problem, screen(problem, held, ["push"]), TOLERANCE)
    assert hidden.gain < 0.1 * seen.gain
    assert seen.gain > 10 * LEAST_GAIN
    assert seen.gain == pytest.approx(direct.gain, rel=1e-9)
    assert seen.values == pytest.approx(direct.values, rel=1e-9)


def test_a_candidate_with_the_same_trace_is_a_rival_and_one_that_adds_to_it_is_none() -> None:
    problem, rng = problem_of(SIX), np.random.default_rng(3)
    put_in = problem.with_effect(drawn(problem, rng, common=0.3), "push", (0.15,))
    measure(problem, problem.with_effect(put_in, "pull", (0.15,)), rng)
    screened = screen(problem, fit(problem, problem.neutral()), ["push", "pull", "shove"])
    assert rivals(screened, "push") == ["shove"]
    assert rivals(screened, "pull") == []
    assert rivals(screened, "shake") == []  # not screened


def test_an_effect_that_closes_little_is_small() -> None:
    answer = ask(
        push=0.5,
        pull=0.012,
        discrepancy=0.0,
        seed=3,
        candidates=("pull", "push"),
        commands=FOUR,
        channels=CHANNELS,
    )
    assert answer.judgement.verdict == "named"
    assert answer.named == {"push"}
    assert {n.id for n in answer.judgement.small} <= {"pull"}


def test_the_likeliest_model_has_the_highest_posterior_and_probabilities_add_up() -> None:
    found = ask(push=0.3).search
    posteriors = [m.log_posterior for m in found.models]
    assert posteriors == sorted(posteriors, reverse=True)
    competition = by_evidence(found)
    assert competition.probability(lambda _: True) == pytest.approx(1.0)
    each = sum(competition.probability(lambda m, k=m.effects: m.effects == k) for m in found.models)
    assert each == pytest.approx(1.0)
    assert found.model(("push",)) is found.best


def said(answer: Answer) -> str:
    push = EffectFinding("push", "a push", "F = a", (), (), 1.0, OPEN, OPEN)
    return sentence("named", (push,), (), answer.judgement, provisional(answer.problem), TOLERANCE)


def test_trials_that_cannot_be_left_out_say_nothing_of_such() -> None:
    answer = ask(push=0.3, commands=(1,))
    assert np.isnan(answer.judgement.before.left_out).all()
    assert answer.judgement.verdict == "named"
    assert "No trial could be left out; in the fit itself" in said(answer)
    assert "On trials that were left out" in said(ask(push=0.3))


def test_measured_speeds_that_print_alike_are_one_speed_to_the_search_as_in_tables() -> None:
    problem = problem_of((0, 1, 2, 2))  # of no stated command, and of different ways
    for trial, v in zip(problem.trials, (0.2, 0.49831, 0.49834, 0.49834), strict=True):
        seen = trial.observation
        trial.observation = replace(seen, variant=replace(seen.variant, velocity=v))
    assert any("2 of at least 3 speeds driven" in reason for reason in provisional(problem))
    assert len(units(problem)) == 4  # of two speeds, each trial is left out by itself


@pytest.mark.parametrize(
    ("closes", "made", "remainder", "needed", "probability", "named"),
    [
        (0.5, 0.0, 0.0, 0.0, 0.9, True),
        (0.10, 0.0, 0.0, 0.0, 0.9, True),  # three tenths of the rms
        (0.08, 0.0, 0.0, 0.0, 0.9, False),
        (0.10, 0.0, 0.1, 0.0, 0.9, False),  # beside what the set leaves in any case
        (0.02, 0.15, 0.0, 1.5 * TOLERANCE, 0.9, True),
        (0.02, 0.15, 0.0, 0.5 * TOLERANCE, 0.9, False),  # errors of the formulas beside it may do as much
        (0.02, 0.25, 0.0, 0.5 * TOLERANCE, 0.9, False),  # it shows beyond them as learnt, and is not certain
        (0.02, 0.25, 0.0, 0.5 * TOLERANCE, 0.98, True),
        (0.02, 0.15, 0.0, 0.5 * TOLERANCE, 0.98, False),  # less than two std of the formulas as learnt
        (0.02, 0.05, 0.0, 1.5 * TOLERANCE, 0.9, False),  # other effects change that channel
        (np.nan, 0.5, 0.0, 0.5, 0.98, False),  # trials left out show no gap
    ],
)
def test_an_effect_matters_by_the_gap_that_it_closes_or_by_a_channel(
    closes: float, made: float, remainder: float, needed: float, probability: float, named: bool
) -> None:
    gap, channel = Estimate(closes), {"accel_x": made}
    effect = EffectEvidence(
        "push", (), probability, gap, share_made=channel, left_without={"accel_x": needed}
    )
    assert effect.matters(remainder, TOLERANCE, Scales(TOLERANCE, 0.1)) is named


def test_what_an_error_of_the_formulas_beside_it_can_do_does_not_need_an_effect() -> None:
    answer = ask(**BOTH)
    best, without = answer.search.best, answer.search.model(("push",))
    assert without is not None
    changes, scales = {"accel_x": 0.5}, best.fit.scales
    assert left_without(answer.problem, without.fit, scales, "shake", changes, TOLERANCE) == changes
    alone = answer.search.model(())
    assert alone is not None
    lost = left_without(answer.problem, alone.fit, scales, "push", changes, TOLERANCE)
    assert max(lost.values()) > TOLERANCE
    same = left_without(answer.problem, best.fit, scales, "push", changes, TOLERANCE)
    assert max(same.values()) < TOLERANCE


def test_a_second_effect_is_found_where_the_first_leaves_less_than_the_tolerance() -> None:
    """Numbers that change from trial to trial leave no discrepancy that repetitions share."""
    answer = ask(**BOTH)
    assert answer.named == {"push", "shake"}


def test_a_small_effect_that_promises_most_does_not_hide_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is listed beside the one that is named."""

    def moved(_: Problem, before: Fit, after: Fit) -> dict[str, float]:
        little = "shake" in after.point.effects and "shake" not in before.point.effects
        return {"accel_x": 0.5 * TOLERANCE if little else 1.0}

    monkeypatch.setattr("granite_lab.discovery.fitted_sets.is_adequate", lambda *_: True)
    monkeypatch.setattr("granite_lab.discovery.fitted_sets.has_strained_trials", lambda *_: False)
    monkeypatch.setattr("granite_lab.discovery.search.prediction_change", moved)
    found = ask.__wrapped__(push=0.3, shake=0.2, candidates=("push", "shake"), channels=CHANNELS).search
    assert (found.best.effects, found.negligible) == (("push",), ("shake",))


@pytest.mark.parametrize("others", sampled([{"push": 0.3}, {}]))
def test_what_all_trials_have_alike_is_an_effect_and_no_gain_of_each(others: dict[str, float]) -> None:
    candidates = ("motor", "pull", "push")
    answer = ask(motor=0.3, discrepancy=0.0, candidates=candidates, commands=FOUR, **others)
    assert answer.named == {"motor", *others}


@pytest.mark.parametrize(("gain", "expected"), [(0.02, False), (0.2, True)])
def test_numbers_of_the_trials_far_beyond_their_scale_are_strained(gain: float, expected: bool) -> None:
    answer = ask()
    result = answer.search.best.fit
    scales = replace(result.scales, priors={**result.scales.priors, "current_f gain": gain})
    assert has_strained_trials(answer.problem, replace(result, scales=scales)) is expected
    alike = replace(result.point, shared=gain * (np.array(SHARED) == "current_f gain"))
    assert has_strained_trials(answer.problem, replace(result, point=alike)) is expected


def test_the_posterior_alone_names_where_nothing_can_be_predicted() -> None:
    answer = ask(push=0.3)
    judgement = by_posterior(answer.problem, answer.search)
    assert (judgement.verdict, [n.id for n in judgement.named]) == ("named", ["push"])
    assert np.isnan(judgement.remainder)


def test_the_stated_amplitude_of_changing_phase_is_seen_in_four_of_five_draws() -> None:
    """Cosine and sine of a random phase in each of twelve trials; the gain is that of the best scale."""
    rng = np.random.default_rng(5)
    power = np.full((12, 4), 40.0)
    amplitude = _by_noise_per_trial(power, [0, 1], needed=5.2, most=10.0)
    scales = np.geomspace(1e-3, 10, 40)
    gains = []
    for _ in range(400):
        phase = rng.uniform(0, 2 * np.pi, 12)
        true = np.column_stack([np.cos(phase), np.sin(phase), 0 * phase, 0 * phase]) * amplitude
        b = power * true + np.sqrt(power) * rng.normal(size=power.shape)
        each = [np.sum(0.5 * b**2 / (power + s**-2) - 0.5 * np.log1p(power * s**2)) for s in scales]
        gains.append(max(each))
    assert np.mean(np.array(gains) > 5.2) == pytest.approx(0.8, abs=0.12)


def test_an_amplitude_that_matters_is_not_one_by_what_other_numbers_add() -> None:
    """Numbers that follow in one channel, which is known far better, add more in the others."""
    problem = problem_of(SIX)
    point = problem.neutral()
    for own in problem.whiteners:
        own[:] = [white(1e-6 if k == 3 else 1e3, w.measured, 0.02) for k, w in enumerate(own)]
    wide = Scales(0.04, 0.1, {s.name: 10.0 for t in problem.trials for s in t.slacks})
    derivatives = differentiate(problem, point)
    problem.set_noise(problem.whiteners, point, derivatives)
    base = fit(problem, point, wide, derivatives=derivatives, goal=AT_START)
    screened = screen(problem, base, ["shake"])
    places, size = screened.places_per_trial("shake")[:, 0], screened.per_trial["shake"][0].size
    shares = _visible(problem, base, screened)[places]
    for command, (i, *_) in enumerate(problem.commands):
        t, alone = problem.trials[i], size * trace(TRACES["shake"], COMMANDS[command])
        shown = t.bins_of(alone, point.trials[i], point.sensors)
        rms = {c: problem.rms_of(command, c) for c in shown}
        worst = max(np.sqrt(np.mean(b[rms[c][1] > 0] ** 2)) / rms[c][0] for c, b in shown.items())
        assert 0 < shares[i] < 1.02 * worst


def test_a_set_that_predicts_best_is_judged_at_its_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its numbers are reported, and a search fits only the likeliest sets finely."""
    answer = ask(push=0.3)
    problem, key = answer.problem, ("pull", "push")
    start = problem.with_effect(answer.search.best.fit.point, "pull", (0.0,))
    rough = Model.of(key, fit(problem, start, answer.search.best.fit.scales, ROUGH))
    assert answer.search.best.effects == ("push",)
    assert not rough.fit.converged
    monkeypatch.setattr("granite_lab.discovery.verdict.winner", lambda *_: rough)
    others = tuple(m for m in answer.search.models if m.effects != key)
    judged = judge(problem, replace(answer.search, models=(*others, rough)), TOLERANCE).model
    assert judged.effects == key
    assert judged.fit.converged
    assert judged.fit.evidence >= rough.fit.evidence


def test_a_set_that_ends_below_a_part_is_fitted_again_from_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that stops before the optimum must not cost the effect."""
    rng = np.random.default_rng(4)
    problem = problem_of((0, 0, 1, 1), CHANNELS)
    start = problem.with_effect(drawn(problem, rng), "push", (0.0,))
    measure(problem, replace(start, common=np.array([0.7])), rng)
    alone = fit(problem, problem.neutral())

    def stuck(problem: Problem, at: Point, scales: Scales, goal: Goal) -> Fit:
        found = fit(problem, at, scales, goal)
        return replace(found, evidence=alone.evidence - 1) if at is start else found

    monkeypatch.setattr("granite_lab.discovery.sets.fit", stuck)
    given = [(start, alone.scales)]
    found, lost = (fit_sets(problem, given, known)["push",] for known in ({(): alone}, {}))
    assert found.evidence > alone.evidence > lost.evidence
    assert found.point.common[0] == pytest.approx(0.7, abs=0.05)


@pytest.mark.parametrize("competing", [True, False])
def test_sets_that_compete_know_the_best_of_those_before(
    competing: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = problem_of((0, 0, 1, 1), CHANNELS)
    measure(problem, problem.neutral(), np.random.default_rng(4))
    plain = fit(problem, problem.neutral())
    at = {id_: problem.with_effect(problem.neutral(), id_, (0.0,)) for id_ in ("push", "pull", "lift")}
    evidence, asked = {"push": 10.0, "pull": 30.0, "lift": 20.0}, {}

    def known(_: Problem, at: Point, __: Scales, goal: Goal) -> Fit:
        asked[at.effects[0]] = goal.evidence
        return replace(plain, evidence=evidence[at.effects[0]])

    monkeypatch.setattr("granite_lab.discovery.sets.fit", known)
    found = best_fits(problem, [(p, FIRST) for p in at.values()], ROUGH, 5.0 if competing else None)
    assert {key[0]: f.evidence for key, f in found.items()} == evidence
    least = np.log(UNLIKELY)  # the prior odds of the sets are alike
    if competing:
        assert asked == pytest.approx(
            {"push": 5 + LEAST_GAIN + least, "pull": 5 + LEAST_GAIN + least, "lift": 30 + least}
        )
    else:
        assert set(asked.values()) == {-np.inf}


def test_of_several_starts_the_best_fit_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(4)
    problem = problem_of((0, 0, 1, 1), CHANNELS)
    start = problem.with_effect(drawn(problem, rng), "push", (0.0,))
    measure(problem, replace(start, common=np.array([0.7])), rng)
    far = replace(start, shared=start.shared + 0.5)
    starts = [(far, FIRST), (start, FIRST), (problem.neutral(), FIRST)]
    fits = [fit(problem, point, scales, goal=ROUGH) for point, scales in starts]
    ends = [f.evidence for f in fits]
    assert abs(ends[0] - ends[1]) > 0.01  # they end apart, so that it matters which is kept

    def known(_: Problem, at: Point, *__: Any, **___: Any) -> Fit:
        return next(f for f, (point, _) in zip(fits, starts, strict=True) if point is at)

    monkeypatch.setattr("granite_lab.discovery.sets.fit", known)
    for given in (starts, starts[::-1]):
        found = fit_sets(problem, given, {})
        assert found["push",].evidence == max(ends[:2])
        assert found[()].evidence == ends[2]


@pytest.mark.parametrize(
    ("changes", "sure"),
    [
        ({}, True),
        ({"strained": ("size",)}, False),
        ({"closes": Estimate(0.3, 0.1)}, False),  # less than what stands in for another cause may
        ({"speeds": Estimate(0.5, 0.3)}, False),  # speeds left out do not show it
        ({"speeds": Estimate(np.nan)}, False),
        ({"twins": ("pull", "shove", "shake")}, False),
        ({"probability": 0.8}, False),
        ({"changes": {"accel_x": 0.1, "accel_z": 0.5}}, False),  # whose formulas may be off by any amount
        ({"changes": {"accel_x": 0.5, "accel_z": 0.1}}, True),
    ],
)
def test_beside_what_is_not_explained_a_name_needs_speeds_left_out_and_numbers_as_expected(
    changes: dict[str, Any], sure: bool
) -> None:
    scales = Scales(0.01, 0.1, formulas={"accel_z": 0.3})
    effect = EffectEvidence("push", (), 1.0, Estimate(0.5, 0.1), Estimate(0.5, 0.1), changes={"accel_x": 0.5})
    assert replace(effect, **changes).is_sure_beside(0.2, scales) is sure


@pytest.mark.parametrize(
    ("clean", "closes", "named"),
    [(False, 0.02, {"push"}), (False, 0.04, {"push", "shake"}), (True, 0.02, {"push", "shake"})],
)
def test_an_effect_that_closes_less_than_a_channel_s_noise_leaves_unexplained_is_not_named(
    monkeypatch: pytest.MonkeyPatch, clean: bool, closes: float, named: set[str]
) -> None:
    """The set leaves 3 % of the gap."""
    answer = ask(**BOTH)
    asked, whole = verdict._evidence_of, verdict.performance_of

    def one(*given: Any) -> EffectEvidence:
        effect = asked(*given)
        return replace(effect, closes=Estimate(closes, 0.001)) if effect.id == "shake" else effect

    monkeypatch.setattr(verdict, "_evidence_of", one)
    monkeypatch.setattr(
        verdict, "performance_of", lambda *given: replace(whole(*given), closed=Estimate(0.97, 0.001))
    )
    monkeypatch.setattr(verdict, "is_adequate", lambda *_: clean)
    found = judge(answer.problem, answer.search, TOLERANCE)
    assert {n.id for n in found.named} == named
    assert found.verdict == ("named" if len(named) == 2 else "partly named")


def test_the_candidate_that_promises_most_is_fitted_first_though_both_screens_have_it() -> None:
    origin = ask(push=0.3).search.best.fit
    learnt, tolerated = (
        tuple(Score(id_, gain, (0.1,), np.zeros((1, 1))) for id_, gain in gains.items())
        for gains in ({"push": 160.0, "pull": 83.0}, {"push": 90.0, "shake": 80.0})
    )
    screenings = [Screening(origin, None, learnt), Screening(origin, None, tolerated, tolerated=True)]
    assert [p.score.candidate for p in leaders(screenings)] == ["push", "pull", "shake"]


@pytest.mark.parametrize(
    ("fitted", "next_ones"),
    [
        (NOTHING_FITTED, ["push", "pull"]),
        (Fitted(("push", "pull"), "push"), ["push", "pull"]),
        (Fitted(("push", "pull")), ["push", "shake", "pull"]),
    ],
)
def test_a_candidate_that_adds_to_the_best_one_has_its_turn_where_neither_that_nor_its_rivals_stay(
    monkeypatch: pytest.MonkeyPatch, fitted: Fitted, next_ones: list[str]
) -> None:
    origin = ask(push=0.3).search.best.fit
    gains = {"push": 160.0, "shake": 150.0, "pull": 83.0}
    columns = cast(Screen, object())
    promised = tuple(Score(id_, gain, (0.1,)) for id_, gain in gains.items())
    monkeypatch.setattr("granite_lab.discovery.leaders.rivals", lambda *_: {"pull"})
    found = leaders([Screening(origin, columns, promised)], fitted)
    assert [p.score.candidate for p in found] == next_ones


@pytest.mark.parametrize("law", [True, False])
def test_a_contact_law_competes_with_a_law_that_was_only_screened_beside_the_same_set(law: bool) -> None:
    laws: dict[str, Effect] = {id_: MadeUp(id_) for id_ in ("push", "shove")}
    for effect in laws.values():
        effect.law = law
    rng, problem = np.random.default_rng(0), problem_of(FOUR, CHANNELS, effects=laws)
    measure(problem, problem.with_effect(drawn(problem, rng, common=0.3), "push", (0.3,)), rng)
    base = Model.of((), fit(problem, problem.neutral()))
    sets = FittedSets(problem, ("push", "shove"), TOLERANCE, lambda *_: None, {(): base})
    (push,) = [p for p in sets.prospects(base) if p.score.candidate == "push"]
    sets.fit_prospects(base, [push])
    found = sets.models["push",]
    exchange(sets, found, [Extension(base, found, [push.score])])
    assert (("shove",) in sets.models) is law
    if law:  # no trial tells the two apart
        assert sets.models["shove",].log_posterior == pytest.approx(found.log_posterior, abs=0.5)


@pytest.mark.parametrize(("predicted_drop", "more"), [(0.0, True), (18.0, True), (22.0, False)])
def test_a_larger_set_must_be_likelier_than_what_the_fit_of_a_smaller_one_has_missed(
    predicted_drop: float, more: bool
) -> None:
    best = ask(push=0.3).search.best
    small = replace(best, fit=replace(best.fit, predicted_drop=predicted_drop))
    assert small.is_improved_by(replace(best, log_posterior=best.log_posterior + LEAST_GAIN + 10)) is more


def test_an_effect_whose_size_ends_at_a_bound_is_described_and_what_it_closes_counts_as_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answer = ask(push=0.3)
    assert answer.named == {"push"}
    monkeypatch.setattr(verdict, "AT_BOUND", 0.495)  # 0.3 N counts as the bound of 20 N
    found = judge(answer.problem, answer.search, TOLERANCE)
    assert (found.verdict, found.named) == ("unknown", ())
    (only,) = found.described
    assert only.at_bound
    assert only.probability < 0.6 * answer.judgement.named[0].probability


@pytest.mark.parametrize(
    ("size", "lag", "at_bound"),
    [(0.3, 0.02, ()), (0.3, 0.0002, ()), (0.3, 0.2, ("lag",)), (20.0, 0.02, ("size",)), (0.0, 0.02, ())],
)
def test_a_size_at_a_bound_and_a_lag_at_one_beyond_all_that_is_expected_speak_against_an_effect(
    size: float, lag: float, at_bound: tuple[str, ...]
) -> None:
    numbers = (
        EffectParameter("size", "N", "size", 0.0, 20.0, 0.0, 0.1, 1.0),
        EffectParameter("lag", "s", "lag", 0.0002, 0.2, 0.01, 0.002, 0.05, shape=True),
    )
    problem = problem_of(channels=CHANNELS, effects=EFFECTS | {"push": MadeUp("push", *numbers)})
    measure(problem, problem.neutral(), np.random.default_rng(1))
    fitted = fit(problem, problem.with_effect(problem.neutral(), "push", (size, lag)), goal=AT_START)
    assert at_bounds(problem, fitted, "push") == at_bound
    assert strained_numbers(problem, fitted, "push") == at_bound


def of_sets(problem: Problem, lost: Mapping[tuple[str, ...], float]) -> FittedSets:
    """Return a search that has fitted some sets, each with an evidence that is too small by what it lost."""
    models = {}
    for effects, missed in lost.items():
        start = problem.neutral()
        for id_ in effects:
            start = problem.with_effect(start, id_, (0.1,))
        fitted = fit(problem, start, goal=ROUGH)
        models[effects] = Model.of(effects, replace(fitted, evidence=fitted.evidence - missed))
    return FittedSets(problem, CANDIDATES, TOLERANCE, lambda *_: None, models)


def test_a_set_that_missed_its_optimum_is_fitted_again_from_the_end_of_the_likeliest_one() -> None:
    sets = of_sets(
        trials_with(push=0.3, pull=0.3, channels=CHANNELS),
        {(): 0, ("push",): 300, ("pull",): 0, ("pull", "push"): 0},
    )
    before = dict(sets.models)
    assert not reduce(sets)
    assert sets.likeliest().effects == ("pull", "push")
    assert sets.models["push",].log_posterior > before["push",].log_posterior + LEAST_GAIN


def test_an_effect_that_only_a_missed_optimum_speaks_for_is_given_up() -> None:
    sets = of_sets(trials_with(push=0.3, channels=CHANNELS), {(): 0, ("push",): 100, ("pull", "push"): 0})
    assert sets.likeliest().effects == ("pull", "push")
    assert reduce(sets)
    assert sets.likeliest().effects == ("push",)


@pytest.mark.parametrize("moved", [(), ("pull", "push")], ids=["of the part", "of the whole set"])
def test_a_set_that_lacks_an_effect_is_fitted_from_the_sand_that_misfits_less(
    moved: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    sets = of_sets(
        trials_with(push=0.3, pull=0.3, channels=CHANNELS), dict.fromkeys([(), ("pull", "push")], 0.0)
    )
    off = sets.models[moved]
    point = replace(off.fit.point, shared=off.fit.point.shared + 0.3)
    sets.models[moved] = replace(off, fit=replace(off.fit, point=point))
    begun: list[Point] = []

    def record(problem: Problem, starts: Any, *_: Any) -> dict[tuple[str, ...], Fit]:
        begun.extend(start for start, _ in starts)
        return {}

    monkeypatch.setattr("granite_lab.discovery.fitted_sets.fit_sets", record)
    sets.fit_parts(sets.models["pull", "push"])
    (other,) = {(), ("pull", "push")} - {moved}
    assert [start.effects for start in begun] == [("push",), ("pull",)]
    for start in begun:
        assert np.array_equal(start.shared, sets.models[other].fit.point.shared)


def test_a_search_goes_on_from_an_effect_that_nearly_took_the_place_of_the_one_found() -> None:
    sets = of_sets(
        trials_with(push=0.3, pull=0.3, channels=CHANNELS), dict.fromkeys([(), ("pull",), ("push",)], 0.0)
    )
    first, second = ranked(sets.models[k] for k in [("pull",), ("push",)])
    sets.screenings[()] = ()
    again = search_from_rivals(sets.as_search(), sets.problem, CANDIDATES)
    assert again.best.effects == ("pull", "push")
    assert second.effects in again.screenings  # it was extended, and the first one was not
    assert first.effects not in again.screenings


@pytest.mark.parametrize("screened", [True, False], ids=["extended already", "far worse"])
def test_a_search_does_not_go_on_from_what_is_no_rival(screened: bool) -> None:
    missed = 0.0 if screened else 1e5
    problem = trials_with(push=0.3, pull=0.3, channels=CHANNELS)
    sets = of_sets(problem, {(): missed, ("pull",): 2 * missed, ("push",): 0.0})
    second = ranked(sets.models.values())[1] if screened else sets.baseline
    sets.screenings |= {(): (), second.effects: ()}
    found = sets.as_search()
    assert search_from_rivals(found, problem, CANDIDATES) is found


@pytest.mark.parametrize(("together", "twins"), [(40.0, ("lag",)), (400.0, ())])
def test_a_rival_is_judged_with_what_acts_beside_it(together: float, twins: tuple[str, ...]) -> None:
    """By itself the lag leaves too much; with another effect beside it, it closes as much as the speed."""
    left = {
        ("speed", "tyre"): 10.0, ("exit", "lag"): together, ("lag", "tyre"): 900.0, ("speed",): 500.0,
        (): 2000.0,
    }  # fmt: skip
    fitted = ask(push=0.3).search.best.fit
    search = Search(tuple(Model(k, fitted, -misfit) for k, misfit in left.items()), {})

    def of(models: Sequence[Model]) -> list[Predicted]:
        units = [np.full(4, left[m.effects] / 4) for m in models]
        return [Predicted(x, x, x, np.zeros(4), x, x) for x in units]

    before, after = of([search.baseline, search.best])
    competition = Competition(search.models, np.array([0.95, 0.05, 0.0, 0.0, 0.0]))
    predictions = cast(Predictions, SimpleNamespace(of=of, tolerance=TOLERANCE))
    found, _ = verdict._twins(
        search, "speed", 0.5, verdict.performance_of(before, after), competition, predictions
    )
    assert found == twins


def test_a_set_that_leaves_nothing_is_at_its_optimum_before_more_is_fitted_beside_it() -> None:
    problem = trials_with(push=0.3, hidden=0.2, channels=CHANNELS)
    lacking = of_sets(problem, {("push",): 0.0})
    assert lacking.at_optimum_if_adequate(lacking.models["push",]) is lacking.models["push",]
    sets = of_sets(trials_with(push=0.3, channels=CHANNELS), {("push",): 0.0})
    rough = sets.models["push",]
    fine = sets.at_optimum_if_adequate(rough)
    assert not rough.fit.converged
    assert fine.fit.converged
    assert sets.models["push",] is fine


def test_an_effect_is_named_beside_another_cause() -> None:
    answer = ask(
        push=0.5,
        hidden=0.2,
        candidates=("pull", "push"),
        commands=FOUR,
        channels=("accel_x", "accel_z", *CHANNELS),
    )
    assert answer.judgement.verdict == "partly named"
    assert answer.named == {"push"}


Row = tuple[Array, Array, Array]


def dense(problem: Problem, found: Fit) -> tuple[list[Row], Array]:
    """Return per trial columns of the shared numbers, residual and covariance; and the shared std.

    The covariance is that of noise, of what is tolerated, and of the trial's own numbers.
    """
    std, _ = problem.prior(found.point, found.scales)
    rows, first = [], np.cumsum([0, *(x.size for x in found.point.trials)])
    for i, t in enumerate(problem.trials):
        command = next(c for c, own in enumerate(problem.commands) if i in own)
        n, J = found.point.trials[i].size, problem.columns(i, found.point, found.derivatives)
        C = np.diag(np.concatenate([1 / w.filters[0].inverse for w in problem.whiteners[i]]) ** 2)
        for c, (basis,) in problem._plain[command].items():
            at = problem.rows[i][c]
            for kind, share in ((MOTION, TOLERANCE), (REST, REST_SHARE)):
                B = basis.columns[:, basis.kind == kind]
                C[at, at] += share**2 * B @ B.T
        C += (J[:, :n] * std[first[i] : first[i + 1]] ** 2) @ J[:, :n].T
        assert len(t.channels) == len(CHANNELS)
        rows.append((J[:, n:], found.residuals[i].ravel(), C))
    return rows, std[first[-1] :]


def refitted(rows: list[Row], std: Array, trials: list[int]) -> Array:
    """Return the shared numbers that a fit to some trials alone gives."""
    N, b = np.diag(std**-2.0), np.zeros(std.size)
    for J, y, C in (rows[i] for i in trials):
        N += J.T @ np.linalg.solve(C, J)
        b += J.T @ np.linalg.solve(C, y)
    return np.asarray(np.linalg.solve(N, b))


def misfit(row: Row, shared: Array) -> float:
    J, y, C = row
    left = y - J @ shared
    return float(left @ np.linalg.solve(C, left))


def predicted_by(rows: list[Row], std: Array, trials: list[int], i: int) -> float:
    """Return the misfit of a trial over the covariance of its prediction by some others."""
    N = np.diag(std**-2.0) + sum(J.T @ np.linalg.solve(C, J) for J, _, C in (rows[k] for k in trials))
    J, y, C = rows[i]
    left = y - J @ refitted(rows, std, trials)
    return float(left @ np.linalg.solve(C + J @ np.linalg.solve(N, J.T), left))


def test_each_trial_is_predicted_as_by_a_refit_without_it() -> None:
    problem = problem_of((0, 0, 1, 1, 2), CHANNELS)
    found = linear(problem, np.random.default_rng(1), 0.1)
    equations = Equations(problem, found)
    unlimited = np.full(equations.low.size, np.inf)  # as the refits are
    equations.low, equations.high = -unlimited, unlimited
    predicted = predict(problem, found, TOLERANCE, equations)
    rows, std = dense(problem, found)
    everyone = refitted(rows, std, [0, 1, 2, 3, 4])
    for i in range(5):
        others = [j for j in range(5) if j != i]
        command = next(own for own in problem.commands if i in own)
        elsewhere = [j for j in range(5) if j not in command]
        assert predicted.in_fit[i] == pytest.approx(misfit(rows[i], everyone), rel=1e-4)
        assert predicted.left_out[i] == pytest.approx(predicted_by(rows, std, others, i), rel=1e-4)
        assert predicted.speed_left_out[i] == pytest.approx(predicted_by(rows, std, elsewhere, i), rel=1e-4)
    assert (predicted.left_out > predicted.in_fit).all()
    # of a command with one trial both are the same
    assert predicted.left_out[4] == pytest.approx(predicted.speed_left_out[4], rel=1e-9)


def test_what_is_expected_of_trials_is_what_an_exact_model_leaves() -> None:
    problem = problem_of((0, 0, 1, 1, 2, 2), CHANNELS)
    ratios = []
    for seed in range(20):
        predicted = predict(problem, linear(problem, np.random.default_rng(seed), 0.0), TOLERANCE)
        ratios.append(predicted.in_fit.sum() / predicted.expected.sum())
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)


def test_the_share_that_is_closed_has_the_standard_error_of_the_jackknife() -> None:
    rng = np.random.default_rng(1)
    gap = rng.uniform(50, 150, 12)
    before = gap + 400
    after = before - gap * rng.normal(0.8, 0.1, 12)
    found = closed(before, after, gap)
    whole = (before - after).sum() / gap.sum()
    without = [(before - after)[np.arange(12) != i].sum() / gap[np.arange(12) != i].sum() for i in range(12)]
    assert found.value == pytest.approx(whole)
    assert found.std == pytest.approx(np.sqrt(11 / 12 * np.sum((without - np.mean(without)) ** 2)), rel=0.05)


def test_shares_are_nan_where_there_is_no_gap_or_no_trial_left_out() -> None:
    one, nothing = np.ones(3), np.full(3, np.nan)
    assert np.isnan(closed(one, one, 0 * one).value)
    assert np.isnan(closed(nothing, one, one).value)
    single = closed(np.array([3.0]), np.array([1.0]), np.array([4.0]))
    assert single.value == pytest.approx(0.5)
    assert np.isnan(single.std)
