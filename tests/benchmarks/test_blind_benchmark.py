"""The blind benchmark: a balanced schedule, strengths that mean something, and tables that count rightly."""

from __future__ import annotations

import json
from collections import Counter
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.blind import Results, missed_before, waiting
from benchmarks.blind_code import code_hash
from benchmarks.blind_figures import Share, headline, is_wrong_single, newest, strength_of
from benchmarks.blind_schedule import Task, schedule, sizes_of, wish_of
from benchmarks.blind_set import run
from benchmarks.blind_tables import report
from granite_lab.hidden.catalogue import LIBRARY, OUTSIDE, TWINS
from granite_lab.hidden.wish import drawn

PLAN = list(islice(schedule(), 500))


def line(kind: str = "single", effect: str = "ground_slope", **changed: Any) -> dict[str, Any]:
    found = {
        "key": f"{kind}/{effect}", "kind": kind, "effect": effect, "strength": 5.0, "seed": 1, "noise": 1.0,
        "sand_off": False, "code": "new", "commit": "abc", "status": "judged",
        "cpu": {"make": 4, "discover": 20},
        "reached": {effect: 5.0}, "truth": {effect: {"slope": 0.1}}, "outcome": "right", "right": True,
        "verdict": "named", "found": [{"id": effect, "twins": [], "empirical": False, "parameters": {}}],
        "parameters": [{"effect": effect, "name": "slope", "kind": "exact", "true": 0.1, "value": 0.11,
                        "std": 0.01, "z": 1.0}],
        "gap": {"train": [1.2, 1.01, 1.0], "held_out": [1.2, 1.01, 1.0]}, "closed": {"held_out": 0.95},
        "candidates": [[effect, 500.0, "evaluated"], ["imu_tilt", 100.0, "screened only"]],
    }  # fmt: skip
    return found | changed


def null(**changed: Any) -> dict[str, Any]:
    nothing = {"strength": None, "reached": {}, "truth": {}, "found": [], "parameters": [], "closed": {}}
    return line("null", "none", **({"verdict": "none"} | nothing | changed))


def test_the_schedule_holds_what_is_asked_of_the_benchmark() -> None:
    kinds = Counter(task.kind for task in PLAN)
    assert kinds["null"] >= 150
    assert kinds["pair"] >= 10
    assert kinds["loud"] >= 15
    cells = Counter((t.effect, t.strength) for t in PLAN if t.kind == "single")
    assert set(cells) == {(name, x) for name in LIBRARY for x in (0.5, 2, 5, 20)}
    assert min(cells.values()) >= 2
    outside = Counter(task.effect for task in PLAN if task.kind == "outside")
    assert set(outside) == set(OUTSIDE)
    assert min(outside.values()) >= 4
    nulls = Counter((t.noise, t.sand_off) for t in PLAN if t.kind == "null")
    assert nulls[1.0, True] == nulls[1.0, False] == 50
    assert nulls[4.0, True] == nulls[4.0, False] == 25
    assert {t.noise for t in PLAN if t.kind == "loud"} == {3.0}
    assert all(frozenset(t.effect.split("+")) not in TWINS for t in PLAN if t.kind == "pair")


def test_any_hour_of_the_schedule_is_balanced_and_no_seed_comes_twice() -> None:
    whole = Counter(task.kind for task in PLAN)
    for start in range(0, 400, 37):
        some = Counter(task.kind for task in PLAN[start : start + 100])
        assert all(abs(some[kind] - n / 5) <= 2 for kind, n in whole.items())
    assert len({task.seed for task in PLAN}) == len(PLAN) == len({task.key for task in PLAN})
    assert list(islice(schedule(), 500)) == PLAN


def test_a_strength_multiplies_the_smallest_detectable_size() -> None:
    rng = np.random.default_rng(0)
    sizes, reached = sizes_of("payload_mass", 5.0, {"mass": 0.3}, rng)
    assert sizes == {"mass": pytest.approx(1.5)}
    assert reached == 5.0
    both = [sizes_of("multi_pass", 2.0, {"pressure": 0.01, "shear": 0.03}, rng)[0] for _ in range(40)]
    for found in both:
        assert (found["pressure"] / 0.01) ** 2 + (found["shear"] / 0.03) ** 2 == pytest.approx(4.0)
    assert {(s["pressure"] > 0, s["shear"] > 0) for s in both} == {(True, True), (True, False), (False, True)}
    signs = {np.sign(sizes_of("ground_slope", 2.0, {"slope": 0.01}, rng)[0]["slope"]) for _ in range(20)}
    assert signs == {-1, 1}


