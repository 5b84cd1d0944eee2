"""Torsion of the tyre between rim and tread."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters

TREAD_LAG = 2e-5
"""Time in which the tread of a rigid tyre takes up a change of torque [s]: it keeps the equation explicit."""


class TyreWindup(Effect):
    r"""A spring and a damper in parallel (Kelvin and Voigt) between rim and tread.

    The twist is ψ = κ u with κ the compliance and u the torque of the spring, so that the rigid
    tyre is κ = 0 and nothing becomes infinite there:

    .. math::
       J_t (\dot\omega - \kappa \ddot u) &= u + T_r \dot u + M_\omega(\omega - \kappa \dot u) \\
       J \dot\omega &= T + M_\omega + J_t \kappa \ddot u

    with stiffness 1/κ, damping T_r/κ, and J_t the share of the wheel's inertia J that sits in the tread.
    The soil meets the tread, which turns at ω − κ u̇; the motor and the encoder turn the rim. With gear
    play, too, J is the inertia of the whole wheel.
    """

    id = "tyre_windup"
    name = "tyre wind-up"
    title = "torsion of the tyre between rim and tread"
    equation = "J_t (ω̇ − κ ü) = u + T_r u̇ + M_ω(ω − κ u̇); ψ = κ u, stiffness k = 1/κ, damping c = T_r/κ"
    source = (
        "Zegelaar, TU Delft 1998; Pacejka, Tire and Vehicle Dynamics, 3rd ed., 2012, ch. 9; range: "
        "250-5000 N m/rad from 0.7 to 14 times the paper's radial stiffness; tread_share is assumed"
    )
    signature = (
        "The body lags the wheels by a few to tens of milliseconds when the torque changes: at the start "
        "and at the ends of the ramps. Currents rise later. Constant speed is unchanged."
    )
    parameters = (
        EffectParameter("compliance", "rad/(N m)", "twist of one tyre per torque, 1/k",
                        0.0, 0.1, 0.0, 2e-4, 4e-3),
        EffectParameter("retardation", "s", "damping over stiffness, c/k",
                        5e-4, 0.2, 0.01, 0.002, 0.05, shape=True),
        EffectParameter("tread_share", "-", "share of the wheel's inertia in the tread, J_t/J",
                        0.02, 0.95, 0.15, 0.05, 0.3, shape=True),
    )  # fmt: skip
    states = ("torque_f", "torque_rate_f", "torque_r", "torque_rate_r")

    def wheel(self, state: WheelState, sym: Symbols) -> WheelState:
        """Let the tread turn slower than the rim while the twist grows."""
        u_rate = sym.x[f"torque_rate_{state.letter}"]
        return replace(state, tread_rate=state.tread_rate - sym.p["compliance"] * u_rate)

    def rim_acceleration(self, acceleration: Any, axle: Axle, p: ModelParameters, sym: Symbols) -> Any:
        """Load the rim with what turns the tread."""
        return acceleration + sym.p["tread_share"] * sym.p["compliance"] * _jerk(acceleration, axle, p, sym)

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols) -> dict[str, Any]:
        """Return u̇ and ü."""
        rates: dict[str, Any] = {}
        for axle in axles:
            name = axle.state.letter
            plain = axle.rim_acceleration(p.chassis.wheel_inertia)
            rates[f"torque_{name}"] = sym.x[f"torque_rate_{name}"]
            rates[f"torque_rate_{name}"] = _jerk(plain, axle, p, sym)
        return rates


def _jerk(rigid: Any, axle: Axle, p: ModelParameters, sym: Symbols) -> Any:
    """Return ü, given the acceleration that the rim of a rigid tyre would have."""
    share, compliance, T_r = sym.p["tread_share"], sym.p["compliance"], sym.p["retardation"]
    J_t, name = share * p.chassis.wheel_inertia, axle.state.letter
    unbalanced = -axle.forces.moment - sym.x[f"torque_{name}"] - T_r * sym.x[f"torque_rate_{name}"]
    # ω̇ = rigid + share κ ü put into the equation of the tread
    slow = (1 - share) * J_t * compliance + TREAD_LAG * T_r
    return (unbalanced + J_t * rigid) / slow
