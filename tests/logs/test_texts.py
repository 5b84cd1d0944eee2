"""Text as programs write it gives the same trial; a broken log is refused in one line, with place and hint."""

# ruff: noqa: E501  # tables, one log a line

import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from granite_lab.errors import InputError, LabError
from granite_lab.logs import inspect_logs, read_trial
from tests.logs import make
from tests.soak import SOAK

LINES, COLUMNS = make.lines(), make.COLUMNS
PLAIN = "\n".join(LINES)
HEADER, *ROWS = LINES


def each(change: Callable[[str], str], header: str = HEADER) -> str:
    """Change every row, and give the header that belongs to it."""
    return "\n".join([header, *map(change, ROWS)])


def quoted(line: str) -> str:
    return ",".join(f'"{cell}"' for cell in line.split(","))


WAYS: dict[str, str | bytes] = {
    "UTF-8 with byte order mark": b"\xef\xbb\xbf" + PLAIN.encode(),
    "UTF-16 little endian": PLAIN.encode("utf-16"),
    "UTF-16 big endian": b"\xfe\xff" + PLAIN.encode("utf-16-be"),
    "UTF-16 without mark": PLAIN.encode("utf-16-le"),
    "Windows line ends": PLAIN.replace("\n", "\r\n"),
    "old Macintosh line ends": PLAIN.replace("\n", "\r").encode(),
    "semicolons": PLAIN.replace(",", ";"),
    "semicolons and decimal commas": PLAIN.replace(",", ";").replace(".", ","),
    "tabs": PLAIN.replace(",", "\t"),
    "tabs and decimal commas": PLAIN.replace(",", "\t").replace(".", ","),
    "blanks": PLAIN.replace(",", "   "),
    "bars": PLAIN.replace(",", "|"),
    "blanks behind commas": PLAIN.replace(",", ", "),
    "quoted cells": each(quoted, quoted(HEADER)),
    "quoted decimal commas": each(lambda row: quoted(row).replace(".", ","), quoted(HEADER)),
    "delimiter at the end of every line": each(lambda row: row + ",", HEADER + ","),
    "semicolon at the end of every line": each(lambda row: row + ";", HEADER + ";"),
    "delimiter at the end of rows only": each(lambda row: row + ","),
    "sep= line": "sep=;\n" + PLAIN.replace(",", ";"),
    "quoted sep= line": '"sep=,"\n' + PLAIN,
    "unnamed index": each(lambda row: "7," + row, "," + HEADER),
    "a column of texts": each(lambda row: row + ',"a, b"', HEADER + ",note"),
    "doubled header that nobody needs": each(lambda row: row + ",1,2", HEADER + ",x,x"),
    "a row of units below the header": "\n".join([HEADER, "s" + ",-" * 10, *ROWS]),
    "preamble": "Recorded by station 4\n\n" + PLAIN,
    "upper case": each(str, HEADER.upper()),
    "empty lines": PLAIN.replace("\n", "\n\n"),
    "no line end at the end": PLAIN,
    "NaN for not sampled": each(lambda row: row + ",NaN", HEADER + ",cur_fl_A"),
}


@pytest.mark.parametrize("way", WAYS)
def test_the_same_trial_comes_out(way: str, tmp_path: Path) -> None:
    make.same(make.plain(), make.read(tmp_path, WAYS[way], "other.csv"))


def test_windows_1252_is_read_and_said(tmp_path: Path) -> None:
    trial = make.read(tmp_path, ("# Bediener = Müller\n" + PLAIN).encode("cp1252"))
    assert trial.info.extra == {"Bediener": "Müller"}
    assert any("Windows-1252" in line for line in trial.warnings)


def test_a_million_blank_lines(tmp_path: Path) -> None:
    blank = "\n" * 1_000_000
    trial = make.read(tmp_path, blank + "\n".join(LINES[:300]) + blank + "\n".join(LINES[300:]))
    assert len(trial.imu.t) == len(LINES) - 1


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


