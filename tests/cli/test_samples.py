"""The sample trials against the truth that their generator kept aside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from granite_lab.fitting import fit_a_theta
from granite_lab.parameters.quantity import parse_toml
from granite_lab.reporting.content import TrialResult
from granite_lab.study import Options, analyse

SAMPLES = Path(__file__).parent.parent.parent / "data" / "samples"
LOGS = sorted(SAMPLES.glob("*.csv"))


def truth_of(log: Path) -> tuple[pd.DataFrame, dict[str, float]]:
    path = SAMPLES / "truth" / log.name
    lines = path.read_text(encoding="utf-8").splitlines()
    header = "\n".join(line[2:] for line in lines if line.startswith("# "))
    return pd.read_csv(path, comment="#"), parse_toml(header, path)


@pytest.fixture(scope="module")
def results() -> list[TrialResult]:
    return [analyse(log, Options()) for log in LOGS]


def test_the_samples_are_table_2_three_times_and_say_that_they_are_virtual(
    results: list[TrialResult],
) -> None:
    assert [r.comparison.fit.variant.velocity for r in results] == [0.2] * 3 + [0.3] * 3 + [0.5] * 3 + [
        0.7
    ] * 3
    assert all(r.trial.info.virtual and r.comparison.motion.virtual for r in results)


def test_true_velocity_is_met_within_six_millimetres_per_second(results: list[TrialResult]) -> None:
    for log, result in zip(LOGS, results, strict=True):
        truth, _ = truth_of(log)
        motion = result.comparison.motion
        error = motion.v - np.interp(motion.t, truth["t_s"], truth["v_mps"])
        assert np.sqrt(np.mean(error**2)) < 0.006
        assert abs(motion.x[-1] - truth["x_m"].iloc[-1]) < 3 * motion.distance.std


def test_stated_uncertainty_of_velocity_is_true_on_the_whole(results: list[TrialResult]) -> None:
    squares = []
    for log, result in zip(LOGS, results, strict=True):
        truth, _ = truth_of(log)
        motion = result.comparison.motion
        error = motion.v - np.interp(motion.t, truth["t_s"], truth["v_mps"])
        moving = np.array(motion.phase) != "rest"
        squares.append(np.mean((error / motion.v_std)[moving] ** 2))
    # twelve trials, each little more than one independent number
    assert 0.4 < np.mean(squares) < 1.9


def test_slip_ratio_is_met_within_a_point(results: list[TrialResult]) -> None:
    for log, result in zip(LOGS, results, strict=True):
        _, true = truth_of(log)
        assert result.comparison.motion.slip_ratio.value == pytest.approx(true["slip_ratio"], abs=0.01)


def test_k92_lies_in_its_interval_by_slip_and_by_trajectory(results: list[TrialResult]) -> None:
    for log, result in zip(LOGS, results, strict=True):
        _, true = truth_of(log)
        fit = result.comparison.fit
        assert fit.status == "ok"
        k92 = np.exp(-true["k92_value"] * fit.variant.velocity)
        for estimate in (fit.k92, fit.k92_trajectory):
            low, high = estimate.interval()
            assert low <= k92 <= high, (log.stem, k92, estimate)


def test_a_theta_lies_in_its_interval(results: list[TrialResult]) -> None:
    drawn = [truth_of(log)[1]["k92_value"] for log in LOGS]
    fit = fit_a_theta([result.comparison.fit for result in results])
    assert fit.ci95[0] <= np.mean(drawn) <= fit.ci95[1]
    assert fit.agrees  # the scatter was drawn about the published value
