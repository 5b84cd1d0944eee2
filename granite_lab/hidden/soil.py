"""Influences of the soil. Where the literature has rivals, the form here is not the library's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granite_lab.hidden.contact import V_FLOOR, Array, Contact, Ground, Stance, slip_ratio, smoothstep
from granite_lab.hidden.influence import Influence, Size, amplitudes, pairs
from granite_lab.hidden.model import ANGLE

UNIT_WEIGHT = 1600 * 9.81
"""Of dry sand [N/m^3]."""


class Bulldozing(Influence):
    """Soil pushed ahead, as a wedge in front of a wheel that leans over it."""

    id = "bulldozing"
    title = "soil pushed ahead of the wheels"
    account = (
        "Bekker (1960): b sin(α + φ) / (2 sin α cos φ) (2 z c K_c + γ z² K_γ), α = acos(1 − 2 z/D), "
        "bearing factors after Vesić; scaled to the passive pressure of a vertical wall at 16 mm"
    )
    declared = (Size("strength", "-", "multiple of the passive pressure", 0.3, 0.8, 0, 8, kind="equivalent"),)

    def setup(self) -> None:
        """Work out the bearing factors and the scale."""
        super().setup()
        g, tan = self.ground, self.ground.tan_phi
        self.phi = float(np.arctan(tan))
        passive = np.tan(np.pi / 4 + self.phi / 2) ** 2
        n_q = np.exp(np.pi * tan) * passive
        self.k_cohesion = float(((n_q - 1) / tan - tan) * np.cos(self.phi) ** 2)
        self.k_weight = float((4 * (n_q + 1) + 1) * np.cos(self.phi) ** 2)
        z = 0.016
        wall = g.b * (2 * g.c * np.sqrt(passive) * z + UNIT_WEIGHT * passive * z**2 / 2)
        self.wedge_scale = self.sizes[Bulldozing.id]["strength"] * wall / self.wedge(np.array([z]))[0]

    def wedge(self, z: Array) -> Array:
        """Return Bekker's resistance of a wheel [N] at sinkage z [m]."""
        g, z = self.ground, np.clip(z, 1e-6, self.r)
        lean = np.arccos(1 - z / self.r)
        shape = np.sin(lean + self.phi) / (2 * np.sin(lean) * np.cos(self.phi))
        return np.asarray(g.b * shape * (2 * z * g.c * self.k_cohesion + UNIT_WEIGHT * z**2 * self.k_weight))

    def contact(self, t: float, y: Array) -> Contact:
        """Add the wedge's resistance, against the motion."""
        wheel = super().contact(t, y)
        v = self.velocity(y)
        against = self.wedge_scale * self.wedge(wheel.sinkage) * (wheel.sinkage > 0)
        return replace(wheel, R=wheel.R - np.sign(v) * self.fade(y) * against)


class SlipSinkage(Influence):
    """Sinkage multiplied by a function of slip."""

    id = "slip_sinkage"
    title = "sinkage that grows with slip"
    account = (
        "Lyasko (2010): sinkage times K_ss = (1 + λ)/(1 − 0.5 λ), here as pressure divided by a power "
        "of K_ss that agrees at small slip with n0 + n1 λ at 10 mm"
    )
    declared = (Size("growth", "-", "growth of the exponent per slip", 0.2, 0.6, -0.5, 3, kind="equivalent"),)

    def soil(self, t: float, y: Array, at: Stance) -> Ground:
        """Soften the soil under a slipping wheel."""
        g = super().soil(t, y, at)
        slip = np.minimum(np.abs(slip_ratio(at.v_o, at.v, self.near_rest)), 0.95)
        power = self.sizes[SlipSinkage.id]["growth"] * np.log(1 / 0.010) / 1.5
        softer = ((1 + slip) / (1 - 0.5 * slip)) ** -power
        return replace(g, k_c=g.k_c * softer, k_phi=g.k_phi * softer)


