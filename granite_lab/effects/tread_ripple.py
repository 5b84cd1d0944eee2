"""Lugs of the tread that modulate pressure, shear stress and pull."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from granite_lab.model.contact import ContactAngles, WheelForces, WheelState, stiffer, stronger
from granite_lab.model.effect import Effect, Symbols, turning_parameters
from granite_lab.parameters import Soil

OF = {"": "pressure", "_strength": "shear strength", "_pull": "pull"}
"""What oscillates, by the end of the names of its parameters."""


class TreadRipple(Effect):
    """Each lug that enters the soil raises the pressure, the shear stress or the pull, each gap lowers them.

    Which of them oscillates most depends on the lugs. Cosine and sine parts replace amplitude and phase,
    which keeps the model linear near zero. The initial angles of front and rear wheels are unknown, hence the
    numbers for each trial.
    """

    id = "tread_ripple"
    by_lugs = True
    title = "force ripple from the lugs of the tread"
    equation = (
        "(8) with k (1 + ρ), (10) with τ_max (1 + ρ'), (16) with F_Tx (1 + ρ''), N lugs, each ρ = "
        "c cos(N θ) + s sin(N θ)"
    )
    source = (
        "Irani, Bauer, Warkentin, J. Terramechanics 48, 2011, 307-318; Shikanai et al., J. "
        "Terramechanics 37, 2000, 21-39 (sinusoidal drawbar pull)"
    )
    signature = (
        "Accelerations and pitch rate oscillate at N times the wheel rate, 8-28 Hz for 24 lugs at 0.2-0.7 "
        "m/s. The mean is zero."
    )
    parameters = tuple(
        parameter
        for of, what in OF.items()
        for parameter in turning_parameters("", f"relative {what} ripple", 0.8, 0.3, of)
    )
    circles = tuple((f"cos_{axle}{of}", f"sin_{axle}{of}") for of in OF for axle in ("front", "rear"))

    def soil(self, soil: Soil, state: WheelState, sym: Symbols) -> Soil:
        """Modulate both moduli and the shear strength with the angle of the wheel."""
        stiff = stiffer(soil, 1 + _ripple(state, sym, ""))
        return stronger(stiff, 1 + _ripple(state, sym, "_strength"))

    def wheel_forces(
        self, forces: WheelForces, state: WheelState, angles: ContactAngles, soil: Soil, sym: Symbols
    ) -> WheelForces:
        """Modulate the longitudinal force with the angle of the wheel."""
        return replace(forces, extra=forces.extra + _ripple(state, sym, "_pull") * forces.longitudinal)


def _ripple(state: WheelState, sym: Symbols, of: str) -> Any:
    """Return the relative ripple of the pressure or of the pull."""
    name, angle = "front" if state.front else "rear", sym.model.wheels.lugs * state.angle
    return sym.p[f"cos_{name}{of}"] * ca.cos(angle) + sym.p[f"sin_{name}{of}"] * ca.sin(angle)
