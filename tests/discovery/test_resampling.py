"""Probabilities of sets from the commands that were driven: by Student's t, and on a search."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student

from granite_lab.discovery.heldout import Predicted, units
from granite_lab.discovery.models import Model, Search
from granite_lab.discovery.resampling import (
    Competition,
    Predictions,
    by_evidence,
    compete,
    competitors,
    nothing_missing,
    winner,
    winners,
)
from granite_lab.discovery.verdict import EffectEvidence, holding, judge
from granite_lab.estimate import Estimate
from granite_lab.inference.constants import TOLERANCE
from granite_lab.inference.fit import fit
from tests.discovery.test_verdict import BOTH, SIX, ask
from tests.inference.stub import problem_of

pytestmark = pytest.mark.usefixtures("one_blas_thread")

ALIKE = np.array([[0.0] * 4, [1.0] * 4])
"""Every unit is expected to show the same."""

APART = np.zeros(2)
"""The sets have no effect in common."""


@pytest.mark.parametrize(
    "gains", [(300.0, 500.0, 100.0, 900.0), (50.0, -40.0, 90.0, 20.0), (9.0, 10.0, 11.0)]
)
def test_a_set_wins_with_the_probability_of_students_t(gains: tuple[float, ...]) -> None:
    """Where densities are large, the better of two sets wins a draw: the sign of the mean gain decides."""
    gain = 1e3 * np.array(gains)
    common = 1e6 * np.random.default_rng(1).normal(size=gain.size)  # commands that are hard for both
    first, second = winners(np.stack([common + gain, common]), np.zeros(2), ALIKE[:, : gain.size], APART)
    ratio = gain.mean() / (gain.std(ddof=1) / np.sqrt(gain.size))
    assert first == pytest.approx(student.cdf(ratio, gain.size - 1), abs=0.015)
    assert first + second == pytest.approx(1.0)
    assert 0 < second < 1


def test_equal_sets_share_by_their_prior_odds() -> None:
    same = np.tile(np.array([-500.0, -700.0, -400.0]), (2, 1))
    assert winners(same, np.log([0.05, 0.15]), np.zeros((2, 3)), APART) == pytest.approx(
        [0.25, 0.75], abs=0.001
    )


def test_a_set_that_always_wins_is_not_certain() -> None:
    first, second = winners(np.array([[0.0, 0.0, 0.0], [-1e4, -1e4, -1e4]]), np.zeros(2), ALIKE[:, :3], APART)
    assert 0.999 < first < 1
    assert second > 0


def test_a_signature_that_grows_with_the_speed_is_no_doubt_but_a_departure_from_it_is() -> None:
    """Leads of 12 to 580 over four speeds are what the effect makes there; by their mean alone: 0.86."""
    leads = np.array([[0.0] * 4, [15.0, 35.0, 95.0, 600.0]])
    as_expected = np.array([[0.0] * 4, [-12.0, -36.0, -91.0, -580.0]])
    elsewhere = np.array([[0.0] * 4, [-580.0, -36.0, -91.0, -12.0]])
    assert winners(as_expected, np.zeros(2), leads, APART)[0] > 0.99
    assert winners(elsewhere, np.zeros(2), leads, APART)[0] < 0.9
    assert winners(as_expected, np.zeros(2), ALIKE, APART)[0] == pytest.approx(0.86, abs=0.02)


def test_beside_an_effect_that_both_sets_share_the_spread_of_the_leads_is_doubt() -> None:
    """Errors of that effect's formula are not in proportion to what the other effect is expected to show."""
    leads = np.array([[0.0] * 4, [0.7, 3.6, 4.2, 15.7]])
    found = np.array([[0.0] * 4, [-1.2, -5.7, 1.4, -23.3]])
    shared = np.array([0.0, 500.0])
    assert winners(found, np.zeros(2), leads, APART)[0] > 0.95
    doubted = winners(found, np.zeros(2), leads, shared)[0]
    assert doubted == pytest.approx(winners(found, np.zeros(2), ALIKE, APART)[0], abs=0.02)
    assert 0.8 < doubted < 0.9


def test_an_effect_that_errors_of_the_shared_formulas_cannot_make_is_sure() -> None:
    leads = np.array([[0.0] * 4, [54.0, 65.0, 197.0, 895.0]])
    found = np.array([[0.0] * 4, [-70.0, -52.0, -171.0, -784.0]])
    assert winners(found, np.zeros(2), leads, np.array([0.0, 1000.0]))[0] > 0.97
    assert winners(found, np.zeros(2), leads, np.array([0.0, 1e5]))[0] < 0.9


@pytest.mark.parametrize("mean", [1.0, 4.0])
def test_a_lead_is_never_surer_than_the_noise_allows(mean: float) -> None:
    """A lead that agrees with the expected one in every unit is still one draw of mean m and variance 2 m."""
    leads = np.array([[0.0] * 4, [1e3 * mean] * 4])
    sure = winners(-leads / 1e3, np.zeros(2), leads / 1e3, APART)[0]
    z = np.random.default_rng(3).standard_t(3, 200_000) * np.sqrt(8 * mean)
    assert sure == pytest.approx(np.mean(1 / (1 + np.exp(-np.clip(4 * mean + z, -700, 700)))), abs=0.01)


