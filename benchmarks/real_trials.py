"""Public trials of other robots through the whole chain: estimate, reference, k_92, and what a report says.

The logs are not part of the project; `docs/real-trials.md`, which this writes, says where they are. What a
user has to write by hand is in `benchmarks/robots` and in the sidecars that are made here.

``python -m benchmarks.real_trials --data FOLDER [--out docs/real-trials.md]``
"""

from __future__ import annotations

import math
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import granite_lab as gl
from benchmarks.command_line import parser_of
from benchmarks.real_logs import BOREAL, BY_HAND, SNOW_STD, by_hand, standstills
from benchmarks.real_trials_drive import steps_of
from benchmarks.real_trials_field import FIELD, own_folder
from benchmarks.real_trials_page import page, picture
from benchmarks.real_trials_plot import slips
from benchmarks.real_trials_set import Outcome, Prepared, Row
from granite_lab.errors import LabError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.files import write_text
from granite_lab.fitting.fit import K92_BOUNDS, K92Fit
from granite_lab.logs import read_trial
from granite_lab.logs.counters import mean_known
from granite_lab.logs.trial import Trial, trial_files
from granite_lab.reporting.answers import of_study
from granite_lab.reporting.canvas import saved

HUSKY = str(BY_HAND / "husky.toml")
"""The robot of the catalogue with a chassis, by hand."""

ICP = (
    "A step of 6 s follows the one before without a standstill: without the reference its steady slip cannot "
    "be seen. The positions by ICP scatter by up to 0.4 m, so that the path through them is too long "
    "(step_036 of the Warthog would slip by -11.1 ± 0.3 %). Their distance along the heading is used."
)
"""What is to be said of the reference of DRIVE."""

REVERSED = (
    "In step_074 the wheels pass from -1.2 m/s through zero without standing. The wheels' stamps come some "
    "0.35 s after those of the IMU."
)
"""What is to be said of the Warthog."""

BACKWARDS = "Its IMU looks backwards: step_197 was refused until the robot's file said so."
"""What is to be said of the Husky of DRIVE."""

NO_ANCHOR = (
    "No run has a standstill, a reference or a measured way. Slip that is steady cannot be seen by an IMU "
    "then: 0 to 100 % are possible, and no k_92 follows, whatever drives the model."
)
"""What is to be said of the logs of the Husky without a reference."""

TWO_SIDED = 1.96
"""Half of a 95 % interval in std."""


def snow(data: Path, work: Path) -> Prepared:
    """Rover on snow; standstills of the body are named by its inertial navigation."""
    robot, columns = by_hand("snow_rover")
    for path in sorted((data / "snow").glob("event_1_*.mat")):
        shutil.copy(path, work)
        sidecar, named = work / f"{path.stem}.toml", f"ref_v_std_mps = {SNOW_STD}\n"
        sidecar.write_text(named, encoding="utf-8")
        try:
            rests = standstills(read_trial(path, robot=robot, map=columns))
        except LabError:
            continue
        rested = ", ".join(f"[{a:.3f}, {b:.3f}]" for a, b in rests)
        sidecar.write_text(f"{named}body_rests = [{rested}]\n", encoding="utf-8")
    return Prepared(
        "Rover on snow", "austinlines/PhD, Thesis - Code/ImmobilizationDetection", "none: not committed",
        work, robot, columns,
        ("robot and snow: of the author's own model of it",
         "column map: 14 lines, with two axes of the gyro exchanged",
         "sidecar of each run: the standstills of the body, std of the reference"),
        str(BY_HAND / "snow.toml"), "inertial navigation with GPS, ± 30 mm/s at rest",
        "The rover works itself into the snow until it is immobile. The author's snow lets the model reach a "
        "slip of some 7 % at these speeds, with k_92 = 0; slip beyond it has no k_92. Where λ_R is known to "
        "5 to 7 points only, it is for the wheels: encoders that give no counts for seconds.",
    )  # fmt: skip


def vulpi(data: Path, work: Path) -> Prepared:
    """Husky on farm land, currents of both sides, no reference."""
    pairs(data / "vulpi", work, [p.stem for p in sorted((data / "vulpi").glob("*_imu_*.csv"))])
    return Prepared(
        "Husky on ploughed, unploughed and dirt ground (Vulpi et al.)", "norlab-ulaval/BorealTC, data/vulpi",
        "see its README: not committed", work, HUSKY,
        written=("a folder for each run with imu.csv and motors.csv", "robot: chassis by its description"),
        remark=NO_ANCHOR,
    )  # fmt: skip


