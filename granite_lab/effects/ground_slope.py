"""Ground that is not level."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from granite_lab.model.body import BodyLoad, BodyState
from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import GRAVITY


class GroundSlope(Effect):
    """The frame O is parallel to the slope and gravity is turned. The robot does not roll at rest."""

    id = "ground_slope"
    title = "sloping ground"
    equation = "g_x = −g sin(slope), g_z = −g cos(slope) in (20), (21); at rest m g sin(slope) is held"
    source = "(20), (21); range: raked sand is level within a few tenths of a degree to 1°"
    signature = (
        "Uphill, slip and currents are higher at constant speed. The accelerometer has an offset also at "
        "standstill, as with imu_tilt. In the opposite direction the sign changes."
    )
    parameters = (
        EffectParameter("slope", "deg", "rise of the ground in the direction of travel",
                        -15.0, 15.0, 0.0, -2.0, 2.0, linear=True,
                        signs=("ground that rises", "ground that falls")),
    )  # fmt: skip

    def body_load(
        self, load: BodyLoad, body: BodyState, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols
    ) -> BodyLoad:
        """Turn gravity; at rest sand and gears hold its component downhill."""
        slope = sym.p["slope"] * np.pi / 180
        moving = sum(smoothstep(axle.state.speed / V_FLOOR) for axle in axles) / 2
        support = (1 - moving) * p.chassis.total_mass * GRAVITY * ca.sin(slope)
        return replace(
            load,
            x=load.x + support,
            moment=load.moment - support * p.chassis.com_z,
            gravity_x=-GRAVITY * ca.sin(slope),
            gravity_z=-GRAVITY * ca.cos(slope),
        )
