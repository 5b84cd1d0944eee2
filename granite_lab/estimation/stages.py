"""The stages of the estimation: roll, stand, clock, slip and noise, smooth. Each turns a record into one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation.clock import Clock, agreed, find_offset, ramps, slow_offset
from granite_lab.estimation.error_model import ANY_SLIP, FAR_FROM_REST, LOST_PITCH, SlipModel
from granite_lab.estimation.noise import identify, muted_share, with_motion_noise
from granite_lab.estimation.problem import Problem, Sensors
from granite_lab.estimation.reference import LOST, readings_of
from granite_lab.estimation.rest import coasts, find_rests, refuse_moved, travel_of
from granite_lab.estimation.slip import identify_scatter, with_jumps
from granite_lab.estimation.smoother import Solution, settle, smooth, with_gyro_scale, with_steady_slip
from granite_lab.estimation.wheels import Rolling, rolling_of
from granite_lab.logs.sensors import mounting
from granite_lab.logs.sensors.counts import other_counts
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.faults import find_faults, find_restarts, without_steps
from granite_lab.logs.sensors.imu import despike, mounted
from granite_lab.logs.sensors.signs import check_signs
from granite_lab.logs.sensors.standstill import LONGEST_GAP, MOVING, Interval, inside, unbridged
from granite_lab.logs.sensors.two_clocks import GIVEN
from granite_lab.logs.trial import ImuStream, Trial, WheelStream, part
from granite_lab.parameters import Robot, Soil

SPIN = 0.2
"""Random walk of the slip ratio where wheels turned in a standstill that was named: it reached 100 % once, in
a trial of half a minute [1/sqrt(s)]."""

UNMATCHED = Doubt(
    "the ramps of the wheels are not found in the IMU: their clocks may be apart by any time", grade="poor"
)

SWALLOWED = 0.05
"""A dead band that hides a larger share of the samples in motion hides how the body moves; chance makes
single readings equal that at rest."""

FEWEST = 3
"""Samples of the encoders from which on the wheels can be rolled."""

LONG = 60.0
"""Motion longer than this [s] without a standstill leans on the wheels."""


def roll(trial: Trial, robot: Robot) -> Sensors:
    """Put the sensors of a trial with an IMU right, as far as no standstill is needed, and roll its wheels.

    Raises:
        EstimateError: the IMU's axes are not those of the robot.
    """
    assert trial.imu is not None
    logged = _complete(trial.imu)
    stream, spikes = despike(logged)
    imu = mounting.to_body(stream, mounted(robot))
    wheels, rolling, doubts = roll_wheels(trial, imu, robot)
    thrown = np.linalg.norm(np.nan_to_num(logged.specific_force - stream.specific_force), axis=1)
    shared = [sensor.stamp_std for sensor in (trial.imu, trial.wheels) if sensor is not None]
    return Sensors(
        name=trial.name, stream=stream, imu=imu, wheels=wheels, rolling=rolling, robot=robot,
        faults=find_faults(stream, robot.imu_grade, spikes, thrown), stamp_std=math.hypot(*shared),
        doubts=doubts,
    )  # fmt: skip


def roll_wheels(
    trial: Trial, imu: mounting.BodyImu | None, robot: Robot
) -> tuple[WheelStream | None, Rolling | None, tuple[Doubt, ...]]:
    """Put the encoders right and roll the wheels; also what was corrected or is doubtful."""
    if trial.wheels is None or trial.wheels.t.size < FEWEST:
        return trial.wheels, None, ()
    forward = imu is not None and (robot.imu.forward != "find" or bool(trial.imu and trial.imu.robot_axes))
    try:
        wheels, turned = check_signs(trial.wheels, imu, robot, forward_given=forward)
    except EstimateError as refusal:
        raise EstimateError(f"{trial.name}: {refusal.message}", refusal.hint) from None
    scaled = other_counts(wheels, robot.encoders.counts)
    return wheels, rolling_of(wheels, robot), (*turned, *([scaled] if scaled else []))


def stand(sensors: Sensors, by_hand: Sequence[Interval] = ()) -> Problem:
    """Find the standstills, and what they show: the mounting of the IMU, its noise.

    Raises:
        EstimateError: nothing anchors the velocity, or the robot moved in a standstill given `by_hand`.
    """
    stream, imu, rolling, robot = sensors.stream, sensors.imu, sensors.rolling, sensors.robot
    refuse_moved(imu, by_hand)
    rests, unseen = find_rests(stream, rolling, robot.imu_grade, by_hand=by_hand)
    if robot.imu.forward == "find" and not stream.robot_axes and rolling is not None and rests:
        imu = _orient(stream, imu, rolling, rests)
    level = mounting.by_gravity(stream, imu, inside(imu.t, rests), robot)
    if rolling is not None and robot.imu.forward != "find":
        level = mounting.by_ramps(level, rolling.t, rolling.speed)
    if rolling is None and not rests:
        raise EstimateError(
            f"{sensors.name}: neither wheels nor a standstill: nothing anchors the velocity",
            "let the robot stand for 0.5 s at start or end, or name a standstill by hand (--rest start:end); "
            "granite-lab inspect lists columns of wheels that are not used",
        )
    sensors = replace(
        sensors, stream=level.stream, imu=level.imu, robot=level.robot,
        doubts=(*sensors.doubts, *level.doubts),
    )  # fmt: skip
    far = rolling is not None and _far_from_rest(rests, level.imu)
    noise = identify(level.imu, rolling, level.robot, rests)
    problem = Problem(**vars(sensors), rests=rests, unseen=unseen, far=far, noise=noise)
    if rolling is None:
        return problem
    return replace(problem, noise=with_motion_noise(problem, 0.0, folding=False))


def compare_clocks(problem: Problem, given: float | None = None, *, moved: bool = False) -> Clock:
    """Return the offset of the clocks: as `given` [s], or as it shows far from rest or at onsets and stops.

    They were seconds apart, and are roughly synchronized already, if they were `moved`.
    """
    if given is not None:
        offset = Estimate(given, GIVEN)
    elif problem.far and problem.rolling is not None:
        offset = slow_offset(problem.imu, problem.rolling)
    else:
        return find_offset(problem, moved=moved)
    return Clock(offset, offset, offset.value)


def add_reference(problem: Problem, trial: Trial, offset: Estimate) -> Problem:
    """Add the external reference where the trial says that it is a measurement.

    Raises:
        EstimateError: there is none, or its std is not stated.
    """
    reference = readings_of(trial, problem.rolling, offset.value)
    doubts = tuple(LOST for readings in reference if not readings.t.size)
    problem = replace(problem, reference=reference, doubts=(*problem.doubts, *doubts))
    return replace(problem, far=problem.far and not problem.anchored)


def stand_again(problem: Problem, offset: Estimate, by_hand: Sequence[Interval] = ()) -> Problem:
    """Find the standstills again now that the offset of the clocks is known, and restarts between them.

    Raises:
        EstimateError: samples are missing while the robot moves.
    """
    stream, rolling, at = problem.stream, problem.rolling, offset.value
    grade = problem.robot.imu_grade
    if rolling is not None and at != 0.0:
        rests, unseen = find_rests(stream, rolling, grade, offset=at, by_hand=by_hand)
        noise = identify(problem.imu, rolling, problem.robot, rests)
        problem = replace(problem, rests=rests, unseen=unseen, noise=noise)
        problem = replace(problem, noise=with_motion_noise(problem, at))
    problem = replace(problem, offset=at, coasts=coasts(stream, rolling, grade, at, problem.rests))
    _refuse_gaps(problem, at)
    imu, faults = problem.imu, problem.faults
    restarts = find_restarts(stream, problem.rests, faults.doubt, faults.gaps, grade)
    if restarts:
        imu = mounting.to_body(without_steps(stream, restarts), imu.rotation, levelled=imu.levelled)
    problem = replace(problem, imu=imu, faults=replace(faults, restarts=restarts), slip=SlipModel(fades=True))
    return replace(problem, doubts=(*problem.doubts, *_limits(problem, offset)))


def slip_and_noise(problem: Problem, clock: Clock, soil: Soil) -> Problem:
    """Say how the slip ratio may change, and how loud motion makes the IMU."""
    if problem.far:
        return _slip_of_soil(problem, clock.expected.value, soil)
    if problem.rolling is None:
        return problem
    if _far_from_rest(problem.rests, problem.imu):
        # a reference tells the velocity, and with it the pitch
        noise = with_motion_noise(problem, clock.expected.value, folding=False)
        return replace(problem, noise=replace(noise, gyro=LOST_PITCH))
    least = SPIN if _turned_at_rest(problem.rolling, problem.rests, clock.expected.value) else 0.0
    tells_pitch = problem.imu.has_pitch_rate and problem.imu.gravity
    if tells_pitch:
        problem = with_jumps(problem, clock.near)
    problem = replace(problem, noise=with_motion_noise(problem, clock.near))
    slip = identify_scatter(problem, clock.near) if tells_pitch else problem.slip
    return replace(problem, slip=replace(slip, walk=max(slip.walk, least)))


def smoothed(problem: Problem, clock: Clock, soil: Soil, distance: Estimate | None = None) -> Solution:
    """Filter and smooth; `distance` was measured [m]."""
    solution = smooth(settle(problem, clock.expected, near=clock.near, distance=distance))
    offset = clock.expected
    if clock.shown is not offset:
        offset = agreed(clock.shown, solution.offset, solution.problem.compliance)
    applied = 0.0 if problem.far else clock.expected.value
    solution = replace(solution, offset=offset, applied=applied)
    if problem.noise.gyro_scale > 0.0:
        solution = with_gyro_scale(solution, problem.noise.gyro_scale)
    if problem.far and soil.slip_std >= ANY_SLIP:
        solution = with_steady_slip(solution)
    return solution


def _slip_of_soil(problem: Problem, offset: float, soil: Soil) -> Problem:
    """Let slow changes of velocity follow the wheels, with the slip ratio of the soil."""
    any_slip = soil.slip_std >= ANY_SLIP
    model = replace(FAR_FROM_REST, steady=soil.slip, limit=FAR_FROM_REST.limit if any_slip else soil.slip_std)
    noise = replace(with_motion_noise(problem, offset, folding=False), gyro=LOST_PITCH)
    allowed = "0 to 100 %" if any_slip else f"± {100 * soil.slip_std:.2g} %"
    follows = "slow changes of velocity follow the wheels; steady slip is not measured there"
    where = "far from standstills" if problem.rests else "no standstill"
    doubt = Doubt(f"{follows}, the std allows for {allowed}", where)
    return replace(problem, slip=model, noise=noise, doubts=(*problem.doubts, doubt))


def _turned_at_rest(rolling: Rolling, rests: Sequence[Interval], offset: float) -> bool:
    """Whether wheels turned during a standstill."""
    resting = inside(rolling.t + offset, rests)
    turning = np.abs(np.nan_to_num(rolling.speed)) > MOVING
    return float(np.sum(resting & turning)) > 0.1 * max(float(np.sum(resting)), 1.0)


def _complete(imu: ImuStream) -> ImuStream:
    """Drop samples that lack a value in a column that is otherwise logged; they become gaps."""
    columns = np.concatenate([imu.specific_force, imu.angular_rate], axis=1)
    logged = np.isfinite(columns).mean(axis=0) > 0.01
    whole = np.isfinite(columns[:, logged]).all(axis=1)
    return imu if whole.all() else part(imu, whole)


def _orient(
    stream: ImuStream, imu: mounting.BodyImu, rolling: Rolling, still: Sequence[Interval]
) -> mounting.BodyImu:
    """Level the axes at standstill and turn x to where the wheels accelerate the robot."""
    levelled = mounting.level(stream, inside(imu.t, still), imu.rotation)
    rotation = mounting.find_forward(stream, levelled, rolling.t, rolling.speed)
    return mounting.to_body(stream, rotation, levelled=True)


def _far_from_rest(still: Sequence[Interval], imu: mounting.BodyImu) -> bool:
    """Whether the robot moves, or may have moved, for longer than integration lasts."""
    if not still:
        return True
    edges = [imu.t[0], *(t for rest in still for t in rest), imu.t[-1]]
    return bool(max(b - a for a, b in zip(edges[::2], edges[1::2], strict=True)) > LONG)


def _refuse_gaps(problem: Problem, offset: float) -> None:
    """Refuse samples that are missing for long while the robot moves faster than its wheels coast."""
    wheels = None if problem.rolling is None else travel_of(problem.rolling)
    for begin, end in unbridged(problem.faults.gaps, problem.rests, wheels, offset)[:1]:
        raise EstimateError(
            f"{problem.name}: no IMU samples from {begin:.3f} s to {end:.3f} s while the robot moved",
            f"velocity cannot be bridged over more than {LONGEST_GAP:g} s: cut the log there",
        )


def _limits(problem: Problem, offset: Estimate) -> list[Doubt]:
    """Return what limits the estimate."""
    imu, rolling = problem.imu, problem.rolling
    lines = list[str]()
    if not imu.gravity:
        lines.append(
            "gravity was removed by the logger: pitch is not observable, only its changes by the gyro"
        )
    if not imu.has_pitch_rate:
        lines.append("no pitch rate was logged: pitch is taken as constant with 1 deg of doubt in motion")
    share = muted_share(imu, problem.rests, problem.robot.imu_grade)
    muted = f"a dead band of the accelerometer hides all at rest, and {share:.0%} of the samples in motion"
    dead = [Doubt(muted, grade="poor" if share > SWALLOWED else "fair")] if share else []
    ends = [f"no standstill at the {side}: uncertainty grows towards it" for side in problem.open_ends]
    doubts = [*map(Doubt, lines), *problem.faults.doubts(), *dead, *map(Doubt, ends)]
    if rolling is None:
        alone = (
            "standstill is judged by the IMU alone, and noise that only motion makes is not told from motion"
        )
        return [Doubt(f"no encoders: no wheel velocity and no slip; {alone}", grade="fair"), *doubts]
    if not np.isfinite(offset.std):
        unseen = "clock offset between IMU and encoders unobservable: taken as zero"
        by_nothing = Doubt(unseen, grade="fair" if rolling.path_length else "good")
        doubts.append(by_nothing if problem.far or not ramps(rolling) else UNMATCHED)
    return [*rolling.doubts, *doubts]
