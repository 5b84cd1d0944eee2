"""What the wheel encoders say: signs and sides, rolled distances, circumferential velocities and their noise.

Everything here is on the encoders' own clock. Distances are of the tread, angle times radius.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.errors import EstimateError
from granite_lab.estimation.motion import mean_known
from granite_lab.logs.counters import integral, joined, runs
from granite_lab.logs.sensors.mounting import BodyImu
from granite_lab.logs.sensors.standstill import bridged
from granite_lab.logs.trial import Array, WheelStream
from granite_lab.parameters import WHEELS, Robot

MOVING = 0.02
"""Wheel velocity [m/s] above which a wheel certainly rolls."""

MEET = 2.5
"""Confidence intervals of slopes reach this many std to either side."""

STUCK_AFTER = 0.25
"""A wheel without a count for this long [s], while the others roll, is taken for a dead encoder."""

COUNTS = 3.0
"""It must have missed this many counts."""

SHARED, SLOWEST = 0.2, 1.0e-3
"""Samples share the error of the last count for this long [s] at most, of wheels this fast [m/s] at least:
slower ones are about to stand."""

STEP = 0.01
"""Spacing of the grid on which wheels and IMU are compared [s]."""

REACH = 40
"""Lags searched to either side, for the clocks may be that far apart [steps]."""

ALIKE = 0.9
"""Wheels whose velocities correlate this much, up to the sign, drive straight (or turn in place)."""

CLEAR = 0.4
"""Correlation with the IMU from which on a direction counts as seen."""

TURNING = 0.25
"""Gyro over yaw rate by the wheels from which on the robot really turns; skidding takes half of it."""

AXES = "give its [imu] rotation in the robot's file, or let forward = 'find' look for it"
"""What to do about an IMU whose axes are not the robot's."""


@dataclass(frozen=True, eq=False)
class Rolling:
    """Wheel motion at the encoders' stamps."""

    t: Array  # (M,) [s]
    distance: Array  # (M, 4) rolled distance of each wheel since the first sample [m], NaN where unknown
    mean: Array  # (M,) rolled distance, mean of the left and right sides [m]
    mean_std: Array  # (M,) std of one sample of it [m] (quantisation and stamps)
    velocity: Array  # (M, 4) circumferential velocity v_o of each wheel [m/s]
    velocity_std: Array
    speed: Array  # (M,) velocity of `mean` [m/s]
    speed_std: Array
    by_rate: bool  # the logger gave rates; distances are their integrals and not measurements
    resolution: tuple[float, ...]  # (4,) of each distance [m] (of each velocity [m/s] if by_rate)
    warnings: tuple[str, ...] = ()  # doubts, one line each

    @property
    def step(self) -> float:
        """The coarsest resolution of the four [m] or [m/s]."""
        return max(self.resolution)

    def speed_at(self, t: Array | float, offset: float = 0.0) -> Array:
        """Return `speed` at instants of a clock that the encoders' lies behind by `offset` [s]."""
        return joined(t, self.t + offset, self.speed)


