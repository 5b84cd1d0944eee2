"""The filter's nodes: instants, what is measured at each, and the matrices between them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d, uniform_filter1d
from scipy.signal import savgol_filter

from granite_lab.estimate import Estimate
from granite_lab.estimation import error_model as model
from granite_lab.estimation.error_model import BA, BG, BM, PD, SIZE, TAU, TH, Course, D, P, Pace, S, V, X
from granite_lab.estimation.nominal import Nominal
from granite_lab.estimation.problem import Problem
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.counters import mad_std
from granite_lab.logs.sensors.faults import UNSEEN
from granite_lab.logs.sensors.mounting import BodyImu
from granite_lab.logs.sensors.standstill import COAST, GENTLE, MOVING, WINDOW, ZERO_VELOCITY
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

LOOSE_TIME = 0.1
"""Time over which the displacement between wheels and body walks in one direction [s]."""

SWAY = 0.25
"""A body that pitches or gains speed goes on with it for so long [s]."""

ORIGIN = 10.0
"""Std of the place at the start by the origin of an external reference [m]: nothing is known."""

SLOPE = float(np.radians(2.0))
"""Std of the pitch at the start [rad]."""

FREE = 10.0
"""Distance that wheels which spin on the spot may roll between two nodes [m]."""

BAND = 0.05
"""The wheels run steadily within this share of their speed."""

MOST = 60_000
"""More nodes than this are thinned; the IMU is integrated at its own rate all the same."""

UNEXPLAINED = 0.3
"""Acceleration of the body that the wheels' own, steady or not, does not suggest [m/s^2]."""

BEYOND = 3.0
"""A reading that is thrown off by more than this many std of what may go unseen is no jolt of the body."""


@dataclass(frozen=True, eq=False)
class Nodes(model.Places):
    """Everything the filter needs.

    Attributes:
        F, Q: (K, 14, 14) transition and noise into each node.
        updates: the measurements.
        x0, P0: (14, 1) and (14, 14) initial state and covariance.
    """

    F: Array
    Q: Array
    updates: model.Updates
    x0: Array
    P0: Array


def choose(nominal: Nominal, period: float, spacing: float) -> np.ndarray:
    """Pick nodes (K,): stamps `spacing` apart in motion, every 50 ms at rest; fewer in a long log."""
    rest = nominal.rest
    keep = np.zeros(rest.size, dtype=bool)
    keep[np.flatnonzero(~rest)[:: max(1, round(spacing / period), int(np.ceil((~rest).sum() / MOST)))]] = True
    keep[np.flatnonzero(rest)[:: max(1, round(REST_STEP / period))]] = True
    edge = np.flatnonzero(rest[1:] != rest[:-1])
    keep[[0, *edge, *(edge + 1), -1]] = True
    return np.flatnonzero(keep)


def derivative_of(values: Array, window: int, order: int, derivative: int = 1) -> Array:
    """Return a derivative of values on the `GRID`, by polynomials through neighbours (Savitzky and Golay).

    The first and the last value continue beyond the ends.
    """
    return np.asarray(savgol_filter(values, window, order, derivative, GRID, mode="nearest"))


