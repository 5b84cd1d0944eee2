"""Estimates on public logs of other robots, against the references that came with them.

The logs are not part of the project; `docs/estimation-real.md`, which this writes, says where they are.

``python -m benchmarks.real_logs --data FOLDER [--out docs/estimation-real.md]``
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.against_truth import Array, Velocities, draw, rms
from benchmarks.command_line import parser_of
from benchmarks.log_set import LogSet, wheel_speed
from benchmarks.real_logs_page import Delay, Delays, page, run_table
from granite_lab.errors import LabError
from granite_lab.files import write_text
from granite_lab.logs import Excerpt, read_trial
from granite_lab.logs.counters import mad_std
from granite_lab.logs.sensors.standstill import Interval
from granite_lab.logs.streams import WINDOW, slope_of_line
from granite_lab.logs.trial import Trial

BY_HAND = Path(__file__).parent / "robots"
"""Robots and column maps that were written for logs of unknown layout."""

FIRM = str(BY_HAND / "firm.toml")
"""Ground of the car and of the Husky with GPS."""

SCENES = ("0757", "1100", "0061", "0103", "0655", "0796", "0916", "1077", "1094")
CAR_RUNS = (4, 21, 22)
BOREAL = ("SNOW_{}_01", "SANDY_LOAM_{}_01", "SANDY_LOAM_{}_06")

SNOW_STANDS, SNOW_SHORTEST, SNOW_STD = 0.1, 0.45, 0.03
"""Rover on snow: speed below which its reference is noise [m/s]; shortest standstill that is named [s]; std
of the reference at rest [m/s]."""

MOVES, GPS_MOVES = 0.01, 0.2
"""Speed from which car and Pathfinder move, by their references [m/s]."""

OTHERS = ("pathfinder", "husky", "small car", "boreal")

STEADY_FROM = 1.5
"""The three-wheeled robot has sped up after this [s]."""


def by_hand(name: str) -> tuple[str, str]:
    """Files of a robot and of its column map that were written by hand."""
    return str(BY_HAND / f"{name}.toml"), str(BY_HAND / f"{name}_map.toml")


def snow(data: Path, *, named: bool) -> LogSet:
    """Rover on snow, with both standstills named or with none."""
    found, (robot, columns) = LogSet(), by_hand("snow_rover")
    for path in sorted((data / "snow").glob("event_*.mat")):
        name = path.stem.removeprefix("event_")
        try:
            trial = read_trial(path, robot=robot, map=columns)
        except LabError as refusal:
            found.refused[name] = refusal.message.removeprefix(f"{path}: ")
            continue
        rests = standstills(trial) if named else []
        if len(rests) == 2 or not named:
            found.add(name, trial, robot, rests)
    found.runs[:] = [replace(run, truth_std=SNOW_STD) for run in found.runs]
    return found


def standstills(trial: Trial) -> list[Interval]:
    """Standstills of the rover's body at both ends of a run, by its reference [s]."""
    reference = trial.reference_v
    assert reference is not None
    t = reference.t
    moving = np.flatnonzero(np.abs(reference.value) >= SNOW_STANDS)
    first, last = max(moving[0] - 1, 0), min(moving[-1] + 1, t.size - 1)
    ends = [(float(t[0]), float(t[first])), (float(t[last]), float(t[-1]))]
    return [(begin, end) for begin, end in ends if end - begin > SNOW_SHORTEST]


def car(data: Path) -> LogSet:
    """Car on roads, against its fused velocity."""
    found, (robot, columns) = LogSet(), by_hand("zoe")
    for scene in SCENES:
        folder = data / "car" / f"scene-{scene}" / "CAN"
        imu, wheels, pose = (folder / f"{n}.csv" for n in ("imu_signal", "zoe_veh_signal", "gt_pose"))
        trial = read_trial(imu, {"encoders": wheels, "reference": pose}, robot=robot, map=columns)
        found.add(scene, trial, robot, soil=FIRM)
    return found


def only(run: Velocities, keep: NDArray[np.bool_]) -> Velocities:
    """Return a part of a run."""
    t, truth, v, std, wheels = (values[keep] for values in (run.t, run.truth, run.v, run.std, run.wheels))
    return replace(run, t=t, truth=truth, v=v, std=std, wheels=wheels)


def delays(scenes: LogSet) -> Delays:
    """How the reference's velocity is delayed: by scene, and by the low-pass that it decays with at rest."""
    found = {run.name: (delay(run, run.v), delay(run, run.wheels)) for run in scenes.runs}
    ratios, step = [], 0.0
    for run in scenes.runs:
        before, after = run.truth[:-1], run.truth[1:]
        still = (run.wheels[1:] == 0.0) & (before > 0.0) & (before < MOVES)
        ratios.append(after[still] / before[still])
        step = float(np.median(np.diff(run.t)))
    decay = -step / float(np.log(np.median(np.concatenate(ratios))))
    unseen = {run.name: float(np.abs(run.v[run.wheels == 0.0]).max(initial=0.0)) for run in scenes.runs}
    return Delays(found, decay, unseen)


