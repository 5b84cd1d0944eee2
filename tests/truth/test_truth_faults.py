"""Each injected fault does what it says and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.logs.trial import Trial
from tests.truth import csv_text, faults, generate


@pytest.fixture(scope="module")
def trial() -> Trial:
    return generate(11, velocity=0.5, duration=3.0, still=(1.0, 1.0), reference=True).trial


def cell(text: str, row: int, column: str) -> str:
    _, columns, rows = csv_text.split(text)
    return rows[row][columns.index(column)]


def column_of(text: str, name: str) -> np.ndarray:
    _, columns, rows = csv_text.split(text)
    return np.array([float(row[columns.index(name)]) for row in rows if row[columns.index(name)]])


def test_csv_holds_every_sample_in_order(trial: Trial) -> None:
    text = csv_text.to_csv(trial)
    assert column_of(text, "imu_ax_mps2") == pytest.approx(trial.imu.specific_force[:, 0], rel=1e-8)
    assert column_of(text, "enc_rr_rad") == pytest.approx(trial.wheels.angle[:, 3], rel=1e-8)
    assert column_of(text, "cur_fl_A") == pytest.approx(trial.currents.current[:, 0], rel=1e-8)
    assert column_of(text, "ref_v_mps") == pytest.approx(trial.reference_v.value, rel=1e-8, abs=1e-12)
    assert (np.diff(column_of(text, "t_s")) >= 0).all()
    assert '# robot = "granite"' in text


def test_wrapped_counts_unwrap_to_the_angle(trial: Trial) -> None:
    text = csv_text.wrapped_counts(csv_text.to_csv(trial), 106000, 16, start=65000)
    counts = column_of(text, "enc_fl_counts")
    assert counts.max() < 2**16
    assert np.abs(np.diff(counts)).max() > 2**15
    angle = np.unwrap(counts, period=2**16) * 2 * np.pi / 106000
    assert angle - angle[0] == pytest.approx(trial.wheels.angle[:, 0], abs=1e-4)


def test_units_are_converted_with_or_without_the_name(trial: Trial) -> None:
    text = csv_text.to_csv(trial)
    honest = csv_text.converted(text, "imu_a", 1 / 9.81, "g")
    assert column_of(honest, "imu_az_g").mean() == pytest.approx(1.0, abs=0.02)
    assert "imu_az_mps2" not in honest
    lying = csv_text.converted(text, "imu_a", 1 / 9.81)
    assert column_of(lying, "imu_az_mps2").mean() == pytest.approx(1.0, abs=0.02)


def test_rows_are_repeated_shuffled_and_reversed(trial: Trial) -> None:
    text = csv_text.to_csv(trial)
    stamps = column_of(text, "t_s")
    assert column_of(csv_text.duplicated(text, 10), "t_s").size == stamps.size + stamps.size // 10
    mixed = column_of(csv_text.unsorted(text, 1), "t_s")
    assert (np.diff(mixed) < 0).any()
    assert np.array_equal(np.sort(mixed), stamps)
    assert np.array_equal(column_of(csv_text.backwards(text), "t_s"), stamps[::-1])


def test_cells_and_columns_are_spoilt(trial: Trial) -> None:
    text = csv_text.to_csv(trial)
    assert "imu_gy" not in csv_text.without_columns(text, "imu_gy")
    assert cell(csv_text.with_cell(text, 5, "t_s", "soon"), 5, "t_s") == "soon"
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


def test_rail_cuts_both_sides(trial: Trial) -> None:
    force = faults.saturated(trial, 0.4).imu.specific_force
    assert np.ptp(force[:, 0]) == pytest.approx(0.8)
    assert np.array_equal(force[:, 1:], trial.imu.specific_force[:, 1:])


def test_restarted_imu_is_silent_and_comes_back_with_another_bias(trial: Trial) -> None:
    again = faults.imu_restart(
        trial, 2.0, gap=0.2, accel_jump=np.array([0.3, 0, 0]), gyro_jump=np.full(3, 0.01)
    )
    assert np.diff(again.imu.t).max() == pytest.approx(0.2, abs=0.02)
    later = again.imu.t > 2.1
    matching = trial.imu.t > 2.2
    assert again.imu.specific_force[later][-50:, 0] == pytest.approx(
        trial.imu.specific_force[matching][-50:, 0] + 0.3
    )
    assert again.imu.angular_rate[~later] == pytest.approx(trial.imu.angular_rate[trial.imu.t < 2.0])


@pytest.mark.parametrize(("how", "held"), [("frozen", None), ("zero", 0.0)])
def test_dead_encoder_repeats_itself_and_counts_on(trial: Trial, how: str, held: float | None) -> None:
    dead = faults.dead_encoder(trial, "rl", 2.0, 3.0, how)  # type: ignore[arg-type]
    t, angle, good = dead.wheels.t, dead.wheels.angle[:, 2], trial.wheels.angle[:, 2]
    inside, after = (t >= 2.0) & (t <= 3.0), t > 3.0
    assert np.ptp(angle[inside]) == 0
    assert angle[inside][0] == pytest.approx(good[t < 2.0][-1] if held is None else held)
    assert np.diff(angle[after]) == pytest.approx(np.diff(good[after]))
    others = [0, 1, 3]
    assert np.array_equal(dead.wheels.angle[:, others], trial.wheels.angle[:, others])


def test_missing_encoder_is_nan_and_keeps_its_count(trial: Trial) -> None:
    dead = faults.dead_encoder(trial, "fr", 2.0, 3.0, "missing")
    t = dead.wheels.t
    assert np.array_equal(np.isnan(dead.wheels.angle[:, 1]), (t >= 2.0) & (t <= 3.0))
    assert dead.wheels.angle[-1, 1] == trial.wheels.angle[-1, 1]


def test_signs_orders_units_and_axes(trial: Trial) -> None:
    angle = trial.wheels.angle
    assert np.array_equal(faults.flipped(trial, "fl", "rr").wheels.angle, angle * [-1, 1, 1, -1])
    assert np.array_equal(faults.swapped(trial, "fl", "rr").wheels.angle, angle[:, [3, 1, 2, 0]])
    assert faults.rescaled(trial, gyro=57.3).imu.angular_rate == pytest.approx(57.3 * trial.imu.angular_rate)
    upside_down = faults.turned(trial, np.diag([1.0, -1.0, -1.0]))
    assert np.median(upside_down.imu.specific_force[:, 2]) == pytest.approx(-9.81, abs=0.1)


def test_clocks_drift_and_begin_elsewhere(trial: Trial) -> None:
    fast = faults.drifting_clock(trial, 1e-3)
    assert fast.wheels.t[-1] - trial.wheels.t[-1] == pytest.approx(0.005, rel=0.02)
    late = faults.shifted_time(trial, 1.7e9)
    assert late.imu.t[0] == pytest.approx(1.7e9 + trial.imu.t[0])
    assert late.currents.t[0] - late.wheels.t[0] == pytest.approx(
        trial.currents.t[0] - trial.wheels.t[0], abs=1e-6
    )


def test_spikes_hit_as_many_samples_as_asked(trial: Trial) -> None:
    spiky = faults.spikes(trial, 1, 7, 30.0)
    changed = (spiky.imu.specific_force != trial.imu.specific_force).any(axis=1)
    assert changed.sum() == 7