class MultiPass(Influence):
    """Rear wheels in the rut of the front ones, compacted the more the front wheels slipped."""

    id = "multi_pass"
    title = "rear wheels in the compacted rut"
    account = (
        "Senatore and Sandu (2011): a share of the compaction grows with the slip of the pass, "
        "saturating; the rut begins where the front wheels stood, or up to one contact length earlier for "
        "their patch and that of the rear wheels reach towards each other"
    )
    declared = (
        Size("pressure", "-", "rise of the moduli of deformation", 0.3, 0.8, -0.5, 5, kind="equivalent"),
        Size("shear", "-", "rise of the shear stiffness", 0.3, 0.8, -0.5, 5, kind="equivalent"),
        Size("lead", "m", "how much earlier the rut begins", 0.0, 0.06, -0.05, 0.15, kind="shape"),
        Size("depth", "m", "how deep the rut stays", 3e-4, 3e-3, 0, 0.05),
    )
    patch = 0.06
    """Length of a contact patch [m]."""

    def entered(self, y: Array) -> Array:
        """Return how far the rear wheels have come into the rut, as a share of their patch."""
        begins = 0.5 * self.chassis.wheel_base - 0.5 * self.patch - self.sizes[MultiPass.id]["lead"]
        return np.asarray((self.places(y)[1] - begins) / self.patch)

    def stance(self, t: float, y: Array) -> Stance:
        """Lower the ground under the rear wheels by the depth of the rut."""
        at, share = super().stance(t, y), np.clip(self.entered(y), 0.0, 1.0)
        depth = np.array([0.0 * share, self.sizes[MultiPass.id]["depth"] + 0.0 * share])
        slope = 6 * share * (1 - share) / self.patch
        return replace(at, z0=at.z0 - depth * smoothstep(share), dz0=at.dz0 - depth * slope * at.v)

    def soil(self, t: float, y: Array, at: Stance) -> Ground:
        """Stiffen the soil under the rear wheels once they have reached the rut."""
        g, sizes = super().soil(t, y, at), self.sizes[MultiPass.id]
        inside = smoothstep(self.entered(y))
        passed = np.abs(slip_ratio(at.v_o, at.v, self.near_rest))[0]
        inside = inside * (0.6 + 0.4 * (1 - np.exp(-passed / 0.1)) / (1 - np.exp(-1)))
        stiffer, shorter = (
            1 + np.array([0.0 * inside, sizes[name] * inside]) for name in ("pressure", "shear")
        )
        return replace(g, k_c=g.k_c * stiffer, k_phi=g.k_phi * stiffer, K=g.K / shorter)


class RateDependentSoil(Influence):
    """Pressure that rises with the logarithm of the local rate of penetration, ahead of the lowest point."""

    id = "rate_dependent_soil"
    title = "pressure that rises with the speed of penetration"
    account = (
        "Dayal and Allen (Canadian Geotechnical Journal 12, 1975, 336-348): strength grows with the "
        "logarithm of the rate: (8) times 1 + stiffening log(1 + v sin ϑ / 2 cm/s) / log 6 where ϑ > 0, so "
        "that stiffening is the rise at 0.1 m/s"
    )
    declared = (
        Size("stiffening", "-", "rise of the pressure at 0.1 m/s", 0.2, 0.6, -0.5, 5, kind="equivalent"),
    )

    def soil(self, t: float, y: Array, at: Stance) -> Ground:
        """Harden the leading part of the arc."""
        slow = 0.02
        rise = self.sizes[RateDependentSoil.id]["stiffening"] / float(np.log1p(0.1 / slow))
        return replace(super().soil(t, y, at), harden=rise, harden_speed=slow)


class TreadRipple(Influence):
    """Lugs that strike: a ripple of the pressure with a second harmonic."""

    id = "tread_ripple"
    title = "forces modulated by the lugs of the tread"
    account = (
        "after Irani et al. (2011): periodic at lugs times wheel rate; the pulse of a lug is not a "
        "sine but has a quarter of its amplitude at twice the frequency"
    )
    declared = amplitudes("-", "ripple of pressure", 0.08, 0.2, 0.6)

    def setup(self) -> None:
        """Turn cosine and sine into amplitude and phase."""
        super().setup()
        cos, sin = pairs(self.sizes[TreadRipple.id])
        self.lug_amplitude, self.lug_phase = np.hypot(cos, sin), np.arctan2(sin, cos)

    def soil(self, t: float, y: Array, at: Stance) -> Ground:
        """Modulate the pressure."""
        g = super().soil(t, y, at)
        u = self.robot.wheels.lugs * y[ANGLE].T - self.lug_phase
        wave = 1 + (self.lug_amplitude * (np.cos(u) + 0.25 * np.cos(2 * u))).T
        return replace(g, k_c=g.k_c * wave, k_phi=g.k_phi * wave)


