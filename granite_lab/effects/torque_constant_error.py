"""Torque constant that differs from the robot's file."""

from __future__ import annotations

from dataclasses import replace

from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters


class TorqueConstantError(Effect):
    """k_m or the efficiency η_d; T depends only on their product."""

    id = "torque_constant_error"
    title = "wrong torque constant or gear efficiency"
    equation = "T = η_d n_d k_m (1 + error) i"
    source = (
        "(24); range: makers state k_m within 5-10 %, warm magnets lose 5-10 % (Hughes and Drury, "
        "Electric Motors and Drives, 5th ed., 2019, ch. 3)"
    )
    signature = (
        "All currents differ by the same factor in all phases and at all speeds. The motion is unchanged. "
        "A gain error of the current sensors looks identical."
    )
    parameters = (
        EffectParameter("error", "", "relative error of k_m η_d", -0.5, 0.5, 0.0, -0.15, 0.15, relative=True,
                        signs=("torque constant or gear efficiency above that of the robot's file",
                               "torque constant or gear efficiency below that of the robot's file")),
    )  # fmt: skip

    def system(self, p: ModelParameters, sym: Symbols) -> ModelParameters:
        """Scale k_m in the torque; the back-EMF keeps its own constant k_e."""
        constant = p.drive.torque_constant * (1 + sym.p["error"])
        return replace(p, drive=replace(p.drive, torque_constant=constant))
