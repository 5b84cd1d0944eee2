"""`check`, `inspect`, `ingest` and `view`: whether a log is good, what it holds, the motion in it, a look."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Unpack

import numpy as np

from granite_lab import estimation, reporting
from granite_lab import logs as log_files
from granite_lab.api import calls
from granite_lab.api.calls import Arg, checked
from granite_lab.api.project import About, Chosen, Logs, choose
from granite_lab.api.records import Origin, Records
from granite_lab.errors import EstimateError, InputError, LabError, UsageError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion, mean_known
from granite_lab.estimation.rest import inside
from granite_lab.files import is_folder, refuse_special
from granite_lab.folders import replacing
from granite_lab.logs.standstill import COAST
from granite_lab.logs.trial import Array, Trial, TrialInfo, is_bag, is_log, name_of, trial_files
from granite_lab.parameters import WHEELS, Robot
from granite_lab.processes import one_thread
from granite_lab.results import WHOLE
from granite_lab.rounding import percent_of
from granite_lab.running import Options, each_trial, sifted
from granite_lab.running.options import corrected, read, soil_of
from granite_lab.shown import Shown, frame

if TYPE_CHECKING:
    import pandas as pd

    from granite_lab.logs import Inspection


REST = 0.5
"""Shortest standstill at either end that anchors the velocity [s]."""
SPEED = 0.05
"""Largest difference of the wheels' mean speed from the desired one, as a share."""
SLIP = (0.0, 0.5)
"""Slip ratios that a light robot has on level sand."""
GRAVITY = (9.3, 10.3)
"""Mean magnitude of the specific force at rest, whatever the axes [m/s^2]."""
SHARE = 0.2
"""Least travel of a wheel, as a share of the wheel that travels farthest."""


@dataclass(frozen=True, eq=False)
class Ingested(Shown):
    """The trial of a log, its robot and its motion; if asked for, the judgement by the log's reference.

    `log` is the path of the log.
    """

    trial: Trial
    robot: Robot
    motion: Motion
    judgement: Any = None
    log: Path = Path()

    def __repr__(self) -> str:
        return f"Ingested({self.motion!r})"

    @property
    def name(self) -> str:
        """The trial's name."""
        return self.trial.name

    def to_frame(self) -> pd.DataFrame:
        """Return the motion, one row an IMU stamp."""
        return self.motion.to_frame()


@checked
def ingest(
    logs: Logs = (),
    *,
    imu: calls.File = None,
    encoders: calls.File = None,
    currents: calls.File = None,
    reference: calls.File = None,
    rows: str | None = None,
    variant: Annotated[float | None, Arg(low=0.01, high=5)] = None,
    rests: Sequence[tuple[float, float]] = (),
    distance_measured: Estimate | None = None,
    against_reference: bool = False,
    strict: calls.Strict = False,
    jobs: calls.Jobs = 0,
    done: calls.Done = lambda _: None,
    **said: Unpack[About],
) -> Records[Ingested]:
    """Estimate body velocity, slip and their uncertainty from logs.

    A log that cannot be used is left out and listed with the reason.

    Args:
        logs: paths of logs, or of folders with logs.
        imu: file with the IMU, if each sensor of a trial has its own file.
        encoders: file with the encoders of that trial.
        currents: file with the motor currents of that trial.
        reference: file with an external reference of that trial, as GPS or motion capture.
        rows: rows to take from a log of several runs, as ``run_id = 4``.
        variant: desired velocity [m/s], if the log lacks it.
        rests: intervals of standstill (start, end) [s, the log's time].
        distance_measured: total distance by tape [m].
        against_reference: judge the estimate by the log's reference, which the filter does not use.

    Returns:
        one record a log; its table has a row for each IMU stamp.

    Raises:
        InputError: no log can be used.
        EstimateError: the motion cannot be had from any.
        UsageError: the arguments do not fit together.
    """
    apart = {"imu": imu, "encoders": encoders, "currents": currents, "reference": reference}
    paths: dict[str, Any] = {name: Path(path) for name, path in apart.items() if path is not None}
    if paths and not isinstance(logs, (str, Path)) and not logs:  # the IMU's file is the log
        logs = paths.pop("imu", ())
    choice = choose(
        logs, {**said, "jobs": jobs, "cache": False},
        rows=rows, rests=tuple(rests), distance_measured=distance_measured, **paths,
    )  # fmt: skip
    together, note = ({}, "") if paths or rows else _halves(choice)
    if together:
        paths, choice = together, replace(choice, files=(together["imu"],))
    if len(choice.files) > 1 and (paths or variant):
        raise UsageError("--variant and files of sensors go with one trial", "ingest the trials one by one")
    options = replace(choice.options, **paths)
    if variant:
        options = replace(options, info=TrialInfo(robot=options.robot, v_desired=variant))
    outcomes = each_trial(corrected, choice.files, options, execution=choice.execution, done=done)
    pairs = zip(choice.files, outcomes, strict=True)
    records = [_ingested(path, outcome, against_reference) for path, outcome in pairs]
    found, failed = sifted(choice.files, records, strict=strict)
    warnings = tuple(f"{item.name}: {line}" for item in found for line in item.motion.warnings)
    origin = Origin(left_out=(*choice.excluded, *failed), warnings=(*([note] if note else []), *warnings))
    return Records(found, [item.name for item in found], origin)


