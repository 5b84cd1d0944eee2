"""One trial as it was logged, streams with their own stamps in SI, and which files are trials."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from granite_lab.errors import UsageError
from granite_lab.files import is_folder
from granite_lab.logs.quantities import WORDS
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.parameters import WHEELS
from granite_lab.parameters.changes import Changes
from granite_lab.parameters.quantity import quantity

Array = npt.NDArray[np.float64]

R = TypeVar("R")

_BAGS = (".bag", ".mcap", ".db3")  # endings of recordings by ROS
_PACKED = (".csv.gz", ".csv.zip")
_TEXTS = (".txt", ".tsv", ".dat", ".log")  # of a text by another ending nobody knows whether it is a log


def part(record: R, keep: npt.NDArray[np.bool_] | slice) -> R:
    """Return a record of samples with some of them only: every array in it is cut, the rest stays."""
    samples: Any = record
    arrays = {name: values[keep] for name, values in vars(samples).items() if isinstance(values, np.ndarray)}
    cut: R = replace(samples, **arrays)
    return cut


@dataclass(frozen=True, eq=False)
class ImuStream:
    """Samples of the inertial measurement unit, at the sensor's place; NaN in a column that was not logged.

    Attributes:
        t: (N,) stamps [s], strictly increasing.
        specific_force: (N, 3) [m/s^2]; +9.81 on z at rest in the robot's axes (x forward, y left, z up).
        angular_rate: (N, 3) [rad/s]; y positive nose down.
        gravity_removed: by the logger.
        robot_axes: the mounting rotation has been applied, as in a corrected trial.
        stamp_std: std of a delay that all stamps have in common, where samples shared them [s].
        scaled: factor by which the logged specific force was divided, by gravity at standstill.
    """

    t: Array
    specific_force: Array
    angular_rate: Array
    gravity_removed: bool = False
    robot_axes: bool = False
    stamp_std: float = 0.0
    scaled: float = 1.0


@dataclass(frozen=True, eq=False)
class WheelStream:
    """Samples of the wheel encoders, in the order of `granite_lab.parameters.WHEELS`.

    Attributes:
        t: (M,) stamps [s], strictly increasing.
        angle: (M, 4) accumulated wheel angle [rad], unwrapped; NaN where a wheel was not sampled.
        rate: (M, 4) wheel rate [rad/s] where the logger gives rates; then `angle` is its integral.
        resolution: (4,) smallest step of each wheel's angle [rad], of its logged rate [rad/s];
            0 where it is not known.
        span: (4,) after which each wheel's counter starts again [rad]; 0: it does not.
        stamp_std: std of a delay that all stamps have in common, where samples shared them [s].
    """

    t: Array
    angle: Array
    rate: Array | None = None
    resolution: tuple[float, ...] = (0.0,) * len(WHEELS)
    span: tuple[float, ...] = (0.0,) * len(WHEELS)
    stamp_std: float = 0.0

    @property
    def step(self) -> float:
        """The coarsest resolution of the four [rad] or [rad/s]."""
        return max(self.resolution)

    def changed(self, change: Callable[[Array], Array], **others: Any) -> WheelStream:
        """Return the stream with angles and rates, each (M, 4), changed alike, and with `others` replaced."""
        rate = None if self.rate is None else change(self.rate)
        return replace(self, angle=change(self.angle), rate=rate, **others)


@dataclass(frozen=True, eq=False)
class CurrentStream:
    """Motor currents (K, 4) [A] in the order of the wheels, NaN where not logged, at stamps (K,) [s]."""

    t: Array
    current: Array


@dataclass(frozen=True, eq=False)
class Series:
    """One logged quantity (K,), in the unit that its holder names, at stamps (K,) [s].

    `places` is how many logged places each value was computed from; 1 where it was logged itself.
    """

    t: Array
    value: Array
    places: int = 1


@dataclass(frozen=True)
class InputFile:
    """A file that went into a result."""

    path: Path
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What a laboratory says about a trial, by keys of TOML with their bounds; None where it is not stated.

    Attributes:
        soil: name of the catalogue or path of a TOML file.
        v_desired, a_max, distance: of the desired motion [m/s], [m/s^2], [m].
        clock_offset: known offset of the encoder clock behind the IMU's [s].
        command: the desired velocity as a list, as `parameters.parse_path` reads it.
        rests: intervals in which robot and wheels stood still (start, end) [s, the log's time].
        body_rests: intervals in which the body stood still; its wheels may have turned.
        distance_measured, distance_measured_std: total distance by tape measure [m].
        ref_v_std, ref_x_std: std of the external reference's velocity [m/s] and place [m].
        use_reference: the reference enters the estimate as a measurement.
    """

    soil: str | None = None
    v_desired: float | None = quantity("m/s", 0, 50, "desired velocity of the steady part", "v_Ru", None)
    a_max: float | None = quantity("m/s^2", 0, 500, "largest acceleration", "a_Rmax", None)
    distance: float | None = quantity("m", 0, 1e6, "total desired distance", "L_p", None)
    repetition: int | None = quantity("", 0, 1e6, "number of the repetition", "", None)
    clock_offset: float | None = quantity("s", -1e4, 1e4, "encoder clock behind the IMU's", "", None)
    command: str | None = None
    rests: tuple[tuple[float, float], ...] = ()
    body_rests: tuple[tuple[float, float], ...] = ()
    distance_measured: float | None = quantity("m", 1e-3, 1e6, "total distance by tape", "", None)
    distance_measured_std: float | None = quantity("m", 1e-6, 1e4, "its std", "", None)
    ref_v_std: float | None = quantity("m/s", 1e-6, 10, "std of the reference's velocity", "", None)
    ref_x_std: float | None = quantity("m", 1e-6, 100, "std of the reference's position", "", None)
    use_reference: bool = False

    @property
    def info(self) -> TrialInfo:
        """The same as what is known of a trial."""
        return TrialInfo(**{f.name: getattr(self, f.name) for f in fields(Stated)})


