"""From a trial to its motion: the stages of the estimation in their order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation.clean import clean_trial
from granite_lab.estimation.clock import GIVEN, agreed, find_offset, ramps, slow_offset
from granite_lab.estimation.error_model import FAR, LOST_PITCH, UNKNOWN, SlipModel
from granite_lab.estimation.faults import Faults, find_faults, find_restarts, without_steps
from granite_lab.estimation.gross_clock import together
from granite_lab.estimation.guard import Doubt, common_gaps, guard
from granite_lab.estimation.health import assess
from granite_lab.estimation.motion import Motion
from granite_lab.estimation.nodes import Problem
from granite_lab.estimation.noise import identify, with_motion_noise
from granite_lab.estimation.outcome import motion_of, motion_without_imu
from granite_lab.estimation.rest import coasts, find_rests, inside, refuse_moved, turning_of
from granite_lab.estimation.slip import identify_scatter, with_jumps
from granite_lab.estimation.smoother import Solution, settle, smooth, with_steady_slip
from granite_lab.estimation.wheels import MOVING, Rolling, check_signs, roll
from granite_lab.logs.sensors import mounting
from granite_lab.logs.sensors.imu import despike, mounted
from granite_lab.logs.sensors.standstill import Interval, coasting
from granite_lab.logs.trial import Array, ImuStream, Trial, WheelStream, part
from granite_lab.parameters import ImuGrade, Robot, Soil, Variant, load_soil, load_variants

LONGEST_GAP = 0.5
"""IMU samples missing for longer than this in motion end the estimate [s]."""

SPIN = 0.2
"""Random walk of the slip ratio where wheels turned in a standstill that was named: it reached 100 % once, in
a trial of half a minute [1/sqrt(s)]."""

ALONE = "without encoders, noise that only motion makes cannot be told from the motion"
"""Why an estimate by the IMU alone is fair at best."""

UNMATCHED = "the ramps of the wheels are not found in the IMU: their clocks may be apart by any time"
"""Why an estimate near standstills is poor where its clock offset does not show."""

LONG = 60.0
"""Motion longer than this [s] without a standstill leans on the wheels."""


def estimate(
    trial: Trial,
    robot: Robot,
    *,
    variants: Sequence[Variant] | None = None,
    rests: Sequence[Interval] = (),
    distance_measured: Estimate | None = None,
    soil: Soil | None = None,
) -> Motion:
    """Estimate the motion of one trial: the second of what `correct` returns."""
    return correct(
        trial, robot, variants=variants, rests=rests, distance_measured=distance_measured, soil=soil
    )[1]


def correct(
    trial: Trial,
    robot: Robot,
    *,
    variants: Sequence[Variant] | None = None,
    rests: Sequence[Interval] = (),
    distance_measured: Estimate | None = None,
    soil: Soil | None = None,
) -> tuple[Trial, Motion]:
    """Correct a trial, and estimate its body velocity, distance, pitch, wheel velocities and slip.

    Between two standstills velocity is the integral of specific force, corrected for pitch by the
    gyro; zero-velocity updates and a smoother fix what drifts. The wheels show when the robot stands
    and enter as body velocity plus a slip velocity that is free to take any value. The external
    reference of a trial is not used.

    Args:
        trial: what was logged.
        robot: its parameters, with an IMU grade.
        variants: motions to recognise, Table 2 by default.
        rests: standstills given by hand, in the log's time [s].
        distance_measured: measured total distance with its std [m].
        soil: what it drives on, whose slip ratio counts far from standstills; dry sand by default.

    Returns:
        the trial as corrected, which later stages read in place of the log (see `clean.clean_trial`); its
        motion.

    Raises:
        EstimateError: no standstill to start from, one named by hand in which the robot moved, samples
            missing in motion, or nothing to estimate.
    """
    known = load_variants() if variants is None else variants
    if not _feels_thrust(trial.imu, robot):
        wheels, rolling, _ = _roll(trial, None, robot)
        if rolling is None:
            raise EstimateError(
                f"{trial.name}: neither IMU nor encoder samples", "inspect the log and its column map"
            )
        motion = motion_without_imu(trial, robot, rolling, known, rests)
        return clean_trial(trial, robot, motion, wheels=wheels, rolling=rolling), motion
    trial, moved = together(trial, robot)
    apart = moved != 0.0 and trial.info.clock_offset is None
    solved = solve(trial, robot, rests=rests, distance_measured=distance_measured, soil=soil, apart=apart)
    clean, motion = finish(trial, robot, solved, known)
    gaps = common_gaps(motion, solved.problem.faults.gaps, solved.wheels)
    motion = guard(motion, load_soil() if soil is None else soil, (*solved.limits, *gaps))
    offset = replace(motion.clock_offset, value=motion.clock_offset.value + moved)
    return clean, replace(motion, clock_offset=offset, clock_applied=motion.clock_applied + moved)


@dataclass(frozen=True, eq=False)
class Solved:
    """A trial after the smoother.

    Attributes:
        problem, solution: what the filter was given, and what the smoother found.
        wheels: the encoders as corrected.
        warnings: what limits the estimate, one line each.
        limits: what keeps its grade from "good".
    """

    problem: Problem
    solution: Solution
    wheels: WheelStream | None
    warnings: tuple[str, ...]
    limits: tuple[Doubt, ...] = ()


@dataclass(frozen=True, eq=False)
class Ready:
    """The sensors of a trial put right, each on its own clock, and where the robot stands.

    Attributes:
        stream, imu: samples of the IMU without spikes, in its own axes and in those of the robot.
        wheels, rolling: the encoders as corrected and what the wheels roll; None without encoders.
        robot: its parameters, with what the standstills say of the mounting.
        grade: of the IMU.
        faults: of the IMU's samples.
        still, unseen: standstills [s], and (N,) std of the velocity that may be left where each begins [m/s].
        signs, doubts: what was corrected in the encoders, and in the mounting, one line each.
    """

    stream: ImuStream
    imu: mounting.BodyImu
    wheels: WheelStream | None
    rolling: Rolling | None
    robot: Robot
    grade: ImuGrade
    faults: Faults
    still: tuple[Interval, ...]
    unseen: Array
    signs: tuple[str, ...]
    doubts: tuple[str, ...]


def stand(trial: Trial, robot: Robot, rests: Sequence[Interval] = ()) -> Ready:
    """Put the sensors of a trial with an IMU right and find its standstills; errors as `correct`."""
    grade = robot.imu_grade
    assert grade is not None
    assert trial.imu is not None
    logged = _complete(trial.imu)
    stream, spikes = despike(logged)
    imu = mounting.to_body(stream, mounted(robot))
    wheels, rolling, signs = _roll(trial, imu, robot)
    thrown = np.linalg.norm(np.nan_to_num(logged.specific_force - stream.specific_force), axis=1)
    faults = find_faults(imu, stream, grade, spikes, thrown)
    refuse_moved(imu, rests)
    still, unseen = find_rests(stream, rolling, grade, by_hand=rests)
    if robot.imu.forward == "find" and not stream.robot_axes and rolling is not None and still:
        imu = _orient(stream, imu, rolling, still)
    level = mounting.by_gravity(stream, imu, inside(imu.t, still), robot)
    if rolling is None and not still:
        raise EstimateError(
            f"{trial.name}: neither wheels nor a standstill: nothing anchors the velocity",
            "let the robot stand for 0.5 s at start or end, or name a standstill by hand (--rest start:end)",
        )
    return Ready(
        level.stream, level.imu, wheels, rolling, level.robot, grade, faults, still, unseen, signs,
        level.doubts,
    )  # fmt: skip


def solve(
    trial: Trial,
    robot: Robot,
    *,
    rests: Sequence[Interval] = (),
    distance_measured: Estimate | None = None,
    soil: Soil | None = None,
    apart: bool = False,
) -> Solved:
    """Filter and smooth a trial with an IMU; arguments and errors are those of `correct`.

    The clocks were `apart` by seconds, and `together` has brought them together roughly.
    """
    soil = load_soil() if soil is None else soil
    any_slip = soil.slip_std >= UNKNOWN
    ready = stand(trial, robot, rests)
    stream, imu, rolling, still, faults, robot = (
        ready.stream, ready.imu, ready.rolling, ready.still, ready.faults, ready.robot,
    )  # fmt: skip
    grade, unseen = ready.grade, ready.unseen
    far = rolling is not None and _far_from_rest(still, imu)
    noise = identify(imu, rolling, robot, still)
    problem = Problem(imu, rolling, robot, still, faults, noise, SlipModel(), unseen=unseen)
    problem = replace(problem, stamp_std=_stamp_std(trial))
    if rolling is not None:
        problem = replace(problem, noise=with_motion_noise(problem, 0.0, folding=False))
    offset, found, near = _clock(trial, problem, far, apart)
    if rolling is not None and offset.value != 0.0:
        still, unseen = find_rests(stream, rolling, grade, offset=offset.value, by_hand=rests)
        problem = replace(problem, rests=still, unseen=unseen, noise=identify(imu, rolling, robot, still))
        problem = replace(problem, noise=with_motion_noise(problem, offset.value))
    problem = replace(problem, coasts=coasts(stream, rolling, grade, offset.value, still))
    _refuse_gaps(trial, problem, offset.value)
    restarts = find_restarts(stream, still, faults.doubt, faults.gaps, grade)
    faults = replace(faults, restarts=restarts)
    if restarts:
        stepless = mounting.to_body(without_steps(stream, restarts), imu.rotation, levelled=imu.levelled)
        imu = replace(stepless, scale=imu.scale, scale_std=imu.scale_std)
    problem = replace(problem, imu=imu, faults=faults, slip=SlipModel(fades=True))
    warnings = [*ready.signs, *ready.doubts, *_complain(problem, offset)]
    if far:
        slip = replace(FAR, steady=soil.slip, limit=FAR.limit if any_slip else soil.slip_std)
        noise = replace(with_motion_noise(problem, offset.value, folding=False), gyro=LOST_PITCH)
        problem = replace(problem, slip=slip, noise=noise)
        where = "far from standstills" if still else "no standstill"
        allowed = "0 to 100 %" if any_slip else f"± {100 * soil.slip_std:.2g} %"
        warnings.append(
            f"{where}: slow changes of velocity follow the wheels; steady slip is not measured there, "
            f"the std allows for {allowed}"
        )
    else:
        least = SPIN if _spun(problem, offset.value) else 0.0
        if rolling is not None:
            problem = with_jumps(problem, near) if imu.has_pitch_rate and imu.gravity else problem
            problem = replace(problem, noise=with_motion_noise(problem, near))
        slip = identify_scatter(problem, near)
        problem = replace(problem, slip=replace(slip, walk=max(slip.walk, least)))
    solution = smooth(settle(problem, offset, near=near, distance=distance_measured))
    seen = offset if found is offset else agreed(found, solution.offset, solution.compliance)
    solution = replace(solution, offset=seen, applied=0.0 if far else offset.value)
    if far and any_slip:
        solution = replace(solution, smoothed=with_steady_slip(solution.nodes, solution.smoothed))
    limits = [Doubt(line, "fair") for line in ready.doubts]
    return Solved(problem, solution, ready.wheels, tuple(warnings), (*limits, *_limits(rolling, offset, far)))


def _limits(rolling: Rolling | None, offset: Estimate, far: bool) -> tuple[Doubt, ...]:
    """Return what the estimate lacks for want of wheels, or of their clock."""
    if rolling is None:
        return (Doubt(ALONE, "fair"),)
    if not far and not np.isfinite(offset.std) and ramps(rolling):
        return (Doubt(UNMATCHED, "poor"),)
    return ()


def finish(trial: Trial, robot: Robot, solved: Solved, known: Sequence[Variant]) -> tuple[Trial, Motion]:
    """Return the corrected trial and its motion, as `correct` does, from what the smoother found."""
    problem, solution = solved.problem, solved.solution
    health = assess(solution, problem.imu.t, problem.rests, problem.faults, problem.noise)
    motion = motion_of(trial, problem, solution, health, known, solved.warnings)
    clean = clean_trial(
        trial, robot, motion, wheels=solved.wheels, rolling=problem.rolling, imu=problem.imu,
        faults=problem.faults, solution=solution,
    )  # fmt: skip
    return clean, motion


def _feels_thrust(imu: ImuStream | None, robot: Robot) -> bool:
    """Whether an accelerometer along the robot's x axis was logged."""
    if imu is None or imu.t.size < 8:
        return False
    return bool(np.isfinite(mounting.to_body(imu, mounted(robot)).forward).any())


