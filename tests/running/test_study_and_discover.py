"""A search is the same whether `study` or `discover` runs it, and what it leaves serves the same commands."""

from __future__ import annotations

import importlib
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import granite_lab as gl
from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import Finding
from granite_lab.errors import InputError, UsageError
from granite_lab.planning.design import load_design
from granite_lab.running import Cache, Execution, Options, each_trial
from granite_lab.running.cache import trial_key
from granite_lab.running.output import Guard
from granite_lab.running.reading import corrected
from granite_lab.running.search import save_found, search, search_key
from granite_lab.study import write_found
from tests.effects.example import EXAMPLE
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import made_up_finding
from tests.running.processes import SAMPLES

chain = importlib.import_module("granite_lab.study")  # the package has a function of that name
LOG = SAMPLES / "virtual_v0.7_r2.csv"
SAID = ("# v_desired_mps", "# a_max_mps2", "# distance_m")


@pytest.fixture
def silent(tmp_path: Path) -> Path:
    """A log that does not say what was commanded."""
    lines = LOG.read_text(encoding="utf-8").splitlines(keepends=True)
    path = tmp_path / "silent.csv"
    path.write_text("".join(line for line in lines if not line.startswith(SAID)), encoding="utf-8")
    return path


def test_what_was_commanded_is_recognised_and_remembered(
    silent: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    how = Execution(1, cache=Cache(tmp_path / "cache"))
    recognised = each_trial(corrected, [silent], Options(), execution=how)[0]
    assert isinstance(recognised, tuple)
    trial, motion = recognised
    assert (trial.info.v_desired, trial.info.a_max, trial.info.distance) == (None, None, None)
    variant = motion.variant
    assert (variant.velocity, variant.acceleration, variant.distance) == (0.7, 2.4, 3.0)

    def again(*_: object, **__: object) -> None:
        raise AssertionError("estimated again")

    monkeypatch.setattr("granite_lab.estimation.correct", again)
    assert isinstance(each_trial(corrected, [silent], Options(), execution=how)[0], tuple)


def found_in_made_up_study() -> Finding:
    """Return a finding in the trials of `made_up_study(speeds=(0.5,), repetitions=2)`."""
    return made_up_finding("named", speeds=(0.5,), repetitions=2)


def test_a_plan_can_start_from_trials_whose_command_was_recognised(tmp_path: Path) -> None:
    study = made_up_study(speeds=(0.5,), repetitions=2)
    finding = found_in_made_up_study()
    trials = [replace(r.trial, info=replace(r.trial.info, v_desired=None)) for r in study.trials]
    motions = [r.comparison.motion for r in study.trials]
    names = {r.trial for r in finding.residuals}
    assert names <= {t.name for t in trials}
    guard = Guard(tmp_path)
    save_found(finding, Options(), trials, motions, guard)
    assert guard.lines == []
    driven = {d.variant for d in load_design(tmp_path / "design.json").driven}
    assert driven <= {m.variant for m in motions}
    assert driven


def test_study_and_discover_leave_the_same_for_a_plan_and_a_simulation(tmp_path: Path) -> None:
    finding = found_in_made_up_study()
    study = replace(made_up_study(speeds=(0.5,), repetitions=2), finding=finding)
    trials = [r.trial for r in study.trials]
    motions = [r.comparison.motion for r in study.trials]
    write_found(finding, Options(), trials, motions, tmp_path / "discover", study.source)
    chain.write(study, Options(), tmp_path / "study")
    for name in ("design.json", "model.toml"):
        assert (tmp_path / "discover" / name).read_bytes() == (tmp_path / "study" / name).read_bytes()


def test_another_tolerance_or_latency_is_another_search_but_not_another_estimate() -> None:
    plain, *others = Options(), Options(tolerance=0.05), Options(latency=0.03)
    for other in others:
        assert search_key([b"x"], other) != search_key([b"x"], plain)
        assert trial_key("w", LOG, other) == trial_key("w", LOG, plain)
        assert Options.from_given(other.given()) == other
    assert plain.given() == ()


@pytest.mark.parametrize("options", [Options(tolerance=0.0), Options(tolerance=1.5), Options(latency=-1e-3)])
def test_a_tolerance_or_latency_that_makes_no_sense_is_refused(options: Options) -> None:
    with pytest.raises(UsageError, match="cannot be used"):
        search([], options, motions=[])


def documents(folder: Path) -> dict[str, Any]:
    """Write a finding as `discover`, `discover --json`, `study` and `study --json` do."""
    found = json.loads(json.dumps(finding_as_json(made_up_finding("named"))))
    return {
        "discover/finding.json": found,
        "said.json": found,
        "study/report.json": {"schema": "granite-lab/report/2", "discovery": found},
        "said-study.json": {"schema": "granite-lab/study/1", "discovery": found},
    }


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, document in documents(tmp_path).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(json.dumps(document), encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("place", ["discover", "study", "said.json", "said-study.json", "study/report.json"])
def test_reveal_judges_what_either_wrote(folder: Path, place: str) -> None:
    opened = gl.reveal(SAMPLES, folder / place)
    assert opened.score is not None
    assert opened.score == gl.reveal(SAMPLES, folder / "said.json").score
    assert opened.score.named == tuple(e.id for e in made_up_finding("named").effects)


def test_the_newer_of_two_counts(folder: Path) -> None:
    study = folder / "study"
    (study / "finding.json").write_text("{")
    os.utime(study / "finding.json", (0, 0))
    assert gl.reveal(SAMPLES, study).score is not None
    os.utime(study / "report.json", (0, 0))
    os.utime(study / "finding.json", (9, 9))
    with pytest.raises(InputError, match=r"finding\.json: not JSON"):
        gl.reveal(SAMPLES, study)


def test_a_study_that_did_not_search_is_refused_with_what_to_do(tmp_path: Path) -> None:
    text = json.dumps({"schema": "granite-lab/report/2", "discovery": None})
    (tmp_path / "report.json").write_text(text)
    with pytest.raises(InputError, match="did not search") as refused:
        gl.reveal(SAMPLES, tmp_path)
    assert "--no-discover" in refused.value.hint


def test_the_report_of_a_study_knows_the_user_s_own_effects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import granite_lab.reporting

    own = tmp_path / "my_effect.py"
    own.write_text(EXAMPLE)
    known: list[str] = []

    def noted(*_: object, effects: list[str], **__: object) -> Path:
        known.extend(effects)
        return tmp_path

    monkeypatch.setattr(granite_lab.reporting, "write_report", noted, raising=False)
    finding = found_in_made_up_study()
    result = replace(made_up_study(speeds=(0.5,), repetitions=2), finding=finding)
    chain.write(result, Options(effects=own), tmp_path / "report")
    assert "head_wind" in known
    assert "tyre_windup" in known