def delay(run: Velocities, values: Array) -> Delay:
    """The delay of the reference with which it agrees best with some velocity, and how well it does then."""
    shifts = np.linspace(-0.3, 0.3, 61)
    keep = run.truth > MOVES
    keep[:20] = keep[-20:] = False  # 0.4 s at 50 Hz: nothing is shifted in from outside
    off = [(np.interp(run.t - s, run.t, values) - run.truth)[keep] for s in shifts]
    best = int(np.argmin([rms(one) for one in off]))
    std = np.interp(run.t - shifts[best], run.t, run.std)[keep]
    return Delay(float(shifts[best]), rms(off[best]), float(np.mean(np.abs(off[best]) <= 2.0 * std)))


def pathfinder(data: Path) -> LogSet:
    """Planetary test rover on rough ground, 50 s between two standstills, against differential GPS."""
    found, (robot, columns), folder = LogSet(), by_hand("pathfinder"), data / "pathfinder"
    imu, wheels, gps = (folder / f"{name}.csv" for name in ("imu", "wheels", "gps"))
    trial = read_trial(imu, {"encoders": wheels, "reference": gps}, robot=robot, map=columns)
    found.add("Pathfinder", trial, robot)
    (run,) = found.runs
    run = only(replace(run, t=run.t - run.t[0]), run.truth > GPS_MOVES)
    found.runs[:] = [replace(run, truth_std=gps_noise(run))]
    return found


def gps_noise(run: Velocities) -> float:
    """Std of a speed by GPS [m/s], from its changes against the wheels: a steady slip leaves none in them."""
    beside = (run.truth - run.wheels)[::WINDOW]  # windows that share no fix are WINDOW samples apart
    return float(mad_std(np.diff(beside), 0.0) / np.sqrt(2.0))


def husky(data: Path, soil: str = FIRM) -> LogSet:
    """Husky against GPS; everything as the slope of a line through five fixes, as the speed by GPS is."""
    found, folder = LogSet(), data / "husky_gps"
    trial = read_trial(folder / "imu.csv", {"encoders": folder / "odom.csv", "reference": folder / "fix.csv"})
    found.add("Husky", trial, "husky_gps", soil=soil)
    (run,), (motion,) = found.runs, found.motions.values()
    noise = gps_noise(run)

    def smoothed(t: Array, velocity: Array) -> Array:
        way = np.cumsum(velocity * np.diff(t, prepend=t[0]))
        return slope_of_line(run.t, np.interp(run.t, t, way))

    v, wheels = smoothed(motion.t, motion.v), smoothed(*wheel_speed(trial, "husky_gps"))
    found.runs[:] = [replace(run, v=v, wheels=wheels, truth_std=noise, window=(200.0, 300.0))]
    return found


def small_car(data: Path) -> LogSet:
    """Car at scale 1:10 that skids, against motion capture."""
    found, path = LogSet(), data / "f1tenth_optitrack" / "hoons_all_test.csv"
    for number in CAR_RUNS:
        found.add(f"run {number}", read_trial(path, excerpt=Excerpt(f"run_id = {number}")), "f1tenth")
    found.runs[:] = [replace(run, window=(run.t[0], run.t[0] + 15.0)) for run in found.runs]
    return found


def boreal(data: Path) -> LogSet:
    """Husky on sandy loam and snow: no reference and no standstill."""
    found, folder = LogSet(), data / "borealtc_husky"
    for name in BOREAL:
        imu, wheels = (folder / f"{name.format(part)}.csv" for part in ("imu", "pro"))
        found.add(name.replace("_{}", ""), read_trial(imu, {"encoders": wheels}), "husky")
    return found


def sliding(data: Path) -> dict[str, tuple[float, float]]:
    """Three-wheeled robot without an IMU: way by wheels and by camera once it has sped up [m], by run."""
    found = {}
    for path in sorted((data / "robotino_slip").glob("*.csv")):
        trial = read_trial(path)
        (t, v), reference = wheel_speed(trial, "robotino"), trial.reference_x
        assert reference is not None
        rolled = float(np.trapezoid(v[t > STEADY_FROM], t[t > STEADY_FROM]))
        found[path.stem] = rolled, float(np.ptp(reference.value[reference.t > STEADY_FROM]))
    return found


def main() -> None:
    """Estimate every log, write the page and its figures."""
    parser = parser_of(__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the logs")
    parser.add_argument("--out", type=Path, default=Path("docs/estimation-real.md"))
    given = parser.parse_args()
    data, figures = given.data, given.out.parent / "figures"
    sets = {
        "snow, named": snow(data, named=True),
        "snow": snow(data, named=False),
        "car": car(data),
        "pathfinder": pathfinder(data),
        "husky": husky(data),
        "small car": small_car(data),
        "boreal": boreal(data),
    }
    late = delays(sets["car"])
    sets["car"].runs[:] = [only(run, run.truth > MOVES) for run in sets["car"].runs]
    draw(figures / "real_snow.png", [run for run in sets["snow, named"].runs if run.name[0] == "1"])
    draw(figures / "real_car.png", sets["car"].runs, columns=3)
    draw(figures / "real_others.png", [run for name in OTHERS for run in sets[name].runs])
    runs = run_table(sets, late).to_csv(index=False)
    write_text(given.out.parent / "tables" / "real-logs.csv", runs)
    write_text(given.out, page(sets, late, sliding(data)))
    print(given.out)


if __name__ == "__main__":
    main()
