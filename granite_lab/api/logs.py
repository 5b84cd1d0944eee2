"""`check`, `inspect`, `ingest` and `view`: whether a log is good, what it holds, the motion in it, a look."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from granite_lab import estimation, reporting
from granite_lab import logs as log_files
from granite_lab.api import calls
from granite_lab.api.calls import Arg, checked
from granite_lab.api.project import About, Logs, choose
from granite_lab.api.records import Origin, Records
from granite_lab.errors import InputError, UsageError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.field_check import Checked, check_log
from granite_lab.files import is_folder, refuse_special
from granite_lab.logs.named import is_log, name_of
from granite_lab.logs.trial import Trial, TrialInfo
from granite_lab.parameters import Robot
from granite_lab.running import each_trial, sifted
from granite_lab.running.options import corrected
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd

    from granite_lab.logs import Inspection


@dataclass(frozen=True, eq=False)
class Ingested(Shown):
    """One log and the motion in it.

    Attributes:
        trial: the samples as they were logged, in SI.
        robot: whose log it is.
        motion: the estimate with its uncertainty.
        judgement: how the estimate stands against the log's reference; None where nobody asked.
    """

    trial: Trial
    robot: Robot
    motion: Motion
    judgement: Any = None

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
    jobs: calls.Jobs = 0,
    done: calls.Done = lambda _: None,
    **said: Unpack[About],
) -> Records[Ingested]:
    """Estimate body velocity, slip and their uncertainty from logs.

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
        InputError: a log cannot be used.
        EstimateError: the motion cannot be had from it.
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
    if len(choice.files) > 1 and (paths or variant):
        raise UsageError("--variant and files of sensors go with one trial", "ingest the trials one by one")
    options = choice.options
    if variant:
        options = replace(options, info=TrialInfo(robot=options.robot, v_desired=variant))
    outcomes = each_trial(corrected, choice.files, options, execution=choice.execution, done=done)
    found = [Ingested(*one) for one in sifted(choice.files, outcomes, strict=True)[0]]
    if against_reference:
        found = [replace(i, judgement=estimation.judge(i.motion, i.trial, 0.0)) for i in found]
    warnings = tuple(f"{item.name}: {line}" for item in found for line in item.motion.warnings)
    origin = Origin(left_out=choice.excluded, warnings=warnings)
    return Records(found, [item.name for item in found], origin)


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
        logs: paths of logs.

    Returns:
        what was recognised, file by file; its table has a row for each column.

    Raises:
        InputError: a file does not exist.
        UsageError: unknown robot or column map.
    """
    paths = [logs] if isinstance(logs, (str, Path)) else list(logs)
    if not paths:
        raise UsageError("no log given", "name the files of one trial")
    for path in paths:
        refuse_special(Path(path))
    return log_files.inspect_logs(paths, map=column_map, robot=robot, topics=topics)


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
        made = Path("reports") / "view" / f"{name_of(path)}.rrd"
        path = reporting.recording.record_trial(found.trial, found.comparison, made)
    if screenshot is not None:
        reporting.recording.save_picture(path, Path(screenshot), at)
    elif web:
        reporting.recording.serve(path, tell)
    else:
        reporting.recording.open_viewer(path)


def _recording_in(folder: Path, trial: str | None) -> Path:
    """Return the recording of a trial in a report folder, or that of the whole study.

    Raises:
        InputError: there is none.
    """
    found = {path.stem: path for path in sorted(folder.rglob("*.rrd"), reverse=True)}
    if not found:
        raise InputError(
            f"{folder}: no recording in it", "make one with 'granite-lab study TRIALS --out DIR'"
        )
    if trial is not None and trial not in found:
        raise InputError(
            f"{folder}: no recording of trial '{trial}'", f"there are: {', '.join(sorted(found))}"
        )
    return found[trial] if trial else found.get("study", found[min(found)])


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
        raise UsageError(f"{log}: {len(choice.files)} logs", "check one after the other")
    return check_log(choice.files[0], choice.options)
