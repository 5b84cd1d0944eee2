"""The model as it is, fitted with all nuisances, and the noise that the repetitions show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from granite_lab.discovery.adjust import ROUGH, SEARCH
from granite_lab.discovery.adjust import fit as adjust
from granite_lab.discovery.bench import SAND
from granite_lab.discovery.follow import followed, simulated
from granite_lab.discovery.noise import FAST, LEARNT, at_rest, errors, learn, white
from granite_lab.discovery.point import Fit, Point
from granite_lab.discovery.problem import Problem
from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array
from granite_lab.model.command import desired_velocity

NOMINAL = {
    "accel_x": 0.05, "accel_z": 0.07, "pitch_rate": 0.003,
    "wheel": 1e-3, "wheel_split": 3e-4, "current_f": 0.05, "current_r": 0.05,
}  # fmt: skip
"""Std of a bin with which the first fit weights the channels [unit of the channel]."""

FLOOR = {
    "accel_x": 2e-3, "accel_z": 2e-3, "pitch_rate": 1e-4,
    "wheel": 1e-4, "wheel_split": 1e-4, "current_f": 5e-3, "current_r": 5e-3,
}  # fmt: skip
"""Std below which no agreement is believed, however quiet the sensor: a wheel angle of 1e-4 rad is
10 µm on the circumference. It enters as white noise beside what the sensor shows."""

ROUNDS = (ROUGH, SEARCH)
"""Fits with the noise learnt anew before each."""

FAR = 5.0
"""chi2 per number from which on a fit is far from noise."""

MANY = 4
"""How often a fit near noise may differentiate anew."""

STILL = 1e-3
"""Share of the full speed below which a wheel counts as standing."""

WEAKER = tuple(-0.05 * k for k in range(1, 10))
"""Logarithm of φ over that of a fit, where the sand's own strength may begin to limit the shear stress."""

GIVES = 1.01
"""Rise of chi2 that shows that it does."""


def begin(problem: Problem) -> None:
    """Weight the channels by `NOMINAL`."""
    problem.whiteners = [
        [white(NOMINAL[c], np.isfinite(t.observation.values[c])) for c in t.channels] for t in problem.trials
    ]


def learn_noise(problem: Problem, residuals: Sequence[Array]) -> None:
    """Replace the weights by the noise that residuals show, one command and channel at a time."""
    whiteners = [list(w) for w in problem.whiteners]
    speeds = [(own, _speed(problem, residuals, own)) for own in by_command(problem)]
    rest = _rest(problem, residuals, speeds)
    for own, speed in speeds:
        width = problem.trials[own[0]].observation.width
        for c in channels_of(problem, own):
            having = having_channel(problem, own, c)
            place = {i: problem.trials[i].channels.index(c) for i in having}
            rows = [residuals[i][place[i]] for i in having]
            shown = _predicted(problem, residuals, c, having)
            strength = speed
            if c.startswith("current"):  # its errors grow with the torque
                level = float(np.median(np.abs(shown[speed >= FAST])))
                strength = np.clip(np.abs(shown) / level, 0, 4) * (speed > 0) if level > 0 else speed
            sensor = rest[_sensor(problem, having[0], c)]
            found = learn(rows, strength, np.gradient(shown), FLOOR[c], width, sensor)
            for i, w in zip(having, found, strict=True):
                whiteners[i][place[i]] = w
    problem.whiteners = whiteners


def _rest(
    problem: Problem, residuals: Sequence[Array], speeds: Sequence[tuple[list[int], Array]]
) -> dict[tuple[str, int], Array]:
    """Return sensor to its spectrum at standstill, from all commands."""
    noise: dict[tuple[str, int], list[Array]] = {}
    for own, speed in speeds:
        for c in channels_of(problem, own):
            having = having_channel(problem, own, c)
            rows = errors([residuals[i][problem.trials[i].channels.index(c)] for i in having])
            noise.setdefault(_sensor(problem, having[0], c), []).extend(rows[:, speed == 0])
    width = problem.trials[0].observation.width
    return {sensor: at_rest(rows, FLOOR[sensor[0]], width) for sensor, rows in noise.items()}


def _sensor(problem: Problem, trial: int, channel: str) -> tuple[str, int]:
    """Tell sensors apart by what they show and how many samples they give a bin."""
    o = problem.trials[trial].observation
    return channel, round(o.width / float(np.median(np.diff(o.streams[channel].t))))


def _predicted(problem: Problem, residuals: Sequence[Array], channel: str, having: Sequence[int]) -> Array:
    """Return (n,) what the model shows of a channel, mean over trials; zero where nothing was measured."""
    total = np.zeros(problem.trials[having[0]].observation.bins)
    for i in having:
        k = problem.trials[i].channels.index(channel)
        total += np.nan_to_num(problem.trials[i].measured[k] - residuals[i][k])
    return total / len(having)


def _speed(problem: Problem, residuals: Sequence[Array], own: Sequence[int]) -> Array:
    """Return (n,) how fast the wheels turn over their largest rate; the command where none were logged."""
    wheels = having_channel(problem, own, "wheel")
    if wheels:
        rate = np.fmax(np.diff(_predicted(problem, residuals, "wheel", wheels), prepend=0.0), 0.0)
        rate = np.minimum(rate, 1.2 * np.median(rate[rate > 0.5 * np.quantile(rate, 0.9)]))
    else:
        o = problem.trials[own[0]].observation
        rate = np.array([float(desired_velocity(t, o.variant)) for t in o.t])
    rate = rate / rate.max()
    rate[rate < STILL] = 0.0
    return np.asarray(rate)


