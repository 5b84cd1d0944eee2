"""Wrong units in good trials: corrected with a warning where the evidence is unmistakable.

The trials come from the independent generator of `tests.truth`.
"""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from granite_lab.logs import read_trial
from granite_lab.logs.trial import Trial
from tests.truth import csv_text, trials

DEG = 180 / np.pi
G = 9.80665
SETTINGS = [("industrial", 0.2, 1), ("industrial", 0.7, 2), ("consumer", 0.3, 3), ("consumer", 0.5, 4)]


@lru_cache
def good(grade: str, velocity: float, seed: int) -> str:
    return csv_text.to_csv(trials.generate(seed, velocity=velocity, grade=grade).trial)


def read(text: str, folder: Path, name: str = "trial.csv") -> Trial:
    path = folder / name
    path.write_text(text)
    return read_trial(path)


def close(a: Trial, b: Trial) -> bool:
    return (
        np.allclose(a.imu.t, b.imu.t, atol=1e-4)
        and np.allclose(a.imu.specific_force, b.imu.specific_force, rtol=1e-3, atol=1e-2)
        and np.allclose(a.imu.angular_rate, b.imu.angular_rate, rtol=1e-3, atol=1e-4)
        and np.allclose(a.wheels.angle, b.wheels.angle, rtol=1e-3, atol=1e-3)
    )


WRONG = {
    # columns, factor on the values, suffix they get (None: the old one, which then lies), what is said
    "g as m/s^2": ("imu_a", 1 / G, None, r"declared in m/s\^2, reads .* it is in g"),
    "m/s^2 as g": ("imu_a", 1.0, "g", r"declared in g, reads .* it is in m/s\^2"),
    "mg as m/s^2": ("imu_a", 1000 / G, None, "it is in mg"),
    "g as mg": ("imu_a", 1 / G, "mg", "it is in g"),
    "deg/s as rad/s": ("imu_g", DEG, None, "declared in rad/s, is in deg/s"),
    "rad/s as deg/s": ("imu_g", 1.0, "dps", "declared in deg/s, is in rad/s"),
    "ms as s": ("t_", 1e3, None, "stamps are in ms"),
    "s as ms": ("t_", 1.0, "ms", "stamps are in s"),
    "ns as s": ("t_", 1e9, None, "stamps are in ns"),
    "deg as rad": ("enc", DEG, None, "declared in rad, .* they are in deg"),
    "rad as deg": ("enc", 1.0, "deg", "declared in deg, .* they are in rad"),
    "rev as rad": ("enc", 1 / (2 * np.pi), None, "declared in rad, .* they are in rev"),
}


@pytest.mark.parametrize("setting", SETTINGS, ids=str)
@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_unit_is_corrected_and_said(
    name: str, setting: tuple[str, float, int], tmp_path: Path
) -> None:
    prefix, factor, suffix, said = WRONG[name]
    text = good(*setting)
    right = read(text, tmp_path)
    wrong = read(csv_text.converted(text, prefix, factor, suffix), tmp_path)
    assert close(right, wrong)
    news = [line for line in wrong.warnings if line not in right.warnings]
    assert any(re.search(said, line) for line in news), news


@pytest.mark.parametrize("setting", SETTINGS, ids=str)
def test_a_good_trial_raises_no_doubt(setting: tuple[str, float, int], tmp_path: Path) -> None:
    assert read(good(*setting), tmp_path).warnings == ()


def test_removed_gravity_is_noticed(tmp_path: Path) -> None:
    head, columns, rows = csv_text.split(good(*SETTINGS[0]))
    at = columns.index("imu_az_mps2")
    for row in rows:
        row[at] = f"{float(row[at]) - 9.81:.9g}" if row[at] else ""
    trial = read(csv_text.join(head, columns, rows), tmp_path)
    assert trial.imu.gravity_removed
    assert any("has removed gravity" in line for line in trial.warnings)


def test_rails_and_dead_axes_are_reported(tmp_path: Path) -> None:
    head, columns, rows = csv_text.split(good("industrial", 0.7, 2))
    ax, gz = columns.index("imu_ax_mps2"), columns.index("imu_gz_radps")
    for row in rows:
        if row[ax]:
            row[ax] = f"{np.clip(float(row[ax]), -1.0, 1.5):.9g}"
            row[gz] = "0.25"
    warnings = read(csv_text.join(head, columns, rows), tmp_path).warnings
    assert any("accelerometer x: saturated at" in line for line in warnings)
    assert any("gyroscope z: constant at 0.25" in line for line in warnings)


def test_a_dead_encoder_is_reported_and_an_absent_one_too(tmp_path: Path) -> None:
    head, columns, rows = csv_text.split(good("industrial", 0.7, 2))
    fl, rr = columns.index("enc_fl_rad"), columns.index("enc_rr_rad")
    for row in rows:
        if row[fl]:
            row[fl], row[rr] = "0.25", ""
    trial = read(csv_text.join(head, columns, rows), tmp_path)
    assert any("encoder fl stands still" in line for line in trial.warnings)
    assert any("'enc_rr_rad' is empty" in line for line in trial.warnings)
    assert np.isnan(trial.wheels.angle[:, 3]).all()


def test_a_wheel_that_is_silent_for_a_while_is_reported(tmp_path: Path) -> None:
    text = csv_text.with_gap_of_nan(good("industrial", 0.3, 1), "enc_rl_rad", 3.0, 4.5)
    trial = read(text, tmp_path)
    assert np.isnan(trial.wheels.angle[:, 2]).sum() > 100
    assert any("'enc_rl_rad': no sample from t = 3.0" in line for line in trial.warnings)


def test_a_short_hole_in_one_axis_costs_its_samples_only(tmp_path: Path) -> None:
    text = csv_text.with_gap_of_nan(good("industrial", 0.3, 1), "imu_gy_radps", 3.0, 3.1)
    right, holed = read(good("industrial", 0.3, 1), tmp_path), read(text, tmp_path)
    assert 15 <= len(right.imu.t) - len(holed.imu.t) <= 25
    assert any("without 'imu_gy_radps' were left out" in line for line in holed.warnings)


@pytest.mark.parametrize("bits", [16, 32])
def test_wraps_injected_into_a_trial_are_undone_exactly(bits: int, tmp_path: Path) -> None:
    text = good("industrial", 0.3, 1)
    _head, columns, rows = csv_text.split(text)
    at = columns.index("enc_fl_rad")
    counts = 106_000
    true = np.array([round(float(row[at]) * counts / (2 * np.pi)) for row in rows if row[at]])
    wrapped = csv_text.wrapped_counts(text, counts, bits, start=2**bits - 3000)
    trial = read(wrapped, tmp_path)
    got = np.rint((trial.wheels.angle[:, 0] - trial.wheels.angle[0, 0]) * counts / (2 * np.pi))
    np.testing.assert_array_equal(got, true - true[0])
    assert any("wrapped" in line for line in trial.warnings)
