"""Each injected fault does what it says and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.logs.trial import Trial
from tests.truth import csv_text, faults, generate


@pytest.fixture(scope="module")
def trial() -> Trial:
    return generate(11, velocity=0.5, duration=3.0, still=(1.0, 1.0), reference=True).trial


@pytest.fixture(scope="module")
def text(trial: Trial) -> str:
    return csv_text.to_csv(trial)


def column_of(text: str, name: str) -> np.ndarray:
    _, columns, rows = csv_text.split(text)
    return np.array([float(row[columns.index(name)]) for row in rows if row[columns.index(name)]])


def test_csv_holds_every_sample_in_order(trial: Trial, text: str) -> None:
    for name, logged in (
        ("imu_ax_mps2", trial.imu.specific_force[:, 0]),
        ("enc_rr_rad", trial.wheels.angle[:, 3]),
        ("cur_fl_A", trial.currents.current[:, 0]),
        ("ref_v_mps", trial.reference_v.value),
    ):
        assert column_of(text, name) == pytest.approx(logged, rel=1e-8, abs=1e-12)
    assert (np.diff(column_of(text, "t_s")) >= 0).all()
    assert '# robot = "granite"' in text


def test_wrapped_counts_unwrap_to_the_angle(trial: Trial, text: str) -> None:
    counts = column_of(csv_text.wrapped_counts(text, 106000, 16, start=65000), "enc_fl_counts")
    assert counts.max() < 2**16
    assert np.abs(np.diff(counts)).max() > 2**15
    angle = np.unwrap(counts, period=2**16) * 2 * np.pi / 106000
    assert angle - angle[0] == pytest.approx(trial.wheels.angle[:, 0], abs=1e-4)


def test_units_are_converted_with_or_without_the_name(text: str) -> None:
    honest, lying = (csv_text.converted(text, "imu_a", 1 / 9.81, *suffix) for suffix in (("g",), ()))
    assert column_of(honest, "imu_az_g").mean() == pytest.approx(1.0, abs=0.02)
    assert "imu_az_mps2" not in honest
    assert column_of(lying, "imu_az_mps2").mean() == pytest.approx(1.0, abs=0.02)


def test_rows_are_repeated_shuffled_reversed_and_blanked(trial: Trial, text: str) -> None:
    stamps = column_of(text, "t_s")
    assert column_of(csv_text.duplicated(text, 10), "t_s").size == stamps.size + stamps.size // 10
    mixed = column_of(csv_text.unsorted(text, 1), "t_s")
    assert (np.diff(mixed) < 0).any()
    assert np.array_equal(np.sort(mixed), stamps)
    assert np.array_equal(column_of(csv_text.backwards(text), "t_s"), stamps[::-1])
    gap = csv_text.with_gap_of_nan(text, "imu_ax_mps2", 1.0, 1.2)
    assert gap.count("NaN") == np.count_nonzero((trial.imu.t >= 1.0) & (trial.imu.t <= 1.2))


def test_dropouts_remove_samples_and_keep_the_rest(trial: Trial) -> None:
    holed = faults.imu_dropout(trial, 2.0, 2.3)
    assert not ((holed.imu.t > 2.0) & (holed.imu.t < 2.3)).any()
    assert trial.imu.t.size - holed.imu.t.size == pytest.approx(60, abs=1)
    assert holed.wheels is trial.wheels
    assert np.diff(faults.wheel_dropout(trial, 2.0, 2.3).wheels.t).max() > 0.29
    sparse = faults.random_dropouts(trial, 1, 0.2)
    assert sparse.imu.t.size == pytest.approx(0.8 * trial.imu.t.size, rel=0.1)


def test_cut_trial_begins_in_motion(trial: Trial) -> None:
    short = faults.cut(trial, 2.0, 3.0)
    assert 2.0 <= short.imu.t[0] < short.imu.t[-1] <= 3.0
    assert not short.wheels.angle[0].any()
    assert short.wheels.angle[-1] == pytest.approx(5.2, abs=0.2)
    assert short.currents.t[0] >= 2.0


def test_restarted_imu_is_silent_and_comes_back_with_another_bias(trial: Trial) -> None:
    again = faults.imu_restart(trial, 2.0, gap=0.2, accel_jump=np.array([0.3, 0, 0]), gyro_jump=0.01)
    assert np.diff(again.imu.t).max() == pytest.approx(0.2, abs=0.02)
    assert again.imu.specific_force[-50:, 0] == pytest.approx(trial.imu.specific_force[-50:, 0] + 0.3)
    assert again.imu.angular_rate[again.imu.t < 2.0] == pytest.approx(
        trial.imu.angular_rate[trial.imu.t < 2.0]
    )


@pytest.mark.parametrize("how", ["frozen", "zero", "missing"])
def test_dead_encoder_repeats_itself_and_counts_on_or_is_missing(trial: Trial, how: str) -> None:
    dead = faults.dead_encoder(trial, "rl", 2.0, 3.0, how)
    t, angle, good = dead.wheels.t, dead.wheels.angle[:, 2], trial.wheels.angle[:, 2]
    inside, after = (t >= 2.0) & (t <= 3.0), t > 3.0
    if how == "missing":
        assert np.array_equal(np.isnan(angle), inside)
        assert angle[-1] == good[-1]
    else:
        assert np.ptp(angle[inside]) == 0
        assert angle[inside][0] == pytest.approx(good[t < 2.0][-1] if how == "frozen" else 0.0)
        assert np.diff(angle[after]) == pytest.approx(np.diff(good[after]))
    others = [0, 1, 3]
    assert np.array_equal(dead.wheels.angle[:, others], trial.wheels.angle[:, others])


def test_signs_orders_axes_rails_spikes_and_clocks(trial: Trial) -> None:
    angle, force = trial.wheels.angle, trial.imu.specific_force
    assert np.array_equal(faults.flipped(trial, "fl", "rr").wheels.angle, angle * [-1, 1, 1, -1])
    assert np.array_equal(faults.swapped(trial, "fl", "rr").wheels.angle, angle[:, [3, 1, 2, 0]])
    upside_down = faults.turned(trial, np.diag([1.0, -1.0, -1.0]))
    assert np.median(upside_down.imu.specific_force[:, 2]) == pytest.approx(-9.81, abs=0.1)
    railed = faults.saturated(trial, 0.4).imu.specific_force
    assert np.ptp(railed[:, 0]) == pytest.approx(0.8)
    assert np.array_equal(railed[:, 1:], force[:, 1:])
    assert (faults.spikes(trial, 1, 7, 30.0).imu.specific_force != force).any(axis=1).sum() == 7
    late = faults.shifted_time(trial, 1.7e9)
    assert late.imu.t[0] == pytest.approx(1.7e9 + trial.imu.t[0])