def roll(stream: WheelStream, robot: Robot) -> Rolling:
    """Turn encoder angles into rolled distances and velocities with their std.

    The noise of one sample is q^2/12 (which makes q^2/(6 dt^2) in a difference) and, while rolling,
    the velocity times the scatter of the stamps, found from how the distances scatter about a
    locally smooth motion; the robot's file is the floor of the former.
    """
    t, counts = stream.t, robot.encoders.counts
    usual = 2 * np.pi / counts if counts and stream.rate is None else 0.0
    resolution = tuple((step or usual) * robot.wheels.radius for step in stream.resolution)
    if stream.rate is not None:
        return _roll_rates(t, bridge(t, stream.rate) * robot.wheels.radius, resolution)
    distance = bridge(t, stream.angle) * robot.wheels.radius
    increment, warnings = mask_dead(t, distance, resolution)
    mean_step = side_mean(increment)
    lost = ~np.isfinite(mean_step)
    lost[0] = False
    mean = np.cumsum(np.nan_to_num(mean_step))
    mean[lost] = np.nan
    quantum = max(*resolution, 1e-6)
    n_live = np.maximum(np.isfinite(increment).sum(axis=1), 1)
    rough, _ = slope(t, np.nan_to_num(mean, nan=0.0), np.full(t.size, quantum / np.sqrt(12)))
    jitter = stamp_scatter(t, mean, rough, quantum)

    period = float(np.median(np.diff(t)))

    def sigma(wheels: np.ndarray | int, pace: Array) -> Array:
        """Std of one sample of a rolled distance [m]: quantisation per wheel, stamps common to all.

        Samples between two counts share their error; so many of them tell as much as one.
        """
        shared = np.clip(quantum / np.maximum(np.abs(pace), SLOWEST) / period, 1.0, max(SHARED / period, 1.0))
        return np.asarray(np.sqrt(quantum**2 / 12.0 * shared / wheels + (jitter * pace) ** 2))

    speed, speed_std = slope(t, np.nan_to_num(mean), sigma(n_live, rough))
    mean_std = sigma(n_live, speed)
    velocity, velocity_std = np.full_like(distance, np.nan), np.full_like(distance, np.nan)
    for i in range(distance.shape[1]):
        use = np.isfinite(increment[:, i])
        use[1:-1] &= use[:-2] | use[2:]
        use[0] = np.isfinite(distance[0, i]) and use[1:2].any()
        for a, b in runs(use):
            if b - a >= 3:
                own = np.concatenate([[0.0], np.cumsum(increment[a + 1 : b, i])])
                velocity[a:b, i], velocity_std[a:b, i] = slope(t[a:b], own, sigma(1, speed[a:b]))
    speed[~np.isfinite(mean)] = np.nan
    first = np.nan_to_num(distance[np.isfinite(distance).argmax(axis=0), np.arange(distance.shape[1])])
    return Rolling(
        t=t, distance=np.where(np.isfinite(increment), distance - first, np.nan), mean=mean,
        mean_std=mean_std, velocity=velocity, velocity_std=velocity_std, speed=speed, speed_std=speed_std,
        by_rate=False, resolution=resolution, warnings=tuple(warnings),
    )  # fmt: skip


def _roll_rates(t: Array, velocity: Array, resolution: tuple[float, ...]) -> Rolling:
    """Take logged rates, as velocities (M, 4) [m/s]; the distances are their integrals."""
    dt, none = np.diff(t, prepend=t[0]), (0.0,) * velocity.shape[1]
    increment, warnings = mask_dead(t, np.cumsum(dt[:, None] * np.nan_to_num(velocity), axis=0), none)
    velocity = np.where(np.isfinite(increment) | (dt == 0)[:, None], velocity, np.nan)
    speed = side_mean(velocity)
    known = np.isfinite(speed)
    bend = np.abs(np.diff(np.nan_to_num(speed), n=2, prepend=0.0, append=0.0))
    scatter = 1.4826 * float(np.median(bend[known])) / np.sqrt(6.0) if known.any() else 0.0
    floor = max(max(resolution) / np.sqrt(12.0), scatter, 1e-3)
    mean = integral(t, joined(t, t, speed) if known.any() else np.zeros_like(speed))
    distance = np.cumsum(dt[:, None] * np.nan_to_num(velocity), axis=0)
    distance[~np.isfinite(velocity)] = np.nan
    return Rolling(
        t=t, distance=distance, mean=mean, mean_std=np.full(speed.size, np.nan), velocity=velocity,
        velocity_std=np.where(np.isfinite(velocity), floor, np.nan), speed=speed,
        speed_std=np.full(speed.size, floor), by_rate=True, resolution=resolution, warnings=tuple(warnings),
    )  # fmt: skip


def bridge(t: Array, angle: Array) -> Array:
    """Fill the cells of wheels that are sampled at other rows; longer gaps than 3 periods stay NaN."""
    filled = angle.copy()
    for wheel in filled.T:
        known = np.isfinite(wheel)
        if 1 < known.sum() < t.size:
            between = bridged(t, known, 3.0 * float(np.median(np.diff(t[known])))) & ~known
            wheel[between] = joined(t[between], t, wheel)
    return filled


