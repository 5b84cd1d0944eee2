"""Sizes that trials could show, on responses in closed form."""

from dataclasses import dataclass, replace

import pytest

from granite_lab.discovery.power import GROWTH, detectable
from granite_lab.discovery.screens import screen
from granite_lab.inference.constants import TOLERANCE
from granite_lab.inference.fit import fit
from granite_lab.inference.pool import Scenario, Task
from granite_lab.logs.trial import Array
from granite_lab.model.effect import EffectParameter
from tests.inference.stub import EFFECTS, MadeUp, Respond, measured, problem_of

SIZE = EFFECTS["lift"].parameters[0]
WAY = EffectParameter("way", "", "which of two", 0.0, 2.0, 1.0, 0.1, 0.5, shape=True, kinds=(0.12, 0.3))


@dataclass(frozen=True)
class OfTwoKinds(Respond):
    """The trace of "way" is that of a lift, times its second number."""

    def one(self, scenario: Scenario, task: Task) -> Array | None:
        setting = (("lift", (v[0] * v[1],)) if id_ == "way" else (id_, v) for id_, v in task.setting)
        return super().one(scenario, replace(task, setting=tuple(setting)))


def test_a_detectable_size_is_enough_for_each_kind_of_an_effect() -> None:
    """Which kind acts is not known: the size is that of the kind that shows least."""
    plain, _, _ = measured(0)
    problem = problem_of(respond=OfTwoKinds(), effects=EFFECTS | {"way": MadeUp("way", SIZE, WAY)})
    for trial, other in zip(problem.trials, plain.trials, strict=True):
        trial.measured[:] = other.measured
    base = fit(problem, problem.neutral())
    rows, _ = detectable(problem, base, screen(problem, base, ("lift", "way")), TOLERANCE)
    sizes = {row.effect: row.size for row in rows}
    assert sizes["way"] == pytest.approx(sizes["lift"] / min(WAY.kinds), rel=GROWTH - 1)
