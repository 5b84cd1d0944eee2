"""A centre of mass that is not where the robot's file has it."""

from __future__ import annotations

from dataclasses import replace

from granite_lab.model.effect import Effect, EffectParameter, Own
from granite_lab.model.symbols import ModelParameters


class ComOffset(Effect):
    """Shift along the robot."""

    id = "com_offset"
    title = "centre of mass shifted along the robot"
    equation = "x_CM + forward in (22)"
    source = (
        "(22); weighing both axles on scales to 0.5-2 % of the weight leaves 2-8 mm; a laptop on top "
        "moves it more"
    )
    signature = (
        "sinkage, load and current move from one axle to the other by the same share at standstill and in "
        "motion; kin to drive_reaction, which is absent at standstill and grows with the torque"
    )
    parameters = (
        EffectParameter("forward", "m", "shift of the centre of mass, forward positive",
                        -0.15, 0.15, 0.0, -0.04, 0.04),
    )  # fmt: skip

    def system(self, p: ModelParameters, own: Own) -> ModelParameters:
        """Shift x_CM."""
        return replace(p, chassis=replace(p.chassis, com_x=p.chassis.com_x + own.p["forward"]))
