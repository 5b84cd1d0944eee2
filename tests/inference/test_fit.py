"""The fit finds what was put in, and learns how much trials differ and how far the model is off."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import minimize

from granite_lab.errors import EstimateError
from granite_lab.inference import noise
from granite_lab.inference.constants import PSEUDO_TRIALS, UPDATES
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.descent import (
    AT_START,
    Descent,
    Goal,
    _aim,
    _linear,
    evidence_at,
    predict_drop,
    simulate_at,
    simulated,
    state_at,
)
from granite_lab.inference.fit import Fit, fit, with_priors
from granite_lab.inference.gap import discrepancies
from granite_lab.inference.noise import FLOOR
from granite_lab.inference.normal import Scales
from granite_lab.inference.point import SHARED, Point
from granite_lab.inference.pool import SAND, SAND_PER_TRIAL, Scenario, Task
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import (
    DISCREPANCIES,
    FIRST,
    FORMULAS,
    learn_discrepancy,
    log_prior,
    posterior_at,
)
from granite_lab.inference.setup import initial_point, nominal
from granite_lab.logs.trial import Array
from granite_lab.model.single_wheel import Ratio, SingleWheel, rolling
from granite_lab.parameters import load_robot, load_soil, load_variants
from tests.inference.stub import Respond, drawn, measure, measured, problem_of
from tests.soak import SOAK

pytestmark = pytest.mark.usefixtures("one_blas_thread")
FOUR = (0, 0, 1, 1)
COHESION = SAND.index("cohesion")
PLAIN = {
    0.02: ("wheel", "wheel_split"),
    0.08: ("pitch_rate", "wheel", "wheel_split", "current_f", "current_r"),
}
"""Channels in which a discrepancy of a share is as large as the noise of a bin, or larger."""


def std_of(found: Fit) -> np.ndarray:
    return np.sqrt(np.diag(found.posterior.covariance))


def test_numbers_are_found_within_their_std() -> None:
    scores = []
    for seed in range(6 if SOAK else 4):
        problem, truth, _ = measured(seed)
        found = fit(problem, problem.neutral())
        assert found.converged
        scores.append((found.point.vector - truth.vector) / std_of(found))
    table = np.concatenate(scores)
    # priors are twice as wide as what was drawn from, so that the numbers they hold lie closer
    assert 0.6 < np.sqrt(np.mean(table**2)) < 1.1
    assert np.mean(np.abs(table) < 1.96) > 0.93


def test_the_std_of_a_fit_that_has_not_arrived_holds_the_way_to_the_optimum() -> None:
    """Three std off in drawn directions: by the posterior alone most numbers are further off than two std."""
    problem, _, rng = measured(1)
    found = fit(problem, problem.neutral())
    off = 3 * std_of(found) * rng.normal(size=found.point.vector.size)
    stopped = fit(problem, problem.stepped(found.point, off), found.scales, goal=AT_START)
    away = np.abs(stopped.point.vector - found.point.vector)
    assert np.mean(away > 2 * std_of(stopped)) > 0.4
    assert np.mean(away < 2 * stopped.std) > 0.95
    np.testing.assert_allclose(found.std, std_of(found), rtol=0.01)


def test_the_evidence_does_not_depend_on_where_the_fit_begins() -> None:
    problem, _, rng = measured(3, 0.02)
    first = fit(problem, problem.neutral())
    second = fit(problem, drawn(problem, rng))
    assert first.evidence == pytest.approx(second.evidence, abs=0.1)
    assert np.abs(first.point.vector - second.point.vector).max() < 0.5 * std_of(first).max()


@pytest.mark.parametrize(("late", "commands"), [(-0.1, FOUR), (0.0, FOUR), (0.07, FOUR), (0.07, (1, 1))])
def test_a_fit_begins_near_the_latency_of_the_stamps(late: float, commands: tuple[int, ...]) -> None:
    """Whatever the sand is, and where a command was left out; from far away a fit ends elsewhere."""
    rng = np.random.default_rng(8)
    problem = problem_of(commands)
    truth = drawn(problem, rng)
    truth.shared[SHARED.index("latency")] = late
    measure(problem, truth, rng)
    start, _ = initial_point(problem)
    assert start.shared[SHARED.index("latency")] == pytest.approx(late, abs=0.02)
    assert fit(problem, start).point.shared[SHARED.index("latency")] == pytest.approx(late, abs=1e-3)


@pytest.mark.parametrize("share", PLAIN)
def test_a_known_share_is_found(share: float) -> None:
    """Of some 60 amplitudes of a channel half are determined; the scatter of a std is then 1/sqrt(2 · 30)."""
    ratios = []
    for seed in range(6 if SOAK else 4):
        problem, *_ = measured(10 + seed, share)
        scales = fit(problem, problem.neutral()).scales
        ratios += [scales.discrepancies[c] / share for c in PLAIN[share]]
    assert np.median(ratios) == pytest.approx(1.0, abs=0.15)
    assert np.std(ratios) < 0.35


def test_the_least_error_of_a_formula_is_below_what_a_sensor_tells() -> None:
    """A wheel radius wrong by three times what a tyre wears and deflects by (4 %), in the paper's trials."""
    angle = max(v.distance for v in load_variants()) / load_robot().wheels.radius
    assert FORMULAS[0] * 0.12 * angle < FLOOR["wheel"]


