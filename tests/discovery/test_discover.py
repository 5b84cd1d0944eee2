"""A search for the missing effect: nothing where nothing is missing, the right name where it is plain."""

from __future__ import annotations

import json

import pytest

from granite_lab.discovery import Finding, discover, finding_as_json
from granite_lab.effects import get
from granite_lab.logs.trial import Trial
from granite_lab.model import Accuracy, simulate
from granite_lab.model.effect import Active, activate
from granite_lab.model.virtual import virtual_trial
from granite_lab.parameters import load_robot, load_soil, load_variants

CANDIDATES = {i: get(i) for i in ("drive_reaction", "tyre_windup", "rolling_drag")}


def searched(trials: list[Trial]) -> Finding:
    return discover(trials, load_robot(), load_soil(), effects=CANDIDATES)


def driven(*effects: Active) -> list[Trial]:
    """The four variants of Table 2, twice each, virtual."""
    trials = []
    for i, variant in enumerate(load_variants()):
        run = simulate(
            variant, load_robot(), load_soil(), effects=effects, accuracy=Accuracy(1e-6, 1e-8, 0.0025)
        )
        trials += [virtual_trial(run, 10 * i + r, f"v{i}r{r}", repetition=r)[0] for r in (1, 2)]
    return trials


@pytest.mark.slow
def test_trials_of_the_papers_model_miss_nothing() -> None:
    finding = searched(driven())
    assert finding.verdict == "none"
    assert finding.effects == ()
    assert finding.virtual
    before, after, floor = finding.gap.held_out
    assert before == after
    assert abs(before - floor) < 0.02


@pytest.mark.slow
def test_a_plain_reaction_of_the_drives_is_named() -> None:
    effect = get("drive_reaction")
    active = activate(effect, {p.name: p.prior_high for p in effect.parameters})
    trials = driven(active)
    finding = searched(trials)
    assert finding.verdict == "named"
    assert [e.id for e in finding.effects] == ["drive_reaction"]
    (parameter,) = finding.effects[0].parameters
    true = active.values[0]
    assert abs(parameter.estimate.value - true) < 4 * parameter.estimate.std + 0.02 * true
    assert finding.gap.train[1] < finding.gap.train[0]
    document = finding_as_json(finding, "model.toml")
    assert document["schema"] == "granite-lab/discovery/1"
    json.dumps(document, allow_nan=False)
