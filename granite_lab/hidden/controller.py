"""Controllers of the wheels other than (25), (26), whose gains no file states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from granite_lab.hidden.contact import Array, Contact
from granite_lab.hidden.model import CURRENT, Truth
from granite_lab.hidden.parts import CompleteRobot
from granite_lab.hidden.random_numbers import magnitude
from granite_lab.parameters import GRAVITY

BANDWIDTH = 2.0, 10.0
"""Motor controllers of mobile robots close their speed loop at so many Hz; an assumption."""

STRENGTH = 0.35, 0.8
"""Torque at the limit of the current, over that with which a wheel pulls its share of the weight: a robot
that pulls less than a third of its weight does not cross sand, and rubber on sand holds 0.6 of it."""

CURRENT_LOOP = 0.003
"""Time constant of a current loop [s]: amplifiers of this size state 0.3 to 2.5 kHz; slow ones are slower."""


class Controller(Truth):
    """The truth under another controller; `gains` are those of `Setup`."""

    id: ClassVar[str]

    @classmethod
    def drawn(cls, rng: np.random.Generator, robot: CompleteRobot) -> dict[str, float]:
        """Draw the gains for a robot."""
        raise NotImplementedError

    def error(self, t: float, y: Array) -> Array:
        """Return by how much the wheels are too slow, as the encoders read them [rad/s]."""
        return np.asarray(self.demand(t)[1] / self.r - self.reading(y)[1])

    def bounded(self, voltage: Array, least: float) -> Array:
        """Return what the bridge can give, `least` [V] or more."""
        return np.asarray(np.minimum(np.maximum(voltage, least), self.drive.voltage_max))


class Integrating(Controller):
    """A proportional and integral gain on the speed, the integral held back while a limit acts."""

    def setup(self) -> None:
        """Claim the integrals, in the unit of `wanted`."""
        super().setup()
        self.summed = self.claim(2)

    def wanted(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return what the gains ask for, before and after the limits."""
        raise NotImplementedError

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Add the rates of the integrals."""
        dy = super().rates(t, y, wheel)
        wanted, given = self.wanted(t, y)
        dy[self.summed] = self.gains["i"] * (self.error(t, y) + (given - wanted) / self.gains["p"])
        return dy


def _per_wheel(robot: CompleteRobot) -> tuple[float, float, float]:
    """Return inertia on one motor [kg m^2], torque of a wheel per current [N m/A], EMF per rate [V s/rad]."""
    ch, d, r = robot.chassis, robot.drive, robot.wheels.radius
    inertia = ch.wheel_inertia + ch.total_mass * r**2 / 4
    return inertia, d.gear_efficiency * d.gear_ratio * d.torque_constant, d.emf_constant * d.gear_ratio


def _limit(rng: np.random.Generator, robot: CompleteRobot) -> float:
    """Draw the largest current [A]."""
    pulls = robot.chassis.total_mass * GRAVITY / 4 * robot.wheels.radius
    return float(rng.uniform(*STRENGTH)) * pulls / _per_wheel(robot)[1]


class OtherGains(Controller):
    """(26) with 0.15 to 0.5 times the gains of the file, their ratio off by up to 1.4."""

    id = "other_gains"

    @classmethod
    def drawn(cls, rng: np.random.Generator, robot: CompleteRobot) -> dict[str, float]:
        """Draw the factors on both gains."""
        del robot
        both = magnitude(rng, 0.15, 0.5)
        return {"p": both, "d": both * magnitude(rng, 1 / 1.4, 1.4)}

    def voltage(self, t: float, y: Array) -> Array:
        """Return the motor voltages [V]."""
        d, (angle, rate), (s_d, v_d) = self.drive, self.reading(y), self.demand(t)
        p, derivative = self.gains["p"] * d.gain_p, self.gains["d"] * d.gain_d
        wanted = p * (s_d / self.r - angle) + derivative * (v_d / self.r - rate)
        return self.bounded(wanted, d.voltage_min)


class FeedForward(Controller):
    """A voltage for the speed, and a weak correction: the wheels fall behind under load.

    u = share · EMF at the desired speed + a proportional gain on the error of the speed.
    """

    id = "feed_forward"

    @classmethod
    def drawn(cls, rng: np.random.Generator, robot: CompleteRobot) -> dict[str, float]:
        """Draw the share of the EMF, and the gain [V s/rad]."""
        emf = _per_wheel(robot)[2]
        return {"share": float(rng.uniform(0.9, 1.0)), "p": emf * magnitude(rng, 0.5, 4.0)}

    def voltage(self, t: float, y: Array) -> Array:
        """Return the motor voltages [V]."""
        ahead = self.gains["share"] * self.emf * self.demand(t)[1] / self.r
        return self.bounded(ahead + self.gains["p"] * self.error(t, y), self.drive.voltage_min)


class Limited(Integrating):
    """Proportional and integral on the speed; voltage and current are limited.

    u = k_P e + k_I ∫ e dt within the bridge's voltage and R_d i_max about the EMF, the integral held back
    while that limits (Åström and Hägglund, PID Controllers, 2nd ed., ISA 1995, ch. 3).
    """

    id = "limited"

    @classmethod
    def drawn(cls, rng: np.random.Generator, robot: CompleteRobot) -> dict[str, float]:
        """Draw the gains for a bandwidth, and the largest current."""
        inertia, torque, emf = _per_wheel(robot)
        w = 2 * np.pi * magnitude(rng, *BANDWIDTH)
        lag = inertia * robot.drive.resistance / (torque * emf)  # of the speed behind the voltage [s]
        return {"p": emf * w * lag, "i": emf * w, "current": _limit(rng, robot)}

    def wanted(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return the voltages before and after their limits [V]."""
        wanted = self.gains["p"] * self.error(t, y) + y[self.summed]
        back, most = self.emf * self.shaft(y)[1], self.drive.resistance * self.gains["current"]
        limited = np.minimum(np.maximum(wanted, back - most), back + most)
        return wanted, self.bounded(limited, self.drive.voltage_min)

    def voltage(self, t: float, y: Array) -> Array:
        """Return the motor voltages [V]."""
        return self.wanted(t, y)[1]


