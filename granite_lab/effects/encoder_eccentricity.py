"""Encoders whose discs are not centred on their shafts."""

from __future__ import annotations

import casadi as ca

from granite_lab.model.effect import Axle, Effect, Shaft, Symbols, turning_parameters


class EncoderEccentricity(Effect):
    """The reading runs ahead and behind once a revolution, and the controller makes the wheel follow it.

    It reads θ at θ = 0. The initial angles of front and rear wheels are unknown, hence four numbers for
    each trial.
    """

    id = "encoder_eccentricity"
    fault = True
    title = "eccentric encoder discs"
    equation = "enc = θ + c sin θ + s (cos θ − 1), for the controller (25), (26), too; amplitude e/R"
    source = (
        "geometry of a disc with offset e, read at the radius R; range: 0.2-0.4° for e = 0.1 mm "
        "(Synapticon, Circulo manual), 1.9° for 0.5 mm at 15 mm"
    )
    signature = (
        "Wheels, body and currents oscillate once per wheel turn (0.33-1.2 Hz at 0.2-0.7 m/s) while the "
        "encoders follow the command. wheel_eccentricity has vertical motion, too."
    )
    parameters = turning_parameters("rad", "reading error", 0.3, 0.03)
    circles = (("cos_front", "sin_front"), ("cos_rear", "sin_rear"))

    def reading(self, shaft: Shaft, axle: Axle, sym: Symbols) -> Shaft:
        """Add the error of the disc."""
        name, angle = "front" if axle.state.front else "rear", axle.state.angle
        c, s = sym.p[f"cos_{name}"], sym.p[f"sin_{name}"]
        return Shaft(
            shaft.angle + c * ca.sin(angle) + s * (ca.cos(angle) - 1),
            shaft.rate + (c * ca.cos(angle) - s * ca.sin(angle)) * axle.state.rate,
        )