def test_data_that_the_best_set_explains_lead_as_much_as_it_predicts() -> None:
    """The stub is linear: what is measured leads over the model alone as expected, within the noise."""
    answer = ask(push=0.3)
    best, alone = answer.search.best, answer.search.baseline
    predictions = Predictions(answer.problem, best.fit, TOLERANCE)
    after, before = predictions.of((best, alone))
    expected = np.diff(predictions.squares_if_right((best, alone)), axis=0)[0]
    found = before.squares - after.squares
    assert np.all(expected > 0)
    assert np.all(np.abs(found - expected) < 4 * np.sqrt(4 * expected))


def test_commands_are_drawn_whole_where_there_are_three_speeds() -> None:
    assert units(problem_of(SIX)) == ((0, 1), (2, 3), (4, 5))
    assert units(problem_of((0, 0, 1, 1))) == ((0,), (1,), (2,), (3,))


def test_the_best_set_competes_with_those_that_lack_an_effect() -> None:
    found = ask(**BOTH).search
    sets = {m.effects for m in competitors(found)}
    assert found.best.effects in sets
    assert {(), ("push",)} <= sets


def test_a_right_name_is_sure_and_never_certain() -> None:
    judgement = ask(push=0.3).judgement
    assert judgement.competition is not None
    (only,) = judgement.named
    assert 0.95 < only.probability < 1
    assert judgement.competition.probability(holding("push")) == only.probability
    assert judgement.competition.weights.sum() == pytest.approx(1.0)


def test_one_speed_more_against_a_name_makes_it_less_sure() -> None:
    with_it, without = np.array([-100.0, -100.0, -100.0, -100.0]), np.array([-180.0, -220.0, -200.0, -190.0])
    sure = winners(np.stack([with_it, without]), np.zeros(2), ALIKE, APART)[0]
    without[3] = -60.0
    doubted = winners(np.stack([with_it, without]), np.zeros(2), ALIKE, APART)[0]
    assert sure > 0.99
    assert 0.6 < doubted < 0.95


def test_nothing_missing_is_less_likely_the_more_candidates_promise_and_the_likelier_they_matter() -> None:
    found = ask(candidates=("pull", "push")).search
    assert 0.5 < nothing_missing(found) < 1

    def promising(gain: float, relevant: float = 1.0) -> Search:
        (screening,) = [k for k in found.screenings[()] if not k.tolerated][:1]
        scores = tuple(replace(s, gain=gain, relevant=relevant) for s in screening.scores)
        fitted = tuple(m for m in found.models if not m.effects)
        return replace(found, models=fitted, screenings={(): (replace(screening, scores=scores),)})

    assert nothing_missing(promising(0.0)) == pytest.approx(1 / (1 + 2 * 0.05), rel=1e-6)
    assert nothing_missing(promising(0.0, 0.5)) == pytest.approx(1 / (1 + 2 * 0.05 / 2), rel=1e-6)
    assert nothing_missing(promising(-9.0)) > nothing_missing(promising(2.0))


def test_without_three_commands_or_trials_the_evidence_alone_counts() -> None:
    answer = ask(push=0.3, commands=(1,))
    evidence = by_evidence(answer.search)
    (only,) = answer.judgement.named
    assert only.probability == evidence.probability(holding("push"))
    assert only.probability < 1


def test_a_set_that_cannot_be_predicted_leaves_the_evidence_to_decide() -> None:
    answer = ask(push=0.3)
    problem, models = answer.problem, competitors(answer.search)
    predictions = Predictions(problem, answer.search.best.fit, TOLERANCE)
    unknown = Predicted.unknown(problem)
    predictions.predicted[models[0].effects] = unknown, unknown.squares
    found = compete(problem, answer.search, predictions)
    assert found.weights == pytest.approx(by_evidence(answer.search).weights)


def test_a_set_that_was_set_aside_counts_for_the_likeliest_part_of_it() -> None:
    found = ask(push=0.3).search
    models = [replace(found.baseline, effects=e) for e in (("pull",), ("push",), ("pull", "push"), ())]
    aside = replace(found, models=tuple(models), set_aside=frozenset({("pull", "push")}))
    competition = Competition(aside.models, np.array([0.3, 0.2, 0.4, 0.1]))
    assert winner(competition, aside).effects == ("pull",)
    assert winner(competition, replace(aside, set_aside=frozenset())).effects == ("pull", "push")


def test_a_set_that_predicts_worse_than_another_is_not_judged_though_it_is_likelier() -> None:
    answer = ask(push=0.3)
    problem, right = answer.problem, answer.search.best
    assert right.effects == ("push",)
    wrong = fit(problem, problem.with_effect(answer.search.baseline.fit.point, "pull", [0.0]))
    likelier = Model(("pull",), wrong, right.log_posterior + 5)
    others = tuple(m for m in answer.search.models if m is not right)
    judgement = judge(answer.problem, replace(answer.search, models=(likelier, right, *others)), TOLERANCE)
    assert [n.id for n in judgement.named] == ["push"]
    assert judgement.model is right


def test_what_is_unexplained_counts_against_an_effect_that_is_only_described() -> None:
    effect = EffectEvidence("push", (), 0.9, Estimate(0.3, 0.1))
    assert effect.as_likely(0.6).probability == pytest.approx(0.3)
    assert effect.as_likely(-0.1).probability == pytest.approx(0.9)
    assert replace(effect, closes=Estimate(-0.1)).as_likely(0.5).probability == 0.0
