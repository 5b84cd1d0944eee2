"""Waves of the ground: what the model leaves and what repeats with the position of the robot at all speeds.

Each trial meets them with another phase. What trials have in common does not show them then, and the noise
as learnt takes them in. A wave has one wavelength at every speed, a resonance of the frame one frequency, and
what turns with the wheels one order. The last differs from a wave because slip differs with the speed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from granite_lab.discovery.finding import GroundWave
from granite_lab.discovery.lines import SHOWN_BY, line_amplitude, table_of_gains, without_strongest_command
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.inference.constants import LEAST_GAIN
from granite_lab.inference.fit import Fit
from granite_lab.inference.gap import remaining
from granite_lab.inference.observation import UNITS
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array

STEPS = 4
"""Lines that are tried in the width of one, which is one period more in the longest trial; convention."""

PERIODS = 2
"""Periods of the longest line in the shortest trial: one alone is a bump; convention."""


def ground_wave(problem: Problem, fit: Fit, motions: Sequence[Motion], tolerance: float) -> GroundWave | None:
    """Return the wave of the ground that trials of two speeds or more show; None where they show none.

    It must be better than none, than any line in time, and than any whole order of the wheels, by what one
    line among so many must be worth, and no worse than any other order: a frame that rings where the lugs
    strike is no sharp line. Orders are looked at as far as waves are, for where fast wheels slip the trials
    resolve shorter waves than parts of a turn. The speed that speaks for a line most does not count.

    Args:
        problem: the trials.
        fit: of them; waves are looked for in what it leaves.
        motions: estimates of the trials; they tell where the robot was.
        tolerance: smaller waves do not matter, as a share of a channel's rms in motion.
    """
    if len(problem.commands) < 2:
        return None
    left = remaining(problem, fit)
    estimates = {m.trial: m for m in motions}
    place, turns, time = [], [], []
    for trial in problem.trials:
        o = trial.observation
        motion, at = estimates[o.name], o.t_start + o.t
        rolled = cumulative_trapezoid(motion.v_wheel.mean(axis=1), motion.t, initial=0)
        place.append(np.interp(at, motion.t, motion.x))
        turns.append(np.interp(at, motion.t, rolled) / (2 * np.pi * trial.radius))
        time.append(o.t)
    if min(np.ptp(x) for x in (*place, *turns)) <= 0:
        return None
    numbers = _numbers(place)
    way = max(float(np.ptp(x) / np.ptp(n)) for x, n in zip(place, turns, strict=True))  # of a turn [m]
    orders = _numbers(turns, most=numbers[-1] * way)
    table = table_of_gains(problem, left, place, numbers)
    whole = without_strongest_command(table)
    k, best = np.unravel_index(int(np.argmax(whole)), whole.shape)
    worth = LEAST_GAIN + math.log(whole.size)
    rivals = [(time, _numbers(time)), (turns, np.arange(1, math.floor(orders[-1]) + 1))]
    others = [without_strongest_command(table_of_gains(problem, left, x, n)).max() for x, n in rivals]
    if whole[k, best] <= max(0.0, *others) + worth:
        return None
    by_order = without_strongest_command(table_of_gains(problem, left, turns, orders)).max(axis=0)
    if whole[k, best] < by_order.max():
        return None
    channel = SHOWN_BY[int(k) if k < len(SHOWN_BY) else int(np.argmax(table[:-1, :, best].sum(axis=1)))]
    wavelength = _wavelength(numbers, whole[k], int(best))
    ways = [m.distance.std / m.distance.value for m in motions if m.distance.value > 0]
    scale = wavelength.value * float(np.median(ways or [0.0]))
    wavelength = replace(wavelength, std=math.hypot(wavelength.std, scale))
    found = _sizes(problem, left, place, wavelength.value, channel)
    if not found or max(share for _, share in found) <= tolerance:
        return None
    return GroundWave(
        wavelength=wavelength,
        channel=channel,
        unit=UNITS[channel],
        amplitude=float(np.median([size for size, _ in found])),
        share=max(share for _, share in found),
        order=float(orders[by_order.argmax()]) if by_order.max() + worth >= whole[k, best] else float("nan"),
    )


def _numbers(axis: Sequence[Array], most: float = 0.0) -> Array:
    """Return (n,) numbers of periods per unit of an axis, up to `most`, or those that all trials resolve."""
    extents = [float(np.ptp(x)) for x in axis]
    most = most or 1 / (2 * max(float(np.max(np.abs(np.diff(x)))) for x in axis))
    return np.arange(PERIODS / min(extents), most, 1 / (STEPS * max(extents)))


def _wavelength(numbers: Array, gains: Array, best: int) -> Estimate:
    """Return the wavelength [m] at the top of the gains, by the parabola through it and its neighbours."""
    at = min(max(best, 1), numbers.size - 2)
    step = float(numbers[1] - numbers[0])
    before, top, after = (float(g) for g in gains[at - 1 : at + 2])
    bend = max(2 * top - before - after, 1.0)  # less than one is no more than the step
    number = numbers[best] + step * float(np.clip((after - before) / (2 * bend), -1, 1)) * (at == best)
    return Estimate(1 / float(number), step / math.sqrt(bend) / float(number) ** 2)


def _sizes(
    problem: Problem, left: Sequence[Array], place: Sequence[Array], wavelength: float, channel: str
) -> list[tuple[float, float]]:
    """Return per trial amplitude [the channel's unit], and rms as a share of the channel's rms in motion."""
    found = []
    for command, repetitions in enumerate(problem.commands):
        for i in repetitions:
            channels = problem.trials[i].channels
            size = problem.rms_of(command, channel)[0] if channel in channels else 0.0
            if size > 0:
                row = left[i][channels.index(channel)]
                amplitude = line_amplitude(2 * np.pi * place[i] / wavelength, row)
                found.append((amplitude, amplitude / math.sqrt(2) / size))
    return [f for f in found if math.isfinite(f[0])]
