"""Trials with a known truth, written as loggers of one kind each write them: errors in std, kind by kind.

The trials are the samples (virtual), and those of another program where its folder is at hand. Each kind
changes what is logged and not the motion, so that the truth holds.

python -m benchmarks.field_kinds --draws 100 --jobs 2 [--kinds "256 counts;low-pass 5 Hz"] [--outside DIR]
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.signal import lfilter

import granite_lab as gl
from benchmarks.outside import DEFAULT
from granite_lab.errors import LabError
from granite_lab.parameters import load_robot

Array = npt.NDArray[Any]
Rng = np.random.Generator

SAMPLES = Path(__file__).parents[1] / "data" / "samples"
WHEELS = ("fl", "fr", "rl", "rr")
FORCE = ["imu_ax_mps2", "imu_ay_mps2", "imu_az_mps2"]
TURN = ["imu_gx_radps", "imu_gy_radps", "imu_gz_radps"]
COUNTED = 2 * math.pi


@dataclass(frozen=True, eq=False)
class Log:
    """Samples of one logger: IMU (N,), (N, 3) and encoders (M,), (M, 4), each on a clock of its own.

    A stamp is `origin` plus `pace` times the true time [s].
    """

    t: Array
    force: Array
    rate: Array
    t_wheels: Array
    angle: Array
    head: dict[str, Any] = field(default_factory=dict)
    unit: str = "rad"
    digits: int = 6
    origin: float = 0.0
    pace: float = 1.0


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


# Kinds of loggers


def counts(per_rev: int, log: Log, rng: Rng) -> Log:
    ticks = np.floor(log.angle / COUNTED * per_rev + rng.random(4))
    return replace(log, angle=ticks / per_rev * COUNTED)


def counter(per_rev: int, log: Log, rng: Rng) -> Log:
    ticks = np.floor(log.angle / COUNTED * per_rev + rng.random(4))
    return replace(log, angle=ticks, unit="counts", head={**log.head, "enc_counts_per_rev": per_rev})


def wheels_at(rate: float, log: Log, rng: Rng) -> Log:
    t = np.arange(log.t_wheels[0] + rng.random() / rate, log.t_wheels[-1], 1 / rate)
    angle = np.column_stack([np.interp(t, log.t_wheels, a) for a in log.angle.T])
    return replace(log, t_wheels=t, angle=angle)


def rates(per_rev: int, log: Log, rng: Rng) -> Log:
    ticks = counts(per_rev, log, rng).angle
    values = np.diff(ticks, axis=0, prepend=ticks[:1]) / np.median(np.diff(log.t_wheels))
    return replace(log, angle=values, unit="radps")


def batch(size: int, log: Log, rng: Rng) -> Log:
    t, start = log.t, int(rng.integers(size))
    last = np.minimum(((np.arange(t.size) + start) // size + 1) * size - 1 - start, t.size - 1)
    late = rng.exponential(1e-3, t.size)
    return replace(log, t=t[last] + late[last])


def both_batched(size: int, log: Log, rng: Rng) -> Log:
    """All rows are stamped when the computer reads the port."""
    step = size * float(np.median(np.diff(log.t)))
    start = step * rng.random()
    t, t_wheels = (np.ceil((x - start) / step) * step + start for x in (log.t, log.t_wheels))
    return replace(log, t=t, t_wheels=t_wheels)


def noise(factor: float, log: Log, rng: Rng) -> Log:
    """White noise of a cheap IMU, 0.02 m/s² and 1 mrad/s a reading, times a factor."""
    n = log.t.size
    return replace(
        log, force=log.force + factor * 0.02 * rng.normal(size=(n, 3)),
        rate=log.rate + factor * 0.001 * rng.normal(size=(n, 3)),
    )  # fmt: skip


def noise_in_motion(factor: float, log: Log, rng: Rng) -> Log:
    """The same, while the wheels turn alone."""
    speed = np.interp(log.t, log.t_wheels, np.abs(np.gradient(log.angle.mean(axis=1), log.t_wheels)))
    on = (speed > 0.1)[:, None]
    loud = noise(factor, log, rng)
    return replace(log, force=np.where(on, loud.force, log.force), rate=np.where(on, loud.rate, log.rate))


def low_pass(corner: float, log: Log, _: Rng) -> Log:
    """A first-order filter in the IMU, of all axes."""
    a = 1 - math.exp(-2 * math.pi * corner * float(np.median(np.diff(log.t))))
    force, rate = (x[0] + lfilter([a], [1, a - 1], x - x[0], axis=0) for x in (log.force, log.rate))
    return replace(log, force=force, rate=rate)


def imu_at(rate: float, mean: bool, log: Log, _: Rng) -> Log:
    few = max(round(1 / rate / float(np.median(np.diff(log.t)))), 1)
    n = log.t.size // few * few
    if not mean:
        return replace(log, t=log.t[:n:few], force=log.force[:n:few], rate=log.rate[:n:few])
    t, force, turn = (x[:n].reshape(n // few, few, -1).mean(axis=1) for x in (log.t, log.force, log.rate))
    return replace(log, t=t[:, 0], force=force, rate=turn)


def jitter(std: float, log: Log, rng: Rng) -> Log:
    t, t_wheels = (x + std * rng.normal(size=x.size) for x in (log.t, log.t_wheels))
    return replace(log, t=np.sort(t), t_wheels=np.sort(t_wheels))


def late_stamps(mean: float, log: Log, rng: Rng) -> Log:
    """Stamps of arrival: late by an exponential time, in order."""
    t, t_wheels = (np.maximum.accumulate(x + rng.exponential(mean, x.size)) for x in (log.t, log.t_wheels))
    return replace(log, t=t, t_wheels=t_wheels)


def dropped(share: float, log: Log, rng: Rng) -> Log:
    a, b = rng.random(log.t.size) > share, rng.random(log.t_wheels.size) > share
    return replace(
        log, t=log.t[a], force=log.force[a], rate=log.rate[a], t_wheels=log.t_wheels[b], angle=log.angle[b]
    )


def wheels_clock(drift: float, log: Log, rng: Rng) -> Log:
    """The encoders' clock runs fast."""
    return replace(log, t_wheels=log.t_wheels * (1 + drift * rng.choice([-1, 1])))


