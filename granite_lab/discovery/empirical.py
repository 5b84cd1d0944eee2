"""What is missing, where no candidate explains it: a sparse law of force, moment and torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca

from granite_lab.model.body import BodyLoad, BodyState
from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Own
from granite_lab.model.symbols import ModelParameters

TERMS: dict[str, Callable[[WheelState, Any], Any]] = {
    "motion": lambda _s, _t: 1.0,
    "velocity": lambda s, _t: s.velocity / 0.5,
    "velocity_squared": lambda s, _t: (s.velocity / 0.5) ** 2,
    "slip": lambda s, _t: s.slip / 0.2,
    "sinking": lambda s, _t: s.sinkage_rate / 0.02,
    "start": lambda s, _t: ca.exp(-ca.fmax(s.travel, 0) / 0.2),
    "distance": lambda s, _t: s.travel,
    "cos_angle": lambda s, _t: ca.cos(s.angle),
    "sin_angle": lambda s, _t: ca.sin(s.angle),
    "time": lambda _s, t: t / 5.0,
}
"""Functions of what a wheel does, of the order of one, all faded out at standstill."""

TARGETS = {"force": ("N", 40.0), "moment": ("N m", 10.0), "torque_f": ("N m", 4.0), "torque_r": ("N m", 4.0)}
"""What may be missing: a force along the robot, a moment nose down on it, a torque against each front
and each rear wheel; unit, and the size of interest."""


class EmpiricalLaw(Effect):
    """Not a physical effect: a sum of simple terms that says what the missing quantity looks like."""

    id = "empirical"
    title = "empirical law of a missing force, moment or torque"
    equation = "Σ a_k φ_k, φ_k of velocity, slip, sinkage rate, distance, wheel angle and time"
    source = "fitted to the trials; sparse regression as in Brunton, Proctor, Kutz, PNAS 113, 2016, 3932-3937"
    signature = "whatever the candidates do not explain"
    parameters = tuple(
        EffectParameter(
            f"{target}_{term}", unit, f"{target.replace('_', ' ')} by {term.replace('_', ' ')}",
            -10 * size, 10 * size, 0.0, 0.2 * size, size, linear=True,
        )
        for target, (unit, size) in TARGETS.items() for term in TERMS
    )  # fmt: skip

    def body_load(
        self,
        load: BodyLoad,
        body: BodyState,
        axles: tuple[Axle, Axle],
        p: ModelParameters,  # noqa: ARG002
        own: Own,
    ) -> BodyLoad:
        """Add the force and the moment."""
        state = axles[0].state
        force = _sum("force", state, own)
        return replace(
            load,
            x=load.x + ca.cos(body.pitch) * force,
            z=load.z - ca.sin(body.pitch) * force,
            moment=load.moment + _sum("moment", state, own),
        )

    def rim_load(self, load: Any, state: WheelState, own: Own) -> Any:
        """Add the torque."""
        return load - _sum("torque_f" if state.front else "torque_r", state, own)


def _sum(target: str, state: WheelState, own: Own) -> Any:
    moving = smoothstep(ca.fabs(state.circumferential_velocity) / (2 * V_FLOOR))
    return moving * sum(own.p[f"{target}_{term}"] * φ(state, own.t) for term, φ in TERMS.items())
