"""What drives the simulation of a trial: the motors, by the command, or the wheels, as they were measured."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from granite_lab.errors import EstimateError, LabError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.inference.constants import TOLERANCE
from granite_lab.logs.counters import mean_known
from granite_lab.logs.trial import Array
from granite_lab.model import simulate
from granite_lab.model.command import duration, path_of, velocities_at
from granite_lab.model.effect import Effect
from granite_lab.model.limits import FASTEST_BACKWARDS
from granite_lab.model.turning import AHEAD, turned
from granite_lab.parameters import Course, Robot, Soil, Variant, course_of, is_driven
from granite_lab.parameters.course import DriveBy

STATED = ("given", "recognised", "logged", "stated")
"""Sources of a command that is more than what the wheels show."""

FOLLOW = 0.06
"""Wheels follow a command whose rms deviation from it is below this share of the command's own rms: twice
what the paper's controller leaves over the variants of Table 2, 2 to 3 %, most of it on the ramps."""

OBEYS = TOLERANCE / 2
"""Motors turn the wheels as simulated where both differ by less than this share, rms over the command's rms:
a quarter of the variance that is accepted of any sensor. A start known to 10 ms leaves 0.3 %."""

ALIKE = 0.02
"""Half of the difference of left and right wheels over their mean that does not matter: contacts of both
sides in place of one at the mean move a_θ by 0.7 % at most (`docs/limits.md`)."""

STILL = 0.02
"""Slower wheels stand [m/s]: the model's floor of slip."""


def with_drive_input(motion: Motion, robot: Robot, by: DriveBy, soil: Soil | None = None) -> Motion:
    """Return the motion with what its simulation is driven by, and a line on it.

    Args:
        motion: the estimate.
        robot: with wheels; motors are simulated only where it has a [drive].
        by: "wheels", "command", or "auto": the command where it is stated and the wheels follow it.
        soil: on which "auto" simulates a command that is no trapezoid, to see whether the robot's drive turns
            the wheels as they turned; without it that is not asked.

    Raises:
        EstimateError: the wheels are to drive, and their speeds are not known or they turn backwards.
    """
    if by == "command" or is_driven(motion.variant):
        return motion
    reason = "as asked for" if by == "wheels" else _reason(motion, robot, soil)
    if not reason:
        return motion
    split = _split(motion)
    apart = _apart(motion, split)
    start, course = _turned(motion, robot, split if apart else None)
    desired = "the command" if course.commanded else "the mean of r ω, for nothing is commanded"
    line = f"driven by the measured wheel speeds, {reason}; v_d of (5) is {desired}"
    lines = (line, *apart)
    return replace(
        motion, variant=course, variant_source="wheels", t_start=start, warnings=(*motion.warnings, *lines)
    )


def _split(motion: Motion) -> Array:
    """Return (N, 2) half of what r ω of the right wheel is above that of the left one, front and rear [m/s].

    An axle of which a side is not known turns as the other one; zero where neither is known.
    """
    split: Array = (motion.v_wheel[:, 1::2] - motion.v_wheel[:, ::2]) / 2
    return np.nan_to_num(np.where(np.isfinite(split), split, split[:, ::-1]))


def _apart(motion: Motion, split: Array) -> tuple[str, ...]:
    """Say where left and right wheels turn at different speeds, so that each side has contacts of its own."""
    v = mean_known(motion.v_wheel)
    fast = v > 0.5 * v.max(initial=0.0, where=np.isfinite(v))
    if not fast.any():
        return ()
    share = float(np.median(split[fast].mean(axis=1) / v[fast]))
    if abs(share) <= ALIKE:
        return ()
    side = "right" if share > 0 else "left"
    line = f"the {side} wheels are {200 * abs(share):.0f} % faster than the others: "
    return (line + "each side is simulated with its own slip, on a robot that goes straight",)


def _reason(motion: Motion, robot: Robot, soil: Soil | None) -> str:
    """Return why, with "auto", the wheels drive the simulation; empty where the command does."""
    if of_robot := _unlike(robot):
        return of_robot
    if not np.isfinite(motion.v_wheel).any():
        return ""
    if not stated(motion):
        return "for no command is stated"
    if not math.isfinite(motion.t_start.value):
        return "for the start of the command is unknown"
    off = deviation(motion, motion.variant)
    if off > FOLLOW:
        return f"for they deviate from the command by {100 * off:.0f} %"
    if soil is None or not isinstance(motion.variant, Course):
        return ""
    off = mistaken(motion, robot, soil)
    return (
        f"for the drive of the robot's file would turn them {100 * off:.1g} % otherwise"
        if off > OBEYS
        else ""
    )


def _unlike(robot: Robot) -> str:
    """Return why the motors of a robot cannot be simulated; empty where they can."""
    if robot.drive is None:
        return f"for the file of '{robot.name}' has no [drive]"
    if robot.motors == "side":
        return "for a motor drives both wheels of a side"
    return "for its wheels have several radii" if robot.wheels.uneven else ""


def mistaken(motion: Motion, robot: Robot, soil: Soil) -> float:
    """Return the rms by which simulated wheels miss those of the trial over the rms of the command.

    The motors follow the command by (24)-(26). The start of the command is where they fit best within two of
    its std. Zero where the command cannot be simulated.
    """
    try:
        run = simulate(motion.variant, robot, soil)
    except LabError:
        return 0.0
    wheels = (run["v_wheel_f_mps"] + run["v_wheel_r_mps"]) / 2

    def missed(late: float) -> float:
        return _missed(motion, motion.variant, lambda t: np.asarray(np.interp(t - late, run.t, wheels)))

    off = min(map(missed, np.linspace(-2, 2, 9) * np.nan_to_num(motion.t_start.std)))
    return off if math.isfinite(off) else 0.0


