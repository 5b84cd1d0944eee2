"""What a search for the missing effect adds to a recording, read back."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np
import pytest

from granite_lab.discovery.finding import Finding
from granite_lab.reporting.recording import record_study, record_trial
from granite_lab.results import TrialResult
from tests.recording.read_back import ReadBack
from tests.reporting.made_up import made_up_study, made_up_trial
from tests.reporting.made_up_finding import BUMP, CHANNELS, START, made_up_finding

NANOSECOND = 0.6e-9
DEGREE = 180 / np.pi
LATE = START - 102.0
"""The search starts the command so much later than the comparison [s]."""


@pytest.fixture(scope="module")
def path(trial: TrialResult, finding: Finding, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("discovered")
    return record_trial(trial.trial, trial.comparison, folder / "trial.rrd", finding=finding)


@pytest.fixture(scope="module")
def back(path: Path) -> ReadBack:
    return ReadBack(path)


def test_disagreements_are_bars_on_the_trials_own_clock(trial: TrialResult, back: ReadBack) -> None:
    lane = "/simulation_differs/pitch_rate"
    assert back.texts(lane, "StateChange:state") == ["none", "35 %", "none"]
    np.testing.assert_allclose(
        back.t(lane), [trial.comparison.t[0], BUMP[0] + LATE, BUMP[1] + LATE], atol=NANOSECOND
    )
    colours = back.fixed(lane, "StateConfiguration:colors")
    assert colours[0] != colours[1]


def test_bars_end_do_not_overlap_and_stay_within_the_log(
    trial: TrialResult, finding: Finding, tmp_path: Path
) -> None:
    one = next(d for d in finding.where if d.variant == 0.3)
    where = [
        dataclasses.replace(one, start=start - LATE, end=end - LATE, share=share)
        for start, end, share in ((2.0, 4.0, 0.2), (3.0, 5.0, 0.4), (50.0, 60.0, 0.6))
    ]
    found = dataclasses.replace(finding, where=tuple(where))
    path = record_trial(trial.trial, trial.comparison, tmp_path / "a.rrd", finding=found)
    back, lane = ReadBack(path), "/simulation_differs/pitch_rate"
    assert back.texts(lane, "StateChange:state") == ["none", "20 %", "40 %", "none"]
    np.testing.assert_allclose(back.t(lane), [trial.comparison.t[0], 2.0, 3.0, 5.0], atol=NANOSECOND)
    values, visible = (back.fixed(lane, f"StateConfiguration:{k}") for k in ("values", "visible"))
    assert dict(zip(values, visible, strict=True)) == {"none": False, "20 %": True, "40 %": True}


def test_a_disagreement_at_another_speed_is_not_this_trials(back: ReadBack) -> None:
    assert not [e for e in back.entities() if "motor" in e and "simulation_differs" in e]


def test_simulations_before_and_after_stand_beside_what_was_measured(
    trial: TrialResult, finding: Finding, back: ReadBack
) -> None:
    own = {r.channel: r for r in finding.residuals if r.trial == trial.trial.name}
    assert set(own) == set(CHANNELS)
    r = own["pitch_rate"]
    np.testing.assert_allclose(back.scalars("/found_pitch_rate/measured"), DEGREE * r.measured)
    model = back.scalars("/found_pitch_rate/from_model")
    np.testing.assert_allclose(model, DEGREE * np.column_stack([r.before, r.after]))
    np.testing.assert_allclose(back.t("/found_pitch_rate/from_model"), r.t + LATE, atol=NANOSECOND)
    names = back.fixed("/found_pitch_rate/from_model", "Measurements:names")
    assert names == ["without the effect", "with the effect"]
    r = own["wheel"]
    np.testing.assert_allclose(
        back.scalars("/found_wheel/from_model"),
        DEGREE * np.column_stack([r.measured - r.before, r.measured - r.after]),
    )


def test_a_gap_in_the_log_is_a_gap_in_the_line(back: ReadBack) -> None:
    assert np.isnan(back.scalars("/found_accel_x/measured")[42])
    assert np.isfinite(back.scalars("/found_accel_x/from_model")[42]).all()


def test_log_lines_name_what_is_missing_and_where(back: ReadBack) -> None:
    lines = back.texts("/events", "TextLog:text")
    (missing,) = [line for line in lines if "missing from the model" in line]
    assert "ear wheels in the compacted rut (pressure 0.300 ± 0.004" in missing
    (where,) = [line for line in lines if "% of its rms" in line]
    assert "simulated pitch rate differs from the measured one by 35 % of its rms, 0.53 s to 1.53 s" in where
    assert [line for line in lines if "IMU stamps 4.0 ± 1.0\u00a0ms behind those of wheels" in line]
    levels = dict(zip(lines, back.texts("/events", "TextLog:level"), strict=True))
    assert levels[missing] == levels[where] == "WARN"


def test_nothing_found_is_said_and_no_after_is_drawn(trial: TrialResult, tmp_path: Path) -> None:
    path = record_trial(trial.trial, trial.comparison, tmp_path / "a.rrd", finding=made_up_finding("none"))
    back = ReadBack(path)
    assert not [e for e in back.entities() if "simulation_differs" in e]
    assert [
        line for line in back.texts("/events", "TextLog:text") if "Nothing that these trials show" in line
    ]
    assert back.scalars("/found_pitch_rate/from_model").ndim == 1
    assert back.fixed("/found_pitch_rate/from_model", "Measurements:names") == ["simulated"]


def test_a_trial_that_was_not_searched_has_no_bars_and_one_that_was_dropped_says_why(
    trial: TrialResult, tmp_path: Path
) -> None:
    finding = made_up_finding(names="another_{speed}_{repetition}")
    finding = dataclasses.replace(finding, dropped=((trial.trial.name, "no model fits it"),))
    back = ReadBack(record_trial(trial.trial, trial.comparison, tmp_path / "a.rrd", finding=finding))
    assert not [e for e in back.entities() if "found_" in e or "simulation_differs" in e]
    lines = back.texts("/events", "TextLog:text")
    assert [line for line in lines if "left out of the search: no model fits it" in line]


def test_a_study_shows_it_in_every_trial(tmp_path: Path, finding: Finding) -> None:
    study = made_up_study(speeds=(0.3, 0.7), repetitions=1)
    back = ReadBack(record_study(study, tmp_path / "study.rrd", finding=finding))
    for result in study.trials:
        root = f"/{result.trial.name}"
        assert f"{root}/found_current_r/from_model" in back.entities()
        assert f"{root}/simulation_differs/pitch_rate" in back.entities()


def test_it_still_takes_less_than_a_second_and_two_megabytes(finding: Finding, tmp_path: Path) -> None:
    result = made_up_trial(0.3)  # the longest of Table 2
    begin = time.process_time()
    path = record_trial(result.trial, result.comparison, tmp_path / "a.rrd", finding=finding)
    assert time.process_time() - begin <= 1.0
    assert path.stat().st_size <= 2_000_000
