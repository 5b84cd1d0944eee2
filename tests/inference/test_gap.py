"""The discrepancy is a smooth process; what noise leaves of a fit is expected rightly, and more is a gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from granite_lab.inference.constants import REST_SHARE, SMOOTH
from granite_lab.inference.discrepancy import (
    FORMULA,
    MOTION,
    REST,
    joined,
    modulated,
    smooth,
    variances,
)
from granite_lab.inference.fit import FIRST, Fit, fit
from granite_lab.inference.gap import beyond, discrepancies, scatter
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array
from tests.inference.stub import drawn, measure, predicted, problem_of

pytestmark = pytest.mark.usefixtures("one_blas_thread")
TOLERANCE = 0.02
FOUR = (0, 0, 1, 1)


def linear(problem: Problem, rng: np.random.Generator, share: float) -> Fit:
    """Return the fit, linear about the files' values, of trials drawn from the model of the measurement.

    Numbers are drawn from their priors, the discrepancy with a share in motion and as it is near rest.
    """
    point = problem.neutral()
    slopes = problem.slopes(point)
    std, _ = problem.prior(point, FIRST)
    θ = std * rng.normal(size=std.size)
    first = np.cumsum([0, *(x.size for x in point.trials)])
    shown = predicted(problem, point)
    for command, own in enumerate(problem.commands):
        smooth = {}
        for c, basis in problem._plain[command].items():
            root = np.sqrt(variances(basis.kind, share, 0.0))
            smooth[c] = basis.columns @ (root * rng.normal(size=root.size))
        for i in own:
            J = problem.columns(i, point, slopes)
            x = np.concatenate([θ[first[i] : first[i + 1]], θ[first[-1] :]])
            t = problem.trials[i]
            change = (J @ x).reshape(t.measured.shape)
            for k, c in enumerate(t.channels):
                noise = rng.normal(size=t.observation.bins) / problem.whiteners[i][k].inverse
                t.measured[k] = shown[i][k] + change[k] + smooth[c] + noise
    return fit(problem, point, FIRST, slopes=slopes, rounds=0)


def test_the_misfit_is_the_expected_one_where_nothing_is_missing() -> None:
    """The expectation follows the noise that is there: the scatter of their difference is less than half."""
    problem = problem_of(FOUR)
    left, expected = means_of(problem, 0.0)
    away = left - expected
    assert abs(away.mean()) < 0.01 * expected.mean()
    assert np.std(away) < 0.5 * np.std(left)


def test_a_discrepancy_of_the_tolerated_size_is_a_small_gap() -> None:
    """The misfit is then that of independent numbers; five percent of it are beyond what is expected."""
    problem = problem_of(FOUR)
    left, expected = means_of(problem, TOLERANCE)
    bins = sum(t.measured.size for t in problem.trials)
    assert left.mean() == pytest.approx(bins, abs=4 * np.sqrt(2 * bins / left.size))
    assert 0 < (left - expected).mean() < 0.06 * bins


def means_of(problem: Problem, share: float) -> tuple[Array, Array]:
    rows = [beyond(problem, linear(problem, np.random.default_rng(s), share), TOLERANCE) for s in range(40)]
    left, expected = np.array(rows).T
    return left, expected


def test_the_discrepancy_of_a_channel_is_the_conditional_mean_of_the_dense_gaussian() -> None:
    """Numbers and discrepancy together, of all trials at once, in three channels."""
    problem = problem_of((0, 0, 1), ("pitch_rate", "wheel", "current_f"))
    found = linear(problem, np.random.default_rng(4), 0.1)
    point, scales = found.point, found.scales
    std, _ = problem.prior(point, scales)
    first = np.cumsum([0, *(x.size for x in point.trials)])
    n = [r.size for r in found.residuals]
    begin = np.cumsum([0, *n])
    J, y, noise = np.zeros((begin[-1], std.size)), np.zeros(begin[-1]), np.zeros(begin[-1])
    for i, t in enumerate(problem.trials):
        rows = slice(begin[i], begin[i + 1])
        places = [*range(first[i], first[i + 1]), *range(first[-1], std.size)]
        J[rows, places] = problem.columns(i, point, found.slopes)
        y[rows] = found.residuals[i].ravel()
        noise[rows] = np.concatenate([1 / w.inverse for w in problem.whiteners[i]]) ** 2
        assert t.channels == problem.trials[0].channels
    Σ = np.diag(noise) + (J * std**2) @ J.T
    bins = {}
    for command, own in enumerate(problem.commands):
        for c, basis in problem._plain[command].items():
            B = np.zeros((begin[-1], basis.kind.size))
            for i in own:
                at = problem.rows[i][c]
                B[begin[i] + at.start : begin[i] + at.stop] = basis.columns
            Λ = variances(basis.kind, scales.share_of(c), scales.formula)
            Σ += (B * Λ) @ B.T
            bins[command, c] = (B, Λ, basis)
    solved = np.linalg.solve(Σ, y)
    for d in discrepancies(problem, found):
        B, Λ, basis = bins[d.command, d.channel]
        own = basis.kind == MOTION
        moving = problem.size_of(d.command, d.channel)[1] > 0
        wanted = basis.columns[:, own] @ (Λ * (B.T @ solved))[own] * moving
        assert d.value == pytest.approx(wanted, rel=1e-5, abs=1e-6 * d.size)


def test_a_channel_that_never_moves_has_no_share() -> None:
    problem = problem_of(FOUR)
    found = discrepancies(problem, linear(problem, np.random.default_rng(1), 0.0))[0]
    assert replace(found, std=np.zeros_like(found.std)).share == 0.0


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_repetitions_scatter_by_what_changes_slowly_from_trial_to_trial(share: float) -> None:
    """A wave of 2 Hz and random phase in the pitch rate, as a robot on uneven ground shows it."""
    problem = problem_of((0, 0, 0, 1, 1, 1))
    rng = np.random.default_rng(6)
    k = problem.trials[0].channels.index("pitch_rate")
    measure(problem, drawn(problem, rng), rng)
    for i, t in enumerate(problem.trials):
        size, moving = problem.size_of(problem.variants.index(t.variant), "pitch_rate")
        wave = np.sin(4 * np.pi * t.observation.t + 2 * np.pi * i / 3)
        t.measured[k] += np.sqrt(2) * share * size * wave * (moving > 0)
    found = scatter(problem, fit(problem, problem.neutral(), FIRST))
    assert found.pop("pitch_rate") == pytest.approx(share, abs=0.2 * share + 0.05)
    assert max(found.values()) < 0.1


WIDTH = 0.02


@pytest.mark.parametrize("n", [30, 200, 400])
def test_the_process_has_unit_variance(n: int) -> None:
    variance = (smooth(n, WIDTH) ** 2).sum(axis=1)
    assert variance.mean() == pytest.approx(1.0, abs=0.03)
    assert 0.6 < variance.min() < variance.max() < 1.4  # cos^4 + sin^4 lies between 1/2 and 1


def test_the_process_is_smooth_over_the_shorter_time_and_forgets_over_the_longer() -> None:
    columns = smooth(400, WIDTH)
    covariance = columns @ columns.T
    lag = np.array([np.diag(covariance, k).mean() for k in range(80)])
    assert lag[1] > 0.95  # from one bin to the next
    assert 0.2 < lag[round(SMOOTH[0] / WIDTH)] < 0.8
    assert abs(lag[round(2 * SMOOTH[1] / WIDTH) :]).max() < 1e-12


def test_a_size_modulates_the_process() -> None:
    size = np.concatenate([np.zeros(100), np.linspace(0, 3, 100)])
    basis = modulated(size, MOTION, WIDTH)
    std = np.sqrt((basis.columns**2).sum(axis=1))
    assert (std[:100] == 0).all()
    assert std[105:] / size[105:] == pytest.approx(np.ones(95), abs=0.25)
    assert (basis.kind == MOTION).all()
    assert (np.abs(basis.columns).max(axis=0) > 0).all()  # bumps where nothing can be are not kept


def test_bases_are_joined_with_the_variance_of_each_kind() -> None:
    moving, resting = np.ones(100), np.zeros(100)
    moving[60:], resting[60:] = 0.0, 2.0
    parts = [modulated(x, k, WIDTH) for x, k in ((moving, MOTION), (resting, REST), (0.1 * moving, FORMULA))]
    whole = joined(parts)
    assert whole.columns.shape == (100, sum(p.kind.size for p in parts))
    Λ = variances(whole.kind, 0.05, 0.2)
    std = np.sqrt((whole.columns**2 * Λ).sum(axis=1))
    assert std[5:55] == pytest.approx(np.full(50, np.hypot(0.05, 0.02)), rel=0.3)
    assert std[65:] == pytest.approx(np.full(35, 2 * REST_SHARE), rel=0.3)
