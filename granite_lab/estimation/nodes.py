"""The filter's nodes: instants, what is measured at each, and the matrices between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, uniform_filter1d
from scipy.signal import savgol_filter

from granite_lab.estimate import Estimate
from granite_lab.estimation import process
from granite_lab.estimation.differentiation import MOVING
from granite_lab.estimation.faults import Faults, inflate
from granite_lab.estimation.integration import Nominal
from granite_lab.estimation.lateral import Sideways
from granite_lab.estimation.measurements import ZERO_VELOCITY, Update, add_rest, add_wheels
from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.noise import Noise
from granite_lab.estimation.process import BA, BG, SIZE, TH, D, P, SlipModel, X
from granite_lab.estimation.rolling import Rolling
from granite_lab.logs.trial import Array
from granite_lab.parameters import GRAVITY

REST_STEP = 0.05
"""Spacing of the nodes at standstill [s]; the IMU's samples between two are averaged."""

GRID = 0.01
"""Spacing on which the wheels' acceleration is judged [s]."""

TURN_TIME = 2.0
"""How long a turn goes on [s]."""

QUICK, CALM = 0.05, 0.15
"""What changes faster than this [s] is no thrust: in general, and while the wheels turn steadily."""

RESISTANCE = 0.1 * GRAVITY
"""What sand resists with, over mass [m/s^2]."""

COMPLIANCE = 0.005
"""Std of the displacement between wheels and body by thrust over mass [s^2], which is the reciprocal of the
square of a natural frequency: a robot that rings at 2 Hz on its tyres, gears and mounts."""

LOOSE = 1.0e-4
"""The displacement follows thrust roughly only. It also walks by as much, and at least by this [s^2]: the
compliance of a robot that rings at 16 Hz."""

LOOSE_TIME = 0.1
"""Time over which such a walk keeps its direction [s]."""

SLOWEST = 3.0e-3
"""Slip velocity goes with the wheel speed down to this [m/s]: ten times what a robot that stands may move."""

FREE = 10.0
"""Distance that wheels which spin on the spot may roll between two nodes [m]."""

MOST = 60_000
"""More nodes than this are thinned; the IMU is integrated at its own rate all the same."""


@dataclass(frozen=True, eq=False)
class Nodes:
    """Everything the filter needs.

    Attributes:
        index: (K,) places of the nodes among the IMU's stamps.
        t: (K,) stamps [s].
        moving: (K,) False where the step into the node lies within a standstill.
        lost: (K,) rolled minus travelled distance by the mean slip ratio alone [m].
        mean_slip: (K,) that slip ratio, to which S and G are deviations.
        w: (K,) signed wheel speed [m/s], floor included, that turns slip ratio into slip velocity.
        F, Q: (K, 14, 14) transition and noise into each node.
        updates: (K,) lists of measurements.
        x0, P0: (14, 1) and (14, 14) initial state and covariance.
        thinned: nodes are sparser than the IMU's samples in motion.
    """

    index: np.ndarray
    t: Array
    moving: np.ndarray
    lost: Array
    mean_slip: Array
    w: Array
    F: Array
    Q: Array
    updates: tuple[tuple[Update, ...], ...]
    x0: Array
    P0: Array
    thinned: bool


def choose(nominal: Nominal) -> tuple[np.ndarray, bool]:
    """Pick nodes: every stamp in motion, every 50 ms at rest; thinned in a long log."""
    t, rest = nominal.t, nominal.rest
    n_moving = int((~rest).sum())
    every = max(1, int(np.ceil(n_moving / MOST)))
    keep = np.zeros(t.size, dtype=bool)
    keep[np.flatnonzero(~rest)[::every]] = True
    period = float(np.median(np.diff(t)))
    keep[np.flatnonzero(rest)[:: max(1, round(REST_STEP / period))]] = True
    edge = np.flatnonzero(np.diff(rest.astype(np.int8)) != 0)
    keep[edge] = keep[edge + 1] = True
    keep[[0, -1]] = True
    return np.flatnonzero(keep), every > 1


@dataclass(frozen=True, eq=False)
class Pace:
    """How the wheels went, at the nodes.

    Attributes:
        speed: (K,) wheel speed [m/s].
        calm: (K,) the same, averaged over half a second wherever it is steady [m/s].
        unrest: (K,) its relative change [1/s].
        growth: (K,) how fast its magnitude grows [m/s^2]; 0 within the noise.
        steady: (K,) True where it does not change within a quarter of a second.
    """

    speed: Array
    calm: Array
    unrest: Array
    growth: Array
    steady: np.ndarray