TEXT = PLAIN + "\n"

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
    "missing time": (header(lambda h: h.replace("t_s", "x")), r":1: column 't' is missing.*", ""),
    "misspelt wheel": (header(lambda h: h.replace("enc_fr", "encfr")), r":1: column 'enc_fr' is missing.*", "encfr_rad"),
    "no unit": (header(lambda h: h.replace("imu_gy_radps", "imu_gy")), r":1: column 'imu_gy' is missing.*", "imu_gy_radps"),
    "unknown unit": (header(lambda h: h.replace("ax_mps2", "ax_mps3")), r":1: column 'imu_ax_mps3': unit 'mps3' is not known, expected one of m/s\^2.*", "mps2"),
    "unit of another kind": (header(lambda h: h.replace("gy_radps", "gy_rad")), r":1: column 'imu_gy_rad': unit 'rad' is one of angle, but imu_gy is angular rate", "rad/s"),
    "duplicate column": (header(lambda h: h.replace("imu_ay", "imu_ax")), r":1: 'imu_ax_mps2#1' \(column 2\) and 'imu_ax_mps2#2' \(column 3\) both are imu_ax.*", 'name = "imu_ax_mps2#2"'),
    "two units of one channel": (header(lambda h: h.replace("imu_ay_mps2", "imu_ax_g")), r":1: 'imu_ax_mps2' \(column 2\) and 'imu_ax_g' \(column 3\) both are imu_ax.*", "remove"),
    "header too short": (header(lambda h: h.rsplit(",", 1)[0]), r":1: the header names 10 columns, the rows below have 11", "one name a column"),
    "header too long": (header(lambda h: h + ",more,and_more"), r":1: the header names 13 columns, the rows below have 11", "one name a column"),
    "comma in a name": (header(lambda h: h.replace("t_s", "t, in s")), r":1: the header names 12 columns, the rows below have 11", "quote"),
    "unknown layout": ("alpha,beta,gamma\n1,2,3\n2,3,4\n", r":1: the layout is not known: alpha, beta, gamma", "inspect"),
    # cells
    "hexadecimal numbers": (each(lambda row: "0x1F" + row[row.index(","):]), r":2: column 't_s': '0x1F' is not a number, expected one; 600 of 600 rows are damaged", "empty"),
    "decimal commas, comma separated": (TEXT.replace(".", ","), r":1: the header names 11 columns, the rows below have \d+", "decimal comma"),
    # clocks
    "one row": ("\n".join(LINES[:2]), r": column 't_s' does not advance, expected time stamps", "two rows"),
    "constant time": (column("t_s", lambda _: 5.0), r": column 't_s' does not advance, expected time stamps", ""),
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


def test_files_of_different_clocks_and_of_other_sensors(tmp_path: Path) -> None:
    later = make.only("t_s", *make.WHEELS, change=lambda row: [f"{float(row[0]) + 1e6}", *row[1:]])
    with pytest.raises(InputError, match="have no time in common"):
        make.read(
            tmp_path,
            make.only("t_s", *make.IMU),
            beside={"encoders": make.written(tmp_path, later, "enc.csv")},
        )
    other = make.written(tmp_path, make.only("t_s", *make.IMU), "b.csv")
    with pytest.raises(InputError, match="given as --encoders, but nothing in it is of that kind"):
        make.read(tmp_path, TEXT, beside={"encoders": other})


def test_counts_of_an_encoder_nobody_describes(tmp_path: Path) -> None:
    robot = make.written(tmp_path, 'name = "mine"\ntitle = "Mine"\n[wheels]\nradius_m = 0.1\n', "mine.toml")
    with pytest.raises(InputError, match="counts per wheel revolution are not known"):
        make.read(tmp_path, re.sub(r"(enc_..)_rad", r"\1_counts", TEXT), robot=robot)


EXAMPLES = 3000 if SOAK else 30
GOOD = make.text(duration=2.0).encode()
ROWS_OF_BYTES = GOOD.split(b"\n")

CELLS = [
    *(b"", b"nan", b"inf", b"-", b"1e400", b"1e-320", b"1,5", b"0x10", b"=1+1", b"true", b"9" * 400, b"t_s"),
    *(b"'", b'"', b'""', b"#", b",", b";", b"\t", b"\r", b"\n", b"\x00", b"\xff\xfe", b"# a = 1"),
]
cells = st.sampled_from(CELLS)
rows, places = st.integers(0, len(ROWS_OF_BYTES) - 1), st.integers(0, len(GOOD))
damage = st.one_of(
    st.tuples(st.just("cell"), rows, st.integers(0, 10), cells),
    st.tuples(st.just("swap"), rows, rows, st.just(b"")),
    st.tuples(st.just("line"), rows, st.just(0), st.binary(max_size=40)),
    st.tuples(
        st.just("line"),
        rows,
        st.just(0),
        st.sampled_from([GOOD[:90], b"# note", b'"', b"\0" * 512, b"1;2;3"]),
    ),
    st.tuples(st.just("drop cell"), rows, st.integers(0, 10), st.just(b"")),
    st.tuples(st.just("add cell"), rows, st.integers(0, 10), cells),
    st.tuples(st.just("rows"), rows, rows, st.just(b"")),  # cut out
    st.tuples(st.just("again"), rows, rows, st.just(b"")),  # written twice
    st.tuples(st.just("column"), st.integers(0, 10), st.integers(0, 10), cells),
    st.tuples(st.just("bytes"), places, st.none(), st.binary(max_size=20)),
    st.tuples(st.just("bytes"), places, places, st.just(b"")),  # cut out
)


