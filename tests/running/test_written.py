"""What is written after a search: the same by `study` and `discover`; a defect in one part loses no other."""

import json
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pytest

import granite_lab as gl
import granite_lab.reporting
from granite_lab.chain import corrected, find_effect, search_key
from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import Finding
from granite_lab.effects.library import met
from granite_lab.errors import InputError, LabError, UsageError
from granite_lab.estimation.motion import Motion
from granite_lab.logs.trial import Trial
from granite_lab.options import Options
from granite_lab.planning.design import load_design
from granite_lab.results import StudyResult
from granite_lab.running.cache import trial_key
from granite_lab.running.output import Guard, raise_failed
from granite_lab.study_folder import save_finding, write
from tests.effects.example import EXAMPLE
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import made_up_finding
from tests.running.processes import SAMPLES

pytestmark = pytest.mark.usefixtures("one_picture")
LOG = SAMPLES / "virtual_v0.7_r1.csv"
SAID = ("# v_desired_mps", "# a_max_mps2", "# distance_m")
PARTS = {
    "model": "granite_lab.study_folder.save_model",
    "design": "granite_lab.planning.design.save_design",
    "report": "granite_lab.reporting.write_report",
}
FILES = {"model": "model.toml", "design": "design.json", "report": "index.html"}


def broken(*_: Any, **__: Any) -> NoReturn:
    raise ValueError("mean of\nan empty slice")


@pytest.fixture(scope="module")
def found() -> Finding:
    return made_up_finding("named", speeds=(0.5,), repetitions=2)


@pytest.fixture(scope="module")
def study(found: Finding) -> StudyResult:
    return replace(made_up_study(speeds=(0.5,), repetitions=2), finding=found)


def parts(study: StudyResult) -> list[tuple[Trial, Motion]]:
    return [(r.trial, r.motion) for r in study.trials]


def alone(study: StudyResult) -> StudyResult:
    """As `discover` has it: a search without trials."""
    return replace(study, trials=(), a_theta=None)


def test_what_was_commanded_is_recognised_and_a_plan_can_start_from_it(
    tmp_path: Path, study: StudyResult, found: Finding
) -> None:
    lines = LOG.read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "silent.csv").write_text("".join(line for line in lines if not line.startswith(SAID)))
    trial, _, motion = corrected(tmp_path / "silent.csv", Options())
    assert (trial.info.v_desired, trial.info.a_max, trial.info.distance) == (None, None, None)
    variant = motion.variant
    assert (variant.velocity, variant.acceleration, variant.distance) == (0.7, 2.4, 3.0)

    trials, motions = zip(*parts(study), strict=True)
    silent = [replace(t, info=replace(t.info, v_desired=None)) for t in trials]
    assert {r.trial for r in found.residuals} <= {t.name for t in silent}
    guard = Guard(tmp_path)
    save_finding(found, Options(), list(zip(silent, motions, strict=True)), guard)
    assert guard.lines == []
    driven = {d.variant for d in load_design(tmp_path / "design.json").driven}
    assert driven
    assert driven <= {m.variant for m in motions}


def test_study_and_discover_leave_the_same_for_a_plan_and_a_simulation(
    tmp_path: Path, study: StudyResult
) -> None:
    write(alone(study), Options(), tmp_path / "discover", parts(study))
    write(study, Options(), tmp_path / "study")
    for name in ("design.json", "model.toml"):
        assert (tmp_path / "discover" / name).read_bytes() == (tmp_path / "study" / name).read_bytes()


def test_another_tolerance_or_latency_is_another_search_but_not_another_estimate() -> None:
    plain, *others = Options(), Options(tolerance=0.05), Options(latency=0.03)
    for other in others:
        assert search_key(["x"], other) != search_key(["x"], plain)
        assert trial_key("w", LOG, other) == trial_key("w", LOG, plain)
    for other in (*others, Options(window=(1772366400.123456, math.inf)), Options(window=(-math.inf, 3.0))):
        assert Options.from_given([(key, str(value)) for key, value in other.given()]) == other
    assert plain.given() == ()