def pace_of(rolling: Rolling, offset: float, t: Array) -> Pace:
    """Judge the wheels' pace at instants (K,) of the IMU's clock, which theirs lies behind by `offset` [s].

    The slip ratio multiplies `calm`: were it `speed`, whose noise is that of the rolled distance as
    well, every update would find a little more slip than there is.
    """
    known = np.isfinite(rolling.speed) & np.isfinite(rolling.mean)
    stamps = rolling.t[known] + offset
    speed = np.interp(t, stamps, rolling.speed[known])
    grid = np.arange(t[0], t[-1] + GRID, GRID)
    period = max(float(np.median(np.diff(stamps))), GRID)
    window = max(round(0.16 / GRID), 8 * round(period / GRID)) | 1
    if grid.size <= 3 * window:
        return Pace(speed, speed, np.zeros(t.size), np.zeros(t.size), np.zeros(t.size, dtype=bool))
    path = np.interp(grid, stamps, rolling.mean[known])
    growth = savgol_filter(path, window, 3, deriv=2, delta=GRID, mode="nearest")
    calm = savgol_filter(path, 3 * window, 1, deriv=1, delta=GRID, mode="nearest")
    pace = np.interp(grid, stamps, rolling.speed[known])
    growth = np.where(pace < 0, -growth, growth)
    # std of the second derivative of a cubic through n samples that span T: sqrt(720/n) sigma / T^2
    one = rolling.mean_std if not rolling.by_rate else rolling.speed_std * period
    sigma = np.interp(grid, stamps, one[known]) * np.sqrt(720 * period / (window * GRID))
    limit = np.minimum(0.05, 0.5 * np.abs(pace)) + 3.0 * sigma / (window * GRID) ** 2
    # the slip ratio goes on changing for some tenths of a second after the wheels have settled
    relative = np.maximum(np.abs(growth) - limit, 0.0) / np.maximum(np.abs(pace), SLOWEST)
    memory = np.exp(-np.arange(0, 2.0, GRID) / 0.4)
    lasting = np.convolve(relative, memory / memory.sum(), mode="full")[: grid.size]
    busy = np.abs(growth) > limit
    growth = np.where(busy, growth, 0.0)
    near = maximum_filter1d(busy.astype(float), 3 * window)
    quick = speed
    if rolling.by_rate:
        quick = np.interp(t, grid, savgol_filter(path, window, 2, deriv=1, delta=GRID, mode="nearest"))
    steady = np.interp(t, grid, near) == 0
    return Pace(
        speed=speed,
        calm=np.where(steady, np.interp(t, grid, calm), quick),
        unrest=np.interp(t, grid, np.maximum(relative, lasting)),
        growth=np.interp(t, grid, growth),
        steady=steady,
    )


def lasting_speed(t: Array, speed: Array, moving: np.ndarray, memory: float) -> Array:
    """(K,) signed wheel speed [m/s] averaged over `memory` [s] of motion, floor included."""
    grid = np.arange(t[0], t[-1] + 0.1, 0.1)
    on = np.interp(grid, t, moving.astype(float))
    weight = gaussian_filter1d(on, 5.0 * memory)
    pace = gaussian_filter1d(on * np.interp(grid, t, np.abs(speed)), 5.0 * memory) / np.maximum(weight, 1e-3)
    return np.where(speed < 0, -1.0, 1.0) * np.maximum(np.interp(t, grid, pace), process.V_FLOOR)


def push(imu: BodyImu, width: float = 0.1) -> Array:
    """(N,) specific force along x without what changes within `width` [s]: a tenth of a second [m/s^2]."""
    known = np.isfinite(imu.forward)
    force = np.interp(imu.t, imu.t[known], imu.forward[known])
    return np.asarray(uniform_filter1d(force, max(round(width / float(np.median(np.diff(imu.t)))), 1)))


def thrust(imu: BodyImu, rest: np.ndarray, index: np.ndarray, pace: Pace) -> Array:
    """(K,) thrust over mass at the nodes, against that at standstill [m/s^2].

    Specific force along x is thrust less the ground's resistance, over mass; resistance in sand is about a
    tenth of the weight, against the motion. While the wheels turn steadily, what is fast is vibration.

    Args:
        rest: (N,) True at standstill.
        index: (K,) places of the nodes among the IMU's stamps.
        pace: of the wheels.
    """
    force = np.where(pace.steady, push(imu, CALM)[index], push(imu, QUICK)[index])
    level = (
        float(np.mean(imu.forward[rest & np.isfinite(imu.forward)])) if rest.any() else float(np.mean(force))
    )
    return np.asarray(force - level + RESISTANCE * np.tanh(pace.speed / process.V_FLOOR))