def pace_of(rolling: Rolling, offset: float, t: Array) -> Pace:
    """Judge the wheels' pace at instants (K,) of the IMU's clock, which theirs lies behind by `offset` [s].

    The slip ratio multiplies `calm`: were it `speed`, whose noise is that of the rolled distance as
    well, every update would find a little more slip than there is.
    """
    finite = np.isfinite(rolling.speed) & np.isfinite(rolling.mean)
    stamps, grid = rolling.t[finite] + offset, np.arange(t[0], t[-1] + GRID, GRID)
    speed, pace = (np.interp(at, stamps, rolling.speed[finite]) for at in (t, grid))
    period = max(float(np.median(np.diff(stamps))), GRID)
    window = max(round(0.16 / GRID), 8 * round(period / GRID)) | 1
    if grid.size <= 3 * window:
        none = np.zeros(t.size)
        return Pace(speed, speed, none, none, none > 0)
    path = np.interp(grid, stamps, rolling.mean[finite])
    density = np.interp(grid, stamps, rolling.sample_std[finite]) * np.sqrt(period)
    density *= period if rolling.by_rate else 1.0
    growth, beyond = growth_of(path, density, np.maximum(np.abs(pace), 0.1), window)
    growth *= np.where(pace < 0, -1.0, 1.0)
    # the slip ratio goes on changing for some tenths of a second after the wheels have settled
    relative = beyond / np.maximum(np.abs(pace), 0.1)
    memory = np.exp(-np.arange(0, 2.0, GRID) / 0.4)
    lasting = np.convolve(relative, memory / memory.sum())[: grid.size]
    steady = np.interp(t, grid, maximum_filter1d((beyond > 0).astype(float), 3 * window)) == 0
    quick = np.interp(t, grid, derivative_of(path, window, 2)) if rolling.by_rate else speed
    return Pace(
        speed=speed,
        calm=np.where(steady, np.interp(t, grid, derivative_of(path, 3 * window, 1)), quick),
        unrest=np.interp(t, grid, np.maximum(relative, lasting)),
        growth=np.interp(t, grid, np.where(beyond > 0, growth, 0.0)),
        steady=steady,
    )


def growth_of(path: Array, density: Array, pace: Array, window: int) -> tuple[Array, Array]:
    """Return the acceleration (K,) of a path on the `GRID` [m/s^2], and by how much it is beyond chance.

    A `window` of samples is widened by two, and again, where noise hides more than `GENTLE` and than a change
    of the `pace` (K,) [m/s] by `BAND`: coarse counts show over half a second a ramp that they hide over
    0.16 s. The narrowest window that shows one counts. `density` (K,) is the std of the path's noise times
    the root of its period [m sqrt(s)].
    """
    growth, beyond, clear = np.zeros(path.size), np.zeros(path.size), np.zeros(path.size, dtype=bool)
    while 3 * window < path.size and not clear.all():
        seen, span = derivative_of(path, window, 3, 2), window * GRID
        # std of the second derivative of a cubic through n samples that span T: sqrt(720/n) sigma / T^2
        hidden = 3.0 * density * np.sqrt(720.0 / span) / span**2
        left = ~clear & (beyond == 0.0)
        growth = np.where(left, seen, growth)
        beyond = np.where(left, np.maximum(np.abs(seen) - GENTLE - hidden, 0.0), beyond)
        clear |= (hidden < GENTLE) | (hidden * span < BAND * pace)
        window = 2 * window + 1
    return growth, beyond


def lasting_speed(t: Array, speed: Array, moving: np.ndarray) -> Array:
    """(K,) signed wheel speed [m/s] averaged over `MEMORY` of motion, floor included."""
    grid = np.arange(t[0], t[-1] + 0.1, 0.1)
    on = np.interp(grid, t, moving.astype(float))
    width = 5.0 * model.MEMORY
    weight = gaussian_filter1d(on, width)
    pace = gaussian_filter1d(on * np.interp(grid, t, np.abs(speed)), width) / np.maximum(weight, 1e-3)
    return heading(speed) * np.maximum(np.interp(t, grid, pace), model.V_FLOOR)


def heading(speed: Array) -> Array:
    """(K,) direction, 1 or -1, in which wheels of a signed speed (K,) [m/s] turn.

    Below `COAST` it is that of the last speed beyond it, or of the first one: the sign of a speed that is
    nearly zero is chance, and slip would change its sign with it.
    """
    fast = np.flatnonzero(np.abs(speed) >= COAST)
    if fast.size:
        last = np.searchsorted(fast, np.arange(speed.size), side="right") - 1
        speed = speed[fast[np.maximum(last, 0)]]
    return np.where(speed < 0, -1.0, 1.0)


def thrust(imu: BodyImu, rest: np.ndarray, index: np.ndarray, pace: Pace) -> Array:
    """(K,) thrust over mass at the nodes, against that at standstill [m/s^2].

    Specific force along x is thrust less the ground's resistance, over mass; resistance in sand is about a
    tenth of the weight, against the motion. While the wheels turn steadily, what is fast is vibration.
    """
    calm, quick = (uniform_filter1d(imu.forward, max(round(s / imu.period), 1))[index] for s in (CALM, QUICK))
    force = np.where(pace.steady, calm, quick)
    level = np.mean(imu.forward[rest]) if rest.any() else np.mean(force)
    return np.asarray(force - float(level) + RESISTANCE * np.tanh(pace.speed / model.V_FLOOR))


