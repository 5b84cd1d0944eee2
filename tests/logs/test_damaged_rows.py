"""Damaged rows are left out with one warning that names the line; what is left is read to the last bit."""

# ruff: noqa: E501  # tables, one log a line

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from granite_lab.errors import InputError
from granite_lab.logs import inspect_logs, read_trial, rows
from granite_lab.logs.trial import Trial
from tests.logs import make

HEADER, *ROWS = make.lines()
SAMPLE = Path(__file__).parents[2] / "data" / "samples" / "virtual_v0.5_r1.csv"


def with_rows(change: Callable[[list[str]], list[str] | None]) -> str:
    """Return the log with other rows; row 0 stands in line 2."""
    rows = list(ROWS)
    return "\n".join([HEADER, *(change(rows) or rows)]) + "\n"


def cell(row: int, column: str, text: str) -> str:
    def change(rows: list[str]) -> None:
        cells = rows[row].split(",")
        cells[make.COLUMNS.index(column)] = text
        rows[row] = ",".join(cells)

    return with_rows(change)


def replaced(row: int, text: str) -> str:
    return with_rows(lambda rows: [*rows[:row], text, *rows[row + 1 :]])


def added(row: int, *texts: str) -> str:
    return with_rows(lambda rows: [*rows[:row], *texts, *rows[row:]])


def one_long_and_one_short(rows: list[str]) -> None:
    rows[50] += ",1.5"
    rows[60] = rows[60].rpartition(",")[0]


def a_sector_of_zeros(rows: list[str]) -> None:
    rows[50] = rows[50][:20] + "\0" * 512 + rows[60][-20:]
    del rows[51:61]


# name: (log, rows that are missing from the trial, what is said)
LEFT_OUT: dict[str, tuple[str, list[int], str]] = {
    "a text": (cell(10, "imu_ax_mps2", "fast"), [10], r":12: column 'imu_ax_mps2': 'fast' is not a number.*: the row was left out"),
    "a time of day among stamps": (cell(38, "t_s", "12:30:05"), [38], r":40: column 't_s': '12:30:05' is not a number.*"),
    "a word in the last row": (cell(599, "enc_rl_rad", "END"), [599], r":601: column 'enc_rl_rad': 'END' is not a number.*"),
    "a formula": (cell(28, "enc_fl_rad", "=cmd|' /C calc'!A0"), [28], r":30: column 'enc_fl_rad': .*=cmd.* is not a number.*"),
    "braces": (cell(28, "enc_fl_rad", "{0!r}"), [28], r":30: .*'{0!r}' is not a number.*"),
    "a script": (cell(29, "enc_fl_rad", "<script>alert(1)</script>"), [29], r":31: .*'<script>.*' is not a number.*"),
    "the letter O for zero": (cell(75, "imu_gz_radps", "O.01"), [75], r":77: column 'imu_gz_radps': 'O.01' is not a number.*"),
    "an underscore": (cell(75, "imu_gz_radps", "1_000"), [75], r":77: .*'1_000' is not a number.*"),
    "a hexadecimal number": (cell(75, "imu_gz_radps", "0x1F"), [75], r":77: .*'0x1F' is not a number.*"),
    "digits of another script": (cell(75, "imu_gz_radps", "\u0661"), [75], r":77: .* is not a number.*"),
    "infinity": (cell(48, "imu_az_mps2", "inf"), [48], r":50: column 'imu_az_mps2': 'inf' is not finite.*"),
    "a number beyond all numbers": (cell(48, "imu_az_mps2", "1e999"), [48], r":50: .*'1e999' is not finite.*"),
    "a decimal comma": (cell(48, "imu_az_mps2", '"9,81"'), [48], r":50: .*'9,81' is not a number.*"),
    "a cell too many": (replaced(199, ROWS[199] + ",1.5"), [199], r":201: 12 cells, expected 11: the row was left out"),
    "cells too few": (replaced(18, "0.18,1,2"), [18], r":20: 3 cells, expected 11: the row was left out"),
    "one cell": (replaced(18, "brownout"), [18], r":20: 1 cell, expected 11.*"),
    "one row too long and one too short": (
        with_rows(one_long_and_one_short), [50, 60], r":52: 12 cells, expected 11: 2 damaged rows were left out, lines 52, 62",
    ),
    "a row that ends early at the end": (make.text()[:-40], [599], r":601: \d+ cells, expected 11: the row was left out"),
    "a row that ends in half a number": (make.text() + "6.0,0.1,-0.07x\n", [], r":602: 3 cells, expected 11.*"),
    "a sector of zeros": (with_rows(a_sector_of_zeros), [*range(50, 61)], r":52: zero bytes, expected cells of numbers.*"),
    "a cell of 200 kB": (cell(28, "imu_ax_mps2", "1" * 200_000), [28], r":30: .*11111…' is not finite.*"),
    "a quoted cell of 200 kB": (cell(28, "imu_ax_mps2", f'"{"1" * 200_000}"'), [28], r":30: .*"),
    "a quote that is not closed": (cell(28, "imu_ax_mps2", '"0.1'), [28], r":30: a quote that is not closed.*"),
    "a quote in the last cell": (cell(28, "enc_rr_rad", '"0.1'), [28], r":30: a quote that is not closed.*"),
    "the header again": (added(198, HEADER), [], r":200: the header stands here again"),
    "the header after every start": (
        with_rows(lambda rows: [x for k, row in enumerate(rows) for x in ([HEADER] if k % 50 == 49 else []) + [row]]), [],
        r":51: the header stands here again, 12 times, lines 51, 102, 153, 204, 255, …",
    ),
    "a comment": (added(198, "# wheel touched a stone"), [], r":200: a comment among the rows passed over"),
    "comments": (added(198, "# one", " # two", "#"), [], r":200: 3 comments among the rows passed over, lines 200, 201, 202"),
}  # fmt: skip


