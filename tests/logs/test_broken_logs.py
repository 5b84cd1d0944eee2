"""Broken logs: each is refused in one line that names the place, with a hint and exit code 3."""

# ruff: noqa: E501  # a table, one broken log a line

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from granite_lab.errors import InputError
from granite_lab.logs import inspect_logs
from tests.logs import make

LINES = make.lines()
COLUMNS = make.COLUMNS


def cell(line: int, column: str, text: str) -> str:
    """Put a text into one cell; line 2 is the first row."""
    row = LINES[line - 1].split(",")
    row[COLUMNS.index(column)] = text
    return "\n".join([*LINES[: line - 1], ",".join(row), *LINES[line:]]) + "\n"


def header(change: Callable[[str], str]) -> str:
    return "\n".join([change(LINES[0]), *LINES[1:]]) + "\n"


def column(prefix: str, change: Callable[[float], float], first: int = 2) -> str:
    """Change every value of the columns that begin with a prefix, from a line on."""
    hit = [name.startswith(prefix) for name in COLUMNS]
    out = LINES[: first - 1]
    for line in LINES[first - 1 :]:
        out.append(
            ",".join(repr(change(float(c))) if h else c for h, c in zip(hit, line.split(","), strict=True))
        )
    return "\n".join(out) + "\n"


def insert(line: int, text: str) -> str:
    return "\n".join([*LINES[: line - 1], text, *LINES[line - 1 :]]) + "\n"


TEXT = "\n".join(LINES) + "\n"
HALF = len(TEXT) // 2

