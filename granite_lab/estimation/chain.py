"""From a trial to its motion: the stages of the estimation in their order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation import stages
from granite_lab.estimation.clean import clean_trial
from granite_lab.estimation.clock_rate import doubt_rate
from granite_lab.estimation.closure import doubt_closure
from granite_lab.estimation.health import assess
from granite_lab.estimation.motion import Motion
from granite_lab.estimation.outcome import FEWEST_OF_IMU, motion_of, motion_without_imu
from granite_lab.estimation.plausibility import (
    common_gaps,
    disagreeing_wheels,
    missing_rates,
    open_end_changes,
    with_plausibility,
    with_radius,
)
from granite_lab.estimation.rest import named_rests
from granite_lab.estimation.smoother import Solution
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.sensors import mounting
from granite_lab.logs.sensors.imu import mounted
from granite_lab.logs.sensors.standstill import Interval
from granite_lab.logs.sensors.two_clocks import synchronize_roughly
from granite_lab.logs.trial import ImuStream, Trial
from granite_lab.parameters import Robot, Soil, load_soil

TAPE = 0.005
"""Std of a distance by tape, if none is stated [m]: a mark in sand is read to half a centimetre."""

OTHER_UNIT = 2.0
"""A way by tape of so many times that of the wheels is in another unit: a foot has 0.3 m, and driven wheels
roll more than half of the way."""


def correct(trial: Trial, robot: Robot, *, soil: Soil | None = None) -> tuple[Trial, Motion]:
    """Correct a trial, and estimate its body velocity, distance, pitch, wheel velocities and slip.

    Between two standstills velocity is the integral of specific force, corrected for pitch by the
    gyro; zero-velocity updates and a smoother fix what drifts. The wheels show when the robot stands
    and enter as body velocity plus a slip velocity that is free to take any value. Standstills, a measured
    distance and an external reference are used where the trial says so.

    Args:
        trial: what was logged.
        robot: its parameters.
        soil: what it drives on, whose slip ratio counts far from standstills; dry sand by default.

    Returns:
        the trial as corrected, which later stages read in place of the log (see `clean.clean_trial`); its
        motion.

    Raises:
        EstimateError: no standstill to start from, one named by hand in which the robot moved, samples
            missing in motion, or nothing to estimate.
    """
    soil, rests = load_soil() if soil is None else soil, named_rests(trial, robot)
    if not _feels_thrust(trial.imu, robot):
        wheels, rolling, turned = stages.roll_wheels(trial, None, robot)
        if rolling is None:
            raise _too_few(trial)
        rolling = replace(rolling, doubts=(*turned, *rolling.doubts))
        motion = motion_without_imu(trial, robot, rolling, rests)
        return _with_warnings(clean_trial(trial, robot, motion, wheels, rolling), motion)
    trial, moved = synchronize_roughly(trial, robot)
    solution = solve(trial, robot, rests=rests, soil=soil, moved=moved != 0.0)
    clean, motion = finish(trial, robot, solution)
    problem = solution.problem
    yaw_rate = solution.nominal.heading_rate if np.isfinite(problem.imu.yaw_rate).any() else None
    unsure = (
        *common_gaps(motion, problem.faults.gaps, problem.wheels), *missing_rates(motion, problem.wheels),
        *open_end_changes(motion, problem.open_ends),
        *disagreeing_wheels(motion, yaw_rate, robot),
    )  # fmt: skip
    limits = [doubt for doubt in (*trial.doubts, *problem.doubts) if doubt.grade != "good"]
    motion = with_radius(with_plausibility(motion, soil, (*limits, *unsure)), robot)
    offset = replace(motion.clock_offset, value=motion.clock_offset.value + moved)
    return clean, replace(motion, clock_offset=offset, clock_applied=motion.clock_applied + moved)


def solve(
    trial: Trial, robot: Robot, *, rests: Sequence[Interval] = (), soil: Soil, moved: bool = False
) -> Solution:
    """Filter and smooth a trial with an IMU; errors are those of `correct`.

    Args:
        trial, robot, soil: as in `correct`.
        rests: standstills that were named by hand [s].
        moved: the clocks were seconds apart, and `synchronize_roughly` has moved the stamps of one.
    """
    problem = stages.stand(stages.roll(trial, robot), rests)
    clock = stages.compare_clocks(problem, trial.info.clock_offset, moved=moved)
    problem = stages.add_reference(problem, trial, clock.expected)
    problem = stages.stand_again(problem, clock.expected, rests)
    if trial.info.clock_offset is None and not problem.far:
        problem = replace(problem, doubts=(*problem.doubts, *doubt_rate(problem)))
    problem = stages.slip_and_noise(problem, clock, soil)
    problem = replace(problem, doubts=(*problem.doubts, *doubt_closure(problem, clock.near)))
    return stages.smoothed(problem, clock, soil, _tape(trial, problem.rolling))


def finish(trial: Trial, robot: Robot, solution: Solution) -> tuple[Trial, Motion]:
    """Return the corrected trial and its motion, as `correct` does, from what the smoother found."""
    motion = motion_of(trial, solution, assess(solution))
    clean = clean_trial(trial, robot, motion, solution.problem.wheels, solution.problem.rolling, solution)
    return _with_warnings(clean, motion)


def _with_warnings(clean: Trial, motion: Motion) -> tuple[Trial, Motion]:
    """Return the corrected trial, and the motion whose warnings say what was put right in it."""
    return clean, replace(motion, warnings=tuple(dict.fromkeys((*motion.warnings, *clean.warnings))))


def _tape(trial: Trial, rolling: Rolling | None) -> Estimate | None:
    """Return the total distance by tape that a trial states [m].

    Raises:
        EstimateError: it is that of another unit, by what the wheels roll.
    """
    info = trial.info
    if info.distance_measured is None:
        return None
    rolled = math.inf if rolling is None or not np.isfinite(rolling.speed).any() else rolling.path_length
    if info.distance_measured > OTHER_UNIT * rolled:
        raise EstimateError(
            f"{trial.name}: the distance by tape, {info.distance_measured:g} m, is "
            f"{info.distance_measured / max(rolled, 1e-3):.3g} times the {rolled:.2f} m that the wheels roll",
            "state it in metres (distance_measured_m), or check wheel radius and counts of a turn",
        )
    return Estimate(info.distance_measured, info.distance_measured_std or TAPE)


def _too_few(trial: Trial) -> EstimateError:
    """Return the error of a trial without enough samples of an IMU or of encoders."""
    streams = {"IMU": trial.imu, "encoder": trial.wheels}
    counts = [f"{stream.t.size} {name}" for name, stream in streams.items() if stream is not None]
    if not counts:
        return EstimateError(
            f"{trial.name}: neither IMU nor encoder samples", "inspect the log and its column map"
        )
    return EstimateError(
        f"{trial.name}: only {' and '.join(counts)} samples, expected {FEWEST_OF_IMU} of an IMU's forward "
        f"acceleration or {stages.FEWEST} of encoders at least",
        "the log is too short: log the whole trial, with 2 s of standstill before and after the motion",
    )


def _feels_thrust(imu: ImuStream | None, robot: Robot) -> bool:
    """Whether an accelerometer along the robot's x axis was logged."""
    if imu is None or imu.t.size < FEWEST_OF_IMU:
        return False
    return bool(np.isfinite(mounting.to_body(imu, mounted(robot)).forward).any())
