"""Small virtual logs as text, with nothing but arithmetic behind them."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from granite_lab.logs import inspect_logs, read_trial
from granite_lab.logs.trial import Trial

IMU = [f"imu_{kind}" for kind in ("ax_mps2", "ay_mps2", "az_mps2", "gx_radps", "gy_radps", "gz_radps")]
WHEELS = [f"enc_{wheel}_rad" for wheel in ("fl", "fr", "rl", "rr")]
COLUMNS = ["t_s", *IMU, *WHEELS]
HEADER = ",".join(COLUMNS)
RADIUS = 0.0965
STREAMS = {
    "imu": ("t", "specific_force", "angular_rate"), "wheels": ("t", "angle"), "currents": ("t", "current"),
    "reference_v": ("t", "value"),
}  # fmt: skip


def rows(duration: float = 6.0, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps (N,), IMU (N, 6) and wheel angles (N, 4) of a drive over a gently rolling floor.

    At 0.3 m/s and 1.2 m/s^2 from 1 to 5 s, with a slip of 10 %, at 100 Hz.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(int(duration * 100)) / 100
    v = np.clip(np.minimum(1.2 * (t - 1.0), 1.2 * (5.0 - t)), 0.0, 0.3)
    pitch = 0.02 * np.sin(2 * np.pi * 0.4 * np.clip(t - 1, 0, 4)) * (v > 0)
    force = np.column_stack(
        [np.gradient(v, t) + 9.81 * np.sin(pitch), np.zeros_like(t), 9.81 * np.cos(pitch)]
    ) + rng.normal(0, 0.02, (len(t), 3))
    turn = np.column_stack([np.zeros_like(t), np.gradient(-pitch, t), np.zeros_like(t)])
    turn = turn + rng.normal(0, 5e-4, (len(t), 3))
    angle = np.cumsum(v) / 100 / 0.9 / RADIUS
    return t, np.hstack([force, turn]), np.repeat(angle[:, None], 4, axis=1)


def lines(**options: float) -> list[str]:
    """Return the lines of a canonical log, the header first."""
    t, imu, wheels = rows(**options)
    table = np.column_stack([t, imu, wheels])
    return [HEADER, *(",".join(f"{value:.9g}" for value in row) for row in table)]


@cache
def text(**options: float) -> str:
    """Return a canonical log."""
    return "\n".join(lines(**options)) + "\n"


def only(*names: str, change: Callable[[list[str]], list[str]] = lambda row: row) -> str:
    """Return some columns of the log, each row of cells changed."""
    keep = [COLUMNS.index(name) for name in names]
    header, *data = ([line.split(",")[i] for i in keep] for line in lines())
    return "\n".join(",".join(row) for row in [header, *map(change, data)]) + "\n"


def written(folder: Path, content: str | bytes, name: str = "trial.csv") -> Path:
    """Write a file into a folder, which is made."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@cache
def plain() -> Trial:
    """Return the trial of a canonical log."""
    with TemporaryDirectory() as folder:
        return read(Path(folder), text(), "plain.csv")


def read(folder: Path, content: str | bytes, name: str = "trial.csv", **options: Any) -> Trial:
    """Write a log and read it."""
    return read_trial(written(folder, content, name), **options)


def changed(folder: Path, sample: Path, change: Callable[[pd.DataFrame], pd.DataFrame | None]) -> Path:
    """Write a log whose table was changed, in place or into another; what stands above it stays."""
    head = [line for line in sample.read_text(encoding="utf-8").splitlines(True) if line.startswith("#")]
    table = pd.read_csv(sample, comment="#")
    other = change(table)
    return written(folder, "".join(head) + (table if other is None else other).to_csv(index=False))


def converted(table: pd.DataFrame, prefix: str, factor: float, suffix: str | None = None) -> pd.DataFrame:
    """Multiply the columns that begin with `prefix`; the unit in their name becomes `suffix`, if given.

    Without `suffix` the name lies about the unit, as after a mistake in the logger's settings.
    """
    names = [name for name in table if name.startswith(prefix)]
    table[names] *= factor
    return table.rename(columns={n: f"{n.rpartition('_')[0]}_{suffix}" for n in names if suffix})


def mapped(folder: Path, path: Path, **options: Any) -> Trial:
    """Read a log by the map that its inspection writes, which goes into a folder."""
    chart = written(folder, inspect_logs([path]).to_map_toml(), "map.toml")
    return read_trial(path, map=chart, **options)


def same(one: Any, other: Any, rtol: float = 0.0, atol: float = 0.0) -> None:
    """Hold what two trials logged to be the same."""
    for stream, names in STREAMS.items():
        a, b = (getattr(trial, stream) for trial in (one, other))
        assert (a is None) == (b is None), stream
        for name in names if a else ():
            np.testing.assert_allclose(
                getattr(a, name), getattr(b, name), rtol=rtol, atol=atol, err_msg=f"{stream}.{name}"
            )
