"""From corrected trials to a fitted problem: one clock, bins of one width, and noise learnt on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granite_lab.errors import EstimateError, InputError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.inference.constants import (
    BIN,
    LATENCY_STD,
    NEAR_ZERO,
    REST_SHARE,
    UPDATES,
)
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.descent import ROUGH, TO_OPTIMUM
from granite_lab.inference.fit import Fit, fit
from granite_lab.inference.noise import FAST, FLOOR, NOMINAL, Whitener, at_rest, errors, identify, white
from granite_lab.inference.nuisances import TrialModel
from granite_lab.inference.observation import bin_width, observe
from granite_lab.inference.point import SHARED, Point
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array, Trial
from granite_lab.model.command import alike, duration, velocities_at
from granite_lab.parameters import Course, Robot, Variant

QUICK = 2
"""Most steps of the first fit of one trial, whose noise follows from the fast part of its residuals."""

FAR, TIMES = 1.5, 3
"""The fit of a single trial learns its noise again, up to so often, while it ends more std away from where
the noise was learnt: there residuals were not yet noise."""


LATENCIES = LATENCY_STD * np.arange(-5, 6)
"""Latencies of the IMU that are tried before the first fit [s]; the robot takes 0.1 to 0.35 s to set off."""


Clocked = tuple[list[Trial], list[Motion]]
"""Trials and motions with the same stamps."""


def clock_choices(trials: Sequence[Trial], motions: Sequence[Motion]) -> tuple[Clocked, ...]:
    """Return how the stamps of encoders and currents may stand.

    Estimation finds the offset of each trial for itself, within several milliseconds, and applies only one
    that is clearly larger than an ordinary latency. Trials of one logger share their offset: differences of
    milliseconds between them would be taken for a gap of the model. Where most trials agree with the median
    of what was applied, all follow it. Where they disagree, either the clocks were set anew in each trial, or
    a body that follows its wheels late, more so at some speeds, was taken for an offset.

    Args:
        trials: as estimation corrected them.
        motions: their estimates, in the same order.

    Returns:
        both with the offset in stamps and starts; where they disagree, as they are and with the common one.
    """
    as_stamped = list(trials), list(motions)
    if len(trials) < 2:
        return (as_stamped,)
    applied = np.array([m.clock_applied for m in motions])
    std = np.array([m.clock_offset.std for m in motions])
    common = float(np.median(applied))
    alike = np.abs(applied - common) <= 2 * np.nan_to_num(std)
    if not applied.any():
        return (as_stamped,)
    pairs = [_on_common_clock(t, m, common) for t, m in zip(trials, motions, strict=True)]
    on_common = [t for t, _ in pairs], [m for _, m in pairs]
    return (on_common,) if 2 * int(alike.sum()) > len(trials) else (as_stamped, on_common)


def _on_common_clock(trial: Trial, motion: Motion, common: float) -> tuple[Trial, Motion]:
    """Return a trial whose stamps of encoders, currents and command are moved by the common offset."""
    by = common - motion.clock_applied
    shifted = replace(trial, **trial.on_its_clock(by))
    start = Estimate(motion.t_start.value + by, motion.t_start.std)
    return shifted, replace(motion, clock_applied=common, t_start=start)


def trial_models(
    trials: Sequence[Trial], robot: Robot, motions: Sequence[Motion], *, least: float = BIN
) -> tuple[list[TrialModel], tuple[Variant, ...]]:
    """Put all trials into bins of one width.

    Args:
        trials: as estimation corrected them.
        robot: of all of them.
        motions: their estimates, which know command and start.
        least: least width of a bin [s].

    Returns:
        the trials, and the commands they are numbered by.

    Raises:
        InputError: there is no trial.
        EstimateError: a trial has no sensor to compare with, or its start is unknown.
    """
    if not trials:
        raise InputError("no trial to look at", "give at least one log")
    for motion in motions:
        if not np.isfinite(motion.t_start.value):
            raise EstimateError(
                f"trial '{motion.trial}': the start of the command cannot be found", "check its wheels"
            )
    motions = _repeated(motions)
    variants = tuple(
        sorted({m.variant for m in motions}, key=lambda v: (v.velocity, v.acceleration, v.distance))
    )
    width = max(least, *(bin_width(t, robot) for t in trials))
    commands = _commands([m.variant for m in motions], variants)
    models = []
    for trial, motion, command in zip(trials, motions, commands, strict=True):
        same = [duration(m.variant) for m, c in zip(motions, commands, strict=True) if c == command]
        start = motion.t_start.value
        seen = observe(trial, robot, motion.variant, start, width=width, lasting=max(same))
        drive = variants.index(motion.variant)
        models.append(TrialModel(seen, drive, robot, command, len(trials)))
    return models, variants


def _commands(driven: Sequence[Variant], variants: Sequence[Variant]) -> list[int]:
    """Return the number of the command of each trial: place of the first variant that it repeats.

    Wheels that turn the simulations of repetitions differ, what was commanded does not.
    """
    commanded = [k for k, v in enumerate(variants) if isinstance(v, Course) and v.wheels and v.commanded]
    first = {
        v: next((k for k in commanded if number in commanded and alike(variants[k], v)), number)
        for number, v in enumerate(variants)
    }
    return [first[v] for v in driven]


def _repeated(motions: Sequence[Motion]) -> list[Motion]:
    """Return motions whose commands are those of the first that they repeat, where no number states them."""
    repeated: list[Motion] = []
    for motion in motions:
        same = motion.variant
        if motion.variant_source in ("logged", "stated", "measured"):
            others = (m.variant for m in repeated if m.variant_source == motion.variant_source)
            same = next((v for v in others if alike(v, motion.variant)), same)
        repeated.append(replace(motion, variant=same))
    return repeated


def baseline(problem: Problem) -> Fit:
    """Fit the model as it is: with nominal noise, then with the noise that the residuals show.

    Args:
        problem: gets the noise, which is learnt twice; that of a single trial as often as needed.

    Raises:
        EstimateError: the robot cannot be simulated on the soil.
    """
    single = len(problem.trials) == 1
    start, _ = initial_point(problem)
    derivatives = differentiate(problem, start)
    if derivatives is None:
        raise EstimateError(
            "the robot cannot be simulated on this soil", "check the robot's and the soil's file"
        )
    problem.set_noise(nominal(problem), start, derivatives)
    first = replace(ROUGH, rounds=QUICK if single else UPDATES)
    fitted = fit(problem, start, goal=first, derivatives=derivatives)
    goal = TO_OPTIMUM if single else ROUGH
    for _ in range(TIMES if single else 2):
        before = fitted.point.vector
        problem.set_noise(learnt(problem, fitted.residuals), fitted.point, fitted.derivatives)
        fitted = fit(problem, fitted.point, fitted.scales, goal, fitted.derivatives)
        std = np.sqrt(np.diag(fitted.posterior.covariance))
        if single and np.all(np.abs(fitted.point.vector - before) < FAR * std):
            break
    return fitted


def initial_point(problem: Problem) -> tuple[Point, float]:
    """Return where a fit begins, and the misfit there under the nominal noise.

    It is the point of the files with the likeliest latency: from one that is off by more than a ramp of the
    motion lasts, no fit returns.
    """
    neutral = problem.neutral()
    runs = problem.respond([problem.centre(neutral, k) for k, _ in enumerate(problem.inputs)])
    if runs is None:
        return neutral, np.inf
    responses = [runs[k] for k in problem.input_of]
    weights = nominal(problem)
    best = neutral, np.inf
    for late in LATENCIES:
        shared = neutral.shared.copy()
        shared[SHARED.index("latency")] = late
        point = replace(neutral, shared=shared)
        misfit = (late / LATENCY_STD) ** 2
        for whiteners, table in zip(weights, problem.residuals(point, responses), strict=True):
            misfit += sum(float(np.sum(w(row) ** 2)) for w, row in zip(whiteners, table, strict=True))
        best = min(best, (point, misfit), key=lambda entry: entry[1])
    return best


def nominal(problem: Problem) -> list[list[Whitener]]:
    """Return the weights of `NOMINAL`."""
    return [
        [white(NOMINAL[c], np.isfinite(o.values[c]), o.width) for c in t.channels]
        for t in problem.trials
        for o in [t.observation]
    ]


def learnt(problem: Problem, residuals: Sequence[Array]) -> list[list[Whitener]]:
    """Return the weights by the noise that residuals show, one command and channel at a time."""
    whiteners = [list(w) for w in problem.whiteners]
    speeds = [_speed(problem, residuals, repetitions) for repetitions in problem.commands]
    rest: dict[tuple[str, int], list[Array]] = {}
    for repetitions, speed in zip(problem.commands, speeds, strict=True):
        for c, places in problem.places_of(repetitions).items():
            noise = errors([residuals[i][k] for i, k in places])
            rest.setdefault(_sensor(problem, places[0][0], c), []).extend(noise[:, speed == 0])
    width = problem.trials[0].observation.width
    spectra = {sensor: at_rest(rows, FLOOR[sensor[0]], width) for sensor, rows in rest.items()}
    for command, (repetitions, speed) in enumerate(zip(problem.commands, speeds, strict=True)):
        for c, places in problem.places_of(repetitions).items():
            rows = [_without_turning(problem.trials[i], residuals[i], k, speed) for i, k in places]
            shown = _predicted(problem, residuals, places)
            strength = speed
            if c.startswith("current"):  # its errors grow with the torque
                level = float(np.median(np.abs(shown[speed >= FAST])))
                strength = np.clip(np.abs(shown) / level, 0, 4) * (speed > 0) if level > 0 else speed
            sensor = spectra[_sensor(problem, places[0][0], c)]
            blows = (REST_SHARE * problem.resting(command, c)) ** 2
            floor = float(
                np.hypot(FLOOR[c], max(problem.trials[i].observation.rounding(c) for i, _ in places))
            )
            filters = identify(rows, strength, np.gradient(shown), floor, width, sensor, blows)
            for (i, k), w in zip(places, filters, strict=True):
                whiteners[i][k] = w
    return whiteners


def _without_turning(trial: TrialModel, residuals: Array, row: int, speed: Array) -> Array:
    """Return the (n,) residuals of a channel without what repeats once a turn of the wheels.

    Run-out has another phase in each trial: among the differences of repetitions it would pass for noise, and
    the effect that explains it would not show. Of noise, two numbers of a trial are lost.

    Args:
        trial: with the residuals (C, n).
        residuals: measured minus predicted.
        row: of the channel.
        speed: (n,) speed of the wheels over its largest.
    """
    values: Array = residuals[row]
    if "wheel" not in trial.channels:
        return values
    wheel = trial.channels.index("wheel")
    angle = trial.measured[wheel] - residuals[wheel]
    turning = speed[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    seen = np.isfinite(values) & np.isfinite(angle)
    size = np.linalg.lstsq(turning[seen], values[seen], rcond=None)[0]
    return np.asarray(np.where(seen, values - turning @ size, values))


def _sensor(problem: Problem, trial: int, channel: str) -> tuple[str, int]:
    """Tell sensors apart by what they show and how many samples they give a bin."""
    o = problem.trials[trial].observation
    return channel, round(o.width / float(np.median(np.diff(o.streams[channel].t))))


def _predicted(problem: Problem, residuals: Sequence[Array], places: Sequence[tuple[int, int]]) -> Array:
    """Return (n,) what the model shows of a channel, mean over trials; zero where nothing was measured."""
    rows = [np.nan_to_num(problem.trials[i].measured[k] - residuals[i][k]) for i, k in places]
    return np.asarray(sum(rows) / len(places))


def _speed(problem: Problem, residuals: Sequence[Array], repetitions: Sequence[int]) -> Array:
    """Return (n,) how fast the wheels turn over their largest rate; the command where none were logged."""
    if wheels := problem.places_of(repetitions).get("wheel"):
        rate = np.fmax(np.diff(_predicted(problem, residuals, wheels), prepend=0.0), 0.0)
        rate = np.minimum(rate, 1.2 * np.median(rate[rate > 0.5 * np.quantile(rate, 0.9)]))
    else:
        o = problem.trials[repetitions[0]].observation
        rate = velocities_at(o.t, o.variant)
    rate = rate / rate.max()
    rate[rate < NEAR_ZERO] = 0.0  # it stands
    return np.asarray(rate)
