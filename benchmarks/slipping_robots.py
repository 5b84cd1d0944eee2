"""Virtual robots whose body does not follow its wheels: how well is their velocity estimated?

Planar kinematics and a sensor model of its own; no code of the simulators or of `granite_lab.hidden` is used.
A second estimate of the same log, by least squares, is told the standstills or also the slip: it shows what
the sensors allow.

``python -m benchmarks.slipping_robots [--seeds 24] [--out docs/estimation-robots.md]``
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse
from scipy.signal import iirpeak, lfilter, lsim
from scipy.sparse.linalg import spsolve

from benchmarks.against_truth import Array, Velocities, draw, errors, inside, rms, table
from benchmarks.blind_code import commit
from benchmarks.command_line import parser_of
from granite_lab.errors import LabError
from granite_lab.files import write_text
from granite_lab.logs.trial import ImuStream, Trial, TrialInfo, WheelStream
from granite_lab.parameters import load_robot
from tests.truth.motion import estimate

KINDS = {
    "rings": "soft tyres: after each change of speed the body swings at 2 Hz relative to its wheels",
    "slips through": "for 1 to 3 s of the drive the slip ratio is 90 %",
    "is stuck": "the body comes to rest, its wheels turn on for 2 to 4 s",
    "brakes on a slope": "5 to 12° downhill, the wheels stop and the body slides on for 0.2 to 0.5 s",
}

GRAVITY = 9.81
FINE = 1000
"""Rate of the grid on which a trial is made [Hz]."""

IMU_X, IMU_Z = 0.10, 0.12
"""Place of the IMU, forward of and above R, as in the robot's file [m]."""

RADIUS = 0.0965
STARTS = 1e-3
"""Speed from which body or wheels move [m/s]."""

SCATTER, SCATTER_TIME = 0.02, 0.3
"""Std of the slip ratio about its mean, and the time of each of its two low-passes [s]."""

VIBRATION_Q = 5.0
"""Quality factor of the vibration of the frame."""

RESTS, SLIP = "told the standstills", "told the slip"

COVERAGE_AIM = (0.88, 0.98)
RATIO_AIM = 2.0
"""Aims: share of the velocities within two std; RMSE over that of the estimate that is told the slip."""


@dataclass(frozen=True, eq=False)
class Course:
    """What happens in a trial, on the fine grid (N samples).

    Attributes:
        t: [s].
        wheel, v: velocity of the wheels' circumference and of R along the body's x axis [m/s].
        shapes: (2, N) the mean of v is the sum of these [m/s], each times a number of its own.
        scatter: (N,) std of v about its mean [m/s].
        pitch: [rad], positive nose down.
    """

    t: Array
    wheel: Array
    v: Array
    shapes: Array
    scatter: Array
    pitch: Array


@dataclass(frozen=True, eq=False)
class Sensors:
    """Properties of the sensors, drawn for each trial.

    Attributes:
        accel, gyro: noise densities [m/s^2/√Hz], [rad/s/√Hz].
        accel_bias, gyro_bias: [m/s^2], [rad/s].
        imu_rate, wheel_rate: [Hz].
        late: by how much the stamps of the IMU are late [s].
        shake, frequency: rms [m/s^2] and frequency [Hz] of the vibration of the frame.
        counts: of an encoder per turn of the wheel.
    """

    accel: float
    gyro: float
    accel_bias: float
    gyro_bias: float
    imu_rate: int
    wheel_rate: int
    late: float
    shake: float
    frequency: float
    counts: int


def wander(rng: np.random.Generator, n: int, time: float) -> Array:
    """(n,) noise of unit std through two low-passes of some time [s]."""
    keep = np.exp(-1.0 / (time * FINE))
    noise = rng.standard_normal(n + int(10 * time * FINE))
    for _ in range(2):
        noise = lfilter([1 - keep], [1, -keep], noise)
    return np.asarray(noise[-n:] / np.std(noise))


