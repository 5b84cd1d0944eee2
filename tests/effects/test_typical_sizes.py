"""A typical size of every effect shows in the sensors, in some variant, and effects add up."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.effects import get, library
from granite_lab.effects.contract import CHANNELS, typical
from granite_lab.model import simulate
from granite_lab.parameters import load_variants
from tests.effects.runs import ROBOT, SOIL

NOISE = dict(zip(CHANNELS, (0.05, 0.07, 0.003, 3e-5, 3e-5, 0.05, 0.05), strict=True))
"""Of a single sample (encoders: half a count)."""


@pytest.mark.parametrize("effect_id", library())
def test_a_typical_strength_shows_in_some_channel(effect_id: str) -> None:
    active, largest = typical(get(effect_id)), 0.0
    for variant in load_variants():
        plain, run = (simulate(variant, ROBOT, SOIL, effects=e) for e in ((), (active,)))
        largest = max(largest, *(np.abs(run[c] - plain[c]).max() / NOISE[c] for c in CHANNELS))
    assert largest > 1


def test_effects_add_up() -> None:
    """Several at once: the graph is built, each acts, and the order changes little."""
    pair = [typical(get(i)) for i in ("tyre_windup", "drive_reaction", "gear_backlash", "clock_offset")]
    variant = load_variants()[2]
    a, b = (simulate(variant, ROBOT, SOIL, effects=tuple(e)) for e in (pair, pair[::-1]))
    np.testing.assert_allclose(a["v_mps"], b["v_mps"], rtol=0, atol=5e-4)
