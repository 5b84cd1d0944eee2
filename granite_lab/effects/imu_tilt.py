"""An IMU that is mounted at an angle nobody told of."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from granite_lab.model.effect import Effect, EffectParameter, Own
from granite_lab.model.symbols import ModelParameters


class ImuTilt(Effect):
    """Tilt in pitch; roll and yaw act on the planar motion in second order only."""

    id = "imu_tilt"
    title = "IMU mounted at an angle"
    equation = "a_x' = a_x cos β − a_z sin β, a_z' = a_x sin β + a_z cos β"
    source = "rotation (19) between robot and sensor; brackets and cases align an IMU to 0.2-2°"
    signature = (
        "a constant of g sin(tilt) in the longitudinal acceleration, at standstill as in motion, so that its "
        "integral drifts; twin of ground_slope but for slip and current, which know nothing of it"
    )
    parameters = (
        EffectParameter("tilt", "deg", "tilt of the IMU, nose down positive", -20.0, 20.0, 0.0, -2.0, 2.0),
    )

    def sensors(self, signals: dict[str, Any], p: ModelParameters, own: Own) -> dict[str, Any]:
        """Turn the specific force into the axes of the sensor."""
        β = own.p["tilt"] * np.pi / 180
        x, z = signals["imu_ax_mps2"], signals["imu_az_mps2"]
        return signals | {
            "imu_ax_mps2": x * ca.cos(β) - z * ca.sin(β),
            "imu_az_mps2": x * ca.sin(β) + z * ca.cos(β),
        }
