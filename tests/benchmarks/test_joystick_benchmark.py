"""The benchmark of joystick runs: it covers what is asked, and its page counts rightly."""

import json
from typing import Any

import pytest

from benchmarks.joystick import FIRST, SEARCHED, drive, effects_of, exponent, law, work_of
from benchmarks.joystick_page import law_rows, name_rows, page
from granite_lab.estimate import Estimate
from granite_lab.hidden.catalogue import LIBRARY


def run(z: float | None, trajectory: float | None = 0.0) -> dict[str, Any]:
    found = [None if x is None else [4.9 + 0.1 * x, 0.1] for x in (z, trajectory)]
    return {"trial": "x", "true": 4.9, "slip": found[0], "trajectory": found[1], "wheels": z == 0.0}


def of_law(*runs: dict[str, Any], **changed: Any) -> dict[str, Any]:
    return {
        "part": "law", "key": "law/1", "seed": FIRST, **drive(FIRST), "status": "judged", "true": 4.9,
        "a_theta": [5.0, 0.1], "runs": list(runs), "code": "new", "commit": "abc",
    } | changed  # fmt: skip


def of_names(**changed: Any) -> dict[str, Any]:
    return {
        "part": "names", "key": "names/1/x", "seed": SEARCHED, "effect": "bulldozing", "kind": "single",
        **drive(SEARCHED), "status": "judged", "outcome": "right", "right": True, "code": "new",
        "commit": "abc", "effects": [{"id": "bulldozing", "indistinguishable_from": ["rolling_drag"]}],
    } | changed  # fmt: skip


def test_half_of_the_sets_have_an_unknown_controller_and_half_a_logged_command() -> None:
    kinds = [drive(FIRST + k) for k in range(4)]
    assert sorted((k["controller"], k["log_command"]) for k in kinds) == [
        ("paper", False), ("paper", True), ("unknown", False), ("unknown", True),
    ]  # fmt: skip
    assert all(k["log_command"] == (k["command"] == "recorded") for k in kinds)


def test_nine_laboratories_hide_every_effect_once_or_twice() -> None:
    hidden = [name for k in range(9) for name in effects_of(SEARCHED + k)]
    assert set(hidden) == set(LIBRARY)
    assert len(hidden) == 27


def test_sets_with_an_effect_wait_for_the_one_without() -> None:
    law_sets = work_of(8, 2, {})
    assert [given[0] for _, given in law_sets] == [FIRST, FIRST + 1, SEARCHED, SEARCHED + 1]
    assert [given[1] for _, given in law_sets[2:]] == ["none", "none"]
    null = of_names(effect="none", kind="null", detectable={"imu_tilt.tilt": 1.0})
    done = {f"law/{FIRST}": of_law(), f"law/{FIRST + 1}": of_law(), f"names/{SEARCHED}/none": null}
    more = work_of(8, 2, done)
    assert [given[:2] for _, given in more] == [
        *((SEARCHED, name) for name in effects_of(SEARCHED)), (SEARCHED + 1, "none"),
    ]  # fmt: skip
    assert more[0][1][2] == {"imu_tilt.tilt": 1.0}


def test_a_value_that_is_missing_or_two_std_off_is_not_right() -> None:
    (every, *_) = law_rows([of_law(run(0.0), run(1.9), run(-2.1), run(None, None), a_theta=[5.3, 0.1])])
    assert every[0] == "all"
    assert every[1] == "1 of 4"
    assert every[2].startswith("2 of 4 = 50 %")
    assert every[4].startswith("3 of 3 = 100 %")
    assert every[6] == "1"
    assert every[7].startswith("0 of 1")


def test_the_exponent_of_a_k92_has_its_std() -> None:
    assert exponent(Estimate(0.1, 0.01), 0.5) == pytest.approx([4.6052, 0.2])
    assert exponent(Estimate(0.0, 0.01), 0.5) == [None, None]


def test_the_page_counts_names_by_sort_and_says_what_could_not_be_seen() -> None:
    null = of_names(effect="none", kind="null", outcome="false_alarm", right=False)
    unseen = of_names(effect="imu_tilt", status="not made", error="the design shows no size of 'imu_tilt'")
    old = of_names(code="old")
    (every, one) = name_rows([null, of_names()])
    assert every[1:] == one[1:]
    assert every[1].startswith("1 of 1 = 100 %")
    assert every[2] == "–"
    assert every[3].startswith("0 of 1 = 0 %")
    smaller = of_names(reached={"bulldozing": 1.4}, right=False, outcome="missed")
    assert name_rows([smaller, of_names(reached={"bulldozing": 5.0})])[0][1:3] == [
        "1 of 1 = 100 % (21–100)", "0 of 1 = 0 % (0–79)",
    ]  # fmt: skip
    text = page([old, of_law(run(0.0)), null, unseen, of_names()])
    assert "2 sets of four runs" in text
    assert "could be seen in 1 sets: imu_tilt (" in text
    assert f"| {SEARCHED} | joystick, not logged, controller of the file | none | – | false alarm |" in text


@pytest.mark.usefixtures("fits_by_slip", "two_variants")
def test_a_set_is_made_and_judged_as_json_holds_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.joystick.drive", lambda seed: drive(seed) | {"controller": "unknown"})
    line = law(7)
    assert json.loads(json.dumps(line, allow_nan=False)) == line
    assert line["status"] == "judged"
    assert len(line["runs"]) == 2
    assert all(r["slip"] and abs(r["slip"][0] - r["true"]) < 6 * r["slip"][1] for r in line["runs"])