def _roll(
    trial: Trial, imu: mounting.BodyImu | None, robot: Robot
) -> tuple[WheelStream | None, Rolling | None, tuple[str, ...]]:
    """Put the encoders right and roll the wheels; also what was corrected or is doubtful."""
    if trial.wheels is None or trial.wheels.t.size <= 2:
        return trial.wheels, None, ()
    known = imu is not None and (robot.imu.forward != "find" or bool(trial.imu and trial.imu.robot_axes))
    try:
        wheels, said = check_signs(trial.wheels, imu, robot, forward_known=known)
    except EstimateError as refusal:
        raise EstimateError(f"{trial.name}: {refusal.message}", refusal.hint) from None
    rolling = roll(wheels, robot)
    if imu is None:
        rolling = replace(rolling, warnings=(*said, *rolling.warnings))
    return wheels, rolling, said


def _clock(trial: Trial, problem: Problem, far: bool, apart: bool) -> tuple[Estimate, Estimate, float]:
    """Return the clock offset as `find_offset` does, or as it is given, or as it shows far from any rest."""
    if trial.info.clock_offset is not None:
        known = Estimate(trial.info.clock_offset, GIVEN)
    elif far and problem.rolling is not None:
        known = slow_offset(problem.imu, problem.rolling)
    else:
        return find_offset(problem, apart=apart)
    return known, known, known.value


