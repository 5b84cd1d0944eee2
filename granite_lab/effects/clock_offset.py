"""Clocks of the sensors that do not agree."""

from __future__ import annotations

from typing import Any

from granite_lab.model.effect import Effect, EffectParameter, Own


class ClockOffset(Effect):
    """Encoders and currents come from the motor controllers; their stamps lag those of the IMU."""

    id = "clock_offset"
    title = "stamps of encoders and currents late against the IMU's"
    equation = "enc(t), cur(t) = their values at t − offset"
    source = (
        "Rehder, Siegwart, Furgale, A general approach to spatiotemporal calibration in multisensor systems, "
        "IEEE Transactions on Robotics 32, 2016, 383-398: offsets of some to some tens of milliseconds where "
        "stamps are given on arrival"
    )
    signature = (
        "wheels and currents lag the body by the same time in every trial and phase; seen only while "
        "the speed changes; mirror image of tyre_windup at the start, but it does not fade with the torque"
    )
    parameters = (
        EffectParameter("offset", "s", "by how much the stamps are late", -0.3, 0.3, 0.0, -0.04, 0.04),
    )

    def delays(self, own: Own) -> dict[str, Any]:
        """Delay the sensors of the drive units."""
        return {"enc": own.p["offset"], "cur": own.p["offset"]}
