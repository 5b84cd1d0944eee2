"""The page on public trials is made of what is there, and says of each trial how it ends."""

import pickle
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks import real_trials
from benchmarks.real_trials import Prepared, analysed
from benchmarks.real_trials_drive import SAMPLES, steps_of
from benchmarks.real_trials_page import page
from tests.corpus.cli import SAMPLES as LOGS

NAMES = ("cmd_left", "cmd_right", "left_wheel_vel", "right_wheel_vel", "icp_x", "icp_y", "icp_yaw", "imu_yaw")


def table(turning: float) -> pd.DataFrame:
    """Two windows of a step ahead at 2 rad/s and 0.5 m/s, with a scan every fifth sample."""
    scans = 0.05 * (np.arange(SAMPLES) // 5 * 5)
    values = {name: np.zeros(SAMPLES) for name in NAMES} | {"icp_x": 0.5 * scans}
    values |= {f"{side}": np.full(SAMPLES, 2.0) for side in NAMES[2:4]}
    values |= {"cmd_left": np.full(SAMPLES, 2.0 - turning), "cmd_right": np.full(SAMPLES, 2.0 + turning)}
    values |= {f"imu_acceleration_{a}": np.full(SAMPLES, g) for a, g in zip("xyz", (0, 0, 9.81), strict=True)}
    row = {f"{name}_{i}": x for name, own in values.items() for i, x in enumerate(own)}
    window = row | {"calib_step": 3.0, "gt_icp_x": 1.0, "gt_icp_y": 0.0}
    return pd.DataFrame([window, window])


def test_windows_of_drive_become_one_log_of_a_straight_step(tmp_path: Path) -> None:
    path = tmp_path / "steps.pkl"
    table(0.0).to_pickle(path)
    ((name, log, std),) = steps_of(path, 0.25)
    assert name == "step_003"
    assert len(log) == 2 * SAMPLES
    place = log.dropna(subset=["ref_x_m"])
    assert np.polyfit(place["t_s"], place["ref_x_m"], 1)[0] == pytest.approx(0.5, rel=0.01)
    assert std == 0.02
    assert log["v_cmd_mps"].unique() == pytest.approx([0.5])
    table(1.5).to_pickle(path)
    assert list(steps_of(path, 0.25)) == []


def test_a_pickle_that_holds_anything_but_a_table_is_not_loaded(tmp_path: Path) -> None:
    path = tmp_path / "evil.pkl"
    path.write_bytes(pickle.dumps(shutil.rmtree))
    with pytest.raises(pickle.UnpicklingError, match="no part of a table"):
        list(steps_of(path, 0.25))


def test_the_page_says_how_each_trial_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    work = tmp_path / "logs"
    work.mkdir()
    shutil.copy(LOGS / "virtual_v0.3_r1.csv", work)
    (work / "nothing.csv").write_text("hello\nworld\n", encoding="utf-8")
    monkeypatch.setattr(real_trials, "said_by_report", lambda _: ("A report.",))
    outcome = analysed(Prepared("A set", "here", "CC0", work, written=("a map",)))
    rows = {row.name: row for row in outcome.rows}
    assert rows["nothing"].grade == "refused"
    assert rows["virtual_v0.3_r1"].k92[:3] == "0.2"
    text = page([outcome], ["another"])
    assert "| A set | 2 | 1 | 1 | – | – | 1 |" in text
    assert "![slip ratios](figures/real-trials/a-set.png)" in text
    assert "> A report." in text
    assert "Not in the data of this run: another." in text
