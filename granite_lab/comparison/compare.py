"""One trial beside its simulation, channel by channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from granite_lab.comparison.record import Comparison, Misfit
from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import K92Fit
from granite_lab.fitting.k92 import simulate_k92
from granite_lab.logs.trial import Array, Trial
from granite_lab.model import Run
from granite_lab.model.command import V_FLOOR
from granite_lab.model.effect import Active
from granite_lab.parameters import WHEELS, Robot, Soil

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

PHASES = ("all", "rest", "accelerate", "steady", "brake")

SLIP_STD_USED = 0.1
"""Slip ratios with a larger std say nothing (the last moments before standstill, section 5)."""

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


def compare(
    motion: Motion,
    trial: Trial,
    fit: K92Fit,
    robot: Robot,
    soil: Soil,
    *,
    effects: Sequence[Active] = (),
    run: Run | None = None,
) -> Comparison:
    """Hold a trial against its simulation, channel by channel and phase by phase.

    Args:
        motion: the estimate.
        trial: as estimation corrected it; currents and IMU are compared as well.
        fit: its k_92 (by steady slip) is simulated by (5), its t_start aligns the two in time.
        robot: with chassis and drive.
        soil: the ground.
        effects: effects added to the paper's model.
        run: a simulation to compare with instead.

    Raises:
        EstimateError: the start of the command is unknown, or the simulation fails.
        InputError: the robot's file lacks chassis or drive.
    """
    if run is None:
        run = simulate_k92(fit.variant, robot, soil, fit.k92.value, effects=effects)
    start = fit.t_start.value if np.isfinite(fit.t_start.value) else motion.t_start.value
    if not np.isfinite(start):
        raise EstimateError(
            f"{motion.trial}: the start of the command is unknown, so no simulation can be aligned with it",
            "the log must contain the beginning of the motion",
        )
    t = motion.t - start
    simulated = simulated_channels(run, t)
    measured = without_offsets(measured_channels(motion, trial, robot, t), simulated, t)
    misfits: list[Misfit] = []
    for name, (value, own) in measured.items():
        std = np.hypot(own, alignment_std(simulated[name], t, fit.t_start))
        misfits += misfits_of(name, value, std, simulated[name], np.array(motion.phase))
    return Comparison(
        motion=motion,
        run=run,
        fit=fit,
        t=t,
        measured={name: value for name, (value, _) in measured.items()},
        measured_std={name: std for name, (_, std) in measured.items()},
        simulated=simulated,
        units=dict(UNITS),
        misfits=tuple(misfits),
    )


def alignment_std(simulated: Array, t: Array, start: Estimate) -> Array:
    """Return the std (N,) that the uncertain start of the command gives a difference, |df/dt| σ."""
    if not np.isfinite(start.std):
        return np.zeros(t.size)
    return np.abs(np.gradient(simulated, t)) * start.std


def misfits_of(
    channel: str, measured: Array, std: Array, simulated: Array, phase: npt.NDArray[np.str_]
) -> list[Misfit]:
    """Return the misfit over the whole trial and over each phase that has samples.

    Args:
        channel: its name.
        measured, simulated: (N,) in the channel's unit.
        std: (N,) of their difference.
        phase: (N,) phase of each sample.
    """
    difference = simulated - measured
    usable = np.isfinite(difference)
    if channel.startswith("slip"):
        usable &= ~(std > SLIP_STD_USED) & (phase != "rest")
    found = []
    for name in PHASES:
        mask = usable if name == "all" else usable & (phase == name)
        if not mask.any():
            continue
        d, s = difference[mask], std[mask]
        known = np.isfinite(s) & (s > 0)
        found.append(
            Misfit(
                channel=channel,
                unit=UNITS[channel],
                phase=name,
                rms=float(np.sqrt(np.mean(d**2))),
                bias=float(d.mean()),
                peak=float(np.abs(d).max()),
                normalised=float(np.sqrt(np.mean((d[known] / s[known]) ** 2))) if known.any() else np.nan,
                samples=int(mask.sum()),
            )
        )
    return found