def with_cell(line: bytes, place: int, text: bytes, kind: str = "cell") -> bytes:
    """Replace, drop or add a cell."""
    row = line.split(b",")
    place = min(place, len(row) - 1)
    row[place : place + (kind != "add cell")] = [] if kind == "drop cell" else [text]
    return b",".join(row)


def damaged(steps: list[tuple[str, int, int | None, bytes]]) -> bytes:
    """Apply some damage to the good log."""
    content = GOOD
    for kind, a, other, text in steps:
        lines, b = content.split(b"\n"), a if other is None else other
        if kind == "bytes":
            content = content[: min(a, b)] + text + content[max(a, b) :]
            continue
        if kind == "line":
            lines.insert(a, text)
        elif kind == "swap" and max(a, b) < len(lines):
            lines[a], lines[b] = lines[b], lines[a]
        elif kind == "rows":
            del lines[min(a, b) : max(a, b)]
        elif kind == "again":
            lines[a:a] = lines[min(a, b) : max(a, b)]
        elif kind == "column":
            lines = [
                with_cell(line, a, text if k else line.split(b",")[b % line.count(b",")])
                if line.count(b",")
                else line
                for k, line in enumerate(lines)
            ]
        elif a < len(lines):
            lines[a] = with_cell(lines[a], b, text, kind)
        content = b"\n".join(lines)
    return content


def check(path: Path) -> bool:
    """Read a log and hold what comes out to its promises; return whether it was refused."""
    refused: LabError | None = None
    begin = time.process_time()
    try:
        trial = read_trial(path)
    except LabError as error:
        refused = error
    else:
        if trial.imu is not None:
            assert np.isfinite(trial.imu.t).all()
            assert (np.diff(trial.imu.t) > 0).all()
            for values in (trial.imu.specific_force, trial.imu.angular_rate):
                assert (np.isfinite(values).all(axis=0) | np.isnan(values).all(axis=0)).all()
        if trial.wheels is not None:
            assert (np.diff(trial.wheels.t) > 0).all()
            assert not np.isinf(trial.wheels.angle).any()
        assert all("\n" not in line for line in trial.warnings)
    if refused:
        assert refused.message.startswith(str(path)), refused.message
        assert "\n" not in refused.message
        assert refused.hint
        assert refused.exit_code == 3
    report = inspect_logs([path]).files[0]
    assert report.as_json()
    if report.trial is not None:
        own = make.written(path.parent, report.to_map_toml(), "map.toml")
        make.same(inspect_logs([path], map=own).files[0].trial, report.trial, rtol=1e-12, atol=1e-12)
    assert time.process_time() - begin < 10.0
    return refused is not None


many = settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck))
numbers = st.floats(allow_nan=True, width=32) | st.none()


@given(steps=st.lists(damage, min_size=1, max_size=4))
@example(steps=[("cell", 2, 0, b"1e-320")])  # two stamps nearer to each other than any logger writes
@many
def test_a_damaged_log(steps: list[tuple[str, int, int | None, bytes]], tmp_path: Path) -> None:
    check(make.written(tmp_path, damaged(steps)))


@given(content=st.binary(max_size=300))
@many
def test_any_bytes(content: bytes, tmp_path: Path) -> None:
    check(make.written(tmp_path, content))


@given(rows=st.lists(st.lists(numbers, min_size=11, max_size=11), max_size=12))
@example(rows=[[0.0] * 11, [2.0**-9, *[0.0] * 9, 1.0]])  # a wheel whose only step no wheel can make
@many
def test_any_numbers(rows: list[list[float | None]], tmp_path: Path) -> None:
    table = [",".join("" if x is None else repr(x) for x in row) for row in rows]
    check(make.written(tmp_path, "\n".join([make.HEADER, *table])))