class Cascade(Integrating):
    """A speed loop that asks a current loop for a limited current.

    i_d = k_P e + k_I ∫ e dt within ± i_max; a current loop of 3 ms with the EMF fed forward, bridges that
    brake (Leonhard, Control of Electrical Drives, 3rd ed., Springer 2001, ch. 7).
    """

    id = "cascade"

    @classmethod
    def drawn(cls, rng: np.random.Generator, robot: CompleteRobot) -> dict[str, float]:
        """Draw the gains for a bandwidth, and the largest current."""
        inertia, torque, _ = _per_wheel(robot)
        w = 2 * np.pi * magnitude(rng, *BANDWIDTH)
        p = w * inertia / torque
        return {"p": p, "i": p * w / 4, "current": _limit(rng, robot)}

    def wanted(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return the currents that the speed loop asks for, before and after their limit [A]."""
        wanted, most = self.gains["p"] * self.error(t, y) + y[self.summed], self.gains["current"]
        return np.asarray(wanted), np.minimum(np.maximum(wanted, -most), most)

    def voltage(self, t: float, y: Array) -> Array:
        """Return the motor voltages [V]."""
        d, (_, asked) = self.drive, self.wanted(t, y)
        wanted = self.emf * self.shaft(y)[1] + d.resistance * asked
        wanted = wanted + d.inductance / CURRENT_LOOP * (asked - y[CURRENT])
        return self.bounded(wanted, -d.voltage_max)


CONTROLLERS: Mapping[str, type[Controller]] = {
    kind.id: kind for kind in (OtherGains, FeedForward, Limited, Cascade)
}
"""Controllers of which "unknown" draws one, by id."""
