"""One trial beside its simulation, channel by channel and phase by phase."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from granite_lab.errors import EstimateError
from granite_lab.estimation.motion import Motion
from granite_lab.fitting.fit import K92Fit
from granite_lab.logs.counters import mean_known
from granite_lab.logs.trial import Array, Trial
from granite_lab.model import Run
from granite_lab.model.command import V_FLOOR
from granite_lab.model.symbols import DIRECT
from granite_lab.parameters import WHEELS, Robot
from granite_lab.shown import Shown, frame

if TYPE_CHECKING:
    import pandas as pd

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

PHASES = ("all", "rest", "accelerate", "steady", "brake")

STANDSTILL = frozenset({"pitch", "accel", "pitch_rate"})
"""Channels of which the change since the standstill before the command is compared."""

SLIP_STD_USED = 0.1
"""Slip ratios with a larger std are not compared (the last moments before standstill, section 5)."""

_FAST = 0.1
"""What a moving average over this time [s] takes out of an IMU signal counts as its noise."""

Measured = dict[str, tuple[Array, Array]]
"""Channel to (N,) values and std; what was not measured is absent."""


@dataclass(frozen=True)
class Misfit:
    """How far simulation and measurement are apart in one channel and phase.

    Attributes:
        unit: of `rms`, `bias` and `peak`.
        phase: one of `PHASES`.
        rms, bias, peak: root mean square, mean and largest absolute difference (simulated minus measured).
        normalised: root mean square of the difference over its std (1 is the noise floor); NaN if unknown.
        samples: number of them.
    """

    channel: str
    unit: str
    phase: str
    rms: float
    bias: float
    peak: float
    normalised: float
    samples: int


@dataclass(frozen=True, eq=False)
class Comparison(Shown):
    """One trial, measured and simulated on the same time axis.

    Attributes:
        trial: as estimation corrected it.
        run: the simulation with the fitted k_92.
        t: (N,) time since the start of the command [s].
        measured, measured_std, simulated: channel of `units` to (N,) values in its unit; NaN where nothing
            was measured.
    """

    units: ClassVar[dict[str, str]] = UNITS
    trial: Trial
    motion: Motion
    run: Run
    fit: K92Fit
    t: Array
    measured: dict[str, Array]
    measured_std: dict[str, Array]
    simulated: dict[str, Array]
    misfits: tuple[Misfit, ...]

    @property
    def start(self) -> float:
        """The log's own time [s] at which the clock of the comparison reads zero."""
        return float(np.median(self.motion.t - self.t))

    def __repr__(self) -> str:
        return f"Comparison({self.motion!r}, {self.fit!r}, {len(self.misfits)} misfits)"

    def to_frame(self) -> pd.DataFrame:
        """Return the misfits, one row a channel and phase; `unit` is that of rms, bias and peak."""
        return frame([dataclasses.asdict(misfit) for misfit in self.misfits])


def compare(motion: Motion, trial: Trial, fit: K92Fit, run: Run) -> Comparison:
    """Compare a trial with its simulation.

    Args:
        motion, trial: the estimate, and the trial as it was corrected.
        fit: its t_start aligns the two in time.
        run: the simulation of the trial's command, with the k_92 of `fit`.

    Raises:
        EstimateError: the start of the command is unknown.
    """
    start = fit.t_start.value if np.isfinite(fit.t_start.value) else motion.t_start.value
    if not np.isfinite(start):
        raise EstimateError(
            f"{motion.trial}: the start of the command is unknown, so no simulation can be aligned with it",
            "the log must contain the beginning of the motion",
        )
    t = motion.t - start
    simulated = simulated_channels(run, t)
    measured = _measured(motion, trial, run.robot, t)
    for name in measured.keys() & STANDSTILL:
        # tilt and bias of the sensor cannot be separated from the robot's pitch: its change is compared
        value, std = measured[name]
        measured[name] = value - standstill_mean(t, value - simulated[name])[0], std
    late = np.nan_to_num(fit.t_start.std)
    values, stds, misfits = {}, {}, []
    for name, (value, sensor_std) in measured.items():
        values[name], stds[name] = value, sensor_std
        std = np.hypot(sensor_std, np.abs(np.gradient(simulated[name], t)) * late)
        misfits += misfits_of(name, value, std, simulated[name], np.array(motion.phase))
    return Comparison(trial, motion, run, fit, t, values, stds, simulated, tuple(misfits))


def misfits_of(
    channel: str, measured: Array, std: Array, simulated: Array, phase: npt.NDArray[np.str_]
) -> list[Misfit]:
    """Return the misfit over the whole trial and over each phase that has samples.

    All arrays are (N,), `std` is that of the difference, values in the channel's unit.
    """
    difference = simulated - measured
    usable = np.isfinite(difference)
    if channel.startswith("slip"):
        usable &= ~(std > SLIP_STD_USED) & (phase != "rest")
    misfits = []
    for name in PHASES:
        mask = usable if name == "all" else usable & (phase == name)
        if not mask.any():
            continue
        d, s = difference[mask], std[mask]
        with_std = np.isfinite(s) & (s > 0)
        normalised = float(np.sqrt(np.mean((d[with_std] / s[with_std]) ** 2))) if with_std.any() else np.nan
        rms, bias, peak = float(np.sqrt(np.mean(d**2))), float(d.mean()), float(np.abs(d).max())
        misfits.append(Misfit(channel, UNITS[channel], name, rms, bias, peak, normalised, int(mask.sum())))
    return misfits


