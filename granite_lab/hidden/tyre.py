"""Influences of the tyres and wheels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granite_lab.hidden.contact import V_FLOOR, Array, Contact, Stance, smoothstep
from granite_lab.hidden.influence import Influence, Size, amplitudes, pairs
from granite_lab.hidden.model import ANGLE, OMEGA
from granite_lab.parameters import GRAVITY


class TyreWindup(Influence):
    """A tread ring of its own inertia, held to the rim by rubber that relaxes (Zener)."""

    id = "tyre_windup"
    title = "torsion of the tyre between rim and tread"
    account = (
        "rigid ring (Zegelaar 1998) on a standard linear solid, as rubber is modelled by Berg (Vehicle "
        "System Dynamics 30, 1998, 197-212) without its friction: a spring of 1/compliance beside another as "
        "stiff in series with a damper, so that fast twists meet twice the stiffness; slow ones are damped "
        "by retardation/compliance; a fifth of the wheel's inertia sits in the tread"
    )
    declared = (
        # trials show twists faster than rubber relaxes: there it is as stiff as both springs
        Size("compliance", "rad/(N m)", "twist of a tyre per lasting torque", 1e-3, 3e-3, 0, 0.02,
             kind="equivalent"),
        Size("retardation", "s", "damping over stiffness", 0.005, 0.03, 5e-4, 0.2, kind="shape"),
    )  # fmt: skip

    def setup(self) -> None:
        """Claim twist, rate of the tread and twist of the second spring."""
        super().setup()
        sizes = self.sizes[TyreWindup.id]
        self.stiffness = 1 / max(sizes["compliance"], 1e-7)
        self.relaxation = sizes["retardation"]
        self.ring_inertia = 0.2 * self.chassis.wheel_inertia
        self.rim_inertia -= self.ring_inertia
        self.twist, self.tread_rate, self.second = self.claim(2), self.claim(2), self.claim(2)

    def spring(self, y: Array) -> Array:
        """Return the torque that the rim passes to the tread [N m]."""
        return np.asarray(self.stiffness * (y[self.twist] + y[self.second]))

    def stance(self, t: float, y: Array) -> Stance:
        """Let the tread meet the ground, not the rim."""
        at = super().stance(t, y)
        return replace(at, v_o=at.v_o + (self.rolling * (y[self.tread_rate] - y[OMEGA]).T).T)

    def load(self, y: Array, wheel: Contact) -> Array:
        """Load the rim with the springs."""
        return super().load(y, wheel) - wheel.M - self.spring(y)

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Add the rates of both twists and of the tread."""
        dy = super().rates(t, y, wheel)
        dy[self.twist] = y[OMEGA] - y[self.tread_rate]
        dy[self.tread_rate] = (self.spring(y) + wheel.M) / self.ring_inertia
        dy[self.second] = dy[self.twist] - y[self.second] / self.relaxation
        return dy


class RadialTyreCompliance(Influence):
    """A tyre pressed flat below: it meets the soil as a rigid wheel of larger radius would."""

    id = "radial_tyre_compliance"
    title = "tyre that deflects under its load"
    account = (
        "substitute circle (Schmid, Journal of Terramechanics 32, 1995, 3-26), here of the leading half: "
        "radius r (1 + δ/z), on which the front contact is as long as under the flattened tyre; deflection "
        "δ = W compliance reached in 5 ms; rolling radius of the chord, r sin α / α with cos α = 1 − δ/r"
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
        """Take the deflection off the sinkage, enlarge the circle and shorten the rolling radius."""
        at, given = super().stance(t, y), np.maximum(y[self.pressed], 0.0)
        z0 = at.z0 - given
        radius = (self.r if at.radius is None else at.radius) * (1 + given / np.maximum(z0, 1e-3))
        chord = np.arccos(1 - np.minimum(given / self.r, 1.0))
        return replace(at, z0=z0, v_o=at.v_o * np.sinc(chord / np.pi), radius=radius)

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Let the deflection follow the load."""
        dy = super().rates(t, y, wheel)
        wanted = self.sizes[RadialTyreCompliance.id]["compliance"] * wheel.W
        dy[self.pressed] = (wanted - y[self.pressed]) / 0.005
        return dy


class UnequalWheels(Influence):
    """Tyres that are worn, or pumped up, otherwise in front than behind; the mean is that of the file."""

    id = "unequal_wheels"
    title = "front and rear wheels of different radius"
    account = "radius, height of the axle and lever of the tangential force of each axle by its own radius"
    declared = (Size("difference", "-", "front less rear radius, over r", 0.01, 0.04, -0.2, 0.2, True),)

    def larger(self, y: Array) -> Array:
        """Return how much larger the radius of front and rear wheels is, over r, as y[OMEGA]."""
        half = 0.5 * self.sizes[UnequalWheels.id]["difference"]
        return np.stack([np.full(y.shape[1:], half), np.full(y.shape[1:], -half)])

    def stance(self, t: float, y: Array) -> Stance:
        """Change radius and sinkage."""
        at, more = super().stance(t, y), self.r * self.larger(y)
        radius = (self.r if at.radius is None else at.radius) + more
        return replace(at, z0=at.z0 + more, v_o=at.v_o + more * y[OMEGA], radius=radius)

    def contact(self, t: float, y: Array) -> Contact:
        """Lengthen the lever of the tangential force, which the formula takes to be r."""
        wheel = super().contact(t, y)
        return replace(wheel, M=wheel.M * (1 + self.larger(y)))


class WheelEccentricity(Influence):
    """Wheels out of round: the radius at the lowest point changes as the wheel turns."""

    id = "wheel_eccentricity"
    title = "wheels that run out of true"
    account = (
        "radius r + ρ(θ) with a first harmonic and a quarter of it in the second, as run-out of tyres is "
        "measured (Dixon, Tires, Suspension and Handling, 2nd ed., SAE 1996, non-uniformity), with the "
        "moments that conserve energy"
    )
    declared = amplitudes("m", "run-out", 4e-4, 1.2e-3, 0.01)

    def run_out(self, y: Array) -> tuple[Array, Array]:
        """Return how much longer the radius at the lowest point is [m], and its derivative by the angle."""
        cos, sin = pairs(self.sizes[WheelEccentricity.id])
        size, turned = np.hypot(cos, sin), y[ANGLE].T - np.arctan2(sin, cos)
        return (
            np.asarray(-size * (np.cos(turned) + 0.25 * np.cos(2 * turned))).T,
            np.asarray(size * (np.sin(turned) + 0.5 * np.sin(2 * turned))).T,
        )

    def stance(self, t: float, y: Array) -> Stance:
        """Lengthen the radius."""
        at, (longer, slope) = super().stance(t, y), self.run_out(y)
        rate = y[OMEGA]
        return replace(at, z0=at.z0 + longer, dz0=at.dz0 + rate * slope, v_o=at.v_o + rate * longer)

    def load(self, y: Array, wheel: Contact) -> Array:
        """Add the moment about the axle; at rest the gear's own friction holds it."""
        longer, slope = self.run_out(y)
        turning = smoothstep(np.abs(y[OMEGA]) * self.r / V_FLOOR)
        return super().load(y, wheel) - turning * (longer * (wheel.F + wheel.R) + slope * wheel.normal)