def burst(share: float, longest: float, log: Log, rng: Rng) -> Log:
    """Stamps of arrival over a network that hangs now and then: what waits comes at once."""

    def late(t: Array) -> Array:
        hangs = np.where(rng.random(t.size) < share, rng.uniform(0.0, longest, t.size), 0.0)
        return np.maximum.accumulate(t + hangs)

    return replace(log, t=late(log.t), t_wheels=late(log.t_wheels))


def repeated(times: int, length: float, log: Log, rng: Rng) -> Log:
    """While the robot moves the IMU's samples are lost some times, and the last one is logged again."""
    force, rate = log.force.copy(), log.rate.copy()
    turns = log.t_wheels[np.flatnonzero(np.abs(np.diff(log.angle.mean(axis=1))) > 1e-4)]
    for begin in rng.uniform(turns[0], turns[-1] - length, times):
        k = np.flatnonzero((log.t >= begin) & (log.t < begin + length))
        force[k], rate[k] = force[k[0]], rate[k[0]]
    return replace(log, force=force, rate=rate)


def hangs(length: float, log: Log, rng: Rng) -> Log:
    """The encoders' bus hangs once in motion: the last angle is logged again, then it goes on."""
    angle = log.angle.copy()
    turns = log.t_wheels[np.flatnonzero(np.abs(np.diff(angle.mean(axis=1))) > 1e-4)]
    begin = rng.uniform(turns[0], turns[-1] - length)
    k = np.flatnonzero((log.t_wheels >= begin) & (log.t_wheels < begin + length))
    angle[k] = angle[k[0]]
    return replace(log, angle=angle)


def held(rate: float, log: Log, _: Rng) -> Log:
    """One table at a rate of its own, in each row the last value of each sensor."""
    t = np.arange(max(log.t[0], log.t_wheels[0]), min(log.t[-1], log.t_wheels[-1]), 1.0 / rate)
    i, j = (np.searchsorted(stamps, t, side="right") - 1 for stamps in (log.t, log.t_wheels))
    return replace(log, t=t, force=log.force[i], rate=log.rate[i], t_wheels=t, angle=log.angle[j])


def loses(share: float, log: Log, rng: Rng) -> Log:
    """One encoder counts too little."""
    angle = log.angle.copy()
    angle[:, rng.integers(4)] *= 1.0 - share
    return replace(log, angle=angle)


def trimmed(std: float, log: Log, rng: Rng) -> Log:
    """The sensitivity of each axis of the accelerometer is off by its own error."""
    return replace(log, force=log.force * (1.0 + std * rng.normal(size=3)))


def imu_clock(drift: float, log: Log, rng: Rng) -> Log:
    factor = 1 + drift * rng.choice([-1, 1])
    return replace(log, t=log.t * factor, pace=factor)