def test_ripples_are_measured_by_their_amplitude_on_both_axles() -> None:
    detectable = {f"{part}_{axle}": 1e-3 for part in ("cos", "sin") for axle in ("front", "rear")}
    sizes, _ = sizes_of("tread_ripple", 5.0, detectable, np.random.default_rng(1))
    assert sizes == {
        "amplitude_front": pytest.approx(5e-3 / np.sqrt(2)),
        "amplitude_rear": pytest.approx(5e-3 / np.sqrt(2)),
    }


def test_a_strength_stops_where_the_robot_would_be_a_wreck() -> None:
    sizes, reached = sizes_of("imu_tilt", 20.0, {"tilt": 0.5}, np.random.default_rng(0))
    assert abs(sizes["tilt"]) == pytest.approx(6.0)  # three times the 2 degrees that are to be expected
    assert reached == pytest.approx(12.0)


def test_an_effect_without_a_detectable_size_is_refused() -> None:
    with pytest.raises(ValueError, match="no size of 'payload_mass'"):
        sizes_of("payload_mass", 5.0, {"mass": None}, np.random.default_rng(0))


def test_every_set_of_the_schedule_can_be_wished_for() -> None:
    detectable = {  # a thousandth of what the hidden effects are drawn at
        name: {
            s.name.replace("amplitude_", "cos_"): s.high / 1000
            for s in kind.declared
            if s.kind != "shape"
        }
        for name, kind in LIBRARY.items()
    }  # fmt: skip
    for task in PLAN:
        wish, _ = wish_of(task, detectable)
        names = () if task.effect == "none" else tuple(sorted(task.effect.split("+")))
        found = drawn(wish, names)
        assert set(found) == set(names)


def test_a_crash_is_a_result() -> None:
    result = run(Task("single", "payload_mass", 5.0, 1), {"payload_mass": {"mass": None}})
    assert result["status"] == "crashed"
    assert "no size of 'payload_mass'" in result["error"]
    assert "crashed" in report([result])


def test_results_survive_a_run_that_was_killed(tmp_path: Path) -> None:
    path = tmp_path / "results" / "blind.jsonl"
    Results(path).append(line(key="a"))
    with path.open("a") as file:
        file.write('{"key": "torn", "ki')
    again = Results(path)
    assert [x["key"] for x in again.lines] == ["a"]
    again.append(line(key="b"))
    again.append(line(key="c"))
    assert [x["key"] for x in Results(path).lines] == ["a", "b", "c"]
    assert len(path.read_text().splitlines()) == 4


def test_a_run_goes_on_where_the_last_one_ended() -> None:
    done = {task.seed for task in PLAN[:7]} | {PLAN[9].seed}
    assert list(islice(waiting(done, None), 4)) == [PLAN[7], PLAN[8], PLAN[10], PLAN[11]]
    chosen = list(islice(waiting(done, "single:5"), 8))
    assert all((task.kind, task.strength) == ("single", 5.0) for task in chosen)
    assert {task.effect for task in islice(waiting(set(), "tyre_windup"), 5)} == {"tyre_windup"}