def course_of(problem: Problem, nominal: Nominal, offset: float) -> Course:
    """Choose the nodes, and judge how wheels and body go at them."""
    slip, rolling = problem.slip, problem.rolling
    index = choose(nominal, problem.imu.period, problem.spacing)
    t, rest, v = nominal.t[index], nominal.rest[index], nominal.v[index]
    before = np.append(rest[0], rest[:-1])
    moving, dt, none = ~(rest & before), np.diff(t, prepend=t[0]), np.zeros(t.size)
    pace = Pace(v, v, none, none, none > 0) if rolling is None else pace_of(rolling, offset, t)
    pull = none if rolling is None else thrust(problem.imu, nominal.rest, index, pace)
    if slip.far:
        w = lasting_speed(t, pace.speed, moving)
        mean_slip = np.clip(slip.steady * pull / RESISTANCE, -0.4, 0.4)
    else:
        w = heading(pace.calm) * np.maximum(np.abs(pace.calm), COAST)
        mean_slip = slip.expected(pace.growth, pace.speed)
    loss = np.where(moving, mean_slip * (w if slip.far else pace.speed), 0.0)
    return Course(
        **vars(pace), index=index, t=t, dt=dt, coupling=nominal.coupling[index], rest=rest, moving=moving,
        onset=before & ~rest, spinning=rest & (np.abs(pace.speed) > MOVING) & problem.spins, w=w,
        mean_slip=mean_slip, loss=loss, lost=np.cumsum(loss * dt), thrust=pull,
    )  # fmt: skip


def build(
    problem: Problem, nominal: Nominal, offset: float, left: Estimate, distance: Estimate | None = None
) -> Nodes:
    """Lay out nodes, matrices and measurements about a nominal motion.

    The wheels' stamps are moved by `offset` [s]; `left` of the clock offset is expected to be left then.
    """
    rolling, noise, course = problem.rolling, problem.noise, course_of(problem, nominal, offset)
    size, creep = shaking(noise, nominal, course), _creep(problem, course)
    F = _transitions(problem, course)
    Q = _process_noise(problem, nominal, course, F, size)
    Q[:, V, V] += creep**2
    shaken = np.where(course.spinning, size / noise.vibration_omega, 0.0)
    begins = np.append(creep[1:] > 0, False)
    parts = model.rest_updates(problem.imu, nominal, noise, problem.faults, course, shaken, begins)
    start = 0.0
    if rolling is not None:
        walked = problem.compliance * np.gradient(course.thrust, course.t)
        Q[:, D, D] += course.moving * walked**2 * LOOSE_TIME * course.dt
        wheels, start = model.wheel_updates(rolling, nominal, course, offset)
        parts.append(wheels)
    parts += _end_updates(problem, nominal, course, distance)
    parts += [model.reference_updates(readings, nominal, course) for readings in problem.reference]
    updates = model.in_order(parts)
    for kind, factor in problem.variance_factors.items():
        updates.R[updates.kind == kind] *= factor
    x0 = np.zeros((SIZE, 1))
    x0[[TH, BA, BG, TAU], 0] = -nominal.pitch[0], -nominal.accel_bias, -nominal.gyro_bias, left.value
    P0 = np.diag(_start_std(problem, nominal, course, float(size[0]), start, left.std) ** 2) + _origin(
        problem
    )
    places = {f.name: getattr(course, f.name) for f in fields(model.Places)}
    return Nodes(**places, F=F, Q=Q, updates=updates, x0=x0, P0=P0)


def _transitions(problem: Problem, course: Course) -> Array:
    """(K, 14, 14) transitions from each node to the next.

    A scale error multiplies acceleration, not the bias that the nominal velocity drifts by.
    """
    t, rest, speed = course.t, course.rest, course.speed
    going = speed - (course.loss if problem.rolling is not None else np.interp(t, t[rest], speed[rest]))
    gain = np.diff(going, prepend=going[0])
    return model.transitions(course, gain, problem.slip, problem.noise, pitch_gyro=problem.imu.has_pitch_rate)


