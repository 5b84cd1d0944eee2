"""Velocity, distance and slip ratio against the true motion of trials that another program made.

A folder holds the logs as ``<set>/trial_<key>.csv`` and the true motion as ``truth/<set>_<key>.csv`` with the
columns t_s, x_m, v_mps, slip_f and slip_b.

``python -m benchmarks.outside_motion [DIR] [--out docs/estimation-outside.md]``
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from zlib import crc32

import numpy as np

from benchmarks.against_truth import Array
from benchmarks.blind_code import commit
from benchmarks.chance import coverages
from benchmarks.command_line import parser_of
from benchmarks.outside import DEFAULT
from granite_lab.estimation.chain import finish, solve
from granite_lab.files import write_text
from granite_lab.logs import read_trial
from granite_lab.parameters import load_robot, load_soil

STARTS = 1e-3
"""Speed from which the robot moves, by the truth [m/s]."""

AFTER = 0.5
"""Time after the stop that still counts as motion [s]."""

DRAWS = 400
"""Draws of the errors of each trial."""

WIDE, NARROW = 0.98, 0.9
"""Aims: largest and least share of samples within ±2σ in each set."""

PHASES = ("gaining speed", "steady", "braking", "after the stop")

RMSE_AIM, SLIP_AIM = 6e-3, 0.01
"""Aims: largest RMSE of the velocity [m/s] and largest error of λ_R [-]."""


@dataclass(frozen=True)
class Judged:
    """One trial against its truth.

    Attributes:
        name: of its set.
        rmse: of the velocity in motion [m/s].
        inside: share of the samples in motion within ±2σ.
        nees: mean square of the errors of the velocity over their std.
        phases: the same and the share within ±2σ in each of `PHASES`.
        distance: relative error; `distance_inside`: within ±2σ.
        slip, slip_std: error of λ_R in the steady part, and its std.
        grade: of the estimate.
        chance: (DRAWS,) `inside` of errors drawn from the posterior of the smoother.
    """

    name: str
    rmse: float
    inside: float
    nees: float
    phases: tuple[tuple[float, float], ...]
    distance: float
    distance_inside: bool
    slip: float
    slip_std: float
    grade: str
    chance: Array


def judged(log: Path) -> Judged:
    """Estimate a trial and compare it with the truth."""
    trial = read_trial(log)
    robot = load_robot(trial.info.robot or "granite")
    solution = solve(trial, robot, soil=load_soil())
    _, motion = finish(trial, robot, solution)
    name = f"{log.parent.name}_{log.stem.removeprefix('trial_')}.csv"
    truth = np.genfromtxt(log.parent.parent / "truth" / name, delimiter=",", names=True)
    t, x, v = truth["t_s"], truth["x_m"], truth["v_mps"]
    moving = t[np.abs(v) > STARTS]
    at = (motion.t > moving[0]) & (motion.t < moving[-1] + AFTER)
    error = motion.v - np.interp(motion.t, t, v)
    over = error / motion.v_std
    steady = motion.t[np.array(motion.phase) == "steady"]
    edges = (moving[0], steady[0], steady[-1], moving[-1], moving[-1] + AFTER)
    parts = [over[(motion.t > a) & (motion.t < b)] for a, b in pairwise(edges)]
    error, over = error[at], over[at]
    wheels = v / (1 - 0.5 * (truth["slip_f"] + truth["slip_b"]))
    rolled = np.concatenate([[0.0], np.cumsum(0.5 * (wheels[1:] + wheels[:-1]) * np.diff(t))])
    (x0, x1), (r0, r1) = (np.interp(motion.steady, t, way) for way in (x, rolled))
    slip = motion.slip_ratio.value - (1 - (x1 - x0) / (r1 - r0))
    way = motion.distance.value - (x[-1] - x[0])
    return Judged(
        log.parent.name,
        float(np.sqrt(np.mean(error**2))),
        float(np.mean(np.abs(over) < 2)),
        float(np.mean(over**2)),
        tuple((float(np.mean(z**2)), float(np.mean(np.abs(z) < 2))) for z in parts),
        float(way / (x[-1] - x[0])),
        bool(abs(way) < 2 * motion.distance.std),
        float(slip),
        motion.slip_ratio.std,
        motion.health.grade,
        coverages(motion, solution, at, DRAWS, np.random.default_rng(crc32(name.encode()))),
    )


HEAD = (
    "set", "trials", "rmse_median_mmps", "rmse_largest_mmps", "above_6_mmps", "inside_percent",
    "inside_by_chance_from_percent", "inside_by_chance_to_percent", "nees",
    "distance_rms_percent", "distance_inside_percent", "slip_mean_points", "slip_mean_absolute_points",
    "slip_within_1_point_percent", "slip_inside_percent", "good",
)  # fmt: skip


def by_chance(trials: Sequence[Judged]) -> Array:
    """(DRAWS,) share of the samples within ±2σ over some trials, were the filter's model exact."""
    return np.asarray(np.mean([j.chance for j in trials], axis=0))