def make_course(kind: str, rng: np.random.Generator) -> Course:
    """Draw a course: standstill, drive straight ahead at one speed, standstill."""
    speed, acceleration = rng.uniform(0.2, 0.5), rng.uniform(0.5, 1.5)
    ramp = speed / acceleration
    begin, duration = rng.uniform(1.5, 3.0), rng.uniform(5.0, 9.0)
    brake = begin + duration
    t = np.arange(0.0, brake + ramp + (6.0 if kind == "rings" else 2.5), 1.0 / FINE)
    wheel = np.interp(t, [begin, begin + ramp, brake, brake + ramp], [0, speed, speed, 0])
    wheel = np.convolve(np.pad(wheel, 50, mode="edge"), np.full(101, 1 / 101), mode="valid")
    grip = 1.0 - rng.uniform(0.02, 0.25)
    gripping, other, size, pitch = wheel, np.zeros(t.size), grip, np.zeros(t.size)
    if kind == "rings":
        omega, damping = 2 * np.pi * 2.0, rng.uniform(0.05, 0.15)
        swing = ([-1.0, 0.0], [1.0, 2 * damping * omega, omega**2])
        other = lsim(swing, np.gradient(wheel, t), t)[1]
        pitch = rng.uniform(0.0, 0.5) * grip * np.cumsum(other) / FINE
    elif kind == "brakes on a slope":
        slides = rng.uniform(0.2, 0.5)
        body = np.interp(t, [brake, brake + ramp + slides], [speed, 0.0])
        other = np.where(t > brake, body - wheel, 0.0)
    else:
        first = begin + ramp + rng.uniform(0.5, 1.5)
        last, size = first + rng.uniform(1.0, 3.0), 0.1
        if kind == "is stuck":
            first, last, size = brake - rng.uniform(2.0, 4.0), t[-1], 0.0
        slipping = np.interp(t, [first, first + 0.3, last, last + 0.3], [0, 1, 1, 0])
        gripping, other = wheel * (1 - slipping), wheel * slipping
    scatter = SCATTER * (gripping + np.abs(other) * (size > 0))
    v = grip * gripping + size * other + scatter * wander(rng, t.size, SCATTER_TIME)
    # the ground is a matter of the way: a body that stands does not pitch
    way = np.cumsum(np.abs(v)) / np.sum(np.abs(v))
    pitch += np.interp(way, t / t[-1], 0.01 * wander(rng, t.size, 0.8))
    if kind == "brakes on a slope":
        along = np.clip(2 * way - 0.3, 0, 1)
        pitch += np.deg2rad(rng.uniform(5.0, 12.0)) * 0.5 * (1 - np.cos(np.pi * along))
    return Course(t, wheel, v, np.stack([gripping, other]), scatter, pitch)


def draw_sensors(rng: np.random.Generator) -> Sensors:
    """Draw sensors between an industrial and a consumer IMU, in density and bias."""
    worse = rng.uniform(0.0, 1.0)  # 0: industrial, 1: consumer; figures as in imu_grades.toml
    return Sensors(
        accel=0.00098 * 3.0**worse, gyro=5.2e-5 * 3.3**worse,
        accel_bias=rng.normal(0, 0.02 * 10**worse), gyro_bias=rng.normal(0, 0.0017 * 5**worse),
        imu_rate=int(rng.choice([50, 100, 200])), wheel_rate=int(rng.choice([20, 50, 100])),
        late=rng.uniform(0.0, 0.008), shake=rng.uniform(0.05, 0.5), frequency=rng.uniform(8.0, 20.0),
        counts=int(rng.choice([2000, 20000, 106000])),
    )  # fmt: skip


