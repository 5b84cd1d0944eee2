"""Runs with and without an effect, for the tests of this folder."""

import numpy as np

from granite_lab.effects import get
from granite_lab.model import Accuracy, Run, simulate
from granite_lab.model.effect import activate
from granite_lab.parameters import load_robot, load_soil, variant_of

ROBOT, SOIL = load_robot(), load_soil()
CHASSIS, DRIVE = ROBOT.chassis, ROBOT.drive


def run(effect_id: str | None = None, v: float = 0.5, step: float = 0.005, **values: float) -> Run:
    """Simulate a variant of Table 2 finely, with at most one effect."""
    effects = (activate(get(effect_id), values),) if effect_id else ()
    return simulate(variant_of(v), ROBOT, SOIL, effects=effects, accuracy=Accuracy(1e-7, 1e-9, step))


def at(r: Run, t: float, name: str) -> float:
    """Return a signal at an instant."""
    return float(np.interp(t, r.t, r[name]))