def _process_noise(problem: Problem, nominal: Nominal, course: Course, F: Array, size: Array) -> Array:
    """(K, 14, 14) covariance of what the states change by to each node, beside the wheels' compliance.

    The yaw rate leaks into the pitch gyro by the roll, and keeps its sign for seconds. `size` (K,) is the rms
    of the acceleration by vibration [m/s^2].
    """
    noise = problem.noise
    turn = nominal.roll_std * np.abs(nominal.heading_rate[course.index]) * np.sqrt(TURN_TIME)
    gyro = np.hypot(np.hypot(noise.gyro, noise.gyro_motion), turn)
    Q = model.noises(F, course, gyro, size, problem.slip, noise)
    if problem.jumps is not None:
        Q[:, S, S] += course.moving * problem.jumps[course.index] * course.dt / course.w**2
    inflate(Q, course, problem, nominal.rest)
    blur(Q, course, problem.imu, noise)
    # a standstill that was named: the wheels may spin while the body stands
    Q[course.spinning, D, D] += FREE**2
    return Q


def _creep(problem: Problem, course: Course) -> Array:
    """(K,) velocities that a standstill may begin with at the node before, gone at this one [m/s]."""
    creep = np.zeros(course.t.size)
    creep[1:] = (course.rest * problem.unseen[course.index])[:-1]
    return creep


def _end_updates(
    problem: Problem, nominal: Nominal, course: Course, distance: Estimate | None
) -> list[model.Updates]:
    """Return what is known of the last node: a body that coasts with slow wheels, the measured distance."""
    last, parts = np.array([course.t.size - 1]), []
    if problem.coasts:
        R = ZERO_VELOCITY**2 + float(course.speed[-1]) ** 2
        parts.append(model.updates_of("zero_velocity", last, -float(nominal.v[-1]), {V: 1.0, PD: -1.0}, R))
    if distance is not None:
        missed = distance.value - float(nominal.x[-1])
        parts.append(model.updates_of("distance", last, missed, {X: 1.0, P: -1.0}, distance.std**2))
    return parts


def _start_std(
    problem: Problem, nominal: Nominal, course: Course, size: float, start: float, left: float
) -> Array:
    """(14,) std of the states at the start.

    Args:
        problem, nominal, course: as in `build`.
        size: rms of the acceleration by vibration [m/s^2].
        start: std of the rolled distance [m].
        left: std of the clock offset that is left [s].
    """
    noise, slip, rest, omega = problem.noise, problem.slip, course.rest[0], problem.noise.vibration_omega
    return np.array([
        1e-6, np.hypot(1e-6, start), ZERO_VELOCITY if rest else 1.0 + abs(course.speed[0]), SLOPE,
        noise.accel_bias, max(noise.gyro_bias, noise.gyro_level, abs(nominal.gyro_bias)),
        1e-7 if rest else noise.motion_bias, 1e-6 if rest else slip.limit,
        1e-6 if rest else slip.scatter, left, noise.accel_scale,
        1e-8 if slip.far else problem.soft, 1e-8 + size / omega**2, 1e-7 + size / omega,
    ])  # fmt: skip


def _origin(problem: Problem) -> Array:
    """(14, 14) covariance at the start by the origin of a reference's position; X + D is on the wheels'."""
    covariance = np.zeros((SIZE, SIZE))
    if any(readings.kind == "reference_x" for readings in problem.reference):
        covariance[np.ix_([X, D], [X, D])] = ORIGIN**2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return covariance


def shaking(noise: model.Noise, nominal: Nominal, course: Course) -> Array:
    """(K,) rms of the acceleration by vibration at the nodes [m/s^2]."""
    size = noise.vibration * np.minimum(np.abs(course.speed) / noise.vibration_speed, 2.0)
    return size if nominal.vibration_left is None else size * nominal.vibration_left[course.index]


