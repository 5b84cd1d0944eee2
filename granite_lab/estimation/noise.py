"""Noise identified from the trial itself: at rest, with the robot's file as prior, and in motion.

An IMU may be noisier in motion than at rest. The integral of white noise wanders without bound, that
of vibration does not, so neither may be taken for the other. Where the wheels turn steadily, specific
force without gravity and lever holds

* motion of the body, up to 1.5 Hz, on some ground to 3 Hz;
* vibration, the derivative of a bounded velocity: below its resonances the density rises as f^2;
* white noise, as dense there as anywhere.

Between the motion and the resonance the spectrum is taken for white noise and such a rise, whose height
may be anything: a frame has many resonances, and its rms does not tell how they overlap. Anywhere above it
may hold more than white noise, but not less, so that what shakes the body for good at some Hz is not taken
for noise. How likely that makes the periodogram is Whittle's formula [1]; of the white noise the posterior's
mean is taken, because the std of the estimate goes by its variance.

[1] P. Whittle, Estimation and information in stationary time series, Ark. Mat. 2 (1953).

Densities are as `scipy.signal` has them, whose import takes half a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import softmax

from granite_lab.estimation.error_model import Noise
from granite_lab.estimation.mounting import BodyImu
from granite_lab.estimation.nodes import SWAY, Problem, pace_of
from granite_lab.estimation.nominal import Nominal
from granite_lab.estimation.rest import inside
from granite_lab.estimation.smoother import nominal_of, usual
from granite_lab.estimation.wheels import Rolling
from granite_lab.logs.counters import runs
from granite_lab.logs.standstill import ROUNDED, Interval
from granite_lab.logs.trial import Array
from granite_lab.parameters import GRAVITY, Robot

PRIOR_SAMPLES = 20.0
"""The grade of the robot's file weighs as much as this many samples."""

UNSEEN_PITCH = float(np.radians(2.0))
"""Random walk of the pitch over uneven ground, where no gyro sees it [rad/sqrt(m)]."""

UNSEEN_ATTITUDE = GRAVITY * float(np.radians(0.3))
"""Random walk of the gravity that a logger leaves in its "linear acceleration" [m/s^2/sqrt(s)]."""

MOTION, RESTLESS = 1.5, 3.0
"""The body itself moves at up to this frequency [Hz]: usually, and on restless ground."""

HIGH, BELOW = 10.0, 0.45
"""Up to this frequency [Hz], and this share of the resonance's, vibration is the tail of the resonance."""

BAND = 5.0
"""Width of the bands above, none of which may be quieter than the white noise [Hz]."""

LUG = 0.15
"""Lugs strike the ground within this share of their frequency."""

FASTEST = 0.35
"""Up to this share of the sampling rate nothing is filtered or folded much."""

LOBE = 4.0
"""Half the width of the window's main lobe, in reciprocals of its length."""

TOLD = 0.5
"""What an ordinate under this window tells, against an independent one."""

SHORTEST = 2.0
"""Steady motion shorter than this [s] has no ordinates to speak of."""

ADDED = np.geomspace(0.3, 3e4, 61)
"""Densities that motion may add, in shares of the one at rest."""

HEIGHTS = np.geomspace(1e-2, 1e6, 81)
"""Densities of the tail at the highest frequency, in shares of the white one at rest; all equally likely."""

NONE = 0.8
"""Probability, before the trial is seen, that motion adds nothing."""

SHAKEN = 1.0
"""A motion shorter than this [s] does not tell how far shaking turns the gyro's pitch."""

BLOCKS = 4
"""Parts of a standstill whose levels are compared."""


