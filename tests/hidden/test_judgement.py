"""Answers, sealed and open, are read; every outcome of a judgement, from a table of answers."""

import base64
import hashlib
import json
import shutil
import tracemalloc
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import granite_lab as gl
from granite_lab.api.hidden import hide
from granite_lab.errors import InputError
from granite_lab.hidden.scoring import SCHEMA, read_finding, score
from granite_lab.hidden.sealed import HEAD, LARGEST, open_answer, seal, unseal
from tests.corpus.cli import lab, refused, succeeded

OUTSIDE = Path(__file__).parent.parent / "data" / "outside" / "o03"
REACTION = [{"id": "drive_reaction", "parameters": {"share": 0.8}}]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return trials of a simulator in C with their answer, as another laboratory hands them over."""
    shutil.copytree(OUTSIDE, tmp_path / "trials")
    written(tmp_path / "trials", REACTION)
    return tmp_path / "trials"


def written(folder: Path, effects: object) -> None:
    (folder / "answer.json").write_text(json.dumps({"effects": effects}))


def finding(folder: Path, verdict: str, *ids: str) -> Path:
    effects = [{"id": i, "parameters": {"share": {"value": 0.78, "std": 0.05}}} for i in ids]
    gap = {"train": {"before": 3.0, "after": 1.0}}
    document = {"schema": SCHEMA, "verdict": verdict, "effects": effects, "gap": gap}
    (folder / "finding.json").write_text(json.dumps(document))
    return folder / "finding.json"


@pytest.mark.parametrize(
    ("effects", "verdict", "ids", "outcome"),
    [
        (REACTION, "named", ("drive_reaction",), "right"),
        ([], "none", (), "right"),
        ([{"id": "unknown", "title": "magnets"}], "unknown", (), "abstained"),
    ],
)
def test_a_folder_with_logs_and_an_open_answer_is_enough_for_a_judgement(
    folder: Path, effects: list[dict[str, Any]], verdict: str, ids: tuple[str, ...], outcome: str
) -> None:
    written(folder, effects)
    file = finding(folder, verdict, *ids)
    opened = gl.reveal(folder, file)
    printed = succeeded("reveal", folder, "--finding", file).out
    assert "judgement: right" in printed
    assert "gap closed, trials in the fit: 100" in printed
    assert "[-]" not in printed
    assert opened.score.outcome == outcome
    assert opened.warnings == ()
    if outcome == "right" and ids:
        assert opened.score.parameters[0].true == 0.8
        assert opened.score.parameters[0].z == pytest.approx(-0.4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("[]", "expected an object"),
        ('{"effects": "none"}', "no answer that can be used"),
        ('{"effects": [{"id": "drive_reaction", "parameters": [1]}]}', "no answer that can be used"),
        ('{"effects": [{"id": "tire_windup"}]}', "unknown effect 'tire_windup'"),
        ('{"effects": [{"id": "unknown"}]}', "'unknown' has no title"),
        ('{"effects": [{"id": "drive_reaction", "parameters": {"size": 1}}]}', "has no parameter 'size'"),
        ('{"effects": [{"id": "drive_reaction", "parameters": {"share": "1"}}]}', "'1' is not a number"),
        ('{"effects": [{"id": "drive_reaction", "parameters": {"share": NaN}}]}', "nan is not a number"),
    ],
)
def test_an_open_answer_that_cannot_be_used_is_refused(folder: Path, text: str, message: str) -> None:
    (folder / "answer.json").write_text(text)
    done = lab("reveal", folder)
    refused(done, 3, message)
    assert f"{folder / 'answer.json'}: " in done.error


def test_of_two_answers_the_sealed_one_counts_and_changed_logs_are_told(folder: Path, tmp_path: Path) -> None:
    made = hide("none", tmp_path / "set", repetitions=1)
    written(tmp_path / "set", REACTION)
    made.trials[0].write_text("changed")
    made.trials[1].unlink()
    opened = gl.reveal(tmp_path / "set")
    assert opened.answer["effects"] == []
    assert opened.warnings == (
        f"{made.trials[0]}: has changed since it was written", f"{made.trials[1]}: is missing",
    )  # fmt: skip
    (folder / "answer.json").unlink()
    with pytest.raises(InputError, match=r"sealed\.bin: .*does not exist"):
        gl.reveal(folder)
    (folder / "sealed.bin").write_bytes(b"something else")
    with pytest.raises(InputError, match="not a sealed answer"):
        open_answer(folder)


def answer(*ids: str, library: bool = True) -> dict[str, Any]:
    parameters = {"size": {"value": 2.0, "unit": "N", "kind": "exact"}}
    return {"effects": [{"id": name, "library": library, "parameters": parameters} for name in ids]}


def verdict_of(verdict: str, *effects: tuple[str, ...], **gap: Any) -> dict[str, Any]:
    return {
        "schema": "granite-lab/discovery/3",
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
        (answer(), verdict_of("none"), "right", True),
        (answer(), verdict_of("named", ("a",)), "false_alarm", False),
        (answer(), verdict_of("unknown"), "false_alarm", False),
        (answer("a"), verdict_of("none"), "missed", False),
        (answer("a"), verdict_of("unknown"), "abstained", False),
        (answer("a"), verdict_of("named"), "abstained", False),
        (answer("a"), verdict_of("named", ("a",)), "right", True),
        (answer("a"), verdict_of("named", ("a", "b")), "right", True),
        (answer("a"), verdict_of("named", ("b", "a")), "twin_set", True),
        (answer("a"), verdict_of("named", ("b", "a", "c")), "twin_set", True),
        (answer("a"), verdict_of("named", ("b", "a", "c", "d")), "vague", False),
        (answer("a"), verdict_of("named", ("a", "b", "c", "d")), "vague", False),
        (answer("a"), verdict_of("named", ("b",)), "wrong_name", False),
        (answer("a"), verdict_of("named", ("b", "c")), "wrong_name", False),
        (answer("a"), verdict_of("named", ("a",), ("b",)), "spurious", False),
        (answer("a"), verdict_of("named", ("b",), ("c", "a")), "spurious", False),
        (answer("a", "b"), verdict_of("named", ("b",), ("a",)), "right", True),
        (answer("a", "b"), verdict_of("named", ("c", "b"), ("a",)), "twin_set", True),
        (answer("a", "b"), verdict_of("named", ("b", "a"), ("a", "b")), "right", True),
        (answer("a", "b"), verdict_of("named", ("b", "a")), "partial", False),
        (answer("a", "b"), verdict_of("named", ("a",), ("c",)), "wrong_name", False),
        (answer("a", "b"), verdict_of("named", ("c",), ("d",)), "wrong_name", False),
        (answer("a", "b"), verdict_of("none"), "missed", False),
        (answer("com_offset"), verdict_of("named", ("drive_reaction",)), "near_twin", False),
        (answer("com_offset"), verdict_of("named", ("drive_reaction",), ("a",)), "wrong_name", False),
        (answer("x", library=False), verdict_of("unknown"), "abstained", True),
        (answer("x", library=False), verdict_of("none"), "missed", False),
        (answer("x", library=False), verdict_of("named", ("a",)), "wrong_name", False),
    ],
)
def test_outcomes(hidden: dict[str, Any], found: dict[str, Any], outcome: str, right: bool) -> None:
    judged = score(hidden, found)
    assert (judged.outcome, judged.right) == (outcome, right)


def test_parameters_are_judged_where_the_name_is_right() -> None:
    (parameter,) = score(answer("a", "b"), verdict_of("named", ("a",))).parameters
    assert (parameter.effect, parameter.true, parameter.value) == ("a", 2.0, 2.5)
    assert parameter.z == pytest.approx(2.0)
    assert parameter.relative == pytest.approx(0.25)
    assert score(answer("b"), verdict_of("named", ("a",))).parameters == ()
    without = verdict_of("named", ("a",))
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
    judged = score(answer("a"), verdict_of("named", ("a",), held_out=gap))
    assert judged.gap_closed["held_out"] == (None if closed is None else pytest.approx(closed))
    assert judged.gap_closed["train"] is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON"),
        ("[]", "expected an object"),
        ('{"schema": "granite-lab/fit/1"}', "expected schema"),
        ('{"schema": "granite-lab/discovery/3", "verdict": "maybe"}', "verdict is 'maybe'"),
        ('{"schema": "granite-lab/discovery/3", "verdict": "named", "effects": ["a"]}', "malformed"),
        (
            '{"schema": "granite-lab/discovery/3", "verdict": "named", "effects": [{"name": "a"}]}',
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
    effect = {"id": "tyre_windup", "title": "x", "account": "", "library": True, "parameters": {}}
    whole = _answer(effects=[effect], seed=7) | {"μ": 0.5}
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


def test_a_sealed_answer_that_would_fill_the_memory_is_refused() -> None:
    body = base64.encodebytes(zlib.compress(bytes(10 * LARGEST), 9)[::-1])
    data = HEAD + hashlib.sha256(bytes(10 * LARGEST)).hexdigest().encode() + b"\n" + body
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="is damaged"):
            unseal(data, "sealed.bin")
        assert tracemalloc.get_traced_memory()[1] < 3 * LARGEST
    finally:
        tracemalloc.stop()


def _answer(**changes: Any) -> dict[str, Any]:
    effect = {"id": "x", "title": "", "account": "", "library": True, "parameters": {}}
    settings = {"seed": 1, "strength": 1.0, "noise": 1.0, "sand_off": {}}
    return settings | {"effects": [effect], "trials": {"a": {"sha256": "0"}}} | changes


@pytest.mark.parametrize(
    "changes",
    [
        {"trials": None},
        {"trials": {}},
        {"trials": {"a": {}}},
        {"trials": {"a": {"sha256": 1}}},
        {"effects": 1},
        {"effects": [{"id": "x"}]},
        {"effects": [_answer()["effects"][0] | {"parameters": {"p": 1}}]},
        {"effects": [_answer()["effects"][0] | {"parameters": {"p": {"value": "2", "unit": "m"}}}]},
    ],
)
def test_a_sealed_answer_that_lacks_something_is_told_in_one_line(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    assert unseal(seal(_answer()), "x") == _answer()
    (tmp_path / "sealed.bin").write_bytes(seal(_answer(**changes)))
    refused(lab("reveal", tmp_path), 3, "sealed.bin: the sealed answer is incomplete")


def test_several_names_are_counted_one_by_one() -> None:
    hidden = [
        {"id": name, "library": name != "unknown", "parameters": {}}
        for name in ("tyre_windup", "multi_pass", "bulldozing", "unknown")
    ]
    named = [
        {"id": "tyre_windup"},
        {"id": "rolling_drag", "indistinguishable_from": ["bulldozing"]},
        {"id": "com_offset"},
    ]
    document = {"verdict": "partly named", "effects": named, "remainder": 0.3}
    names = score({"effects": hidden}, document, 0.7).names
    assert names.right == ("bulldozing", "tyre_windup")
    assert names.missed == ("multi_pass",)
    assert names.wrong == ("com_offset",)
    assert names.absorbed == ()
    after_refit = {"tyre_windup": 0.05, "multi_pass": 0.09, "bulldozing": 0.4}
    answer = {"effects": hidden, "reopens_after_refit": after_refit}
    assert score(answer, document).names == replace(names, missed=(), absorbed=("tyre_windup", "multi_pass"))


@pytest.mark.parametrize(
    ("ceiling", "closed", "right"), [(0.5, 0.0, False), (0.5, 0.4, True), (0.1, 0.0, True)]
)
def test_an_answer_that_closes_nothing_although_much_could_be_closed_is_a_miss(
    ceiling: float, closed: float, right: bool
) -> None:
    answer = {"effects": [{"id": "unknown", "library": False, "parameters": {}}]}
    document = {
        "verdict": "unknown", "effects": [], "ceiling": {"value": ceiling},
        "closed": {"trials": {"value": closed, "std": 0.01}},
    }  # fmt: skip
    judged = score(answer, document)
    assert judged.right is right
    assert judged.outcome == ("abstained" if right else "idle")
