"""Trials of another program as a different logger would have written them: what is hidden stays the same.

Each variant changes the logs and not the motion, so that the answers hold. `benchmarks.outside` judges the
folder that is written.

``python -m benchmarks.outside_variants OUT [DIR] [--sets o01,o03] [--variants short,late]``
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from benchmarks.command_line import parser_of
from benchmarks.outside import DEFAULT
from granite_lab.files import write_text

IMU = [f"imu_{what}" for what in ("ax_mps2", "ay_mps2", "az_mps2", "gx_radps", "gy_radps", "gz_radps")]
WHEELS = ("fl", "fr", "rl", "rr")

Change = Callable[[pd.DataFrame, np.random.Generator], pd.DataFrame]


def of_imu(log: pd.DataFrame) -> npt.NDArray[Any]:
    """Return which rows are the IMU's."""
    return np.asarray(log[IMU[0]].notna())


def short(log: pd.DataFrame, _: np.random.Generator) -> pd.DataFrame:
    """End the log 0.4 s after the wheels have stopped."""
    wheels = log[[f"enc_{w}_rad" for w in WHEELS]].dropna()
    away = (wheels - wheels.iloc[-1]).abs().max(axis=1)
    stop = log.loc[away[away > 0.002 * wheels.iloc[-1].abs().max()].index[-1], "t_s"]
    return log.loc[log["t_s"] <= float(stop) + 0.4]


def late(log: pd.DataFrame, _: np.random.Generator) -> pd.DataFrame:
    """Stamp the IMU 7 ms later than it was, as a filter in it would."""
    out = log.copy()
    out.loc[of_imu(log), "t_s"] += 0.007
    return out.sort_values("t_s")


def slow(log: pd.DataFrame, _: np.random.Generator) -> pd.DataFrame:
    """Leave every second reading of the IMU, averaged with the one before it."""
    imu, rest = log[of_imu(log)], log[~of_imu(log)]
    n = len(imu) // 2 * 2
    half = imu.iloc[1:n:2].copy()
    half[IMU] = (imu[IMU].to_numpy()[0:n:2] + imu[IMU].to_numpy()[1:n:2]) / 2
    half["t_s"] = (imu["t_s"].to_numpy()[0:n:2] + imu["t_s"].to_numpy()[1:n:2]) / 2
    return pd.concat([half, rest]).sort_values("t_s")