def _measured(motion: Motion, trial: Trial, robot: Robot, t: Array) -> Measured:
    """Return what was measured, at the (N,) stamps `t` of the motion [s after command start]."""
    channels = {"velocity": (motion.v, motion.v_std), "pitch": (motion.pitch, motion.pitch_std)}
    for i, wheel in enumerate(WHEELS):
        channels[f"wheel_{wheel}"] = motion.v_wheel[:, i], motion.v_wheel_std[:, i]
    for axle, columns in AXLES.items():
        # the body's velocity is common to a pair and rules the error, so a mean is no better than one
        channels[f"slip_{axle}"] = (
            mean_known(motion.slip[:, columns]),
            mean_known(motion.slip_std[:, columns]),
        )
    channels |= _torques(motion, trial, robot, t) | _imu(motion, trial)
    return {
        name: channels[name] for name in UNITS if name in channels and np.isfinite(channels[name][0]).any()
    }


def simulated_channels(run: Run, t: Array) -> dict[str, Array]:
    """Return every channel of a run at `t`; at rest outside the run.

    All are those of the virtual sensors, so that a sensor's fault in the model appears in them.
    """
    v = run["v_mps"]
    drawn = {"velocity": v, "pitch": run["pitch_rad"]}
    drawn |= {"accel": run["imu_ax_mps2"], "pitch_rate": run["imu_gy_radps"]}
    for axle, columns in AXLES.items():
        v_o = run.robot.wheels.radius * np.gradient(run[f"enc_{axle}_rad"], run.t)
        drawn |= {f"wheel_{WHEELS[i]}": v_o for i in columns}
        drawn[f"slip_{axle}"] = (v_o - v) / np.maximum(np.maximum(np.abs(v_o), np.abs(v)), V_FLOOR)  # (1)
        drawn[f"torque_{axle}"] = _torque_per_ampere(run.robot) * run[f"cur_{axle}_A"]
    return {name: np.asarray(np.interp(t, run.t, drawn[name])) for name in UNITS}


def _torque_per_ampere(robot: Robot) -> float:
    """Return η_d n_d k_m of (24) [N m/A]; 1 without a drive, where the current stands for the torque."""
    drive = robot.drive or DIRECT
    return drive.gear_efficiency * drive.gear_ratio * drive.torque_constant


def standstill_mean(t: Array, signal: Array) -> tuple[float, int]:
    """Return the mean of a signal up to 50 ms before the command, and of how many samples; 0 of none."""
    still = (t < -0.05) & np.isfinite(signal)
    count = int(still.sum())
    return (float(signal[still].mean()), count) if count else (0.0, 0)


def _torques(motion: Motion, trial: Trial, robot: Robot, t: Array) -> Measured:
    """Return the driving torque of a wheel by (24), mean of a pair, less the offset at standstill."""
    sensor, torques = robot.currents, {}
    if trial.currents is None or robot.drive is None or robot.motors == "side":
        return {}
    late = motion.clock_left.value if np.isfinite(motion.clock_left.value) else 0.0
    stamps = trial.currents.t + late - (motion.t[0] - t[0])  # time since command start
    for axle, columns in AXLES.items():
        pair, offset_stds = [], []
        for current in trial.currents.current[:, columns].T:
            good = np.isfinite(current)
            if good.sum() < 2:
                continue
            offset, samples = standstill_mean(stamps, current)
            rounded = sensor.step / np.sqrt(12)
            offset_stds.append(max(sensor.noise / np.sqrt(samples), rounded) if samples else sensor.offset)
            pair.append(np.interp(t, stamps[good], current[good] - offset, left=np.nan, right=np.nan))
        if pair:
            factor, mean = _torque_per_ampere(robot), np.mean(pair, axis=0)
            offset_variance = np.mean(np.square(offset_stds))
            total_std = np.sqrt(sensor.noise**2 + offset_variance + (sensor.gain * mean) ** 2)
            torques[f"torque_{axle}"] = factor * mean, factor * total_std / np.sqrt(len(pair))
    return torques


def _imu(motion: Motion, trial: Trial) -> Measured:
    """Return specific force along the robot and pitch rate; the std of each phase is that of its noise."""
    from scipy.ndimage import uniform_filter1d  # noqa: PLC0415, heavy

    imu, phase, signals = trial.imu, np.array(motion.phase), {}
    if imu is None:
        return {}
    for name, signal in (("accel", imu.specific_force[:, 0]), ("pitch_rate", imu.angular_rate[:, 1])):
        good = np.isfinite(signal)
        if good.sum() < 8:
            continue
        t, y = imu.t[good], signal[good]
        window = max(3, round(_FAST / float(np.median(np.diff(imu.t)))))
        noise = np.interp(motion.t, t, (y - uniform_filter1d(y, window, mode="nearest")) ** 2)
        std = np.empty(motion.t.size)
        for name_of_phase in np.unique(phase):
            std[phase == name_of_phase] = np.sqrt(noise[phase == name_of_phase].mean())
        signals[name] = np.interp(motion.t, t, y), std
    return signals
