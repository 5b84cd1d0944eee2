"""A report says nothing of what its trials do not tell."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from granite_lab.comparison.compare import Comparison
from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate, mean_over, weights_of
from granite_lab.fitting import fit_a_theta
from granite_lab.fitting.fit import K92_STEADY, K92_TRAJECTORY
from granite_lab.reporting import write_report
from granite_lab.reporting.answers import of_study
from granite_lab.reporting.json_report import k92_as_json
from granite_lab.results import StudyResult
from tests.reporting.made_up import made_up_study


def known_to(c: Comparison, std: float, **fit: Any) -> Comparison:
    """Return the trial with a λ_R that is known to `std`."""
    slip = Estimate(c.motion.slip_ratio.value, std)
    whole = Estimate(c.motion.distance.value, std * abs(c.motion.distance_wheels.value))
    motion = replace(c.motion, slip_ratio=slip, distance=whole)
    return replace(c, motion=motion, fit=replace(c.fit, slip_measured=slip, **fit))


def vague(std: float = 0.13, **fit: Any) -> StudyResult:
    study = made_up_study()
    trials = tuple(known_to(r, std, **fit) for r in study.trials)
    return replace(study, trials=trials, a_theta=None, finding=None)


def test_without_a_known_slip_nothing_is_said_of_k92_model_or_effects(tmp_path: Path) -> None:
    answers = of_study(vague())
    assert answers.slip_unknown
    assert [a.id for a in answers.questions] == ["slip", "k92", "trust", "next"]
    k92 = answers.questions[1]
    assert k92.text.startswith("k_92 cannot be determined from these trials, because λ_R of")
    assert "± 13 points only" in k92.text
    assert "--use-reference" in answers.questions[-1].text
    written = write_report(vague(), tmp_path / "report").with_name("report.md")
    page = written.read_text(encoding="utf-8").replace("\\", "")
    assert "k_92 cannot be determined" in page
    for word in ("a_θ", "Model and measurement", "What is missing", "paper's k_92"):
        assert word not in page, word
    assert not (tmp_path / "report" / "figures" / "k92_over_velocity.svg").exists()


def test_one_known_slip_ends_the_silence() -> None:
    study = vague()
    first, *others = made_up_study().trials[0], *study.trials[1:]
    answers = of_study(replace(study, trials=(first, *others)))
    assert not answers.slip_unknown
    assert [a.id for a in answers.questions][:3] == ["slip", "a_theta", "model"]
    noted = [s.k92_note for s in answers.speeds]
    assert noted.count("") == 1
    assert set(noted) == {"", "not known"}


def test_a_study_in_which_every_k92_is_at_a_bound_says_what_the_model_reaches() -> None:
    curve = ((0.0, 0.31), (0.5, 0.12), (1.0, 0.021))
    study = vague(0.01, status="at_lower_bound", curve=curve)
    answers = of_study(study)
    assert not answers.slip_unknown
    text = answers.questions[1].text
    assert "lies above the 2.1 to 31 % that the model reaches on this soil" in text
    assert "the model reaches a slip of 2.1 to 31 %" in answers.questions[0].text
    assert {s.k92_note for s in answers.speeds} == {"at its limit"}
    fit = study.trials[0].fit
    assert K92_STEADY.cell(fit).text == "at lower limit"
    assert math.isnan(K92_STEADY.cell(fit).raw[0])
    assert math.isnan(k92_as_json(fit)["k92"]["value"])
    assert math.isnan(fit.to_frame()["k92"][0])


@pytest.mark.parametrize(
    ("k92", "text"),
    [
        (Estimate(9e-11, 4e-11), "at lower limit"),
        (Estimate(0.4, 170.0), "not known"),
        (Estimate(0.412, 0.01), "0.412 ± 0.010"),
    ],
)
def test_a_k92_by_the_trajectory_that_tells_nothing_is_no_number(k92: Estimate, text: str) -> None:
    fit = replace(made_up_study().trials[0].fit, k92_trajectory=k92, status_trajectory="ok")
    assert K92_TRAJECTORY.cell(fit).text == text


def test_no_a_theta_without_a_known_slip() -> None:
    with pytest.raises(EstimateError, match="known to 5 points"):
        fit_a_theta([r.fit for r in vague().trials])


def test_what_is_hardly_known_enters_a_mean_by_its_weight_only() -> None:
    known = [Estimate(0.05, 0.01), Estimate(0.052, 0.01)]
    wild = [*known, Estimate(0.95, 0.5)]
    assert mean_over(known, 0.05) == mean_over(known)
    assert mean_over(wild).value > 0.3
    mean = mean_over(wild, 0.05)
    assert mean.value == pytest.approx(0.051, abs=0.002)
    assert mean.n == 3
    assert 0.9 * 0.01 / math.sqrt(2) < mean.std < 0.02
    assert weights_of(known, 0.05) == [0.5, 0.5]
    assert sum(weights_of(wild, 0.05)) == pytest.approx(1.0)
    # where all are vague and scatter by more than they say, they count nearly the same
    far = [Estimate(-0.9, 0.06), Estimate(0.1, 0.08), Estimate(1.0, 0.07)]
    assert weights_of(far, 0.05) == pytest.approx([1 / 3] * 3, abs=0.01)
    assert weights_of([]) == []


def test_the_first_screen_names_what_was_assumed() -> None:
    study = made_up_study()
    assert "Assumed" not in of_study(study).lead
    unnamed = [
        replace(r, trial=replace(r.trial, info=replace(r.trial.info, soil=None))) for r in study.trials
    ]
    lead = of_study(replace(study, trials=tuple(unnamed))).lead
    assert "Assumed, because no log and no option says it: the soil is dry sand" in lead
    assert "(--soil says which)" in lead
    said = replace(study.source, options=(("soil", "dry_sand"),))
    assert "Assumed" not in of_study(replace(study, trials=tuple(unnamed), source=said)).lead
