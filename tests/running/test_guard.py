"""A defect in one part of what is written after a search loses nothing of the others."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pytest

import granite_lab.reporting
from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import Finding
from granite_lab.errors import LabError
from granite_lab.running import Options
from granite_lab.running.output import Guard, tell
from granite_lab.study import write, write_found
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import made_up_finding

PARTS = {
    "model": "granite_lab.running.search.save_model",
    "design": "granite_lab.planning.design.save_design",
    "report": "granite_lab.reporting.write.study_report",
}
FILES = {"model": "model.toml", "design": "design.json", "report": "index.html"}


def broken(*_: Any, **__: Any) -> NoReturn:
    raise ValueError("mean of\nan empty slice")


def found() -> Finding:
    return made_up_finding("named", speeds=(0.5,), repetitions=2)


def test_what_fails_is_one_line_that_names_the_traceback(tmp_path: Path) -> None:
    guard = Guard(tmp_path)
    assert guard.run("first", lambda: 3) == 3
    assert guard.run("second", broken) is None
    assert guard.run("third", lambda: 4) == 4
    assert guard.lines == [
        f"second: ValueError: mean of an empty slice; the traceback is in {tmp_path / 'failure-second.txt'}"
    ]
    assert "in broken" in (tmp_path / "failure-second.txt").read_text(encoding="utf-8")
    with pytest.raises(LabError, match="second: ValueError"):
        tell(guard.lines)
    Guard(tmp_path).run("second", lambda: 5)
    assert not (tmp_path / "failure-second.txt").exists()  # it was mended


def test_known_trouble_needs_no_traceback_and_an_interruption_is_none_of_it(tmp_path: Path) -> None:
    def full() -> None:
        raise LabError("x: cannot be written", "free some space")

    def stop() -> None:
        raise KeyboardInterrupt

    guard = Guard(tmp_path)
    guard.run("model", full)
    assert guard.lines == ["model: x: cannot be written (free some space)"]
    assert not list(tmp_path.iterdir())
    with pytest.raises(KeyboardInterrupt):
        guard.run("report", stop)


@pytest.mark.parametrize("part", list(PARTS))
def test_a_search_keeps_all_but_the_part_that_fails(
    part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PARTS[part], broken)
    study = made_up_study(speeds=(0.5,), repetitions=2)
    trials = [r.trial for r in study.trials]
    motions = [r.comparison.motion for r in study.trials]
    written = write_found(found(), Options(), trials, motions, tmp_path, study.source)
    (line,) = written.failures
    assert line.startswith(f"{part}: ValueError: mean of an empty slice; the traceback is in ")
    there = {path.name for path in tmp_path.iterdir()}
    assert there >= {FILES[p] for p in PARTS if p != part} | {"finding.json", f"failure-{part}.txt"}
    assert FILES[part] not in there
    document = json.loads((tmp_path / "finding.json").read_text(encoding="utf-8"))
    assert document["effects"] == json.loads(json.dumps(finding_as_json(found())["effects"]))
    assert document["failures"] == [line]


def test_a_study_keeps_the_rest_of_its_report_when_the_search_cannot_be_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("granite_lab.reporting.report._missing", broken)
    study = replace(made_up_study(speeds=(0.5,), repetitions=2), finding=found())
    written = write(study, Options(), tmp_path)
    assert written.page == tmp_path / "index.html"
    assert [line.partition(":")[0] for line in written.failures] == ["report"]
    assert json.loads((tmp_path / "finding.json").read_text(encoding="utf-8"))["verdict"] == "named"
    assert "see finding.json" in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_a_study_whose_report_fails_keeps_the_finding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(granite_lab.reporting, "write_report", broken, raising=False)
    study = replace(made_up_study(speeds=(0.5,), repetitions=2), finding=found())
    assert write(study, Options(), tmp_path).page is None
    assert json.loads((tmp_path / "finding.json").read_text(encoding="utf-8"))["verdict"] == "named"
    assert (tmp_path / "model.toml").exists()
