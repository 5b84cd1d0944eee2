"""The linear model of the drift: states, transition and process noise between two nodes, measurements.

The states are corrections to the nominal motion of `integrate`, so they change slowly:

    x  = x_nominal + X - P          distance of R, without the frame's vibration
    v  = v_nominal + V - PD         velocity of R
    pitch = pitch_nominal + TH

    dV/dt  = g cos(pitch) TH - BA - BM - K a   accelerometer bias with mounting tilt; motion-only bias;
                                               scale error K times the acceleration a
    dTH/dt = -BG
    dD/dt  = (S + G) w                         D: rolled minus travelled distance, w: wheel speed
                                               (what the onset's mean slip ratio makes is taken out)
    P'' + 2 zeta omega P' + omega^2 P = noise  vibration: bounded, so its integral is bounded too

The rolled distance is x + D + C F: where tyres twist, gears have play or the mount is soft, the wheels turn
ahead of the body by the compliance C [s^2] times the thrust over mass F [m/s^2].

Slip velocity is (S + G) w: a slip ratio that wanders (S a random walk, G coloured about it) while
the wheels turn, and no slip velocity at rest. It is not assumed to be small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import product
from math import factorial

import numpy as np

from granite_lab.estimation.nominal import Nominal
from granite_lab.estimation.reference import Readings
from granite_lab.estimation.wheels import Rolling, nearest
from granite_lab.logs.counters import repeated, runs
from granite_lab.logs.sensors.faults import Faults
from granite_lab.logs.sensors.mounting import BodyImu
from granite_lab.logs.sensors.standstill import ZERO_VELOCITY
from granite_lab.logs.trial import Array

X, D, V, TH, BA, BG, BM, S, G, TAU, K, C, P, PD = range(14)

SIZE = 14

TINY = np.array([1e-8, 1e-8, 1e-7, 1e-9, 1e-9, 1e-10, 1e-8, 1e-7, 1e-7, 1e-8, 1e-9, 1e-9, 1e-9, 1e-8])
"""Std added per step, so that no predicted covariance is singular, in each state's own unit."""

RETURN, MEMORY = 30.0, 2.0
"""Slip far from standstills returns to its mean in this time; its wheel speed is averaged over this [s]."""

V_FLOOR = 0.02
"""v_floor of (1) [m/s]."""

UNEVEN = 1.0
"""Acceleration that may come or go between a sample of the wheels and the nearest of the IMU [m/s^2]."""

NEAREST = 1.0e-5
"""Std of the rolled distance beyond quantisation [m]: play, and the wheel's own shape."""


@dataclass(frozen=True)
class Noise:
    """Noise that the filter works with; densities are of both-sided spectra (std times sqrt(dt)).

    Attributes:
        accel, gyro: white noise [m/s^2 sqrt(s)], [rad/s sqrt(s)].
        accel_stamps: what the stamps' scatter makes of vibration; the larger of it and `accel_motion` counts.
        accel_bias, gyro_bias: std before the first standstill [m/s^2], [rad/s]; the former with tilt.
        accel_walk, gyro_walk: random walk of the biases [m/s^2/sqrt(s)], [rad/s/sqrt(s)].
        accel_scale, gyro_scale: std of the scale errors of accelerometer and pitch gyro [-].
        motion_bias: std of a bias that is there only in motion [m/s^2].
        vibration: rms of the frame's vibration along x in motion [m/s^2] at `vibration_speed` [m/s].
        vibration_frequency: its dominant frequency [Hz].
        vibration_damping: its damping ratio (relative bandwidth over two).
        accel_motion, gyro_motion: white noise that is there only in motion, the former below the vibration.
        accel_level, gyro_level: std of what all readings of a standstill are off alike, and those in motion
            are not, by rounding or a dead band [m/s^2], [rad/s].
    """

    accel: float
    gyro: float
    accel_stamps: float
    accel_bias: float
    gyro_bias: float
    accel_walk: float
    gyro_walk: float
    accel_scale: float
    motion_bias: float
    vibration: float
    vibration_speed: float
    vibration_frequency: float
    vibration_damping: float
    accel_motion: float = 0.0
    gyro_motion: float = 0.0
    accel_level: float = 0.0
    gyro_level: float = 0.0
    gyro_scale: float = 0.0

    @property
    def vibration_omega(self) -> float:
        """Angular frequency of the vibration [rad/s]."""
        return 2 * np.pi * self.vibration_frequency

    def as_dict(self) -> dict[str, float]:
        """Return the figures by name, unit in the name, as the motion record keeps them."""
        return {
            "accel_noise_mps2_sqrts": self.accel,
            "gyro_noise_radps_sqrts": self.gyro,
            "accel_noise_in_motion_mps2_sqrts": self.accel_motion,
            "accel_noise_by_stamps_mps2_sqrts": self.accel_stamps,
            "accel_bias_prior_mps2": self.accel_bias,
            "gyro_bias_prior_radps": self.gyro_bias,
            "accel_bias_walk_mps2_per_sqrts": self.accel_walk,
            "gyro_bias_walk_radps_per_sqrts": self.gyro_walk,
            "accel_scale_error_prior": self.accel_scale,
            "gyro_scale_error_prior": self.gyro_scale,
            "motion_bias_prior_mps2": self.motion_bias,
            "vibration_mps2": self.vibration,
            "vibration_frequency_hz": self.vibration_frequency,
            "vibration_damping": self.vibration_damping,
            "accel_level_error_mps2": self.accel_level,
            "gyro_level_error_radps": self.gyro_level,
        }


