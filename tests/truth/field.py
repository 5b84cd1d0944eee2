"""Logs as field loggers write them, with their truth: drawn encoders, rates, roundings, batches and clocks.

Half of the draws rewrite a sample trial (virtual, its truth beside it), half are drives by formula: a robot
on firm ground whose slip ratio is constant and whose IMU has white noise in motion. Nothing of the package
that is judged makes them.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

Array = npt.NDArray[np.float64]

SAMPLES = sorted((Path(__file__).parents[2] / "data" / "samples").glob("*.csv"))

FORCE = ["imu_ax_mps2", "imu_ay_mps2", "imu_az_mps2"]
TURN = ["imu_gx_radps", "imu_gy_radps", "imu_gz_radps"]
WHEELS = ("fl", "fr", "rl", "rr")

RADIUS = 0.165
ROBOT = f"""name = "field_rover"
title = "an outdoor robot, wheels of 0.165 m"
[wheels]
radius_m = {RADIUS}
[imu]
grade = "consumer"
x_m = 0.0
z_m = 0.0
"""
"""Robot of the drives by formula."""


@dataclass(frozen=True, eq=False)
class FieldLog:
    """A log and what is true of it.

    Attributes:
        text: of the CSV file.
        robot: text of the robot's file; None where the log names one of the catalogue.
        slip: true slip ratio λ_R in steady motion [-].
        distance: true way of the body [m].
        sample: it was made from a sample trial.
        imu_rate: samples of the IMU a second [Hz].
        drawn: what was drawn, by name.
    """

    text: str
    robot: str | None
    slip: float
    distance: float
    sample: bool
    imu_rate: float
    drawn: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Sensors:
    """Samples before the logger: IMU (N,) and encoders (M, 4) on one clock, true values beside them."""

    t_imu: Array
    force: Array
    rate: Array
    t_wheels: Array
    angle: Array
    slip: float
    distance: float
    metadata: dict[str, Any]


def of_sample(path: Path) -> Sensors:
    """Read a sample trial and its truth."""
    metadata, frame = _read(path)
    known, truth = _read(path.parent / "truth" / path.name)
    imu = frame.dropna(subset=FORCE)
    wheels = frame.dropna(subset=[f"enc_{w}_rad" for w in WHEELS])
    return Sensors(
        imu["t_s"].to_numpy(), imu[FORCE].to_numpy(), imu[TURN].to_numpy(),
        wheels["t_s"].to_numpy(), wheels[[f"enc_{w}_rad" for w in WHEELS]].to_numpy(),
        known["slip_ratio"], float(truth["x_m"].iloc[-1]),
        {k: v for k, v in metadata.items() if k not in ("enc_step_rad", "made_by")},
    )  # fmt: skip


def _read(path: Path) -> tuple[dict[str, Any], pd.DataFrame]:
    lines = path.read_text().splitlines(keepends=True)
    head = [line[1:].strip() for line in lines if line.startswith("#")]
    return tomllib.loads("\n".join(head)), pd.read_csv(StringIO("".join(lines[len(head) :])))


def of_formula(rng: np.random.Generator, *, noise: float | None = None) -> Sensors:
    """Drive by formula: rest, ramp, constant speed, ramp, rest; slip constant, noise white in motion."""
    rate, wheel_rate = rng.uniform(10, 120), rng.uniform(20, 120)
    v, ramp, cruise = rng.uniform(0.15, 0.8), rng.uniform(0.3, 1.0), rng.uniform(5, 25)
    slip, noise = rng.uniform(0.0, 0.3), rng.uniform(0.05, 1.0) if noise is None else noise
    edges = np.cumsum([rng.uniform(1, 5), ramp, cruise, ramp, rng.uniform(1, 5)])
    corners = [0.0, *edges]

    def speed(t: Array) -> Array:
        return np.interp(t, corners, [0, 0, v, v, 0, 0])

    t = np.arange(0, corners[-1], 1 / rate)
    moving = speed(t) > 0
    fine = np.linspace(0, corners[-1], 20001)
    way = np.concatenate([[0.0], np.cumsum(np.diff(fine) * 0.5 * (speed(fine)[1:] + speed(fine)[:-1]))])
    # mean acceleration over a sampling period, as an IMU with a filter of its own gives it
    gained = (speed(t + 0.5 / rate) - speed(t - 0.5 / rate)) * rate
    std = np.where(moving, noise, 0.01)[:, None] * np.array([1.0, 0.7, 1.0])
    force = np.column_stack([gained, 0 * t, 0 * t + 9.81]) + std * rng.normal(size=(t.size, 3))
    gyro = np.where(moving, 0.01, 0.001)[:, None] * rng.normal(size=(t.size, 3))
    tw = np.arange(0, corners[-1], 1 / wheel_rate)
    angle = np.interp(tw, fine, way) / (1 - slip) / RADIUS
    return Sensors(t, force, gyro, tw, np.repeat(angle[:, None], 4, axis=1), slip, float(way[-1]), {})


def draw(seed: int) -> FieldLog:
    """Draw a source and a logger."""
    rng = np.random.default_rng([seed, 3881])
    sample = bool(rng.random() < 0.5)
    source = of_sample(SAMPLES[rng.integers(len(SAMPLES))]) if sample else of_formula(rng)
    return logged(rng, source, sample=sample)


def logged(rng: np.random.Generator, source: Sensors, *, sample: bool) -> FieldLog:
    """Write sensors as a drawn logger does."""
    few = int(rng.choice([1, 2, 4, 8])) if sample else 1
    t, force, rate = source.t_imu[::few], source.force[::few], source.rate[::few]
    filtered = bool(rng.random() < 0.5)
    if filtered and few > 1:  # a unit whose filter follows its output rate; others alias
        n = t.size - 1
        force, rate = (x[: n * few].reshape(n, few, 3).mean(axis=1) for x in (source.force, source.rate))
        t = source.t_imu[: n * few].reshape(n, few).mean(axis=1)
    rounding = str(rng.choice(["none", "none", "none", "3 decimals", "2 decimals", "g, 3 decimals"]))
    scale, names = 1.0, FORCE
    if rounding.startswith("g"):
        scale, names = 1 / 9.80665, [name.replace("mps2", "g") for name in FORCE]
    decimals = {"n": 9, "3": 3, "2": 2, "g": 3}[rounding[0]]
    imu = pd.DataFrame(np.round(force * scale, decimals), columns=names)
    imu[TURN] = np.round(rate, 9 if decimals == 9 else decimals + 1)
    stamps = t.copy()
    period = float(np.median(np.diff(t)))
    batch = int(rng.integers(2, 11)) if rng.random() < 0.2 and 2 * period <= 0.1 else 1
    batch = max(1, min(batch, int(0.1 / period)))
    if batch > 1:  # each read of the FIFO stamps all of its samples with its own time
        last = np.minimum((np.arange(t.size) // batch + 1) * batch - 1, t.size - 1)
        stamps = t[last]
    imu["t_s"] = stamps
    drawn, wheels, metadata = _encoders(rng, source)
    metadata = {**source.metadata, **metadata}
    offset = _offset(rng)
    wheels["t_s"] = wheels["t_s"] - offset
    imu["arrival"], wheels["arrival"] = t, source.t_wheels[:: drawn["few"]]
    log = pd.concat([imu, wheels]).sort_values("arrival", kind="stable")
    step = 0.0
    if rng.random() < 0.1:  # the computer's clock is set in the run
        step = float(rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(0.01), np.log(2.0))))
        at = rng.uniform(0.2, 0.8) * t[-1]
        log["t_s"] += np.where(log["arrival"] > at, step, 0.0)
    log = log.drop(columns="arrival").round({"t_s": 6})
    log = log[["t_s", *(c for c in log.columns if c != "t_s")]]
    head = "".join(f"# {key} = {_toml(value)}\n" for key, value in metadata.items())
    drawn |= {
        "imu_hz": round(1 / period), "filtered": filtered, "rounding": rounding, "batch": batch,
        "offset": round(offset, 3), "clock_step": round(step, 3), "sample": sample,
    }  # fmt: skip
    return FieldLog(
        head + log.to_csv(index=False, lineterminator="\n"), None if sample else ROBOT, source.slip,
        source.distance, sample, 1 / period, drawn,
    )  # fmt: skip


def _offset(rng: np.random.Generator) -> float:
    """By which the encoders' stamps lie behind [s]: none, of one logger, or of two computers."""
    kind = rng.random()
    size = 0.0 if kind < 0.7 else rng.uniform(0.01, 0.3) if kind < 0.85 else rng.uniform(0.5, 5.0)
    return float(size * rng.choice([-1, 1]))


