"""Estimates of logs as field loggers write them, judged by their truth: counts for docs/reliability.md.

python -m benchmarks.field --draws 320 --jobs 2
"""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

import granite_lab as gl
from benchmarks.command_line import parser_of
from granite_lab.errors import LabError
from tests.truth import field

PAGE = Path(__file__).parents[1] / "docs" / "reliability.md"
BEGIN, END = "<!-- field: begin -->", "<!-- field: end -->"


@dataclass(frozen=True)
class Judged:
    """One draw.

    Attributes:
        seed: of the draw.
        fast: made from a sample, with its IMU at 50 Hz or more.
        drawn: what was drawn.
        grade: "good", "fair", "poor", or "refused".
        message: verdict or refusal.
        slip, slip_std: error of the slip ratio [-] and its std; NaN where there is none.
        distance, distance_std: the same of the distance [m]; NaN where the log was cut, too.
    """

    seed: int
    fast: bool
    drawn: dict[str, object]
    grade: str
    message: str
    slip: float = math.nan
    slip_std: float = math.nan
    distance: float = math.nan
    distance_std: float = math.nan

    def of(self, index: int) -> tuple[tuple[float, float], ...]:
        """Return (error, std) of the slip ratio (0) or the distance (1), nothing where it is not known."""
        error, std = ((self.slip, self.slip_std), (self.distance, self.distance_std))[index]
        return ((error, std),) if math.isfinite(error) else ()

    @property
    def usable(self) -> bool:
        """Whether the tool calls it good or fair."""
        return self.grade in ("good", "fair")


def judge(seed: int) -> Judged:
    """Write the log of a draw, estimate it, and compare with its truth."""
    log = field.draw(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trial.csv"
        path.write_text(log.text)
        robot = None
        if log.robot is not None:
            robot = Path(folder) / "robot.toml"
            robot.write_text(log.robot)
        made = partial(Judged, seed, log.sample and log.imu_rate >= 49.0, log.drawn)
        try:
            motion = gl.ingest(path, robot=robot)[0].motion
        except LabError as refusal:
            return made("refused", str(refusal))
    # of a log that was cut, as a warning says, the distance is that of one stretch, whose truth is not known
    cut = any("the log is cut there" in line for line in motion.warnings)
    return made(
        motion.health.grade, motion.health.verdict,
        slip=motion.slip_ratio.value - log.slip, slip_std=motion.slip_ratio.std,
        distance=math.nan if cut else motion.distance.value - log.distance, distance_std=motion.distance.std,
    )  # fmt: skip


def table(judged: Sequence[Judged]) -> str:
    """Return the counts as a Markdown table."""
    rows = [
        "| draws | | good or fair | inside 2 std | beyond 4 std | median std / rms error |",
        "|---|---|---|---|---|---|",
    ]
    groups = {
        "all": judged,
        "samples": [j for j in judged if j.drawn.get("sample")],
        "samples, IMU at 50 Hz or more": [j for j in judged if j.fast],
        "drives by formula": [j for j in judged if not j.drawn.get("sample")],
    }
    for name, of_group in groups.items():
        usable = [j for j in of_group if j.usable]
        for what, index in (("slip ratio", 0), ("distance", 1)):
            pairs = np.array([e for j in usable for e in j.of(index)]).reshape(-1, 2)
            if not len(pairs):
                continue
            size = np.abs(pairs[:, 0])
            inside, beyond = int(np.sum(size <= 2 * pairs[:, 1])), int(np.sum(size > 4 * pairs[:, 1]))
            ratio = float(np.median(pairs[:, 1]) / np.sqrt(np.mean(size**2)))
            rows.append(
                f"| {name} | {what} | {len(usable)} of {len(of_group)} | {inside} of {len(pairs)} "
                f"({100 * inside / len(pairs):.0f} %) | {beyond} | {ratio:.2f} |"
            )
    return "\n".join(rows)


def main() -> None:
    """Judge draws and write the counts."""
    parser = parser_of(__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--draws", type=int, default=320)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--page", action="store_true", help="write the counts into docs/reliability.md")
    parser.add_argument("--out", type=Path, help="write each draw as a line of JSON")
    args = parser.parse_args()
    seeds = range(args.first, args.first + args.draws)
    with ProcessPoolExecutor(args.jobs) as pool:
        judged = list(pool.map(judge, seeds))
    if args.out:
        args.out.write_text("".join(json.dumps(asdict(one)) + "\n" for one in judged))
    counts = table(judged)
    print(counts)
    for one in judged:
        worst = max((abs(e) / s for e, s in (*one.of(0), *one.of(1)) if s > 0), default=0.0)
        if one.usable and worst > 3:
            print(f"seed {one.seed}: {worst:.1f} std, {one.grade}, {one.drawn}")
    if args.page:
        text = re.sub(f"{BEGIN}.*{END}", f"{BEGIN}\n{counts}\n{END}", PAGE.read_text(), flags=re.DOTALL)
        PAGE.write_text(text)


if __name__ == "__main__":
    main()