def test_scales_that_came_near_zero_rise_again() -> None:
    """Where a fit learnt its scales before is forgotten, of the formula's error, too."""
    rng = np.random.default_rng(21)
    problem = problem_of(FOUR)
    start = problem.with_effect(problem.neutral(), "push", (0.0,))
    wrong = problem.with_effect(drawn(problem, rng), "pull", (0.4,))
    measure(problem, wrong, rng, 0.08)
    zero = Scales(DISCREPANCIES[0], FORMULAS[0], discrepancies=dict.fromkeys(PLAIN[0.08], DISCREPANCIES[0]))
    first, second = fit(problem, start), fit(problem, start, zero)
    assert second.evidence == pytest.approx(first.evidence, abs=1.0)
    assert min(second.scales.discrepancies[c] for c in PLAIN[0.08]) > 20 * DISCREPANCIES[0]


@pytest.mark.parametrize("seed", range(3))
def test_the_learnt_discrepancy_is_the_likeliest(seed: int) -> None:
    """Errors of the model and of a formula explain the same residuals: a step of each alone goes too far."""
    rng = np.random.default_rng(seed)
    problem = problem_of(FOUR)
    wrong = problem.with_effect(drawn(problem, rng), "push", (0.4,))
    measure(problem, problem.with_effect(wrong, "pull", (0.1,)), rng, 0.05)
    state = state_at(problem, problem.with_effect(problem.neutral(), "push", (0.4,)))
    assert state is not None
    point, normal = state.point, state.normal
    channels = tuple(problem.counts)

    def evidence(scales: Scales) -> float:
        return posterior_at(problem, point, normal, scales).evidence + log_prior(problem, scales, True)

    def scales_at(logs: Array) -> Scales:
        sizes = np.exp(logs).reshape(2, -1)
        return replace(found, discrepancies=dict(zip(channels, sizes[0], strict=True)),
                       formulas=dict(zip(channels, sizes[1], strict=True)))  # fmt: skip

    found = FIRST
    for _ in range(4):
        found = learn_discrepancy(problem, normal, point, found)
    begin = np.log([found.discrepancy_of(c) for c in channels] + [found.formula_of(c) for c in channels])
    limits = [np.log(DISCREPANCIES)] * len(channels) + [np.log(FORMULAS)] * len(channels)
    best = minimize(lambda logs: -evidence(scales_at(logs)), begin, bounds=limits, method="L-BFGS-B")
    assert evidence(found) > -best.fun - 0.3
    assert evidence(found) > evidence(learn_discrepancy(problem, normal, point, found)) - 0.1


def test_the_share_of_an_exact_model_does_not_matter() -> None:
    problem, *_ = measured(5)
    found = fit(problem, problem.neutral())
    assert max(d.share for d in discrepancies(problem, found)) < 0.003
    assert max(found.scales.noise_factor.values()) < 1.15


def test_the_estimated_discrepancy_is_the_one_that_was_put_in() -> None:
    problem, truth, _ = measured(6)
    t = problem.trials[0].observation.t
    size, moving = problem.rms_of(0, "wheel_split")
    put_in = 0.2 * size * np.sin(2 * np.pi * t / 0.8) * moving
    for i in problem.commands[0]:
        problem.trials[i].measured[problem.trials[i].channels.index("wheel_split")] += put_in
    found = fit(problem, problem.neutral())
    d = next(d for d in discrepancies(problem, found) if (d.command, d.channel) == (0, "wheel_split"))
    at = moving > 0
    assert np.corrcoef(d.value[at], put_in[at])[0, 1] > 0.9
    assert np.abs(found.point.vector - truth.vector)[: problem.trials[0].size].max() < 0.05


