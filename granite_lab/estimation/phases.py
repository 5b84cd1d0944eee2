"""Phases of a trial from the wheels' motion, its steady part, and which variant of Table 2 it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.estimate import Estimate
from granite_lab.estimation.differentiation import MOVING
from granite_lab.estimation.motion import PhaseName
from granite_lab.estimation.rest import Interval, inside
from granite_lab.estimation.rolling import runs
from granite_lab.logs.trial import Array, Series, TrialInfo
from granite_lab.parameters import Variant

PHASES: tuple[PhaseName, ...] = ("rest", "accelerate", "steady", "brake")
UP, STEADY, DOWN = 1, 2, 3
"""Places in `PHASES`."""

BAND = 0.05
"""The wheels run steadily within this share of their plateau."""


@dataclass(frozen=True, eq=False)
class Phases:
    """What the wheels did.

    Attributes:
        name: (N,) phase of each stamp.
        steady: the part over which λ_R is taken: the second half of the constant part, when slip has
            settled [s]; NaN where there is none.
        plateau: wheel velocity there [m/s].
        onset: instant at which the wheels set off, with std [s].
        acceleration: slope of the wheels' velocity on the way up [m/s^2].
        distance: rolled distance [m].
    """

    name: tuple[PhaseName, ...]
    steady: Interval
    plateau: float
    onset: Estimate
    acceleration: float
    distance: float


def find(t: Array, speed: Array, rests: Sequence[Interval]) -> Phases:
    """Divide a trial into rest, acceleration, steady motion and braking.

    Args:
        t: (N,) stamps [s].
        speed: (N,) mean wheel velocity [m/s].
        rests: standstills [s].
    """
    period = float(np.median(np.diff(t)))
    smooth = uniform_filter1d(speed, max(round(0.05 / period), 1), mode="nearest")
    pace = np.abs(smooth)
    rest = inside(t, rests)
    name = np.zeros(t.size, dtype=int)
    longest: tuple[int, int] = (0, 0)
    onset, acceleration = Estimate(float("nan")), float("nan")
    for a, b in zip(*runs(~rest), strict=True):
        part = pace[a:b]
        if part.max() < MOVING:
            name[a:b] = UP if b == t.size else DOWN
            continue
        plateau = float(np.median(part[part > 0.6 * part.max()]))
        flat = np.abs(part - plateau) < BAND * plateau
        pieces = list(zip(*runs(_closed(flat, round(0.2 / period))), strict=True))
        first, last = max(pieces, key=lambda p: p[1] - p[0], default=(0, 0))
        slow = uniform_filter1d(np.gradient(part, t[a:b]), max(round(0.1 / period), 1))
        label = np.where(slow >= 0, UP, DOWN)
        for i, j in pieces:
            if j - i > round(0.3 / period):
                label[i:j] = STEADY
        label[:first] = np.where(label[:first] == STEADY, STEADY, UP)
        label[last:] = np.where(label[last:] == STEADY, STEADY, DOWN)
        name[a:b] = label
        if last - first > longest[1] - longest[0]:
            longest = (a + first, a + last)
            onset, acceleration = _onset(t[a : a + max(first, 1)], pace[a : a + max(first, 1)], plateau)
    i, j = longest
    if j - i < 3:
        steady, plateau = (float("nan"), float("nan")), float(pace.max())
    else:
        steady = (float(0.5 * (t[i] + t[j - 1])), float(t[j - 1]))
        plateau = float(np.median(speed[(t >= steady[0]) & (t <= steady[1])]))
    distance = float(np.trapezoid(np.where(rest, 0.0, speed), t))
    return Phases(tuple(PHASES[i] for i in name), steady, plateau, onset, acceleration, distance)


def _closed(mask: np.ndarray, longest: int) -> np.ndarray:
    """Bridge interruptions of up to `longest` samples."""
    closed = mask.copy()
    for a, b in zip(*runs(~mask), strict=True):
        if a > 0 and b < mask.size and b - a <= longest:
            closed[a:b] = True
    return closed


def _onset(t: Array, pace: Array, plateau: float) -> tuple[Estimate, float]:
    """Extend the straight part of the ramp (15 to 60 % of the plateau) back to zero velocity."""
    use = (pace > 0.15 * plateau) & (pace < 0.6 * plateau)
    if use.sum() < 4:
        return Estimate(float(t[-1]), 0.05), float("nan")
    slope, level = np.polyfit(t[use] - t[0], pace[use], 1)
    if slope <= 0:
        return Estimate(float(t[0]), 0.1), float("nan")
    period = float(np.median(np.diff(t)))
    residual = float(np.std(pace[use] - slope * (t[use] - t[0]) - level))
    # the corner of the ramp is rounded by the drive
    return Estimate(float(t[0] - level / slope), float(np.hypot(0.01, period + residual / slope))), float(
        slope
    )


def command_start(command: Series | None, offset: Estimate, onset: Estimate) -> Estimate:
    """Return the instant at which the command began: as logged, else when the wheels set off [s].

    A logged command is stamped by the encoders' clock.
    """
    if command is None or command.t.size < 3:
        return onset
    active = np.flatnonzero(np.abs(np.nan_to_num(command.value)) > 1e-6)
    if active.size == 0:
        return onset
    i = int(active[0])
    shift = offset.value if np.isfinite(offset.value) else 0.0
    extra = offset.std if np.isfinite(offset.std) else 0.0
    step = float(np.median(np.diff(command.t)))
    if i == 0:
        return Estimate(float(command.t[0]) + shift, float(np.hypot(step, extra)))
    # a ramp has already risen at its first sample; a line through the next ones leads back to zero
    begin, std = float(command.t[i]) - 0.5 * step, step / np.sqrt(12.0)
    rise = command.value[i : i + 4]
    if rise.size == 4 and np.all(np.diff(np.abs(rise)) > 0):
        slope = float(np.polyfit(command.t[i : i + 4], np.abs(rise), 1)[0])
        begin = max(float(command.t[i]) - float(np.abs(rise[0])) / slope, float(command.t[i - 1]))
    return Estimate(begin + shift, float(np.hypot(std, extra)))


def recognise(
    phases: Phases, info: TrialInfo, variants: Sequence[Variant]
) -> tuple[Variant, str, str | None]:
    """Say which variant the trial was.

    Args:
        phases: what the wheels did.
        info: metadata, which rules where it names the velocity.
        variants: what is known, as Table 2.

    Returns:
        the variant; "given", "recognised" or "measured"; a doubt or None.
    """
    speed, rolled = abs(phases.plateau), abs(phases.distance)
    accelerated = phases.acceleration if np.isfinite(phases.acceleration) else max(speed, 0.02)
    if info.v_desired is not None:
        near = next((v for v in variants if abs(v.velocity - info.v_desired) < 1e-6), None)
        given = Variant(
            velocity=info.v_desired,
            acceleration=info.a_max or (near.acceleration if near else accelerated),
            distance=info.distance or (near.distance if near and info.a_max is None else max(rolled, 0.05)),
        )
        doubt = None
        if np.isfinite(speed) and speed > MOVING and abs(speed - info.v_desired) > 0.15 * info.v_desired:
            doubt = (
                f"the wheels ran at {speed:.3g} m/s, not at the {info.v_desired:g} m/s that the metadata give"
            )
        return given, "given", doubt
    best = min(variants, key=lambda v: _distance(v, speed, rolled, accelerated), default=None)
    if best is not None and _distance(best, speed, rolled, accelerated) < 1.0:
        return best, "recognised", None
    measured = Variant(
        velocity=max(speed, 0.01), acceleration=max(accelerated, 0.01), distance=max(rolled, 0.05)
    )
    return measured, "measured", "the motion is none of the known variants: taken as measured"


def _distance(variant: Variant, speed: float, rolled: float, acceleration: float) -> float:
    """How far a motion is from a variant; 1 is the tolerance (8 % of velocity, 20 % of distance)."""
    return float(
        np.sqrt(
            ((speed / variant.velocity - 1) / 0.08) ** 2
            + ((rolled / variant.distance - 1) / 0.2) ** 2
            + (np.log(acceleration / variant.acceleration) / 1.0) ** 2 / 2
        )
    )
