"""When a run is computed, and how finely."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from granite_lab.logs.trial import Array
from granite_lab.model.command import corners, duration, peak_velocity
from granite_lab.model.limits import refuse_long
from granite_lab.parameters import Course, Variant

SETTLE = 1.0
"""Standstill before the command [s]."""

COAST = 2.5
"""Time simulated after the command's end [s]: (26) cannot brake actively, so the robot comes to
rest with a time constant of 0.38 s; after 2.5 s it is slower than 0.1 mm/s."""


@dataclass(frozen=True)
class Accuracy:
    """How finely a run is computed.

    Attributes:
        relative, absolute: tolerances of the integrator.
        order: highest of CVODES' backward differences, where it integrates. Of a lower order the errors of
            neighbouring runs are more alike, and so their difference, a derivative, is better than either.
        step: largest spacing of the output grid while the robot moves [s].
        travel: how far the robot may drive from one instant to the next [m]; lugs and run-outs
            shake it by distance, so that fast runs need closer instants.
        lean: few instants before the command, where nothing happens, and many after each corner of
            it, where motors and tyres answer within milliseconds: straight lines over that would
            show the answer too late. As many before it, for there a clock that is early shows it.
    """

    relative: float = 1e-4
    absolute: float = 1e-6
    step: float = 0.005
    travel: float = np.inf
    lean: bool = False
    order: int = 5


USUAL = Accuracy()
"""For runs that people look at."""

ANSWER = np.concatenate(
    [np.arange(0, 0.01, 0.0005), np.arange(0.01, 0.03, 0.001), np.arange(0.03, 0.1, 0.0025)]
)
"""Instants about a corner of the command at which its answer is computed [s]."""

AT_REST = 0.02
"""Spacing of the instants before the command where they are few [s]."""


def instants(variant: Variant, accuracy: Accuracy) -> Array:
    """Return the (N,) output grid of a run [s after command start].

    Raises:
        EstimateError: it would be too long.
    """
    return _instants(variant, accuracy).copy()


@lru_cache(maxsize=64)
def _instants(variant: Variant, accuracy: Accuracy) -> Array:
    step = accuracy.step
    if not isinstance(variant, Course):
        step = min(step, accuracy.travel / peak_velocity(variant))
    samples = int(np.ceil((SETTLE + duration(variant) + COAST) / step)) + 1
    refuse_long(variant, samples, step)
    t: Array = -SETTLE + step * np.arange(samples, dtype=np.float64)
    if not accuracy.lean:
        return t
    before = np.arange(-SETTLE, 0, AT_REST)
    if isinstance(variant, Course):  # it may have corners everywhere
        return np.unique(np.concatenate([before, t[t >= 0]]).round(6))
    answers = (np.array(corners(variant))[:, None] + np.concatenate([-ANSWER, ANSWER])).ravel()
    return np.unique(np.concatenate([before, t[t >= 0], answers]).round(6))