def test_scales_of_what_differs_from_trial_to_trial_are_learnt() -> None:
    """Twelve trials with twice and half the first values: the mode of the posterior lies between."""
    problem = problem_of((0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2))
    rng = np.random.default_rng(7)
    wide = {"a_theta": 2.0, "wheel gain": 3.0, "cohesion": 0.4}
    point = problem.neutral()
    trials = []
    for t in problem.trials:
        trials.append(np.array([wide.get(s.name, 0.2) * s.std * rng.normal() for s in t.slacks]))
    truth = measure(problem, replace(point, trials=tuple(trials)), rng)
    scales = fit(problem, problem.neutral()).scales
    slacks = problem.trials[0].slacks
    for name in wide:
        k = [s.name for s in slacks].index(name)
        drawn_here = np.array([x[k] for x in truth.trials])
        first = slacks[k].std
        mode = np.sqrt(
            (np.sum((drawn_here - drawn_here.mean()) ** 2) + PSEUDO_TRIALS * first**2) / (12 + PSEUDO_TRIALS)
        )
        assert scales.priors[name] == pytest.approx(mode, rel=0.25), name
    assert scales.priors["a_theta"] > 1.3 * slacks[0].std


def test_what_all_trials_have_alike_widens_no_scale_and_its_prior_counts_once() -> None:
    """A gain of twelve trials, three std of the data sheet off, costs 3^2/2 of log evidence."""
    problem = problem_of((0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2))
    place, first = SHARED.index("current_f gain"), problem.learnt_std["current_f gain"]
    fits = []
    for off in (0.0, 3 * first):
        shared = off * (np.arange(len(SHARED)) == place)
        measure(problem, replace(problem.neutral(), shared=shared), np.random.default_rng(7))
        fits.append(fit(problem, problem.neutral()))
    alike, shifted = fits
    k = sum(x.size for x in shifted.point.trials) + place
    std = np.sqrt(shifted.posterior.covariance[k, k])
    assert shifted.point.vector[k] == pytest.approx(3 * first, abs=2 * std)
    widths = [f.scales.priors["current_f gain"] for f in fits]
    assert widths[1] == pytest.approx(widths[0], rel=0.1)
    assert alike.evidence - shifted.evidence == pytest.approx(3**2 / 2, abs=1.0)


def bounded(source: Problem, bound: float) -> Problem:
    """Return the same four trials where the sand has no solution beyond a bound."""
    problem = problem_of(FOUR, respond=Respond(bound))
    for t, s in zip(problem.trials, source.trials, strict=True):
        t.measured[:] = s.measured
    return problem


def test_a_simulation_without_a_solution_shortens_the_step() -> None:
    """The sand lies just within the bound; the first step goes beyond it."""
    rng = np.random.default_rng(8)
    problem = problem_of(FOUR)
    truth = problem.neutral()
    shared = truth.shared.copy()
    shared[3] = 0.3
    truth = measure(problem, replace(truth, shared=shared), rng)
    free = fit(problem, problem.neutral())
    other = bounded(problem, 0.315)
    found = fit(other, other.neutral())
    assert np.abs(found.point.vector - truth.vector)[-len(SHARED) + 3] < 0.05
    assert found.evidence == pytest.approx(free.evidence, abs=2.0)


@pytest.mark.parametrize("bound", [0.0301, 0.05, 0.1])
def test_a_fit_ends_within_the_region_that_has_solutions(bound: float) -> None:
    """The best fit lies far beyond where the model has a solution; the fit stays and says where it is."""
    rng = np.random.default_rng(9)
    source = problem_of(FOUR)
    shared = source.neutral().shared.copy()
    shared[:3] = 0.5, -0.5, 0.5
    measure(source, replace(source.neutral(), shared=shared), rng)
    problem = bounded(source, bound)
    found = fit(problem, problem.neutral())
    assert np.isfinite(found.evidence)
    for x in found.point.trials:
        assert np.abs(found.point.shared[:SAND_PER_TRIAL] + x[:SAND_PER_TRIAL]).max() <= bound
    began, ended = (objective(problem, p, found.scales) for p in (problem.neutral(), found.point))
    assert ended < (0.9 if bound > 0.04 else 1.0) * began
    assert not found.converged
    at_the_point = found.posterior.evidence + 0.5 * (found.posterior.misfit - ended)
    assert found.evidence == pytest.approx(at_the_point + log_prior(problem, found.scales, False), abs=0.1)


