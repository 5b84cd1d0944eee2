"""Mass that the robot's file does not know of."""

from __future__ import annotations

from dataclasses import replace

from granite_lab.model.effect import Effect, EffectParameter, Own
from granite_lab.model.symbols import ModelParameters


class PayloadMass(Effect):
    """A mass at the centre of mass; one that sits elsewhere is this and com_offset together."""

    id = "payload_mass"
    title = "mass that the robot's file does not know of"
    equation = "m_0 + mass in (20), (21)"
    source = "(20), (21); a laptop, a battery or an instrument on this robot weighs 1-8 kg"
    signature = (
        "deeper sinkage already at standstill, more current at every speed and most while accelerating; "
        "slip falls by tenths of a point; nearly what softer sand looks like, except that inertia "
        "grows, too"
    )
    parameters = (EffectParameter("mass", "kg", "additional mass of the body", -20.0, 100.0, 0.0, 0.5, 8.0),)

    def system(self, p: ModelParameters, own: Own) -> ModelParameters:
        """Add to m_0."""
        return replace(p, chassis=replace(p.chassis, body_mass=p.chassis.body_mass + own.p["mass"]))