def mask_dead(t: Array, distance: Array, resolution: Sequence[float]) -> tuple[Array, list[str]]:
    """Blank a wheel where it gives no count, or jumps, while the others roll; also warn.

    Args:
        t: (M,) stamps [s].
        distance: (M, 4) rolled distances [m].
        resolution: (4,) their smallest steps [m], below which no count is expected.

    Returns:
        (M, 4) increments to each sample from the one before [m], NaN where not to be used; warnings.
    """
    step = np.diff(distance, axis=0, prepend=np.full((1, distance.shape[1]), np.nan))
    dt = np.diff(t, prepend=t[0] - 1.0)
    warnings = []
    with np.errstate(invalid="ignore"):
        live = np.isfinite(step).sum(axis=1)
        wild = np.abs(step - _median(step)[:, None]) > 3.0 * dt[:, None] + 0.05
    step[wild & (live >= 3)[:, None]] = np.nan
    for i, wheel in enumerate(WHEELS):
        if not np.isfinite(step[:, i]).any():
            continue
        others = np.nan_to_num(_median(np.delete(step, i, axis=1)))
        rolling = np.abs(others) > MOVING * dt
        dead = 0.0
        for a, b in runs(np.nan_to_num(step[:, i]) == 0.0):
            at = np.arange(a, b)[rolling[a:b]]
            silent, way = float(dt[at].sum()), abs(float(others[at].sum()))
            if silent >= STUCK_AFTER and way > COUNTS * resolution[i]:
                step[a : b + 1, i] = np.nan  # the sample after it may hold the missed counts at once
                dead += silent
        if dead > 0:
            warnings.append(
                f"encoder {wheel} gives no counts for {dead:.2f} s while the others turn: not used there"
            )
    return step, warnings


def _median(values: Array) -> Array:
    """Median over the wheels, NaN where none is known."""
    known = np.isfinite(values).any(axis=1)
    median = np.full(known.size, np.nan)
    median[known] = np.nanmedian(values[known], axis=1)
    return median


def side_mean(values: Array) -> Array:
    """Mean of the left and right sides' means, so that a missing wheel does not look like a turn."""
    return mean_known(np.stack([mean_known(values[:, side::2]) for side in (0, 1)], axis=1))


def slope(t: Array, y: Array, sigma: Array) -> tuple[Array, Array]:
    """Differentiate y (M,) by local straight lines, the window as wide as the motion allows.

    At each sample the windows of 5, 9 and 17 samples are tried in turn; one is kept as long as
    its confidence interval meets those of all narrower ones (Goldenshluger & Nemirovski 1997), so
    corners stay sharp and steady motion is smooth. Also its std, by the std `sigma` (M,) of the samples.
    """
    m = t.size
    low, high = np.full(m, -np.inf), np.full(m, np.inf)
    best, best_std = np.full(m, np.nan), np.full(m, np.nan)
    going = np.ones(m, dtype=bool)
    for half in (2, 4, 8):
        value, std = _line(t, y, sigma, min(half, m - 1))
        low, high = np.maximum(low, value - MEET * std), np.minimum(high, value + MEET * std)
        going &= low <= high
        best, best_std = np.where(going, value, best), np.where(going, std, best_std)
    return best, best_std


def _line(t: Array, y: Array, sigma: Array, half: int) -> tuple[Array, Array]:
    """Slope of the least squares line through 2 half + 1 samples (fewer at the ends), and its std."""
    index = np.arange(t.size)[:, None] + np.arange(-half, half + 1)
    inside = (index >= 0) & (index < t.size)
    index = np.clip(index, 0, t.size - 1)
    tt, yy = (t[index] - t[:, None]) * inside, (y[index] - y[:, None]) * inside
    n = inside.sum(axis=1)
    tc = (tt - (tt.sum(axis=1) / n)[:, None]) * inside
    spread = (tc**2).sum(axis=1)
    spread = np.where(spread > 0, spread, np.inf)
    return (tc * yy).sum(axis=1) / spread, sigma / np.sqrt(spread)