def _ingested(log: Path, outcome: tuple[Trial, Robot, Motion] | LabError, judge: bool) -> Ingested | LabError:
    """Return the record of a log, if asked for with its judgement; the error of one that has none."""
    if isinstance(outcome, LabError):
        return outcome
    found = Ingested(*outcome, log=log)
    try:
        return replace(found, judgement=estimation.judge(found.motion, found.trial, 0.0)) if judge else found
    except EstimateError as error:
        return error


def _halves(choice: Chosen) -> tuple[dict[str, Any], str]:
    """Return the files of a trial that was logged in two halves, and what to say of it."""
    from granite_lab.logs.halves import halves  # noqa: PLC0415, heavy

    return halves(choice.files, choice.options.column_map, dict(choice.options.topics))


@checked
def inspect(
    logs: Logs,
    *,
    column_map: calls.MapFile = None,
    topics: calls.Topics = None,
    robot: calls.RobotFile = None,
) -> Inspection:
    """Show what is recognised in logs: columns, units, clocks, rates, gaps, variant.

    A log that is not understood is reported as a `problem`, not as an error.

    Args:
        logs: paths of logs, or of folders with logs.

    Returns:
        what was recognised, file by file; its table has a row for each column.

    Raises:
        InputError: a file does not exist.
        UsageError: unknown robot or column map, or a folder holds no log.
    """
    paths = [Path(path) for path in ([logs] if isinstance(logs, (str, Path)) else logs)]
    if not paths:
        raise UsageError("no log given", "name one or more logs, or a folder of them")
    for path in paths:
        refuse_special(path)
    named = [trial_files(path) if is_folder(path) and not is_log(path) else [path] for path in paths]
    files = [file for inside in named for file in inside]
    return log_files.inspect_logs(files, map=column_map, robot=robot, topics=topics)


