"""Influences of the contact law: what stands in place of (8), (9) or (11). None has the library's form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from granite_lab.hidden.contact import Array, Ground, Stance
from granite_lab.hidden.influence import Influence, Size


class StressAhead(Influence):
    """Normal stress that is greatest ahead of the lowest point."""

    id = "stress_ahead"
    title = "normal stress that is greatest ahead of the lowest point"
    account = (
        "greatest at ϑm = share (0.18 + 0.32 |λ|) ϑ1, loose sand of Wong and Reece (J. Terramechanics 4, "
        "1967, 81-98); behind it a straight line to zero at −ϑ2, as Shibly, Iagnemma and Dubowsky "
        "(J. Terramechanics 42, 2005, 1-13) approximate it"
    )
    declared = (
        Size("share", "-", "place of the greatest stress over that law", 0.6, 1.2, 0, 2, kind="equivalent"),
    )

    def soil(self, t: float, y: Array, at: Stance) -> Ground:
        """Move the stress forward; a robot at rest has no front."""
        share = self.sizes[StressAhead.id]["share"]
        # a share of zero is the paper's law, which has no line behind the lowest point
        moved = self.fade(y) * min(share / 0.1, 1.0)
        return replace(super().soil(t, y, at), moved=moved, ahead=0.18 * share, ahead_slip=0.32 * share)


class ShearSoftening(Influence):
    """Shear stress that falls from a peak to a residual value."""

    id = "shear_softening"
    title = "shear stress with a peak and a residual value"
    account = (
        "Oida (1979) in place of (11): Kr (1 + (1/(Kr (1 − 1/e)) − 1) exp(1 − j/Kw)) (1 − exp(−j/Kw)) of the "
        "strength, Kr = 1 − loss, Kw = peak (Wong, Theory of Ground Vehicles, 4th ed., 2008, section 2.4.3)"
    )
    declared = (
        Size("loss", "-", "share of the peak that is lost", 0.2, 0.5, 0, 0.9, kind="equivalent"),
        Size("peak", "m", "shear displacement of the greatest stress", 0.02, 0.05, 0.005, 0.2, kind="shape"),
    )

    def soil(self, t: float, y: Array, at: Stance) -> Ground:
        """Give the shear stress its peak."""
        sizes = self.sizes[ShearSoftening.id]
        return replace(super().soil(t, y, at), residual=1.0 - sizes["loss"], peak=sizes["peak"])


class ExitBySinkage(Influence):
    """Rear contact angle that the rise of the sand behind the wheel sets."""

    id = "exit_by_sinkage"
    title = "rear contact angle set by the sinkage"
    account = (
        "in place of (5) k_92 = sqrt(κ) at any speed, κ of the sinkage behind the wheel over that in front "
        "(Ishigami and others, J. Field Robotics 24, 2007, 233-250), by the small angles of (4); a robot at "
        "rest has the paper's"
    )
    declared = (
        Size("share", "-", "share of this law, the rest by (5)", 0.6, 1.0, 0, 1, kind="equivalent"),
        Size("recovery", "-", "κ", 0.02, 0.15, 0, 1, kind="shape"),
    )

    def k92(self, t: float, y: Array) -> float | Array:
        """Mix both laws."""
        sizes = self.sizes[ExitBySinkage.id]
        share = sizes["share"] * self.fade(y)
        return (1 - share) * super().k92(t, y) + share * float(np.sqrt(sizes["recovery"]))


class BearingLimit(Influence):
    """Pressure that the soil's bearing capacity bounds; no effect of the library describes it."""

    id = "bearing_limit"
    title = "pressure bounded by the bearing capacity of the soil"
    account = (
        "Kacigin and Guskov (J. Terramechanics 5(3), 1968, 43-66): p = B tanh(p (8) / B), B = 50 kPa / limit"
    )
    declared = (Size("limit", "-", "50 kPa over the bearing capacity", 0.8, 1.6, 0, 4),)

    def soil(self, t: float, y: Array, at: Stance) -> Ground:
        """Bound the pressure of wheels that move, as the fits leave rest alone."""
        limit = self.sizes[BearingLimit.id]["limit"]
        return replace(super().soil(t, y, at), bearing=5e4 / limit if limit else 0.0)