def sense(course: Course, sensors: Sensors, rng: np.random.Generator) -> Trial:
    """Log a course."""
    t, pitch = course.t, course.pitch
    rate = np.gradient(pitch, t)
    shaken = np.minimum(course.wheel / 0.3, 1.0) * sensors.shake
    resonance = iirpeak(sensors.frequency, VIBRATION_Q, fs=FINE)

    def vibration() -> Array:
        noise = lfilter(*resonance, rng.standard_normal(t.size + 2 * FINE))
        return np.asarray(shaken * noise[2 * FINE :] / np.std(noise[2 * FINE :]))

    force = np.zeros((t.size, 3))
    force[:, 0] = np.gradient(course.v + IMU_Z * rate, t) - GRAVITY * np.sin(pitch) - IMU_X * rate**2
    force[:, 2] = GRAVITY * np.cos(pitch) - IMU_X * np.gradient(rate, t) - IMU_Z * rate**2 - course.v * rate
    for axis in (0, 1, 2):
        force[:, axis] += vibration()
    turned = np.zeros((t.size, 3))
    turned[:, 1] = rate
    every = FINE // sensors.imu_rate
    n = t.size // every

    def sampled(values: Array, bias: float, density: float) -> Array:
        means = values[: n * every].reshape(n, every, 3).mean(axis=1)
        return np.asarray(
            means + rng.normal(0, abs(bias), 3) * [0, 1, 1] + [bias, 0, 0]
            + density * np.sqrt(sensors.imu_rate) * rng.standard_normal((n, 3))
        )  # fmt: skip

    stamps = t[: n * every].reshape(n, every).mean(axis=1) + sensors.late
    gyro = sampled(turned[:, [1, 0, 2]], sensors.gyro_bias, sensors.gyro)[:, [1, 0, 2]]
    imu = ImuStream(stamps, sampled(force, sensors.accel_bias, sensors.accel), gyro)
    skip = FINE // sensors.wheel_rate
    step = 2 * np.pi / sensors.counts
    angle = np.cumsum(course.wheel)[::skip] / FINE / RADIUS
    angle = angle[:, None] * rng.normal(1.0, 0.002, 4) + rng.uniform(0, step, 4)
    counted = np.floor(angle / step) * step
    wheels = WheelStream(
        t[::skip] + rng.normal(0, 3e-4, angle.shape[0]), counted - counted[0], resolution=(step,) * 4
    )
    return Trial("virtual", TrialInfo(robot="granite", virtual=True), imu, wheels)