def _encoders(
    rng: np.random.Generator, source: Sensors
) -> tuple[dict[str, Any], pd.DataFrame, dict[str, Any]]:
    """Quantise the wheels' angles, and give them as angles, as counters of some range, or as rates."""
    few = int(rng.choice([1, 1, 2, 4]))
    t, angle = source.t_wheels[::few], source.angle[::few]
    counts = int(np.round(np.exp(rng.uniform(np.log(256), np.log(65536)))))
    ticks = np.floor(angle / (2 * np.pi) * counts + rng.random(4))
    kind = str(rng.choice(["angle", "angle", "counter", "turn", "rate"]))
    metadata: dict[str, Any] = {}
    if kind == "angle":
        values, unit = np.round(ticks / counts * 2 * np.pi, 6), "rad"
    elif kind == "rate":
        values = np.diff(ticks, axis=0, prepend=ticks[:1]) / counts * 2 * np.pi
        values, unit = np.round(values / np.median(np.diff(t)), 6), "radps"
    else:
        largest = float(np.abs(np.diff(ticks, axis=0)).max())
        span = counts
        if kind == "counter":
            # a logger that aliases is drawn, too, where the motion just reaches half of its range
            least = int(np.ceil(np.log2(max(2.0 * largest, 128))))
            span = 2 ** int(rng.integers(least, 33)) if least < 32 else 2**32
        elif 2 * largest >= counts:
            kind, span = "counter", 2**32
        signed = rng.random() < 0.3 and kind == "counter"
        values, unit = np.mod(ticks + (span // 2 if signed else 0), span), "counts"
        values = values - (span // 2 if signed else 0)
        metadata["enc_counts_per_rev"] = counts
    wheels = pd.DataFrame(values, columns=[f"enc_{w}_{unit}" for w in WHEELS])
    wheels["t_s"] = t
    rate = round(1 / float(np.median(np.diff(t))))
    return {"few": few, "encoder": kind, "counts": counts, "encoder_hz": rate}, wheels, metadata


def _toml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')
