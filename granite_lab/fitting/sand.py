"""What the sand does from trial to trial, and how far that moves a simulated quantity."""

from __future__ import annotations

import dataclasses

from granite_lab.model.virtual import Scatter
from granite_lab.parameters import Soil

_RAKED = Scatter()

SAND_SCATTER = {
    "frictional_modulus": _RAKED.frictional_modulus,
    "cohesion": _RAKED.cohesion,
    "friction_angle": 0.02,
}
"""Relative std of k_φ, c and φ from one raking and levelling to the next.

An assumption, the same that virtual trials are made with: prepared dry sand repeats to several
percent in stiffness and strength and better in the angle of friction, and no test of the
container's sand itself is published. The repetitions of each variant check it: scatter beyond it
shows up as `AThetaFit.scatter`. k_92 itself may scatter as well; that is part of what is fitted,
not a nuisance.
"""

SHARED = ("exponent", "shear_modulus", "tyre_friction")
"""n, K and μ_s belong to the sand and the tyre, not to the raking: an error in them is common to
all trials, so it shifts every k_92 alike and is stated beside the fit, not added to its std."""

SHARED_STEP = 0.05
"""Relative change of a shared parameter for which the shift of k_92 is stated."""


def perturbed(soil: Soil, parameter: str, relative: float) -> Soil:
    """Return the soil with one parameter multiplied by 1 + `relative`."""
    return dataclasses.replace(soil, **{parameter: getattr(soil, parameter) * (1 + relative)})