def stated(motion: Motion) -> bool:
    """Say whether a command is known; a variant that was recognised is none if the wheels do not follow.

    A run by hand may have the speed, the way and the ramps of a variant of Table 2.
    """
    if motion.variant_source == "recognised" and math.isfinite(motion.t_start.value):
        return deviation(motion, motion.variant) <= FOLLOW
    return motion.variant_source in STATED


def deviation(motion: Motion, variant: Variant) -> float:
    """Return the rms by which r ω, mean of the wheels, misses the command over the rms of the command."""
    return _missed(motion, variant, lambda t: velocities_at(t, variant))


def _missed(motion: Motion, variant: Variant, wheels: Callable[[Array], Array]) -> float:
    """Return the rms by which r ω, mean of the wheels, misses that of a model over the rms of the command.

    It is infinite where the wheels are not known during the command.

    Args:
        motion: the estimate.
        variant: the command.
        wheels: of the model: times since the start of the command [s] to r ω [m/s].
    """
    t, v = motion.t - motion.t_start.value, mean_known(motion.v_wheel)
    use = (t >= 0) & (t <= duration(variant)) & np.isfinite(v)
    if use.sum() < 2:
        return math.inf
    off, wanted = v[use] - wheels(t[use]), velocities_at(t[use], variant)
    return float(np.sqrt(np.mean(off**2) / np.mean(wanted**2)))


def _turned(motion: Motion, robot: Robot, split: Array | None) -> tuple[Estimate, Course]:
    """Return when the wheels set off [s, the log's time], and their motion from then on.

    Args:
        motion, robot: as in `driven`.
        split: as `_split` returns it; None where the sides turn alike.
    """
    v, std = (
        [mean_known(axle) for axle in np.hsplit(each, 2)] for each in (motion.v_wheel, motion.v_wheel_std)
    )
    for k, other in ((0, 1), (1, 0)):  # an axle without encoders turns as the other
        if not np.isfinite(v[k]).any():
            v[k], std[k] = v[other], std[other]
    known = np.isfinite(v[0] + v[1])
    moving = np.flatnonzero(known & (np.maximum(np.abs(v[0]), np.abs(v[1])) > STILL))
    if not known.any():
        raise EstimateError(
            f"{motion.trial}: the speeds of its wheels are not known",
            "a log without encoders has --drive command",
        )
    if moving.size < 8:
        raise EstimateError(
            f"{motion.trial}: its wheels do not turn", "give a trial in which the robot drives"
        )
    t = motion.t
    first = float(t[moving[0]]) - AHEAD
    commanded = stated(motion) and math.isfinite(motion.t_start.value)
    if commanded:
        first = min(first, motion.t_start.value)
    part = known & (t >= first) & (t <= t[moving[-1]] + AHEAD)
    _refuse_reversed(motion.trial, t[part], 0.5 * (v[0][part] + v[1][part]))
    start = float(t[part][0])
    wanted = None
    if commanded:  # repetitions begin with it; wheels may turn a little before a start that is known so well
        start = min(motion.t_start.value, start + AHEAD)
        t_command, v_command = path_of(motion.variant)
        late = motion.t_start.value - start
        # a command that is not logged is seen by the wheels alone, which follow it late
        stamped = motion.variant_source == "logged"
        wanted = replace(course_of(t_command + late, v_command), stamped=stamped)
    stretch = motion.steady[0] - start, motion.steady[1] - start
    course = turned(
        t[part] - start, (v[0][part], v[1][part]), (_std(std[0][part]), _std(std[1][part])),
        robot.wheels.radius, stretch=stretch if np.isfinite(stretch[0]) else None, command=wanted,
        split=None if split is None else (split[part, 0], split[part, 1]),
    )  # fmt: skip
    return Estimate(start, float(np.nan_to_num(motion.clock_offset.std))), course


def _refuse_reversed(trial: str, t: Array, v: Array) -> None:
    """Refuse wheels whose mean velocity v (M,) [m/s] goes backwards at t [s]: the model holds ahead only."""
    back = v < -max(FASTEST_BACKWARDS, 0.05 * float(np.abs(v).max()))
    if back.any():
        raise EstimateError(
            f"{trial}: the wheels turn backwards at {t[back][0]:.1f} to {t[back][-1]:.1f} s: the model holds "
            "for forward motion",
            "take a stretch that drives ahead (--from, --to); where a robot drives back all the time, turn "
            "IMU and wheels round in the files of robot and columns",
        )


def _std(std: Array) -> Array:
    """Return std of speeds, gaps filled with the median; 1 mm/s where the log gives none."""
    stated = std[np.isfinite(std) & (std > 0)]
    return np.nan_to_num(std, nan=float(np.median(stated)) if stated.size else 1e-3)


def goes_by_command(effect: Effect) -> bool:
    """Say whether an effect changes k_92 as a function of the command, so that the command must be known."""
    return effect.by_command or type(effect).desired_velocity is not Effect.desired_velocity


def drives(effect: Effect) -> bool:
    """Say whether an effect acts on the drive or its encoders, which wheels that are turned replace."""
    kind, plain = type(effect), Effect
    hooks = ("voltages", "shaft", "reading")
    return effect.of_encoders or any(getattr(kind, hook) is not getattr(plain, hook) for hook in hooks)
