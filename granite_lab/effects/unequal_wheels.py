"""Front and rear wheels of different radius."""

from __future__ import annotations

from dataclasses import replace

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Effect, EffectParameter, Symbols


class UnequalWheels(Effect):
    """Tyres of one axle are worn, or pressed together, more than those of the other one.

    Both axles turn at the same rate, so that the larger wheels push and the smaller ones brake. The mean
    radius is that of the robot's file; see `wheel_radius_error` for an error of the mean.
    """

    id = "unequal_wheels"
    title = "front and rear wheels of different radius"
    equation = "r_F = r (1 + δ/2), r_R = r (1 − δ/2)"
    source = (
        "geometry; Borenstein and Feng, IEEE Transactions on Robotics and Automation 12, 1996, 869-880 "
        "(unequal diameters); range: a rubber tyre wears and deflects by 1-4 % of its radius"
    )
    signature = (
        "Front and rear currents differ by a constant share while the robot drives steadily; com_offset and "
        "payload_mass change the pitch with the acceleration, too."
    )
    parameters = (
        EffectParameter("difference", "", "radius of the front less that of the rear wheels, over the mean",
                        -0.2, 0.2, 0.0, -0.04, 0.04, relative=True,
                        signs=("front wheels larger", "rear wheels larger")),
    )  # fmt: skip

    def wheel(self, state: WheelState, sym: Symbols) -> WheelState:
        """Change the radius; the wheel's centre stays, so that its sinkage changes as much."""
        change = (0.5 if state.front else -0.5) * sym.p["difference"] * state.radius
        return replace(state, radius=state.radius + change, sinkage=state.sinkage + change)
