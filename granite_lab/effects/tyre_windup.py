"""Torsion of the tyre between rim and tread."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Own
from granite_lab.model.symbols import ModelParameters

TREAD_SHARE = 0.1
"""Share of the wheel's inertia that sits in the tread: an assumption. With a tread without mass
a compliance of 1.5 mrad/(N m) is found 0.7 % larger."""

TREAD_LAG = 2e-5
"""Time in which the tread of a rigid tyre takes up a change of torque [s]: it keeps the equation explicit."""


class TyreWindup(Effect):
    r"""A spring and a damper in parallel (Kelvin and Voigt) between rim and tread.

    The twist is ψ = κ u with κ the compliance and u the torque of the spring, so that the rigid
    tyre is κ = 0 and nothing becomes infinite there:

    .. math:: J \kappa \ddot u + u + T_r \dot u = -M_\omega(\omega - \kappa \dot u)

    with stiffness 1/κ, damping T_r/κ, and J the inertia of the tread, which is part of the wheel's.
    The soil meets the tread, which turns at ω − κ u̇; the motor and the encoder turn the rim.
    """

    id = "tyre_windup"
    title = "torsion of the tyre between rim and tread"
    equation = "J κ ü + u + T_r u̇ = −M_ω(ω − κ u̇); ψ = κ u, stiffness k = 1/κ, damping c = T_r/κ"
    source = (
        "torsional degree of freedom of the rigid-ring tyre: Zegelaar, The dynamic response of tyres to "
        "brake torque variations and road unevennesses, TU Delft 1998; Pacejka, Tire and Vehicle "
        "Dynamics, 3rd ed., Butterworth-Heinemann 2012, ch. 9; stiffness k = k_x r^2 with a longitudinal "
        "stiffness k_x of 0.7 to 14 times the radial one of the paper, 40 kN/m, gives 250-5000 N m/rad"
    )
    signature = (
        "jerks at the start and the end of the torque: the body lags the wheels by the few milliseconds "
        "to some tens that the tyre needs to wind up, is late again at the corner of the ramp, and is "
        "thrown back when the command ends; currents rise later; between the jerks nothing changes, "
        "steady slip least of all"
    )
    parameters = (
        EffectParameter("compliance", "rad/(N m)", "twist of one tyre per torque, 1/k",
                        0.0, 0.02, 0.0, 2e-4, 4e-3),
        EffectParameter("retardation", "s", "damping over stiffness, c/k",
                        5e-4, 0.2, 0.01, 0.002, 0.05, shape=True),
    )  # fmt: skip
    states = ("torque_f", "torque_rate_f", "torque_r", "torque_rate_r")

    def wheel(self, state: WheelState, own: Own) -> WheelState:
        """Let the tread turn slower than the rim while the twist grows."""
        u_rate = own.x["torque_rate_f" if state.front else "torque_rate_r"]
        return replace(state, tread_rate=state.tread_rate - own.p["compliance"] * u_rate)

    def rates(self, axles: tuple[Axle, Axle], p: ModelParameters, own: Own) -> dict[str, Any]:
        """Return u̇ and ü."""
        T_r = own.p["retardation"]
        slow = TREAD_SHARE * p.chassis.wheel_inertia * own.p["compliance"] + TREAD_LAG * T_r
        rates: dict[str, Any] = {}
        for name, axle in zip("fr", axles, strict=True):
            u, u_rate = own.x[f"torque_{name}"], own.x[f"torque_rate_{name}"]
            rates[f"torque_{name}"] = u_rate
            rates[f"torque_rate_{name}"] = (-axle.forces.moment - u - T_r * u_rate) / slow
        return rates