def build(
    imu: BodyImu,
    rolling: Rolling | None,
    nominal: Nominal,
    noise: Noise,
    faults: Faults,
    slip: SlipModel,
    *,
    offset: float,
    offset_std: float,
    roll_std: float,
    distance: Estimate | None = None,
    aside: Sideways | None = None,
    compliance: float = LOOSE,
    soft: float = COMPLIANCE,
    louder: Mapping[str, float] | None = None,
) -> Nodes:
    """Lay out nodes, matrices and measurements.

    Args:
        imu, rolling: the sensors.
        nominal: the integrated motion.
        noise, slip: what drifts, and how much.
        faults: gaps, plateaus and restarts, over which the noise grows.
        offset, offset_std: clock offset that the wheels' stamps are moved by, and its std [s].
        roll_std: std of the roll [rad].
        distance: measured total distance [m].
        aside: velocity to the left, as the nominal motion has it.
        compliance: by which the displacement between wheels and body walks as thrust changes [s^2].
        soft: std of the compliance itself [s^2].
        louder: factors on the variance of kinds of measurements.
    """
    index, thinned = choose(nominal)
    t = nominal.t[index]
    dt = np.diff(t, prepend=t[0])
    rest = nominal.rest[index]
    moving = ~(rest & np.concatenate([[True], rest[:-1]]))
    moving[0] = not rest[0]
    onset = np.concatenate([[False], rest[:-1] & ~rest[1:]])
    coupling = nominal.coupling[index]
    if rolling is not None:
        pace = pace_of(rolling, offset, t)
    else:
        none = np.zeros(t.size)
        pace = Pace(nominal.v[index], nominal.v[index], none, none, none > 0)
    speed = pace.speed
    w = np.where(pace.calm < 0, -1.0, 1.0) * np.maximum(np.abs(pace.calm), SLOWEST)
    mean_slip = slip.expected(pace.growth)
    if slip.memory:
        w = lasting_speed(t, speed, moving, slip.memory)
        mean_slip = np.clip(mean_slip + slip.thrust * push(imu)[index], -0.4, 0.4)
    loss = np.where(moving, mean_slip * (w if slip.memory else speed), 0.0)
    lost = np.cumsum(loss * dt)
    # a scale error multiplies acceleration, not the bias that the nominal velocity drifts by
    going = speed - (loss if rolling is not None else np.interp(t, t[rest], speed[rest]))
    omega = 2 * np.pi * noise.vibration_frequency
    F = process.transitions(
        dt, coupling, moving, w, slip, None if imu.has_pitch_rate else np.zeros(1, dtype=bool), omega,
        noise.vibration_damping, np.diff(going, prepend=going[0]),
    )  # fmt: skip
    accel = np.full(t.size, np.hypot(noise.accel, max(noise.accel_motion, noise.accel_stamps)))
    if aside is not None:
        accel = np.hypot(accel, aside.noise(nominal.heading_rate)[index])
    # yaw rate that leaks into the pitch gyro, and keeps its sign for seconds
    turn = roll_std * np.abs(nominal.heading_rate[index]) * np.sqrt(TURN_TIME)
    gyro = np.hypot(np.hypot(noise.gyro, noise.gyro_motion), turn)
    Q = process.noises(
        dt, coupling, moving, accel=accel, gyro=gyro, accel_walk=noise.accel_walk, gyro_walk=noise.gyro_walk
    )
    process.add_slip(Q, dt, moving, onset, w, pace.unrest, slip)
    size = noise.vibration * np.minimum(np.abs(speed) / noise.vibration_speed, 2.0)
    if nominal.vibration_left is not None:
        size = size * nominal.vibration_left[index]
    process.add_vibration(Q, F, dt, moving, size, omega)
    Q[onset, process.BM, process.BM] += noise.motion_bias**2
    inflate(Q, t, dt, moving, faults, imu, nominal.rest, None if rolling is None else pace.growth)
    updates: list[list[Update]] = [[] for _ in range(t.size)]
    # a standstill that was named: the wheels may spin while the body stands
    spinning = rest & (np.abs(speed) > MOVING)
    Q[spinning, D, D] += FREE**2
    add_rest(updates, imu, nominal, noise, faults, index, rest, np.where(spinning, 0.0, speed))
    start = 0.0
    if rolling is not None:
        pull = thrust(imu, nominal.rest, index, pace)
        change = np.gradient(pull, t)
        Q[:, D, D] += moving * (compliance * change) ** 2 * LOOSE_TIME * dt
        start = add_wheels(updates, rolling, nominal, index, rest, spinning, offset, lost, loss, w, pull)
    if distance is not None:
        H = np.zeros((1, SIZE))
        H[0, [X, P]] = 1.0, -1.0
        updates[-1].append(Update("distance", distance.value - float(nominal.x[-1]), H, distance.std**2))
    x0 = np.zeros((SIZE, 1))
    x0[TH, 0] = -nominal.pitch[0]
    x0[BA, 0] = -nominal.accel_bias
    x0[BG, 0] = -nominal.gyro_bias
    v_std = ZERO_VELOCITY if rest[0] else 1.0 + abs(speed[0])
    std = np.array([
        1e-6, np.hypot(1e-6, start), v_std, noise.pitch, noise.accel_bias,
        max(noise.gyro_bias, abs(nominal.gyro_bias)), 1e-7 if rest[0] else noise.motion_bias,
        1e-6 if rest[0] else slip.limit, 1e-6 if rest[0] else slip.scatter, offset_std, noise.accel_scale,
        1e-8 if slip.memory else soft, 1e-8 + size[0] / omega**2, 1e-7 + size[0] / omega,
    ])  # fmt: skip
    if louder:
        updates = [[replace(u, R=u.R * louder.get(u.kind, 1.0)) for u in several] for several in updates]
    return Nodes(
        index=index, t=t, moving=moving, lost=lost, mean_slip=mean_slip, w=w, F=F, Q=Q,
        updates=tuple(tuple(u) for u in updates), x0=x0, P0=np.diag(std**2), thinned=thinned,
    )  # fmt: skip
