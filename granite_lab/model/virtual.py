"""A virtual trial: what imperfect sensors would have logged of a simulated run.

Everything made here is virtual and says so in its metadata. The sensors have turn-on bias, bias
instability, mounting tilt, white noise, saturation, quantisation, jitter and a frame vibration
that shakes but does not carry the robot away (its integral stays bounded). A sample of the IMU is
the mean over its sampling interval.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, lfilter, sosfilt
from scipy.spatial.transform import Rotation

from granite_lab.logs.trial import Array, CurrentStream, ImuStream, Series, Trial, TrialInfo, WheelStream
from granite_lab.model.run import Run
from granite_lab.parameters import WHEELS, Course, ImuGrade, Robot

STILL = 2.0
"""Standstill before the command and after the run's end in a virtual log [s]."""

LATERAL_VIBRATION = 0.6
"""Vibration along y as a share of that along x and z [-]; an assumption."""


def virtual_trial(run: Run, seed: int, name: str) -> tuple[Trial, pd.DataFrame]:
    """Log a run with the sensors of its robot.

    Args:
        run: the simulated run; a fine output grid (2.5 ms) keeps the vibration out of its interpolation.
        seed: of all random draws; the same seed gives the same log.
        name: of the trial.

    Returns:
        the virtual trial, and the truth at the IMU's stamps (``t_s``, ``x_m``, ``v_mps``,
        ``pitch_rad``, ``v_wheel_f_mps``, ``v_wheel_r_mps``, ``slip_f``, ``slip_r``) with the
        steady slip ratio and the command's start as attributes.
    """
    rng = np.random.default_rng(seed)
    robot = run.robot
    origin = STILL + rng.uniform(0, 0.05)  # the log's time at which the command starts
    end = origin + float(run.t[-1]) + STILL
    imu_t = _stamps(rng, robot.imu_grade.rate, end, 2e-5)
    imu, tilt = _imu(run, imu_t, origin, rng)
    enc_t = _stamps(rng, robot.encoders.rate, end, robot.encoders.jitter)
    wheels = _encoders(run, enc_t, origin)
    cur_t = _stamps(rng, robot.currents.rate, end, robot.encoders.jitter)
    stated = None if isinstance(run.variant, Course) else run.variant  # the log holds a course itself
    trial = Trial(
        name=name,
        info=TrialInfo(
            robot=robot.name,
            soil=run.soil.name,
            v_desired=stated.velocity if stated else None,
            a_max=stated.acceleration if stated else None,
            distance=stated.distance if stated else None,
            repetition=1,
            virtual=True,
        ),
        imu=imu,
        wheels=wheels,
        currents=_currents(run, cur_t, origin, rng),
        command=Series(enc_t, _at(run, "v_desired_mps", enc_t - origin)),
    )
    names = ("x_m", "v_mps", "pitch_rad", "v_wheel_f_mps", "v_wheel_r_mps", "slip_f", "slip_r")
    truth = pd.DataFrame({"t_s": imu_t} | {n: _at(run, n, imu_t - origin) for n in names})
    truth.attrs = {
        "slip_ratio": run.slip_ratio,
        "t_start_s": origin,
        "k92_law": run.k92_law,
        "k92_value": run.k92_value,
        "frictional_modulus_Pa_mn": run.soil.frictional_modulus,
        "cohesion_Pa": run.soil.cohesion,
        "tilt_rad": tilt,
        "seed": seed,
    }
    return trial, truth


def _at(run: Run, name: str, t: Array) -> Array:
    """Interpolate a signal; before and after the run the robot is at rest."""
    return np.asarray(np.interp(t, run.t, run[name]))


def _mean_at(run: Run, name: str, t: Array, width: float) -> Array:
    """Average a signal over an interval around each t, as a sensor's own low-pass filter does."""
    gained: Array = cumulative_trapezoid(run[name], run.t, initial=0)

    def integral(at: Array) -> Array:
        beyond = np.minimum(at - run.t[0], 0) * run[name][0] + np.maximum(at - run.t[-1], 0) * run[name][-1]
        return np.asarray(np.interp(at, run.t, gained) + beyond)

    return np.asarray((integral(t + width / 2) - integral(t - width / 2)) / width)


def _stamps(rng: np.random.Generator, rate: float, end: float, jitter: float) -> Array:
    """Return strictly increasing stamps [s] from 0 to `end`, rounded to the microsecond."""
    t = rng.uniform(0, 1 / rate) + np.arange(int((end - 1 / rate) * rate)) / rate
    t += np.clip(rng.normal(0, jitter, t.size), -0.3 / rate, 0.3 / rate)
    return np.asarray(np.round(t - min(t[0], 0.0), 6))


