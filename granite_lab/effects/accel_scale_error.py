"""An accelerometer whose scale is off."""

from __future__ import annotations

from typing import Any

from granite_lab.model.effect import Effect, EffectParameter, Own
from granite_lab.model.symbols import ModelParameters


class AccelScaleError(Effect):
    """Scale factors of the two axes that see the planar motion."""

    id = "accel_scale_error"
    title = "scale of the accelerometer off"
    equation = "a_x' = (1 + x) a_x, a_z' = (1 + z) a_z"
    source = (
        "Titterton and Weston, Strapdown Inertial Navigation Technology, 2nd ed., IET 2004, ch. 8; Tedaldi, "
        "Pretto, Menegatti, ICRA 2014, 3042-3049: scale factors of uncalibrated MEMS units are off by 0.1-3 %"
    )
    signature = (
        "velocity from the IMU too large by the same share in every phase, in proportion to the change of "
        "speed; along z a constant share of g, at standstill, too"
    )
    parameters = (
        EffectParameter("x", "", "relative error of the longitudinal axis", -0.3, 0.3, 0.0, -0.03, 0.03),
        EffectParameter("z", "", "relative error of the vertical axis", -0.3, 0.3, 0.0, -0.03, 0.03),
    )

    def sensors(self, signals: dict[str, Any], p: ModelParameters, own: Own) -> dict[str, Any]:
        """Scale both axes."""
        return signals | {
            f"imu_a{axis}_mps2": signals[f"imu_a{axis}_mps2"] * (1 + own.p[axis]) for axis in "xz"
        }
