"""A slice of the blind benchmark: sets of the independent simulator, searched with the user's command."""

from __future__ import annotations

import json
from typing import Any

import pytest

from benchmarks.blind import RESULTS
from benchmarks.blind_schedule import Task
from benchmarks.blind_set import run
from granite_lab.parameters import Variant, load_variants

DETECTABLE = json.loads(RESULTS.with_name("detectable.json").read_text(encoding="utf-8"))["1"]["sizes"]


def judged(task: Task, variants: tuple[Variant, ...] = ()) -> dict[str, Any]:
    line = run(task, DETECTABLE, repetitions=2, variants=variants)
    assert line["status"] == "judged", line.get("error")
    return line


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_hidden_in_sand_off_its_file() -> None:
    line = judged(Task("null", "none", None, 77, sand_off=True))
    assert line["sand"]
    assert (line["verdict"], line["found"], line["right"]) == ("none", [], True)


@pytest.mark.slow
def test_a_load_five_times_as_heavy_as_can_be_seen_is_named_and_weighed() -> None:
    line = judged(Task("single", "payload_mass", 5.0, 78))
    assert [effect["id"] for effect in line["found"]] == ["payload_mass"]
    assert line["right"]
    (mass,) = line["parameters"]
    assert mass["true"] == pytest.approx(5 * DETECTABLE["payload_mass"]["mass"], rel=1e-3)
    assert abs(mass["z"]) < 4
    assert mass["std"] < 0.25 * mass["true"]
    before, after, _ = line["gap"]["held_out"]
    assert after < before


@pytest.mark.slow
def test_an_effect_outside_the_library_gets_no_name() -> None:
    slow, _, fast, _ = load_variants()
    line = judged(Task("outside", "command_staircase", 1.0, 79), (slow, fast))
    assert line["verdict"] == "unknown"
    assert line["right"]
    assert line["gap"]["held_out"][0] > 1.2 * line["gap"]["held_out"][2]
