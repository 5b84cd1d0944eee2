"""Passive pressure of the soil that a wheel pushes ahead of itself."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from granite_lab.model.command import V_FLOOR, magnitude
from granite_lab.model.contact import ContactAngles, WheelForces, WheelState
from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.parameters import Soil

UNIT_WEIGHT = 15_000.0
"""Weight of dry, raked sand [N/m^3]; 1.4-1.6 t/m^3."""

ROUND = 1e-3
"""Travel below which |x| is rounded off [m]."""


class Bulldozing(Effect):
    r"""Rankine's passive earth pressure on the face of the wheel below the surface.

    .. math:: F_b = b (2 c \sqrt{K_p} z_0 + \gamma K_p z_0^2 / 2), \qquad K_p = \tan^2(45° + \phi/2)

    The soil that it fails on is a wedge of the length z_0 tan(45° + φ/2), 1 to 5 cm, which piles up first.
    The sources have the full wedge from the start: the shortest length is less than `ROUND`.
    """

    id = "bulldozing"
    title = "soil pushed ahead of the wheels"
    equation = (
        "F_x = (16) − strength · b (2 c √K_p z0 + γ K_p z0²/2) (1 − exp(−|x|/length)) tanh(v/v_floor), "
        "K_p = tan²(45° + φ/2)"
    )
    source = (
        "Hegedus, Land Locomotion Laboratory report 61, 1960; Bekker, Introduction to Terrain-Vehicle "
        "Systems, 1969; Ishigami et al., Journal of Field Robotics 24, 2007, 233-250"
    )
    signature = (
        "Slip and currents are higher at every speed, the more the deeper the wheels sink. Friction in "
        "the drives raises only the currents."
    )
    parameters = (
        EffectParameter("strength", "", "multiple of the passive pressure of a vertical wall",
                        0.0, 10.0, 0.0, 0.1, 1.0),
        EffectParameter("length", "m", "travel from the start over which the soil piles up",
                        0.0002, 0.1, 0.03, 0.0002, 0.1, shape=True, kinds=(0.0002, 0.03)),
    )  # fmt: skip

    def wheel_forces(
        self, forces: WheelForces, state: WheelState, angles: ContactAngles, soil: Soil, sym: Symbols
    ) -> WheelForces:
        """Add the resistance at the wheel centre, through which a normal pressure on the face acts."""
        K_p = ca.tan(np.pi / 4 + soil.friction_angle * np.pi / 360) ** 2
        z0 = ca.fmax(state.sinkage, 0)
        F_b = state.width * (2 * soil.cohesion * ca.sqrt(K_p) * z0 + UNIT_WEIGHT * K_p * z0**2 / 2)
        piled = 1 - ca.exp(-magnitude(state.travel, ROUND) / sym.p["length"])
        direction = ca.tanh(state.velocity / V_FLOOR)
        return replace(forces, extra=forces.extra - sym.p["strength"] * F_b * piled * direction)
