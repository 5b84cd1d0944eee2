"""Scale factor error of the accelerometer."""

from __future__ import annotations

from typing import Any

from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters


class AccelScaleError(Effect):
    """Scale factors of the two axes that see the planar motion."""

    id = "accel_scale_error"
    name = "accelerometer scale error"
    fault = True
    title = "scale factor error of the accelerometer"
    equation = "a_x' = (1 + x) a_x, a_z' = (1 + z) a_z"
    source = (
        "Titterton and Weston, Strapdown Inertial Navigation Technology, 2nd ed., 2004, ch. 8; range: "
        "0.1-3 % in uncalibrated MEMS units (Tedaldi, Pretto, Menegatti, ICRA 2014, 3042-3049)"
    )
    signature = (
        "The velocity change from the IMU is wrong by a constant factor. The vertical axis reads a wrong "
        "g, also at standstill."
    )
    parameters = (
        EffectParameter("x", "", "relative error of the longitudinal axis",
                        -0.3, 0.3, 0.0, -0.03, 0.03, relative=True, linear=True),
        EffectParameter("z", "", "relative error of the vertical axis",
                        -0.3, 0.3, 0.0, -0.03, 0.03, relative=True, linear=True),
    )  # fmt: skip

    def as_logged(self, value: float, scaled: float) -> float:
        """Return an axis's whole error: what estimation took out of all axes, and what was found beyond."""
        return (1 + value) * scaled - 1

    def sensors(self, signals: dict[str, Any], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Scale both axes."""
        return signals | {
            f"imu_a{axis}_mps2": signals[f"imu_a{axis}_mps2"] * (1 + sym.p[axis]) for axis in "xz"
        }
