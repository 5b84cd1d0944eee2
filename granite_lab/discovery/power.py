"""What these trials could show: the smallest sizes that would be named, and what would be taken for what."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granite_lab.discovery.candidates import Probe, Screen
from granite_lab.discovery.finding import Confusion, Detectable
from granite_lab.discovery.search import is_empirical
from granite_lab.inference.constants import CREDIBLE, EFFECT_ODDS
from granite_lab.inference.fit import Fit
from granite_lab.inference.problem import Problem, width_of
from granite_lab.logs.trial import Array

POWER = 0.8416
"""Standard normal number for a power of 80 %."""

SAME = 0.95
"""Cosine above which two signatures count as one."""

FACTOR, DRAWS = 2.0, 200
"""Size of the candidates in the confusion table, over the smallest detectable, and sets a row."""


def detectable(
    problem: Problem, fit: Fit, screened: Screen, tolerance: float
) -> tuple[tuple[Detectable, ...], Confusion]:
    """Return the smallest sizes that would be named, and what these trials can tell apart.

    A candidate is named where its posterior odds are beyond doubt and what the nuisances cannot take up of
    its trace exceeds the tolerance in some channel.

    Args:
        problem: the trials.
        fit: about which it is linear.
        screened: candidates about that fit.
        tolerance: as a share of a channel's rms.
    """
    own = screened.own
    probes = [(k, p) for k, p in _smallest(screened.probes) if not is_empirical(p.candidate)]
    gram = screened.posterior.rest[:-1, :-1]
    cosines = _cosines(gram, [k for k, _ in probes])
    shares = _shares(problem, fit, screened)
    needed = -np.log(EFFECT_ODDS) + np.log(CREDIBLE / (1 - CREDIBLE))
    found = []
    sizes: dict[int, float] = {}
    for n, (k, probe) in enumerate(probes):
        noise = _by_noise(float(gram[k, k]), (width_of(probe.parameter) / probe.size) ** 2, needed)
        matter = tolerance / shares[k] if shares[k] > 0 else np.inf
        close = tuple(
            dict.fromkeys(
                p.candidate for m, (_, p) in enumerate(probes)
                if abs(cosines[n, m]) > SAME and p.candidate != probe.candidate
            )
        )  # fmt: skip
        sizes[n] = max(noise, matter)
        found.append(_row(probe, noise, matter, close))
    for id_, group in own.items():
        places = screened.places_of_own(id_)
        power = float(np.sum(np.diag(gram)[places[:, 0]]))
        noise = _by_noise(power, 1.0, needed + places.size / 2)
        share = max(shares[k] for k in places[:, 0].tolist())
        found.append(_row(group[0], noise, tolerance / share if share > 0 else np.inf, ()))
    return tuple(found), _confusion(gram, probes, sizes, cosines)


def _row(probe: Probe, noise: float, matter: float, close: tuple[str, ...]) -> Detectable:
    p, size = probe.parameter, max(noise, matter) * abs(probe.size)
    reachable = size <= max(p.high - p.neutral, p.neutral - p.low)
    limit = "noise" if noise >= matter else "tolerance"
    return Detectable(probe.candidate, p.name, p.unit, size if reachable else float("nan"), limit, close)


def _smallest(probes: Sequence[Probe]) -> list[tuple[int, Probe]]:
    """Return the probe of smallest size of each strength, with its place."""
    best: dict[tuple[str, int], tuple[int, Probe]] = {}
    for k, p in enumerate(probes):
        key = (p.candidate, p.place)
        if key not in best or abs(p.size) < abs(best[key][1].size):
            best[key] = (k, p)
    return list(best.values())


def _by_noise(power: float, variance: float, needed: float) -> float:
    """Return the amplitude whose log Bayes factor reaches what is needed with 80 % probability."""
    if power <= 0:
        return float("inf")
    occam = 0.5 * np.log1p(power * variance)
    return float((np.sqrt(2 * (needed + occam)) + POWER) / np.sqrt(power))


def _cosines(gram: Array, places: Sequence[int]) -> Array:
    G = gram[np.ix_(places, places)]
    norm = np.sqrt(np.fmax(np.diag(G), 1e-300))
    return np.asarray(G / np.outer(norm, norm))


def _shares(problem: Problem, fit: Fit, screened: Screen) -> Array:
    """Return per column the largest rms over commands and channels of what the parameters cannot follow.

    It is given as a share of the channel's rms in motion.
    """
    follow = screened.posterior.follow
    sizes = [x.size for x in fit.point.trials]
    local = sum(sizes)
    worst = np.zeros(follow.shape[1])
    for command, everyone in enumerate(problem.commands):
        i = everyone[0]
        begin = sum(sizes[:i])
        mine = np.concatenate([np.arange(begin, begin + sizes[i]), np.arange(local, follow.shape[0])])
        raw = screened.raw[i]
        change = np.zeros((raw.shape[0], follow.shape[1]))
        change[:, screened.columns_of(i)] = raw[:, mine.size :]
        change -= raw[:, : mine.size] @ follow[mine]
        for name, bins in problem.rows[i].items():
            size, moving = problem.size_of(command, name)
            at = moving > 0
            if size > 0:
                worst = np.fmax(worst, np.sqrt(np.mean(change[bins][at] ** 2, axis=0)) / size)
    return worst


def _confusion(
    gram: Array, probes: Sequence[tuple[int, Probe]], sizes: dict[int, float], cosines: Array
) -> Confusion:
    """Play the screen many times with one candidate at a time in the trials."""
    ids = tuple(dict.fromkeys(p.candidate for _, p in probes))
    place = [next(n for n, (_, p) in enumerate(probes) if p.candidate == id_) for id_ in ids]
    at = [probes[n][0] for n in place]
    G = gram[np.ix_(at, at)]
    power = np.fmax(np.diag(G), 1e-300)
    variance = np.array([(width_of(probes[n][1].parameter) / probes[n][1].size) ** 2 for n in place])
    values, vectors = np.linalg.eigh(G)
    root = vectors * np.sqrt(np.fmax(values, 0.0))
    rng = np.random.default_rng(0)
    matrix, missed = np.full((len(ids), len(ids)), np.nan), np.full(len(ids), np.nan)
    for row, n in enumerate(place):
        if not np.isfinite(sizes[n]):
            continue
        b = FACTOR * sizes[n] * G[row][:, None] + root @ rng.standard_normal((len(ids), DRAWS))
        gains = 0.5 * b**2 / (power + 1 / variance)[:, None] - 0.5 * np.log1p(power * variance)[:, None]
        first = gains.argmax(axis=0)
        seen = gains.max(axis=0) > -np.log(EFFECT_ODDS)
        matrix[row] = [np.mean(seen & (first == k)) for k in range(len(ids))]
        missed[row] = float(np.mean(~seen))
    return Confusion(ids, cosines[np.ix_(place, place)], matrix, missed, FACTOR, DRAWS)