def blur(Q: Array, course: Course, imu: BodyImu, noise: model.Noise) -> None:
    """Let biases change, in place, where rounding or a dead band begins or ceases to mute a sensor.

    Muted readings hide whatever is below them, of which they are off for `SWAY`. Q is (K, 14, 14).
    """
    dt, gravity = course.dt, course.coupling * course.dt
    velocity: dict[int, Array | float] = {V: 1.0, X: dt}
    angle: dict[int, Array | float] = {TH: 1.0, V: gravity, X: gravity * dt}
    for state, level, signal, step, gains in (
        (BM, noise.accel_level, imu.forward, imu.steps[0], velocity),
        (BG, noise.gyro_level, imu.pitch_rate, imu.steps[1], angle),
    ):
        if level > 0.0:
            mute = muted(signal, step, imu.period)
            edges = np.flatnonzero(np.diff(mute)) + 1
            Q[np.searchsorted(course.index, edges), state, state] += level**2
            hidden = mute[course.index] & course.moving
            model.add_noise(Q, hidden * level**2 * 2.0 * SWAY * dt, gains)


def muted(signal: Array, step: float, period: float) -> np.ndarray:
    """(N,) True where the readings of a `WINDOW` do not differ by more than a `step`."""
    size, filled = max(round(WINDOW / period), 3), np.nan_to_num(signal)
    calm = maximum_filter1d(filled, size) - minimum_filter1d(filled, size) < 1.5 * step + 1e-12
    return np.asarray(maximum_filter1d(calm, size))


def inflate(Q: Array, course: Course, problem: Problem, rest: np.ndarray) -> None:
    """Let velocity, pitch and biases drift over the faults, in place, by as much as may go unseen.

    Q (K, 14, 14) is at the nodes, `rest` at the samples (N,).
    """
    imu, faults, t, dt = problem.imu, problem.faults, course.t, course.dt
    if not (faults.doubt.any() or faults.gaps or faults.restarts):
        return
    active = ~rest & ~faults.doubt
    enough = active.sum() > 2
    shake = mad_std(np.diff(imu.forward[active]), 0.0) if enough else 1.0
    turn = max(0.02, 2.0 * float(np.std(imu.pitch_rate[active])) if enough and imu.has_pitch_rate else 0.0)

    def shares(begin: float, end: float) -> Array:
        """(K,) share of each step in motion from `begin` to `end` [s]."""
        within = np.where((t > begin) & (t - dt < end) & course.moving, dt, 0.0)
        return np.asarray(within / max(float(within.sum()), 1e-9))

    def unseen(begin: float, end: float) -> float:
        if problem.rolling is None:
            return UNSEEN
        # the body follows the wheels within a quarter of a second
        near = (t > begin - 0.25) & (t < end + 0.1)
        return float(np.hypot(UNEXPLAINED, 1.2 * np.abs(course.growth[near]).max(initial=0.0)))

    def drift(begin: float, end: float, force: float, turn: float) -> None:
        share, length = shares(begin, end), max(end - begin, imu.period)
        # what shakes comes back within some hundredths of a second
        unknown = np.hypot(force * length, shake * min(length, 0.03))
        Q[:, V, V] += unknown**2 * share
        Q[:, [X, V], [V, X]] += (0.5 * unknown**2 * share * dt)[:, None]
        Q[:, X, X] += (share > 0) * (unknown * dt) ** 2 / 3
        Q[:, TH, TH] += (turn * length) ** 2 * share

    for begin, end in faults.gaps:
        drift(begin, end, unseen(begin, end), turn)
    for end, thrown in zip(imu.t[faults.spikes], faults.thrown[faults.spikes], strict=True):
        force = unseen(end - imu.period, end)  # of a jolt of the body, or beyond one
        drift(end - imu.period, end, force if thrown < BEYOND * force else 0.0, turn)
    for (begin, end), beyond in zip(faults.plateaus, faults.beyond, strict=True):
        at = (imu.t >= begin) & (imu.t <= end)
        drift(begin, end, beyond, 2.0 if faults.rate_doubt[at].any() else 0.0)
    for jump in faults.restarts:
        share = shares(jump.begin, jump.end)
        Q[:, BA, BA] += jump.accel**2 * share
        Q[:, BG, BG] += jump.gyro**2 * share
