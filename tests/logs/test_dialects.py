"""The same log in the many ways in which programs write CSV gives the same trial."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.logs import make

LINES = make.lines()


TEXT = "\n".join(LINES)
HEADER, *ROWS = LINES


def each(change: Callable[[str], str], header: str = HEADER) -> str:
    """Change every row, and give the header that belongs to it."""
    return "\n".join([header, *map(change, ROWS)])


def quoted(line: str) -> str:
    return ",".join(f'"{cell}"' for cell in line.split(","))


WAYS: dict[str, str | bytes] = {
    "UTF-8 with byte order mark": b"\xef\xbb\xbf" + TEXT.encode(),
    "UTF-16 little endian": TEXT.encode("utf-16"),
    "UTF-16 big endian": b"\xfe\xff" + TEXT.encode("utf-16-be"),
    "UTF-16 without mark": TEXT.encode("utf-16-le"),
    "Windows line ends": TEXT.replace("\n", "\r\n"),
    "old Macintosh line ends": TEXT.replace("\n", "\r").encode(),
    "semicolons": TEXT.replace(",", ";"),
    "semicolons and decimal commas": TEXT.replace(",", ";").replace(".", ","),
    "tabs": TEXT.replace(",", "\t"),
    "tabs and decimal commas": TEXT.replace(",", "\t").replace(".", ","),
    "blanks": TEXT.replace(",", "   "),
    "bars": TEXT.replace(",", "|"),
    "blanks behind commas": TEXT.replace(",", ", "),
    "quoted cells": each(quoted, quoted(HEADER)),
    "quoted decimal commas": each(lambda row: quoted(row).replace(".", ","), quoted(HEADER)),
    "delimiter at the end of every line": each(lambda row: row + ",", HEADER + ","),
    "semicolon at the end of every line": each(lambda row: row + ";", HEADER + ";"),
    "delimiter at the end of rows only": each(lambda row: row + ","),
    "sep= line": "sep=;\n" + TEXT.replace(",", ";"),
    "quoted sep= line": '"sep=,"\n' + TEXT,
    "unnamed index": each(lambda row: "7," + row, "," + HEADER),
    "a column of texts": each(lambda row: row + ',"a, b"', HEADER + ",note"),
    "doubled header that nobody needs": each(lambda row: row + ",1,2", HEADER + ",x,x"),
    "a row of units below the header": "\n".join([HEADER, "s" + ",-" * 10, *ROWS]),
    "preamble": "Recorded by station 4\n\n" + TEXT,
    "upper case": each(str, HEADER.upper()),
    "empty lines": TEXT.replace("\n", "\n\n"),
    "no line end at the end": TEXT,
    "NaN for not sampled": each(lambda row: row + ",NaN", HEADER + ",cur_fl_A"),
}


@pytest.mark.parametrize("way", WAYS)
def test_the_same_trial_comes_out(way: str, tmp_path: Path) -> None:
    make.same(make.read(tmp_path, make.text()), make.read(tmp_path, WAYS[way], "other.csv"))


def test_a_row_that_was_cut_off_at_the_end_is_left_out_and_said(tmp_path: Path) -> None:
    trial = make.read(tmp_path, "\n".join(LINES)[:-40], "cut.csv")
    assert len(trial.imu.t) == len(LINES) - 2
    assert any(f"cut.csv:{len(LINES)}: the last row is cut off" in line for line in trial.warnings)


def test_windows_1252_is_read_and_said(tmp_path: Path) -> None:
    trial = make.read(tmp_path, ("# Bediener = Müller\n" + "\n".join(LINES)).encode("cp1252"))
    assert trial.info.extra == {"Bediener": "Müller"}
    assert any("Windows-1252" in line for line in trial.warnings)


def test_a_million_blank_lines(tmp_path: Path) -> None:
    blank = "\n" * 1_000_000
    trial = make.read(tmp_path, blank + "\n".join(LINES[:300]) + blank + "\n".join(LINES[300:]))
    assert len(trial.imu.t) == len(LINES) - 1