@checked
def view(
    what: str | Path,
    *,
    trial: str | None = None,
    web: bool = False,
    screenshot: calls.File = None,
    at: float | None = None,
    robot: calls.RobotFile = None,
    soil: calls.SoilFile = None,
    column_map: calls.MapFile = None,
    tell: Callable[[str], None] = print,
) -> None:
    """Open a recording in the Rerun viewer, which stays open.

    Args:
        what: a recording (.rrd), a report folder, or a log.
        trial: with a report folder, the trial to open.
        web: serve the viewer to a browser on this machine instead, until interrupted.
        screenshot: save a picture of the viewer (.png) instead; no display is needed.
        at: time of the `screenshot` since the start of the command [s]; by default the middle.
        tell: called with the address, with `web`.

    Raises:
        InputError: there is no such recording, or the log cannot be used.
        UsageError: `web` and `screenshot` together, `at` alone or outside of the recording.
        LabError: there is no display, viewer or graphics driver.
    """
    if web and screenshot is not None:
        raise UsageError("--web and --screenshot: one of them at a time", "run the command twice")
    if at is not None and screenshot is None:
        raise UsageError("--at is the time of a picture", "add --screenshot FILE.png")
    path = Path(what)
    refuse_special(path)
    if is_folder(path) and not is_log(path):
        path = _recording_in(path, trial)
    elif path.suffix != ".rrd":
        from granite_lab.study import analyse  # noqa: PLC0415, heavy

        said = {"robot": robot, "soil": soil, "column_map": column_map}
        found = analyse(path, choose(path, said, everything=True).options)
        place, name = Path("reports") / "view", f"{name_of(path)}.rrd"
        with replacing(place, name) as new:
            reporting.recording.record_trial(found.trial, found.comparison, new / name)
        path = place / name
    if screenshot is not None:
        reporting.recording.save_picture(path, Path(screenshot), at)
    elif web:
        reporting.recording.serve(path, tell)
    else:
        reporting.recording.open_viewer(path)


def _recording_in(folder: Path, trial: str | None) -> Path:
    """Return the recording of a trial in a report folder, or that of the whole study."""
    found = {path.stem: path for path in sorted(folder.rglob("*.rrd"), reverse=True)}
    if not found:
        hint = "make one with 'granite-lab study TRIALS --out DIR'"
        raise InputError(f"{folder}: no recording in it", hint)
    if trial is not None and trial.casefold() == WHOLE and f"{trial} (2)" in found:
        trial = f"{trial} (2)"  # the log has the name of the whole study's recording
    if trial is not None and trial not in found:
        hint = f"there are: {', '.join(sorted(found))}"
        raise InputError(f"{folder}: no recording of trial '{trial}'", hint)
    return found[trial] if trial else found.get(WHOLE, found[min(found)])


@dataclass(frozen=True)
class Check:
    """One thing that was checked, whether it passed, what was found, and what to do where it failed."""

    name: str
    good: bool
    found: str
    advice: str = ""


@dataclass(frozen=True)
class Checked:
    """What was checked in a log.

    Attributes:
        log: its path.
        virtual: a simulator wrote it.
        checks: in the order in which they were made; what a failure makes impossible is not there.
        grade: of the estimate, as `ingest` has it; empty where there is none.
        unusable: the log cannot be used, or a sensor does not work; otherwise what failed is the run.
    """

    log: Path
    virtual: bool
    checks: tuple[Check, ...]
    grade: str = ""
    unusable: bool = False

    @property
    def good(self) -> bool:
        """All checks passed."""
        return all(check.good for check in self.checks)

    @property
    def reason(self) -> str:
        """What failed; of a good run its speed, slip ratio and the grade of its estimate."""
        if not self.good:
            return "; ".join(f"{check.name}: {check.found}" for check in self.checks if not check.good)
        told = [check.found for check in self.checks if check.name in ("speed", "slip")]
        return "; ".join([*told, f"estimate {self.grade}"])

    @property
    def error(self) -> LabError | None:
        """None where all checks passed; else what the command ends with."""
        bad = [check for check in self.checks if not check.good]
        if not bad:
            return None
        kind: type[LabError] = InputError if self.unusable else EstimateError
        if len(self.checks) == 1:  # the log cannot be read
            return kind(bad[0].found, bad[0].advice)
        failed = ", ".join(dict.fromkeys(check.name for check in bad))
        return kind(f"{self.log}: failed: {failed}", bad[0].advice)

    def to_frame(self) -> pd.DataFrame:
        """Return one row a check."""
        return frame([asdict(check) for check in self.checks])


