"""Noise identified from the trial itself: at rest, with the robot's file as prior, and in motion.

An IMU may be noisier in motion than at rest; `white` tells white noise from vibration by the spectrum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import signal

from granite_lab.estimation.error_model import Noise
from granite_lab.estimation.nodes import SWAY, pace_of
from granite_lab.estimation.nominal import Nominal
from granite_lab.estimation.problem import Problem
from granite_lab.estimation.smoother import nominal_of, usual
from granite_lab.estimation.wheels import Rolling
from granite_lab.estimation.white import (
    HIGH,
    MOTION,
    RESTLESS,
    evident_resonance,
    white_below_resonance,
    white_in_motion,
)
from granite_lab.logs.counters import runs
from granite_lab.logs.sensors.mounting import BodyImu
from granite_lab.logs.sensors.stamps import GAP_PERIODS
from granite_lab.logs.sensors.standstill import ROUNDED, Interval, inside
from granite_lab.logs.trial import Array
from granite_lab.parameters import GRAVITY, ImuGrade, Robot

PRIOR_SAMPLES = 20.0
"""The grade of the robot's file weighs as much as this many samples."""

AVERAGED = (1, 8, 16, 32, 64, 128)
"""Numbers of samples over which noise at rest is averaged."""

LEAST_FREEDOM = 8
"""Fewest degrees of freedom of an average that counts."""

LONGEST = 20.0
"""Noise at rest that is too short to be averaged is louder at low frequencies by this factor at most: that of
a low-pass at a tenth of the sampling rate, below which no maker's goes at the rates of short logs."""

CORRELATES = 3.0
"""Noise at rest is coloured where it differs from white noise by more than this many std."""

UNSEEN_PITCH = float(np.radians(2.0))
"""Random walk of the pitch over uneven ground, where no gyro sees it [rad/sqrt(m)]."""

UNSEEN_ATTITUDE = GRAVITY * float(np.radians(0.3))
"""Random walk of the gravity that a logger leaves in its "linear acceleration" [m/s^2/sqrt(s)]."""

LUG = 0.15
"""Lugs strike the ground within this share of their frequency."""

FASTEST = 0.35
"""Up to this share of the sampling rate nothing is filtered or folded much."""

LAST = 0.4
"""Beyond this share of the sampling rate the end of a spectrum is judged."""

ENDED = 0.1
"""A spectrum ends where it is below this share of its maximum (10 dB); what is beyond is not counted."""

LOBE = 4.0
"""Half the width of the window's main lobe, in reciprocals of its length."""

LEAST_STEADY = 2.0
"""Steady motion shorter than this [s] has no ordinates to speak of."""

SHAKEN = 1.0
"""A motion shorter than this [s] does not tell how far shaking turns the gyro's pitch."""

BLOCKS = 4
"""Parts of a standstill whose levels are compared."""


