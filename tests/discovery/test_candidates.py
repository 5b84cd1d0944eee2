"""Screening on trials in closed form: traces that move with their size, probes without a solution."""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import pytest
from scipy.stats import norm

from granite_lab.discovery.candidates import Score, scores
from granite_lab.discovery.fitted_sets import FittedSets
from granite_lab.discovery.leaders import Screening, overlooked
from granite_lab.discovery.models import Model
from granite_lab.discovery.screens import around, screen, sizes
from granite_lab.inference.constants import FEW, LEAST_GAIN, TOLERANCE
from granite_lab.inference.descent import ROUGH
from granite_lab.inference.fit import Fit, fit
from granite_lab.inference.gap import prediction_change
from granite_lab.inference.pool import ACCURACY, Scenario, Task
from granite_lab.logs.trial import Array
from granite_lab.model.effect import EffectParameter
from granite_lab.model.instants import instants
from tests.inference.stub import EFFECTS, PLACE, MadeUp, Respond, drawn, measure, moving, problem_of
from tests.soak import SOAK, sampled

PLAY = EffectParameter("size", "N", "size", 0.0, 20.0, 0.0, 0.1, 3.0, moving=True)
SEEN = tuple(PLACE) if SOAK else ("accel_x", "accel_z", "pitch_rate")
"""Channels; fewer take less time. A blow is in the first one alone."""


@dataclass(frozen=True)
class Late(Respond):
    """The robot gets a blow of a duration [s], the later the larger the size, whatever its size."""

    duration: float = 0.15

    def one(self, scenario: Scenario, task: Task) -> Array | None:
        others = tuple((id_, values) for id_, values in task.setting if id_ != "blow")
        out = super().one(scenario, replace(task, setting=others))
        sizes = [values[0] for id_, values in task.setting if id_ == "blow"]
        if out is not None and sizes:
            variant = scenario.variants[task.variant]
            t = instants(variant, ACCURACY)
            share = -np.expm1(-sizes[0] / 0.05)
            out[0] += (
                2
                * share
                * moving(t, variant)
                * np.exp(-0.5 * ((t - 0.5 - 0.3 * sizes[0]) / self.duration) ** 2)
            )
        return out


@dataclass(frozen=True)
class Partly(Respond):
    """There is no solution where the second number of an effect is large."""

    def one(self, scenario: Scenario, task: Task) -> Array | None:
        if any(abs(values[1]) > 0.3 for _, values in task.setting):
            return None
        return super().one(scenario, replace(task, setting=tuple(("shake", v) for _, v in task.setting)))


@pytest.mark.parametrize("true", sampled([0.3, 0.9, 1.7, 2.7], 3))
def test_an_effect_that_moves_with_its_size_is_found_from_where_a_few_small_sizes_do_not_show_it(
    true: float,
) -> None:
    problem = problem_of(channels=SEEN, respond=Late(), effects=EFFECTS | {"blow": MadeUp("blow", PLAY)})
    rng = np.random.default_rng(3)
    measure(problem, problem.with_effect(problem.neutral(), "blow", (true,)), rng)
    base = fit(problem, problem.neutral())
    (score,) = scores(problem, screen(problem, base, ["blow"], most=FEW), TOLERANCE)
    assert score.gain > LEAST_GAIN
    found = fit(problem, problem.with_effect(base.point, "blow", score.values), goal=ROUGH)
    assert found.point.common[0] == pytest.approx(true, abs=0.02)


@pytest.mark.parametrize("off", [-1, 1])
def test_from_a_size_that_leads_to_another_optimum_the_sizes_next_to_it_lead_to_the_true_one(
    off: int,
) -> None:
    true = 0.9
    effects = EFFECTS | {"blow": MadeUp("blow", PLAY)}
    problem = problem_of(channels=SEEN, respond=Late(duration=0.04), effects=effects)
    rng = np.random.default_rng(4)
    measure(problem, problem.with_effect(problem.neutral(), "blow", (true,)), rng)
    base = fit(problem, problem.neutral())
    larger = [size for size in sizes(PLAY) if size > true + 0.2]
    start = problem.with_effect(base.point, "blow", (larger[0],))
    missed = fit(problem, start, goal=ROUGH)
    assert abs(missed.point.common[0] - true) > 0.1
    models = {(): Model((), base, base.evidence), ("blow",): Model(("blow",), missed, missed.evidence)}
    sets = FittedSets(problem, ("blow",), TOLERANCE, lambda *_: None, models)
    sets.refit_at_other_sizes(("blow",), "blow")
    assert sets.models["blow",].fit.point.common[0] == pytest.approx(true, abs=0.02)
    assert around(problem, problem.with_effect(base.point, "push", (0.3,)), "push") == []