@dataclass(frozen=True)
class SlipModel:
    """How the slip ratio may change.

    Attributes:
        steady, per_acceleration: expected slip ratio on soft ground, steady [-] and more for each
            m/s^2 that the wheels gain [s^2/m]: resistance there is about a tenth of the weight, so an
            acceleration of a tenth of g takes as much thrust, and slip, again; and braking gives it back.
        onset: std about the expected value after a standstill [-].
        walk: random walk of S [1/sqrt(s)] in steady motion.
        ramp: walk added per square root of relative change of wheel speed [-].
        scatter, time: std [-] and correlation time [s] of G.
        limit: std that caps one step's noise of S [-]; far from standstills, that of S.
        far: far from standstills a random walk would lose the velocity: S reverts to 0 within `RETURN`. The
            expected slip ratio is proportional to the thrust, `steady` at constant speed. It is multiplied by
            the wheel speed averaged over `MEMORY`, so that a change of speed says nothing about a steady slip
            ratio.
        fades: the steady slip ratio goes down with the speed below `V_FLOOR`, as the ground's resistance
            does: wheels that coast to rest slip less. The moments that tell the clocks' offset are judged
            without it, or twisting tyres pass for an offset.
    """

    steady: float = 0.15
    per_acceleration: float = 0.15
    onset: float = 0.35
    walk: float = 0.005
    ramp: float = 0.25
    scatter: float = 0.06
    time: float = 2.0
    limit: float = 0.5
    far: bool = False
    fades: bool = False

    def expected(self, growth: Array, speed: Array) -> Array:
        """(K,) slip ratio expected while the wheels' speed (K,) [m/s] grows by `growth` (K,) [m/s^2]."""
        resisted = np.tanh(np.abs(speed) / V_FLOOR) if self.fades else 1.0
        return np.clip(self.steady * resisted + self.per_acceleration * growth, -0.3, 0.5)


FAR_FROM_REST = SlipModel(
    steady=0.0, per_acceleration=0.0, onset=0.0, walk=0.0, ramp=0.0, scatter=0.05, time=0.3, limit=0.05,
    far=True,
)  # fmt: skip
"""Deviation of slip from the expected where no standstill is near; `ANY_SLIP` is beside it."""

ANY_SLIP = 3.0**-0.5
"""Root mean square of a slip ratio that is anywhere from 0 to 100 %. It is in the std only: in the estimate
it would give way to every drift of the pitch."""

LOST_PITCH = 0.005
"""Random walk of the pitch far from standstills [rad/sqrt(s)]: turns and shaking mislead the gyro."""


