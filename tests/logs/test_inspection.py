"""What is said about unknown logs, and column maps that read them back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from granite_lab.logs import inspect_logs, read_trial
from granite_lab.logs.guess import by_name
from tests.logs import make
from tests.truth import csv_text, trials


def unknown(rename: dict[str, str], delimiter: str = ",") -> str:
    """Return a log whose columns have other names."""
    lines = make.lines()
    names = [rename.get(name, name) for name in lines[0].split(",")]
    return "\n".join([delimiter.join(names), *(line.replace(",", delimiter) for line in lines[1:])])


STRANGE = {
    "t_s": "Zeit [ms]", "imu_ax_mps2": "Accelerometer.X (m/s²)", "imu_ay_mps2": "Accelerometer.Y (m/s²)",
    "imu_az_mps2": "Accelerometer.Z (m/s²)", "imu_gx_radps": "gyroX", "imu_gy_radps": "gyroY",
    "imu_gz_radps": "gyroZ", "enc_fl_rad": "wheel_front_left_pos", "enc_fr_rad": "wheel_front_right_pos",
    "enc_rl_rad": "wheel_rear_left_pos", "enc_rr_rad": "wheel_rear_right_pos",
}  # fmt: skip


def test_an_unknown_log_is_guessed_and_its_map_reads_it(tmp_path: Path) -> None:
    path, plain, chart = tmp_path / "odd.csv", tmp_path / "plain.csv", tmp_path / "odd_map.toml"
    path.write_text(unknown({**STRANGE, "t_s": "time_stamp"}, ";"))
    plain.write_text(make.text())
    report = inspect_logs([path]).files[0]
    assert report.layout == ""
    assert {c.name: c.to for c in report.columns}["wheel_rear_left_pos"] == ("enc_rl",)
    assert all(0 < c.confidence < 1 for c in report.columns)
    chart.write_text(report.to_map_toml())
    right, back = read_trial(plain), read_trial(path, map=chart)
    np.testing.assert_array_equal(back.imu.specific_force, right.imu.specific_force)
    np.testing.assert_array_equal(back.imu.angular_rate, right.imu.angular_rate)
    np.testing.assert_array_equal(back.wheels.angle, right.wheels.angle)


def test_without_telling_names_clock_and_gravity_are_found_by_value(tmp_path: Path) -> None:
    names = {name: f"Kanal {k}" for k, name in enumerate(make.HEADER.split(","))}
    path = tmp_path / "odd.csv"
    path.write_text(unknown(names))
    to = {c.name: c.to for c in inspect_logs([path]).files[0].columns}
    assert to["Kanal 0"] == ("t",)
    assert [to[f"Kanal {k}"] for k in (1, 2, 3)] == [("imu_ax",), ("imu_ay",), ("imu_az",)]
    assert to["Kanal 7"] == ()


@pytest.mark.parametrize(
    ("name", "to", "unit"),
    [
        ("gyroX (°/s)", ("imu_gx",), "deg/s"),
        ("accel_z_g", ("imu_az",), "g"),
        ("Acceleration Y", ("imu_ay",), "m/s^2"),
        ("AccY", ("imu_ay",), "m/s^2"),
        ("wz", ("imu_gz",), "rad/s"),
        ("left_encoder", ("enc_fl", "enc_rl"), "rad"),
        ("encoderRight", ("enc_fr", "enc_rr"), "rad"),
        ("enc3_rad", ("enc_rl",), "rad"),
        ("front_left_wheel_speed_rpm", ("enc_fl",), "rpm"),
        ("motor_current_rr_mA", ("cur_rr",), "mA"),
        ("v_cmd_mps", ("v_cmd",), "m/s"),
        ("mocap_v_mps", ("ref_v",), "m/s"),
        ("timestamp_ns", ("t",), "ns"),
        ("rate_pitch", ("imu_gy",), "rad/s"),
        ("rear_left_rpm", ("enc_rl",), "rpm"),
        ("gps_longitude", ("ref_lon",), "deg"),
        ("mocap_y_mm", ("ref_y",), "mm"),
        ("field.position1", (), ""),
        ("field.pose.covariance1", (), ""),
        ("battery", (), ""),
    ],
)
def test_names_are_understood(name: str, to: tuple[str, ...], unit: str) -> None:
    found = by_name(name)
    assert (found.to, found.unit) == (to, unit)


@pytest.mark.parametrize("name", ["roll", "pitch_deg", "Euler_Z", "field.orientation.w", "quat_x", "q3"])
def test_a_logged_attitude_is_recognised_and_said_to_be_of_no_use(name: str, tmp_path: Path) -> None:
    lines = make.lines()
    path = tmp_path / "log.csv"
    path.write_text("\n".join([f"{lines[0]},{name}", *(f"{x},0.5" for x in lines[1:])]))
    report = inspect_logs([path]).files[0]
    column = report.columns[-1]
    assert (column.name, column.to) == (name, ())
    assert "attitude: recognised, not used" in column.why
    assert report.layout == "canonical"
    assert f'# name = "{name}"' in report.to_map_toml()


def test_a_known_log_is_described_whole(tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    path.write_text(csv_text.to_csv(trials.generate(1, velocity=0.5).trial))
    report = inspect_logs([path]).files[0]
    assert report.layout == "canonical"
    imu, wheels = (next(s for s in report.streams if s.what == what) for what in ("imu", "encoders"))
    assert imu.rate == pytest.approx(200, rel=0.02)
    assert wheels.rate == pytest.approx(100, rel=0.02)
    assert imu.gaps == 0
    assert len(report.rests) == 2
    assert report.motion.variant.velocity == 0.5
    assert report.motion.velocity == pytest.approx(0.5, rel=0.05)
    assert report.motion.acceleration == pytest.approx(1.2, rel=0.3)
    assert json.dumps(inspect_logs([path]).as_json())


@pytest.mark.parametrize("velocity", [0.2, 0.3, 0.5, 0.7])
def test_the_variant_is_recognised(velocity: float, tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    path.write_text(csv_text.to_csv(trials.generate(7, velocity=velocity, grade="consumer").trial))
    motion = inspect_logs([path]).files[0].motion
    assert motion.variant.velocity == velocity


def test_a_speed_of_no_variant_is_none(tmp_path: Path) -> None:
    lines = make.lines()
    fast = [lines[0]]
    for line in lines[1:]:
        cells = line.split(",")
        fast.append(",".join([*cells[:7], *(f"{float(c) * 1.25:.9g}" for c in cells[7:])]))
    path = tmp_path / "trial.csv"
    path.write_text("\n".join(fast))
    motion = inspect_logs([path]).files[0].motion
    assert motion.variant is None


def test_gaps_wraps_and_doubts_are_told(tmp_path: Path) -> None:
    lines = make.lines()
    text = "\n".join(lines[:300] + lines[312:])
    path = tmp_path / "trial.csv"
    path.write_text(csv_text.wrapped_counts(text + "\n", 106_000, 16, start=65_000))
    report = inspect_logs([path]).files[0]
    assert report.streams[0].gaps == 1
    assert report.streams[0].longest_gap == pytest.approx(0.13)
    assert any("wrapped" in doubt for doubt in report.doubts)


def test_files_without_header_and_with_double_names_get_a_usable_map(tmp_path: Path) -> None:
    lines = make.lines()
    bare, chart = tmp_path / "bare.csv", tmp_path / "bare_map.toml"
    bare.write_text("\n".join(lines[1:]))
    report = inspect_logs([bare]).files[0]
    assert "no header line" in report.problem
    chart.write_text(report.to_map_toml())
    trial = read_trial(bare, map=chart)
    assert len(trial.imu.t) == len(lines) - 1


def test_every_column_is_listed_and_has_a_stub_in_the_map(tmp_path: Path) -> None:
    """Of a known layout, too: a column that is not used, one of texts, and an empty one."""
    lines = make.lines()
    path, chart = tmp_path / "more.csv", tmp_path / "more.toml"
    path.write_text("\n".join([lines[0] + ",battery,note,spare", *(x + ",24.1,ok," for x in lines[1:])]))
    report = inspect_logs([path]).files[0]
    assert report.layout == "canonical"
    assert [c.name for c in report.columns] == [*lines[0].split(","), "battery", "note", "spare"]
    assert all(c.why.startswith("not used") for c in report.columns[-3:])
    text = report.to_map_toml()
    assert all(f'name = "{name}"' in text for name in ("battery", "note", "spare"))
    chart.write_text(text)
    assert read_trial(path, map=chart).imu is not None


cell_names = st.text(st.characters(exclude_categories=["Cs", "Cc", "Zl", "Zp"]), max_size=15)


@given(names=st.lists(cell_names, min_size=7, max_size=7), seed=st.integers(0, 100))
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
def test_any_header_can_be_inspected_and_mapped(names: list[str], seed: int, tmp_path: Path) -> None:
    quoted = ['"' + name.replace('"', '""') + '"' for name in names]
    t, imu, _ = make.rows(duration=2, seed=seed)
    table = np.column_stack([t, imu])
    path, chart = tmp_path / "any.csv", tmp_path / "any_map.toml"
    path.write_text(
        "\n".join([",".join(quoted), *(",".join(map(repr, row)) for row in table.tolist())]), encoding="utf-8"
    )
    report = inspect_logs([path]).files[0]
    chart.write_text(report.to_map_toml(), encoding="utf-8")
    again = inspect_logs([path], map=chart).files[0] if any("t" in e.to for e in report.entries) else report
    assert again.dialect is not None