def both_clocks(drift: float, log: Log, rng: Rng) -> Log:
    """The logger's clock runs fast: nobody can tell."""
    factor = 1 + drift * rng.choice([-1, 1])
    return replace(log, t=log.t * factor, t_wheels=log.t_wheels * factor, pace=factor)


def nominal_imu(drift: float, log: Log, rng: Rng) -> Log:
    """Samples of the IMU are stamped by counting them, at the rate of the data sheet."""
    t = log.t[0] + np.arange(log.t.size) * float(np.diff(log.t[[0, -1]])[0]) / (log.t.size - 1)
    factor = 1 + drift * rng.choice([-1, 1])
    return replace(log, t=log.t[0] + (t - log.t[0]) * factor, pace=factor)


def offset(size: float, log: Log, rng: Rng) -> Log:
    return replace(log, t_wheels=log.t_wheels + size * rng.choice([-1, 1]))


def epoch(step: float, log: Log, _: Rng) -> Log:
    t, t_wheels = (np.round((x + 1.7e9) / step) * step for x in (log.t, log.t_wheels))
    return replace(log, t=t, t_wheels=t_wheels, origin=1.7e9)


def dead(log: Log, rng: Rng) -> Log:
    angle = log.angle.copy()
    angle[:, rng.integers(4)] = 0.0
    return replace(log, angle=angle)


def reversed_wheel(log: Log, rng: Rng) -> Log:
    angle = log.angle.copy()
    angle[:, rng.integers(4)] *= -1
    return replace(log, angle=angle)


def dies(log: Log, rng: Rng) -> Log:
    """An encoder stops counting while the wheel turns."""
    angle, i = log.angle.copy(), rng.integers(4)
    angle[:, i] = np.minimum(angle[:, i], rng.uniform(0.2, 0.8) * angle[-1, i])
    return replace(log, angle=angle)


def radius(std: float, log: Log, rng: Rng) -> Log:
    return replace(log, angle=log.angle * (1 + std * rng.normal(size=4)))


def turned(axis: int, degrees: float, log: Log, rng: Rng) -> Log:
    """The IMU is turned about one of its axes."""
    a = math.radians(degrees) * rng.choice([-1, 1])
    turn = np.eye(3)
    i, j = (k for k in range(3) if k != axis)
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = math.cos(a), -math.sin(a), math.sin(a), math.cos(a)
    return replace(log, force=log.force @ turn.T, rate=log.rate @ turn.T)


def saturated(share: float, log: Log, _: Rng) -> Log:
    """The accelerometer's range ends at a share of what it reads at most along x."""
    force = log.force.copy()
    top = share * np.abs(force[:, 0]).max()
    force[:, 0] = np.clip(force[:, 0], -top, top)
    return replace(log, force=force)


def scaled(share: float, log: Log, rng: Rng) -> Log:
    return replace(log, force=log.force * (1 + share * rng.choice([-1, 1])))


def rounded(step: float, log: Log, _: Rng) -> Log:
    return replace(
        log, force=np.round(log.force / step) * step, rate=np.round(log.rate / step * 10) * step / 10
    )


def without(what: str, log: Log, _: Rng) -> Log:
    force, rate, angle = log.force.copy(), log.rate.copy(), log.angle.copy()
    if what == "gyro":
        rate[:] = np.nan
    elif what == "other axes":
        force[:, 1:], rate[:, ::2] = np.nan, np.nan
    else:
        angle[:, 1:] = np.nan
    return replace(log, force=force, rate=rate, angle=angle)


def ends(begin: float, end: float, log: Log, _: Rng) -> Log:
    """Standstills of so many seconds at start and end."""
    turns = np.flatnonzero(np.abs(np.diff(log.angle.mean(axis=1))) > 1e-5)
    a, b = log.t_wheels[turns[0]] - begin, log.t_wheels[turns[-1] + 1] + end
    imu, wheels = (log.t >= a) & (log.t <= b), (log.t_wheels >= a) & (log.t_wheels <= b)
    return replace(
        log, t=log.t[imu], force=log.force[imu], rate=log.rate[imu], t_wheels=log.t_wheels[wheels],
        angle=log.angle[wheels],
    )  # fmt: skip


def temperature(drift: float, log: Log, rng: Rng) -> Log:
    """The biases drift: so many m/s² and a tenth of it in rad/s, over the log."""
    share = (log.t - log.t[0]) / (log.t[-1] - log.t[0])
    force, rate = (
        x + d * share[:, None] * rng.normal(size=3) for x, d in ((log.force, drift), (log.rate, drift / 30))
    )
    return replace(log, force=force, rate=rate)


Kind = Callable[[Log, Rng], Log]