def white(t: Array, values: Array, rests: Sequence[Interval], prior: float) -> float:
    """Find the white noise density (std times sqrt(dt)) of a signal at standstill by its Allan variance.

    The Allan variance at one sample is precise, that over many samples is blind to noise beyond the filter's
    interest; they agree for white noise. Where that over eight samples differs by more than its own
    scatter, or successive samples correlate beyond theirs (coloured noise, a sensor's low-pass), the last two
    are extended to a time without end: what a low-pass hides falls with the reciprocal of the time.
    """
    sums = np.zeros((len(AVERAGED), 2))  # of squares, and of degrees of freedom: of these, overlap leaves 2/3
    alike, power, pairs = 0.0, 0.0, 0
    for rest in rests:
        at = inside(t, [rest]) & np.isfinite(values)
        if at.sum() < 16:
            continue
        part, dt = values[at], float(np.median(np.diff(t[at])))
        about = part - part.mean()
        alike, power = alike + float(about[1:] @ about[:-1]), power + float(about @ about)
        pairs += part.size - 1
        for i, m in enumerate(AVERAGED):
            step = np.diff(part[: part.size // m * m].reshape(-1, m).mean(axis=1))
            sums[i] += (step @ step) * m * dt / 3.0, step.size * 2.0 / 3.0
    (fine, n_fine), *longer = sums
    if n_fine == 0:
        return prior
    variance = (PRIOR_SAMPLES * prior**2 + fine) / (PRIOR_SAMPLES + n_fine)
    long = [(max(total / n, 1e-30), n) for total, n in longer if n >= LEAST_FREEDOM]
    # the first of them has the most degrees of freedom: others would often differ by chance
    coloured = alike > CORRELATES * power / np.sqrt(max(pairs, 1))
    if long and (coloured or abs(np.log(long[0][0] / variance)) > CORRELATES * np.sqrt(2.0 / long[0][1])):
        before, last = ([variance] + [v for v, _ in long])[-2:]
        variance = max(last, 2.0 * last - before)
    elif coloured:  # too short for averages: density without end of noise whose correlation decays evenly
        r = alike / power
        fine *= min((1.0 + r) / (1.0 - r) ** 2, LONGEST)
        variance = (PRIOR_SAMPLES * prior**2 + fine) / (PRIOR_SAMPLES + n_fine)
    return float(np.sqrt(variance))


def stamp_noise(imu: BodyImu, moving: np.ndarray) -> float:
    """White noise density [m/s^2 sqrt(s)] that the stamps' scatter makes of vibration in motion.

    Integrated by the trapezoidal rule, a stamp that is off by d changes the velocity by d times half the
    difference of the samples before and after it. The scatter is that of stamps about an even spacing,
    by their second differences, whose variance is six times that of one stamp.
    """
    period = imu.period
    shaken = (imu.forward[2:] - imu.forward[:-2])[moving[1:-1]]
    if shaken.size < 8:
        return 0.0
    steps = np.diff(imu.t)
    near = np.fmax(steps[1:], steps[:-1]) <= GAP_PERIODS * period
    uneven = float(np.sqrt(np.mean(np.diff(steps)[near] ** 2) / 6.0)) if near.any() else 0.0
    return float(uneven * 0.5 * np.sqrt(np.mean(shaken**2) / period))


def vibration(
    imu: BodyImu, moving: np.ndarray, accel: float, prior_frequency: float
) -> tuple[float, float, float]:
    """Identify the frame's vibration along x in motion from the spectrum above 5 Hz.

    Returns:
        rms beyond the white noise [m/s^2], dominant frequency [Hz], damping ratio.
    """
    dt, part = imu.period, imu.forward[moving]
    if part.size < 64 or dt > 0.05:
        return 0.0, prior_frequency, 0.3
    size = int(min(part.size, 2 ** np.ceil(np.log2(1.28 / dt))))
    frequency, _, densities = signal.spectrogram(part, 1.0 / dt, "hann", size, size // 2)
    band = frequency >= min(5.0, 0.2 / dt)
    # a jerk of the body at a change of speed is in few segments: it is no vibration
    mean, typical = (
        np.maximum(average(densities, axis=1) - 2.0 * accel**2, 0.0)[band] for average in (np.mean, np.median)
    )
    frequency, power = frequency[band], float(mean.sum() * (frequency[1] - frequency[0]))
    if power <= (0.5 * accel) ** 2 / dt or not typical.any():
        return float(np.sqrt(power)), prior_frequency, 0.3
    peak = float(frequency[np.argmax(typical)])
    low, high = np.interp([0.16, 0.84], np.cumsum(typical) / typical.sum(), frequency)
    return float(np.sqrt(power)), peak, float(np.clip(0.5 * (high - low) / peak, 0.05, 0.7))


def identify(imu: BodyImu, rolling: Rolling | None, robot: Robot, rests: Sequence[Interval]) -> Noise:
    """Identify all noise figures of a trial; the grade in the robot's file is the prior."""
    grade, moving = robot.imu_grade, ~inside(imu.t, rests)
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
    accel_bias = 0.0
    if silent(imu.forward[~moving], force_step, grade.accel_noise, imu.period):
        accel, accel_bias = max(accel, grade.accel_noise), dead_band(imu.forward, ~moving, grade.accel_bias)
    accel_level = level_error(imu.forward, ~moving, force_step, accel_bias)
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
        motion_bias=float(np.hypot(np.hypot(2.0 * grade.accel_instability, blind), accel_level)),
        vibration=rms,
        vibration_speed=max(speed, 0.05),
        vibration_frequency=frequency,
        vibration_damping=damping,
        accel_level=accel_level,
        gyro_level=gyro_level,
        gyro_scale=grade.gyro_scale if imu.has_pitch_rate else 0.0,
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


def muted_share(imu: BodyImu, rests: Sequence[Interval], grade: ImuGrade) -> float:
    """Share of the forward readings in motion that equal the one at rest, if a dead band mutes it; else 0."""
    at_rest = inside(imu.t, rests)
    still = imu.forward[at_rest]
    if not silent(still, imu.steps[0], grade.accel_noise, imu.period):
        return 0.0
    return float(np.mean(imu.forward[~at_rest] == still[np.isfinite(still)][0])) if (~at_rest).any() else 0.0


def dead_band(values: Array, rest: np.ndarray, bias: float) -> float:
    """Std of what a dead band hides in readings (N,) that are all equal at rest, the bias at least.

    No reading lies between the level at rest and the end of the band: anything between is as likely.
    """
    finite = np.isfinite(values)
    off = np.abs(values[finite] - values[rest & finite][0])
    return max(bias, 2.0 * ROUNDED * float(off[off > 0.0].min(initial=np.inf))) if off.any() else bias


def level_error(values: Array, rest: np.ndarray, step: float, bias: float) -> float:
    """Return the std of an error that all readings (N,) at rest share and readings in motion do not have.

    Noise of half a step makes rounding errors independent. Below, all readings of a standstill share one. If
    they are muted they say nothing of the `bias`, and motion tells it no better than its mean (else: 0).
    """
    finite = np.isfinite(values)
    still, motion = values[rest & finite], values[~rest & finite]
    if bias > 0.0:
        return float(np.hypot(bias, np.mean(motion) - still[0])) if motion.size else bias
    noise = float(np.std(np.diff(still))) / np.sqrt(2.0) if still.size > 1 else np.inf
    return ROUNDED * step if noise < 0.5 * step else 0.0


def with_motion_noise(problem: Problem, offset: float, *, folding: bool = True) -> Noise:
    """Return the noise with the white noise in motion, and with what vibration is left beside it.

    `folding` adds what sampling may fold to the frequencies of the motion. It drifts over seconds, and does
    not blur the instants at which motion begins and ends.
    """
    noise, nominal = problem.noise, nominal_of(problem, offset)
    parts = steady_parts(problem, nominal, offset)
    frequency, force, rate = spectrum(problem, nominal, parts)
    if problem.imu.has_pitch_rate:
        noise = replace(noise, gyro_motion=white_in_motion(frequency, rate, noise.gyro, turns=True))
        lost = lost_pitch(replace(problem, noise=noise), nominal)
        noise = replace(noise, gyro_motion=float(np.hypot(noise.gyro_motion, lost)))
    moving = ~inside(nominal.t, problem.rests)
    most = most_folded(problem.imu, moving)
    if np.isfinite(most) and evident_resonance(frequency, force):
        added = white_below_resonance(frequency, force, noise.accel, noise.vibration_frequency)
    else:
        added = white_in_motion(frequency, force, noise.accel)
    if folding:
        # a slow sensor folds the resonance itself, which may be loudest where the body moves, too
        band = (0.0, MOTION) if slow(problem.imu) else (MOTION, RESTLESS)
        added = max(added, min(most, all_white(nominal, parts, problem.imu.period, noise.accel, band)))
    noise = replace(noise, accel_motion=added)
    density = float(np.hypot(noise.accel, noise.accel_motion))
    rms, frequent, damping = vibration(problem.imu, moving, density, problem.robot.imu.vibration_frequency)
    return replace(noise, vibration=rms, vibration_frequency=frequent, vibration_damping=damping)


def slow(imu: BodyImu) -> bool:
    """Whether a sensor is too slow to show a resonance of the frame."""
    return 1.0 / imu.period < 4.0 * HIGH


def most_folded(imu: BodyImu, moving: np.ndarray) -> float:
    """White noise density [m/s^2 sqrt(s)] of the vibration that sampling can fold to low frequencies.

    It is that at the sampling rate: the tail of the spectrum, which falls from its maximum towards half the
    rate, goes on by the same power of the frequency. Infinite where the sensor is too slow to show a
    resonance, or no tail.
    """
    rate, part = 1.0 / imu.period, imu.forward[moving]
    if slow(imu):
        return np.inf
    if part.size < rate:
        return 0.0
    frequency, density = signal.welch(part, rate, nperseg=int(rate))
    beyond, last = frequency > MOTION, frequency > LAST * rate
    smooth = np.convolve(density[beyond], np.full(3, 1.0 / 3.0), "same")
    top, peak = float(np.mean(density[last])), float(frequency[beyond][np.argmax(smooth)])
    if peak > FASTEST * rate:
        return np.inf
    if top < ENDED * smooth.max():
        return 0.0
    middle = float(np.mean(frequency[last]))
    octaves = np.log(rate / middle) / np.log(middle / peak)
    return float(np.sqrt(0.5 * top * min(top / smooth.max(), 1.0) ** octaves))  # one-sided


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
    variance_of_sample = noise.accel**2 / imu.period / imu.gravity**2
    angle, variance = np.array([level(imu.forward[at] / imu.gravity, variance_of_sample) for at in places]).T
    pitch = np.array([np.mean(nominal.pitch[at]) for at in places])
    begin, end = np.ravel(problem.rests)[1:-1].reshape(-1, 2).T  # of each motion
    length, rested = end - begin, np.sum(np.diff(problem.rests))
    missed = np.diff(pitch + angle)  # the specific force of a body that stands is -g sin(pitch)
    expected = noise.gyro**2 * length * (1 + length / rested) + noise.gyro_walk**2 * length**3 / 3
    expected += variance[:-1] + variance[1:] + noise.accel_walk**2 * length / imu.gravity**2
    expected += 2.0 * (noise.accel_level / imu.gravity) ** 2 + (noise.gyro_level * length) ** 2
    whole = [not problem.faults.touch(*motion) for motion in zip(begin, end, strict=True)]
    use = (length >= SHAKEN) & np.isfinite(expected) & whole
    missed, expected, length = missed[use], expected[use], length[use]
    if not use.any() or float(np.mean(missed**2 / expected)) <= usual(length.size):
        return 0.0
    return float(np.sqrt(max(np.sum(missed**2 - expected), 0.0) / np.sum(length)))


def level(force: Array, variance: float) -> tuple[float, float]:
    """Angle [rad] that a standstill's specific force (N,) in g makes, and its variance.

    A body that still rocks is levelled no better than the means of its blocks agree.
    """
    angle = float(np.arcsin(np.clip(np.mean(force), -1, 1))) if force.size else 0.0
    if force.size < 2 * BLOCKS:
        return angle, np.inf
    means = [np.mean(part) for part in np.array_split(force, BLOCKS)]
    return angle, max(variance / force.size, float(np.var(means, ddof=1)) / BLOCKS)


def steady_parts(problem: Problem, nominal: Nominal, offset: float) -> list[tuple[int, int, float]]:
    """Find the motion with steady wheels, as [begin, end) of the samples and its mean speed [m/s].

    Motion without wheels, or without a steady part, counts as a whole.
    """
    dt = problem.imu.period
    on, speed = ~nominal.rest, np.zeros(nominal.t.size)
    if problem.jumps is not None:
        on &= problem.jumps == 0.0
    on &= np.diff(nominal.t, prepend=nominal.t[0] - dt) < 3.0 * dt
    if problem.rolling is not None:
        pace = pace_of(problem.rolling, offset, nominal.t)
        speed = pace.speed
        steady = on & pace.steady
        on = steady if max((b - a for a, b in runs(steady)), default=0) * dt >= LEAST_STEADY else on
    return [(a, b, abs(float(np.mean(speed[a:b])))) for a, b in runs(on) if (b - a) * dt >= LEAST_STEADY]


def spectrum(
    problem: Problem, nominal: Nominal, parts: Sequence[tuple[int, int, float]]
) -> tuple[Array, Array, Array]:
    """Periodograms of the nominal acceleration and pitch rate over the steady `parts`.

    Frequencies to which the window spreads the motion, and those near the lugs' own, are left out.

    Returns:
        (F,) frequencies [Hz]; (F,) densities of acceleration [m^2/s^3] and of pitch rate [rad^2/s].
    """
    dt = problem.imu.period
    turning = problem.robot.wheels.lugs / (2.0 * np.pi * problem.robot.wheels.radius)
    densities = [np.empty((3, 0))]
    for a, b, speed in parts:
        length = (b - a) * dt
        window: Any = signal.windows.blackmanharris(b - a - 1)  # SciPy's types know no window as an array
        frequency, force = signal.periodogram(np.diff(nominal.v[a:b]) / dt, 1.0 / dt, window)
        _, rate = signal.periodogram(np.diff(nominal.pitch[a:b]) / dt, 1.0 / dt, window)
        lug = turning * speed
        use = (frequency > LOBE / length) & (frequency < FASTEST / dt)
        use &= (frequency < MOTION) | (frequency > MOTION + LOBE / length)
        use &= np.abs(frequency - lug) > LUG * lug
        # the trapezoidal rule of the integration averaged neighbouring samples
        gain = np.cos(np.pi * frequency * dt) ** 2
        densities.append(np.array([frequency, force / gain, rate / gain])[:, use])
    frequency, force, rate = np.concatenate(densities, axis=1)
    return frequency, force, rate


def all_white(
    nominal: Nominal,
    parts: Sequence[tuple[int, int, float]],
    dt: float,
    rest: float,
    band: tuple[float, float],
) -> float:
    """White noise density beyond that at `rest` if all that steady `parts` hold in a `band` [Hz] is white.

    It is the mean of the posterior.
    """
    low = []
    for a, b, _ in parts:
        frequency, density = signal.periodogram(np.diff(nominal.v[a:b]) / dt, 1.0 / dt, "hann")
        least = max(band[0], 2.0 / ((b - a) * dt))  # the window spreads the mean up to there
        low.append(density[(frequency >= least) & (frequency < band[1])])
    ordinates = np.concatenate([np.empty(0), *low])
    independent = ordinates.size / 1.5  # noise bandwidth of the window of Hann
    if independent <= 1.0:
        return 0.0
    mean = float(np.mean(ordinates)) * independent / (independent - 1.0)
    return float(np.sqrt(max(0.5 * mean - rest**2, 0.0)))