def row(name: str, trials: Sequence[Judged]) -> list[str]:
    """Return a row of the table, in the order of `HEAD`."""
    rmse = np.array([j.rmse for j in trials]) * 1e3
    slip, way = (np.array([getattr(j, n) for j in trials]) * 100 for n in ("slip", "distance"))
    return [
        name, str(len(trials)), f"{np.median(rmse):.1f}", f"{rmse.max():.1f}",
        str(int((rmse > 1e3 * RMSE_AIM).sum())),
        f"{100 * np.mean([j.inside for j in trials]):.1f}",
        *(f"{100 * x:.1f}" for x in np.quantile(by_chance(trials), (0.025, 0.975))),
        f"{np.mean([j.nees for j in trials]):.2f}",
        f"{np.sqrt(np.mean(way**2)):.2f}", f"{100 * np.mean([j.distance_inside for j in trials]):.0f}",
        f"{slip.mean():+.2f}", f"{np.abs(slip).mean():.2f}",
        f"{100 * np.mean(np.abs(slip) < 100 * SLIP_AIM):.0f}",
        f"{100 * np.mean([abs(j.slip) < 2 * j.slip_std for j in trials]):.0f}",
        str(sum(j.grade == "good" for j in trials)),
    ]  # fmt: skip


def by_set(trials: Sequence[Judged]) -> str:
    """Return a row for each set, as CSV."""
    names = list(dict.fromkeys(j.name for j in trials))
    rows = [HEAD, *(row(n, [j for j in trials if j.name == n]) for n in names)]
    return "".join(f"{','.join(cells)}\n" for cells in rows)


def page(trials: Sequence[Judged]) -> str:
    """Return the page."""
    names = list(dict.fromkeys(j.name for j in trials))
    sets = [[j for j in trials if j.name == n] for n in names]
    inside, drawn = [np.mean([j.inside for j in one]) for one in sets], np.array([by_chance(s) for s in sets])
    wide, narrow = sum(c > WIDE for c in inside), sum(c < NARROW for c in inside)
    low, high = np.quantile(drawn, (0.025, 0.975), axis=1)
    usual = sum(a <= c <= b for c, a, b in zip(inside, low, high, strict=True))
    within = (drawn >= NARROW) & (drawn <= WIDE)
    phases = np.mean([j.phases for j in trials], axis=0)
    known = np.mean([math.erf(SLIP_AIM / j.slip_std / math.sqrt(2.0)) for j in trials])
    f = dict(zip(HEAD, row("all", trials), strict=True))
    return f"""# Estimation on trials of another program

* **Velocity.** The RMSE is {f["rmse_median_mmps"]} mm/s (median of {f["trials"]} trials). It exceeds
  {1e3 * RMSE_AIM:g} mm/s in {f["above_6_mmps"]} trials; the aim is one in twenty.
* **Uncertainty.** {f["inside_percent"]} % of the samples in motion lie within ±2σ; the NEES is {f["nees"]}.
  With exact std, chance gives {f["inside_by_chance_from_percent"]} to {f["inside_by_chance_to_percent"]} %
  (95 % of {DRAWS} draws from the posterior of the smoother). {wide} of {len(names)} sets are above the aim
  of 90 to 98 %, {narrow} below. With exact std {100 * np.mean(drawn > WIDE):.0f} % are above and
  {100 * np.mean(drawn < NARROW):.0f} % below, because the errors of a trial correlate; all sets meet it in
  {100 * np.mean(within.all(axis=0)):.0f} % of the draws. {usual} of {len(names)} sets are inside their range.
* **Slip ratio λ_R of the steady part.** The error is below 1 point in
  {f["slip_within_1_point_percent"]} % of the trials ({100 * known:.0f} % by the stated std) and within ±2σ in
  {f["slip_inside_percent"]} %. Its mean is {f["slip_mean_points"]} points.
* **Distance.** The rms error is {f["distance_rms_percent"]} %;
  {f["distance_inside_percent"]} % of the errors are within ±2σ.
* **Verdict.** {f["good"]} of {f["trials"]} estimates are *good*.

These figures are not blind: the sets were used for development. [Each set](tables/estimation-outside.csv).

| | {" | ".join(PHASES)} |
| --- |{" ---: |" * len(PHASES)}
| NEES | {" | ".join(f"{x:.2f}" for x in phases[:, 0])} |
| in 2σ [%] | {" | ".join(f"{100 * x:.1f}" for x in phases[:, 1])} |

While the speed changes, the std allows for a delay of some milliseconds between the sensors.

The virtual trials come from a simulator and a sensor model that share no code with this project.
`python -m benchmarks.outside_motion DIR --out docs/estimation-outside.md` writes this page; code {commit()}.
"""


def main() -> None:
    """Judge all trials of a folder, and print or write the page."""
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=DEFAULT)
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, help="write the page here")
    options = parser.parse_args()
    logs = sorted(p for p in options.folder.glob("*/trial_*.csv"))
    if not logs or not (options.folder / "truth").is_dir():
        sys.exit(f"error: {options.folder}: holds no trials with a folder 'truth'\nhint: see the docstring")
    with ProcessPoolExecutor(options.jobs) as pool:
        trials = list(pool.map(judged, logs))
    text = page(trials)
    if options.out is not None:
        write_text(options.out.parent / "tables" / "estimation-outside.csv", by_set(trials))
        write_text(options.out, text)
    else:
        print(text)


if __name__ == "__main__":
    main()
