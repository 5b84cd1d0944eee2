"""Whatever the normal equations and the gap say, the dense covariance of all measurements says too."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from granite_lab.discovery.candidates import gain
from granite_lab.inference.constants import REST_SHARE, SMOOTH
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.descent import AT_START
from granite_lab.inference.discrepancy import FORMULA, MOTION, REST, joined, modulated, smooth, variances
from granite_lab.inference.fit import Fit, fit
from granite_lab.inference.gap import beyond, discrepancies, scatter
from granite_lab.inference.normal import ChannelPart, CommandPart, NormalEquations, Rows, Scales, posterior
from granite_lab.inference.nuisances import TrialModel
from granite_lab.inference.pool import SimulationPool
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import FIRST
from granite_lab.inference.setup import nominal
from granite_lab.logs.trial import Array
from tests.inference.stub import COMMANDS, ROBOT, Respond, measured, predicted, problem_of

Rng = np.random.Generator
BINS = 9
CHANNELS = ("accel_x", "current_f")


@dataclass(frozen=True, eq=False)
class Made:
    """Random trials: of two commands, the first repeated, with two channels; one trial lacks the second.

    Attributes:
        normal: as the inference keeps them.
        command, channel: (N,) of each bin.
        trial: (N,) of each bin.
        columns: (N, p + k) by parameters and candidates.
        basis: (N, M) by all amplitudes of the discrepancy.
        own: (M,) channel of each amplitude; `kind` its kind.
        y: (N,) whitened residuals.
    """

    normal: NormalEquations
    channel: list[str]
    trial: Array
    columns: Array
    basis: Array
    own: list[str]
    kind: Array
    y: Array

    def prior_of_amplitudes(self, scales: Scales) -> Array:
        root = [
            {MOTION: scales.discrepancy_of(c), REST: REST_SHARE, FORMULA: scales.formula_of(c)}[k]
            for c, k in zip(self.own, self.kind.tolist(), strict=True)
        ]
        return np.square(root)

    def noise(self, scales: Scales) -> Array:
        return np.array([scales.noise_factor.get(c, 1.0) ** 2 for c in self.channel])

    def covariance(self, scales: Scales) -> Array:
        """Return the (N, N) covariance of noise and discrepancy."""
        shared = (self.basis * self.prior_of_amplitudes(scales)) @ self.basis.T
        return np.diag(self.noise(scales)) + shared

    def white(self, y: Array) -> list[Array]:
        return [y[self.trial == i] for i in range(3)]


P, K = 5, 3


def made(rng: Rng) -> Made:
    """Each trial has a parameter of its own (0, 1, 2), two are shared (3, 4); then come candidates."""
    commands, having = ((0, 1), (2,)), (CHANNELS, CHANNELS[:1], CHANNELS)
    kind = np.array([MOTION, MOTION, MOTION, REST, FORMULA])
    trial = np.repeat(range(3), [BINS * len(own) for own in having])
    y, channel = 3 * rng.normal(size=trial.size), np.repeat([c for own in having for c in own], BINS)
    columns, bases, parts, size = np.zeros((y.size, P + K)), [], [], P + K + 1
    for own in commands:
        at = np.array([*own, 3, 4, *range(P, P + K), size - 1])
        channels = []
        for c in CHANNELS:
            plain, bases = rng.normal(size=(BINS, kind.size)), [*bases, np.zeros((y.size, kind.size))]
            gram, basis = np.zeros((at.size, at.size)), np.zeros((kind.size, kind.size))
            across, rows = np.zeros((kind.size, at.size)), []
            for i in (i for i in own if c in having[i]):
                place = np.flatnonzero(np.isin(at, [i, 3, 4, *range(P, P + K)]))
                whitening = np.tril(rng.normal(size=(BINS, BINS))) + 2 * np.eye(BINS)
                A, B = rng.normal(size=(BINS, place.size)), whitening @ plain
                here = np.flatnonzero((trial == i) & (channel == c))
                columns[np.ix_(here, at[place])], bases[-1][here] = A, B
                full, k = np.column_stack([A, y[here]]), np.append(place, at.size - 1)
                gram[np.ix_(k, k)] += full.T @ full
                basis += B.T @ B
                across[:, k] += B.T @ full
                begin = BINS * having[i].index(c)
                rows.append(Rows(i, slice(begin, begin + BINS), place, A, B))
            channels.append(ChannelPart(c, kind, tuple(rows), gram, basis, across))
        parts.append(CommandPart(at, tuple(channels)))
    names = [c for _ in commands for c in CHANNELS for _ in kind]
    normal, kinds = NormalEquations(tuple(parts), size, P), np.tile(kind, len(bases))
    return Made(normal, channel.tolist(), trial, columns, np.hstack(bases), names, kinds, y)


def scales_of(rng: Rng) -> Scales:
    return Scales(
        discrepancy=float(rng.uniform(0.05, 0.5)),
        formula=float(rng.uniform(0.05, 0.5)),
        discrepancies={"accel_x": float(rng.uniform(0.05, 0.5))},
        formulas={"current_f": float(rng.uniform(0.05, 0.5))},
        noise_factor={"current_f": float(rng.uniform(1.0, 3.0))},
    )


def dense_evidence(y: Array, C: Array, noise: Array) -> float:
    """Return the log density of y under N(0, C), over that of the noise up to its quadratic form."""
    _, logdet = np.linalg.slogdet(C)
    return float(-0.5 * (y @ np.linalg.solve(C, y) + logdet - np.log(noise).sum()))


@pytest.fixture(params=range(10))
def rng(request: pytest.FixtureRequest) -> Rng:
    return np.random.default_rng(request.param)


@pytest.fixture
def m(rng: Rng) -> Made:
    return made(rng)


@pytest.fixture
def scales(rng: Rng, m: Made) -> Scales:
    """Scales drawn after the trials."""
    return scales_of(rng)


def test_the_discrepancy_is_integrated_out_as_by_the_whole_covariance(m: Made, scales: Scales) -> None:
    C, full = m.covariance(scales), np.column_stack([m.columns, m.y])
    M, logdet = m.normal.marginal(scales)
    assert pytest.approx(full.T @ np.linalg.solve(C, full), rel=1e-8, abs=1e-8) == M
    assert logdet == pytest.approx(np.linalg.slogdet(C)[1] - np.log(m.noise(scales)).sum(), rel=1e-9)


def test_posterior_and_evidence_are_those_of_the_dense_gaussian(m: Made, scales: Scales, rng: Rng) -> None:
    std, pull = rng.uniform(0.2, 3, P), rng.normal(size=P)
    post = posterior(*m.normal.marginal(scales), std**-2.0, pull)
    J, C = m.columns[:, :P], m.covariance(scales)
    everything = C + (J * std**2) @ J.T
    away = m.y - J @ pull  # what is left of the residual where the priors have their means
    solved = np.linalg.solve(everything, away)
    assert post.step == pytest.approx(pull + std**2 * (J.T @ solved), rel=1e-6, abs=1e-8)
    by_prior = np.diag(std**2) - (std[:, None] ** 2 * J.T) @ np.linalg.solve(everything, J * std**2)
    assert post.covariance == pytest.approx(by_prior, rel=1e-5, abs=1e-8)
    assert post.evidence == pytest.approx(dense_evidence(away, everything, m.noise(scales)), rel=1e-7)
    assert post.misfit == pytest.approx(away @ solved, rel=1e-7)


def test_the_gain_of_candidates_is_the_difference_of_two_evidences(m: Made, scales: Scales, rng: Rng) -> None:
    std, pull = rng.uniform(0.2, 3, P), rng.normal(size=P)
    post = posterior(*m.normal.marginal(scales), std**-2.0, pull)
    places, width = [0, 2], rng.uniform(0.2, 3, 2)
    value, mean = gain(post.rest, places, width**2)
    J, X = m.columns[:, :P], m.columns[:, [P + k for k in places]]
    alone = m.covariance(scales) + (J * std**2) @ J.T
    more, away, noise = alone + (X * width**2) @ X.T, m.y - J @ pull, m.noise(scales)
    wanted = dense_evidence(away, more, noise) - dense_evidence(away, alone, noise)
    assert value == pytest.approx(wanted, rel=1e-6, abs=1e-7)
    assert mean == pytest.approx(width**2 * (X.T @ np.linalg.solve(more, away)), rel=1e-6, abs=1e-8)


def test_amplitudes_of_the_discrepancy_are_those_of_a_regression(m: Made, scales: Scales, rng: Rng) -> None:
    step = np.concatenate([rng.normal(size=P + K), [1.0]])
    left = np.column_stack([m.columns, m.y]) @ step
    Λ, C = m.prior_of_amplitudes(scales), m.covariance(scales)
    mean = Λ * (m.basis.T @ np.linalg.solve(C, left))
    variance = Λ - Λ**2 * np.einsum("nm,nm->m", m.basis, np.linalg.solve(C, m.basis))
    found = [c.amplitudes(step[p.place_in(step.size)], scales) for p in m.normal.parts for c in p.channels]
    assert np.concatenate([f[0] for f in found]) == pytest.approx(mean, rel=1e-7, abs=1e-9)
    assert np.concatenate([f[1] for f in found]) == pytest.approx(variance, rel=1e-7, abs=1e-9)


def test_misfits_of_other_residuals_are_mahalanobis_distances(m: Made, scales: Scales, rng: Rng) -> None:
    other = rng.normal(size=m.y.size) * 2
    C = m.covariance(scales)
    found = m.normal.misfits(m.white(other), scales)
    for c in CHANNELS:
        own = np.array(m.channel) == c
        wanted = other[own] @ np.linalg.solve(C[np.ix_(own, own)], other[own])
        assert found[c] == pytest.approx(wanted, rel=1e-8)


def test_other_residuals_give_the_same_as_all_built_anew(m: Made, scales: Scales, rng: Rng) -> None:
    m.normal.marginal(scales)  # what is remembered must not survive
    other = rng.normal(size=m.y.size)
    M, _ = m.normal.at(m.white(other)).marginal(scales)
    full = np.column_stack([m.columns, other])
    assert pytest.approx(full.T @ np.linalg.solve(m.covariance(scales), full), rel=1e-8, abs=1e-8) == M


def test_parts_that_are_left_out_have_no_say(m: Made, scales: Scales) -> None:
    first, second = (m.normal.marginal(scales, [k])[0] for k in (0, 1))
    assert not first[2].any()  # the third trial's own number
    assert first + second == pytest.approx(m.normal.marginal(scales)[0])


pytestmark = pytest.mark.usefixtures("one_blas_thread")
TOLERANCE = 0.02
FOUR = (0, 0, 1, 1)


def linear(problem: Problem, rng: np.random.Generator, share: float) -> Fit:
    """Return the fit, linear about the files' values, of trials drawn from the model of the measurement.

    Numbers are drawn from their priors, the discrepancy with a share in motion and as it is near rest.
    """
    point = problem.neutral()
    derivatives = differentiate(problem, point)
    std, _ = problem.prior(point, FIRST)
    θ = std * rng.normal(size=std.size)
    first = np.cumsum([0, *(x.size for x in point.trials)])
    shown = predicted(problem, point)
    for command, own in enumerate(problem.commands):
        smooth = {}
        for c, (basis,) in problem._plain[command].items():
            root = np.sqrt(variances(basis.kind, share, 0.0))
            smooth[c] = basis.columns @ (root * rng.normal(size=root.size))
        for i in own:
            J = problem.columns(i, point, derivatives)
            x = np.concatenate([θ[first[i] : first[i + 1]], θ[first[-1] :]])
            t = problem.trials[i]
            change = (J @ x).reshape(t.measured.shape)
            for k, c in enumerate(t.channels):
                noise = rng.normal(size=t.observation.bins) / problem.whiteners[i][k].filters[0].inverse
                t.measured[k] = shown[i][k] + change[k] + smooth[c] + noise
    return fit(problem, point, FIRST, derivatives=derivatives, goal=AT_START)


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
        J[rows, places] = problem.columns(i, point, found.derivatives)
        y[rows] = found.residuals[i].ravel()
        noise[rows] = np.concatenate([1 / w.filters[0].inverse for w in problem.whiteners[i]]) ** 2
        assert t.channels == problem.trials[0].channels
    Σ = np.diag(noise) + (J * std**2) @ J.T
    bins = {}
    for command, own in enumerate(problem.commands):
        for c, (basis,) in problem._plain[command].items():
            B = np.zeros((begin[-1], basis.kind.size))
            for i in own:
                at = problem.rows[i][c]
                B[begin[i] + at.start : begin[i] + at.stop] = basis.columns
            Λ = variances(basis.kind, scales.discrepancy_of(c), scales.formula_of(c))
            Σ += (B * Λ) @ B.T
            bins[command, c] = (B, Λ, basis)
    solved = np.linalg.solve(Σ, y)
    for d in discrepancies(problem, found):
        B, Λ, basis = bins[d.command, d.channel]
        own = basis.kind == MOTION
        moving = problem.rms_of(d.command, d.channel)[1] > 0
        wanted = basis.columns[:, own] @ (Λ * (B.T @ solved))[own] * moving
        assert d.value == pytest.approx(wanted, rel=1e-5, abs=1e-6 * d.size)


def test_a_channel_that_never_moves_has_no_share() -> None:
    problem = problem_of(FOUR)
    found = discrepancies(problem, linear(problem, np.random.default_rng(1), 0.0))[0]
    assert replace(found, std=np.zeros_like(found.std)).share == 0.0


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_repetitions_scatter_by_what_changes_slowly_from_trial_to_trial(share: float) -> None:
    """A wave of 2 Hz and random phase in the pitch rate, as a robot on uneven ground shows it."""
    problem, *_ = measured(6, commands=(0, 0, 0, 1, 1, 1))
    k = problem.trials[0].channels.index("pitch_rate")
    for i, t in enumerate(problem.trials):
        size, moving = problem.rms_of(problem.command_of[i], "pitch_rate")
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


def test_a_discrepancy_beside_which_noise_is_lost_in_rounding_has_a_factor() -> None:
    columns = 1e12 * np.random.default_rng(0).normal(size=(4, 40))  # 1 + its inner products is indefinite
    part = ChannelPart("", np.zeros(40, int), (), np.eye(1), columns.T @ columns, np.zeros((40, 1)))
    assert np.isfinite(part.factor(Scales(1.0, 1.0))[1]).all()


@pytest.mark.parametrize("counts", [512, 1024, 4096])
def test_the_rounding_of_the_encoders_is_within_the_tolerance(counts: int) -> None:
    """Sawtooth of a wheel that turns evenly: its rms is the step over √12, the same in all repetitions."""
    problem, step = problem_of((0, 0)), 2 * np.pi / counts
    plain = problem.rms_of(0, "wheel")[0]
    for t in problem.trials:
        t.observation = replace(t.observation, step=step)
    point = problem.neutral()
    problem.set_noise(problem.whiteners, point, differentiate(problem, point))
    angle = np.linspace(0, 20, 100_001)
    rounding = np.floor(angle / step) * step - angle
    coarse = problem.rms_of(0, "wheel")[0]
    assert coarse == pytest.approx(max(plain, np.std(rounding) / TOLERANCE), rel=0.02)
    assert problem.rms_of(0, "wheel_split")[0] == coarse


def test_repetitions_of_which_each_drives_its_own_simulation_are_weighed_as_such() -> None:
    """Two inputs that are the same and one command: nothing may depend on who simulates a trial."""
    together, _, _ = measured(7, commands=(0, 0, 1))
    scenario = replace(together.pool.scenario, variants=(*together.pool.scenario.variants, COMMANDS[0]))
    models = [TrialModel(t.observation, t.variant, ROBOT) for t in together.trials]
    models[1] = TrialModel(together.trials[1].observation, len(COMMANDS), ROBOT, 0)
    for model, trial in zip(models, together.trials, strict=True):
        model.measured = trial.measured
    apart = Problem(models, SimulationPool(scenario, respond=Respond()))
    assert apart.commands == together.commands == ((0, 1), (2,))
    assert apart.inputs == ((0,), (2,), (1,))
    found = []
    for problem in (together, apart):
        point = problem.neutral()
        derivatives, runs = (
            differentiate(problem, point),
            problem.respond([problem.task(point, i) for i in range(3)]),
        )
        assert derivatives is not None
        assert runs is not None
        problem.set_noise(nominal(problem), point, derivatives)
        normal = problem.normal(point, derivatives, problem.residuals(point, runs))
        found.append(normal.marginal(FIRST))
    for own, shared in zip(found[1], found[0], strict=True):
        assert own == pytest.approx(shared, rel=1e-9)
