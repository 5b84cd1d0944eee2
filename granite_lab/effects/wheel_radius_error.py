"""Wheel angles scaled by a wrong radius or count."""

from __future__ import annotations

from typing import Any

from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters


class WheelRadiusError(Effect):
    """Angles that were computed from a distance with a wrong radius, or with a wrong number of counts."""

    id = "wheel_radius_error"
    fault = True
    of_encoders = True
    title = "scale error of the wheel angles"
    equation = "enc' = (1 + error) enc"
    source = (
        "Borenstein and Feng, IEEE Transactions on Robotics and Automation 12, 1996, 869-880; range: a "
        "rubber tyre wears and deflects by 1-4 % of its radius"
    )
    signature = (
        "Encoders and body disagree by the same factor at every speed: slip appears even without torque."
    )
    parameters = (
        EffectParameter("error", "", "relative error of the reading", -0.2, 0.2, 0.0, -0.04, 0.04,
                        relative=True, linear=True,
                        signs=("wheel angles read too large", "wheel angles read too small")),
    )  # fmt: skip

    def sensors(self, signals: dict[str, Any], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Scale the angles."""
        scale = 1 + sym.p["error"]
        return {n: scale * s if n.startswith("enc_") else s for n, s in signals.items()}
