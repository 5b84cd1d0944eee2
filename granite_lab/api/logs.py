"""`check`, `inspect`, `ingest` and `view`: quality of a log, its content, its motion, its recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granite_lab import estimation, reporting
from granite_lab import logs as log_files
from granite_lab.api.arguments import (
    Changes,
    File,
    Logs,
    Rests,
    Topics,
    Window,
    execution_of,
    options_of,
    refuse_outside,
)
from granite_lab.api.project import choose
from granite_lab.api.records import Records
from granite_lab.api.run_checks import Checked, check_run, unread
from granite_lab.chain import analyse, corrected, corrected_without_reference
from granite_lab.errors import EstimateError, InputError, LabError, UsageError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.files import is_folder, refuse_special
from granite_lab.folders import replacing
from granite_lab.logs.trial import Trial, TrialInfo, is_log, name_of, over, trial_files
from granite_lab.origin import Origin
from granite_lab.parameters import Robot
from granite_lab.running import each_trial, split_failures
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd

    from granite_lab.logs import Inspection


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


def ingest(
    logs: Logs = (),
    *,
    imu: File = None, encoders: File = None, currents: File = None, reference: File = None,
    rows: str | None = None, variant: float | None = None,
    against_reference: bool = False,
    robot: File = None, soil: File = None, column_map: File = None, topics: Topics = None,
    window: Window = None, changes: Changes = None,
    rests: Rests = (), body_rests: Rests = (), distance_measured: Estimate | None = None,
    use_reference: bool = False, ref_v_std: float | None = None, ref_x_std: float | None = None,
    strict: bool = False,
    jobs: int = 0,
    done: Callable[[Path], None] = lambda _: None,
) -> Records[Ingested]:  # fmt: skip
    """Estimate body velocity, slip and their uncertainty from logs.

    A log that cannot be used is left out and listed with the reason.

    Args:
        logs: paths of logs, or of folders with logs.
        imu: file with the IMU, if each sensor of a trial has its own file.
        encoders: file with the encoders of that trial.
        currents: file with the motor currents of that trial.
        reference: file with an external reference of that trial, as GPS or motion capture.
        rows: rows to take from a log of several runs, as ``run_id = 4``.
        variant: desired velocity [m/s], 0.01 to 5, if the log lacks it.
        against_reference: compare the estimate with the log's reference, which the filter does not use.
        robot: the robot: a name of the catalogue or a .toml file; by default as granite-lab.toml or the log
            says, else granite.
        soil: the soil, likewise; by default as granite-lab.toml or the log says, else dry_sand.
        column_map: column map: a name of the catalogue or a .toml file, or a folder of these.
        topics: of bags, ``imu``, ``joints`` and ``odom`` to the name of a topic.
        window: begin and end of the part to use of every log [s, the log's time], infinite where open.
        changes: numbers of robot and soil in place of those of their files, by the keys of the files, as
            ``{"robot.wheels.radius_m": 0.106}``.
        rests: intervals in which robot and wheels stood still (start, end) [s, the log's time].
        body_rests: intervals in which the body stood still; its wheels may have turned.
        distance_measured: total distance by tape [m].
        use_reference: the log's external reference enters the estimate as a measurement. The judgement is
            then of the estimate without it.
        ref_v_std: std of the reference's velocity [m/s].
        ref_x_std: std of its place [m].
        strict: a trial that fails is an error.
        jobs: number of processes; 0 means one per core.
        done: called with each path once it is finished.

    Returns:
        one record a log; its table has a row for each IMU stamp.

    Raises:
        InputError: no log can be used.
        EstimateError: the motion cannot be estimated from any.
        UsageError: the arguments do not fit together.
    """
    options = options_of(locals())
    refuse_outside("variant", variant, 0.01, 5)
    apart = {"imu": imu, "encoders": encoders, "currents": currents, "reference": reference}
    files: dict[str, Any] = {name: Path(path) for name, path in apart.items() if path is not None}
    if files and not isinstance(logs, (str, Path)) and not logs:  # the IMU's file is the log
        logs = files.pop("imu", ())
    execution = execution_of(jobs)
    chosen = choose(logs, options)
    from granite_lab.logs.halves import halves  # noqa: PLC0415, heavy

    column_maps, of_bags = chosen.options.column_map, dict(chosen.options.topics)
    together, note = ({}, "") if files or rows else halves(chosen.files, column_maps, of_bags)
    if together:
        files, chosen = together, replace(chosen, files=(together["imu"],))
    if len(chosen.files) > 1 and (files or variant):
        raise UsageError("--variant and files of sensors go with one trial", "ingest the trials one by one")
    options = replace(chosen.options, beside=tuple(files.items()))
    if variant:
        stated = TrialInfo(robot=options.robot, v_desired=variant)
        options = replace(options, info=over(stated, options.info or TrialInfo()))
    outcomes = each_trial(corrected, chosen.files, options, execution=execution, done=done)
    pairs = list(zip(chosen.files, outcomes, strict=True))
    estimated = [(path, outcome) for path, outcome in pairs if not isinstance(outcome, LabError)]
    referred = [path for path, (trial, _, _) in estimated if trial.info.use_reference]
    without = each_trial(corrected_without_reference, referred, options, execution=execution)
    blind = dict(zip(referred, without, strict=True))
    records = [_ingested(path, outcome, against_reference, blind.get(path)) for path, outcome in pairs]
    ingested, failed = split_failures(chosen.files, records, strict=strict)
    warnings = [f"{item.name}: {line}" for item in ingested for line in item.motion.warnings]
    origin = Origin(None, (*chosen.excluded, *failed), tuple([note, *warnings] if note else warnings))
    return Records(ingested, [item.name for item in ingested], origin)


def _ingested(
    log: Path, outcome: tuple[Trial, Robot, Motion] | LabError, judge: bool, blind: Motion | LabError | None
) -> Ingested | LabError:
    """Return the record of a log, with its judgement if asked for; the error where there is no estimate.

    Where the reference entered the estimate, `blind`, the estimate without it, is judged.
    """
    if isinstance(outcome, LabError):
        return outcome
    ingested = Ingested(*outcome, log=log)
    if isinstance(blind, LabError):
        warning = f"without the reference there is no estimate to compare: {blind.message}"
        motion = replace(ingested.motion, warnings=(*ingested.motion.warnings, warning))
        return replace(ingested, motion=motion)
    if blind is None and not judge:
        return ingested
    try:
        return replace(ingested, judgement=estimation.judge(blind or ingested.motion, ingested.trial, 0.0))
    except EstimateError as error:
        return error


def inspect(logs: Logs, *, column_map: File = None, topics: Topics = None, robot: File = None) -> Inspection:
    """Show what is recognised in logs: columns, units, clocks, rates, gaps, variant.

    A log that is not understood is reported as a `problem`, not as an error.

    Args:
        logs: paths of logs, or of folders with logs.
        column_map, topics, robot: as in `ingest`.

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


def view(
    path: str | Path,
    *,
    trial: str | None = None,
    robot: File = None, soil: File = None, column_map: File = None,
) -> None:  # fmt: skip
    """Open a recording in the Rerun viewer, which stays open.

    Args:
        path: of a recording (.rrd), a report folder, or a log.
        trial: with a report folder, the trial to open; all by default.
        robot, soil, column_map: as in `ingest`, for a log.

    Raises:
        InputError: there is no such recording, or the log cannot be used.
        LabError: there is no display, viewer or graphics driver.
    """
    options = options_of(locals())
    path = Path(path)
    refuse_special(path)
    if is_folder(path) and not is_log(path):
        reporting.recording.open_viewer(_recordings_in(path, trial))
        return
    if path.suffix != ".rrd":
        result = analyse(path, choose(path, options, everything=True).options)
        place, name = Path("reports") / "view", f"{name_of(path)}.rrd"
        with replacing(place, name) as new:
            reporting.recording.record_trial(result, new / name)
        path = place / name
    reporting.recording.open_viewer([path])


def _recordings_in(folder: Path, trial: str | None) -> list[Path]:
    """Return the recordings in a report folder, or that of a trial."""
    recordings = {path.stem: path for path in sorted(folder.rglob("*.rrd"), reverse=True)}
    if not recordings:
        hint = "make one with 'granite-lab study TRIALS --out DIR'"
        raise InputError(f"{folder}: no recording in it", hint)
    if trial is not None and trial not in recordings:
        hint = f"there are: {', '.join(sorted(recordings))}"
        raise InputError(f"{folder}: no recording of trial '{trial}'", hint)
    return [recordings[name] for name in ([trial] if trial else sorted(recordings))]


def check(
    logs: Logs,
    *,
    robot: File = None, soil: File = None, column_map: File = None, topics: Topics = None,
    window: Window = None, changes: Changes = None,
    rests: Rests = (), body_rests: Rests = (), distance_measured: Estimate | None = None,
    use_reference: bool = False, ref_v_std: float | None = None, ref_x_std: float | None = None,
    jobs: int = 0,
    done: Callable[[Path], None] = lambda _: None,
) -> Records[Checked]:  # fmt: skip
    """Check logs after runs in the field: readable, sensors, standstills, speed, slip, estimate.

    A log that cannot be used is reported as a failed check.

    Args:
        logs: paths of logs, or of folders with logs.
        robot, soil, column_map, topics, window, changes: options on the logs, as in `ingest`.
        rests, body_rests, distance_measured, use_reference, ref_v_std, ref_x_std: metadata of the trials,
            as in `ingest`.
        jobs: number of processes; 0 means one per core.
        done: called with each path once it is finished.

    Returns:
        one record a log; the table has a row for each check.

    Raises:
        UsageError: unknown robot or column map, or no log.
    """
    execution, options = execution_of(jobs), options_of(locals())
    chosen = choose(logs, options, everything=True)
    outcomes = each_trial(check_run, chosen.files, chosen.options, execution=execution, done=done)
    pairs = zip(chosen.files, outcomes, strict=True)
    checks = [unread(path, outcome) if isinstance(outcome, LabError) else outcome for path, outcome in pairs]
    return Records(checks, [name_of(outcome.log) for outcome in checks])
