"""Judging discoveries: every outcome from a table of answers and findings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from granite_lab.errors import InputError
from granite_lab.hidden.scoring import read_finding, score
from granite_lab.hidden.sealed import open_answer, seal, unseal


def answer(*ids: str, library: bool = True) -> dict[str, Any]:
    parameters = {"size": {"value": 2.0, "unit": "N", "kind": "exact"}}
    return {"effects": [{"id": name, "library": library, "parameters": parameters} for name in ids]}


def finding(verdict: str, *effects: tuple[str, ...], **gap: Any) -> dict[str, Any]:
    return {
        "schema": "granite-lab/discovery/2",
        "verdict": verdict,
        "effects": [
            {
                "id": first,
                "parameters": {"size": {"value": 2.5, "std": 0.25, "unit": "N"}},
                "indistinguishable_from": list(twins),
            }
            for first, *twins in effects
        ],
        "gap": gap,
    }


@pytest.mark.parametrize(
    ("hidden", "found", "outcome", "right"),
    [
        (answer(), finding("none"), "right", True),
        (answer(), finding("named", ("a",)), "false_alarm", False),
        (answer(), finding("unknown"), "false_alarm", False),
        (answer("a"), finding("none"), "missed", False),
        (answer("a"), finding("unknown"), "abstained", False),
        (answer("a"), finding("named"), "abstained", False),
        (answer("a"), finding("named", ("a",)), "right", True),
        (answer("a"), finding("named", ("a", "b")), "right", True),
        (answer("a"), finding("named", ("b", "a")), "twin_set", True),
        (answer("a"), finding("named", ("b", "a", "c")), "twin_set", True),
        (answer("a"), finding("named", ("b", "a", "c", "d")), "vague", False),
        (answer("a"), finding("named", ("a", "b", "c", "d")), "vague", False),
        (answer("a"), finding("named", ("b",)), "wrong_name", False),
        (answer("a"), finding("named", ("b", "c")), "wrong_name", False),
        (answer("a"), finding("named", ("a",), ("b",)), "spurious", False),
        (answer("a"), finding("named", ("b",), ("c", "a")), "spurious", False),
        (answer("a", "b"), finding("named", ("b",), ("a",)), "right", True),
        (answer("a", "b"), finding("named", ("c", "b"), ("a",)), "twin_set", True),
        (answer("a", "b"), finding("named", ("b", "a"), ("a", "b")), "right", True),
        (answer("a", "b"), finding("named", ("b", "a")), "partial", False),
        (answer("a", "b"), finding("named", ("a",), ("c",)), "wrong_name", False),
        (answer("a", "b"), finding("named", ("c",), ("d",)), "wrong_name", False),
        (answer("a", "b"), finding("none"), "missed", False),
        (answer("com_offset"), finding("named", ("drive_reaction",)), "near_twin", False),
        (answer("com_offset"), finding("named", ("drive_reaction",), ("a",)), "wrong_name", False),
        (answer("x", library=False), finding("unknown"), "abstained", True),
        (answer("x", library=False), finding("none"), "missed", False),
        (answer("x", library=False), finding("named", ("a",)), "wrong_name", False),
    ],
)
def test_outcomes(hidden: dict[str, Any], found: dict[str, Any], outcome: str, right: bool) -> None:
    judged = score(hidden, found)
    assert (judged.outcome, judged.right) == (outcome, right)


def test_parameters_are_judged_where_the_name_is_right() -> None:
    (parameter,) = score(answer("a", "b"), finding("named", ("a",))).parameters
    assert (parameter.effect, parameter.true, parameter.value) == ("a", 2.0, 2.5)
    assert parameter.z == pytest.approx(2.0)
    assert parameter.relative == pytest.approx(0.25)
    assert score(answer("b"), finding("named", ("a",))).parameters == ()
    without = finding("named", ("a",))
    without["effects"][0]["parameters"]["size"]["std"] = None
    (parameter,) = score(answer("a"), without).parameters
    assert parameter.z is None
    assert parameter.relative == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("gap", "closed"),
    [
        ({"before": 5.0, "after": 1.4}, 0.9),
        ({"before": 5.0, "after": 5.0}, 0.0),
        ({"before": 5.0, "after": 6.0}, -0.25),
        ({"before": 1.0, "after": 1.0}, None),
        ({"before": None, "after": 1.0}, None),
        ({}, None),
    ],
)
def test_the_gap_closed_is_a_share_of_what_is_not_explained(gap: dict[str, Any], closed: float) -> None:
    judged = score(answer("a"), finding("named", ("a",), held_out=gap))
    assert judged.gap_closed["held_out"] == (None if closed is None else pytest.approx(closed))
    assert judged.gap_closed["train"] is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON"),
        ("[]", "expected schema"),
        ('{"schema": "granite-lab/fit/1"}', "expected schema"),
        ('{"schema": "granite-lab/discovery/2", "verdict": "maybe"}', "verdict is 'maybe'"),
        ('{"schema": "granite-lab/discovery/2", "verdict": "named", "effects": ["a"]}', "malformed"),
        (
            '{"schema": "granite-lab/discovery/2", "verdict": "named", "effects": [{"name": "a"}]}',
            "malformed",
        ),
    ],
)
def test_a_file_that_is_no_discovery_is_named(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "finding.json"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as error:
        read_finding(path)
    assert str(path) in error.value.message


def test_a_sealed_answer_opens_to_what_was_sealed_and_cannot_be_read_by_eye(tmp_path: Path) -> None:
    whole = {"effects": [{"id": "tyre_windup", "library": True}], "seed": 7, "μ": 0.5}
    data = seal(whole)
    assert unseal(data, "x") == whole
    assert b"tyre" not in data
    assert seal(whole) == data
    (tmp_path / "sealed.bin").write_bytes(data)
    assert open_answer(tmp_path) == whole
    assert json.dumps(whole)[:8].encode() not in data


@pytest.mark.parametrize("place", [70, 125, 150, -4])
def test_a_changed_seal_is_noticed(place: int) -> None:
    data = bytearray(seal({"effects": [], "seed": 3, "text": "a longer text, so that there is something"}))
    data[place] = ord("A") if data[place] != ord("A") else ord("B")
    with pytest.raises(InputError, match="damaged"):
        unseal(bytes(data), "x")


def test_a_folder_without_a_seal_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        open_answer(tmp_path)
    (tmp_path / "sealed.bin").write_bytes(b"something else")
    with pytest.raises(InputError, match="not a sealed answer"):
        open_answer(tmp_path)