@dataclass(frozen=True, eq=False)
class Places:
    """The K nodes, and the steps into each from the one before.

    Attributes:
        index: (K,) places of the nodes among the IMU's stamps.
        t: (K,) stamps [s].
        moving: (K,) False for a step within a standstill.
        lost: (K,) rolled minus travelled distance by the mean slip ratio alone [m].
        mean_slip: (K,) that slip ratio, to which S and G are deviations.
        w: (K,) signed wheel speed [m/s], floor included, that turns slip ratio into slip velocity.
    """

    index: np.ndarray
    t: Array
    moving: np.ndarray
    lost: Array
    mean_slip: Array
    w: Array


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


@dataclass(frozen=True, eq=False)
class Course(Places, Pace):
    """How a trial goes at the nodes; without wheels the pace is the body's.

    Attributes:
        dt: (K,) how long the steps last [s].
        coupling: (K,) g cos(pitch) [m/s^2].
        rest, onset: (K,) True at standstill, and for the step that leaves one.
        spinning: (K,) True where the wheels turn at standstill.
        loss: (K,) slip velocity by the mean slip ratio [m/s].
        thrust: (K,) over mass, against that at standstill [m/s^2]; 0 without wheels.
    """

    dt: Array
    coupling: Array
    rest: np.ndarray
    onset: np.ndarray
    spinning: np.ndarray
    loss: Array
    thrust: Array


def transitions(course: Course, gain: Array, slip: SlipModel, noise: Noise, *, pitch_gyro: bool) -> Array:
    """(K, 14, 14) transition matrices; the accelerometer adds the velocity `gain` (K,) [m/s] in each step."""
    dt, on, coupling = course.dt, course.moving.astype(float), course.coupling
    F, h = np.tile(np.eye(SIZE), (dt.size, 1, 1)), on * dt
    F[:, X, V], F[:, V, TH], F[:, X, TH] = h, coupling * h, coupling * h**2 / 2
    F[:, V, BA] = F[:, V, BM] = -h
    F[:, X, BA] = F[:, X, BM] = -(h**2) / 2
    F[:, V, K], F[:, X, K] = -on * gain, -0.5 * gain * h
    F[:, D, S] = F[:, D, G] = course.w * h
    if pitch_gyro:
        F[:, TH, BG], F[:, V, BG], F[:, X, BG] = -h, -coupling * h**2 / 2, -coupling * h**3 / 6
    F[:, BM, BM] = on
    F[:, S, S] = on * (np.exp(-dt / RETURN) if slip.far else 1.0)
    F[:, G, G] = on * np.exp(-dt / slip.time)
    F[:, P:, P:] = on[:, None, None] * resonator(dt, noise)
    return F


def resonator(dt: Array, noise: Noise) -> Array:
    """(K, 2, 2) exact transition of displacement and velocity of the vibration (zeta < 1)."""
    omega, zeta = noise.vibration_omega, noise.vibration_damping
    damped = omega * np.sqrt(1 - zeta**2)
    decay, c, s = np.exp(-zeta * omega * dt), np.cos(damped * dt), np.sin(damped * dt)
    k = zeta * omega / damped
    return np.asarray(
        np.moveaxis(np.array([[c + k * s, s / damped], [-(omega**2) / damped * s, c - k * s]]) * decay, 2, 0)
    )


def add_noise(Q: Array, variance: Array, gains: Mapping[int, Array | float]) -> None:
    """Add white noise, of the `variance` (K,) in a step, to Q (K, 14, 14) in place.

    It enters the first state of `gains`, the second integrates that one, and so on: an impulse at the share s
    of the step before its end changes the i-th state by its gain times s^i / i!.
    """
    for (i, (first, a)), (j, (second, b)) in product(enumerate(gains.items()), repeat=2):
        Q[:, first, second] += variance * a * b / (factorial(i) * factorial(j) * (i + j + 1))


