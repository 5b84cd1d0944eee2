"""Influences that the library of effects does not hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from granite_lab.hidden.contact import Array, Contact, Ground, Stance
from granite_lab.hidden.influence import Influence, Size
from granite_lab.hidden.model import CURRENT, VX


class MoistureGradient(Influence):
    """Sand that is damper, and so firmer and more cohesive, further down the track."""

    id = "moisture_gradient"
    title = "sand whose moisture changes along the track"
    account = "k_φ and c linear in the place, the same for every wheel that comes there"
    declared = (Size("gradient", "1/m", "relative rise of k_φ and c per metre", 0.15, 0.4, -0.3, 2),)

    def soil(self, t: float, y: Array, at: Stance) -> Ground:
        """Change the soil with the place of each axle."""
        g = super().soil(t, y, at)
        firmer = 1 + self.sizes[MoistureGradient.id]["gradient"] * self.places(y)
        firmer = np.clip(firmer, 0.2, None)
        return replace(g, k_phi=g.k_phi * firmer, c=g.c * firmer)


class SoilAdhesion(Influence):
    """Soil that sticks to the trailing part of the wheel and pulls until it comes off."""

    id = "soil_adhesion"
    title = "adhesion between soil and wheel"
    account = "constant tension over the trailing arc while the wheel rolls: down and back by its integral"
    declared = (Size("tension", "Pa", "adhesive stress", 2000.0, 5000.0, 0, 3e4),)

    def contact(self, t: float, y: Array) -> Contact:
        """Add the integrals of (12) and (13) of a constant tension from −ϑ2 to 0."""
        wheel, g = super().contact(t, y), self.ground
        front = np.arccos(1 - np.clip(wheel.sinkage, 0.0, g.r) / g.r)
        rear, tension = self.k92(t, y) * front, self.sizes[SoilAdhesion.id]["tension"] * self.fade(y)
        down = tension * g.b * g.r * np.sin(rear)
        back = tension * g.b * g.r * (1 - np.cos(rear))
        return replace(wheel, R=wheel.R - back, normal=np.maximum(wheel.normal - down, 0.0))


class Washboard(Influence):
    """Ground in waves that the raking left."""

    id = "washboard"
    title = "ground in regular waves"
    account = "height sinusoidal in the place, with the slope of the wave under each wheel"
    declared = (
        Size("height", "m", "amplitude of the waves", 8e-4, 2e-3, 0, 0.01),
        Size("wavelength", "m", "from crest to crest", 0.22, 0.35, 0.1, 2, kind="shape"),
    )
    phased = True

    def wave(self, y: Array) -> tuple[Array, Array]:
        """Return height [m] and slope of the ground under the axles."""
        sizes = self.sizes[Washboard.id]
        number = 2 * np.pi / sizes["wavelength"]
        u = number * self.places(y) + sizes["phase"]
        return np.asarray(sizes["height"] * np.sin(u)), np.asarray(sizes["height"] * number * np.cos(u))

    def stance(self, t: float, y: Array) -> Stance:
        """Raise the ground."""
        at, (height, slope) = super().stance(t, y), self.wave(y)
        return replace(at, z0=at.z0 + height, dz0=at.dz0 + slope * at.v)

    def contact(self, t: float, y: Array) -> Contact:
        """Lean the normal force with the wave; at rest the sand holds."""
        wheel, (_, slope) = super().contact(t, y), self.wave(y)
        return replace(wheel, R=wheel.R - self.fade(y) * slope * wheel.normal)


class CableDrag(Influence):
    """A cable that the robot pulls behind it."""

    id = "cable_drag"
    title = "drag of a cable, growing with the way"
    account = "friction of the length that lies on the sand"
    declared = (Size("weight", "N/m", "drag per metre travelled", 6.0, 15.0, 0, 200),)

    def push(self, t: float, y: Array, wheel: Contact) -> Array:
        """Pull back."""
        length = np.maximum(self.places(y).mean(axis=0), 0.0)
        return super().push(t, y, wheel) + self.drag(y, self.sizes[CableDrag.id]["weight"] * length)


class WindGust(Influence):
    """A gust during the motion, at another instant in each trial."""

    id = "wind_gust"
    title = "a gust of wind"
    account = "bell-shaped force on the centre of mass, against the motion"
    declared = (
        Size("force", "N", "at the height of the gust", 15.0, 40.0, 0, 300),
        Size("duration", "s", "from rise to fall", 0.3, 0.6, 0.1, 3, kind="shape"),
    )
    predictable = False

    @classmethod
    def of_trial(cls, sizes: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Draw the instant, as a share of the motion."""
        return dict(sizes) | {"instant": float(rng.uniform(0.25, 0.75))}

    def push(self, t: float, y: Array, wheel: Contact) -> Array:
        """Blow."""
        sizes = self.sizes[WindGust.id]
        u = (t - sizes["instant"] * self.command.end) / (0.5 * sizes["duration"])
        push = super().push(t, y, wheel)
        push[0] -= sizes["force"] * np.exp(-(u**2)) * self.fade(y)
        return push