def held_against(trial: Trial, missing: list[int], tmp_path: Path) -> None:
    rest = [row for k, row in enumerate(ROWS) if k not in missing]
    make.same(trial, make.read(tmp_path, "\n".join([HEADER, *rest]), "rest.csv"))


@pytest.mark.parametrize("name", LEFT_OUT)
def test_a_damaged_row_is_left_out_and_named_once(name: str, tmp_path: Path) -> None:
    content, missing, said = LEFT_OUT[name]
    path = make.written(tmp_path, content)
    trial = read_trial(path)
    held_against(trial, missing, tmp_path)
    for lines in (trial.warnings, inspect_logs([path]).files[0].doubts):
        assert len([line for line in lines if re.fullmatch(r"trial\.csv" + said, line)]) == 1, lines
        assert len([line for line in lines if line.startswith("trial.csv:")]) == 1, lines


def test_only_rows_that_begin_with_no_number_are_split_though_comments_hold_quotes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    split, seen = rows.split, []
    monkeypatch.setattr(rows, "split", lambda row, sign: seen.append(row) or split(row, sign))
    body = b't,a\n0,1\n1,2\n,3\n# "note"\nt,a\n2,4\n'
    found = rows.checked(b'# soil = "dry_sand"\n' + body.replace(b'"', b""), 3, ",", 2, headers={b"t,a"})
    assert (found.lines.tolist(), found.headers, found.comments) == ([3, 4, 5, 8], (7,), (6,))
    assert seen == [",3"]
    each = rows.checked(b"#\n" + body, 3, ",", 2, headers={b"t,a"})  # a quote among the rows: all are split
    assert len(seen) == 1 + 4
    assert (each.text, each.lines.tolist(), each.headers) == (found.text, found.lines.tolist(), found.headers)


@pytest.mark.parametrize("row", [0, 10, 300])
def test_a_damaged_date_is_left_out_wherever_it_stands(row: int, tmp_path: Path) -> None:
    def dated(k: int, line: str) -> str:
        stamp, _, rest = line.partition(",")
        return f"2{'O' if k == row else '0'}26-03-01T12:00:{float(stamp):09.6f}Z,{rest}"

    trial = make.read(tmp_path, "\n".join([HEADER, *(dated(k, line) for k, line in enumerate(ROWS))]))
    assert len(trial.imu.t) == len(ROWS) - 1
    assert len([x for x in trial.warnings if f"trial.csv:{row + 2}: column 't_s': '2O26" in x]) == 1


def test_zero_bytes_at_the_end_of_a_file_that_was_not_closed_are_no_row(tmp_path: Path) -> None:
    trial = make.read(tmp_path, make.text().encode() + bytes(1 << 16))
    held_against(trial, [], tmp_path)
    assert any("65536 zero bytes at the end" in line for line in trial.warnings)


def test_damage_in_a_column_that_nobody_needs_does_no_harm(tmp_path: Path) -> None:
    rows = [f"{row},{'ok' if k % 7 else k}" for k, row in enumerate(ROWS)]
    trial = make.read(tmp_path, "\n".join([HEADER + ",battery", *rows]))
    held_against(trial, [], tmp_path)
    assert not any("damaged" in line or "left out" in line for line in trial.warnings)


def test_more_damage_than_one_row_in_a_hundred_is_refused_with_its_first_line(tmp_path: Path) -> None:
    """A digit that became another one does not show; where much shows, too much does not."""
    for count, refused in ((8, False), (9, True)):
        rows = [row + ",9" if k % 60 == 30 and k // 60 < count else row for k, row in enumerate(ROWS)]
        path = make.written(tmp_path, "\n".join([HEADER, *rows]))
        if refused:
            with pytest.raises(InputError, match=r":32: 12 cells, expected 11; 9 of 600 rows are") as caught:
                read_trial(path)
            assert "[table]" in caught.value.hint
            assert inspect_logs([path]).files[0].problem == caught.value.message
        else:
            held_against(read_trial(path), [30 + 60 * k for k in range(8)], tmp_path)


def test_another_header_in_the_middle_is_refused(tmp_path: Path) -> None:
    """The columns behind it have other places, and their numbers would be taken for others."""
    names = HEADER.split(",")
    other = ",".join([names[0], *names[4:7], *names[1:4], *names[7:]])
    with pytest.raises(InputError, match=r":200: another header in the middle") as caught:
        make.read(tmp_path, added(198, other))
    assert "cut the file" in caught.value.hint


def test_a_row_too_long_in_a_log_without_header_hides_no_column(tmp_path: Path) -> None:
    """As on the memory card of a microcontroller: sensors of two rates, a row of one damaged."""
    text = SAMPLE.read_text(encoding="utf-8")
    rows = text[text.index("t_s,") :].split("\n")[1:401]
    rows[200] += ",0.000000"
    path = make.written(tmp_path, "\n".join(rows) + "\n", "log.csv")
    report = inspect_logs([path]).files[0]
    assert "log.csv:1: no header line" in report.problem
    assert "--write-map" in report.hint
    to = {column.name: column.to for column in report.columns}
    assert to | {"column 1": ("t",), "column 4": ("imu_az",)} == to
    assert len([line for line in report.doubts if "log.csv:201: " in line]) == 1
    assert {bool(np.isfinite(column.low)) for column in report.columns if column.filled} == {True}