def from_weak_sand(problem: Problem, fit: Fit) -> Fit:
    """Try the other branch of (10) under the noise as it stands; return the better fit.

    Where friction on the tyre is the smaller limit of the shear stress, the strength of the sand has no
    effect, and no derivative tells of the fit in which it has. So φ is lowered until it begins to have.
    Far from noise it is no sand that is missing.
    """
    start = _where_sand_gives(problem, fit) if fit.chi2 < FAR * problem.count else None
    if start is None:
        return fit
    try:
        other = adjust(problem, start, renew=MANY)
    except EstimateError:  # so weak that the robot digs itself in
        return fit
    return other if other.chi2 < fit.chi2 else fit


def _where_sand_gives(problem: Problem, fit: Fit) -> Point | None:
    """Return the fit's point in sand just so weak that it shows; None where it never does."""
    here = simulated(problem, fit.point)
    if here is None:
        return None
    points = []
    for change in WEAKER:
        sand = fit.point.sand.copy()
        sand[SAND.index("friction_angle")] += change
        points.append(replace(fit.point, sand=sand))
    problem.bench.run([problem.centre(p, v) for p in points for v in problem.variants])  # side by side
    for point in points:
        weak = followed(problem, here, fit.point, point, fit.slopes)
        if weak is None:
            return None
        chi2 = problem.chi2(problem.white(problem.residuals(point, weak.trials)), point)
        if chi2 > GIVES * fit.chi2:
            return point
    return None


def by_command(problem: Problem) -> list[list[int]]:
    """Return the numbers of the trials of each command."""
    return [[i for i, t in enumerate(problem.trials) if t.variant == v] for v in problem.variants]


def channels_of(problem: Problem, own: Sequence[int]) -> tuple[str, ...]:
    """Return the channels that any of the trials has."""
    return tuple(dict.fromkeys(c for i in own for c in problem.trials[i].channels))


def having_channel(problem: Problem, own: Sequence[int], channel: str) -> list[int]:
    """Return those of some trials that have a channel."""
    return [i for i in own if channel in problem.trials[i].channels]


def baseline(problem: Problem, tick: Callable[[], None] = lambda: None) -> Fit:
    """Fit the model without any effect, learning the noise on the way.

    Raises:
        EstimateError: the simulation fails.
    """
    begin(problem)
    fit = adjust(problem, problem.neutral(), rounds=12, renew=2, fine=False, tolerance=ROUGH)
    for tolerance in ROUNDS:
        tick()
        learn_noise(problem, fit.residuals)
        # corners of the sand matter where the fit is good; far from noise an effect will move it anyway
        renew = MANY if fit.chi2 < FAR * problem.count else 2
        fit = adjust(problem, fit.point, slopes=fit.slopes, rounds=14, renew=renew, tolerance=tolerance)
    return fit


def pure_error(problem: Problem, white_residuals: Sequence[Array]) -> list[Array]:
    """Return per trial (m,) what repetitions of one command do not have in common.

    Scaled for the mean that was taken; a command driven once gives its residual itself.
    """
    result = [np.asarray(w) for w in white_residuals]
    for own in by_command(problem):
        for c in channels_of(problem, own):
            having = having_channel(problem, own, c)
            if len(having) < 2:
                continue
            n = problem.trials[having[0]].observation.bins
            rows = {
                i: slice(k * n, (k + 1) * n) for i in having for k in [problem.trials[i].channels.index(c)]
            }
            mean = np.mean([white_residuals[i][rows[i]] for i in having], axis=0)
            factor = np.sqrt(len(having) / (len(having) - 1))
            for i in having:
                if result[i] is white_residuals[i]:
                    result[i] = white_residuals[i].copy()
                result[i][rows[i]] = factor * (white_residuals[i][rows[i]] - mean)
    return result


def noise_floor(problem: Problem, error: Sequence[Array]) -> list[Array]:
    """Return the pure error, scaled to what noise alone is expected to leave.

    The noise was learnt from that very error, which makes it look smaller than the next sample of it, and
    the mean over the repetitions, which took no part, larger: with κ numbers learnt per number seen,
    shares of (R − 1)/R and 1/R of the residual are off by −κ and +κ.

    Args:
        problem: for the layout.
        error: (m,) per trial from `pure_error`.
    """
    result = [np.asarray(e).copy() for e in error]
    for own in by_command(problem):
        for c in channels_of(problem, own):
            having = having_channel(problem, own, c)
            if len(having) < 2:
                continue
            for i in having:
                k = problem.trials[i].channels.index(c)
                seen = int(problem.whiteners[i][k].known.sum()) * (len(having) - 1)
                n = problem.trials[i].observation.bins
                result[i][k * n : (k + 1) * n] *= np.sqrt(1 + 2 * LEARNT / max(seen, LEARNT) / len(having))
    return result


def noise_energy(problem: Problem, white_residuals: Sequence[Array]) -> float:
    """Return the sum of squares that noise alone is expected to leave of whitened residuals."""
    return sum(float(e @ e) for e in noise_floor(problem, pure_error(problem, white_residuals)))
