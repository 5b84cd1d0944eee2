"""A trial on its way to the filter: its sensors put right, where it stands, and how much drifts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from granite_lab.estimation.error_model import Noise, SlipModel
from granite_lab.estimation.reference import PAUSE, Readings
from granite_lab.estimation.wheels import Rolling, nearest
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.faults import Faults
from granite_lab.logs.sensors.mounting import BodyImu
from granite_lab.logs.sensors.standstill import MOVING, Interval, inside
from granite_lab.logs.trial import Array, ImuStream, WheelStream, part
from granite_lab.parameters import Robot

COMPLIANCE = 0.005
"""Std of the displacement between wheels and body by thrust over mass [s^2], which is the reciprocal of the
square of a natural frequency: a robot that rings at 2 Hz on its tyres, gears and mounts."""

LOOSE = 1.0e-4
"""The displacement follows thrust roughly only. It also walks by as much, and at least by this [s^2]: the
compliance of a robot that rings at 16 Hz."""

OPEN = 1.0
"""A log that moves for longer than this before its first standstill or after its last one has no standstill
there [s]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensors:
    """The sensors of a trial put right, each on its own clock.

    Attributes:
        name: of the trial.
        stream, imu: samples of the IMU without spikes, in its own axes and in those of the robot.
        wheels, rolling: the encoders as corrected and what the wheels roll; None without encoders.
        robot: its parameters, with what the standstills say of the mounting.
        faults: gaps, plateaus and restarts of the IMU, over which the noise grows.
        stamp_std: std of a delay between the sensors' stamps, where samples shared them [s].
        doubts: what was corrected, or is doubtful.
    """

    name: str
    stream: ImuStream
    imu: BodyImu
    wheels: WheelStream | None
    rolling: Rolling | None
    robot: Robot
    faults: Faults
    stamp_std: float = 0.0
    doubts: tuple[Doubt, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem(Sensors):
    """A trial ready for the filter.

    Attributes:
        rests: standstills [s, the IMU's clock].
        offset: of the encoders' clock, by which the standstills were found [s].
        unseen: (N,) std of the velocity that a standstill may begin with, at its first sample [m/s].
        coasts: the log ends while the wheels coast to rest.
        spins: wheels may turn in a standstill.
        far: the robot moves, or may have moved, for longer than integration lasts.
        noise, slip: what drifts, and how much.
        jumps: (N,) square of the slip velocity's jumps per second, at the IMU's stamps [m^2/s^3].
        compliance: by which the displacement between wheels and body walks as thrust changes [s^2].
        soft: std of the compliance itself [s^2].
        variance_factors: factors on the variance of kinds of measurements.
        spacing: of the nodes in motion [s]; 0: a node at each stamp.
        reference: what an external reference measured.
    """

    rests: tuple[Interval, ...]
    offset: float = 0.0
    unseen: Array
    coasts: bool = False
    spins: bool = True
    far: bool = False
    noise: Noise
    slip: SlipModel = field(default_factory=SlipModel)
    jumps: Array | None = None
    compliance: float = LOOSE
    soft: float = COMPLIANCE
    variance_factors: Mapping[str, float] = field(default_factory=dict)
    spacing: float = 0.0
    reference: tuple[Readings, ...] = ()

    @property
    def anchored(self) -> bool:
        """Whether reference and standstills together tell the velocity all along."""
        stamps = np.sort(np.concatenate([np.empty(0), *(readings.t for readings in self.reference)]))
        if not stamps.size:
            return False
        grid = np.arange(self.imu.t[0], self.imu.t[-1], 0.5 * PAUSE)
        near = np.abs(stamps[nearest(stamps, grid)] - grid) <= PAUSE
        return bool((near | inside(grid, self.rests)).all())

    @property
    def open_ends(self) -> tuple[str, ...]:
        """Return "start" and "end" of the log where it moves, and nothing else tells the velocity."""
        t, rests = self.imu.t, self.rests
        if not rests or self.anchored:
            return ()
        before, after = (t[0], rests[0][0]), (rests[-1][1], t[-1])
        opens = self._moves(*before), self._moves(*after) and not self.coasts
        return tuple(side for side, is_open in zip(("start", "end"), opens, strict=True) if is_open)

    def _moves(self, begin: float, end: float) -> bool:
        """Whether the robot moves between two instants on the IMU's clock [s]: standing wheels say no."""
        if self.rolling is None:
            return end - begin > OPEN
        stamps = self.rolling.t + self.offset
        at = (stamps >= begin) & (stamps <= end)
        return end - begin > OPEN and bool((np.abs(np.nan_to_num(self.rolling.speed[at])) > MOVING).any())

    def cut(self, begin: float, end: float, offset: float) -> Problem:
        """Return a part of it, from `begin` to `end` on the IMU's clock [s]."""
        rolling, keep = self.rolling, (self.imu.t >= begin) & (self.imu.t <= end)
        if rolling is not None:
            stamps = rolling.t + offset
            rolling = part(rolling, (stamps >= begin - 0.5) & (stamps <= end + 0.5))
        rests = tuple((max(a, begin), min(b, end)) for a, b in self.rests if b > begin and a < end)
        imu, faults = part(self.imu, keep), part(self.faults, keep)
        return replace(part(self, keep), imu=imu, rolling=rolling, rests=rests, faults=faults, coasts=False)