@pytest.mark.parametrize(
    ("hits", "total", "low", "high"),
    # Newcombe 1998, table I, method 3
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_intervals_are_wilsons(hits: int, total: int, low: float, high: float) -> None:
    assert Share(hits, total).text.endswith(f"({100 * low:.0f}–{100 * high:.0f})")


def figures(lines: list[dict[str, Any]]) -> dict[str, tuple[str, bool | None]]:
    return {name: (value, met) for name, value, _, met in headline(lines)}


def test_the_figures_count_each_kind_by_its_own_rule() -> None:
    missed = {"right": False, "outcome": "missed", "verdict": "none", "found": [], "parameters": []}
    wrong = {"right": False, "outcome": "wrong_name", "found": [{"id": "imu_tilt", "twins": []}]}
    lines = [
        line(),
        line(**missed),
        line(strength=0.5, reached={"ground_slope": 0.5}, **missed),
        line(strength=20.0, reached={"ground_slope": 4.0}),  # held back: counts at 5
        line(strength=20.0, reached={"ground_slope": 20.0}, **wrong),
        null(),
        null(verdict="unknown", right=False, outcome="false_alarm"),
        line("outside", "wind_gust", outcome="abstained", verdict="unknown", found=[], parameters=[]),
        line("pair", "a+b", reached={"a": 5.0, "b": 5.0}, outcome="partial", right=False),
        line("loud", status="crashed", right=None, outcome=None, verdict=None, found=None),
    ]
    found = figures(lines)
    values = [value.split(" = ")[0] for value, _ in found.values()]
    assert values[:4] == ["–", "2/3", "0/1", "–"]
    assert found["nothing found at half the smallest detectable size"][0].startswith("1/1")
    assert found["a wrong single name, over all sets"][0].startswith("1/10")
    assert found["false alarms where nothing is hidden"] == ("1/2 = 50 % (9–91)", False)
    assert found["`unknown` where the effect is outside the library"][0].startswith("1/1")
    assert found["both of a pair named"][0].startswith("0/1")
    assert found["true value inside the stated 95 % interval"][0].startswith("2/2")


def test_a_set_of_twins_is_no_wrong_single_name() -> None:
    twins = [{"id": "imu_tilt", "twins": ["payload_mass"]}]
    assert not is_wrong_single(line(outcome="wrong_name", found=twins))
    assert is_wrong_single(line(outcome="wrong_name", found=[{"id": "imu_tilt", "twins": []}]))


def test_strengths_are_grouped_by_what_was_reached() -> None:
    reached = [0.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0]
    groups = [strength_of(line(strength=20.0, reached={"x": x})) for x in reached]
    assert groups == ["0.5", "2", "2", "5", "5", "20", "20"]
    assert strength_of(line(strength=None)) == "drawn"


def test_the_page_shows_the_newest_code_and_tells_of_the_rest() -> None:
    wrong = line(outcome="abstained", right=False, verdict="unknown", found=[], parameters=[])
    lines = [line(code="old"), null(), wrong]
    assert newest(lines) == lines[1:]
    page = report(lines)
    assert "2 sets, code new" in page
    assert "1 set of older code" in page
    assert "## Outside the library" not in page  # a table without rows is left out
    assert "3 sets, code new, old" in report(lines, every=True)
    assert "ground_slope (5: slope 0.1)" in page
    assert "abstained: unknown" in page
    assert "ground_slope 500, imu_tilt 100 (screen)" in page
    assert "nan" not in page
    json.dumps(lines, allow_nan=False)


def test_the_page_of_no_results_says_so() -> None:
    assert "No set has been judged yet" in report([])


def test_a_set_in_which_no_robot_could_drive_does_not_count() -> None:
    page = report([line(), line(status="not made", right=None, outcome=None)])
    assert "1 set, code new" in page


def test_the_page_shows_the_newest_code_beside_all() -> None:
    """Failures of older code stay among all and leave the newest."""
    early = [line(outcome="wrong_name", right=False, code="old") for _ in range(10)]
    late = [line(code="new") for _ in range(100)]
    page = report([*early, *late], every=True)
    assert "| 100 sets of the newest code | all 110 |" in page
    row = next(r for r in page.splitlines() if r.startswith("| right name or exact set of twins at 5"))
    assert "| 100/100 = 100 % (96–100) |" in row
    assert "| **100/110 = 91 %" in row


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


def test_what_older_code_missed_is_judged_again_and_shown_beside_its_verdict() -> None:
    wrong = {"outcome": "wrong_name", "right": False, "found": [], "parameters": []}
    lines = [
        line(key="a", seed=1, code="old", **wrong), line(key="b", seed=2, code="old"),
        line(key="c", seed=3, code="old", **wrong), line(key="d", seed=4, code=code_hash(), **wrong),
    ]  # fmt: skip
    again = [line(key="a", code="old"), line(key="c", code=code_hash())]
    assert [task.seed for task in missed_before(lines, again, code_hash())] == [1]
    page = report(lines, every=True, again=[line(key="a", code=code_hash()), line(key="c", code="old")])
    assert "judged 1 sets again that older code missed: 1 come out right" in page
    row = next(r for r in page.splitlines() if "| 1 | wrong name" in r)
    assert "| right: ground_slope |" in row
    assert "| 3 | wrong name: named | – |" in page
