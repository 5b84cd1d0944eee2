"""The same log in the many ways in which programs write CSV gives the same trial."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from granite_lab.logs import read_trial
from tests.logs import make

LINES = make.lines()


def semicolons(lines: list[str]) -> list[str]:
    return [line.replace(",", ";") for line in lines]


def decimal_commas(lines: list[str]) -> list[str]:
    return [line.replace(",", ";").replace(".", ",") for line in lines]


WAYS: dict[str, Callable[[], str | bytes]] = {
    "UTF-8 with byte order mark": lambda: b"\xef\xbb\xbf" + "\n".join(LINES).encode(),
    "UTF-16 little endian": lambda: "\n".join(LINES).encode("utf-16"),
    "UTF-16 big endian": lambda: b"\xfe\xff" + "\n".join(LINES).encode("utf-16-be"),
    "UTF-16 without mark": lambda: "\n".join(LINES).encode("utf-16-le"),
    "Windows line ends": lambda: "\r\n".join(LINES),
    "old Macintosh line ends": lambda: "\r".join(LINES).encode(),
    "semicolons": lambda: "\n".join(semicolons(LINES)),
    "semicolons and decimal commas": lambda: "\n".join(decimal_commas(LINES)),
    "tabs": lambda: "\n".join(line.replace(",", "\t") for line in LINES),
    "tabs and decimal commas": lambda: "\n".join(line.replace(",", "\t").replace(".", ",") for line in LINES),
    "blanks": lambda: "\n".join(line.replace(",", "   ") for line in LINES),
    "bars": lambda: "\n".join(line.replace(",", "|") for line in LINES),
    "blanks behind commas": lambda: "\n".join(line.replace(",", ", ") for line in LINES),
    "quoted cells": lambda: "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in LINES),
    "quoted decimal commas": lambda: "\n".join(
        ",".join('"' + cell.replace(".", ",") + '"' for cell in line.split(",")) for line in LINES
    ),
    "delimiter at the end of every line": lambda: "\n".join(line + "," for line in LINES),
    "semicolon at the end of every line": lambda: "\n".join(line + ";" for line in LINES),
    "delimiter at the end of rows only": lambda: "\n".join([LINES[0], *(x + "," for x in LINES[1:])]),
    "sep= line": lambda: "\n".join(["sep=;", *semicolons(LINES)]),
    "quoted sep= line": lambda: "\n".join(['"sep=,"', *LINES]),
    "unnamed index": lambda: "\n".join(
        ["," + LINES[0], *(f"{k},{line}" for k, line in enumerate(LINES[1:]))]
    ),
    "a column of texts": lambda: "\n".join([LINES[0] + ",note", *(line + ',"a, b"' for line in LINES[1:])]),
    "doubled header that nobody needs": lambda: "\n".join(
        [LINES[0] + ",x,x", *(line + ",1,2" for line in LINES[1:])]
    ),
    "a row of units below the header": lambda: "\n".join([LINES[0], "s" + ",-" * 10, *LINES[1:]]),
    "preamble": lambda: "\n".join(["Recorded by station 4", "", *LINES]),
    "upper case": lambda: "\n".join([LINES[0].upper(), *LINES[1:]]),
    "empty lines": lambda: "\n\n".join(LINES),
    "no line end at the end": lambda: "\n".join(LINES),
    "NaN for not sampled": lambda: "\n".join(
        [LINES[0] + ",cur_fl_A", *(line + ",NaN" for line in LINES[1:])]
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_the_same_trial_comes_out(way: str, tmp_path: Path) -> None:
    make.same(make.read(tmp_path, make.text()), make.read(tmp_path, WAYS[way](), "other.csv"))


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


def test_six_minutes_are_read_in_two_seconds(tmp_path: Path) -> None:
    """A tenth of the hour that may take 20 s."""
    path = tmp_path / "long.csv"
    t = np.arange(72_000) / 200
    cells = np.random.default_rng(1).normal(0, 0.02, (len(t), 7)) + np.array([0, 0, 9.81, 0, 0, 0, 0])
    rows = [
        f"{a:.6f},{x:.6f},{y:.6f},{z:.6f},{p:.6f},{q:.6f},{r:.6f}" + (f",{s:.6f}" * 4 if k % 2 else ",,,,")
        for k, (a, (x, y, z, p, q, r, s)) in enumerate(zip(t, cells, strict=True))
    ]
    path.write_text("\n".join([make.HEADER, *rows]))
    start = time.process_time()
    trial = read_trial(path)
    assert time.process_time() - start < 2
    assert (len(trial.imu.t), len(trial.wheels.t)) == (72_000, 36_000)