def _stamp_std(trial: Trial) -> float:
    """Return the std of a delay between IMU and encoders that sharing of stamps leaves open [s]."""
    return math.hypot(*(one.stamp_std for one in (trial.imu, trial.wheels) if one is not None))


def _spun(problem: Problem, offset: float) -> bool:
    """Whether wheels turned during a standstill."""
    if problem.rolling is None:
        return False
    resting = inside(problem.rolling.t + offset, problem.rests)
    turning = np.abs(np.nan_to_num(problem.rolling.speed)) > MOVING
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
    acceleration = np.gradient(np.nan_to_num(rolling.speed), rolling.t)
    found = mounting.find_forward(stream, levelled, rolling.t, acceleration)
    return mounting.to_body(stream, found, levelled=True)


def _far_from_rest(still: Sequence[Interval], imu: mounting.BodyImu) -> bool:
    """Whether the robot moves, or may have moved, for longer than integration lasts."""
    if not still:
        return True
    edges = [imu.t[0], *(t for rest in still for t in rest), imu.t[-1]]
    return bool(max(b - a for a, b in zip(edges[::2], edges[1::2], strict=True)) > LONG)


def _refuse_gaps(trial: Trial, problem: Problem, offset: float) -> None:
    """Refuse samples that are missing for long while the robot moves faster than its wheels coast."""
    wheels = None if problem.rolling is None else turning_of(problem.rolling)
    for begin, end in problem.faults.gaps:
        resting = any(a - 0.02 <= begin and end <= b + 0.02 for a, b in problem.rests)
        if end - begin > LONGEST_GAP and not resting and not coasting(wheels, begin - offset, end - offset):
            raise EstimateError(
                f"{trial.name}: no IMU samples from {begin:.3f} s to {end:.3f} s while the robot moved",
                f"velocity cannot be bridged over more than {LONGEST_GAP:g} s: cut the log there",
            )


