"""A supply whose voltage drops with the current."""

from __future__ import annotations

from typing import Any

from granite_lab.model.effect import Effect, EffectParameter, Own
from granite_lab.parameters import Drive


class SupplySag(Effect):
    """The controller sets a duty cycle; the motor gets that part of what the supply still has."""

    id = "supply_sag"
    title = "supply voltage that drops with the current"
    equation = "u_i' = u_i (1 − R_s I_s / u_max), I_s = Σ (u_i / u_max) i_i"
    source = (
        "Thévenin source behind a pulse-width-modulated bridge: Mohan, Undeland, Robbins, Power "
        "Electronics, 3rd ed., Wiley 2003, ch. 7; 10-200 mΩ for packs of some 30 V with leads and contacts"
    )
    signature = (
        "wheels fall behind the command when the current is high and catch up later; the angle behind "
        "the command grows with the product of speed and torque; body and slip follow the wheels"
    )
    parameters = (
        EffectParameter("resistance", "ohm", "internal resistance of the supply and its leads",
                        0.0, 2.0, 0.0, 0.02, 0.3),
    )  # fmt: skip

    def voltages(
        self, voltages: tuple[Any, Any], currents: tuple[Any, Any], drive: Drive, own: Own
    ) -> tuple[Any, Any]:
        """Scale the voltages by what the four motors together draw from the supply."""
        drawn = sum(2 * u / drive.voltage_max * i for u, i in zip(voltages, currents, strict=True))
        left = 1 - own.p["resistance"] * drawn / drive.voltage_max
        return voltages[0] * left, voltages[1] * left
