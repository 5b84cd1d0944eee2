"""A resistance to rolling that grows with the speed."""

from __future__ import annotations

from dataclasses import replace

from granite_lab.model.command import V_FLOOR
from granite_lab.model.contact import ContactAngles, WheelForces, WheelState
from granite_lab.model.effect import Effect, EffectParameter, Own
from granite_lab.parameters import Soil

REFERENCE = 0.5
"""Speed at which `force` is stated [m/s]."""


class RollingDrag(Effect):
    """Sand dragged along, tyres kneaded: what holds the wheel centres back the more the faster they go."""

    id = "rolling_drag"
    title = "resistance that grows with speed"
    equation = "F_x = (16) − force/4 · (|v| / 0.5 m/s)^exponent sign(v), per wheel"
    source = (
        "rolling resistance as a power series in speed: Wong, Theory of Ground Vehicles, 4th ed., Wiley "
        "2008, ch. 1; in sand, added mass and drag of a moving granular layer; 0.2-5 % of the weight of "
        "423 N"
    )
    signature = (
        "more slip and more current at 0.7 than at 0.2 m/s, in phase with the speed; no effect on the "
        "heave; linear and quadratic drag can hardly be told apart"
    )
    parameters = (
        EffectParameter("force", "N", "drag of the robot at 0.5 m/s", 0.0, 200.0, 0.0, 1.0, 20.0),
        EffectParameter("exponent", "", "power of the speed", 0.5, 3.0, 1.0, 1.0, 2.0, shape=True),
    )

    def wheel_forces(
        self, forces: WheelForces, state: WheelState, angles: ContactAngles, soil: Soil, own: Own
    ) -> WheelForces:
        """Add the drag at the wheel centre; it passes smoothly through zero speed."""
        v = state.velocity / REFERENCE
        speed = v**2 + (V_FLOOR / REFERENCE) ** 2
        drag = own.p["force"] / 4 * v * speed ** ((own.p["exponent"] - 1) / 2)
        return replace(forces, extra=forces.extra - drag)
