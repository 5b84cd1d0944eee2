"""Influences of gears, motors, their supply and encoders."""

from __future__ import annotations

import numpy as np

from granite_lab.hidden.contact import Array, Contact, smoothstep
from granite_lab.hidden.influence import Influence, Size, amplitudes, pairs
from granite_lab.hidden.model import ANGLE, CURRENT, OMEGA


class DrivetrainFriction(Influence):
    """Dry friction of bristles, which is larger before it slides, and viscous friction."""

    id = "drivetrain_friction"
    title = "Coulomb and viscous friction in the drive units"
    account = (
        "Canudas de Wit et al. (IEEE Transactions on Automatic Control 40, 1995, 419-425): bristles of "
        "3 mrad whose limit falls from 1.3 times the dry friction at rest to the dry friction by "
        "exp(−(ω/ω_s)²), ω_s of 0.3 rad/s (Stribeck)"
    )
    declared = (
        Size("coulomb", "N m", "dry friction at the wheel", 0.4, 1.2, 0, 10),
        Size("viscous", "N m s/rad", "friction per rate of the wheel", 0.02, 0.1, 0, 3),
    )

    def setup(self) -> None:
        """Claim the bristles' deflections, as shares of the sliding friction."""
        super().setup()
        self.bristles = self.claim(2)

    def torque(self, y: Array) -> Array:
        """Take the friction off."""
        sizes = self.sizes[DrivetrainFriction.id]
        return super().torque(y) - sizes["coulomb"] * y[self.bristles] - sizes["viscous"] * y[OMEGA]

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Add the rate of the bristles."""
        dy, rate = super().rates(t, y, wheel), y[OMEGA]
        limit = 1 + 0.3 * np.exp(-((rate / 0.3) ** 2))
        dy[self.bristles] = (rate - np.abs(rate) * y[self.bristles] / limit) / 0.003
        return dy


class GearBacklash(Influence):
    """Motor and wheel as two inertias that meet through stiff teeth with play."""

    id = "gear_backlash"
    title = "play in the gears"
    account = (
        "two masses and a dead zone (Nordin and Gutman 2002): three tenths of the inertia at the motor, "
        "teeth of 20 kN m/rad, stiffer where the play is less than 0.8°, so that play it remains; encoder at "
        "the motor; at rest in the middle of the play"
    )
    declared = (Size("play", "deg", "whole play at the wheel", 0.8, 2.5, 0, 20, kind="equivalent"),)

    def setup(self) -> None:
        """Claim lead of the motors on the wheels, and its rate, in half plays.

        Angles of many turns could not be subtracted closely enough for a play of a hundredth of a degree.
        """
        super().setup()
        self.method = "Radau"  # LSODA is late to see how stiff the teeth are, BDF fails at some blows
        self.half_play = max(0.5 * float(np.radians(self.sizes[GearBacklash.id]["play"])), 1e-7)
        # little play: teeth that give by a like share of it, else their twist would outdo the play
        small = max(1.0, 0.007 / self.half_play)
        self.teeth, self.rubbing, self.soft = 2e4 * small, 8.0 * small, 2e-4 / small
        self.motor_inertia = 0.3 * self.chassis.wheel_inertia
        self.rim_inertia -= self.motor_inertia
        self.lead, self.lead_rate = self.claim(2), self.claim(2)

    def shaft(self, y: Array) -> tuple[Array, Array]:
        """Return the motion of the motors."""
        return (
            np.asarray(y[ANGLE] + self.half_play * y[self.lead]),
            np.asarray(y[OMEGA] + self.half_play * y[self.lead_rate]),
        )

    def torque(self, y: Array) -> Array:
        """Return what drives the wheels: the teeth."""
        return self.passed_on(y)

    def passed_on(self, y: Array) -> Array:
        """Return what the teeth pass on: nothing within the play."""
        gap, soft = self.half_play * y[self.lead], self.soft
        bite = np.maximum(np.abs(gap) - self.half_play, 0.0)
        # the teeth engage over the first 0.2 mrad or less, which keeps force and damping free of corners
        bent = np.where(bite < soft, 0.5 * bite**2 / soft, bite - 0.5 * soft)
        rubbing = self.rubbing * smoothstep(bite / soft)
        return np.asarray(self.teeth * np.sign(gap) * bent + rubbing * self.half_play * y[self.lead_rate])

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Add the rates of the motors."""
        dy = super().rates(t, y, wheel)
        # not `self.torque`: friction at the wheel, if that is hidden as well, does not act on the motor
        motor = (super().torque(y) - self.passed_on(y)) / self.motor_inertia
        dy[self.lead] = y[self.lead_rate]
        dy[self.lead_rate] = (motor - dy[OMEGA]) / self.half_play
        return dy


