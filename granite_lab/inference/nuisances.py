"""What differs from trial to trial without being a missing effect: sand, start, tilt, offsets, gains.

Each is a number with a prior around zero whose std is learnt from the trials; a file says where that
begins. The sand enters through simulations; the rest is applied to a finished simulation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.inference.binning import CURRENTS, IMU, WHEELS
from granite_lab.inference.constants import (
    CURRENT_LATENCY_STD,
    LATENCY_STD,
    LOW_PASS_STD,
    SAND_PER_TRIAL_STD,
    SENSOR_STD,
    THREE_SIGMA,
)
from granite_lab.inference.observation import Observation
from granite_lab.inference.pool import ACCURACY, SAND, SAND_PER_TRIAL
from granite_lab.logs.trial import Array
from granite_lab.model.instants import instants
from granite_lab.parameters import GRAVITY, Robot, load_grade

MOTORS = ("f", "r", "side")

CALIBRATION = (
    "accel_x gain",
    "wheel gain",
    "wheel_split gain",
    *(f"current_{motor} gain" for motor in MOTORS),
)
"""Gains that a calibration leaves open. All trials share the error of a file or a data sheet, and each trial
deviates from it by a number of its own. The tilt of the IMU is not one: each trial is levelled at rest."""

SENSORS = ("latency", "arm_x", "arm_z", "current_latency", "low_pass", *CALIBRATION)
"""What all trials share of the sensors: latency of the IMU's stamps behind those of the wheels [s], its place
off the file [m], latency of the currents behind the wheels [s], variance of the impulse response of the IMU's
low-pass [s^2], and what the calibration leaves open."""

SENSORS_LEAST = np.array([0.0 if name == "low_pass" else -np.inf for name in SENSORS])
"""Their lower bounds."""

LATENCY_OF = {IMU: "latency", CURRENTS: "current_latency"}
"""The number of `SENSORS` by which a sensor is late."""

ARM_OF = {"accel_x": "arm_z", "accel_z": "arm_x"}
"""The number of `SENSORS` by which turning shows in a channel."""

_SHIFT_STEP, _LOW_PASS_STEP = 2e-4, LOW_PASS_STD / 8
"""Steps of derivatives by time [s], within which one trial determines a latency, and by the variance of a
low-pass [s^2]: with less its window ends within the same step of the simulation, beyond which the derivative
is another. Responses are chains of straight lines, whose slopes differ: as several trials determine a latency
better, the former falls with the root of their number."""


@dataclass(frozen=True)
class Slack:
    """One number per trial that is applied to a finished simulation.

    Attributes:
        name: for people.
        std: first value of the std of its prior, in its unit.
        learnt: the std is learnt from the trials; otherwise the standstill determines the number anyway.
    """

    name: str
    std: float
    learnt: bool = False


class TrialModel:
    """How one trial depends on its own numbers.

    A trial's numbers x are: the first `SAND_PER_TRIAL` of `SAND` (about the common sand), the shift of the
    start [s], then the slacks, those of `CALIBRATION` about what all trials share of them.

    Args:
        observation: the trial in bins.
        variant: number of what drives its simulation.
        robot: whose wheels and sensors it has.
        command: number of its command, which repetitions share; by default that of what drives it.
        count: number of trials that share the numbers of the sensors.
    """

    def __init__(
        self,
        observation: Observation,
        variant: int,
        robot: Robot,
        command: int | None = None,
        count: int = 1,
    ) -> None:
        self.observation, self.variant = observation, variant
        self.command = variant if command is None else command
        self.channels = tuple(observation.streams)
        self.slacks = (
            *(
                Slack(name, std, True)
                for name, std in zip(SAND[:SAND_PER_TRIAL], SAND_PER_TRIAL_STD, strict=True)
            ),
            Slack("start", SENSOR_STD["start"]),
            *_slacks(observation, robot),
        )
        self._place = {s.name: k for k, s in enumerate(self.slacks)}
        self.t = instants(observation.variant, ACCURACY)
        self.radius, self._step = robot.wheels.radius, _SHIFT_STEP / math.sqrt(count)
        self.measured = np.stack([observation.values[c] for c in self.channels])

    @property
    def size(self) -> int:
        """How many numbers the trial has."""
        return len(self.slacks)

    def bins_of(
        self, response: Array, x: Array, sensors: Array, only: Sequence[str] = ()
    ) -> dict[str, Array]:
        """Return channel to the (n,) bins of an (8, M) response, or of changes of it, (n, k) of (8, M, k).

        All channels by default; the accelerations are those at the place of the IMU.
        """
        return self._bins(self._at_imu(response, sensors), x, sensors, only)

    def _bins(self, felt: Array, x: Array, sensors: Array, only: Sequence[str] = ()) -> dict[str, Array]:
        """Return `bins_of` what `_at_imu` returns."""
        imu, currents, low_pass = (
            float(sensors[SENSORS.index(name)]) for name in ("latency", "current_latency", "low_pass")
        )
        return self.observation.binned(
            self.t, felt, float(x[SAND_PER_TRIAL]), (0.0, imu, currents), only, low_pass
        )

    def predict(self, response: Array, x: Array, sensors: Array) -> Array:
        """Return the (C, n) bins that the trial should show."""
        out = self._shown(self.bins_of(response, x, sensors), x, sensors)
        return np.stack([out[c] + self._of(x, sensors, f"{c} offset") for c in self.channels])

    def _shown(self, b: Mapping[str, Array], x: Array, sensors: Array) -> dict[str, Array]:
        """Return the bins of a response, (n,), or of changes of it, (n, k), as the sensors show them."""
        out = dict(b)
        if "accel_x" in b:
            tilt = self._of(x, sensors, "tilt")
            out["accel_x"] = (1 + self._of(x, sensors, "accel_x gain")) * (b["accel_x"] - tilt * b["accel_z"])
            out["accel_z"] = b["accel_z"] + tilt * b["accel_x"]
        if "wheel_split" in b:
            out["wheel_split"] = b["wheel_split"] + self._of(x, sensors, "wheel_split gain") * b["wheel"]
        for c in ("wheel", "current_f", "current_r", "current_side"):
            if c in b:
                out[c] = (1 + self._of(x, sensors, f"{c} gain")) * b[c]
        return out

    def directions(self, response: Array) -> Array:
        """Return the (8, M, 2) response itself, and its change with the place of the IMU."""
        return np.dstack([response, self._turning(response)])

    def columns(self, changes: Array, x: Array, sensors: Array) -> tuple[Array, Array, Array]:
        """Return the derivatives of `predict`.

        Args:
            changes: (8, M, 2 + SAND_PER_TRIAL + k) of the response: its `directions`, its derivatives by the
                sand that is raked, and k others.
            x: the trial's numbers.
            sensors: numbers of the sensors that all trials share.

        Returns:
            (C n, p) by the trial's numbers, (C n, s) by `SENSORS`, (C n, k) by what the others are of.
        """
        felt = self._at_imu(changes, sensors)
        bins = self._bins(felt, x, sensors)
        shown = self._shown(bins, x, sensors)
        later = self._later(felt[..., 0], x, sensors)
        raked, others = slice(2, 2 + SAND_PER_TRIAL), slice(2 + SAND_PER_TRIAL, None)
        local = np.zeros((len(self.channels), self.observation.bins, self.size))
        by_sensor = np.zeros((*local.shape[:2], len(SENSORS)))
        for k, c in enumerate(self.channels):
            local[k, :, :SAND_PER_TRIAL], local[k, :, SAND_PER_TRIAL] = shown[c][:, raked], later[c]
            sensor = self.observation.streams[c].sensor
            if sensor != WHEELS:
                by_sensor[k, :, SENSORS.index(LATENCY_OF[sensor])] = later[c]
        for c, by_low_pass in self._by_low_pass(felt[..., 0], x, sensors).items():
            by_sensor[self.channels.index(c), :, SENSORS.index("low_pass")] = by_low_pass
        for axis, arm in ARM_OF.items() if "accel_x" in bins else ():
            turning = self._shown({c: bins[c][:, 1] * (c == axis) for c in ARM_OF}, x, sensors)
            for c in ARM_OF:
                by_sensor[self.channels.index(c), :, SENSORS.index(arm)] = turning[c]
        for n, slack in enumerate(self.slacks[SAND_PER_TRIAL + 1 :], start=SAND_PER_TRIAL + 1):
            channel, _, kind = slack.name.partition(" ")
            if slack.name == "tilt":
                gain = 1 + self._of(x, sensors, "accel_x gain")
                local[self.channels.index("accel_x"), :, n] = -gain * bins["accel_z"][:, 0]
                local[self.channels.index("accel_z"), :, n] = bins["accel_x"][:, 0]
            elif kind == "offset":
                local[self.channels.index(channel), :, n] = 1.0
            else:  # a gain
                gain = 1 + self._of(x, sensors, slack.name)
                alone = bins["wheel"] if channel == "wheel_split" else shown[channel] / gain
                local[self.channels.index(channel), :, n] = alone[:, 0]
            if slack.name in CALIBRATION:
                by_sensor[..., SENSORS.index(slack.name)] = local[..., n]
        rows = local.shape[0] * local.shape[1]
        rest = np.concatenate([shown[c][:, others] for c in self.channels])
        return local.reshape(rows, -1), by_sensor.reshape(rows, -1), rest

    def effect_columns(self, changes: Array, x: Array, sensors: Array) -> Array:
        """Return the (C n, k) bins of k changes of the response, (8, M, k)."""
        shown = self._shown(self.bins_of(changes, x, sensors), x, sensors)
        return np.concatenate([shown[c] for c in self.channels])

    def _by_low_pass(self, felt: Array, x: Array, sensors: Array) -> dict[str, Array]:
        """Return channel of the IMU to the (n,) derivative of its bins by the variance of the low-pass."""
        channels = [c for c in self.channels if self.observation.streams[c].sensor == IMU]
        if not channels:
            return {}
        at, place = float(sensors[SENSORS.index("low_pass")]), np.array(SENSORS) == "low_pass"
        narrow, wide = max(at - _LOW_PASS_STEP, 0.0), at + _LOW_PASS_STEP
        low, high = (self._bins(felt, x, np.where(place, s, sensors), channels) for s in (narrow, wide))
        shown = self._shown({c: (high[c] - low[c]) / (wide - narrow) for c in channels}, x, sensors)
        return {c: shown[c] for c in channels}

    def _turning(self, response: Array) -> Array:
        """Return how specific force changes with the place of the IMU: Θ̈ along x, −Θ̈ along z."""
        pitching = self._pitching(response)
        out = np.zeros_like(response)
        out[0], out[1] = pitching, -pitching
        return out

    def _pitching(self, response: Array) -> Array:
        """Return the pitch acceleration Θ̈ of a response [rad/s^2]."""
        return np.asarray(np.gradient(response[2], self.t, axis=0))

    def _at_imu(self, response: Array, sensors: Array) -> Array:
        """Return a response, or changes of it, with the specific force at the place of the IMU."""
        arm_x, arm_z = (sensors[SENSORS.index(name)] for name in ("arm_x", "arm_z"))
        if arm_x == arm_z == 0:
            return response
        pitching, felt = self._pitching(response), response.copy()
        felt[0] += arm_z * pitching
        felt[1] -= arm_x * pitching
        return felt

    def _later(self, felt: Array, x: Array, sensors: Array) -> dict[str, Array]:
        """Return channel to the (n,) derivative of its bins by a later start of the command.

        A simulation is a chain of straight lines; where the stamps lie in them decides the derivative.
        """
        step = self._step * (np.arange(x.size) == SAND_PER_TRIAL)
        sooner, later = (self._bins(felt, x + sign * step, sensors) for sign in (-1, 1))
        return self._shown({c: (later[c] - sooner[c]) / (2 * self._step) for c in later}, x, sensors)

    def _of(self, x: Array, sensors: Array, name: str) -> float:
        """Return a number of the trial, with what all trials share of it."""
        if name not in self._place:
            return 0.0
        shared = sensors[SENSORS.index(name)] if name in CALIBRATION else 0.0
        return float(x[self._place[name]] + shared)


def sensors_std(learnt: Mapping[str, float]) -> Array:
    """Return the std of the priors of `SENSORS`; `learnt` has those of `CALIBRATION` that any trial has."""
    rest = [LATENCY_STD, SENSOR_STD["arm"], SENSOR_STD["arm"], CURRENT_LATENCY_STD, LOW_PASS_STD]
    return np.array([*rest, *(learnt.get(name, 1.0) for name in CALIBRATION)])


def _slacks(observation: Observation, robot: Robot) -> tuple[Slack, ...]:
    """List the slacks of the channels that were logged.

    Offsets are wider than the sensors' data sheets say: the standstill fixes them in any case.
    """
    grade, currents = robot.imu_grade or load_grade("consumer"), robot.currents
    bias, rate_bias = grade.accel_bias, grade.gyro_bias
    weight = grade.accel_scale * GRAVITY  # what an error of the gain makes of it
    accel_z = 1.0 if observation.gravity_removed else THREE_SIGMA * bias + weight
    table = {
        "accel_x": [
            Slack("tilt", SENSOR_STD["tilt"], True),
            Slack("accel_x offset", 2 * bias),
            Slack("accel_x gain", grade.accel_scale, True),
        ],
        "accel_z": [Slack("accel_z offset", accel_z)],
        "pitch_rate": [Slack("pitch_rate offset", THREE_SIGMA * rate_bias)],
        "wheel": [
            Slack("wheel offset", SENSOR_STD["wheel offset"]),
            Slack("wheel gain", SENSOR_STD["wheel gain"], True),
        ],
        "wheel_split": [
            Slack("wheel_split offset", SENSOR_STD["wheel offset"]),
            Slack("wheel_split gain", SENSOR_STD["wheel_split gain"], True),
        ],
    } | {
        f"current_{motor}": [
            Slack(f"current_{motor} offset", 2 * currents.offset),
            Slack(f"current_{motor} gain", currents.gain, True),
        ]
        for motor in MOTORS
    }
    return tuple(slack for c in observation.streams for slack in table[c])