def test_a_number_of_each_trial_whose_probe_has_no_solution_stays_neutral_and_the_others_are_found() -> None:
    numbers = [
        EffectParameter(name, "N", name, -20.0, 20.0, 0.0, -1.0, 1.0, per_trial=True)
        for name in ("front", "rear", "pull")
    ]
    effects = EFFECTS | {"sway": MadeUp("sway", *numbers)}
    problem = problem_of(channels=SEEN, respond=Partly(), effects=effects)
    true = np.array([[0.9, 0.0, -0.6], [-0.7, 0.0, 0.8], [0.5, 0.0, 0.9], [-0.8, 0.0, -0.5]])
    truth = problem.with_effect(problem.neutral(), "sway", (0.0, 0.0, 0.0), true)
    measure(problem, truth, np.random.default_rng(5))
    base = fit(problem, problem.neutral())
    screened = screen(problem, base, ["sway"])
    (score,) = scores(problem, screened, TOLERANCE)
    assert score.gain > LEAST_GAIN
    assert score.trial_values is not None
    np.testing.assert_allclose(score.trial_values, true, atol=0.1)
    model = Model.of((), base)
    sets = FittedSets(problem, ("sway",), TOLERANCE, lambda *_: None, {(): model})
    sets.fit_prospects(model, sets.prospects(model))
    found = sets.models["sway",].fit.point
    values = np.array([x[t.size :] for t, x in zip(problem.trials, found.trials, strict=True)])
    np.testing.assert_allclose(values, true, atol=0.05)


def test_a_candidate_matters_as_likely_as_its_fit_says_that_it_moves_a_channel_beyond_the_tolerance() -> None:
    problem, rng = problem_of(channels=SEEN), np.random.default_rng(5)
    measure(problem, problem.with_effect(drawn(problem, rng, common=0.3), "push", (0.02,)), rng)
    base = fit(problem, problem.neutral())
    columns = screen(problem, base, ["push"])
    (score,) = scores(problem, columns, TOLERANCE)
    full = fit(problem, problem.with_effect(base.point, "push", score.values), base.scales)
    value, std = full.point.common[0], full.std[-1]
    one = max(prediction_change(problem, base, full).values()) / abs(value)  # of a push of one
    for tolerance in one * (abs(value) + std * np.array([-1.5, 0.0, 1.5])):
        (score,) = scores(problem, columns, tolerance)
        beyond = norm.sf(tolerance / one, [value, -value], std).sum()
        assert score.relevant == pytest.approx(beyond, abs=0.1)


def test_a_candidate_that_an_effect_makes_needless_was_its_rival_and_not_one_that_adds_to_it() -> None:
    """Beside the set the effect promised 100; then half of what the others promised counts as lost."""
    fitted = cast(Fit, None)

    def screens(learnt: dict[str, float], tolerated: dict[str, float]) -> list[Screening]:
        kinds = ((learnt, False), (tolerated, True))
        return [
            Screening(fitted, None, tuple(Score(c, gain, ()) for c, gain in gains.items()), kind)
            for gains, kind in kinds
        ]

    before = screens(
        {"a": 100.0, "rival": 55.0, "adds": 90.0, "weak": 25.0, "tried": 80.0}, {"a": 40.0, "late": 30.0}
    )
    after = screens({"rival": 20.0, "adds": 50.0, "weak": 1.0, "tried": 1.0}, {"late": 14.0})
    found = overlooked(before, after, "a", {"a", "tried"})
    assert [score.candidate for score in found] == ["late", "rival"]