@checked
def check(log: str | Path, **said: Unpack[About]) -> Checked:
    """Check a log after a run in the field: readable, sensors, standstills, speed, slip, estimate.

    A log that cannot be used is reported as a failed check.

    Args:
        log: path of the log.

    Returns:
        the checks; the table has a row for each.

    Raises:
        UsageError: unknown robot or column map, or a folder of several logs.
    """
    choice = choose(log, said, everything=True)
    if len(choice.files) > 1:
        raise UsageError(f"{log}: {len(choice.files)} logs", "check_logs checks several")
    return _checked(choice.files[0], choice.options)


@checked
def check_logs(
    logs: Logs, *, jobs: calls.Jobs = 0, done: calls.Done = lambda _: None, **said: Unpack[About]
) -> Records[Checked]:
    """Check logs after runs in the field: readable, sensors, standstills, speed, slip, estimate.

    A log that cannot be used is reported as a failed check.

    Args:
        logs: paths of logs, or of folders with logs.

    Returns:
        one record a log, as of `check`; the table has a row for each check.

    Raises:
        UsageError: unknown robot or column map, or no log.
    """
    choice = choose(logs, {**said, "jobs": jobs, "cache": False}, everything=True)
    outcomes = each_trial(_checked, choice.files, choice.options, execution=choice.execution, done=done)
    pairs = zip(choice.files, outcomes, strict=True)
    found = [_unread(path, one) if isinstance(one, LabError) else one for path, one in pairs]
    return Records(found, [name_of(one.log) for one in found])


def _unread(path: Path, error: LabError) -> Checked:
    return Checked(path, False, (Check("log", False, error.message, error.hint),), unusable=True)


def _checked(path: Path, options: Options) -> Checked:
    """Check one log; raises nothing that is the log's fault."""
    try:
        trial, robot = read(path, options)
    except InputError as error:
        return _unread(path, error)
    checks, grade = [_log(trial, path), *_sensors(trial)], ""
    unusable = not all(check.good for check in checks)
    try:
        with one_thread():
            motion = estimation.correct(trial, robot, soil=soil_of(trial, options.soil))[1]
        checks += _motion(motion, trial)
        grade = motion.health.grade
    except EstimateError as error:
        checks.append(Check("estimate", False, error.message, error.hint))
    except InputError as error:
        unusable = True
        checks.append(Check("log", False, error.message, error.hint))
    return Checked(path, trial.info.virtual, tuple(checks), grade, unusable)


def _log(trial: Trial, path: Path) -> Check:
    from granite_lab.logs.streams import ZERO  # noqa: PLC0415, heavy

    spans = [s.t for s in (trial.imu, trial.wheels, trial.currents) if s is not None and len(s.t) > 1]
    seconds = max(t[-1] for t in spans) - min(t[0] for t in spans) if spans else 0.0
    dead = [line for line in trial.warnings if line.endswith(ZERO)]
    if dead and not is_bag(path):  # messages of ROS hold zeros where nothing is measured
        return Check("log", False, "; ".join(dead), "check plug and driver of the sensor")
    doubts = f"; warnings: {len(trial.warnings)}, see granite-lab inspect" if trial.warnings else ""
    found = f"read, {seconds:.1f} s, layout {trial.layout}{doubts}"
    return Check("log", bool(seconds > 0), found, "log a whole run")


