"""Additional mass on the robot."""

from __future__ import annotations

from dataclasses import replace

from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters


class PayloadMass(Effect):
    """A mass at the centre of mass; for a mass elsewhere com_offset is switched on, too."""

    id = "payload_mass"
    title = "additional mass on the robot"
    equation = "m_0 + mass in (20), (21)"
    source = "(20), (21); range: a laptop, a battery or an instrument weighs 1-8 kg"
    signature = (
        "Sinkage is larger also at standstill. Currents are higher, most during acceleration. Slip falls "
        "by tenths of a percentage point. Softer sand is similar but does not add inertia."
    )
    parameters = (EffectParameter("mass", "kg", "additional mass of the body", -20.0, 100.0, 0.0, 0.5, 8.0),)

    def system(self, p: ModelParameters, sym: Symbols) -> ModelParameters:
        """Add to m_0."""
        return replace(p, chassis=replace(p.chassis, body_mass=p.chassis.body_mass + sym.p["mass"]))