def stamp_scatter(t: Array, mean: Array, speed: Array, quantum: float) -> float:
    """Std of the stamps [s]: scatter of the distance about cubics, over the velocity.

    Fourth differences cancel any motion that is cubic over five samples; their variance is 70 times
    that of one sample, on evenly spaced stamps.
    """
    fast = np.abs(speed) > 0.3 * max(float(np.nanmax(np.abs(speed), initial=0.0)), MOVING)
    width = 5
    index = np.arange(mean.size - width + 1)[:, None] + np.arange(width)
    ok = fast[index].all(axis=1) & np.isfinite(mean[index]).all(axis=1)
    if ok.sum() < 8:
        return 0.0
    tt = t[index[ok]] - t[index[ok][:, 2]][:, None]
    # divided differences handle stamps that are not even
    apart = tt[:, :, None] - tt[:, None, :] + np.eye(width)
    weights = np.divide.reduce(apart, axis=2, initial=1.0)
    contrast = (weights * mean[index[ok]]).sum(axis=1) / np.sqrt((weights**2).sum(axis=1))
    scatter = 1.4826 * float(np.median(np.abs(contrast)))
    typical = float(np.median(np.abs(speed[fast])))
    return float(np.sqrt(max(scatter**2 - quantum**2 / 12.0 / 4.0, 0.0)) / typical)


def check_signs(
    wheels: WheelStream, imu: BodyImu | None, robot: Robot, *, forward_known: bool
) -> tuple[WheelStream, tuple[str, ...]]:
    """Turn wheels that count backwards, and exchange the sides where the gyro shows that they are.

    Wheels of opposite signs either turn the robot in place, which the yaw gyro sees, or some of them
    count backwards. Front and rear of a side cannot be told apart by the motion of the frame. If the IMU's
    forward axis is known, it also tells forwards from backwards.

    Returns:
        the stream with corrected signs and sides; what was corrected or is doubtful.

    Raises:
        EstimateError: the IMU's axes are not those of the robot.
    """
    grid, speed = _speeds(wheels, robot)
    live = np.flatnonzero(np.nan_to_num(np.abs(speed)).max(axis=0, initial=0.0) > MOVING)
    if live.size == 0 or grid.size < 4 * REACH:
        return wheels, ()
    judge = imu if forward_known else None
    said: list[str] = []
    yaw = None
    if imu is not None and np.isfinite(imu.yaw_rate).any():
        yaw = joined(grid, imu.t, imu.yaw_rate - float(np.nanmedian(imu.yaw_rate)))
    sign = _relative_signs(speed, live)
    if (sign[live] < 0).any():
        left, right = ({float(sign[i]) for i in live if i % 2 == side} for side in (0, 1))
        if len(left) == len(right) == 1 and left != right:
            if yaw is None:
                said.append("left and right wheels turn against each other, and no yaw gyro tells why")
                return wheels, tuple(said)
            turn = _turn(speed, robot)
            if abs(float(yaw @ turn) / max(float(turn @ turn), 1e-12)) > TURNING:
                return wheels, ()
        sign = _choose_side(sign, live, speed, judge, grid)
        names = [WHEELS[i] for i in live if sign[i] < 0]
        said.append(f"encoder {', '.join(names)} counts against the others: its sign was turned")
        speed = speed * sign
    if judge is not None and _against(judge, grid, speed):
        sign, speed = -sign, -speed
        said.append("the encoders count backwards, by the IMU: their signs were turned")
    order = list(range(4))
    if yaw is not None and float(np.std(yaw)) > 0.05:
        turn = _turn(speed, robot)
        if float(np.std(turn)) > 0.05 and _correlation(yaw - yaw.mean(), turn - turn.mean()) < -0.7:
            order = [1, 0, 3, 2]
            said.append("the sides of the encoders are exchanged, by the gyro: put right")
    if not said:
        return wheels, ()
    angle, rate = (None if v is None else (v * sign)[:, order] for v in (wheels.angle, wheels.rate))
    assert angle is not None
    resolution = tuple(wheels.resolution[i] for i in order)
    return replace(wheels, angle=angle, rate=rate, resolution=resolution), tuple(said)