def _imu(run: Run, t: Array, origin: float, rng: np.random.Generator) -> tuple[ImuStream, float]:
    robot, grade, n = run.robot, run.robot.imu_grade, t.size
    force = np.zeros((n, 3))
    rate = np.zeros((n, 3))
    force[:, 0] = _mean_at(run, "imu_ax_mps2", t - origin, 1 / grade.rate)
    force[:, 2] = _mean_at(run, "imu_az_mps2", t - origin, 1 / grade.rate)
    rate[:, 1] = _mean_at(run, "imu_gy_radps", t - origin, 1 / grade.rate)
    shaken = np.abs(_at(run, "v_wheel_f_mps", t - origin)) / 0.5
    for axis, share in enumerate((1.0, LATERAL_VIBRATION, 1.0)):
        force[:, axis] += robot.imu.vibration * share * shaken * _vibration(robot, n, rng)
    rate[:, 1] += robot.imu.vibration_rate * shaken * _vibration(robot, n, rng)
    tilt = rng.normal(0, robot.imu.tilt, 2)
    mounting = Rotation.from_euler("xyz", robot.imu.rotation, degrees=True)  # Rz Ry Rx
    turn = (mounting * Rotation.from_euler("xy", tilt, degrees=True)).inv()
    force, rate = turn.apply(force), turn.apply(rate)
    force += _error(rng, n, grade, grade.accel_bias, grade.accel_instability, grade.accel_noise)
    rate += _error(rng, n, grade, grade.gyro_bias, grade.gyro_instability, grade.gyro_noise)
    return (
        ImuStream(
            t,
            _digitise(force, grade.accel_range, grade.accel_step),
            _digitise(rate, grade.gyro_range, grade.gyro_step),
        ),
        float(np.radians(tilt[1])),
    )


def _vibration(robot: Robot, n: int, rng: np.random.Generator) -> Array:
    """Return noise of unit rms in an octave around the frame's frequency; nothing near zero Hz."""
    low, high = robot.imu.vibration_frequency / np.sqrt(2), robot.imu.vibration_frequency * np.sqrt(2)
    top = 0.45 * robot.imu_grade.rate
    band = [min(low, 0.5 * top), min(high, top)]
    sos = butter(2, band, btype="bandpass", fs=robot.imu_grade.rate, output="sos")
    shaken = sosfilt(sos, rng.normal(size=n + 200))[200:]
    return np.asarray(shaken / shaken.std())


def _error(
    rng: np.random.Generator, n: int, grade: ImuGrade, bias: float, instability: float, density: float
) -> Array:
    """Turn-on bias, first-order Gauss-Markov instability and white noise of three axes."""
    keep = np.exp(-1 / (grade.rate * grade.instability_time))
    drive = rng.normal(size=(n, 3)) * np.sqrt(1 - keep**2)
    drive[0] = rng.normal(size=3)
    wander = instability * lfilter([1.0], [1.0, -keep], drive, axis=0)
    return np.asarray(
        rng.normal(0, bias, 3) + wander + rng.normal(size=(n, 3)) * density * np.sqrt(grade.rate)
    )


def _digitise(values: Array, limit: float, step: float) -> Array:
    clipped = np.clip(values, -limit, limit)
    return np.round(np.round(clipped / step) * step, 9) if step else clipped


def _encoders(run: Run, t: Array, origin: float) -> WheelStream:
    angle = np.column_stack([_at(run, f"enc_{wheel[0]}_rad", t - origin) for wheel in WHEELS])
    counts = run.robot.encoders.counts
    step = 2 * np.pi / counts if counts else 0.0
    return WheelStream(t, np.floor(angle / step) * step if step else angle, resolution=(step,) * 4)


def _currents(run: Run, t: Array, origin: float, rng: np.random.Generator) -> CurrentStream:
    true = np.column_stack([_at(run, f"cur_{wheel[0]}_A", t - origin) for wheel in WHEELS])
    c = run.robot.currents
    read = true * (1 + rng.normal(0, c.gain, 4)) + rng.normal(0, c.offset, 4)
    read += rng.normal(0, c.noise, read.shape)
    return CurrentStream(t, np.round(np.round(read / c.step) * c.step, 9) if c.step else read)
