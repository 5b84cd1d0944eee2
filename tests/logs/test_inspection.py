"""What is said about unknown logs, and column maps that read them back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from granite_lab.logs import inspect_logs
from granite_lab.logs.guess import by_name
from granite_lab.logs.inspection import FileReport
from tests.logs import make
from tests.truth import csv_text, trials


def inspected(folder: Path, content: str) -> FileReport:
    return inspect_logs([make.written(folder, content)]).files[0]


STRANGE = {
    "t_s": "Zeit [ms]", "imu_ax_mps2": "Accelerometer.X (m/s²)", "imu_ay_mps2": "Accelerometer.Y (m/s²)",
    "imu_az_mps2": "Accelerometer.Z (m/s²)", "imu_gx_radps": "gyroX", "imu_gy_radps": "gyroY",
    "imu_gz_radps": "gyroZ", "enc_fl_rad": "wheel_front_left_pos", "enc_fr_rad": "wheel_front_right_pos",
    "enc_rl_rad": "wheel_rear_left_pos", "enc_rr_rad": "wheel_rear_right_pos",
}  # fmt: skip


def renamed(names: dict[str, str], delimiter: str) -> str:
    """Return the log whose columns have other names."""
    header, _, rows = make.text().replace(",", delimiter).partition("\n")
    return delimiter.join(names[name] for name in header.split(delimiter)) + "\n" + rows


def test_an_unknown_log_is_guessed_and_its_map_reads_it(tmp_path: Path) -> None:
    report = inspected(tmp_path, renamed({**STRANGE, "t_s": "time_stamp"}, ";"))
    assert report.layout == ""
    assert {c.name: c.to for c in report.columns}["wheel_rear_left_pos"] == ("enc_rl",)
    assert all(0 < c.confidence < 1 for c in report.columns)
    make.same(make.mapped(tmp_path, report.path), make.read(tmp_path, make.text(), "plain.csv"))


def test_without_telling_names_clock_and_gravity_are_found_by_value(tmp_path: Path) -> None:
    names = {name: f"Kanal {k}" for k, name in enumerate(make.COLUMNS)}
    to = [c.to for c in inspected(tmp_path, renamed(names, ",")).columns]
    assert to == [("t",), ("imu_ax",), ("imu_ay",), ("imu_az",), *[()] * 7]


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
    header, *rows = make.lines()
    report = inspected(tmp_path, "\n".join([f"{header},{name}", *(f"{row},0.5" for row in rows)]))
    column = report.columns[-1]
    assert (column.name, column.to, report.layout) == (name, (), "canonical")
    assert "attitude: recognised, not used" in column.why
    assert f'# name = "{name}"' in report.to_map_toml()


def test_a_known_log_is_described_whole(tmp_path: Path) -> None:
    report = inspected(tmp_path, csv_text.to_csv(trials.generate(1, velocity=0.5).trial))
    assert report.layout == "canonical"
    imu, wheels = (next(s for s in report.streams if s.what == what) for what in ("imu", "encoders"))
    assert imu.rate == pytest.approx(200, rel=0.02)
    assert wheels.rate == pytest.approx(100, rel=0.02)
    assert imu.gaps == 0
    assert len(report.rests) == 2
    assert report.motion.velocity == pytest.approx(0.5, rel=0.05)
    assert report.motion.acceleration == pytest.approx(1.2, rel=0.3)
    assert json.dumps(report.as_json())


@pytest.mark.parametrize("velocity", [0.2, 0.3, 0.5, 0.7])
def test_the_variant_is_recognised(velocity: float, tmp_path: Path) -> None:
    text = csv_text.to_csv(trials.generate(7, velocity=velocity, grade="consumer").trial)
    assert inspected(tmp_path, text).motion.variant.velocity == velocity


def test_a_speed_of_no_variant_is_none(tmp_path: Path) -> None:
    faster = make.only(
        *make.COLUMNS, change=lambda row: [*row[:7], *(f"{float(c) * 1.25:.9g}" for c in row[7:])]
    )
    assert inspected(tmp_path, faster).motion.variant is None


def test_gaps_wraps_and_doubts_are_told(tmp_path: Path) -> None:
    lines = make.lines()
    text = "\n".join(lines[:300] + lines[312:]) + "\n"
    report = inspected(tmp_path, csv_text.wrapped_counts(text, 106_000, 16, start=65_000))
    assert report.streams[0].gaps == 1
    assert report.streams[0].longest_gap == pytest.approx(0.13)
    assert any("wrapped" in doubt for doubt in report.doubts)


def test_a_file_without_header_gets_a_usable_map(tmp_path: Path) -> None:
    report = inspected(tmp_path, make.text().partition("\n")[2])
    assert "no header line" in report.problem
    assert len(make.mapped(tmp_path, report.path).imu.t) == len(make.lines()) - 1


def test_every_column_is_listed_and_has_a_stub_in_the_map(tmp_path: Path) -> None:
    """Of a known layout, too: a column that is not used, one of texts, and an empty one."""
    header, *rows = make.lines()
    report = inspected(
        tmp_path, "\n".join([header + ",battery,note,spare", *(x + ",24.1,ok," for x in rows)])
    )
    assert [c.name for c in report.columns] == [*make.COLUMNS, "battery", "note", "spare"]
    assert all(c.why.startswith("not used") for c in report.columns[-3:])
    assert all(f'name = "{name}"' in report.to_map_toml() for name in ("battery", "note", "spare"))
    make.same(make.mapped(tmp_path, report.path), make.read(tmp_path, make.text(), "plain.csv"))


cell_names = st.text(st.characters(exclude_categories=["Cs", "Cc", "Zl", "Zp"]), max_size=15)


@given(names=st.lists(cell_names, min_size=7, max_size=7), seed=st.integers(0, 100))
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
def test_any_header_can_be_inspected_and_mapped(names: list[str], seed: int, tmp_path: Path) -> None:
    quoted = ['"' + name.replace('"', '""') + '"' for name in names]
    t, imu, _ = make.rows(duration=2, seed=seed)
    rows = [",".join(map(repr, row)) for row in np.column_stack([t, imu]).tolist()]
    report = inspected(tmp_path, "\n".join([",".join(quoted), *rows]))
    own = make.written(tmp_path, report.to_map_toml(), "map.toml")
    if any("t" in column.to for column in report.entries):
        report = inspect_logs([report.path], map=own).files[0]
    assert report.dialect is not None