def white(t: Array, signal: Array, rests: Sequence[Interval], prior: float) -> float:
    """Find the white noise density (std times sqrt(dt)) of a signal at standstill by its Allan variance.

    The Allan variance at one sample is precise, that over eight samples is blind to noise beyond the
    filter's interest; they agree for white noise. Where they differ by more than their own scatter
    (coloured noise, a sensor's low-pass), the longer one is used.
    """
    sums = np.zeros((2, 2))  # of squares, and of degrees of freedom: differences overlap, so each has 2/3
    for rest in rests:
        at = inside(t, [rest]) & np.isfinite(signal)
        if at.sum() < 16:
            continue
        part, dt = signal[at], float(np.median(np.diff(t[at])))
        for i, m in enumerate((1, 8)):
            step = np.diff(part[: part.size // m * m].reshape(-1, m).mean(axis=1))
            sums[i] += (step @ step) * m * dt / 3.0, step.size * 2.0 / 3.0
    (fine, n_fine), (long, n_long) = sums
    if n_fine == 0:
        return prior
    variance = (PRIOR_SAMPLES * prior**2 + fine) / (PRIOR_SAMPLES + n_fine)
    if n_long >= 8 and abs(np.log(max(long / n_long, 1e-30) / variance)) > 3.0 * np.sqrt(2.0 / n_long):
        variance = long / n_long
    return float(np.sqrt(variance))


def stamp_noise(imu: BodyImu, moving: np.ndarray) -> float:
    """White noise density [m/s^2 sqrt(s)] that the stamps' scatter makes of vibration in motion.

    Integrated by the trapezoidal rule, a stamp that is off by d changes the velocity by d times half the
    difference of the samples before and after it. The scatter is that of stamps about an even spacing,
    by their second differences, whose variance is six times that of one stamp.
    """
    period = imu.period
    step = imu.forward[2:] - imu.forward[:-2]
    shaken = step[moving[1:-1] & np.isfinite(step)]
    if shaken.size < 8:
        return 0.0
    uneven = 1.4826 * float(np.median(np.abs(np.diff(imu.t, n=2)))) / np.sqrt(6.0)
    return float(uneven * 0.5 * np.sqrt(np.mean(shaken**2) / period))


def vibration(
    imu: BodyImu, moving: np.ndarray, accel: float, prior_frequency: float
) -> tuple[float, float, float]:
    """Identify the frame's vibration along x in motion from the spectrum above 5 Hz.

    Returns:
        rms beyond the white noise [m/s^2], dominant frequency [Hz], damping ratio.
    """
    dt = imu.period
    part = imu.forward[moving & np.isfinite(imu.forward)]
    if part.size < 64 or dt > 0.05:
        return 0.0, prior_frequency, 0.3
    size = int(min(part.size, 2 ** np.ceil(np.log2(1.28 / dt))))
    frequency, densities = periodograms(part, 1.0 / dt, hann(size))
    band = frequency >= min(5.0, 0.2 / dt)
    # a jerk of the body at a change of speed is in few segments: it is no vibration
    mean, usual = (
        np.maximum(average(densities, axis=0) - 2.0 * accel**2, 0.0)[band] for average in (np.mean, np.median)
    )
    frequency, power = frequency[band], float(mean.sum() * (frequency[1] - frequency[0]))
    if power <= (0.5 * accel) ** 2 / dt or not usual.any():
        return float(np.sqrt(power)), prior_frequency, 0.3
    peak = float(frequency[np.argmax(usual)])
    low, high = np.interp([0.16, 0.84], np.cumsum(usual) / usual.sum(), frequency)
    return float(np.sqrt(power)), peak, float(np.clip(0.5 * (high - low) / peak, 0.05, 0.7))


def identify(imu: BodyImu, rolling: Rolling | None, robot: Robot, rests: Sequence[Interval]) -> Noise:
    """Identify all noise figures of a trial; the grade in the robot's file is the prior."""
    grade, moving = robot.imu_grade, ~inside(imu.t, rests)
    assert grade is not None
    speed = float(np.nanmax(np.abs(rolling.speed))) if rolling is not None else 0.5
    accel = white(imu.t, imu.forward, rests, grade.accel_noise)
    force_step, rate_step = imu.steps
    accel = max(accel, max(grade.accel_step, force_step) * ROUNDED * float(np.sqrt(imu.period)), 1e-5)
    gyro, gyro_level = UNSEEN_PITCH * float(np.sqrt(max(speed, 0.1))), 0.0
    if imu.has_pitch_rate:
        gyro = white(imu.t, imu.pitch_rate, rests, grade.gyro_noise)
        gyro = max(gyro, rounding(imu.pitch_rate[moving], rate_step, imu.period), 1e-7)
        if dead := silent(imu.pitch_rate[~moving], rate_step, grade.gyro_noise, imu.period):
            gyro = max(gyro, grade.gyro_noise)
        gyro_level = level_error(imu.pitch_rate, ~moving, rate_step, grade.gyro_bias if dead else 0.0)
    accel_level = level_error(imu.forward, ~moving, force_step, 0.0)
    rms, frequency, damping = vibration(imu, moving, accel, robot.imu.vibration_frequency)
    tilt = np.radians(2.0 if imu.levelled else robot.imu.tilt)
    # unseen pitch on setting off (squat), or an unknown error of the attitude the logger worked with
    blind = GRAVITY * np.radians(1.0) if not imu.has_pitch_rate or not imu.gravity else 0.0
    attitude, walk = 0.0 if imu.gravity else UNSEEN_ATTITUDE, float(np.sqrt(2.0 / grade.instability_time))
    return Noise(
        accel=accel,
        gyro=gyro,
        accel_stamps=stamp_noise(imu, moving),
        accel_bias=float(np.hypot(grade.accel_bias, GRAVITY * tilt)),
        gyro_bias=grade.gyro_bias,
        accel_walk=float(np.hypot(grade.accel_instability * walk, attitude)),
        gyro_walk=grade.gyro_instability * walk,
        accel_scale=grade.accel_scale,
        pitch=float(np.radians(2.0)),
        motion_bias=float(np.hypot(np.hypot(2.0 * grade.accel_instability, blind), accel_level)),
        vibration=rms,
        vibration_speed=max(speed, 0.05),
        vibration_frequency=frequency,
        vibration_damping=damping,
        accel_level=accel_level,
        gyro_level=gyro_level,
    )


def rounding(rate: Array, step: float, period: float) -> float:
    """White noise density [rad/s sqrt(s)] that rounding to a `step` makes of a rate in motion (N,).

    Where the rate does not change by a step from sample to sample, its rounding errors last as long as it.
    """
    bend = np.diff(rate[np.isfinite(rate)])
    shaken = bend.size > 0 and float(np.std(bend)) > step
    return ROUNDED * step * float(np.sqrt(period if shaken else 2.0 * SWAY))


def silent(still: Array, step: float, density: float, period: float) -> bool:
    """Whether a dead band mutes readings (N,) at rest: all are equal, and noise would exceed their step."""
    still = still[np.isfinite(still)]
    return still.size > 1 and not np.ptp(still) and density / float(np.sqrt(period)) > 3.0 * step


def level_error(signal: Array, rest: np.ndarray, step: float, bias: float) -> float:
    """Std of what the readings (N,) at rest are off alike, and those in motion are not.

    Noise of half a step makes rounding errors independent. Below, all readings of a standstill share one. If
    they are muted they say nothing of the `bias`, and motion tells it no better than its mean (else: 0).
    """
    known = np.isfinite(signal)
    still, motion = signal[rest & known], signal[~rest & known]
    if bias > 0.0:
        return float(np.hypot(bias, np.mean(motion) - still[0])) if motion.size else bias
    noise = float(np.std(np.diff(still))) / np.sqrt(2.0) if still.size > 1 else np.inf
    return ROUNDED * step if noise < 0.5 * step else 0.0


def with_motion_noise(problem: Problem, offset: float) -> Noise:
    """Return the noise with the white noise in motion, and with what vibration is left beside it."""
    noise, imu, moving = problem.noise, problem.imu, ~inside(problem.imu.t, problem.rests)
    if 0.5 / imu.period < 2.0 * HIGH:
        force, rate = (folded(signal, moving, imu.period) for signal in (imu.forward, imu.pitch_rate))
        return replace(noise, accel_motion=force, gyro_motion=rate)
    nominal = nominal_of(problem, offset)
    noise = replace(noise, gyro_motion=lost_pitch(problem, nominal))
    frequency, density = spectrum(problem, nominal, offset)
    density = density / (2.0 * noise.accel**2)
    low = frequency < min(HIGH, BELOW * noise.vibration_frequency)
    ratio = (frequency[low] / noise.vibration_frequency) ** 2
    shape, floor = ratio / (1.0 - ratio) ** 2, band_means(frequency[~low], density[~low])
    quick = frequency[low] > RESTLESS  # what is white is as loud with the slower ordinates as without
    added = min(added_share(density[low][use], shape[use], floor) for use in (quick | True, quick))
    if added < ADDED[0]:
        return noise
    white = noise.accel * float(np.sqrt(1.0 + added))
    rms, frequent, damping = vibration(imu, moving, white, problem.robot.imu.vibration_frequency)
    return replace(
        noise, accel_motion=noise.accel * float(np.sqrt(added)), vibration=rms,
        vibration_frequency=frequent, vibration_damping=damping,
    )  # fmt: skip


def folded(signal: Array, moving: np.ndarray, period: float) -> float:
    """White noise density times sqrt(s) that shaking makes in motion of an IMU too slow to show it.

    Sampled below twice its frequency, it is as white as the samples' second differences say.
    """
    bend = np.diff(signal, n=2)[moving[1:-1]]
    bend = bend[np.isfinite(bend)]
    return float(np.sqrt(np.mean(bend**2) / 6.0 * period)) if bend.size >= 8 else 0.0


def lost_pitch(problem: Problem, nominal: Nominal) -> float:
    """White noise density of the pitch rate [rad/s sqrt(s)] by which the gyro loses the pitch in motion.

    From one standstill to the next, the gyro's angle and the accelerometer's level must change alike. On
    rough ground they do not: a gyro that is shaken errs by its scale, its axes and its sensitivity to
    acceleration, far beyond its noise at rest. Motion over faults, whose noise grows anyway, is left out.
    What is returned is beyond the noise known from the standstills; 0 within chance.
    """
    imu, noise = problem.imu, problem.noise
    if not imu.has_pitch_rate or not imu.gravity or len(problem.rests) < 2:
        return 0.0
    places = [inside(imu.t, [rest]) for rest in problem.rests]
    white = noise.accel**2 / imu.period / imu.gravity**2
    angle, variance = np.array([level(imu.forward[at] / imu.gravity, white) for at in places]).T
    pitch = np.array([np.mean(nominal.pitch[at]) for at in places])
    begin, end = np.ravel(problem.rests)[1:-1].reshape(-1, 2).T  # of each motion
    length, rested = end - begin, np.sum(np.diff(problem.rests))
    missed = np.diff(pitch + angle)  # the specific force of a body that stands is -g sin(pitch)
    known = noise.gyro**2 * length * (1 + length / rested) + noise.gyro_walk**2 * length**3 / 3
    known += variance[:-1] + variance[1:] + noise.accel_walk**2 * length / imu.gravity**2
    known += 2.0 * (noise.accel_level / imu.gravity) ** 2 + (noise.gyro_level * length) ** 2
    whole = [not problem.faults.touch(*motion) for motion in zip(begin, end, strict=True)]
    use = (length >= SHAKEN) & np.isfinite(known) & whole
    missed, known, length = missed[use], known[use], length[use]
    if not use.any() or float(np.mean(missed**2 / known)) <= usual(length.size):
        return 0.0
    return float(np.sqrt(max(np.sum(missed**2 - known), 0.0) / np.sum(length)))


def level(force: Array, variance: float) -> tuple[float, float]:
    """Angle [rad] that a standstill's specific force (N,) in g makes, and its variance.

    A body that still rocks is levelled no better than the means of its blocks agree.
    """
    force = force[np.isfinite(force)]
    angle = float(np.arcsin(np.clip(np.mean(force), -1, 1))) if force.size else 0.0
    if force.size < 2 * BLOCKS:
        return angle, np.inf
    means = [np.mean(part) for part in np.array_split(force, BLOCKS)]
    return angle, max(variance / force.size, float(np.var(means, ddof=1)) / BLOCKS)


def spectrum(problem: Problem, nominal: Nominal, offset: float) -> tuple[Array, Array]:
    """Frequencies (F,) [Hz] and density (F,) [m^2/s^3] of the body's acceleration, over all steady motion.

    One periodogram after the other, by the IMU; the lugs' own frequency is left out.
    """
    imu, rolling = problem.imu, problem.rolling
    assert rolling is not None
    dt, pace = imu.period, pace_of(rolling, offset, nominal.t)
    on = pace.steady & ~nominal.rest
    if problem.jumps is not None:
        on &= problem.jumps == 0.0
    on &= np.diff(nominal.t, prepend=nominal.t[0] - dt) < 3.0 * dt
    turning = problem.robot.wheels.lugs / (2.0 * np.pi * problem.robot.wheels.radius)
    found = [np.empty((2, 0))]
    for a, b in runs(on):
        if (b - a) * dt < SHORTEST:
            continue
        acceleration = np.diff(nominal.v[a:b]) / dt
        frequency, density = spectral_density(acceleration, 1.0 / dt, blackman_harris(acceleration.size))
        use = (frequency > MOTION + LOBE / ((b - a) * dt)) & (frequency < FASTEST / dt)
        lug = turning * abs(float(np.mean(pace.speed[a:b])))
        use &= np.abs(frequency - lug) > LUG * lug
        # the trapezoidal rule of the integration averaged neighbouring samples
        gain = np.cos(np.pi * frequency * dt) ** 2
        found.append(np.array([frequency, density / gain])[:, use])
    frequencies, densities = np.concatenate(found, axis=1)
    return frequencies, densities


def band_means(frequency: Array, density: Array) -> Array:
    """(B, 2) mean of the density in each band of width `BAND`, and its number of ordinates."""
    place = (frequency / BAND).astype(int)
    count = np.bincount(place)
    total = np.bincount(place, density)
    return np.stack([total[count > 0] / count[count > 0], count[count > 0]], axis=1)


def added_share(density: Array, shape: Array, floor: Array) -> float:
    """Return the mean of the white density that motion adds, in shares of that at rest.

    `density` (F,) is the periodogram in such shares, `shape` (F,) the vibration's density over its height,
    `floor` (B, 2) mean and number of the ordinates in bands that may hold anything besides white noise.
    """
    if density.size < 8:
        return 0.0
    white = np.concatenate([[0.0], ADDED])
    tail = HEIGHTS[:, None] * shape / np.max(shape)
    log_posterior, (mean, count) = np.empty(white.size), floor.T
    for i, added in enumerate(white):
        level = 1.0 + added + tail
        low = np.sum(np.log(level) + density / level, axis=1)
        # a band as loud as its mean, but not quieter than the white noise
        least = np.maximum(mean, 1.0 + added)
        high = np.sum(count * (np.log(least) + mean / least))
        log_posterior[i] = np.logaddexp.reduce(-TOLD * (low + high))
    log_posterior += np.log(np.append(NONE, np.full(ADDED.size, (1.0 - NONE) / ADDED.size)))
    return float(softmax(log_posterior) @ white)


def periodograms(values: Array, rate: float, window: Array) -> tuple[Array, Array]:
    """(F,) frequencies [Hz] and (S, F) one-sided densities [unit^2/Hz] of segments that overlap by half.

    The mean of each segment, as long as the window, is removed.
    """
    size = window.size
    parts = np.lib.stride_tricks.sliding_window_view(values, size)[:: max(1, size - size // 2)]
    parts = parts - parts.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(parts * window, axis=1)) ** 2 / (rate * np.sum(window**2))
    power[:, 1 : None if size % 2 else -1] *= 2.0
    return np.asarray(np.fft.rfftfreq(size, 1.0 / rate)), np.asarray(power)


def spectral_density(values: Array, rate: float, window: Array) -> tuple[Array, Array]:
    """Return the mean of the `periodograms` (Welch)."""
    frequency, density = periodograms(values, rate, window)
    return frequency, np.asarray(density.mean(axis=0))


def hann(size: int) -> Array:
    """Return a periodic Hann window."""
    return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(size) / size))


def blackman_harris(size: int) -> Array:
    """Return the symmetric window of four cosines with the least side lobes (Harris, 1978)."""
    phase = np.linspace(0.0, 2.0 * np.pi, size)
    return np.asarray(np.array([0.35875, -0.48829, 0.14128, -0.01168]) @ np.cos(np.outer(range(4), phase)))
