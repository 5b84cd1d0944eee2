"""Influences of the tyres and wheels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from granite_lab.hidden.contact import V_FLOOR, Array, Contact, smoothstep
from granite_lab.hidden.influence import Influence, Size, pairs, with_phase
from granite_lab.hidden.model import ANGLE, OMEGA
from granite_lab.hidden.parts import Stance
from granite_lab.parameters import GRAVITY


class TyreWindup(Influence):
    """A tread ring of its own inertia, held to the rim by a torsional spring and damper."""

    id = "tyre_windup"
    title = "torsion of the tyre between rim and tread"
    account = (
        "rigid ring (Zegelaar 1998): a fifth of the wheel's inertia sits in the tread; stiffness "
        "1/compliance, damping retardation/compliance"
    )
    declared = (
        Size("compliance", "rad/(N m)", "twist of a tyre per torque", 1e-3, 3e-3, 0, 0.02),
        Size("retardation", "s", "damping over stiffness", 0.005, 0.03, 5e-4, 0.2, kind="shape"),
    )

    def setup(self) -> None:
        """Claim twist and rate of the tread."""
        super().setup()
        sizes = self.sizes[TyreWindup.id]
        self.stiffness = 1 / max(sizes["compliance"], 1e-7)
        self.damping = self.stiffness * sizes["retardation"]
        self.ring_inertia = 0.2 * self.chassis.wheel_inertia
        self.rim_inertia -= self.ring_inertia
        self.twist, self.tread_rate = self.claim(2), self.claim(2)

    def spring(self, y: Array) -> Array:
        """Return the torque that the rim passes to the tread [N m]."""
        return np.asarray(self.stiffness * y[self.twist] + self.damping * (y[OMEGA] - y[self.tread_rate]))

    def stance(self, t: float, y: Array) -> Stance:
        """Let the tread meet the ground, not the rim."""
        at = super().stance(t, y)
        return replace(at, v_o=at.v_o + self.r * (y[self.tread_rate] - y[OMEGA]))

    def load(self, y: Array, wheel: Contact) -> Array:
        """Load the rim with the spring."""
        return super().load(y, wheel) - wheel.M - self.spring(y)

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Add the rates of twist and tread."""
        dy = super().rates(t, y, wheel)
        dy[self.twist] = y[OMEGA] - y[self.tread_rate]
        dy[self.tread_rate] = (self.spring(y) + wheel.M) / self.ring_inertia
        return dy


class RadialTyreCompliance(Influence):
    """A tyre pressed flat below: in series with the soil, its outline cut off level."""

    id = "radial_tyre_compliance"
    title = "tyre that deflects under its load"
    account = (
        "flat part under the tyre (Karafiath and Nowatzki 1978): deflection W compliance, reached in "
        "5 ms; outline of the unloaded radius cut level, rolling radius r − δ/3"
    )
    declared = (Size("compliance", "m/N", "deflection per load", 1.5e-5, 3.5e-5, 0, 1e-4, kind="equivalent"),)

    def setup(self) -> None:
        """Claim the deflections."""
        super().setup()
        self.pressed = self.claim(2)

    def at_rest(self) -> Array:
        """Return the state with the deflections under the static loads."""
        y, (fore, aft) = super().at_rest(), self.arm_x
        load = self.mass * GRAVITY / 2 * np.array([-aft, fore]) / (fore - aft)
        y[self.pressed] = self.sizes[RadialTyreCompliance.id]["compliance"] * load
        return y

    def stance(self, t: float, y: Array) -> Stance:
        """Take the deflection off the sinkage and a third of it off the rolling radius."""
        at, flat = super().stance(t, y), np.maximum(y[self.pressed], 0.0)
        return replace(at, z0=at.z0 - flat, v_o=at.v_o * (1 - flat / (3 * self.r)), flat=flat)

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Let the deflection follow the load."""
        dy = super().rates(t, y, wheel)
        wanted = self.sizes[RadialTyreCompliance.id]["compliance"] * wheel.W
        dy[self.pressed] = (wanted - y[self.pressed]) / 0.005
        return dy


class WheelEccentricity(Influence):
    """Wheels whose geometric centre circles about the axle."""

    id = "wheel_eccentricity"
    title = "wheels that run out of true"
    account = "kinematics of a circle about a point off its centre, with the moment of the ground's force"
    declared = (
        Size("amplitude_front", "m", "run-out, front", 4e-4, 1.2e-3, 0, 0.01, kind="amplitude"),
        Size("amplitude_rear", "m", "run-out, rear", 4e-4, 1.2e-3, 0, 0.01, kind="amplitude"),
    )

    @classmethod
    def of_trial(cls, sizes: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Draw the phases: a trial begins with the wheels as they stand."""
        return with_phase(sizes, rng)

    def offset(self, y: Array) -> tuple[Array, Array]:
        """Return the centre of the wheel from the axle, along x and z [m]."""
        (cos, sin), angle = pairs(self.sizes[WheelEccentricity.id]), y[ANGLE]
        return (
            np.asarray(cos * np.sin(angle) - sin * np.cos(angle)),
            np.asarray(cos * np.cos(angle) + sin * np.sin(angle)),
        )

    def stance(self, t: float, y: Array) -> Stance:
        """Move the centre."""
        at, (e_x, e_z) = super().stance(t, y), self.offset(y)
        return replace(at, z0=at.z0 - e_z, dz0=at.dz0 + y[OMEGA] * e_x, v=at.v + y[OMEGA] * e_z)

    def load(self, y: Array, wheel: Contact) -> Array:
        """Add the moment about the axle; at rest the gear's own friction holds it."""
        e_x, e_z = self.offset(y)
        turning = smoothstep(np.abs(y[OMEGA]) * self.r / V_FLOOR)
        return super().load(y, wheel) + turning * (e_z * (wheel.F + wheel.R) - e_x * wheel.normal)
