"""a_θ over trials, the rival laws, intervals by the likelihood, and the budget of the std."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import curve_fit

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate, Part
from granite_lab.fitting import fit_a_theta, published_fit
from granite_lab.fitting.atheta import a_theta_interval, k92_interval
from granite_lab.fitting.fit import SCATTER, K92Fit, Shift, of_a_theta, of_mean, views_of
from granite_lab.parameters import load_paper
from tests.fitting.made_up import made_up_fit
from tests.soak import SOAK

SPEEDS = (0.2, 0.3, 0.5, 0.7)
TABLE3 = load_paper().table3


def law(fit, name):
    return next(law for law in fit.laws if law.id == name)


def drawn(rng, *, scatter=0.05, std=0.006, a=4.919, repetitions=3, shift=None):
    """Draw k_92 of trials around the exponential law; `shift` is a relative deviation per speed."""
    found = []
    for v in SPEEDS:
        for i in range(repetitions):
            k = math.exp(-a * v) * (1 + scatter * rng.standard_normal() + (shift or {}).get(v, 0.0))
            fitted, slip = Estimate(k + std * rng.standard_normal(), std), Estimate(0.26 - 0.7 * k, 0.004)
            found.append(made_up_fit(f"{v}/{i}", v, fitted, slip))
    return found


def test_the_published_k92_give_the_published_a_theta():
    fit = published_fit()
    assert fit.a_theta.value == pytest.approx(4.919, abs=5e-4)
    assert fit.log_linear == pytest.approx(4.9192, abs=5e-5)
    assert fit.ordinary == pytest.approx(4.933, abs=5e-4)
    assert fit.agrees
    assert fit.ci95[0] < 4.919 < fit.ci95[1]
    # four points are too few to weigh the laws
    assert math.isnan(law(fit, "linear_slip").aicc)
    assert all(math.isnan(law.weight) for law in fit.laws)
    assert any("too few for the AICc" in note for note in fit.notes)


def test_speeds_that_print_alike_are_one_speed_in_all_laws():
    """Measured velocities of one command differ in the fourth digit; 0.4983 and 0.5021 are two speeds."""
    velocities = (0.30012, 0.30034, 0.4983, 0.5021, 0.50213, 0.69988)
    fits = [
        made_up_fit(str(i), v, Estimate(math.exp(-4.9 * v), 0.01), Estimate(0.1 + 0.1 * v + 0.01 * i, 0.004))
        for i, v in enumerate(velocities)
    ]
    fit = fit_a_theta(fits)
    assert list(law(fit, "free").parameters) == [f"k_92 at {v} m/s" for v in ("0.3", "0.498", "0.502", "0.7")]
    assert fit.a_theta.value == pytest.approx(4.9, abs=0.01)


def test_speeds_with_a_lack_of_fit_are_one_point_each_however_their_digits_differ():
    """What differs by a millionth from equal velocities gives the same fit over speeds."""
    shift = {0.2: 0.3, 0.3: -0.25, 0.5: 0.3, 0.7: -0.3}
    equal = drawn(np.random.default_rng(5), scatter=0.01, shift=shift)
    near = [
        made_up_fit(f.trial, f.variant.velocity * (1 + 1e-6 * i), f.k92, f.slip_measured)
        for i, f in enumerate(equal)
    ]
    one, other = fit_a_theta(equal), fit_a_theta(near)
    assert any("over 4 speeds" in note for note in one.notes)
    assert other.a_theta.value == pytest.approx(one.a_theta.value, abs=1e-4)
    assert other.a_theta.std == pytest.approx(one.a_theta.std, rel=1e-3)
    assert np.allclose(other.sensitivity, one.sensitivity, rtol=1e-3, atol=1e-6)


def test_the_published_line_over_slip_is_found():
    line = law(published_fit(), "linear_slip")
    b_0, b_1 = line.parameters["b_0"], line.parameters["b_1"]
    assert b_0.value == pytest.approx(0.4108, abs=5e-5)
    assert b_1.value == pytest.approx(-0.01727, abs=5e-6)
    assert line.units["b_1"] == "1/%"
    assert "0.4108 - 0.0173" in line.formula
    # the root, where the model ends: 23.75 % in the paper's rounded figures
    assert -b_0.value / b_1.value == pytest.approx(23.79, abs=0.01)
    # the textbook's covariance of a straight line
    _, covariance = curve_fit(
        lambda x, a, b: a + b * x, [100 * p.slip_measured for p in TABLE3], [p.k92 for p in TABLE3]
    )
    assert [b_0.std, b_1.std] == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-3)


def test_equal_errors_without_scatter_give_least_squares_on_k92():
    points = [
        made_up_fit(f"{p.velocity}", p.velocity, Estimate(p.k92, 0.05), Estimate(p.slip_measured))
        for p in TABLE3
    ]
    fit = fit_a_theta(points)
    assert fit.scatter == 0.0  # 0.05 covers all deviations
    assert fit.a_theta.value == pytest.approx(fit.ordinary, abs=1e-6)
    v = np.array(SPEEDS)
    assert fit.a_theta.std == pytest.approx(0.05 / np.linalg.norm(v * np.exp(-fit.ordinary * v)), rel=1e-6)


def test_a_precise_trial_outweighs_a_vague_one():
    precise = made_up_fit("a", 0.3, Estimate(math.exp(-5.5 * 0.3), 0.001), Estimate(0.1))
    vague = made_up_fit("b", 0.3, Estimate(math.exp(-4.0 * 0.3), 0.2), Estimate(0.1))
    assert fit_a_theta([precise, vague]).a_theta.value == pytest.approx(5.5, abs=0.02)


def test_scatter_beyond_the_stated_errors_is_found_and_widens_the_interval():
    found = [fit_a_theta(drawn(np.random.default_rng(s), scatter=0.10, std=0.001)) for s in range(12)]
    assert np.median([fit.scatter for fit in found]) == pytest.approx(0.10, rel=0.25)
    calm = fit_a_theta(drawn(np.random.default_rng(0), scatter=0.0, std=0.001))
    assert found[0].a_theta.std > 3 * calm.a_theta.std


def test_speeds_that_leave_the_law_rule_the_interval():
    shift = {0.2: -0.12, 0.3: 0.13, 0.5: 0.25, 0.7: -0.2}
    fit = fit_a_theta(drawn(np.random.default_rng(2), scatter=0.02, std=0.001, shift=shift))
    assert any("over 4 speeds, not 12 trials" in note for note in fit.notes)
    assert fit.a_theta.std > 0.1
    assert fit.scatter < 0.06
    assert law(fit, "exponential").weight < 0.01


def test_a_k92_at_the_lower_bound_counts_as_below_it():
    """Some trials at 0.7 m/s end at 0; taking the 0 for a value or leaving it out biases a_θ."""
    rng = np.random.default_rng(5)
    truth, naive, dropped, censored, notes = 4.0, [], [], [], []
    for _ in range(40):
        fits = []
        for v in (0.5, 0.7):
            for i in range(6):
                k = math.exp(-truth * v) + 0.06 * rng.standard_normal()
                status = "ok" if k > 0 else "at_lower_bound"
                fits.append(made_up_fit(f"{v}/{i}", v, Estimate(max(k, 0.0), 0.06), status=status))
        at_value = [dataclasses.replace(f, status="ok") for f in fits]
        naive.append(fit_a_theta(at_value).a_theta.value)
        dropped.append(fit_a_theta([f for f in fits if f.status == "ok"]).a_theta.value)
        fit = fit_a_theta(fits)
        censored.append(fit.a_theta.value)
        notes += fit.notes
    assert abs(np.mean(censored) - truth) < 0.1
    assert abs(np.mean(censored) - truth) < 0.5 * abs(np.mean(dropped) - truth)
    assert np.mean(naive) < np.mean(censored)
    assert any("censored" in note for note in notes)


def test_k92_below_zero_enters_the_weighted_fit_but_not_the_logarithm():
    odd = made_up_fit("odd", 0.7, Estimate(-0.004, 0.01), Estimate(0.26, 0.004))
    fit = fit_a_theta([*drawn(np.random.default_rng(1)), odd])
    assert any("<= 0 cannot enter" in note for note in fit.notes)
    assert math.isfinite(fit.log_linear)
    assert len(fit.points) == 13


def test_one_trial_gives_a_normal_interval_and_says_what_it_lacks():
    fit = fit_a_theta([made_up_fit("only", 0.3, Estimate(0.23, 0.01), Estimate(0.09, 0.004))])
    assert fit.a_theta.value == pytest.approx(-math.log(0.23) / 0.3)
    assert fit.a_theta.std == pytest.approx(0.01 / (0.23 * 0.3), rel=1e-6)
    assert any("one trial only" in note for note in fit.notes)


@pytest.mark.parametrize(
    "items",
    [
        [],
        [made_up_fit("x", 0.3, Estimate(math.nan), Estimate(0.1))],
        [made_up_fit("x", 0.7, Estimate(0.0, 0.01), status="at_lower_bound")],
    ],
)
def test_nothing_usable_is_refused(items):
    with pytest.raises(EstimateError) as caught:
        fit_a_theta(items)
    assert caught.value.exit_code == 4
    assert caught.value.hint


def test_laws_compare_on_the_same_data_and_the_true_one_wins():
    wins = [fit_a_theta(drawn(np.random.default_rng([3, s]))).laws[0].id for s in range(10)]
    fit = fit_a_theta(drawn(np.random.default_rng([3, 0])))
    assert sum(law.weight for law in fit.laws) == pytest.approx(1.0)
    assert [law.aicc for law in fit.laws] == sorted(law.aicc for law in fit.laws)
    # the trials' λ_R is a line in k_92, so both laws are true there; a constant per speed is wasteful
    assert "free" not in wins


def test_aicc_of_the_exponential_law_is_the_textbooks():
    points = [(0.2, 0.38), (0.2, 0.36), (0.3, 0.22), (0.3, 0.24), (0.5, 0.09), (0.7, 0.04)]
    fit = fit_a_theta([made_up_fit("", v, Estimate(k), Estimate(0.1 + v / 5)) for v, k in points])
    v, k = np.array(points).T
    rss, n, count = float(((k - np.exp(-fit.ordinary * v)) ** 2).sum()), 6, 2
    expected = (
        n * (math.log(2 * math.pi * rss / n) + 1) + 2 * count + 2 * count * (count + 1) / (n - count - 1)
    )
    assert law(fit, "exponential").aicc == pytest.approx(expected, abs=1e-3)


def test_the_95_percent_interval_holds_the_true_a_theta():
    """Virtual studies of 12 trials; where k_92 is small, their stated std is as large as it."""
    studies = [
        fit_a_theta(drawn(np.random.default_rng([23, seed]), std=0.012)).ci95
        for seed in range(80 if SOAK else 40)
    ]
    assert 0.90 <= np.mean([low <= 4.919 <= high for low, high in studies]) <= 0.99


def test_errors_that_all_trials_share_widen_the_total_by_what_they_do_to_a_theta():
    """A number that moves log a_θ by 0.3 up and 0.1 down contributes their rms, however many trials."""
    up, down = 4.9 * math.exp(0.3), 4.9 * math.exp(-0.1)
    fits = []
    for v in (*SPEEDS, *SPEEDS, *SPEEDS):
        k = math.exp(-4.9 * v)
        shift = Shift("K", 0.2, math.exp(-up * v) - k, math.exp(-down * v) - k)
        fits.append(made_up_fit(f"{v}", v, Estimate(k, 0.002), shared=(shift,)))
    fit = fit_a_theta(fits)
    whole = 4.9 * math.sqrt((0.3**2 + 0.1**2) / 2)
    assert fit.shared[0].contribution == pytest.approx(whole, rel=1e-3)
    assert fit.total.value == fit.a_theta.value
    assert fit.total.std == pytest.approx(math.hypot(fit.a_theta.std, whole), rel=1e-3)
    half = math.hypot(math.log(fit.ci95[1] / fit.a_theta.value), 1.96 * whole / 4.9)
    assert math.log(fit.total_ci95[1] / 4.9) == pytest.approx(half, rel=1e-2)
    files, uncertain = views_of(fit)
    assert (files.by, uncertain.by) == ("files", "uncertain")
    assert files.ci95 == fit.ci95
    assert uncertain.ci95 == fit.total_ci95
    assert uncertain.parts[0].name == "K"
    assert math.hypot(*(part.contribution for part in uncertain.parts)) == pytest.approx(fit.total.std)


def test_trials_without_a_simulation_have_no_total():
    fit = fit_a_theta(drawn(np.random.default_rng(1)))
    assert math.isnan(fit.total.value)
    assert [v.by for v in views_of(fit)] == ["files"]


STD = 0.01  # of λ_R


def straight(k: float) -> float:
    return 0.26 - 0.7 * k


def bent(k: float) -> float:
    return 0.26 - 0.4 * math.sqrt(k + 0.0025)


def fit(curve, root: float) -> K92Fit:
    grid = sorted({*np.linspace(0, 1, 41), *np.linspace(0, 0.2, 41)})
    slope = (curve(root + 1e-6) - curve(root - 1e-6)) / 2e-6
    std = STD / abs(slope)
    points = tuple((float(k), curve(k)) for k in grid)
    slip = Estimate(curve(root), STD)
    return made_up_fit("virtual", 0.7, Estimate(root, std), slip, std_measurement=std, curve=points)


def test_a_straight_curve_gives_the_interval_of_the_covariance():
    trials = [fit(straight, 0.3), fit(straight, 0.32)]
    assert k92_interval(trials, (0.29, 0.33)) == pytest.approx((0.29, 0.33), abs=1e-6)
    v, own = np.array([0.2, 0.3]), np.array([STD / 0.7] * 2) ** 2
    k = np.exp(-4.9 * v)
    trials = [fit(straight, x) for x in k]
    std = 1 / math.sqrt(float(((v * k) ** 2 / own).sum()))
    low, high = a_theta_interval(trials, v, np.diag(own), Estimate(4.9, std), 0.5)
    assert (low, high) == pytest.approx((4.9 - 0.5 * std, 4.9 + 0.5 * std), abs=0.05 * std)


def test_on_a_bent_curve_the_ends_have_the_slip_ratios_of_its_ends():
    root = 0.04
    one = fit(bent, root)
    low, high = k92_interval([one], one.k92.interval(1.96))
    assert bent(low) == pytest.approx(bent(root) + 1.96 * STD, abs=2e-4)
    assert bent(high) == pytest.approx(bent(root) - 1.96 * STD, abs=2e-4)
    assert high - root > 1.1 * (root - low)  # skewed away from the bound
    low, high = k92_interval([fit(bent, 0.004)], fit(bent, 0.004).k92.interval(1.96))
    assert low == 0.0  # near the bound it ends at that
    assert 0.004 < high < 0.1


def test_the_interval_of_a_theta_holds_the_truth_as_often_as_it_says():
    rng, v, a = np.random.default_rng(1), np.array([0.4, 0.5, 0.6, 0.7]), 4.919
    true = np.exp(-a * v)
    inside, draws = 0, 300 if SOAK else 150
    for _ in range(draws):
        trials = []
        for k in true:
            seen = bent(k) + STD * rng.standard_normal()
            root = max(((0.26 - seen) / 0.4) ** 2 - 0.0025, 1e-3)
            trials.append(dataclasses.replace(fit(bent, root), slip_measured=Estimate(seen, STD)))
        own = np.array([t.k92.std for t in trials]) ** 2
        weight = (v * true) ** 2 / own
        std = 1 / math.sqrt(weight.sum())
        low, high = a_theta_interval(trials, v, np.diag(own), Estimate(a, std), 1.96)
        inside += low <= a <= high
    assert inside / draws == pytest.approx(0.95, abs=0.04)


@pytest.mark.parametrize(("moved", "by_likelihood"), [(0.05, False), (0.2, True)])
def test_the_likelihood_is_used_where_it_differs_by_more_than_a_tenth_of_the_half(moved, by_likelihood):
    one, half = fit(straight, 0.3), 0.02
    linear = 0.28 - moved * half, 0.32 - moved * half  # the likelihood gives 0.28 to 0.32
    found = k92_interval([one], linear)
    assert (found != linear) == by_likelihood
    assert found[0] == pytest.approx(0.28 if by_likelihood else linear[0])
    assert k92_interval([dataclasses.replace(one, curve=())], linear) == linear


def budgeted(name: str, v: float, k: float, parts: tuple[Part, ...]) -> K92Fit:
    std = math.hypot(*(p.contribution for p in parts))
    return made_up_fit(name, v, Estimate(k, std), Estimate(0.2, 0.7 * std), parts=parts)


def fits(shift: dict[float, float], scatter: float) -> list[K92Fit]:
    rng, found = np.random.default_rng(4), []
    for v in SPEEDS:
        for i in range(3):
            k = math.exp(-4.919 * v) * (1 + shift.get(v, 0.0) + scatter * rng.standard_normal())
            own = (
                Part("sensor", "A", "normal", "m/s²", 0.01, 0.003 * rng.uniform(0.5, 2)),
                Part("sand", "B", "log-normal", "1", 0.08, 0.05 * k),
            )
            found.append(budgeted(f"{v}/{i}", v, k, own))
    return found


@pytest.mark.parametrize(
    ("shift", "scatter"),
    [({}, 0.0), ({}, 0.2), ({0.3: 0.5, 0.5: -0.4}, 0.05)],
    ids=["none", "trials", "speeds"],
)
def test_the_budget_of_a_theta_adds_up(shift: dict[float, float], scatter: float) -> None:
    trials = fits(shift, scatter)
    found = fit_a_theta(trials)
    budget = of_a_theta(found, trials)
    assert budget.combined == pytest.approx(found.a_theta.std, rel=1e-6)
    assert sum(budget.share(p) for p in budget.parts) == pytest.approx(1.0)
    assert ("departure of the speeds from the law (27)" in {p.name for p in budget.parts}) == bool(shift)


def test_the_sensitivity_of_a_theta_is_its_derivative() -> None:
    trials = fits({}, 0.0)
    before = fit_a_theta(trials)
    step = 1e-4
    moved = [*trials[:5], budgeted("other", 0.3, trials[5].k92.value + step, trials[5].parts), *trials[6:]]
    change = (fit_a_theta(moved).a_theta.value - before.a_theta.value) / step
    assert before.sensitivity[5] == pytest.approx(change, rel=0.01)


def test_what_scatters_beyond_the_stated_std_is_a_component_of_type_a() -> None:
    parts = [(Part("sensor", "A", "normal", "m/s²", 0.01, 0.002),)] * 3
    budget = of_mean(0.3, Estimate(0.1, 0.004), parts, [1 / 3] * 3)
    assert budget.combined == pytest.approx(0.004)
    scatter = next(p for p in budget.parts if p.name == SCATTER)
    assert scatter.contribution == pytest.approx(math.sqrt(0.004**2 - 0.002**2 / 3))
    assert scatter.kind == "A"
    narrow = of_mean(0.3, Estimate(0.1, 0.002 / math.sqrt(3)), parts, [1 / 3] * 3)
    assert [p.name for p in narrow.parts] == ["sensor"]