def by_least_squares(course: Course, sensors: Sensors, imu: ImuStream, *, slip_told: bool) -> Array:
    """Return the velocity by an estimate that is told the truth [m/s], at the stamps of the IMU.

    It is told the standstills of the body, and noise, vibration and latency of the IMU; with `slip_told` also
    the two shapes of which the mean velocity consists (not how large they are) and the scatter about it. All
    that is linear: a least-squares problem in velocity, pitch error and vibration at the edges of the
    samples, two biases and the sizes of the two shapes.
    """
    dt, n = 1.0 / sensors.imu_rate, imu.t.size
    t = np.arange(n + 1) * dt
    shapes = np.stack([np.interp(t, course.t, shape) for shape in course.shapes], axis=1)
    wheel, scatter = (np.interp(t, course.t, x) for x in (course.wheel, course.scatter))
    moving = course.t[np.abs(course.v) > STARTS]
    rests = (t < moving[0]) | (t > moving[-1])
    still = rests[1:] & rests[:-1]
    f, q = imu.specific_force[:, 0], imu.angular_rate[:, 1]
    q = q - q[still & (t[1:] < moving[0])].mean()
    pitch = np.append(0.0, np.cumsum(q)) * dt
    pitch_mid = 0.5 * (pitch[1:] + pitch[:-1])
    lever = IMU_Z * np.interp(t, imu.t - sensors.late, q)
    acceleration = f + GRAVITY * np.sin(pitch_mid) + IMU_X * q**2 - np.diff(lever) / dt

    one: Any = sparse.identity(n + 1, format="csr")
    step, mean = (one[1:] - one[:-1]) / dt, 0.5 * (one[1:] + one[:-1])
    tilt: Any = -GRAVITY * mean.multiply(np.cos(pitch_mid)[:, None]).tocsr()
    omega = 2 * np.pi * sensors.frequency
    keep = np.exp(-0.5 * omega / VIBRATION_Q * dt)
    turn = 2 * keep * np.cos(omega * dt)
    swing = one[2:] - turn * one[1:-1] + keep**2 * one[:-2]
    drive = (1 - keep**2) / (1 + keep**2) * ((1 + keep**2) ** 2 - turn**2)
    shaken = sensors.shake / omega * np.sqrt(drive) * np.minimum(wheel[1:-1] / 0.3, 1.0) + 1e-6
    hold = np.exp(-dt / (2 * SCATTER_TIME))
    follow = one[1:] - hold * one[:-1]
    scattered = np.sqrt(1 - hold**2) * scatter[1:] + 1e-5 if slip_told else 10.0
    column, zeros = np.ones((n, 1)), np.zeros(n + 1)
    # blocks of velocity, pitch error, vibration and the four constants; right-hand side; std
    equations: list[tuple[Any, Any, Any, Any, Array, Any]] = [
        (step, tilt, step, column * [1, 0, 0, 0], acceleration, sensors.accel / np.sqrt(dt)),
        (None, step, None, column * [0, 1, 0, 0], zeros[1:], sensors.gyro / np.sqrt(dt)),
        (None, None, swing, None, zeros[2:], shaken),
        (one[rests], None, None, None, zeros[rests], 1e-4),
        (None, step[still], None, None, -q[still], 1e-5),
        (follow, None, None, np.pad(-follow @ shapes, [(0, 0), (2, 0)]), zeros[1:], scattered),
        (None, one[:1], None, None, zeros[:1], 0.1),
        (None, None, None, np.eye(4), zeros[:4], [1.0, 0.1, 1.0, 1.0]),
    ]  # fmt: skip
    std = np.concatenate([np.broadcast_to(row[5], row[4].shape) for row in equations])
    value = np.concatenate([row[4] for row in equations]) / std
    blocks: Any = sparse.bmat([row[:4] for row in equations], format="csr")
    matrix = blocks.multiply(1.0 / std[:, None]).tocsr()
    v = np.asarray(spsolve(matrix.T @ matrix, matrix.T @ value))[: n + 1]
    return np.asarray(0.5 * (v[1:] + v[:-1]))


def run(kind: str, seed: int) -> Velocities | str:
    """Make a trial and estimate it; return the velocities in motion, or why it was refused."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    course, sensors = make_course(kind, rng), draw_sensors(rng)
    trial = sense(course, sensors, rng)
    imu, wheels = trial.imu, trial.wheels
    assert imu is not None
    assert wheels is not None
    try:
        motion = estimate(trial, load_robot("granite"))
    except LabError as refusal:
        return f"{kind}, seed {seed}: {refusal.message}"
    at = imu.t - sensors.late
    moving = course.t[(np.abs(course.v) > STARTS) | (course.wheel > STARTS)]
    keep = (at > moving[0]) & (at < moving[-1])
    rolled = RADIUS * np.gradient(wheels.angle.mean(axis=1), wheels.t)
    columns = (
        imu.t, np.interp(at, course.t, course.v), np.interp(imu.t, motion.t, motion.v),
        np.interp(imu.t, motion.t, motion.v_std), np.interp(imu.t, wheels.t, rolled),
    )  # fmt: skip
    t, truth, v, std, alone = (column[keep] for column in columns)
    told = {
        name: by_least_squares(course, sensors, imu, slip_told=name == SLIP)[keep] for name in (RESTS, SLIP)
    }
    return Velocities(f"{kind}, seed {seed}", t, truth, v, std, alone, motion.health.grade, told)


def page(found: dict[str, list[Velocities | str]]) -> str:
    """Return the page."""
    rows, good = [], []
    for kind, trials in found.items():
        runs = [run for run in trials if not isinstance(run, str)]
        own, rests, told, wheels = (rms(errors(runs, what)) for what in ("v", RESTS, SLIP, "wheels"))
        share = inside(runs)
        covered = COVERAGE_AIM[0] <= share <= COVERAGE_AIM[1]
        near = own <= RATIO_AIM * told
        if covered and near:
            good.append(kind)
        grades = [run.grade for run in runs]
        rows.append([
            kind, str(len(trials)), f"{1e3 * own:.1f}", f"{1e3 * rests:.1f}", f"{1e3 * told:.1f}",
            f"{own / told:.1f}" if near else f"**{own / told:.1f}**",
            f"{1e3 * wheels:.0f}", f"{100 * share:.0f}" if covered else f"**{100 * share:.0f}**",
            " / ".join(str(grades.count(grade)) for grade in ("good", "fair", "poor")),
            str(len(trials) - len(runs)),
        ])  # fmt: skip
    head = (
        "robot", "trials", "RMSE [mm/s]", RESTS, SLIP, "ratio", "wheels",
        "in 2σ [%]", "good / fair / poor", "refused",
    )  # fmt: skip
    stands = ""
    if stuck := [run for run in found.get("is stuck", ()) if not isinstance(run, str)]:
        moves = np.concatenate([np.abs(run.truth) > STARTS for run in stuck])
        good_there = np.concatenate([np.abs(run.v - run.truth) < 2 * run.std for run in stuck])[moves]
        stands = f""" The body that is stuck
