"""Reaction of the driving torques on the body, which (22) leaves out."""

from __future__ import annotations

from dataclasses import replace

from granite_lab.model.body import BodyLoad, BodyState
from granite_lab.model.effect import Axle, Effect, EffectParameter, Symbols
from granite_lab.model.symbols import ModelParameters


class DriveReaction(Effect):
    """The motors are in the body: a torque that drives a wheel forward turns the body backward."""

    id = "drive_reaction"
    title = "reaction of the driving torques on the body"
    equation = "I_Ry Θ̈ = (22) − share · Σ T_i"
    source = (
        "Wong, Theory of Ground Vehicles, 4th ed., 2008, ch. 3; Figs. 5-8 of the paper show rear torques "
        "above the simulated ones"
    )
    signature = (
        "Load moves to the rear in proportion to the torque: the nose rises, and current moves from the "
        "front to the rear wheels. The change is largest during acceleration and zero at standstill."
    )
    parameters = (
        EffectParameter("share", "", "share of ΣT that acts on the body; 1 by Newton's third law",
                        -0.5, 2.0, 0.0, 0.5, 1.5, linear=True),
    )  # fmt: skip

    def body_load(
        self, load: BodyLoad, body: BodyState, axles: tuple[Axle, Axle], p: ModelParameters, sym: Symbols
    ) -> BodyLoad:
        """Subtract the torques of all four wheels; the pitch is positive nose down, as they are."""
        torque = 2 * (axles[0].drive_torque + axles[1].drive_torque)
        return replace(load, moment=load.moment - sym.p["share"] * torque)
