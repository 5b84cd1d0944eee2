"""Influences that the library of effects does not hold: of motors, command and load."""

from __future__ import annotations

import numpy as np

from granite_lab.hidden.contact import Array, Contact
from granite_lab.hidden.influence import Influence, Size
from granite_lab.hidden.model import CURRENT, VX


class WarmMotor(Influence):
    """A bad contact in the leads of each motor: little mass, so that it warms up within seconds."""

    id = "warm_motor"
    title = "resistance of the motors' leads that rises with the heat put in"
    account = "R_d (1 + rise ∫ i² dt), no cooling within a trial"
    declared = (Size("rise", "1/(A^2 s)", "relative rise of R_d", 3e-3, 8e-3, 0, 0.1),)

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
