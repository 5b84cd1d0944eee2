"""What is missing, where no candidate explains it: a sparse law of force, moment and torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca

from granite_lab.model.body import BodyLoad, BodyState
from granite_lab.model.command import V_FLOOR, smoothstep
from granite_lab.model.contact import WheelState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Own
from granite_lab.model.symbols import ModelParameters


class Term(NamedTuple):
    """A function of what a wheel does and of the time, of the order of one; in words and as a formula."""

    of: Callable[[WheelState, Any], Any]
    words: str
    formula: str


TERMS = {
    "motion": Term(lambda _s, _t: 1.0, "constant while moving", ""),
    "velocity": Term(lambda s, _t: s.velocity / 0.5, "with the speed of the robot", "v / (0.5 m/s)"),
    "velocity_squared": Term(
        lambda s, _t: (s.velocity / 0.5) ** 2, "with the square of that speed", "(v / (0.5 m/s))²"
    ),
    "slip": Term(lambda s, _t: s.slip / 0.2, "with slip", "s / 0.2"),
    "sinking": Term(lambda s, _t: s.sinkage_rate / 0.02, "with the rate of sinking", "(dz/dt) / (20 mm/s)"),
    "start": Term(
        lambda s, _t: ca.exp(-ca.fmax(s.travel, 0) / 0.2), "over the first 0.2 m", "exp(−x / 0.2 m)"
    ),
    "distance": Term(lambda s, _t: s.travel, "with the distance", "x / (1 m)"),
    "cos_angle": Term(lambda s, _t: ca.cos(s.angle), "with the cosine of the wheel's angle", "cos θ"),
    "sin_angle": Term(lambda s, _t: ca.sin(s.angle), "with the sine of the wheel's angle", "sin θ"),
    "time": Term(lambda _s, t: t / 5.0, "with time", "t / (5 s)"),
}
"""Terms of the law, all faded out at standstill."""


class Target(NamedTuple):
    """What may be missing: its unit, the size of interest, and in words."""

    unit: str
    size: float
    words: str


TARGETS = {
    "force": Target("N", 40.0, "force along the robot"),
    "moment": Target("N m", 10.0, "moment on the body, nose down"),
    "torque_f": Target("N m", 4.0, "torque against each front wheel"),
    "torque_r": Target("N m", 4.0, "torque against each rear wheel"),
}


class EmpiricalLaw(Effect):
    """Not a physical effect: a sum of simple terms that says what the missing quantity looks like."""

    id = "empirical"
    title = "empirical law of a missing force, moment or torque"
    equation = "Σ a_k φ_k, φ_k of velocity, slip, sinkage rate, distance, wheel angle and time"
    source = "fitted to the trials; sparse regression as in Brunton, Proctor, Kutz, PNAS 113, 2016, 3932-3937"
    signature = "whatever the candidates do not explain"
    parameters = tuple(
        EffectParameter(
            f"{name}_{term}", target.unit, f"{name.replace('_', ' ')} by {term.replace('_', ' ')}",
            -10 * target.size, 10 * target.size, 0.0, 0.2 * target.size, target.size, linear=True,
        )
        for name, target in TARGETS.items() for term in TERMS
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
    return moving * sum(own.p[f"{target}_{name}"] * term.of(state, own.t) for name, term in TERMS.items())
