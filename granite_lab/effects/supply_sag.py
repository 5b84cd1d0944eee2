"""A supply whose voltage drops with the current."""

from __future__ import annotations

from typing import Any

from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import Drive


class SupplySag(Effect):
    """The controller sets a duty cycle; the motor gets this share of the supply's voltage.

    The capacitors of the bus delay the drop of the voltage.
    """

    id = "supply_sag"
    title = "supply voltage that drops with the current"
    equation = "u_i' = u_i (1 − R_s I_b / u_max), T_s İ_b + I_b = Σ (u_i / u_max) i_i, T_s = R_s C_s"
    source = (
        "Mohan, Undeland, Robbins, Power Electronics, 3rd ed., 2003, ch. 7; range: 10-200 mΩ for packs of "
        "about 30 V, 1-100 mF on the bus (assumed)"
    )
    signature = (
        "The wheels lag the command when speed and torque are both high, and catch up later. Body and "
        "slip follow the wheels."
    )
    parameters = (
        EffectParameter("resistance", "ohm", "internal resistance of the supply and its leads",
                        0.0, 2.0, 0.0, 0.02, 0.3),
        EffectParameter("time", "s", "resistance times capacitance of the bus, T_s",
                        2e-4, 0.2, 0.005, 0.0005, 0.03, shape=True),
    )  # fmt: skip
    states = ("drawn",)

    def voltages(
        self, voltages: tuple[Any, Any], currents: tuple[Any, Any], drive: Drive, sym: Symbols
    ) -> tuple[Any, Any]:
        """Scale the voltages with that of the bus."""
        left = 1 - sym.p["resistance"] * sym.x["drawn"] / drive.voltage_max
        return voltages[0] * left, voltages[1] * left

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Return İ_b from what the four motors together draw."""
        drawn = sum(2 * axle.voltage / p.drive.voltage_max * axle.current for axle in axles)
        return {"drawn": (drawn - sym.x["drawn"]) / sym.p["time"]}