def objective(problem: Problem, point: Point, scales: Scales) -> float:
    """Return the misfit, simulated anew, and the priors."""
    begun = fit(problem, problem.neutral(), goal=AT_START)
    responses = simulated(problem, point)
    std, mean = problem.prior(point, scales)
    white = problem.white(problem.residuals(point, responses))
    normal = problem.normal(begun.point, begun.derivatives, begun.residuals)
    squares = sum(normal.misfits(white, scales).values())
    return float(squares + np.sum(((point.vector - mean) / std) ** 2))


@dataclass(frozen=True)
class Kinked(Respond):
    """More cohesion than the file's shows fully, less a quarter, as where another limit of (10) rules."""

    def one(self, scenario: Scenario, task: Task) -> Array | None:
        sand = np.array(task.sand)
        sand[COHESION] *= 1.0 if sand[COHESION] > 0 else 0.25
        return super().one(scenario, replace(task, sand=tuple(sand.tolist())))


@dataclass(frozen=True)
class Stiff(Respond):
    """A run diverges with the steps of one whose effect is smaller by more than 0.3."""

    def one(self, scenario: Scenario, task: Task) -> Array | None:
        out = super().one(scenario, task)
        if out is None or task.like is None:
            return out
        pairs = zip(task.setting, task.like.setting, strict=True)
        further = max((a[0] - b[0] for (_, a), (_, b) in pairs), default=0.0)
        return 1e3 * out if further > 0.3 else out


def test_where_repeated_steps_of_integration_let_a_run_diverge_it_chooses_its_own() -> None:
    problem, rng = problem_of(FOUR, respond=Stiff()), np.random.default_rng(2)
    start = problem.with_effect(problem.neutral(), "push", (0.0,))
    measure(problem, replace(start, common=np.array([3.0])), rng)
    found = fit(problem, start, goal=Goal(fine=False, rounds=4))
    assert found.point.common[0] == pytest.approx(3.0, abs=0.1)


def test_trials_on_both_sides_of_a_kink_are_fitted_to_the_optimum() -> None:
    """A derivative at the mean of the repetitions is that of none of them."""
    problem, rng = problem_of(FOUR, respond=Kinked()), np.random.default_rng(2)
    truth = drawn(problem, rng, common=0.2)
    for x, own in zip(truth.trials, (0.3, -0.3, 0.25, -0.25), strict=True):
        x[COHESION] = own
    measure(problem, truth, rng)
    found = fit(problem, problem.neutral())
    assert found.converged
    state = state_at(problem, found.point, found.derivatives)
    assert state is not None
    objective, *_ = predict_drop(problem, state, found.scales)
    sizes = np.cumsum([0, *(x.size for x in found.point.trials)])
    for step in np.diag(0.3 * std_of(found))[sizes + COHESION]:  # of each trial, and what they share
        for aim in (problem.stepped(found.point, step), problem.stepped(found.point, -step)):
            drop, _ = simulate_at(problem, state, found.scales, objective, aim)
            assert drop < 0.02


def test_a_start_without_a_solution_is_refused() -> None:
    problem = problem_of(FOUR)
    shared = problem.neutral().shared.copy()
    shared[0] = 0.2
    problem.pool._respond = Respond(0.1)
    with pytest.raises(EstimateError, match="cannot be simulated"):
        fit(problem, replace(problem.neutral(), shared=shared))


def test_a_misfit_that_is_not_smooth_makes_the_noise_louder() -> None:
    problem, _, rng = measured(11)
    for t in problem.trials:
        k = t.channels.index("current_f")
        t.measured[k] += 3 * 0.05 * rng.normal(size=t.observation.bins)
    noise_factor = fit(problem, problem.neutral()).scales.noise_factor
    assert noise_factor["current_f"] == pytest.approx(np.sqrt(10), rel=0.15)
    assert noise_factor["current_r"] < 1.2


def test_under_other_scales_the_fit_is_that_of_a_refit_under_them() -> None:
    problem, *_ = measured(12, 0.02)
    found = fit(problem, problem.neutral())
    narrow = replace(found.scales, priors={n: 0.3 * s for n, s in found.scales.priors.items()})
    other = with_priors(problem, found, narrow)
    std, _ = problem.prior(found.point, other.scales)
    N = found.normal.marginal(other.scales)[0][: std.size, : std.size] + np.diag(std**-2.0)
    assert other.posterior.covariance == pytest.approx(np.linalg.inv(N), rel=1e-4, abs=1e-9)
    assert other.scales.priors == narrow.priors
    assert std_of(other)[0] < std_of(found)[0]


