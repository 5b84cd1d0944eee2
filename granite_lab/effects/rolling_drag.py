"""A resistance to rolling, constant or with a power of the speed."""

from __future__ import annotations

from dataclasses import replace

from granite_lab.model.command import V_FLOOR
from granite_lab.model.contact import ContactAngles, WheelForces, WheelState
from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.parameters import Soil

REFERENCE = 0.5
"""Speed at which `force` is stated [m/s]."""


class RollingDrag(Effect):
    """A force on the wheel centres against the motion: sand dragged along, tyre hysteresis."""

    id = "rolling_drag"
    name = "rolling resistance"
    title = "rolling resistance"
    equation = "F_x = (16) − force/4 · (|v| / 0.5 m/s)^exponent sign(v), per wheel"
    source = (
        "Wong, Theory of Ground Vehicles, 4th ed., 2008, ch. 1: a constant part and one that grows with the "
        "speed or its square; range: 0.2-5 % of the weight of 423 N"
    )
    signature = (
        "Slip and currents are higher, with an exponent above 0 the more the faster. The vertical motion is "
        "unchanged; at standstill there is none, unlike on a slope."
    )
    parameters = (
        EffectParameter("force", "N", "drag of the robot at 0.5 m/s", 0.0, 200.0, 0.0, 1.0, 20.0),
        EffectParameter("exponent", "", "exponent of the speed", 0.0, 3.0, 0.5, 0.0, 2.0, shape=True),
    )

    def wheel_forces(
        self, forces: WheelForces, state: WheelState, angles: ContactAngles, soil: Soil, sym: Symbols
    ) -> WheelForces:
        """Add the drag at the wheel centre; it passes smoothly through zero speed."""
        v = state.velocity / REFERENCE
        speed = v**2 + (V_FLOOR / REFERENCE) ** 2
        drag = sym.p["force"] / 4 * v * speed ** ((sym.p["exponent"] - 1) / 2)
        return replace(forces, extra=forces.extra - drag)
