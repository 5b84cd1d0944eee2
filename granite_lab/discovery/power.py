"""What these trials could show: the smallest sizes that would be named, and what would be taken for what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import NormalDist

import numpy as np
from scipy.optimize import brentq

from granite_lab.discovery.candidates import Probe, Screen, others_of
from granite_lab.discovery.finding import Confusion, Detectable
from granite_lab.inference.constants import CREDIBLE, DRAWS, LEAST_GAIN, SAME, TINY
from granite_lab.inference.fit import Fit
from granite_lab.inference.normal import posterior
from granite_lab.inference.priors import width_of
from granite_lab.inference.problem import Problem
from granite_lab.inference.scales import learnt_priors
from granite_lab.logs.trial import Array

POWER = NormalDist().inv_cdf(0.8)
"""Standard normal number for a power of 80 %; convention."""

GROWTH = 1.2
"""Step between the amplitudes that are tried, as a factor: to that accuracy a detectable size is told;
convention."""

FACTOR = 2.0
"""Size of the candidates in the confusion table, over the smallest detectable; convention."""


def detectable(
    problem: Problem, fit: Fit, screened: Screen, tolerance: float
) -> tuple[tuple[Detectable, ...], Confusion]:
    """Return the smallest sizes that would be named, and what these trials can tell apart.

    A candidate is named where its posterior odds are beyond doubt and what the nuisances cannot take up of
    its trace exceeds the tolerance in some channel. Without it the scales of the nuisances grow with what
    they take up.

    Args:
        problem: the trials.
        fit: about which it is linear.
        screened: candidates about that fit.
        tolerance: as a share of a channel's rms.
    """
    per_trial = screened.per_trial
    gram = screened.posterior.rest[:-1, :-1]
    visible = _visible(problem, fit, screened)
    needed = LEAST_GAIN + np.log(CREDIBLE / (1 - CREDIBLE))
    limits = {
        k: (
            _by_noise(float(gram[k, k]), (width_of(p.parameter) / p.size) ** 2, needed),
            tolerance / visible[k] if visible[k] > 0 else np.inf,
        )
        for k, p in enumerate(screened.probes)
    }
    probes = _nearest(screened.probes, limits)
    for k, probe in probes:
        variance = (width_of(probe.parameter) / probe.size) ** 2
        noise, matter = limits[k]
        limits[k] = _by_growing(problem, fit, screened, k, variance, needed, noise), matter
    cosines = _cosines(gram, [k for k, _ in probes])
    rows = []
    sizes: dict[int, float] = {}
    for n, (k, probe) in enumerate(probes):
        close = tuple(
            dict.fromkeys(
                p.candidate for m, (_, p) in enumerate(probes)
                if abs(cosines[n, m]) > SAME and p.candidate != probe.candidate
            )
        )  # fmt: skip
        sizes[n] = max(limits[k])
        rows.append(_row(probe, *limits[k], close))
    for id_, group in per_trial.items():
        places = screened.places_per_trial(id_)
        power = np.diag(gram)[places]
        circles = problem.pool.scenario.effects[id_].circles
        for circle in circles or [(p.parameter.name,) for p in group]:
            at = [k for k, p in enumerate(group) if p.parameter.name in circle]
            most = _reach(group[at[0]])
            noise = max(_by_noise_per_trial(power[some], at, needed, most) for some in others_of(problem))
            worst = [max(visible[k] for k in places[:, n].tolist()) for n in at]
            share = float(np.sqrt(np.mean(np.square(worst))))
            rows.append(_row(group[at[0]], noise, tolerance / share if share > 0 else np.inf, ()))
    return tuple(rows), _confusion(gram, probes, sizes, cosines)


def _row(probe: Probe, noise: float, matter: float, close: tuple[str, ...]) -> Detectable:
    p, size = probe.parameter, max(noise, matter) * abs(probe.size)
    reachable = max(noise, matter) <= _reach(probe)
    limit = "noise" if noise >= matter else "tolerance"
    return Detectable(probe.candidate, p.name, p.unit, size if reachable else float("nan"), limit, close)


def _reach(probe: Probe) -> float:
    """Return the largest amplitude within the bounds of a strength."""
    p = probe.parameter
    return max(p.high - p.neutral, p.neutral - p.low) / abs(probe.size)


def _nearest(probes: Sequence[Probe], limits: Mapping[int, tuple[float, float]]) -> list[tuple[int, Probe]]:
    """Return of each strength the probe nearest to the size that it says is needed, with its place.

    A trace need not be proportional to the strength: the size must be probed near where it is stated.
    """
    best: dict[tuple[str, int], int] = {}
    for k, limit in limits.items():
        key = (probes[k].candidate, probes[k].place)
        if key not in best or abs(np.log(max(limit))) < abs(np.log(max(limits[best[key]]))):
            best[key] = k
    return [(k, probes[k]) for k in best.values()]


def _by_noise(power: float, variance: float, needed: float) -> float:
    """Return the amplitude whose log Bayes factor reaches what is needed with 80 % probability."""
    if power <= 0:
        return float("inf")
    occam = 0.5 * np.log1p(power * variance)
    return float((np.sqrt(2 * (needed + occam)) + POWER) / np.sqrt(power))


def _by_growing(
    problem: Problem, fit: Fit, screened: Screen, column: int, variance: float, needed: float, least: float
) -> float:
    """Return the amplitude that is seen though the scales of the nuisances grow with it.

    What each trial's own numbers follow of a candidate widens their learnt priors, which then hold them less.

    Args:
        problem: the trials.
        fit: about which it is linear.
        screened: candidates about that fit.
        column: of the candidate.
        variance: of the prior of its amplitude.
        needed: log Bayes factor.
        least: the amplitude that is seen under the present scales.
    """
    M, logdet = screened.marginal
    places = [*range(screened.posterior.step.size), screened.posterior.step.size + column, M.shape[0] - 1]
    M = M[np.ix_(places, places)]
    at = fit.point.vector
    now, scales = screened.posterior, fit.scales
    occam = 0.5 * np.log1p(now.rest[column, column] * variance)
    grown, follow = now, now.follow[:, column]
    amplitude, most = least, _reach(screened.probes[column])
    while amplitude <= most:
        mean = at + grown.step + amplitude * follow
        priors = learnt_priors(problem, fit.point, mean, np.diag(grown.covariance))
        scales = replace(scales, priors=priors)
        std, centre = problem.prior(fit.point, scales)
        grown = posterior(M, logdet, std**-2.0, centre - at)
        power, follow = float(grown.rest[0, 0]), grown.follow[:, 0]
        gain = now.evidence - grown.evidence + 0.5 * amplitude**2 * power - occam
        if gain - POWER * amplitude * np.sqrt(max(power, 0.0)) >= needed:
            return float(amplitude)
        amplitude *= GROWTH
    return float("inf")


def _by_noise_per_trial(power: Array, at: Sequence[int], needed: float, most: float) -> float:
    """Return the same for an effect with numbers of its own in each trial.

    Args:
        power: (trials, o) of each number.
        at: places of those among which the amplitude is divided by chance, as cosine and sine.
        needed: log Bayes factor.
        most: amplitude that is looked at.
    """
    share = np.zeros(power.shape[1])
    share[list(at)] = 1 / len(at)

    def beyond(amplitude: float) -> float:
        signal = power * (amplitude**2 * share)
        prior = power * (amplitude**2 * share.mean())
        taken = prior / (1 + prior)
        gain = 0.5 * float(np.sum((1 + signal) * taken - np.log1p(prior)))
        std = float(np.sqrt(np.sum(taken**2 * (0.5 + signal))))
        return gain - POWER * std - needed

    return float(brentq(beyond, 0.0, most)) if beyond(most) > 0 else float("inf")


def _cosines(gram: Array, places: Sequence[int]) -> Array:
    G = gram[np.ix_(places, places)]
    norm = np.sqrt(np.fmax(np.diag(G), TINY))
    return np.asarray(G / np.outer(norm, norm))


def _visible(problem: Problem, fit: Fit, screened: Screen) -> Array:
    """Return per column the largest rms over commands and channels of what the parameters cannot follow.

    It is given as a share of the channel's rms in motion. Parameters that follow a trace in one channel may
    add to it in another. For an effect that differs from trial to trial this is not counted: it depends on
    the noise, which is learnt from the differences between repetitions and which such an effect raises.
    """
    per_trial = np.arange(screened.posterior.follow.shape[1]) >= len(screened.probes)
    follow = screened.posterior.follow
    sizes = [x.size for x in fit.point.trials]
    local = sum(sizes)
    worst = np.zeros(follow.shape[1])
    for command, everyone in enumerate(problem.commands):
        i = everyone[0]
        begin = sum(sizes[:i])
        mine = np.concatenate([np.arange(begin, begin + sizes[i]), np.arange(local, follow.shape[0])])
        raw = screened.raw[i]
        trace = np.zeros((raw.shape[0], follow.shape[1]))
        trace[:, screened.columns_of(i)] = raw[:, mine.size :]
        left = trace - raw[:, : mine.size] @ follow[mine]
        for name, bins in problem.rows[i].items():
            size, moving = problem.rms_of(command, name)
            if size > 0:
                alone, beside = (np.mean(change[bins][moving] ** 2, axis=0) for change in (trace, left))
                counted = np.where(per_trial, np.fmin(alone, beside), beside)
                worst = np.fmax(worst, np.sqrt(counted) / size)
    return worst


def _confusion(
    gram: Array, probes: Sequence[tuple[int, Probe]], sizes: dict[int, float], cosines: Array
) -> Confusion:
    """Play the screen many times with one candidate at a time in the trials."""
    ids = tuple(dict.fromkeys(p.candidate for _, p in probes))
    place = [next(n for n, (_, p) in enumerate(probes) if p.candidate == id_) for id_ in ids]
    at = [probes[n][0] for n in place]
    G = gram[np.ix_(at, at)]
    power = np.fmax(np.diag(G), TINY)
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
        seen = gains.max(axis=0) > LEAST_GAIN
        matrix[row] = [np.mean(seen & (first == k)) for k in range(len(ids))]
        missed[row] = float(np.mean(~seen))
    return Confusion(ids, cosines[np.ix_(place, place)], matrix, missed, FACTOR, DRAWS)
