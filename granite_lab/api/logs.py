"""`ingest` and `inspect`: the motion in logs, and what unknown logs hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granite_lab.api.calls import checked
from granite_lab.api.project import choose
from granite_lab.api.records import Records, sifted
from granite_lab.errors import UsageError
from granite_lab.estimate import Estimate
from granite_lab.estimation import judge
from granite_lab.estimation.motion import Motion
from granite_lab.logs import Inspection, inspect_logs
from granite_lab.logs.trial import Trial, TrialInfo
from granite_lab.parameters import Robot
from granite_lab.running import Options, each_trial
from granite_lab.running.reading import ingest as run
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd

Logs = str | Path | Sequence[str | Path]


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


def _ingest(path: Path, options: Options) -> Ingested:
    return Ingested(*run(path, options))


def _path(path: str | Path | None) -> Path | None:
    return None if path is None else Path(path)


@checked
def ingest(
    logs: Logs,
    *,
    imu: str | Path | None = None,
    encoders: str | Path | None = None,
    currents: str | Path | None = None,
    reference: str | Path | None = None,
    rows: str | None = None,
    column_map: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
    window: tuple[float, float] | None = None,
    robot: str | Path | None = None,
    variant: float | None = None,
    rests: Sequence[tuple[float, float]] = (),
    distance_measured: Estimate | None = None,
    against_reference: bool = False,
    reference_std: float = 0.0,
    jobs: int = 0,
    done: Callable[[Path], None] = lambda _: None,
) -> Records[Ingested]:
    """Estimate body velocity, slip and their uncertainty from logs.

    Args:
        logs: paths of logs, or of folders with logs.
        imu, encoders, currents, reference: further files of the trial, where sensors were logged
            apart; only with one log.
        rows: rows to take from a log of several runs, as ``run_id = 4``.
        column_map: name or file of a column map; without it the layout is recognised.
        topics: of a bag, ``imu``, ``joints`` and ``odom`` to the name of a topic.
        window: begin and end of what is taken of every log [s of the log], infinite where open.
        robot: name or file of the robot; without it the log says which.
        variant: desired velocity [m/s], if the log lacks it.
        rests: intervals of standstill (start, end) [s, the log's time].
        distance_measured: total distance by tape [m].
        against_reference: judge the estimate by the log's reference, which the filter never sees.
        reference_std: std of the reference's own velocity [m/s].
        jobs: number of processes; 0 means one per core.
        done: called with each path once it is finished.

    Returns:
        one record a log; its table has a row for each IMU stamp.

    Raises:
        InputError: a log cannot be used.
        EstimateError: the motion cannot be had from it.
        UsageError: the arguments do not fit together.
    """
    choice = choose(logs, robot, None, column_map)
    files, robot, column_map = choice.files, choice.robot, choice.column_map
    if len(files) > 1 and any((imu, encoders, currents, reference)):
        raise UsageError("files of single sensors go with one trial", "ingest the trials one by one")
    options = Options(
        robot=None if robot is None else str(robot),
        column_map=None if column_map is None else str(column_map),
        rows=rows,
        info=TrialInfo(robot=None if robot is None else str(robot), v_desired=variant) if variant else None,
        rests=tuple(rests),
        distance_measured=distance_measured,
        topics=tuple((topics or {}).items()),
        window=window,
        imu=_path(imu),
        encoders=_path(encoders),
        currents=_path(currents),
        reference=_path(reference),
    )
    outcomes = each_trial(_ingest, files, options, jobs=jobs, done=done)
    found, _ = sifted(files, outcomes, strict=True)
    if against_reference:
        found = [Ingested(i.trial, i.robot, i.motion, judge(i.motion, i.trial, reference_std)) for i in found]
    left_out = [(item.trial, item.reason) for item in choice.left_out]
    return Records(found, lambda item: item.name, left_out)


@checked
def inspect(
    logs: Logs,
    *,
    column_map: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
    robot: str | Path | None = None,
) -> Inspection:
    """Say what is recognised in unknown logs: columns, units, clocks, rates, gaps, variant.

    A log that cannot be read is not an error here but a `problem` in its report.

    Args:
        logs: paths of logs.
        column_map: name or file of a column map.
        topics: of a bag, ``imu``, ``joints`` and ``odom`` to the name of a topic.
        robot: name or file of the robot.

    Returns:
        what was recognised, file by file; its table has a row for each column.

    Raises:
        UsageError: unknown robot or column map.
    """
    paths = [logs] if isinstance(logs, (str, Path)) else list(logs)
    if not paths:
        raise UsageError("no log given", "name the files of one trial")
    return inspect_logs(paths, map=column_map, robot=robot, topics=topics)
