"""The channels of a comparison: what was measured and what the model says, at the same instants."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from granite_lab.estimation.motion import Motion
from granite_lab.logs.trial import Array, Trial
from granite_lab.model import Run
from granite_lab.model.command import V_FLOOR
from granite_lab.parameters import WHEELS, Robot

AXLES = {"f": (0, 1), "r": (2, 3)}
"""Columns of WHEELS that form a pair; the model's pairs are symmetric (section 3.3)."""

UNITS = {
    "velocity": "m/s",
    **{f"wheel_{wheel}": "m/s" for wheel in WHEELS},
    **{f"slip_{axle}": "-" for axle in AXLES},
    **{f"torque_{axle}": "N m" for axle in AXLES},
    "pitch": "rad",
    "accel": "m/s^2",
    "pitch_rate": "rad/s",
}
"""Channel to unit, in the order in which they are shown."""

_FAST = 0.1
"""What a moving average over this time [s] takes out of an IMU signal counts as its noise."""


Measured = dict[str, tuple[Array, Array]]
"""Channel to (N,) values and std; what was not measured is absent."""


def measured_channels(motion: Motion, trial: Trial, robot: Robot, t: Array) -> Measured:
    """Return what was measured, at the stamps of the motion.

    Currents become driving torques of one wheel by (24), T = η_d n_d k_m i, mean of a pair; their
    offsets are taken out at the standstill before the start.

    Args:
        motion: the estimate.
        trial: as estimation corrected it.
        robot: with the sensors' figures.
        t: (N,) the motion's stamps as time since the start of the command [s].
    """
    found = {"velocity": (motion.v, motion.v_std), "pitch": (motion.pitch, motion.pitch_std)}
    for i, wheel in enumerate(WHEELS):
        found[f"wheel_{wheel}"] = motion.v_wheel[:, i], motion.v_wheel_std[:, i]
    for axle, columns in AXLES.items():
        # the body's velocity is common to a pair and rules the error, so a mean is no better than one
        found[f"slip_{axle}"] = _mean_known(motion.slip[:, columns]), _mean_known(motion.slip_std[:, columns])
    found |= _torques(motion, trial, robot, t) | _imu(motion, trial)
    return {name: found[name] for name in UNITS if name in found and np.isfinite(found[name][0]).any()}


def simulated_channels(run: Run, t: Array) -> dict[str, Array]:
    """Return every channel of a run at `t` (N,) [s after command start]; at rest outside the run.

    Wheel speeds and slip are those of the virtual encoders with the nominal radius, specific force
    and pitch rate those of the virtual IMU, so that a sensor's fault in the model appears in them.
    """
    drive = run.robot.drive
    assert drive is not None
    v = run["v_mps"]
    drawn = {"velocity": v, "pitch": run["pitch_rad"]}
    drawn |= {"accel": run["imu_ax_mps2"], "pitch_rate": run["imu_gy_radps"]}
    for axle, columns in AXLES.items():
        v_o = run.robot.wheels.radius * np.gradient(run[f"enc_{axle}_rad"], run.t)
        drawn |= {f"wheel_{WHEELS[i]}": v_o for i in columns}
        drawn[f"slip_{axle}"] = (v_o - v) / np.maximum(np.maximum(np.abs(v_o), np.abs(v)), V_FLOOR)  # (1)
        factor = drive.gear_efficiency * drive.gear_ratio * drive.torque_constant
        drawn[f"torque_{axle}"] = factor * run[f"cur_{axle}_A"]  # (24), as if measured
    return {name: np.asarray(np.interp(t, run.t, drawn[name])) for name in UNITS}


def without_offsets(measured: Measured, simulated: dict[str, Array], t: Array) -> Measured:
    """Shift pitch, specific force and pitch rate so that they agree with the model at standstill.

    Before the start, tilt of the sensor and bias cannot be told from the robot's own pitch; what is
    compared is the change since then.
    """
    shifted = dict(measured)
    for name in {"pitch", "accel", "pitch_rate"} & measured.keys():
        value, std = measured[name]
        shifted[name] = value - _standstill_mean(t, value - simulated[name])[0], std
    return shifted


def _standstill_mean(t: Array, signal: Array) -> tuple[float, int]:
    """Return the mean of a signal while the robot waits for the command, and of how many samples.

    The last 50 ms before the start are left out. Without samples the mean is 0: nothing is known.
    """
    still = (t < -0.05) & np.isfinite(signal)
    count = int(still.sum())
    return (float(signal[still].mean()), count) if count else (0.0, 0)


def _mean_known(columns: Array) -> Array:
    known = np.isfinite(columns)
    total = np.where(known, columns, 0.0).sum(axis=1)
    return np.where(known.any(axis=1), total / np.maximum(1, known.sum(axis=1)), np.nan)


def _torques(motion: Motion, trial: Trial, robot: Robot, t: Array) -> Measured:
    drive, sensor = robot.drive, robot.currents
    if trial.currents is None or drive is None:
        return {}
    late = motion.clock_left.value if np.isfinite(motion.clock_left.value) else 0.0
    stamps = trial.currents.t + late - (motion.t[0] - t[0])  # time since command start
    factor = drive.gear_efficiency * drive.gear_ratio * drive.torque_constant
    found = {}
    for axle, columns in AXLES.items():
        pair = []
        offset_std = sensor.offset
        for current in trial.currents.current[:, columns].T:
            good = np.isfinite(current)
            if good.sum() < 2:
                continue
            offset, samples = _standstill_mean(stamps, current)
            if samples:
                offset_std = max(sensor.noise / np.sqrt(samples), sensor.step / np.sqrt(12))
            pair.append(np.interp(t, stamps[good], current[good] - offset, left=np.nan, right=np.nan))
        if pair:
            mean = np.mean(pair, axis=0)
            spread = np.sqrt(sensor.noise**2 + offset_std**2 + (sensor.gain * mean) ** 2)
            found[f"torque_{axle}"] = factor * mean, factor * spread / np.sqrt(len(pair))
    return found


def _imu(motion: Motion, trial: Trial) -> Measured:
    imu = trial.imu
    if imu is None:
        return {}
    phase = np.array(motion.phase)
    found = {}
    for name, signal in (("accel", imu.specific_force[:, 0]), ("pitch_rate", imu.angular_rate[:, 1])):
        good = np.isfinite(signal)
        if good.sum() < 8:
            continue
        t, y = imu.t[good], signal[good]
        window = max(3, round(_FAST / float(np.median(np.diff(imu.t)))))
        noise = np.interp(motion.t, t, (y - uniform_filter1d(y, window, mode="nearest")) ** 2)
        std = np.empty(motion.t.size)
        for own in np.unique(phase):
            std[phase == own] = np.sqrt(noise[phase == own].mean())
        found[name] = np.interp(motion.t, t, y), std
    return found
