"""What differs from trial to trial without being a missing effect: sand, start, offsets, gains.

Each is a number with a prior around zero. The sand enters through simulations; start, offsets and
gains are applied to a finished simulation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granite_lab.discovery.bench import ACCURACY, PER_TRIAL, SAND
from granite_lab.discovery.observation import Observation
from granite_lab.logs.trial import Array
from granite_lab.model.instants import instants
from granite_lab.parameters import Robot

RAKING = (0.04, 0.06, 0.06)
"""Std of the logarithm of a_θ, k_φ and c from one raking to the next: several percent, an assumption."""

UNKNOWN_SAND = (0.20, 0.20, 0.20, 0.20, 0.12, 0.12, 0.20)
"""Std of the logarithm of each of `SAND`, common to all trials, off the file: 5-20 percent happen."""

SHIFT_STD = 0.02
"""Std of the start of the command about its first estimate [s]."""

_SHIFT_STEP = 1e-3


@dataclass(frozen=True)
class Slack:
    """One number per trial that is applied to a finished simulation.

    Attributes:
        name: for people.
        std: of its prior, in its unit.
        unit: of the number.
    """

    name: str
    std: float
    unit: str


class TrialModel:
    """How one trial depends on its own numbers.

    A trial's numbers x are: the first `PER_TRIAL` of `SAND` (about the common sand), the shift of
    the start [s], then the slacks.
    """

    def __init__(self, observation: Observation, variant: int, robot: Robot) -> None:
        self.observation, self.variant = observation, variant
        self.channels = tuple(observation.streams)
        self.slacks = _slacks(observation, robot)
        self._place = {s.name: PER_TRIAL + 1 + k for k, s in enumerate(self.slacks)}
        self.prior = np.array([*RAKING, SHIFT_STD, *(s.std for s in self.slacks)])
        self.names = (*SAND[:PER_TRIAL], "start", *(s.name for s in self.slacks))
        self._t = instants(observation.variant, ACCURACY)
        self.measured = np.stack([observation.values[c] for c in self.channels])

    @property
    def size(self) -> int:
        """How many numbers the trial has."""
        return self.prior.size

    def bins_of(self, response: Array, shift: float) -> dict[str, Array]:
        """Return channel to the (n,) bins of a (7, M) response, or the (k, n) bins of (k, 7, M) responses."""
        return self.observation.binned(self._t, response, shift)

    def predict(self, response: Array, x: Array) -> Array:
        """Return the (C, n) bins that the trial should show."""
        b = self.bins_of(response, float(x[PER_TRIAL]))
        out = dict(b)
        if "accel_x" in b:
            tilt = self._of(x, "tilt")
            out["accel_x"] = (1 + self._of(x, "accel_x gain")) * (b["accel_x"] - tilt * b["accel_z"])
            out["accel_z"] = b["accel_z"] + tilt * b["accel_x"]
        for c in ("wheel", "wheel_split"):
            if c in b:
                out[c] = (1 + self._of(x, "wheel gain")) * b[c]
        for c in ("current_f", "current_r"):
            if c in b:
                out[c] = (1 + self._of(x, f"{c} gain")) * b[c]
        return np.stack([out[c] + self._of(x, f"{c} offset") for c in self.channels])

    def by_start(self, response: Array) -> Array:
        """Return the (7, M) derivative of a response by a later start of the command."""
        sooner, later = (
            np.stack([np.interp(self._t + s * _SHIFT_STEP, self._t, signal) for signal in response])
            for s in (1, -1)
        )
        return np.asarray((later - sooner) / (2 * _SHIFT_STEP))

    def columns(self, response: Array, slopes: Array, x: Array) -> Array:
        """Return the (C n, p) derivatives of `predict` by the trial's numbers.

        Args:
            response: (7, M) near the trial's own.
            slopes: (PER_TRIAL + 1, 7, M) derivatives of the response by the sand and by the start.
            x: the trial's numbers.
        """
        bins = self.bins_of(np.concatenate([response[None], slopes]), float(x[PER_TRIAL]))
        b, *columns = ({c: bins[c][k] for c in self.channels} for k in range(1 + len(slopes)))
        zero = {c: np.zeros(self.observation.bins) for c in self.channels}
        for slack in self.slacks:
            own = dict(zero)
            channel, _, kind = slack.name.partition(" ")
            if slack.name == "tilt":
                own |= {"accel_x": -b["accel_z"], "accel_z": b["accel_x"]}
            elif kind == "offset":
                own[channel] = np.ones(self.observation.bins)
            else:  # a gain
                own |= {c: b[c] for c in (channel, "wheel_split") if c in b and c.startswith(channel)}
            columns.append(own)
        return np.stack([np.concatenate([own[c] for c in self.channels]) for own in columns], axis=1)

    def effect_columns(self, changes: Array, x: Array) -> Array:
        """Return the (C n, k) bins of k changes of the response, (k, 7, M)."""
        b = self.bins_of(changes, float(x[PER_TRIAL]))
        return np.concatenate([b[c].T for c in self.channels])

    def _of(self, x: Array, name: str) -> float:
        return float(x[self._place[name]]) if name in self._place else 0.0


def _slacks(observation: Observation, robot: Robot) -> tuple[Slack, ...]:
    """List the slacks of the channels that were logged.

    Offsets are wider than the sensors' data sheets say: the standstill fixes them in any case.
    """
    grade, currents = robot.imu_grade, robot.currents
    bias, rate_bias = (grade.accel_bias, grade.gyro_bias) if grade else (0.2, 0.01)
    table = {
        "accel_x": [
            Slack("tilt", np.radians(robot.imu.tilt), "rad"),
            Slack("accel_x offset", 2 * bias, "m/s^2"),
            Slack("accel_x gain", 0.002, ""),
        ],
        "accel_z": [Slack("accel_z offset", 3 * bias + 0.05, "m/s^2")],
        "pitch_rate": [Slack("pitch_rate offset", 3 * rate_bias, "rad/s")],
        "wheel": [Slack("wheel offset", 0.02, "rad"), Slack("wheel gain", 5e-4, "")],
        "wheel_split": [Slack("wheel_split offset", 0.02, "rad")],
    } | {
        f"current_{axle}": [
            Slack(f"current_{axle} offset", 2 * currents.offset, "A"),
            Slack(f"current_{axle} gain", currents.gain / np.sqrt(2), ""),
        ]
        for axle in "fr"
    }
    if observation.gravity_removed:
        table["accel_z"] = [Slack("accel_z offset", 1.0, "m/s^2")]
    return tuple(slack for c in observation.streams for slack in table[c])
