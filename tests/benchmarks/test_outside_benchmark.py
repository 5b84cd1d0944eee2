"""Answers of another program are understood and judged; variants change the logger, not the motion."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmarks.judging import document_of, judged, named, wrong_name
from benchmarks.outside import answers_of, main, row, summary
from benchmarks.outside_variants import IMU, VARIANTS, WHEELS, of_imu, write
from benchmarks.peers import one
from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import Ceiling
from granite_lab.estimate import Estimate
from granite_lab.hidden.scoring import score
from granite_lab.logs import read_trial
from tests.reporting.made_up_finding import made_up_finding

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
    ("law", "ids"),
    [
        ("paper", ["multi_pass"]),
        ("Wong-Reece", ["multi_pass", "stress_ahead"]),
        ("exit_by_sinkage", ["multi_pass", "exit_by_sinkage"]),
    ],
)
def test_a_law_of_the_soil_is_the_effect_that_it_is(tmp_path: Path, law: str, ids: list[str]) -> None:
    told = {"m01": {"library": ["multi_pass"], "soil_law": law}}
    (tmp_path / "answers.json").write_text(json.dumps(told))
    answer = answers_of(tmp_path)["m01"]
    assert [effect["id"] for effect in answer["effects"]] == ids
    assert all(effect["library"] for effect in answer["effects"])


def test_an_unknown_law_of_the_soil_is_one_line_that_names_the_set_and_the_known_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = {"m07": {"library": [], "soil_law": "Hertz"}}
    (tmp_path / "answers.json").write_text(json.dumps(told))
    monkeypatch.setattr("sys.argv", ["outside", str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        main()
    message, hint = str(ended.value).split("\n")
    assert message == f"error: {tmp_path / 'answers.json'}: set 'm07': unknown law of the soil 'Hertz'"
    assert hint.startswith("hint: known: paper, Wong-Reece, ")
    assert "shear_softening" in hint
    line = one(str(tmp_path / "m07"))  # beside peers, each set is a line
    assert (line["status"], line["key"]) == ("refused", "m07")
    assert line["error"].startswith("unknown law of the soil 'Hertz'")


@pytest.mark.parametrize(
    ("answer", "finding", "outcome", "right"),
    [
        ("none", line("none"), "right", True),
        ("com_offset", line("named", ("drive_reaction",)), "near_twin", False),
        ("unknown", line("unknown"), "abstained", True),
        ("unknown", line("named", ("rolling_drag",), remainder=0.5), "wrong_name", False),
        ("com_offset+unknown", line("named", ("com_offset",), remainder=0.4), "with_remainder", True),
        ("com_offset+unknown", line("named", ("com_offset",), remainder=0.02), "partial", False),
        ("com_offset+unknown", line("partly named", ("com_offset",), remainder=0.02), "with_remainder", True),
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


@pytest.mark.parametrize(
    ("ceiling", "closed", "outcome"),
    [(0.8, 0.0, "idle"), (0.1, 0.0, "abstained"), (0.8, 0.5, "abstained"), (None, 0.0, "abstained")],
)
def test_nothing_named_and_nothing_closed_where_forces_could_close_much_is_no_right_answer(
    ceiling: float | None, closed: float, outcome: str
) -> None:
    most = None if ceiling is None else Ceiling(ceiling, 1.0, {}, {}, ())
    shares = {"trials": Estimate(closed, 0.02), "speeds": Estimate(closed, 0.02)}
    finding = replace(made_up_finding("unknown"), ceiling=most, closed=shares)
    answer = {"effects": [{"id": "unknown", "library": False, "parameters": {}}]}
    assert score(answer, finding_as_json(finding)).outcome == outcome  # what `reveal` says
    found = judged(document_of(finding) | {"status": "judged"}, answer)
    assert (found["outcome"], found["right"]) == (outcome, outcome == "abstained")


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


@pytest.fixture(scope="module")
def source() -> Path:
    return min(OUTSIDE.glob("*/trial_0.5_*.csv"))


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_is_a_log_of_the_same_motion(name: str, source: Path, tmp_path: Path) -> None:
    change, _ = VARIANTS[name]
    write(source, tmp_path / source.name, change, np.random.default_rng(1))
    before, after = read_trial(source), read_trial(tmp_path / source.name)
    t = after.wheels.t
    for k, wheel in enumerate(WHEELS):
        sign = -1.0 if (name, wheel) == ("reversed_wheel", "rr") else 1.0
        then = np.interp(t, before.wheels.t, before.wheels.angle[:, k])
        np.testing.assert_allclose(sign * after.wheels.angle[:, k], then, atol=4e-3)


def changed_rows(change: Callable[..., pd.DataFrame], log: pd.DataFrame) -> np.ndarray:
    out = change(log, np.random.default_rng(1))
    return np.asarray((out[log.columns] != log).to_numpy() & log.notna().to_numpy())


def test_only_what_a_variant_names_is_changed(source: Path) -> None:
    log = pd.read_csv(source, comment="#")
    imu = of_imu(log)
    assert changed_rows(VARIANTS["noisy"][0], log)[imu][:, 1:7].all()
    assert not changed_rows(VARIANTS["noisy"][0], log)[~imu].any()
    assert changed_rows(VARIANTS["spikes"][0], log).sum() == 5
    assert len(VARIANTS["slow"][0](log, np.random.default_rng(1))[IMU].dropna()) == imu.sum() // 2


def test_readings_thrown_off_change_no_unit_and_no_other_reading(source: Path, tmp_path: Path) -> None:
    for seed in range(5):
        write(source, tmp_path / source.name, VARIANTS["spikes"][0], np.random.default_rng(seed))
        before, after = read_trial(source), read_trial(tmp_path / source.name)
        for name in ("specific_force", "angular_rate"):
            apart = np.abs(getattr(after.imu, name) - getattr(before.imu, name)).max(axis=1)
            assert np.count_nonzero(apart > 1e-6) <= 3
        assert not any("converted" in warning for warning in after.warnings)