class StrapDrag(Influence):
    """A loose strap that catches the ground again and again."""

    id = "strap_drag"
    title = "drag that comes and goes in time"
    account = "squared half waves of a fixed period"
    declared = (
        Size("force", "N", "at its height", 12.0, 30.0, 0, 300),
        Size("period", "s", "between two catches", 0.35, 0.7, 0.1, 5, kind="shape"),
    )
    phased = True

    def push(self, t: float, y: Array, wheel: Contact) -> Array:
        """Catch and let go."""
        sizes = self.sizes[StrapDrag.id]
        wave = max(0.0, float(np.sin(2 * np.pi * t / sizes["period"] + sizes["phase"])))
        return super().push(t, y, wheel) + self.drag(y, sizes["force"] * wave**2)


class WarmMotor(Influence):
    """A bad contact in the leads of each motor: little mass, so that it warms up within seconds."""

    id = "warm_motor"
    title = "resistance of the motors' leads that rises with the heat put in"
    account = "R_d (1 + rise ∫ i² dt), no cooling within a trial"
    declared = (Size("rise", "1/(A^2 s)", "relative rise of R_d", 0.05, 0.15, 0, 0.5),)

    def setup(self) -> None:
        """Claim the heat."""
        super().setup()
        self.heat = self.claim(2)

    def resistance(self, y: Array) -> float | Array:
        """Return the resistance of the warm circuit."""
        return super().resistance(y) * (1 + self.sizes[WarmMotor.id]["rise"] * y[self.heat])

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Add the heat."""
        dy = super().rates(t, y, wheel)
        dy[self.heat] = y[CURRENT] ** 2
        return dy


class CommandStaircase(Influence):
    """A command that is renewed at a slow rate and held in between."""

    id = "command_staircase"
    title = "command in steps instead of ramps"
    account = "desired velocity sampled and held; the desired angle is its integral"
    declared = (Size("period", "s", "between two commands", 0.06, 0.12, 0.01, 0.5),)

    def setup(self) -> None:
        """Lay out the steps."""
        super().setup()
        self.step = self.sizes[CommandStaircase.id]["period"]
        count = int(np.ceil(self.command.end / self.step)) + 1
        self.held_v = np.array([self.command.velocity(k * self.step) for k in range(count)])
        self.held_s = np.concatenate([[0.0], np.cumsum(self.held_v) * self.step])

    def marks(self) -> tuple[float, ...]:
        """Return the edges of the steps, too."""
        edges = self.step * np.arange(self.held_v.size + 1)
        jumps = edges[np.flatnonzero(np.diff(self.held_v, prepend=0.0, append=0.0))]
        return tuple(sorted({*super().marks(), *map(float, jumps)}))

    def demand(self, t: float) -> tuple[float, float]:
        """Return the step in force; just before an edge, the old one."""
        if t <= 0:
            return 0.0, 0.0
        k = int(t / self.step)
        if k >= self.held_v.size:
            return float(self.held_s[-1]), 0.0
        return float(self.held_s[k] + self.held_v[k] * (t - k * self.step)), float(self.held_v[k])


class SwingingLoad(Influence):
    """A part of the body's mass that swings along on a soft mount."""

    id = "swinging_load"
    title = "a load that swings on its mount"
    account = "mass, spring and damping of 5 %, along x at the centre of mass; the whole mass is as filed"
    declared = (
        Size("mass", "kg", "swinging part of the mass", 2.0, 5.0, 0, 20),
        Size("frequency", "Hz", "of the load on its mount", 1.2, 2.5, 0.3, 20, kind="shape"),
    )

    def setup(self) -> None:
        """Claim place and rate of the load against the body."""
        super().setup()
        self.swing = self.claim(2)

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Let the mount share the body's acceleration out."""
        dy, sizes = super().rates(t, y, wheel), self.sizes[SwingingLoad.id]
        w = 2 * np.pi * sizes["frequency"]
        place, rate = y[self.swing]
        pull = w**2 * place + 2 * 0.05 * w * rate  # a unit of swinging mass
        body = (self.mass * dy[VX] + sizes["mass"] * pull) / (self.mass - sizes["mass"])
        dy[VX] = body
        dy[self.swing] = rate, -pull - body
        return dy
