"""Time offset between the sensors."""

from __future__ import annotations

from typing import Any

from granite_lab.model.effect import Effect, EffectParameter, Symbols


class ClockOffset(Effect):
    """Encoders and currents are stamped by the motor controllers, the IMU by itself."""

    id = "clock_offset"
    fault = True
    title = "time offset of encoders and currents relative to the IMU"
    equation = "enc(t), cur(t) = their values at t − offset"
    source = (
        "Rehder, Siegwart, Furgale, IEEE Transactions on Robotics 32, 2016, 383-398: a few to tens of "
        "milliseconds"
    )
    signature = (
        "Wheels and currents lag the body by the same time in every trial, visible while the speed "
        "changes. The lag of tyre_windup depends on the torque."
    )
    parameters = (
        EffectParameter("offset", "s", "delay of the stamps", -0.3, 0.3, 0.0, -0.04, 0.04,
                        signs=("stamps of encoders and currents late against the IMU's",
                               "stamps of encoders and currents early against the IMU's")),
    )  # fmt: skip

    def delays(self, sym: Symbols) -> dict[str, Any]:
        """Delay the sensors of the drive units."""
        return {"enc": sym.p["offset"], "cur": sym.p["offset"]}
