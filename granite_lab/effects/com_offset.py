"""Centre of mass away from the value of the robot's file."""

from __future__ import annotations

from dataclasses import replace

from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters


class ComOffset(Effect):
    """Shift along the robot."""

    id = "com_offset"
    name = "centre-of-mass offset"
    title = "centre of mass shifted along the robot"
    equation = "x_CM + forward in (22)"
    source = "(22); range: weighing both axles leaves 2-8 mm; equipment on top adds more"
    signature = (
        "Load, sinkage and current move from one axle to the other, equally at standstill and in motion. "
        "drive_reaction does so only under torque."
    )
    parameters = (
        EffectParameter("forward", "m", "shift of the centre of mass, forward positive",
                        -0.15, 0.15, 0.0, -0.04, 0.04, linear=True,
                        signs=("centre of mass shifted to the front", "centre of mass shifted to the rear")),
    )  # fmt: skip

    def system(self, p: ModelParameters, sym: Symbols) -> ModelParameters:
        """Shift x_CM."""
        return replace(p, chassis=replace(p.chassis, com_x=p.chassis.com_x + sym.p["forward"]))
