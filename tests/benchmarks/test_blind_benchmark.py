"""The blind benchmark: a frozen schedule, sizes that mean something, and a page that counts rightly."""

import json
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from benchmarks.blind import Task, made, one, ready, schedule, sizes_of
from benchmarks.blind_code import code_hash
from benchmarks.blind_page import figures, group, page, wrong_single
from benchmarks.lines import read, write
from granite_lab.api.hidden import hide
from granite_lab.effects import library
from granite_lab.hidden.catalogue import LIBRARY, OUTSIDE, TWINS, influence
from granite_lab.hidden.sealed import open_answer

PLAN = schedule()
SEEN = {
    f"{name}.{parameter.name}": 0.1 * max(abs(parameter.prior_low), parameter.prior_high)
    for name, effect in library().items()
    for parameter in effect.parameters
}
"""Smallest sizes as a search states them: a tenth of what the library expects."""


def line(kind: str = "single", effect: str = "ground_slope", **changed: Any) -> dict[str, Any]:
    found = {
        "key": f"{kind}/{effect}", "kind": kind, "effect": effect, "strength": 5.0, "seed": 1, "lab": "wild",
        "code": "new", "commit": "abc", "status": "judged", "seconds": 20.0, "reached": {effect: 5.0},
        "truth": {effect: {"slope": 0.1}}, "outcome": "right", "right": True, "verdict": "named",
        "probability": 0.97, "closed": 0.95, "stated": [[effect, 0.97, True]],
        "effects": [{"id": effect, "indistinguishable_from": []}],
        "parameters": [{"effect": effect, "name": "slope", "kind": "exact", "true": 0.1, "value": 0.11,
                        "std": 0.01, "z": 1.0}],
        "lab_drawn": {"repetitions": 3, "other robot": False, "other sand": True,
                      "IMU more than 4 ms late": False, "gears that lock": True},
    }  # fmt: skip
    return found | changed


def null(**changed: Any) -> dict[str, Any]:
    nothing = {
        "stated": [],
        "reached": {},
        "truth": {},
        "effects": [],
        "parameters": [],
        "closed": None,
        "verdict": "none",
    }
    return line("null", "none", **(nothing | changed))


def test_the_schedule_holds_what_is_asked_of_the_benchmark() -> None:
    kinds = Counter(task.kind for task in PLAN)
    assert kinds == {"null": 109, "single": 208, "outside": 35, "pair": 35, "old": 26}
    cells = Counter((t.effect, t.strength) for t in PLAN if t.kind == "single")
    assert cells == dict.fromkeys([(name, x) for name in LIBRARY for x in (2.0, 5.0)], 4)
    outside = Counter(task.effect.split("+")[0] for task in PLAN if task.kind == "outside")
    assert set(outside) == set(OUTSIDE)
    assert min(outside.values()) >= 3
    assert sum("+" in task.effect for task in PLAN if task.kind == "outside") >= 5
    assert not any(frozenset(task.effect.split("+")) in TWINS for task in PLAN)
    assert {t.effect for t in PLAN if t.lab == "bench"} == {*LIBRARY, "none"}
    assert len({task.key for task in PLAN}) == len(PLAN)
    # every set has one without an effect in its own laboratory
    assert {task.reference for task in PLAN} == {task.key for task in PLAN if task.kind == "null"}


def test_a_set_waits_for_the_sizes_of_its_laboratory() -> None:
    first, other = PLAN[0], next(t for t in PLAN if t.kind != "null" and t.seed == PLAN[0].seed)
    assert all(task.kind == "null" for task, _ in ready(PLAN, {}))
    done = {first.key: null(detectable={"ground_slope.slope": 0.2})}
    offered = {task.key: sizes for task, sizes in ready(PLAN, done)}
    assert offered[other.key] == {"ground_slope.slope": 0.2}


@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_a_size_is_so_many_times_what_can_be_seen_of_it(name: str) -> None:
    sizes, reached = sizes_of(Task("single", name, 5.0, 7), SEEN)
    assert reached == {name: pytest.approx(5.0)}
    kinds = {size.name: size for size in influence(name).declared}
    share = sum(
        (sizes[f"{name}.{key}"] / SEEN[f"{name}.{key.replace('amplitude_', 'cos_')}"]) ** 2
        for key, size in kinds.items()
        if size.kind != "shape"
    )
    assert share**0.5 == pytest.approx(5.0)


def test_a_size_stays_sensible_and_says_so() -> None:
    sizes, reached = sizes_of(Task("single", "payload_mass", 5.0, 7), {"payload_mass.mass": 50.0})
    assert sizes["payload_mass.mass"] == pytest.approx(24.0)  # three times the 8 kg that are expected at most
    assert reached["payload_mass"] == pytest.approx(24 / 50)
    assert group(line(reached=reached)) == "less"
    with pytest.raises(ValueError, match="shows no size"):
        sizes_of(Task("single", "payload_mass", 5.0, 7), {"payload_mass.mass": None})