def test_a_named_effect_is_fitted_with_its_size() -> None:
    rng = np.random.default_rng(13)
    problem = problem_of(FOUR)
    start = problem.with_effect(drawn(problem, rng), "push", (0.0,))
    measure(problem, replace(start, common=np.array([0.7])), rng)
    found = fit(problem, problem.with_effect(problem.neutral(), "push", (0.1,)))
    assert abs(found.point.common[0] - 0.7) < 4 * std_of(found)[-1] + 0.01
    assert DISCREPANCIES[0] <= max(found.scales.discrepancies.values()) < 0.02
    alone = fit(problem, problem.neutral())
    assert found.evidence > alone.evidence + 20


def test_sand_stays_within_three_std_of_its_file() -> None:
    problem = problem_of(FOUR)
    step = np.full(problem.neutral().vector.size, 10.0)
    moved = problem.stepped(problem.neutral(), step)
    assert moved.shared[: len(SAND)] == pytest.approx(3 * problem.sand_std)


def test_derivatives_are_taken_backwards_where_a_step_has_no_solution() -> None:
    """The response is linear, so that both directions give the same derivative."""
    free = problem_of(FOUR)
    expected = differentiate(free, free.neutral())
    point = replace(free.neutral(), shared=np.where(np.arange(len(SHARED)) == 0, 0.095, 0.0))
    one_way = differentiate(problem_of(FOUR, respond=Respond(bound=0.1)), point)
    for command, _ in enumerate(free.commands):
        np.testing.assert_allclose(expected.by_simulated(command), one_way.by_simulated(command), atol=1e-9)


@pytest.mark.parametrize("size", [0.02, 0.3])
def test_numbers_of_an_effect_in_each_trial_have_the_scale_that_they_show(size: float) -> None:
    rng = np.random.default_rng(11)
    problem = problem_of((0, 0, 0, 1, 1, 1, 2, 2, 2))
    point = problem.with_effect(drawn(problem, rng, common=0.3), "shake", (0.0,))
    own = size * rng.normal(size=len(problem.trials))
    trials = tuple(np.append(x[:-1], a) for x, a in zip(point.trials, own, strict=True))
    measure(problem, replace(point, trials=trials), rng)
    start = problem.with_effect(problem.neutral(), "shake", (0.0,), 0.5 * own[:, None])
    found = fit(problem, start)
    assert found.scales.priors["shake own"] == pytest.approx(np.sqrt(np.mean(own**2)), rel=0.25)


def test_no_effect_is_credited_with_what_it_would_gain_beyond_its_bound() -> None:
    """Trials that ask for a negative size say nothing for an effect that has none."""
    rng = np.random.default_rng(5)
    problem = problem_of((0, 0, 1, 1))
    measure(problem, problem.with_effect(drawn(problem, rng), "push", (-0.3,)), rng)
    alone = fit(problem, problem.neutral())
    bounded, free = (fit(problem, problem.with_effect(alone.point, i, (0.0,))) for i in ("lift", "push"))
    assert bounded.point.common[0] == 0.0
    assert free.evidence > alone.evidence + 10
    assert bounded.evidence < alone.evidence + 1