@dataclass(frozen=True, kw_only=True)
class TrialInfo(Stated):
    """What is known about a trial besides its samples.

    Attributes:
        robot: name of the catalogue or path of a TOML file.
        virtual: a simulator wrote the log.
        changes: numbers of robot and soil that were given in place of those of their files.
        extra: other metadata of the file, as text.
    """

    robot: str | None = None
    virtual: bool = False
    changes: Changes = ()
    extra: dict[str, str] = field(default_factory=dict, hash=False)


def unsaid(value: Any) -> bool:
    """Whether a value means "not stated"; zero is a statement."""
    return value is None or value is False or value in ("", (), {}) or bool(value != value)  # noqa: PLR0124, NaN


def over(first: TrialInfo, then: TrialInfo) -> TrialInfo:
    """Return what is known about a trial from two sources; the first one counts where it says anything."""
    stated = {name: value for name, value in vars(first).items() if not unsaid(value)}
    return replace(then, **stated | {"extra": then.extra | first.extra})


@dataclass(frozen=True, eq=False)
class Trial:
    """One trial, as it was logged or as estimation corrected it (`granite_lab.estimation.correct`).

    Attributes:
        name: stem of the log's file.
        imu, wheels, currents: None where the log has none.
        command: commanded velocity [m/s].
        tow: force with which a load pulls back [N].
        reference_x, reference_v: external reference [m], [m/s]; it judges the estimate, and enters it
            only where `info.use_reference` says so.
        doubts: every one that the reader had, and what estimation put right.
        layout: name of the column map that was used.
        units: of channels whose column is in another unit than was said.
    """

    name: str
    info: TrialInfo
    imu: ImuStream | None = None
    wheels: WheelStream | None = None
    currents: CurrentStream | None = None
    command: Series | None = None
    tow: Series | None = None
    reference_x: Series | None = None
    reference_v: Series | None = None
    doubts: tuple[Doubt, ...] = ()
    inputs: tuple[InputFile, ...] = ()
    layout: str = "canonical"
    units: dict[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        streams = {"IMU": self.imu, "wheels": self.wheels, "currents": self.currents}
        samples = ", ".join(f"{name} {len(s.t)}" for name, s in streams.items() if s is not None)
        return f"Trial('{self.name}'{', virtual' if self.info.virtual else ''}: samples {samples or 'none'})"

    def on_its_clock(self, by: float) -> dict[str, Any]:
        """Return all that the encoders' clock stamps, by its name here, its stamps moved by some time [s]."""
        streams = {name: getattr(self, name) for name in ("wheels", "currents", "command", "tow")}
        return {name: s if s is None else replace(s, t=s.t + by) for name, s in streams.items()}

    @property
    def warnings(self) -> tuple[str, ...]:
        """The doubts, one line each."""
        return tuple(dict.fromkeys(map(str, self.doubts)))


def is_bag(path: Path) -> bool:
    """Say whether a path is a recording by ROS: a file, or the folder of a ROS 2 recording."""
    return path.suffix.lower() in _BAGS if not is_folder(path) else (path / "metadata.yaml").is_file()


def _is_table(path: Path, endings: tuple[str, ...] = (".csv", ".mat", *_PACKED)) -> bool:
    return path.name.lower().endswith(endings)


def is_log(path: Path) -> bool:
    """Say whether a path in a folder of trials is one of them."""
    return is_bag(path) or (bool(parts_of(path)) if is_folder(path) else _is_table(path))


def parts_of(folder: Path) -> list[Path]:
    """Return the files of a folder that holds one trial, a file a sensor; none if it is no such folder.

    Every table in it is called after a sensor, as ``imu.csv`` and ``WheelEncoders.csv``.
    """
    if not is_folder(folder) or is_bag(folder):
        return []
    try:
        tables = sorted(filter(_is_table, folder.iterdir()))
    except OSError:  # it may not be searched
        return []
    parts, others = [], 0
    for path in tables:
        spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name_of(path)).lower()
        words = set(re.findall(r"[a-z]+|[^\W_a-z]+", spaced)) - WORDS["file_filler"]
        if words and words <= WORDS["sensor_file"]:
            parts.append(path)
        others += bool(words) and words <= WORDS["other_file"]
    return parts if len(parts) > 1 and len(parts) + others == len(tables) else []