def noises(F: Array, course: Course, gyro: Array, size: Array, slip: SlipModel, noise: Noise) -> Array:
    """(K, 14, 14) process noise over each step of `transitions` F.

    At the nodes (K,): white noise `gyro` of the pitch rate [rad/s sqrt(s)]; rms `size` of the acceleration by
    vibration [m/s^2], at which the oscillator is kept.
    """
    dt, on, onset = course.dt, course.moving.astype(float), course.onset
    Q = np.tile(np.diag(TINY**2), (dt.size, 1, 1))
    accel = np.hypot(noise.accel, max(noise.accel_motion, noise.accel_stamps))
    add_noise(Q, on * accel**2 * dt, {V: 1.0, X: dt})
    add_noise(Q, on * gyro**2 * dt, {TH: 1.0, V: course.coupling * dt, X: course.coupling * dt**2})
    Q[:, BA, BA] += noise.accel_walk**2 * dt
    Q[:, BG, BG] += noise.gyro_walk**2 * dt
    Q[onset, BM, BM] += noise.motion_bias**2
    walk = slip.walk**2 + 2 * slip.limit**2 / RETURN * slip.far + slip.ramp**2 * course.unrest
    walked = on * np.minimum(walk * dt, slip.limit**2) + onset * slip.onset**2
    scattered = np.where(onset, 1.0, on * (1 - np.exp(-2 * dt / slip.time))) * slip.scatter**2
    turned = np.where(onset, 0.0, course.w * dt)  # a standstill is left with the slip ratio that follows it
    add_noise(Q, walked, {S: 1.0, D: turned})
    add_noise(Q, scattered, {G: 1.0, D: turned})
    kept = (size[:, None] / noise.vibration_omega ** np.array([2, 1])) ** 2
    A = F[:, P:, P:]
    shaking = kept[:, :, None] * np.eye(2) - (A * kept[:, None]) @ A.transpose(0, 2, 1)
    Q[:, P:, P:] += on[:, None, None] * shaking
    return Q


def std_of(covariance: Array, parts: dict[int, float]) -> Array:
    """(K,) std of a sum of states, each times its factor, by their covariances (K, 14, 14)."""
    variance = sum(a * b * covariance[:, i, j] for i, a in parts.items() for j, b in parts.items())
    return np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True, eq=False)
class Updates:
    """Scalar measurements z = H state + noise of variance R (U in all), in the order the filter takes them.

    Attributes:
        node: (U,) at which node, never falling.
        kind: (U,) which measurement, by name.
        z, H, R: (U,), (U, 14) and (U,).
    """

    node: np.ndarray
    kind: np.ndarray
    z: Array
    H: Array
    R: Array

    def counts(self, n: int) -> list[int]:
        """Return how many there are at each of n nodes."""
        counts: list[int] = np.bincount(self.node, minlength=n).tolist()
        return counts


def updates_of(
    kind: str, node: np.ndarray, z: Array | float, H: Mapping[int, Array | float], R: Array | float
) -> Updates:
    """Measurements of one kind at the nodes (U,); H holds the states' factors that are not 0."""
    rows = np.zeros((node.size, SIZE))
    for state, factor in H.items():
        rows[:, state] = factor
    full = np.zeros(node.size)
    return Updates(node, np.full(node.size, kind), full + z, rows, full + R)


def in_order(parts: Sequence[Updates]) -> Updates:
    """Put measurements together, by node, and at one node as given."""
    node, kind, z, H, R = (np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Updates))
    order = np.argsort(node, kind="stable")
    return Updates(node[order], kind[order], z[order], H[order], R[order])


def rest_updates(
    imu: BodyImu, nominal: Nominal, noise: Noise, faults: Faults, course: Course, shaken: Array,
    creeps: np.ndarray,
) -> list[Updates]:  # fmt: skip
    """Zero-velocity and zero-rate updates, and the level that specific force gives at standstill.

    Wheels that turn meanwhile shake the body by the rms velocity `shaken` (K,) [m/s]. Where it may yet creep,
    `creeps` (K,), the velocity is not measured.
    """
    k = np.flatnonzero(course.rest)
    i = course.index[k]
    # v_nominal is frozen but for the lever's part, which is zero at rest
    R = ZERO_VELOCITY**2 + np.where(course.spinning, 0.0, course.speed)[k] ** 2
    stands = ~creeps[k]
    updates = [updates_of("zero_velocity", k[stands], -nominal.v[i[stands]], {V: 1.0}, R[stands])]
    usable = nominal.rest & ~faults.doubt
    place = np.searchsorted(course.index, np.flatnonzero(usable))  # a sample counts at the next node
    signals = np.ones(usable.size), imu.forward, np.nan_to_num(imu.pitch_rate)
    totals = np.array([np.bincount(place, signal[usable], course.t.size)[k] for signal in signals])
    seen = totals[0] > 0
    k, i, (n, force, rate) = k[seen], i[seen], totals[:, seen]
    alike = np.zeros(course.t.size)
    for a, b in runs(course.rest):
        alike[a:b] = np.count_nonzero((k >= a) & (k < b))  # they share one error
    if imu.has_pitch_rate:
        R = noise.gyro**2 / (n * imu.period)
        updates.append(updates_of("zero_rate", k, rate / n - nominal.gyro_bias, {BG: 1.0}, R))
    z = force / n + imu.gravity * np.sin(nominal.pitch[i]) - nominal.accel_bias
    R = noise.accel**2 / (n * imu.period) + 2.0 * (shaken[k] / (n * imu.period)) ** 2
    R = R + alike[k] * noise.accel_level**2
    return [*updates, updates_of("specific_force", k, z, {BA: 1.0, TH: -nominal.coupling[i]}, R)]