def _speeds(wheels: WheelStream, robot: Robot) -> tuple[Array, Array]:
    """Even stamps (K,) [s] and the wheels' velocities there (K, 4) [m/s], smoothed, NaN without encoder."""
    grid = np.arange(wheels.t[0], wheels.t[-1], STEP)
    speed = np.full((grid.size, 4), np.nan)
    for i, angle in enumerate(wheels.angle.T):
        if grid.size > 1 and np.isfinite(angle).sum() > 2:
            rate = np.gradient(joined(grid, wheels.t, angle), STEP)
            speed[:, i] = uniform_filter1d(rate, 9) * robot.wheels.radius
    return grid, speed


def _relative_signs(speed: Array, live: np.ndarray) -> Array:
    """(4,) signs against the first live wheel; all +1 where the wheels do not move alike."""
    sign, moves = np.ones(4), np.nan_to_num(speed[:, live].T)
    alike = np.array([_correlation(moves[0], one) for one in moves])
    if np.abs(alike).min() >= ALIKE:
        sign[live] = np.sign(alike)
    return sign


def _turn(speed: Array, robot: Robot) -> Array:
    """(K,) yaw rate by the difference of the sides [rad/s], positive to the left."""
    left, right = (np.nan_to_num(mean_known(speed[:, side::2])) for side in (0, 1))
    return np.asarray((right - left) / (robot.chassis.track if robot.chassis else 0.5))


def _choose_side(sign: Array, live: np.ndarray, speed: Array, imu: BodyImu | None, grid: Array) -> Array:
    """Say which of two groups of wheels is wrong: the smaller, else by the IMU, else the one going back."""
    ahead = int((sign[live] > 0).sum())
    if 2 * ahead != live.size:
        return sign if 2 * ahead > live.size else -sign
    common = np.nan_to_num(mean_known(speed * sign))
    if imu is not None:
        gain, clearness = _forward_gain(imu, grid, common)
        if clearness > CLEAR:
            return sign if gain[0] > 0 else -sign
    return sign if float(common.sum()) >= 0 else -sign


def _against(imu: BodyImu, grid: Array, speed: Array) -> bool:
    """Say whether all encoders count backwards; refuse an IMU whose x axis is not the robot's."""
    common = np.nan_to_num(mean_known(speed))
    gain, clearness = _forward_gain(imu, grid, common)
    heading = np.degrees(np.arctan2(gain[1], gain[0]))
    if clearness < CLEAR or abs(heading) < 45 or not 0.3 < np.hypot(*gain) < 3.0:
        return False
    if abs(heading) <= 135:
        raise EstimateError(
            f"the IMU is accelerated {heading:.0f} deg beside its x axis when the wheels gain speed: "
            "its axes are not the robot's",
            AXES,
        )
    if float(common.sum()) < 0:
        return True
    raise EstimateError(
        "the IMU is accelerated backwards while the wheels gain speed: its x axis points backwards", AXES
    )


def _forward_gain(imu: BodyImu, grid: Array, speed: Array) -> tuple[Array, float]:
    """Regress the horizontal specific force (2,) on the wheels' acceleration at the best lag.

    Also how clear the matter is: the share of the force that it explains.
    """
    wheel = _without_trend(np.gradient(speed, STEP))
    axes = (v if np.isfinite(v).any() else np.zeros(v.size) for v in (imu.forward, imu.left))
    force = [_without_trend(joined(grid, imu.t, values)) for values in axes]
    power = float(wheel @ wheel)
    if power * STEP < 0.01:
        return np.zeros(2), 0.0
    lags = range(-REACH, REACH + 1)
    gains = np.array([[float(np.roll(wheel, lag) @ f) / power for f in force] for lag in lags])
    best = gains[int(np.argmax(np.hypot(*gains.T)))]
    along = best / max(float(np.hypot(*best)), 1e-12)
    common = along[0] * force[0] + along[1] * force[1]
    return best, float(np.hypot(*best) * np.sqrt(power / max(float(common @ common), 1e-12)))


def _without_trend(signal: Array) -> Array:
    """Smooth over 0.1 s, and leave out what is slower than a ramp (pitch on slopes)."""
    smooth = uniform_filter1d(signal, round(0.1 / STEP), mode="nearest")
    return np.asarray(smooth - uniform_filter1d(smooth, round(3.0 / STEP), mode="nearest"))


def _correlation(a: Array, b: Array) -> float:
    return float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-12)
