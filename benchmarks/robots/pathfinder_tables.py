"""Save the log of the rover Pathfinder, a MATLAB file of version 7.3, as CSV tables; needs h5py.

``python benchmarks/robots/pathfinder_tables.py test17run.mat FOLDER/pathfinder``
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np

EPOCH, STEP = 0.1, 0.072
"""Time between two epochs of the GPS [s], and the way in that time at the rover's one speed [m]."""


def main(log: Path, folder: Path) -> None:
    """Write imu.csv, wheels.csv and gps.csv."""
    folder.mkdir(parents=True, exist_ok=True)

    def write(name: str, columns: dict[str, np.ndarray]) -> None:
        values, header = np.stack(list(columns.values()), axis=1), ",".join(columns)
        np.savetxt(folder / f"{name}.csv", values, fmt="%.9f", delimiter=",", header=header, comments="")

    with importlib.import_module("h5py").File(log) as file:
        held = {name: np.asarray(file[name]).squeeze() for name in file if not name.startswith("#")}
    sides = [f"{end}{side}Vel" for end in ("front", "rear") for side in ("Left", "Right")]
    write("imu", {"t": held["tTimu"]} | {name: held[name] for name in ("Ax", "Ay", "Az", "Gx", "Gy", "Gz")})
    write("wheels", {"t": held["tTodom"]} | {name: held[name] for name in sides})
    east, north = held["ENUGPS"][:, :2].T
    # a step of twice the length is a lost epoch, which the file's count of rows passes over
    epochs = np.maximum(np.round(np.hypot(np.diff(east), np.diff(north)) / STEP), 1)
    t = held["tTodom"][0] + EPOCH * np.concatenate([[0], np.cumsum(epochs)])
    write("gps", {"t": t, "east": east, "north": north})


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
