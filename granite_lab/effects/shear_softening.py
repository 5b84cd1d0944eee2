"""Shear stress that falls from a peak to a residual value."""

from __future__ import annotations

from typing import Any

import casadi as ca

from granite_lab.model.effect import Effect, EffectParameter, Symbols


class ShearSoftening(Effect):
    """Dense sand dilates when it is sheared: its strength falls from a peak to a residual value."""

    id = "shear_softening"
    law = True
    title = "shear stress with a peak and a residual value"
    equation = "τ = (11) · (1 − loss (1 − exp(−(j / peak)²)))"
    source = (
        "Wong, Preston-Thomas, J. Terramechanics 19, 1983, 225-234 (residual of 0.4 to 0.8 of the peak); "
        "Wong, Theory of Ground Vehicles, 4th ed., 2008, section 2.4.3"
    )
    signature = (
        "Slip and currents are higher where the wheels slip much: at 0.7 m/s and during acceleration. Little "
        "changes at 0.2 m/s."
    )
    parameters = (
        EffectParameter("loss", "", "share of the peak that is lost after a long shear displacement",
                        0.0, 0.9, 0.0, 0.1, 0.6),
        EffectParameter("peak", "m", "shear displacement over which the strength falls",
                        0.005, 0.1, 0.02, 0.01, 0.05, shape=True),
    )  # fmt: skip

    def shear(self, share: Any, displacement: Any, sym: Symbols) -> Any:
        """Lower the share of the strength that a long displacement mobilises."""
        fallen = 1 - ca.exp(-((displacement / sym.p["peak"]) ** 2))
        return share * (1 - sym.p["loss"] * fallen)