def boreal(data: Path, work: Path) -> Prepared:
    """Husky on sandy loam and snow, no reference and no standstill."""
    pairs(data / "borealtc_husky", work, [name.format("imu") for name in BOREAL])
    return Prepared(
        "Husky on sandy loam and snow", "norlab-ulaval/BorealTC, data/borealtc", "CC0", work, HUSKY,
        written=("a folder for each run with imu.csv and motors.csv", "robot: chassis by its description"),
        remark=NO_ANCHOR,
    )  # fmt: skip


def pairs(folder: Path, work: Path, names: Sequence[str]) -> None:
    """Put the two files of each run into a folder of its own."""
    for name in names:
        files = {"imu": folder / f"{name}.csv", "motors": folder / f"{name.replace('imu', 'pro')}.csv"}
        own_folder(work, name.replace("imu_", ""), files)


def drive(robot: str, radius: float, file: str, own: str) -> Callable[[Path, Path], Prepared]:
    """Return what prepares the straight steps of DRIVE of a robot with wheels of a radius [m]."""

    def prepared(data: Path, work: Path) -> Prepared:
        stds = []
        for name, table, std in steps_of(data / "drive" / f"test_{robot}_torch_ready_dataframe.pkl", radius):
            table.to_csv(work / f"{name}.csv", index=False)
            (work / f"{name}.toml").write_text(f"ref_x_std_m = {std:.3f}\n", encoding="utf-8")
            stds.append(1000 * std)
        return Prepared(
            f"DRIVE, {robot.capitalize()} on grass, straight steps", "norlab-ulaval/DRIVE, calib_data",
            "BSD-3", work, str(BY_HAND / file),
            written=("the table of windows of 2 s cut into steps with columns of the canonical log",
                     "steps that drive back turned round; begin of a step when both sides turn as commanded",
                     "robot: wheels and chassis of the maker's description",
                     "sidecar of each step: std of the reference, by its scatter about a constant velocity"),
            soil=str(BY_HAND / "sandy_loam.toml"),
            reference_is=f"lidar ICP, ± {min(stds):.0f} to {max(stds):.0f} mm, its way along the heading",
            remark=f"{ICP} {own}",
        )  # fmt: skip

    return prepared


SETS: dict[str, Callable[[Path, Path], Prepared]] = {
    "drive/test_warthog_torch_ready_dataframe.pkl": drive("warthog", 0.3, "warthog.toml", REVERSED),
    "drive/test_husky_torch_ready_dataframe.pkl": drive("husky", 0.165, "husky_drive.toml", BACKWARDS),
    "snow": snow,
    "vulpi": vulpi,
    "borealtc_husky": boreal,
    **FIELD,
}
"""What must be in the data's folder, and what prepares the set."""


def truth_of(motion: Motion, trial: Trial) -> Estimate:
    """Return λ_R over the steady part by the reference and the wheels, without any estimate.

    The way by places is that between the first and the last known there: none is made up at the ends.
    """
    begin, end = motion.steady
    way, std = math.nan, math.nan
    if trial.reference_x is not None and trial.reference_x.places == 1:
        t, x = trial.reference_x.t, trial.reference_x.value
        known = np.isfinite(x) & (t >= begin) & (t <= end)
        if not known.any():
            return Estimate(math.nan)
        (begin, end), way = t[known][[0, -1]], float(np.diff(x[known][[0, -1]])[0])
        std = math.sqrt(2.0) * (trial.info.ref_x_std or 0.0)
    elif trial.reference_v is not None:
        keep = (trial.reference_v.t >= begin) & (trial.reference_v.t <= end)
        if np.count_nonzero(keep) > 1:
            way = float(np.trapezoid(trial.reference_v.value[keep], trial.reference_v.t[keep]))
            std = (trial.info.ref_v_std or 0.0) * math.sqrt((end - begin) / np.count_nonzero(keep))
    keep = (motion.t >= begin) & (motion.t <= end)
    if not keep.any():
        return Estimate(math.nan)
    rolled = float(np.trapezoid(np.nan_to_num(mean_known(motion.v_wheel[keep])), motion.t[keep]))
    if abs(rolled) < 0.05:
        return Estimate(math.nan)
    return Estimate(1.0 - abs(way / rolled), std / abs(rolled))


