"""Normal stress that is greatest ahead of the lowest point of the wheel."""

from __future__ import annotations

from typing import Any

import casadi as ca

from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.model.contact import ContactAngles, WheelState
from granite_lab.model.effect import Effect, EffectParameter, Symbols

ROUND = 0.01
"""Slip below which its positive part is rounded off, so that the model stays smooth."""


class StressAhead(Effect):
    r"""Wong and Reece's distribution of the normal stress in place of (9).

    The stress is greatest at

    .. math:: ϑ_m = (c_1 + c_2 λ) ϑ_1

    ahead of the lowest point and falls to zero at -ϑ_2. Ahead of ϑ_m the depth (7) at ϑ sets it, as in (9);
    behind, the depth at that angle of the front branch to which ϑ corresponds. A robot at rest has no front.
    """

    id = "stress_ahead"
    law = True
    name = "stress ahead of the wheel"
    title = "normal stress that is greatest ahead of the lowest point"
    equation = (
        "(9) behind ϑm = share (c1 + c2 λ) ϑ1 with z at ϑ1 − (ϑ + ϑe) (ϑ1 − ϑm) / (ϑm + ϑe), "
        "ϑe = ϑ1 + share (ϑ2 − ϑ1)"
    )
    source = (
        "Wong, Reece, J. Terramechanics 4, 1967, 81-98: c1 = 0.18 in loose sand, 0.43 in compact sand, "
        "c2 = 0.32; the expected range is that of loose sand"
    )
    signature = (
        "At constant speed currents and slip are higher and the rear of each contact carries less, the more "
        "the wheels slip. Standstill is unchanged."
    )
    parameters = (
        EffectParameter("share", "", "0: greatest stress at the lowest point, 1: law of Wong and Reece",
                        0.0, 1.5, 0.0, 0.3, 1.0),
        EffectParameter("c1", "", "place of the greatest stress over ϑ1 without slip",
                        0.0, 0.6, 0.15, 0.05, 0.2, shape=True),
        EffectParameter("c2", "", "how much farther ahead it lies per unit of slip",
                        0.0, 0.8, 0.3, 0.15, 0.35, shape=True),
    )  # fmt: skip

    def corner(self, angle: Any, angles: ContactAngles, state: WheelState, sym: Symbols) -> Any:
        """Return ϑm."""
        share = sym.p["share"] * smoothstep(state.velocity / V_FLOOR)
        λ = (state.slip + ca.sqrt(state.slip**2 + ROUND**2)) / 2
        return ca.fmin(share * (sym.p["c1"] + sym.p["c2"] * λ), 1) * angles.front

    def bearing(self, angle: Any, angles: ContactAngles, state: WheelState, sym: Symbols) -> Any:
        """Return the angle of the front branch that bears the same stress."""
        ϑ1, share = angles.front, sym.p["share"] * smoothstep(state.velocity / V_FLOOR)
        ϑm = self.corner(angle, angles, state, sym)
        ϑe = ϑ1 + share * (angles.rear - ϑ1)
        steep = (ϑ1 - ϑm) / (ϑm + ϑe)
        behind = (ϑ1 - ϑe * steep) - angle * steep  # so grouped, exactly -ϑ for the paper's law
        return ca.if_else(angle < ϑm, behind, angle)