def name_of(path: Path) -> str:
    """Return the name of a trial: its file's without the ending, or its folder's."""
    return path.name if is_folder(path) else (path.with_suffix("") if _is_table(path, _PACKED) else path).stem


def sidecar(log: Path) -> Path:
    """Return where metadata of a log may stand beside it: ``trial.toml`` for ``trial.csv.gz``."""
    return log.parent / f"{name_of(log)}.toml"


def trial_files(paths: Sequence[str | Path] | str | Path) -> list[Path]:
    """Return the logs that were named; a folder stands for the logs in it.

    Logs are CSV files (``.csv.gz`` and ``.csv.zip``, too), MATLAB files (``.mat``), ROS 1 bags (``.bag``),
    MCAP files, folders of ROS 2 recordings, and folders with a file a sensor (`parts_of`).

    Raises:
        UsageError: nothing was named, a folder holds no log, or two logs have one name.
    """
    named = [Path(path) for path in ([paths] if isinstance(paths, (str, Path)) else paths)]
    if not named:
        raise UsageError("no trials given", "name one or more logs, or a folder of them")
    files: list[Path] = []
    for path in named:
        inside = sorted(filter(is_log, path.iterdir())) if is_folder(path) and not is_log(path) else [path]
        if not inside:
            message = f"{path}: the folder holds no log (.csv, .mat, .bag, .mcap)"
            texts = sorted({ending for file in path.iterdir() if (ending := file.suffix) in _TEXTS})
            shown = " or ".join(str(path / f"*{ending}") for ending in texts)
            raise UsageError(message, "name the logs themselves" + (f": {shown}" if shown else ""))
        plain = {name_of(log) for log in inside if not _is_table(log, _PACKED)}
        packed = [log for log in inside if _is_table(log, _PACKED)] if path not in inside else []
        files += [log for log in inside if log not in packed or name_of(log) not in plain]
    unique = list(dict.fromkeys(files))
    names = [name_of(path) for path in unique]
    for name in names:
        if names.count(name) > 1:
            hint = "rename one: results carry the name of their log"
            raise UsageError(f"two logs are called '{name}'", hint)
    return unique
