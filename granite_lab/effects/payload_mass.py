"""Additional mass on the robot."""

from __future__ import annotations

from dataclasses import replace

from granite_lab.model.effect import Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters


class PayloadMass(Effect):
    """A mass at the height of the centre of mass, anywhere between the axles."""

    id = "payload_mass"
    title = "additional mass on the robot"
    equation = "m_0 + mass in (20), (21); x_CM, I_Ry of both bodies in (22)"
    source = "(20)-(22), parallel axis theorem; range: a laptop, a battery or an instrument weighs 1-8 kg"
    signature = (
        "Sinkage is larger also at standstill. Currents are higher, most during acceleration. Slip falls "
        "by tenths of a percentage point. Softer sand is similar but does not add inertia. com_offset moves "
        "load between the axles and adds none."
    )
    parameters = (
        EffectParameter("mass", "kg", "additional mass of the body", -20.0, 100.0, 0.0, 0.5, 8.0),
        EffectParameter("place", "m", "where it is, forward of the middle between the axles",
                        -0.2, 0.2, 0.0, -0.15, 0.15, shape=True, kinds=(-0.1, 0.0, 0.1)),
    )  # fmt: skip

    def system(self, p: ModelParameters, sym: Symbols) -> ModelParameters:
        """Join the mass to the robot."""
        c, m = p.chassis, sym.p["mass"]
        total = c.total_mass + m
        away = sym.p["place"] - c.com_x
        return replace(
            p,
            chassis=replace(
                c,
                body_mass=c.body_mass + m,
                com_x=c.com_x + m / total * away,
                pitch_inertia=c.pitch_inertia + c.total_mass * m / total * away**2,
            ),
        )
