"""Mounting tilt of the IMU."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters


class ImuTilt(Effect):
    """Tilt in pitch; roll and yaw act on the planar motion in second order only."""

    id = "imu_tilt"
    name = "IMU tilt"
    fault = True
    title = "mounting tilt of the IMU"
    equation = "a_x' = a_x cos β − a_z sin β, a_z' = a_x sin β + a_z cos β"
    source = "rotation (19); range: brackets and cases align an IMU to 0.2-2°"
    signature = (
        "The longitudinal acceleration has an offset of g sin(tilt), at standstill and in motion. "
        "ground_slope also changes slip and currents."
    )
    parameters = (
        EffectParameter("tilt", "deg", "tilt of the IMU, nose down positive", -20.0, 20.0, 0.0, -2.0, 2.0,
                        linear=True, signs=("IMU mounted nose down", "IMU mounted nose up")),
    )  # fmt: skip

    def sensors(self, signals: dict[str, Any], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Turn the specific force into the axes of the sensor."""
        β = sym.p["tilt"] * np.pi / 180
        x, z = signals["imu_ax_mps2"], signals["imu_az_mps2"]
        return signals | {
            "imu_ax_mps2": x * ca.cos(β) - z * ca.sin(β),
            "imu_az_mps2": x * ca.sin(β) + z * ca.cos(β),
        }
