"""Several causes at once: how strong each of them is, and the motion at a speed that no trial shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from granite_lab.hidden.catalogue import influence
from granite_lab.hidden.contact import Array
from granite_lab.hidden.gaps import LEAST
from granite_lab.hidden.model import Truth
from granite_lab.hidden.random_numbers import generator
from granite_lab.hidden.simulator import DT, drive
from granite_lab.parameters import Variant

STRONGER = 2.0
"""Factor at most by which a cause is made stronger so that it counts."""

ATTEMPTS = 40
"""Draws of causes and sizes until each cause counts."""

WITHHELD = 0.25, 0.65
"""Range of the withheld desired velocity [m/s], inside of Table 2."""

APART = 0.04
"""Least distance of the withheld velocity from those of Table 2 [m/s]."""

SPACING = 0.02
"""Between two instants of the withheld motion [s]."""

SMOOTH = 0.3
"""Average of the withheld motion [s]: three lugs of the paper's wheel or more, which lie 25 mm apart."""


def stronger(name: str, sizes: Mapping[str, float], share: float) -> dict[str, float]:
    """Return the sizes of a cause, larger where it reopens less than `LEAST` of the squared gap."""
    factor = 1.0 if share >= LEAST else min(1.2 * float(np.sqrt(LEAST / share)), STRONGER)
    grown = dict(sizes)
    for size in influence(name).declared:
        if size.kind != "shape":
            grown[size.name] = float(np.clip(factor * sizes[size.name], size.least, size.most))
    return grown


def withheld_variant(seed: int, variants: Sequence[Variant]) -> Variant:
    """Return a command that no trial has, with acceleration and distance of the nearest variant."""
    rng = generator(seed, 6)
    while True:
        v = round(float(rng.uniform(*WITHHELD)), 3)
        if all(abs(v - variant.velocity) >= APART for variant in variants):
            break
    nearest = min(variants, key=lambda variant: abs(variant.velocity - v))
    return replace(nearest, velocity=v)


def motion_of(truths: Sequence[Truth], variant: Variant) -> Mapping[str, Any]:
    """Return the mean true motion under a command: velocity [m/s] and mean current [A] over time [s]."""
    bodies, step = [drive(truth, 0.5, 0.5) for truth in truths], round(SPACING / DT)
    v = np.mean([body.v for body in bodies], axis=0)
    current = np.mean([body.current.mean(axis=1) for body in bodies], axis=0)
    return {
        "velocity": variant.velocity, "acceleration": variant.acceleration, "distance": variant.distance,
        "t": (bodies[0].t - bodies[0].start)[::step].round(3).tolist(),
        "v": v[::step].round(5).tolist(),
        "current": current[::step].round(4).tolist(),
    }  # fmt: skip


def share_closed(truth: Mapping[str, Any], paper: Mapping[str, Array], model: Mapping[str, Array]) -> float:
    """Return the share of the gap at the withheld speed that a model closes: 1 - its rms over the paper's.

    Args:
        truth: as `motion_of` returns it.
        paper, model: ``t_s``, ``v_mps`` and ``current`` of the paper's model and of the one that was found.

    Both sides are averaged over `SMOOTH`: the phase of the lugs is new in each trial. Errors of a channel
    count as shares of its own rms, so that one without a gap weighs as little as it should.
    """
    window = np.full(round(SMOOTH / SPACING), SPACING / SMOOTH)

    def squares(run: Mapping[str, Array]) -> float:
        total = 0.0
        for name, true in (("v_mps", np.array(truth["v"])), ("current", np.array(truth["current"]))):
            error = np.convolve(np.interp(truth["t"], run["t_s"], run[name]) - true, window, "valid")
            total += float(np.mean(error**2) / np.mean(true**2))
        return total

    return float(1 - np.sqrt(squares(model) / squares(paper)))
