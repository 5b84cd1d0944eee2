"""What these trials could show: the smallest sizes that would be named, and what would be taken for what."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from statistics import NormalDist

import numpy as np
from scipy.optimize import brentq

from granite_lab.discovery.candidates import others_of
from granite_lab.discovery.finding import Confusion, Detectable
from granite_lab.discovery.screens import Probe, Screen
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

NEEDED = LEAST_GAIN + math.log(CREDIBLE / (1 - CREDIBLE))
"""Log Bayes factor at which posterior odds are beyond doubt."""

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
    gram, visible = screened.posterior.rest[:-1, :-1], _visible(problem, fit, screened)
    by_noise = {k: _by_noise(float(gram[k, k]), _variance(p)) for k, p in enumerate(screened.probes)}
    by_tolerance = {k: tolerance / visible[k] if visible[k] > 0 else np.inf for k in by_noise}
    probes = _nearest(screened.probes, {k: max(by_noise[k], by_tolerance[k]) for k in by_noise})
    by_noise |= {k: _by_growing(problem, fit, screened, k, by_noise[k]) for k, _ in probes}
    cosines = _cosines(gram, [k for k, _ in probes])
    rows = [
        _row(probe, by_noise[k], by_tolerance[k], _look_alikes(probes, n, cosines))
        for n, (k, probe) in enumerate(probes)
    ]
    rows += [
        row
        for id_ in screened.per_trial
        for row in _rows_per_trial(problem, screened, id_, visible, tolerance)
    ]
    sizes = [max(by_noise[k], by_tolerance[k]) for k, _ in probes]
    return tuple(rows), _confusion(gram, probes, sizes, cosines)


def _look_alikes(probes: Sequence[tuple[int, Probe]], n: int, cosines: Array) -> tuple[str, ...]:
    """Return the other candidates whose signatures count as that of a probe."""
    alike = (p.candidate for m, (_, p) in enumerate(probes) if abs(cosines[n, m]) > SAME)
    return tuple(dict.fromkeys(id_ for id_ in alike if id_ != probes[n][1].candidate))


def _rows_per_trial(
    problem: Problem, screened: Screen, id_: str, visible: Array, tolerance: float
) -> Iterator[Detectable]:
    """Yield the smallest sizes of an effect with numbers of its own in each trial.

    Args:
        problem, screened, tolerance: as in `detectable`.
        id_: the effect.
        visible: (columns,) as `_visible`.
    """
    group, places = screened.per_trial[id_], screened.places_per_trial(id_)
    power = np.diag(screened.posterior.rest)[places]
    circles = problem.pool.scenario.effects[id_].circles
    for circle in circles or [(p.parameter.name,) for p in group]:
        at = [k for k, p in enumerate(group) if p.parameter.name in circle]
        if not at:  # no probe of it has a solution
            continue
        most = _largest_amplitude(group[at[0]])
        noise = max(_by_noise_per_trial(power[trials], at, NEEDED, most) for trials in others_of(problem))
        largest = [max(visible[k] for k in places[:, n].tolist()) for n in at]
        share = float(np.sqrt(np.mean(np.square(largest))))
        yield _row(group[at[0]], noise, tolerance / share if share > 0 else np.inf, ())


def _variance(probe: Probe) -> float:
    """Return the variance of the prior of a probe's amplitude."""
    return (width_of(probe.parameter) / probe.size) ** 2


def _row(probe: Probe, noise: float, tolerance: float, look_alikes: tuple[str, ...]) -> Detectable:
    """Return the smallest size of a strength, by the amplitudes that noise and tolerance ask for."""
    p, amplitude = probe.parameter, max(noise, tolerance)
    size = amplitude * abs(probe.size) if amplitude <= _largest_amplitude(probe) else float("nan")
    limit = "noise" if noise >= tolerance else "tolerance"
    return Detectable(probe.candidate, p.name, p.unit, size, limit, look_alikes)


def _largest_amplitude(probe: Probe) -> float:
    """Return the largest amplitude within the bounds of a strength."""
    p = probe.parameter
    return max(p.high - p.neutral, p.neutral - p.low) / abs(probe.size)