@pytest.mark.parametrize("options", [Options(tolerance=0.0), Options(tolerance=1.5), Options(latency=-1e-3)])
def test_a_tolerance_or_latency_that_makes_no_sense_is_refused(options: Options) -> None:
    with pytest.raises(UsageError, match="cannot be used"):
        find_effect([], options, motions=[])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A finding as `discover`, `discover --json`, `study` and `study --json` write it."""
    found = json.loads(json.dumps(finding_as_json(made_up_finding("named"))))
    for name, document in {
        "discover/finding.json": found,
        "said.json": found,
        "study/report.json": {"schema": "granite-lab/report/2", "discovery": found},
        "said-study.json": {"schema": "granite-lab/study/1", "discovery": found},
        "unsearched/report.json": {"schema": "granite-lab/report/2", "discovery": None},
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(json.dumps(document), encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("place", ["discover", "study", "said.json", "said-study.json", "study/report.json"])
def test_reveal_judges_what_either_wrote(folder: Path, place: str) -> None:
    opened = gl.reveal(SAMPLES, folder / place)
    assert opened.score == gl.reveal(SAMPLES, folder / "said.json").score
    assert opened.score.named == tuple(e.id for e in made_up_finding("named").effects)


def test_the_newer_of_two_counts_and_a_study_that_did_not_search_is_refused(folder: Path) -> None:
    study = folder / "study"
    (study / "finding.json").write_text("{")
    os.utime(study / "finding.json", (0, 0))
    assert gl.reveal(SAMPLES, study).score is not None
    os.utime(study / "report.json", (0, 0))
    os.utime(study / "finding.json", (9, 9))
    with pytest.raises(InputError, match=r"finding\.json: not JSON"):
        gl.reveal(SAMPLES, study)
    with pytest.raises(InputError, match="did not search") as refused:
        gl.reveal(SAMPLES, folder / "unsearched")
    assert "--no-discover" in refused.value.hint


def test_the_report_of_a_study_knows_the_user_s_own_effects(
    tmp_path: Path, study: StudyResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "my_effect.py"
    own.write_text(EXAMPLE)
    known: list[str] = []

    def noted(*_: object, **__: object) -> Path:
        known.extend(name for name in ("head_wind", "tyre_windup") if met(name))
        return tmp_path

    monkeypatch.setattr(granite_lab.reporting, "write_report", noted, raising=False)
    write(study, Options(effects=own), tmp_path / "report")
    assert known == ["head_wind", "tyre_windup"]


def test_what_fails_is_one_line_with_a_traceback_unless_known_or_an_interruption(tmp_path: Path) -> None:
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
    guard = Guard(tmp_path)
    assert guard.run("first", lambda: 3) == 3
    assert guard.run("second", broken) is None
    assert guard.run("third", lambda: 4) == 4
    assert guard.lines == [
        f"second: ValueError: mean of an empty slice; the traceback is in {tmp_path / 'failure-second.txt'}"
    ]
    assert "in broken" in (tmp_path / "failure-second.txt").read_text(encoding="utf-8")
    with pytest.raises(LabError, match="second: ValueError"):
        raise_failed(guard.lines)
    Guard(tmp_path).run("second", lambda: 5)
    assert not (tmp_path / "failure-second.txt").exists()  # it was mended


@pytest.mark.parametrize("part", list(PARTS))
def test_a_search_keeps_all_but_the_part_that_fails(
    part: str, tmp_path: Path, study: StudyResult, found: Finding, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PARTS[part], broken, raising=False)
    written = write(alone(study), Options(), tmp_path, parts(study)).written
    (line,) = written.failures
    assert line.startswith(f"{part}: ValueError: mean of an empty slice; the traceback is in ")
    there = {path.name for path in tmp_path.iterdir()}
    assert there >= {FILES[p] for p in PARTS if p != part} | {"finding.json", f"failure-{part}.txt"}
    assert FILES[part] not in there
    document = json.loads((tmp_path / "finding.json").read_text(encoding="utf-8"))
    assert document["effects"] == json.loads(json.dumps(finding_as_json(found)["effects"]))
    assert document["failures"] == [line]


def test_a_study_keeps_the_rest_of_its_report_when_the_search_cannot_be_shown(
    tmp_path: Path, study: StudyResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    from granite_lab.reporting import write_report

    def fails_with_a_finding(result: StudyResult, folder: Path, **options: Any) -> Path:
        if result.finding is not None:
            broken()
        return write_report(result, folder, **options)

    monkeypatch.setattr(granite_lab.reporting, "write_report", fails_with_a_finding, raising=False)
    written = write(study, Options(), tmp_path).written
    assert written.page == tmp_path / "index.html"
    assert [line.partition(":")[0] for line in written.failures] == ["report"]
    assert json.loads((tmp_path / "finding.json").read_text(encoding="utf-8"))["verdict"] == "named"
    assert "see finding.json" in (tmp_path / "index.html").read_text(encoding="utf-8")
    monkeypatch.setattr(granite_lab.reporting, "write_report", broken, raising=False)
    assert write(study, Options(), tmp_path / "none").written.page is None
    assert (tmp_path / "none" / "finding.json").exists()
    assert (tmp_path / "none" / "model.toml").exists()
