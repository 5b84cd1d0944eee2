"""Whatever the normal equations say, the dense covariance of all measurements says too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from granite_lab.discovery.candidates import gain
from granite_lab.inference.constants import REST_SHARE
from granite_lab.inference.discrepancy import FORMULA, MOTION, REST
from granite_lab.inference.normal import ChannelPart, CommandPart, Normal, Rows, Scales, posterior
from granite_lab.logs.trial import Array

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

    normal: Normal
    channel: list[str]
    trial: Array
    columns: Array
    basis: Array
    own: list[str]
    kind: Array
    y: Array

    def prior_of_amplitudes(self, scales: Scales) -> Array:
        root = [
            {MOTION: scales.share_of(c), REST: REST_SHARE, FORMULA: scales.formula}[k]
            for c, k in zip(self.own, self.kind.tolist(), strict=True)
        ]
        return np.square(root)

    def noise(self, scales: Scales) -> Array:
        return np.array([scales.louder.get(c, 1.0) ** 2 for c in self.channel])

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
            channels.append(ChannelPart(c, plain, kind, tuple(rows), gram, basis, across))
        parts.append(CommandPart(at, tuple(channels)))
    names = [c for _ in commands for c in CHANNELS for _ in kind]
    normal, kinds = Normal(tuple(parts), size, P), np.tile(kind, len(bases))
    return Made(normal, channel.tolist(), trial, columns, np.hstack(bases), names, kinds, y)


def scales_of(rng: Rng) -> Scales:
    return Scales(
        share=float(rng.uniform(0.05, 0.5)),
        formula=float(rng.uniform(0.05, 0.5)),
        shares={"accel_x": float(rng.uniform(0.05, 0.5))},
        louder={"current_f": float(rng.uniform(1.0, 3.0))},
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


def test_the_misfit_of_other_residuals_is_their_mahalanobis_distance(
    m: Made, scales: Scales, rng: Rng
) -> None:
    other = rng.normal(size=m.y.size) * 2
    C = m.covariance(scales)
    found = m.normal.misfits(m.white(other), scales)
    for c in CHANNELS:
        own = np.array(m.channel) == c
        wanted = other[own] @ np.linalg.solve(C[np.ix_(own, own)], other[own])
        assert found[c] == pytest.approx(wanted, rel=1e-8)


def test_other_residuals_in_place_of_the_old_are_the_same_as_all_built_anew(
    m: Made, scales: Scales, rng: Rng
) -> None:
    m.normal.marginal(scales)  # what is remembered must not survive
    other = rng.normal(size=m.y.size)
    M, _ = m.normal.at(m.white(other)).marginal(scales)
    full = np.column_stack([m.columns, other])
    assert pytest.approx(full.T @ np.linalg.solve(m.covariance(scales), full), rel=1e-8, abs=1e-8) == M


def test_parts_that_are_left_out_have_no_say(m: Made, scales: Scales) -> None:
    first, second = (m.normal.marginal(scales, [k])[0] for k in (0, 1))
    assert not first[2].any()  # the third trial's own number
    assert first + second == pytest.approx(m.normal.marginal(scales)[0])