def wheel_updates(rolling: Rolling, nominal: Nominal, course: Course, offset: float) -> tuple[Updates, float]:
    """Rolled distance (or speed, where rates were logged) at the node nearest to each sample.

    Rolled distance counts from the first sample, which is no measurement then; its std [m] is returned.
    """
    t, w, rest = course.t, course.w, course.rest
    stamps = rolling.t + offset
    usable = np.isfinite(rolling.mean) & np.isfinite(rolling.speed)
    usable &= (stamps >= t[0] - 1e-3) & (stamps <= t[-1] + 1e-3)
    samples = np.flatnonzero(usable)
    place = nearest(t, stamps[samples])
    order = np.lexsort((np.abs(t[place] - stamps[samples]), place))
    k, first = np.unique(place[order], return_index=True)
    m = samples[order[first]]
    speed, gained = rolling.speed[m], np.gradient(np.nan_to_num(rolling.speed), rolling.t)[m]
    ahead = t[k] - stamps[m]
    if rolling.by_rate:
        signed = np.sign(course.speed) * course.growth
        H = {V: 1.0, PD: -1.0, TAU: signed[k], S: w[k], G: w[k], C: np.gradient(course.thrust, t)[k]}
        z = speed + gained * ahead - nominal.v[course.index[k]] - course.loss[k]
        return updates_of("wheel", k, z, H, rolling.sample_std[m] ** 2), 0.0
    # carried to the node by the wheels' own velocity: H must not hold the stamps' noise, which
    # is the noise of z as well, or every update would pull the velocity down a little
    z = rolling.mean[m] + ahead * speed + 0.5 * ahead**2 * gained
    z -= nominal.x[course.index[k]] + course.lost[k]
    R = rolling.sample_std[m] ** 2 + (0.5 * UNEVEN * ahead**2) ** 2 + NEAREST**2
    start = float(np.sqrt(R[0])) if k.size else 0.0
    still = rest & np.append(True, rest[:-1]) & np.append(rest[1:], True)
    telling = ~(still | course.spinning)[k]  # a constant reading at rest says nothing new
    telling[:1] = False
    # an offset also moves the wheel speed that the mean slip goes by
    H = {X: 1.0, D: 1.0, P: -1.0, C: course.thrust[k][telling], TAU: (speed - course.loss[k])[telling]}
    R = R[telling] * repeated(rolling.mean[m][telling])
    return updates_of("wheel", k[telling], (z - z[:1])[telling], H, R), start


def reference_updates(readings: Readings, nominal: Nominal, course: Course) -> Updates:
    """Velocity or place of a reference at the node next to each sample; a place counts from the first one.

    What is measured is held against the nominal motion at the sample's own instant: from there to the node
    the drift hardly changes.
    """
    t, inner = course.t, (readings.t >= course.t[0]) & (readings.t <= course.t[-1])
    stamps, value = readings.t[inner], readings.value[inner]
    if readings.kind == "reference_v":
        z, H = value - np.interp(stamps, nominal.t, nominal.v), {V: 1.0, PD: -1.0}
    else:
        z, H = value - np.interp(stamps, nominal.t, nominal.x), {X: 1.0, P: -1.0}
        z = z - z[:1]
    return updates_of(readings.kind, nearest(t, stamps), z, H, readings.std**2)