def _nearest(probes: Sequence[Probe], limits: Mapping[int, float]) -> list[tuple[int, Probe]]:
    """Return of each strength the probe nearest to the size that it says is needed, with its place.

    A trace need not be proportional to the strength: the size must be probed near where it is stated. Of
    several kinds of an effect it is the one that needs the largest size: which one acts is not known.
    """
    best: dict[tuple[str, int, tuple[float, ...]], int] = {}
    for k, limit in limits.items():
        key = (probes[k].candidate, probes[k].place, probes[k].about)
        if key not in best or abs(np.log(limit)) < abs(np.log(limits[best[key]])):
            best[key] = k
    hardest: dict[tuple[str, int], int] = {}
    for (candidate, place, _), k in best.items():
        other = hardest.setdefault((candidate, place), k)
        if limits[k] * abs(probes[k].size) > limits[other] * abs(probes[other].size):
            hardest[candidate, place] = k
    return [(k, probes[k]) for k in hardest.values()]


def _by_noise(power: float, variance: float) -> float:
    """Return the amplitude whose log Bayes factor reaches what is needed with 80 % probability."""
    if power <= 0:
        return float("inf")
    occam = 0.5 * np.log1p(power * variance)
    return float((np.sqrt(2 * (NEEDED + occam)) + POWER) / np.sqrt(power))


def _by_growing(problem: Problem, fit: Fit, screened: Screen, column: int, least: float) -> float:
    """Return the amplitude that is seen though the scales of the nuisances grow with it.

    What each trial's own numbers follow of a candidate widens their learnt priors, which then hold them less.

    Args:
        problem: the trials.
        fit: about which it is linear.
        screened: candidates about that fit.
        column: of the candidate.
        least: the amplitude that is seen under the present scales.
    """
    M, logdet = screened.marginal
    places = [*range(screened.posterior.step.size), screened.posterior.step.size + column, M.shape[0] - 1]
    M = M[np.ix_(places, places)]
    at = fit.point.vector
    now, scales = screened.posterior, fit.scales
    occam = 0.5 * np.log1p(now.rest[column, column] * _variance(screened.probes[column]))
    grown, follow = now, now.follow[:, column]
    amplitude, most = least, _largest_amplitude(screened.probes[column])
    while amplitude <= most:
        mean = at + grown.step + amplitude * follow
        priors = learnt_priors(problem, fit.point, mean, np.diag(grown.covariance))
        scales = replace(scales, priors=priors)
        std, centre = problem.prior(fit.point, scales)
        grown = posterior(M, logdet, std**-2.0, centre - at)
        power, follow = float(grown.rest[0, 0]), grown.follow[:, 0]
        gain = now.evidence - grown.evidence + 0.5 * amplitude**2 * power - occam
        if gain - POWER * amplitude * np.sqrt(max(power, 0.0)) >= NEEDED:
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
    for command, repetitions in enumerate(problem.commands):
        i = repetitions[0]
        begin = sum(sizes[:i])
        own = np.concatenate([np.arange(begin, begin + sizes[i]), np.arange(local, follow.shape[0])])
        raw = screened.raw[i]
        trace = np.zeros((raw.shape[0], follow.shape[1]))
        trace[:, screened.columns_of(i)] = raw[:, own.size :]
        left = trace - raw[:, : own.size] @ follow[own]
        for name, bins in problem.rows[i].items():
            size, moving = problem.rms_of(command, name)
            if size > 0:
                whole, rest = (np.mean(change[bins][moving] ** 2, axis=0) for change in (trace, left))
                counted = np.where(per_trial, np.fmin(whole, rest), rest)
                worst = np.fmax(worst, np.sqrt(counted) / size)
    return worst


def _confusion(
    gram: Array, probes: Sequence[tuple[int, Probe]], sizes: Sequence[float], cosines: Array
) -> Confusion:
    """Play the screen many times with one candidate at a time in the trials."""
    ids = tuple(dict.fromkeys(p.candidate for _, p in probes))
    place = [next(n for n, (_, p) in enumerate(probes) if p.candidate == id_) for id_ in ids]
    at = [probes[n][0] for n in place]
    G = gram[np.ix_(at, at)]
    power = np.fmax(np.diag(G), TINY)
    variance = np.array([_variance(probes[n][1]) for n in place])
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