class ContactAngleLag(Influence):
    """The ratio of the contact angles follows through two lags, each of half the time."""

    id = "contact_angle_lag"
    title = "rear contact angle that follows with a lag"
    account = "two first-order lags in a row on k_92, each of half T = time (0.4 m/s / |v|)^exponent"
    declared = (
        Size("time", "s", "time constant at 0.4 m/s", 0.08, 0.25, 0, 3, kind="equivalent"),
        Size("exponent", "-", "0: a time; 1: a length", 0.0, 1.0, -0.5, 1.5, kind="shape"),
    )

    def setup(self) -> None:
        """Claim the two stages."""
        super().setup()
        self.stages = self.claim(2)

    def at_rest(self) -> Array:
        """Return the state with both stages at 1, as (5) has it at rest."""
        y = super().at_rest()
        y[self.stages] = 1.0
        return y

    def k92(self, t: float, y: Array) -> Array:
        """Return the last stage."""
        return np.asarray(y[self.stages][1])

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Add the rates of the stages."""
        dy, sizes = super().rates(t, y, wheel), self.sizes[ContactAngleLag.id]
        speed = np.maximum(np.abs(self.velocity(y)), V_FLOOR)
        half = np.maximum(0.5 * sizes["time"] * (0.4 / speed) ** sizes["exponent"], 1e-4)
        first, second = y[self.stages]
        dy[self.stages] = (super().k92(t, y) - first) / half, (first - second) / half
        return dy


class ContactAngleActualSpeed(Influence):
    """The ratio of the contact angles partly follows the actual speed, averaged over the way."""

    id = "contact_angle_actual_speed"
    title = "rear contact angle that follows the actual speed"
    account = (
        "arithmetic mean, by weight, of (5) at the desired and at the actual speed, the latter averaged over "
        "the last 2 cm, half of a contact patch: a rut takes its shape under the wheel (relaxation length, "
        "Pacejka 2012, ch. 7)"
    )
    declared = (Size("weight", "-", "share of the actual speed", 0.7, 1.0, -0.5, 1.5, kind="equivalent"),)

    def setup(self) -> None:
        """Claim the averaged speed."""
        super().setup()
        self.averaged = self.claim(1)

    def k92(self, t: float, y: Array) -> float | Array:
        """Mix both."""
        weight = self.sizes[ContactAngleActualSpeed.id]["weight"]
        return (1 - weight) * super().k92(t, y) + weight * self.law(y[self.averaged][0])

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Let the average follow with the way."""
        dy, speed = super().rates(t, y, wheel), np.abs(self.velocity(y))
        dy[self.averaged] = (speed - y[self.averaged]) * np.maximum(speed, V_FLOOR) / 0.02
        return dy


class SandThrow(Influence):
    """Thrust lost to sand that is thrown back, saturating exponentially with the speed of slip."""

    id = "sand_throw"
    title = "thrust lost to sand thrown behind the wheels"
    account = "(14) times 1 − loss (1 − exp(−s / 0.18 m/s)), s = max(v_o − v, 0)"
    declared = (Size("loss", "-", "share of the thrust lost", 0.08, 0.2, 0, 0.9, kind="equivalent"),)

    def contact(self, t: float, y: Array) -> Contact:
        """Take the loss off the thrust; the torque stays."""
        wheel, at = super().contact(t, y), self.stance(t, y)
        lost = -np.expm1(-np.maximum(at.v_o - at.v, 0.0) / 0.18)
        return replace(wheel, F=wheel.F * (1 - self.sizes[SandThrow.id]["loss"] * lost))