def _complain(problem: Problem, offset: Estimate) -> list[str]:
    """Say what limits the estimate, one line each."""
    imu, faults, still = problem.imu, problem.faults, problem.rests
    said = list(problem.rolling.warnings) if problem.rolling is not None else []
    if problem.rolling is None:
        said.append("no encoders: no wheel velocity and no slip; standstill is judged by the IMU alone")
    if not imu.gravity:
        said.append(
            "gravity was removed by the logger: pitch is not observable, only its changes by the gyro"
        )
    if not imu.has_pitch_rate:
        said.append("no pitch rate was logged: pitch is taken as constant with 1 deg of doubt in motion")
    if faults.gaps:
        total = sum(end - begin for begin, end in faults.gaps)
        said.append(
            f"{len(faults.gaps)} gaps in the IMU's samples, {total:.3f} s in all: uncertainty grows there"
        )
    if faults.plateaus:
        said.append(f"the IMU stands at its limit {len(faults.plateaus)} times: uncertainty grows there")
    if faults.spikes.any():
        said.append(f"{np.count_nonzero(faults.spikes)} single readings of the IMU are thrown off: replaced")
    for restart in faults.restarts:
        where = f"in the gap at {restart.begin:.2f} s" if restart.gap else f"after {restart.begin:.2f} s"
        said.append(f"the IMU's biases changed {where}, as after a restart: uncertainty grows there")
    if still:
        if still[0][0] > imu.t[0] + 1.0:
            said.append("no standstill at the start: uncertainty grows towards it")
        if still[-1][1] < imu.t[-1] - 1.0:
            said.append("no standstill at the end: uncertainty grows towards it")
    if problem.rolling is not None and not np.isfinite(offset.std):
        said.append("clock offset between IMU and encoders unobservable: taken as zero")
    return said
