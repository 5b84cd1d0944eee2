"""An effect that was found early keeps its name only if it would get it beside what was found later."""

from __future__ import annotations

import pytest

from granite_lab.discovery.baseline import baseline
from granite_lab.discovery.bench import Bench, World
from granite_lab.discovery.problem import Problem
from granite_lab.discovery.refit import plainly_needed, refit, with_effect
from granite_lab.discovery.select import FAR_FROM_IDLE, _without_idle, settle
from granite_lab.discovery.setup import trial_models
from granite_lab.effects import get
from granite_lab.hidden.making import make_set
from granite_lab.hidden.wish import Wish
from granite_lab.parameters import Variant, load_robot, load_soil

VARIANTS = (
    Variant(velocity=0.3, acceleration=1.2, distance=0.6),
    Variant(velocity=0.6, acceleration=1.2, distance=1.2),
)
CHANCE = 18.0


@pytest.mark.parametrize("hidden", ["contact_angle_lag", "ground_slope+contact_angle_lag"])
def test_a_slope_stays_beside_a_lag_only_if_there_is_one(hidden: str) -> None:
    """The hidden lag has another formula; a slope that is not there explains a part of what that leaves."""
    robot, soil = load_robot(), load_soil()
    sizes = {"contact_angle_lag.time": 0.2} | ({"ground_slope.slope": 2.0} if "+" in hidden else {})
    trials, _ = make_set(Wish(hidden, 3, sizes=sizes), robot, soil, repetitions=2, variants=VARIANTS)
    models, variants = trial_models(trials, robot)
    candidates = {id_: get(id_) for id_ in ("ground_slope", "contact_angle_lag")}
    with Bench(World(robot, soil, variants, candidates)) as bench:
        problem = Problem(models, bench)
        base = baseline(problem)
        start = with_effect(problem, base.point, "ground_slope", (1.0,))
        both = refit(problem, [with_effect(problem, start, "contact_angle_lag", (0.2, 0.5))])
        assert both is not None
        both = settle(problem, both)
        assert plainly_needed(problem, both, "ground_slope", FAR_FROM_IDLE * CHANCE)
        kept = _without_idle(problem, both, CHANCE)
    assert set(kept.point.effects) == set(hidden.split("+"))