stands in {100 * np.mean(~moves):.0f} % of the samples, where any std is large enough; of the others,
{100 * np.mean(good_there):.0f} % are within ±2σ."""
    low, high = (100 * aim for aim in COVERAGE_AIM)
    return f"""# Estimation on robots that slip in unusual ways

## What was reached

Aims: {low:.0f} to {high:.0f} % of the velocities within ±2σ, and an RMSE at most {RATIO_AIM:g} times that of
an estimate that is told the truth about the slip. Bold: missed. Both are reached for:
{", ".join(good) or "–"}.

{table(head, rows)}
RMSE of the velocity [mm/s] over all trials while body or wheels move: of the estimate, of two that are told
a part of the truth, and of the wheels alone. The ratio is that to "told the slip".{stands}

![velocity of a trial of each robot: estimate with two std, wheels, truth](figures/slipping_robots.png)

## The robots

{chr(10).join(f"* *{kind}*: {text}." for kind, text in KINDS.items())}

A trial is a standstill, a drive of 5 to 9 s at 0.2 to 0.5 m/s, and a standstill. Gripping wheels slip by 2
to 25 %, with a scatter of 2 points. Drawn for each trial: noise and bias of the IMU (industrial to consumer),
its delay (up to 8 ms), vibration (0.05 to 0.5 m/s²), uneven ground (0.6°), rates and encoder counts. The
generator shares no code with the simulators.

The two other estimates are least-squares problems that know noise, vibration and delay of the sensors. *Told
the standstills*: the IMU between the standstills, no wheels. *Told the slip*: also when and in which shape
the slip changes and how much it scatters, but not its size.

Written by `python -m benchmarks.slipping_robots --seeds {len(next(iter(found.values())))}`, code {commit()}.
"""


def main() -> None:
    """Estimate all trials, write the page and its figure."""
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, default=24, help="trials of each robot")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, default=Path("docs/estimation-robots.md"))
    given = parser.parse_args()
    tasks = list(product(KINDS, range(given.seeds)))
    with ProcessPoolExecutor(given.jobs) as pool:
        done = list(pool.map(run, *zip(*tasks, strict=True)))
    found = {kind: done[i * given.seeds : (i + 1) * given.seeds] for i, kind in enumerate(KINDS)}
    firsts = [next(run for run in runs if not isinstance(run, str)) for runs in found.values()]
    draw(given.out.parent / "figures" / "slipping_robots.png", firsts)
    write_text(given.out, page(found))


if __name__ == "__main__":
    main()