class SupplySag(Influence):
    """A battery: resistance at once, and more of it as the cells polarise."""

    id = "supply_sag"
    title = "supply voltage that drops with the current"
    account = (
        "first-order Thévenin cell (Chen and Rincón-Mora, IEEE Transactions on Energy Conversion 21, 2006, "
        "504-511): 85 % of the resistance at once, 15 % over a capacitor with 1 s; ideal bridges that pass "
        "the same duty on"
    )
    declared = (Size("resistance", "ohm", "of the supply and its leads", 0.05, 0.2, 0, 2, kind="equivalent"),)

    def setup(self) -> None:
        """Claim the polarisation, as a current [A]."""
        super().setup()
        self.polarised = self.claim(1)

    def drawn(self, t: float, y: Array) -> Array:
        """Return the current of the supply [A]: four motors draw their duty's share."""
        return np.asarray(2 * (super().voltage(t, y) / self.drive.voltage_max * y[CURRENT]).sum(axis=0))

    def voltage(self, t: float, y: Array) -> Array:
        """Apply the duty to what the battery still has."""
        resistance, top = self.sizes[SupplySag.id]["resistance"], self.drive.voltage_max
        lost = resistance * (0.85 * self.drawn(t, y) + 0.15 * y[self.polarised][0])
        return np.asarray(super().voltage(t, y) * (1 - lost / top))

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Add the rate of the polarisation."""
        dy = super().rates(t, y, wheel)
        dy[self.polarised] = self.drawn(t, y) - y[self.polarised]  # over 1 s
        return dy


class TorqueConstantError(Influence):
    """A gear that passes on another share of the torque than its file says, a little more under load."""

    id = "torque_constant_error"
    title = "torque constant or gear efficiency off"
    account = (
        "(24) with another efficiency, which rises with the load as that of gears does (Niemann and "
        "Winter, Maschinenelemente 2, Springer 2003): η_d (1 + error (0.8 + 0.4 |i| / (|i| + 4 A)))"
    )
    declared = (
        Size("error", "-", "relative error of k_m η_d at 4 A", 0.05, 0.12, -0.5, 0.25, signed=True,
             kind="equivalent"),
    )  # fmt: skip

    def torque(self, y: Array) -> Array:
        """Change the efficiency."""
        load = np.abs(y[CURRENT])
        off = self.sizes[TorqueConstantError.id]["error"] * (0.8 + 0.4 * load / (load + 4.0))
        return super().torque(y) * (1 + off)


class EncoderEccentricity(Influence):
    """Encoder discs off their centre: the reading runs ahead and behind once a revolution."""

    id = "encoder_eccentricity"
    title = "encoders that run out of true"
    account = (
        "a head at the radius R reads a disc off its shaft by εR: error atan(ε sin ψ / (1 + ε cos ψ)), which "
        "the controller follows"
    )
    declared = amplitudes("rad", "error of the angle", 0.01, 0.03, 0.3)

    def reading(self, y: Array) -> tuple[Array, Array]:
        """Return the reading, which begins at zero."""
        angle, rate = (part.T for part in super().reading(y))
        (cos, sin), turned = pairs(self.sizes[EncoderEccentricity.id]), y[ANGLE].T
        across = cos * np.sin(turned) + sin * np.cos(turned)  # ε sin ψ and 1 + ε cos ψ
        along = 1 + cos * np.cos(turned) - sin * np.sin(turned)
        error = np.arctan2(across, along) - np.arctan2(sin, 1 + cos)
        gain = (along - 1 + cos**2 + sin**2) / (along**2 + across**2)
        return np.asarray((angle + error).T), np.asarray((rate + gain * y[OMEGA].T).T)