@pytest.mark.usefixtures("two_variants")
def test_a_robot_that_would_dig_in_gets_less(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.blind.hide", partial(hide, repetitions=1))
    task = Task("old", "bulldozing", 5.0, 9, "bench")
    reached = made(task, {"bulldozing.strength": 0.6}, tmp_path)
    assert 0.5 < reached["bulldozing"] < 5.0
    (effect,) = open_answer(tmp_path)["effects"]
    assert effect["parameters"]["strength"]["value"] == pytest.approx(0.6 * reached["bulldozing"], rel=0.01)


def test_a_laboratory_whose_first_set_failed_counts_against_the_search() -> None:
    found = one(Task("single", "imu_tilt", 2.0, 7), {})
    assert (found["status"], found["right"]) == ("crashed", False)


def test_what_a_killed_run_left_is_read(tmp_path: Path) -> None:
    path = tmp_path / "blind.jsonl"
    write(path, [line(), null()])
    assert read(path) == [line(), null()]
    path.write_text(path.read_text() + '{"key": "torn')
    assert read(path) == [line(), null()]
    assert read(tmp_path / "absent") == []


def test_the_figures_count_each_kind_by_its_own_rule() -> None:
    missed = {"right": False, "outcome": "missed", "verdict": "none", "effects": [], "parameters": []}
    wrong = {"right": False, "outcome": "wrong_name",
             "effects": [{"id": "imu_tilt", "indistinguishable_from": []}], "parameters": []}  # fmt: skip
    unknown = {"outcome": "abstained", "verdict": "unknown", "effects": [], "parameters": []}
    lines = [
        line(),
        line(**missed),
        line(reached={"ground_slope": 2.0}, **wrong),
        line(strength=2.0, reached={"ground_slope": 1.2}, **missed),  # held back: in neither figure
        null(),
        null(verdict="unknown", right=False, outcome="false_alarm", probability=0.5),
        line("outside", "wind_gust", probability=0.5, **unknown),
        line("pair", "a+b", right=False, outcome="partial", parameters=[]),
        line("old", status="crashed", outcome="crashed", right=False, verdict=None, parameters=None),
    ]
    twins = [{"id": "imu_tilt", "indistinguishable_from": ["payload_mass"]}]
    assert wrong_single(line(**wrong))
    assert not wrong_single(line(**wrong | {"effects": twins}))
    found = {name: (text.split(" = ")[0], met) for name, text, _, met in figures(lines)}
    assert list(found.values()) == [
        ("0/1", False), ("1/2", False), ("1/9", False), ("1/2", False), ("1/1", True), ("0/1", False),
        ("0/1", False), ("2/7", False), ("1/1", False), ("1/9", False),
    ]  # fmt: skip


def test_the_page_shows_one_code_and_what_went_wrong_by_kind() -> None:
    wrong = {"outcome": "abstained", "right": False, "verdict": "unknown", "effects": [], "parameters": []}
    lines = [line(code="old", **wrong), line(), null(), line(**wrong), line(**wrong), line(status="not made")]
    text = page(lines, 397)
    assert "4 of 397 sets are judged, code new (abc);\n1 more could not be made" in text
    assert "| one effect at 5 times | abstained | 2 | ground_slope (2) |" in text
    assert "`ground_slope.slope`: 1.10, 1 of 1" in text
    assert "3 repetitions 50 % of 4" in text
    assert "| 0.95–0.98 | 0.970 | 3/3 = 100 % (44–100) | yes |" in text
    assert "nan" not in text
    assert "old (abc)" not in text
    json.dumps(lines, allow_nan=False)
    assert "No set has been judged yet" in page([], 397)


def test_the_hash_of_the_code_is_that_of_what_it_does(tmp_path: Path) -> None:
    module = tmp_path / "granite_lab" / "model" / "one.py"
    module.parent.mkdir(parents=True)

    def of(source: str) -> str:
        module.write_text(source, encoding="utf-8")
        return code_hash(tmp_path)

    plain = of("def f(x):\n    return x + 1\n")
    assert of('"""Words."""\n\n\ndef f(x):  # why\n    """More."""\n    return x + 1\n') == plain
    assert of("def f(x):\n    return x + 2\n") != plain
    assert of('def f(x):\n    return "x" + x\n') != plain
    shown = tmp_path / "granite_lab" / "reporting" / "page.py"
    shown.parent.mkdir()
    before = code_hash(tmp_path)
    shown.write_text("x = 1\n")
    assert code_hash(tmp_path) == before
