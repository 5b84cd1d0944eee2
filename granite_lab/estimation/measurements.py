"""What is measured at the filter's nodes: standstill, rolled distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granite_lab.estimation.faults import Faults
from granite_lab.estimation.integration import Nominal
from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.noise import Noise
from granite_lab.estimation.process import BA, BG, PD, SIZE, TAU, TH, C, D, G, P, S, V, X
from granite_lab.estimation.rolling import Rolling
from granite_lab.logs.trial import Array

ZERO_VELOCITY = 3.0e-4
"""Std of the zero-velocity update [m/s]: what a robot that stands may still move."""


UNEVEN = 1.0
"""Acceleration that may come or go between a sample of the wheels and the nearest of the IMU [m/s^2]."""

NEAREST = 1.0e-5
"""Std of the rolled distance beyond quantisation [m]: play, and the wheel's own shape."""


@dataclass(frozen=True, eq=False)
class Update:
    """One scalar measurement: z = H state + noise of variance R."""

    kind: str
    z: float
    H: Array
    R: float


def add_rest(
    updates: list[list[Update]], imu: BodyImu, nominal: Nominal, noise: Noise, faults: Faults,
    index: np.ndarray, rest: np.ndarray, speed: Array,
) -> None:  # fmt: skip
    """Zero-velocity and zero-rate updates, and the level that specific force gives at standstill."""
    h_velocity, h_rate, h_force = np.zeros((3, 1, SIZE))
    h_velocity[0, V] = 1.0
    h_rate[0, BG] = 1.0
    usable = nominal.rest & ~faults.doubt & np.isfinite(imu.forward)
    period = float(np.median(np.diff(imu.t)))
    force = np.concatenate([[0.0], np.cumsum(np.where(usable, imu.forward, 0.0))])
    rate = np.concatenate([[0.0], np.cumsum(np.where(usable, np.nan_to_num(imu.pitch_rate), 0.0))])
    count = np.concatenate([[0], np.cumsum(usable)])
    has_pitch_rate = imu.has_pitch_rate
    for k in np.flatnonzero(rest):
        i = index[k]
        first = index[k - 1] + 1 if k and rest[k - 1] else i
        # v_nominal is frozen but for the lever's part, which is zero at rest
        updates[k].append(
            Update("zero_velocity", -float(nominal.v[i]), h_velocity, ZERO_VELOCITY**2 + float(speed[k]) ** 2)
        )
        n = count[i + 1] - count[first]
        if n == 0:
            continue
        if has_pitch_rate:
            mean = (rate[i + 1] - rate[first]) / n
            updates[k].append(
                Update("zero_rate", mean - nominal.gyro_bias, h_rate, noise.gyro**2 / (n * period))
            )
        mean = (force[i + 1] - force[first]) / n
        h = h_force.copy()
        h[0, BA] = 1.0
        h[0, TH] = -nominal.coupling[i]
        z = mean + imu.gravity * np.sin(nominal.pitch[i]) - nominal.accel_bias
        updates[k].append(Update("specific_force", float(z), h, noise.accel**2 / (n * period)))


def add_wheels(
    updates: list[list[Update]], rolling: Rolling, nominal: Nominal, index: np.ndarray, rest: np.ndarray,
    spinning: np.ndarray, offset: float, lost: Array, loss: Array, w: Array, thrust: Array,
) -> float:  # fmt: skip
    """Rolled distance (or speed, where rates were logged) at the node nearest to each sample.

    Rolled distance counts from the first sample, which is no measurement then.

    Args:
        offset: by which the encoders' clock lies behind [s].
        w: (K,) wheel speed that turns slip ratio into slip velocity [m/s].
        spinning: (K,) the wheels turn on the spot and tell nothing.
        thrust: (K,) thrust over mass, against that at rest [m/s^2].
        lost, loss: (K,) distance [m] and velocity [m/s] that the mean slip ratio loses.

    Returns:
        std of the first sample [m].
    """
    t = nominal.t[index]
    stamps = rolling.t + offset
    known = np.isfinite(rolling.mean) & np.isfinite(rolling.speed)
    known &= (stamps >= t[0] - 1e-3) & (stamps <= t[-1] + 1e-3)
    samples = np.flatnonzero(known)
    if samples.size == 0:
        return 0.0
    start = 0.0
    place = np.clip(np.searchsorted(t, stamps[samples]), 1, t.size - 1)
    place -= (stamps[samples] - t[place - 1]) < (t[place] - stamps[samples])
    distance = np.abs(t[place] - stamps[samples])
    order = np.lexsort((distance, place))
    first = np.concatenate([[True], np.diff(place[order]) > 0])
    still = rest & np.concatenate([[True], rest[:-1]]) & np.concatenate([rest[1:], [True]])
    acceleration = np.gradient(np.nan_to_num(rolling.speed), rolling.t)
    jerk = np.gradient(thrust, t)
    origin = None
    for j in np.sort(order[first]):
        k, m = int(place[j]), int(samples[j])
        if (still[k] or spinning[k]) and origin is not None:
            continue  # a constant reading at rest says nothing new
        i, ahead = index[k], t[k] - stamps[m]
        speed = float(rolling.speed[m])
        H = np.zeros((1, SIZE))
        if rolling.by_rate:
            H[0, [V, PD, TAU, S, G, C]] = 1.0, -1.0, acceleration[m], w[k], w[k], jerk[k]
            z = speed + acceleration[m] * ahead - nominal.v[i] - loss[k]
            updates[k].append(Update("wheel", z, H, float(rolling.speed_std[m]) ** 2))
            continue
        # carried to the node by the wheels' own velocity: H must not hold the stamps' noise, which
        # is the noise of z as well, or every update would pull the velocity down a little
        here = float(rolling.mean[m]) + ahead * speed + 0.5 * ahead**2 * acceleration[m]
        here -= float(nominal.x[i] + lost[k])
        R = float(rolling.mean_std[m]) ** 2 + (0.5 * UNEVEN * ahead**2) ** 2 + NEAREST**2
        if origin is None:
            origin, start = here, float(np.sqrt(R))
            continue
        H[0, [X, D, P, C]] = 1.0, 1.0, -1.0, thrust[k]
        H[0, TAU] = speed - loss[k]  # an offset also moves the wheel speed that the mean slip goes by
        updates[k].append(Update("wheel", here - origin, H, R))
    return start
