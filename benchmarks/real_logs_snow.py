"""A rover on snow, slip up to 100 %: the estimate against the velocity of its inertial navigation.

The data are those of A. Lines' thesis (GitHub, austinlines/PhD, `ImmobilizationDetection/event_*.mat`);
they come without a licence and are not kept here.

``python -m benchmarks.real_logs_snow FOLDER [--out docs/estimation-snow.md]``
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from granite_lab.errors import LabError
from granite_lab.estimation import estimate
from granite_lab.logs.trial import Array, ImuStream, Trial, TrialInfo, WheelStream
from granite_lab.parameters import load_robot

RADIUS = 0.267
"""Wheel radius that the data's own slip ratios and velocities go with [m]."""

STANDS = 0.1
"""Below this the reference is noise [m/s]; a standstill is named from its last sample on."""

SHORTEST = 0.45
"""A run whose ends do not stand for so long is left to the wheels [s]."""

REFERENCE_STD = 0.03
"""Scatter of the reference at rest [m/s]."""


@dataclass(frozen=True, eq=False)
class Run:
    """One run at the IMU's stamps (N): error of the estimate, its std, the wheels' error, true slip."""

    name: str
    rests: int
    error: Array
    std: Array
    wheels: Array
    slip: Array


def read(path: Path) -> tuple[Trial, Array, list[tuple[float, float]]]:
    """Return a run's trial, the reference velocity at its stamps [m/s] and the standstills by it [s]."""
    event = loadmat(path, squeeze_me=True, struct_as_record=False)["e"]

    def columns(*names: str) -> Array:
        return np.stack([np.asarray(getattr(event, name), dtype=float) for name in names], axis=1)

    t, v = (np.asarray(getattr(event, name), dtype=float) for name in ("t", "v_X"))
    keep = np.concatenate([[True], np.diff(t) > 0])
    t, v = t[keep], v[keep]
    # the column of the x axis holds the pitch rate: it is the derivative of the logged pitch to 0.9
    force = columns("a_X", "a_Y", "a_Z")[keep]
    rate = columns("angAccel_Y", "angAccel_X", "angAccel_Z")[keep]
    turning = columns("wfl", "wfr", "wrl", "wrr")[keep]
    angle = np.cumsum(turning * np.diff(t, prepend=t[0])[:, None], axis=0)
    low = np.abs(v) < STANDS
    first, last = int(np.argmax(~low)), t.size - int(np.argmax(~low[::-1]))
    rests = [(float(t[0]), float(t[max(first - 1, 0)])), (float(t[min(last, t.size - 1)]), float(t[-1]))]
    trial = Trial(
        name=path.stem.removeprefix("event_"), info=TrialInfo(), imu=ImuStream(t, force, rate),
        wheels=WheelStream(t, angle, rate=turning),
    )  # fmt: skip
    return trial, v, [(a, b) for a, b in rests if b - a > SHORTEST]


def judge_run(path: Path, *, named: bool) -> Run:
    """Estimate a run, with its standstills named or not."""
    trial, v, rests = read(path)
    husky = load_robot("husky")
    robot = replace(husky, wheels=replace(husky.wheels, radius=RADIUS))
    motion = estimate(trial, robot, rests=rests if named else [])
    assert trial.wheels is not None
    assert trial.wheels.rate is not None
    truth = np.interp(motion.t, trial.wheels.t, v)
    rolled = np.interp(motion.t, trial.wheels.t, RADIUS * trial.wheels.rate.mean(axis=1))
    std = np.hypot(motion.v_std, REFERENCE_STD)
    slip = 1.0 - truth / np.maximum(rolled, 0.05)
    return Run(trial.name, len(rests) if named else 0, motion.v - truth, std, rolled - truth, slip)


def line(name: str, runs: list[Run]) -> str:
    """Return one row of the table for some runs together."""
    error, std, wheels, slip = (
        np.concatenate([getattr(run, what) for run in runs]) for what in ("error", "std", "wheels", "slip")
    )
    inside, high = np.abs(error) < 2.0 * std, slip > 0.4
    rms, alone = (float(np.sqrt(np.mean(values**2))) for values in (error, wheels))
    above = f"{100 * np.mean(inside[high]):.0f}" if high.any() else "–"
    return f"| {name} | {error.size} | {rms:.3f} | {alone:.3f} | {100 * np.mean(inside):.0f} | {above} |"


def page(folder: Path) -> str:
    """Return the page: runs with both standstills named, and all of them with none named."""
    files = sorted(folder.glob("event_*.mat"))
    head = (
        "| run | samples | estimate: RMSE [m/s] | wheels: RMSE [m/s] | 2σ coverage [%] "
        "| above 40 % slip [%] |"
    )
    rows: dict[bool, list[Run]] = {True: [], False: []}
    refused = []
    for path in files:
        for named in (True, False):
            try:
                run = judge_run(path, named=named)
            except LabError as refusal:
                refused.append(f"* {path.stem}: {refusal.message}")
                continue
            if not named or run.rests == 2:
                rows[named].append(run)
    text = [
        "# A rover on snow", "",
        "A four-wheeled rover in straight runs on snow, drawn back until it is stuck: slip up to 100 %, IMU",
        "and wheels at 10 Hz, against the velocity of its inertial navigation (A. Lines, thesis; GitHub,",
        "austinlines/PhD). The data come without a licence and are not kept here; written by",
        "`python -m benchmarks.real_logs_snow FOLDER`. By hand: which gyro measures pitch, the wheel radius,",
        "and the standstills of the body, in which the wheels spin. They were taken from the reference.",
        f"Coverage allows for {REFERENCE_STD:g} m/s of scatter of the reference.", "",
        "## Both standstills named", "", head, "|---|---|---|---|---|---|",
    ]  # fmt: skip
    text += [line(run.name, [run]) for run in rows[True]]
    for start in ("1", "2"):
        group = [run for run in rows[True] if run.name.startswith(start)]
        if group:
            text.append(line(f"**all {start}_***", group))
    text += ["", "## None named", "", head, "|---|---|---|---|---|---|"]
    text += [line(run.name, [run]) for run in rows[False]]
    if rows[False]:
        text.append(line("**all**", rows[False]))
    text += [
        "", "Without a standstill the estimate leans on the wheels and an assumed slip of 3 ± 15 %, which is",
        "not enough here: the std is too small above 40 % slip. Name the standstills.",
    ]  # fmt: skip
    return "\n".join(text + (["", "## Refused", "", *refused] if refused else [])) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/estimation-snow.md"))
    given = parser.parse_args()
    given.out.write_text(page(given.folder), encoding="utf-8")