def _sensors(trial: Trial) -> Iterator[Check]:
    """Say of each sensor whether its channels hold numbers that change."""
    imu, wheels, currents = trial.imu, trial.wheels, trial.currents
    if imu is None:
        yield Check("IMU", False, "not in the log", "check plug, driver and topic of the IMU")
    else:
        names = [f"{kind} {axis}" for kind in ("acceleration", "rate") for axis in "xyz"]
        values = np.hstack([imu.specific_force, imu.angular_rate]).T
        dead = [n for n, x in zip(names, values, strict=True) if np.isfinite(x).any() and not _travel(x)]
        size = float(np.nanmedian(np.linalg.norm(imu.specific_force, axis=1)))
        heavy = imu.gravity_removed or not math.isfinite(size) or GRAVITY[0] < size < GRAVITY[1]
        found = f"constant: {', '.join(dead)}" if dead else f"{_rate(imu.t)}, all channels change"
        found += "" if heavy else f"; magnitude at rest {size:.2f} m/s², not 9.81"
        yield Check("IMU", not dead and heavy, found, "check plug, range and unit of the IMU")
    if wheels is None:
        yield Check("encoders", False, "not in the log", "check plugs and driver of the encoders")
    else:
        travel = {n: _travel(angle) for n, angle in zip(WHEELS, wheels.angle.T, strict=True)}
        still = [n for n, x in travel.items() if not x > SHARE * max(travel.values())]
        found = f"no motion: {', '.join(still)}" if still else f"{_rate(wheels.t)}, all four wheels turn"
        advice = "check plugs of the encoders, and whether the robot drove"
        yield Check("encoders", not still, found, advice)
    if currents is not None:
        flat = [n for n, c in zip(WHEELS, currents.current.T, strict=True) if not _travel(c)]
        found = f"constant: {', '.join(flat)}" if flat else f"{_rate(currents.t)}, all four motors draw"
        yield Check("currents", not flat, found, "check the current sensors")


def _travel(value: Array) -> float:
    """Return how far the known values of a channel reach, 0 where fewer than two are known."""
    known = value[np.isfinite(value)]
    return float(np.ptp(known)) if known.size else 0.0


def _rate(t: Array) -> str:
    return f"{1 / float(np.median(np.diff(t))):.0f} Hz" if len(t) > 1 else "one sample"


def _motion(motion: Motion, trial: Trial) -> Iterator[Check]:
    """Say of the motion what a trial needs to be of use."""
    step, pace = np.gradient(motion.t), np.abs(mean_known(motion.v_wheel))
    stands = inside(motion.t, motion.health.rests) | (pace < COAST)
    middle = np.nan_to_num(0.5 * sum(motion.steady), nan=0.5 * float(motion.t[0] + motion.t[-1]))
    first, last = (float(step[stands & side].sum()) for side in (motion.t < middle, motion.t >= middle))
    found = f"{first:.1f} s before the run, {last:.1f} s after it, {REST:g} s are needed"
    advice = "let the robot stand still for 2 s before and after the run"
    yield Check("standstills", min(first, last) >= REST, found, advice)
    speeds = motion.v_wheel[(motion.t >= motion.steady[0]) & (motion.t <= motion.steady[1])]
    speeds = speeds[np.isfinite(speeds)]
    speed = float(speeds.mean()) if speeds.size else math.nan
    measured = motion.variant_source == "measured"
    wanted = trial.info.v_desired or (None if measured else motion.variant.velocity)
    said = f", desired {wanted:g} m/s" if wanted else "; the log does not say which is desired"
    found = f"wheels {speed:.3f} m/s{said}, for {motion.steady[1] - motion.steady[0]:.1f} s"
    good = math.isfinite(speed) and (wanted is None or abs(speed - wanted) <= SPEED * wanted)
    advice = "check the command, the battery and the current limit"
    yield Check("speed", good, found if math.isfinite(speed) else "no part at constant speed", advice)
    slip = motion.slip_ratio
    low, high = slip.interval()
    usual = f"usual: {100 * SLIP[0]:.0f} to {100 * SLIP[1]:.0f} %"
    known = f"λ_R {percent_of(slip)}, {usual}"
    advice = "check wheel radius, unit of the encoders and mounting of the IMU"
    good = bool(low <= SLIP[1] and high >= SLIP[0])
    yield Check("slip", good, known if math.isfinite(slip.value) else "not known", advice)
    health = motion.health
    yield Check("estimate", health.grade != "poor", health.verdict, "look at the report of granite-lab study")