def both(*kinds: Kind) -> Kind:
    def change(log: Log, rng: Rng) -> Log:
        for kind in kinds:
            log = kind(log, rng)
        return log

    return change


TURNS = ((0, 180), (1, 8), (1, 90), (2, 5), (2, 90), (2, 180))
RESTS = ((0.5, 0.5), (0.4, 3), (3, 0.4), (0, 3), (3, 0))

KINDS: dict[str, Kind] = {
    "as logged": lambda log, _: log,
    **{f"{n} counts": partial(counts, n) for n in (256, 512, 1024, 2048, 4096)},
    **{f"counter of {n} a turn": partial(counter, n) for n in (360, 1000)},
    **{f"encoders at {n} Hz": partial(wheels_at, n) for n in (10, 20, 200)},
    **{f"512 counts at {n} Hz": both(partial(wheels_at, n), partial(counts, 512)) for n in (10, 20, 200)},
    **{f"rates of {n} counts": partial(rates, n) for n in (512, 4096)},
    **{f"IMU in batches of {n}": partial(batch, n) for n in (2, 4, 8, 16)},
    **{f"all in batches of {n}": partial(both_batched, n) for n in (2, 4, 8)},
    **{f"noise x{n}": partial(noise, n) for n in (1, 3, 10)},
    **{f"noise x{n} in motion": partial(noise_in_motion, n) for n in (3, 10, 30)},
    **{f"low-pass {n} Hz": partial(low_pass, n) for n in (2, 5, 10, 20, 50)},
    **{f"IMU at {n} Hz, mean": partial(imu_at, n, True) for n in (10, 20, 50)},
    **{f"IMU at {n} Hz, picked": partial(imu_at, n, False) for n in (10, 20, 50)},
    **{f"jitter {1e3 * s:g} ms": partial(jitter, s) for s in (0.001, 0.003, 0.01)},
    **{f"late by {1e3 * s:g} ms": partial(late_stamps, s) for s in (0.003, 0.01)},
    **{f"hangs of up to {1e3 * s:g} ms": partial(burst, p, s) for p, s in ((0.05, 0.05), (0.01, 0.2))},
    **{f"{n} x {s:g} s repeated": partial(repeated, n, s) for n, s in ((5, 0.05), (5, 0.2))},
    **{f"encoders hang for {s:g} s": partial(hangs, s) for s in (0.1, 0.6)},
    **{f"one table at {n} Hz": partial(held, n) for n in (50, 100, 500)},
    **{f"{100 * s:g} % dropped": partial(dropped, s) for s in (0.02, 0.1, 0.3)},
    **{f"encoder clock {100 * s:g} %": partial(wheels_clock, s) for s in (0.005, 0.01, 0.02, 0.03)},
    **{f"IMU clock {100 * s:g} %": partial(imu_clock, s) for s in (0.005, 0.01, 0.02, 0.03)},
    "IMU counted, 2 %": partial(nominal_imu, 0.02),
    "both clocks 2 %": partial(both_clocks, 0.02),
    **{f"offset {s:g} s": partial(offset, s) for s in (0.05, 0.2, 2.0)},
    "epoch, 1 ms": partial(epoch, 0.001), "epoch, 10 ms": partial(epoch, 0.01),
    "dead wheel": dead, "reversed wheel": reversed_wheel, "encoder dies": dies,
    "radii 1 %": partial(radius, 0.01), "encoder loses 20 %": partial(loses, 0.2),
    **{f"IMU turned {d} deg about {'xyz'[a]}": partial(turned, a, d) for a, d in TURNS},
    "range 70 %": partial(saturated, 0.7), "range 40 %": partial(saturated, 0.4),
    "accelerometer 2 %": partial(scaled, 0.02), "accelerometer 5 %": partial(scaled, 0.05),
    "axes 1 %": partial(trimmed, 0.01), "axes 3 %": partial(trimmed, 0.03),
    "steps of 0.01": partial(rounded, 0.01), "steps of 0.1": partial(rounded, 0.1),
    "no gyro": partial(without, "gyro"), "one axis each": partial(without, "other axes"),
    "one wheel": partial(without, "wheels"),
    **{f"rest {a:g} s and {b:g} s": partial(ends, a, b) for a, b in RESTS},
    "drift 0.05": partial(temperature, 0.05), "drift 0.2": partial(temperature, 0.2),
    "cheap": both(partial(counts, 1024), partial(noise, 3), partial(low_pass, 20), partial(jitter, 0.003)),
}  # fmt: skip
"""Name of a kind to what it makes of a log."""


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
    parser = argparse.ArgumentParser(description=__doc__)
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
