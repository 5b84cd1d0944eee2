"""Trials with a known truth, written as loggers of one kind each write them: errors in std, kind by kind.

The trials are the samples (virtual), and those of another program where its folder is at hand. Each kind
changes what is logged and not the motion, so that the truth holds.

python -m benchmarks.field_kinds --draws 100 --jobs 2 [--kinds "256 counts;low-pass 5 Hz"] [--outside DIR]
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from zlib import crc32

import numpy as np
import pandas as pd

import granite_lab as gl
from benchmarks.command_line import parser_of
from benchmarks.field_loggers import KINDS, Array, Log
from benchmarks.outside import DEFAULT
from granite_lab.errors import LabError
from granite_lab.parameters import load_robot

SAMPLES = Path(__file__).parents[1] / "data" / "samples"
WHEELS = ("fl", "fr", "rl", "rr")
FORCE = ["imu_ax_mps2", "imu_ay_mps2", "imu_az_mps2"]
TURN = ["imu_gx_radps", "imu_gy_radps", "imu_gz_radps"]


@dataclass(frozen=True, eq=False)
class Truth:
    """True way of the body and of the wheels (K,) at stamps (K,) [s], [m]."""

    t: Array
    way: Array
    t_wheels: Array
    rolled: Array

    def slip(self, begin: float, end: float) -> float:
        """Return λ_R between two instants [s]."""
        way = float(np.diff(np.interp([begin, end], self.t, self.way))[0])
        return 1.0 - way / float(np.diff(np.interp([begin, end], self.t_wheels, self.rolled))[0])


def sources(outside: Path) -> list[Path]:
    """Return the trials that have a truth beside them."""
    return [*sorted(SAMPLES.glob("*.csv")), *sorted(outside.glob("*/trial_*.csv"))]


def read(path: Path) -> tuple[Log, Truth]:
    """Read a trial and its truth."""
    name = path.name
    folder = path.parent / "truth"
    if path.parent != SAMPLES:
        name = f"{path.parent.name}_{path.stem.removeprefix('trial_')}.csv"
        folder = path.parent.parent / "truth"
    frame, truth = (pd.read_csv(p, comment="#") for p in (path, folder / name))
    imu, wheels = frame.dropna(subset=FORCE), frame.dropna(subset=[f"enc_{w}_rad" for w in WHEELS])
    angle = wheels[[f"enc_{w}_rad" for w in WHEELS]].to_numpy()
    log = Log(
        imu["t_s"].to_numpy(), imu[FORCE].to_numpy(), imu[TURN].to_numpy(), wheels["t_s"].to_numpy(), angle,
        {"robot": "granite", "soil": "dry_sand"},
    )  # fmt: skip
    rolled = load_robot("granite").wheels.radius * angle.mean(axis=1)
    return log, Truth(truth["t_s"].to_numpy(), truth["x_m"].to_numpy(), log.t_wheels, rolled)


def text(log: Log) -> str:
    """Return the CSV."""
    imu = pd.DataFrame(np.column_stack([log.force, log.rate]), columns=[*FORCE, *TURN])
    imu["t_s"] = log.t
    wheels = pd.DataFrame(np.round(log.angle, log.digits), columns=[f"enc_{w}_{log.unit}" for w in WHEELS])
    wheels["t_s"] = log.t_wheels
    table = pd.concat([imu, wheels]).dropna(axis=1, how="all").sort_values("t_s", kind="stable")
    table = table[["t_s", *(c for c in table.columns if c != "t_s")]].round({"t_s": 6}).round(7)
    head = "".join(f"# {k} = {json.dumps(v)}\n" for k, v in log.head.items())
    return head + table.to_csv(index=False)


@dataclass(frozen=True)
class Judged:
    """One draw: grade, or "refused"; error and std of λ_R [-] and of the distance [m]; what was said."""

    kind: str
    draw: int
    source: str
    grade: str
    slip: float = math.nan
    slip_std: float = math.nan
    way: float = math.nan
    way_std: float = math.nan
    said: tuple[str, ...] = ()


def judge(kind: str, draw: int, outside: Path) -> Judged:
    """Write the log of a draw, estimate it, and compare with its truth."""
    rng = np.random.default_rng([draw, crc32(kind.encode())])
    paths = sources(outside)
    # the same trials for each kind, one in four a sample
    pick = np.random.default_rng(draw)
    path = paths[int(pick.integers(12 if pick.random() < 0.25 else len(paths)))]
    plain, truth = read(path)
    log = KINDS[kind](plain, rng)
    made = partial(Judged, kind, draw, f"{path.parent.name}/{path.stem}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "trial.csv"
        file.write_text(text(log))
        try:
            motion = gl.ingest(file)[0].motion
        except LabError as refusal:
            return made("refused", said=(str(refusal),))
    begin, end = ((x - log.origin) / log.pace for x in motion.steady)
    slip = motion.slip_ratio.value - truth.slip(begin, end)
    way = motion.distance.value - float(truth.way[-1] - truth.way[0])
    return made(
        motion.health.grade, slip, motion.slip_ratio.std, way, motion.distance.std,
        (motion.health.verdict, *motion.warnings),
    )  # fmt: skip


HEAD = (
    "| kind | n | good | fair | poor | refused | slip in 2 std | rms z | worst z | mean error [points] "
    "| median std [points] | way in 2 std | worst z |"
)


def row(name: str, of_kind: Sequence[Judged]) -> str:
    """Return the row of a kind."""
    usable = [j for j in of_kind if j.grade in ("good", "fair")]
    cells = [
        name,
        str(len(of_kind)),
        *(str(sum(j.grade == g for j in of_kind)) for g in ("good", "fair", "poor", "refused")),
    ]
    e = np.array([(j.slip, j.slip_std, j.way, j.way_std) for j in usable if math.isfinite(j.slip)]).reshape(
        -1, 4
    )
    if len(e):
        z, far = np.abs(e[:, 0] / e[:, 1]), np.abs(e[:, 2] / e[:, 3])
        cells += [
            f"{100 * np.mean(z <= 2):.0f} %", f"{np.sqrt(np.mean(z**2)):.2f}", f"{z.max():.1f}",
            f"{100 * np.mean(e[:, 0]):+.2f}", f"{100 * np.median(e[:, 1]):.2f}",
            f"{100 * np.mean(far <= 2):.0f} %", f"{far.max():.1f}",
        ]  # fmt: skip
    else:
        cells += [""] * 7
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Judge draws and print the counts."""
    parser = parser_of(__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--kinds", default="", help="names, or beginnings of names, with ; between")
    parser.add_argument("--outside", type=Path, default=DEFAULT)
    parser.add_argument("--out", type=Path, help="write each draw as a line of JSON")
    args = parser.parse_args()
    wanted = [k.strip() for k in args.kinds.split(";") if k.strip()]
    kinds = [k for k in KINDS if not wanted or any(k.startswith(w) for w in wanted)]
    print(HEAD)
    print("|---" * (HEAD.count("|") - 1) + "|", flush=True)
    with ProcessPoolExecutor(args.jobs) as pool:
        futures = {
            k: [pool.submit(judge, k, d, args.outside) for d in range(args.first, args.first + args.draws)]
            for k in kinds
        }
        everything = []
        for kind, of_kind in futures.items():
            judged = [future.result() for future in of_kind]
            everything += judged
            print(row(kind, judged), flush=True)
    if args.out:
        args.out.write_text("".join(json.dumps(asdict(j)) + "\n" for j in everything))


if __name__ == "__main__":
    main()
