"""Every effect can be simulated over its whole prior range, in all four variants."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.effects import get, library
from granite_lab.effects.signature import CHANNELS, signature, typical
from granite_lab.model import Accuracy, simulate
from granite_lab.model.effect import Effect, activate
from granite_lab.parameters import load_variants
from tests.effects.runs import ROBOT, SOIL


def _points(effect: Effect) -> list[dict[str, float]]:
    """Return both ends of the prior range and two random points in it."""
    rng = np.random.default_rng(list(effect.id.encode()))
    shares = [np.zeros(len(effect.parameters)), np.ones(len(effect.parameters)),
              *rng.uniform(size=(2, len(effect.parameters)))]  # fmt: skip
    return [
        {
            p.name: p.prior_low + s * (p.prior_high - p.prior_low)
            for p, s in zip(effect.parameters, share, strict=True)
        }
        for share in shares
    ]


@pytest.mark.parametrize("effect_id", library())
def test_runs_converge_over_the_prior_range_and_the_robot_arrives(effect_id: str) -> None:
    effect = get(effect_id)
    for values in _points(effect):
        for variant in load_variants():
            r = simulate(variant, ROBOT, SOIL, effects=(activate(effect, values),))
            assert 0.15 * variant.distance < r["x_m"][-1] < 1.1 * variant.distance
            assert -0.1 < r.slip_ratio < 0.8


@pytest.mark.parametrize("effect_id", library())
def test_a_typical_strength_shows_in_some_channel(effect_id: str) -> None:
    """It exceeds the noise of a single sample (encoders: half a count) in at least one of them."""
    noise = dict(zip(CHANNELS, (0.05, 0.07, 0.003, 3e-5, 3e-5, 0.05, 0.05), strict=True))
    found = signature(get(effect_id), ROBOT, SOIL)
    assert list(found) == [v.velocity for v in load_variants()]
    assert max(np.abs(s.difference[c]).max() / noise[c] for s in found.values() for c in CHANNELS) > 1
    assert typical(get(effect_id)).as_dict() != activate(get(effect_id), {}).as_dict()


@pytest.mark.parametrize("effect_id", [i for i, e in library().items() if any(p.shape for p in e.parameters)])
def test_a_shape_alone_changes_nothing(effect_id: str) -> None:
    effect, fine = get(effect_id), Accuracy(1e-8, 1e-10)
    shapes = {p.name: p.prior_high for p in effect.parameters if p.shape}
    variant = load_variants()[2]
    plain, r = (
        simulate(variant, ROBOT, SOIL, accuracy=fine),
        simulate(variant, ROBOT, SOIL, effects=(activate(effect, shapes),), accuracy=fine),
    )
    np.testing.assert_allclose(r["v_mps"], plain["v_mps"], rtol=0, atol=2e-7)


def test_effects_add_up() -> None:
    """Several at once: the graph is built, each acts, and the order changes little."""
    pair = [typical(get(i)) for i in ("tyre_windup", "drive_reaction", "gear_backlash", "clock_offset")]
    variant = load_variants()[2]
    a, b = (simulate(variant, ROBOT, SOIL, effects=tuple(e)) for e in (pair, pair[::-1]))
    np.testing.assert_allclose(a["v_mps"], b["v_mps"], rtol=0, atol=5e-4)