def noisy(log: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Add white noise of a cheap IMU: 0.1 m/s² and 5 mrad/s a reading."""
    out = log.copy()
    here = of_imu(log)
    noise = rng.normal(size=(int(here.sum()), 6)) * ([0.1] * 3 + [0.005] * 3)
    out.loc[here, IMU] = out.loc[here, IMU].to_numpy() + noise
    return out


def counted(log: pd.DataFrame, counts: int, whole: Callable[[Any], Any]) -> pd.DataFrame:
    """Count the wheels in steps of a turn; `whole` returns whole steps."""
    out, step = log.copy(), 2 * np.pi / counts
    for wheel in WHEELS:
        out[f"enc_{wheel}_rad"] = whole(out[f"enc_{wheel}_rad"] / step) * step
    return out


def coarse(log: pd.DataFrame, _: np.random.Generator) -> pd.DataFrame:
    """Count the wheels in steps of 1/2000 of a turn."""
    return counted(log, 2000, np.floor)


def counts(log: pd.DataFrame, _: np.random.Generator) -> pd.DataFrame:
    """Round the wheels' angles to 1/1024 of a turn."""
    return counted(log, 1024, np.round)


def low_pass(log: pd.DataFrame, _: np.random.Generator) -> pd.DataFrame:
    """Pass the IMU through a first-order low-pass of 15 Hz, whose input is linear between readings."""
    out = log.copy()
    here = of_imu(log)
    x, t = log.loc[here, IMU].to_numpy(), log.loc[here, "t_s"].to_numpy()
    tau = 1 / (2 * np.pi * 15.0)
    y = x.copy()
    for k in range(1, len(t)):
        h = max((t[k] - t[k - 1]) / tau, 1e-9)
        lag = (x[k] - x[k - 1]) / h  # of the output behind an input with this slope
        y[k] = x[k] - lag + (y[k - 1] - x[k - 1] + lag) * np.exp(-h)
    out.loc[here, IMU] = y
    return out


def reversed_wheel(log: pd.DataFrame, _: np.random.Generator) -> pd.DataFrame:
    """Count one wheel in the other direction."""
    out = log.copy()
    out["enc_rr_rad"] *= -1
    return out


def no_currents(log: pd.DataFrame, _: np.random.Generator) -> pd.DataFrame:
    """Leave the currents out."""
    return log.drop(columns=[f"cur_{wheel}_A" for wheel in WHEELS])


def gains(log: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Let the accelerometer read 1 % too much and each current another 3 %."""
    out = log.copy()
    out[IMU[:3]] *= 1.01
    for wheel in WHEELS:
        out[f"cur_{wheel}_A"] *= 1 + 0.03 * rng.normal()
    return out


def gaps(log: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Lose 2 % of all rows, and 60 ms of the IMU once."""
    start = rng.uniform(log["t_s"].iloc[0], log["t_s"].iloc[-1])
    lost = of_imu(log) & log["t_s"].between(start, start + 0.06)
    return log[(rng.random(len(log)) > 0.02) & ~lost]


def spikes(log: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Put three readings of the IMU and two of an encoder far off."""
    out = log.copy()
    for row in rng.choice(log.index[of_imu(log)], 3, replace=False):
        out.loc[row, IMU[int(rng.integers(6))]] += 30.0
    for row in rng.choice(log.index[~of_imu(log)], 2, replace=False):
        out.loc[row, "enc_fl_rad"] += 5.0
    return out


def unchanged(log: pd.DataFrame, _: np.random.Generator) -> pd.DataFrame:
    """Change nothing: fewer trials are all that differs."""
    return log


VARIANTS: dict[str, tuple[Change, Callable[[str], bool]]] = {
    **{
        change.__name__: (change, bool)
        for change in (
            short,
            late,
            slow,
            noisy,
            coarse,
            counts,
            low_pass,
            reversed_wheel,
            no_currents,
            gains,
            gaps,
            spikes,
        )
    },
    "two_repetitions": (unchanged, lambda key: not key.endswith("_3")),
    "three_speeds": (unchanged, lambda key: not key.startswith("0.3")),
}
"""Name of a variant to what changes a log, and which trials are kept."""


def write(source: Path, target: Path, change: Change, rng: np.random.Generator) -> None:
    """Write one log anew, with the header that it has."""
    header = [line for line in source.read_text().splitlines() if line.startswith("#")]
    log = change(pd.read_csv(source, comment="#"), rng)
    write_text(target, "\n".join(header) + "\n" + log.to_csv(index=False, float_format="%.9g"))


def main() -> None:
    """Write the variants of the sets, and the answers."""
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("folder", type=Path, nargs="?", default=DEFAULT)
    parser.add_argument("--sets", default="", help="names of sets, with commas between")
    parser.add_argument("--variants", default=",".join(VARIANTS), help=f"of {', '.join(VARIANTS)}")
    options = parser.parse_args()
    answers = json.loads((options.folder / "answers.json").read_text(encoding="utf-8"))
    wanted = [v for v in options.variants.split(",") if v]
    if unknown := [v for v in wanted if v not in VARIANTS]:
        sys.exit(f"error: no variant is called {', '.join(unknown)}\nhint: known: {', '.join(VARIANTS)}")
    told = {}
    for name in [s for s in options.sets.split(",") if s] or list(answers):
        for variant in wanted:
            change, kept = VARIANTS[variant]
            rng = np.random.default_rng([int(name[1:]), list(VARIANTS).index(variant)])
            (options.out / f"{name}_{variant}").mkdir(parents=True, exist_ok=True)
            for source in sorted((options.folder / name).glob("trial_*.csv")):
                if kept(source.stem.removeprefix("trial_")):
                    write(source, options.out / f"{name}_{variant}" / source.name, change, rng)
            told[f"{name}_{variant}"] = answers[name]
    write_text(options.out / "answers.json", json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