# name: (content, what the message says behind the path, what the hint says)
CASES: dict[str, tuple[str | bytes, str, str]] = {
    # files that are no tables
    "empty": ("", r": the file is empty", "header line"),
    "blank lines": ("\n" * 1000, r": the file is empty", "header line"),
    "only comments": ('# robot = "granite"\n# soil = "dry_sand"\n', r": no header line, only comments", "header"),
    "header only": (LINES[0] + "\n", r":1: no row of numbers below the header", "no samples"),
    "a letter": ("Dear Jan,\nthe log is attached.\nBest\n", r":\d: no (table here|row of numbers.*)", ""),
    "binary": (bytes(range(256)) * 40, r": is binary, not text", "CSV"),
    "random bytes": (np.random.default_rng(1).bytes(5000), r": is binary, not text", "CSV"),
    "a bag": (b"#ROSBAG V2.0\n" + bytes(100), r": is not text but a ROS bag", "CSV"),
    "a workbook": (b"PK\x03\x04" + bytes(100), r": is not text but a zip archive or Excel workbook", "CSV"),
    "compressed": (b"\x1f\x8b\x08" + bytes(100), r": is not text but gzip-compressed", "CSV"),
    "parquet": (b"PAR1" + bytes(100), r": is not text but a Parquet file", "CSV"),
    # headers
    "no header": ("\n".join(LINES[1:]), r":1: no header line, expected the names of the columns", "names ="),
    "missing gyro": (header(lambda h: h.replace("imu_gy_radps", "x")), r":1: column 'imu_gy' is missing.*", "imu_gy_radps"),
    "missing accelerometer": (header(lambda h: h.replace("imu_ax_mps2", "x")), r":1: column 'imu_ax' is missing.*", ""),
    "missing wheel": (header(lambda h: h.replace("enc_rr_rad", "x")), r":1: column 'enc_rr' is missing.*", ""),
    "missing time": (header(lambda h: h.replace("t_s", "x")), r":1: column 't' is missing.*", ""),
    "misspelt wheel": (header(lambda h: h.replace("enc_fr", "encfr")), r":1: column 'enc_fr' is missing.*", "encfr_rad"),
    "no unit": (header(lambda h: h.replace("imu_gy_radps", "imu_gy")), r":1: column 'imu_gy' is missing.*", "imu_gy_radps"),
    "unknown unit": (header(lambda h: h.replace("ax_mps2", "ax_mps3")), r":1: column 'imu_ax_mps3': unit 'mps3' is not known, expected one of m/s\^2.*", "mps2"),
    "unit of another kind": (header(lambda h: h.replace("gy_radps", "gy_rad")), r":1: column 'imu_gy_rad': unit 'rad' is one of angle, but imu_gy is angular rate", "rad/s"),
    "duplicate column": (header(lambda h: h.replace("imu_ay", "imu_ax")), r":1: 'imu_ax_mps2' \(column 2\) and 'imu_ax_mps2' \(column 3\) both are imu_ax.*", "remove"),
    "two units of one channel": (header(lambda h: h.replace("imu_ay_mps2", "imu_ax_g")), r":1: 'imu_ax_mps2' \(column 2\) and 'imu_ax_g' \(column 3\) both are imu_ax.*", "remove"),
    "header too short": (header(lambda h: h.rsplit(",", 1)[0]), r":1: the header names 10 columns, the rows below have 11", "one name a column"),
    "header too long": (header(lambda h: h + ",more,and_more"), r":1: the header names 13 columns, the rows below have 11", "one name a column"),
    "comma in a name": (header(lambda h: h.replace("t_s", "t, in s")), r":1: the header names 12 columns, the rows below have 11", "quote"),
    "unknown layout": ("alpha,beta,gamma\n1,2,3\n2,3,4\n", r":1: the layout is not known: alpha, beta, gamma", "inspect"),
    # cells
    "text in a number": (cell(12, "imu_ax_mps2", "fast"), r":12: column 'imu_ax_mps2': 'fast' is not a number, expected one", "empty"),
    "text in a stamp": (cell(40, "t_s", "12:30:05"), r":40: column 't_s': '12:30:05' is not a number.*", ""),
    "text in the last row": (cell(601, "enc_rl_rad", "END"), r":601: column 'enc_rl_rad': 'END' is not a number.*", ""),
    "formula": (cell(30, "enc_fl_rad", "=cmd|' /C calc'!A0"), r":30: column 'enc_fl_rad': .*=cmd.* is not a number.*", ""),
    "script": (cell(31, "enc_fl_rad", "<script>alert(1)</script>"), r":31: column 'enc_fl_rad': '<script>.*' is not a number.*", ""),
    "letter O for zero": (cell(77, "imu_gz_radps", "O.01"), r":77: column 'imu_gz_radps': 'O.01' is not a number.*", ""),
    "underscore": (cell(77, "imu_gz_radps", "1_000"), r":77: column 'imu_gz_radps': '1_000' is not a number.*", ""),
    "hexadecimal": (cell(77, "imu_gz_radps", "0x1F"), r":77: column 'imu_gz_radps': '0x1F' is not a number.*", ""),
    "infinity": (cell(50, "imu_az_mps2", "inf"), r":50: column 'imu_az_mps2': inf is not finite.*", "empty"),
    "overflow": (cell(50, "imu_az_mps2", "1e999"), r":50: column 'imu_az_mps2': 1e999 is not finite.*", "empty"),
    "decimal comma in one cell": (cell(50, "imu_az_mps2", '"9,81"'), r":50: column 'imu_az_mps2': '9,81' is not a number.*", "decimal"),
    "decimal commas, comma separated": (TEXT.replace(".", ","), r":1: the header names 11 columns, the rows below have \d+", "decimal comma"),
    "zeros of a lost sector": (TEXT[:HALF].encode() + bytes(512) + TEXT[HALF:].encode(), r":\d+: .*", ""),
    "a row too long": (insert(20, LINES[19] + ",1,2"), r":20: 13 cells, expected 11", "delimiter"),
    "a row too short": (insert(20, "0.18,1,2"), r":20: 3 cells, expected 11", "damaged"),
    "second header in the middle": (insert(200, LINES[0]), r":200: column 't_s': 't_s' is not a number.*", ""),
    # clocks
    "one row": ("\n".join(LINES[:2]), r": column 't_s' does not advance, expected time stamps", "two rows"),
    "constant time": (column("t_s", lambda _: 5.0), r": column 't_s' does not advance, expected time stamps", ""),
    "clock starts over": (column("t_s", lambda t: t - 2.99, 301), r":301: .*time runs backwards by 2.980 s and starts over at 0.000 s", "cut"),
    "clock set back": (column("t_s", lambda t: t - 1.234, 301), r":301: .*time runs backwards by 1.2\d\d s and starts over.*", "cut"),
    "time reversed": ("\n".join([LINES[0], *LINES[:0:-1]]), r":3: .*time runs backwards, from 5.990 s to 0.000 s", "increase"),
    "time in years": (column("t_s", lambda t: t * 3e7), r": column 't_s': stamps .* times a second.*, expected .*", "unit"),
    # units and signs that nothing fits
    "raw accelerometer": (column("imu_a", lambda x: x * 16384 / 9.81), r": the accelerometer, declared in m/s\^2, reads 1\.6\d+e\+04 at rest, expected 9.81.*", "scale"),
    "half gravity": (column("imu_a", lambda x: x * 0.5), r": the accelerometer, declared in m/s\^2, reads 4\.9\d* at rest, expected 9.81.*", "scale"),
    "absurd wheels": (column("enc", lambda x: x * 1000.0), r": column 'enc_fl_rad': the wheel turns with .* m/s\), expected at most .* rad/s of .*'s motors", "radius"),
    # metadata
    "metadata of the wrong type": ("# v_desired_mps = fast\n" + TEXT, r":1: v_desired_mps = fast is not valid", "TOML"),
    "metadata as text": ('# v_desired_mps = "0.3"\n' + TEXT, r":1: v_desired_mps = '0.3' is not a number", "m/s"),
    "metadata out of range": ("# soil = \"dry_sand\"\n# v_desired_mps = -1\n" + TEXT, r":2: v_desired_mps = -1 is out of range", "from 0 to 50"),
    "metadata not finite": ("# distance_m = nan\n" + TEXT, r":1: distance_m = nan is out of range", "m"),
    "metadata counts": ("# enc_counts_per_rev = 0\n" + TEXT, r":1: enc_counts_per_rev = 0 is out of range", "1/rev"),
    # nothing to estimate from
    "only a clock": ("t_s,v_cmd_mps\n" + "\n".join(f"{k / 100},0.1" for k in range(100)), r": neither IMU nor encoder samples", "at least one"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_broken_log_is_refused_in_one_line_and_can_be_inspected(name: str, tmp_path: Path) -> None:
    content, expected, hint = CASES[name]
    with pytest.raises(InputError) as caught:
        make.read(tmp_path, content)
    error, path = caught.value, tmp_path / "trial.csv"
    assert re.fullmatch(re.escape(str(path)) + expected, error.message), error.message
    assert hint in error.hint, error.hint
    assert "\n" not in error.message + error.hint
    assert error.exit_code == 3
    report = inspect_logs([path]).files[0]
    assert report.problem or report.doubts


def test_files_of_different_clocks(tmp_path: Path) -> None:
    later = make.only("t_s", *make.WHEELS, change=lambda row: [f"{float(row[0]) + 1e6}", *row[1:]])
    with pytest.raises(InputError, match="have no time in common"):
        make.read(tmp_path, make.only("t_s", *make.IMU), encoders=make.written(tmp_path, later, "enc.csv"))


def test_a_file_given_for_what_it_does_not_hold(tmp_path: Path) -> None:
    other = make.written(tmp_path, make.only("t_s", *make.IMU), "b.csv")
    with pytest.raises(InputError, match="given as --encoders, but nothing in it is of that kind"):
        make.read(tmp_path, TEXT, encoders=other)


def test_counts_of_an_encoder_nobody_describes(tmp_path: Path) -> None:
    robot = make.written(tmp_path, 'name = "mine"\ntitle = "Mine"\n[wheels]\nradius_m = 0.1\n', "mine.toml")
    with pytest.raises(InputError, match="counts per wheel revolution are not known"):
        make.read(tmp_path, re.sub(r"(enc_..)_rad", r"\1_counts", TEXT), robot=robot)


def test_a_last_row_that_is_cut_off_within_a_broken_number_is_named_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"trial\.csv:602: not a table of numbers"):
        make.read(tmp_path, TEXT + "6.0,0.1,-0.07x\n")