def rows_of(prepared: Prepared) -> Iterator[Row]:
    """Estimate each trial of a set without and with its reference, and fit k_92."""
    for log in trial_files(prepared.logs):
        nothing = Estimate(math.nan)
        try:
            (plain,) = gl.ingest(log, jobs=1, **prepared.about)
        except LabError as error:
            yield Row(log.stem, "refused", nothing, nothing, nothing, _short(error, log))
            continue
        referred, truth = nothing, nothing
        known = prepared.known
        if known:
            truth = truth_of(plain.motion, plain.trial)
            try:
                referred = gl.ingest(log, jobs=1, **prepared.about, **known)[0].motion.slip_ratio
            except LabError:
                referred = nothing
        grade, slip = plain.motion.health.grade, plain.motion.slip_ratio
        yield Row(plain.name, grade, slip, referred, truth, *_k92(log, prepared, known))


def interval_of(fit: K92Fit) -> tuple[float, float]:
    """Return the 95 % interval of k_92, with what soil and wheel radius may do to it, within its bounds."""
    below = math.hypot(fit.k92.std, *(min(s.up, s.down, 0.0) for s in fit.shared))
    above = math.hypot(fit.k92.std, *(max(s.up, s.down, 0.0) for s in fit.shared))
    low, high = K92_BOUNDS
    return max(fit.k92.value - TWO_SIDED * below, low), min(fit.k92.value + TWO_SIDED * above, high)


def _k92(log: Path, prepared: Prepared, known: dict[str, Any]) -> tuple[str, float]:
    """Return k_92 with its interval and the interval's width, or the reason why there is none and NaN."""
    try:
        (fit,) = gl.fit_k92(log, jobs=1, cache=False, **prepared.about, **known)
    except LabError as error:
        return _short(error, log), math.nan
    if fit.k92_known:
        low, high = interval_of(fit)
        return f"{fit.k92.value:.2f}, 95 % {low:.2f} to {high:.2f}", high - low
    if not fit.slip_known:
        return f"none: λ_R known to ± {100 * fit.slip_measured.std:.1f} points", math.nan
    low, high = (100 * x for x in fit.reach)
    return f"none: λ_R outside the {low:.1f} to {high:.1f} % of the model", math.nan


def _short(error: LabError, log: Path) -> str:
    return (
        error.message.replace(str(log), log.name).removeprefix(f"{log.name}: ").removeprefix(f"{log.stem}: ")
    )


def said_by_report(prepared: Prepared) -> tuple[str, ...]:
    """Return the first screen of a study of a set, or the line with which it ends."""
    try:
        result = gl.study(prepared.logs, discover=False, cache=False, **prepared.about, **prepared.known)
    except LabError as error:
        return (f"ends with: {error.message.replace(str(prepared.logs), 'logs')}",)
    answers = of_study(result)
    verdicts = [f" {q.verdict}." if q.verdict else "" for q in answers.questions]
    said = zip(answers.questions, verdicts, strict=True)
    return (answers.lead, *(f"{q.question}{verdict} {q.text}" for q, verdict in said))


def analysed(prepared: Prepared) -> Outcome:
    """Take a set through the whole chain."""
    begin = time.monotonic()
    rows, said = tuple(rows_of(prepared)), said_by_report(prepared)
    return Outcome(prepared, rows, said, time.monotonic() - begin)


def main() -> None:
    """Analyse every set that is there, and write the page."""
    parser = parser_of(__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the sets")
    parser.add_argument("--out", type=Path, default=Path("docs/real-trials.md"))
    given = parser.parse_args()
    outcomes, absent = [], []
    for name, prepare in SETS.items():
        if not (given.data / name).exists():
            absent.append(name)
            continue
        with tempfile.TemporaryDirectory(prefix="real-trials-") as folder:
            work = Path(folder) / "logs"
            work.mkdir()
            outcomes.append(analysed(prepare(given.data, work)))
            print(f"{name}: {len(outcomes[-1].rows)} trials, {outcomes[-1].seconds:.0f} s")
    table = pd.DataFrame([
        {
            "set": o.prepared.title, "trial": r.name, "grade": r.grade, "slip": r.slip.value,
            "slip_std": r.slip.std, "slip_with_reference": r.referred.value,
            "slip_with_reference_std": r.referred.std, "slip_by_reference": r.truth.value,
            "slip_by_reference_std": r.truth.std, "k92": r.k92, "k92_interval": r.width,
        }
        for o in outcomes for r in o.rows
    ])  # fmt: skip
    write_text(
        given.out.parent / "tables" / "real-trials.csv", table.to_csv(index=False, float_format="%.5g")
    )
    for outcome in outcomes:
        drawn = given.out.parent / picture(outcome)
        drawn.parent.mkdir(parents=True, exist_ok=True)
        drawn.write_bytes(saved(slips(outcome), "png"))
    write_text(given.out, page(outcomes, absent))
    print(given.out)


if __name__ == "__main__":
    main()
