"""The answers of another program are understood; rows and shares say what is right."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.judging import judged, named, wrong_name
from benchmarks.outside import answers_of, row, summary

OUTSIDE = Path(__file__).parent.parent / "data" / "outside"


def line(verdict: str, *sets: tuple[str, ...], **more: Any) -> dict[str, Any]:
    effects = [
        {"id": first, "indistinguishable_from": list(twins), "parameters": {}} for first, *twins in sets
    ]
    return {"status": "judged", "verdict": verdict, "effects": effects, "gap": {}, "seconds": 3.0} | more


def test_the_answers_cover_the_sets_and_say_what_is_hidden() -> None:
    answers = answers_of(OUTSIDE)
    assert set(answers) == {path.name for path in OUTSIDE.iterdir() if path.is_dir()}
    assert answers["o01"]["effects"] == []
    assert [effect["id"] for effect in answers["o03"]["effects"]] == ["drive_reaction"]


@pytest.mark.parametrize(
    ("answer", "finding", "outcome", "right"),
    [
        ("none", line("none"), "right", True),
        ("com_offset", line("named", ("drive_reaction",)), "near_twin", False),
        ("unknown", line("unknown"), "abstained", True),
        ("unknown", line("named", ("rolling_drag",), remainder=0.5), "wrong_name", False),
        ("com_offset+unknown", line("named", ("com_offset",), remainder=0.4), "with_remainder", True),
        ("com_offset+unknown", line("named", ("com_offset",), remainder=0.02), "partial", False),
        ("none", {"status": "crashed", "error": "Traceback", "seconds": 1.0}, "crashed", False),
    ],
)
def test_a_set_is_judged_by_its_answer(
    tmp_path: Path, answer: str, finding: dict[str, Any], outcome: str, right: bool
) -> None:
    (tmp_path / "answers.json").write_text(json.dumps({"a": {"answer": answer}}))
    told = answers_of(tmp_path)["a"]
    found = judged(finding, told)
    assert (found["outcome"], found["right"]) == (outcome, right)
    shown = row("a", told, found)
    assert answer in shown
    assert named(found) in shown
    assert ("WRONG" in shown) is not right


def test_the_shares_come_with_their_intervals() -> None:
    nothing: dict[str, Any] = {"effects": []}
    drag = {"effects": [{"id": "rolling_drag", "library": True, "parameters": {}}]}
    answers = [nothing, nothing, drag]
    closed = {"held_out": {"before": 3.0, "after": 1.2, "floor": 1.0}}
    found = [line("none"), line("unknown"), line("named", ("bulldozing",), gap=closed)]
    lines = [judged(one, answer) for one, answer in zip(found, answers, strict=True)]
    text = summary(lines, answers)
    assert "right, or in a stated set of twins: 1 of 3 (6 to 79 %)" in text  # Wilson 1927
    assert "wrong name: 1 of 3" in text
    assert "none where nothing is missing: 1 of 2" in text
    assert "crashed or refused: 0 of 3" in text
    assert "median 90 %, least 90 %" in text
    assert [wrong_name(one) for one in lines] == [False, False, True]