def test_a_trial_in_stretches_gives_the_numbers_of_the_whole_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half as long as those in use: what is lost is the correlation across the cuts, a few bumps of many."""
    problem, _, _ = measured(4, discrepancy=0.02)
    start = problem.neutral()
    whole = fit(problem, start)
    shapes = [d.value.shape for d in discrepancies(problem, whole)]
    monkeypatch.setattr(noise, "WHOLE", 2.0)
    monkeypatch.setattr(noise, "STRETCH", 2.0)
    problem.set_noise(nominal(problem), start, differentiate(problem, start))
    found = fit(problem, start)
    assert len(problem.whiteners[0][0].filters) > 1
    assert np.max(np.abs(found.point.vector - whole.point.vector) / std_of(whole)) < 0.5
    assert std_of(found) / std_of(whole) == pytest.approx(np.ones(whole.point.vector.size), rel=0.3)
    assert [d.value.shape for d in discrepancies(problem, found)] == shapes


def test_a_scatter_that_is_as_filed_costs_nothing_and_any_other_does() -> None:
    problem = problem_of(FOUR)
    first = problem.learnt_std

    def cost(factor: float) -> float:
        scales = Scales(0.01, 0.1, {name: factor * std for name, std in first.items()})
        return log_prior(problem, Scales(0.01, 0.1), False) - log_prior(problem, scales, False)

    assert cost(1.0) == 0
    assert cost(10.0) == pytest.approx(PSEUDO_TRIALS * len(first) * (np.log(10) - 0.495))
    assert cost(0.5) > 0


@pytest.mark.parametrize("seed", range(20))
def test_a_step_that_several_bounds_hold_is_the_least_within_them(seed: int) -> None:
    """Of a drawn linear problem whose numbers are alike; no other point within the bounds is better."""
    rng, problem = np.random.default_rng(seed), problem_of(FOUR)
    start = problem.neutral()
    step = problem.prior(start, Scales(0.01, 0.1))[0] * rng.normal(size=start.vector.size)
    point = problem.stepped(start, step)
    std, mean = problem.prior(point, Scales(0.01, 0.1))
    A = rng.normal(size=(std.size, 5)) @ rng.normal(size=(5, std.size + 1)) + rng.normal(
        size=(std.size, std.size + 1)
    )
    A[:, :-1] *= 10 / std
    A[:, -1] *= 300
    M = A.T @ A
    aim = _aim(problem, point, M, std, mean - point.vector)
    assert (np.abs(aim.shared[: len(SAND)]) > 2.99 * problem.sand_std).sum() > 1
    least = _linear(M, std, mean, point, aim)
    assert least <= _linear(M, std, mean, point, point)
    for size in (1e-3, 0.03, 1.0):
        other = problem.stepped(aim, size * std * rng.normal(size=std.size))
        assert least <= _linear(M, std, mean, point, other) + 1e-9 * abs(least)


def test_the_start_under_the_other_limit_of_the_shear_stress_is_under_that_limit() -> None:
    """By the torque of a wheel: cohesion changes it where the strength of the sand limits it."""
    problem, _, _ = measured(1)
    file, rim, motion = load_soil(), load_robot().wheels, rolling(0.2, load_robot().wheels.radius)

    def cohesion_shows(point: Point) -> bool:
        changed = {
            name: getattr(file, name) * np.exp(point.shared[SAND.index(name)])
            for name in ("cohesion", "friction_angle", "tyre_friction")
        }
        soil = replace(file, **changed)
        other = replace(soil, cohesion=1.1 * soil.cohesion)
        one, two = (SingleWheel(rim, s).at_sinkage(0.01, motion, Ratio(0.3)).torque for s in (soil, other))
        return abs(two / one - 1) > 1e-3

    limited_by_sand = problem.under_other_limit(problem.neutral())
    assert not cohesion_shows(problem.neutral())
    assert cohesion_shows(limited_by_sand)
    stronger = limited_by_sand.shared.copy()
    stronger[COHESION] = 0.1
    again = problem.under_other_limit(replace(limited_by_sand, shared=stronger))
    assert not cohesion_shows(again)
    assert not again.shared[COHESION]


@pytest.mark.parametrize(
    ("gained", "predicted", "share", "ends"),
    [
        (-5.0, 0.0, 1.0, True),  # five in eight steps: 18 in the 29 that are left
        (-9.0, 0.0, 1.0, False),  # 33
        (-5.0, 41.0, 1.0, False),  # the derivatives promise 20.5
        (-1.0, 0.0, 0.1, False),  # 3.6, and a tenth of the distance is 2
        (-0.5, 0.0, 0.1, True),
    ],
)
def test_a_fit_ends_where_its_growth_does_not_lead_to_what_is_asked_for(
    gained: float, predicted: float, share: float, ends: bool
) -> None:
    problem, truth, _ = measured(1)
    state = state_at(problem, truth)
    assert state is not None
    _, evidence = evidence_at(problem, state, FIRST)
    goal = Goal(fine=False, evidence=evidence + 20, share=share)
    descent = Descent(state, FIRST, goal, reached=[evidence + gained] * (UPDATES + 2))
    assert descent._is_beaten(problem, predicted) is ends
    young = Descent(state, FIRST, goal, reached=[evidence] * (UPDATES - 1))
    assert not young._is_beaten(problem, 0.0)
    assert not Descent(state, FIRST, Goal())._is_beaten(problem, 0.0)
