"""Tables as loggers write them: lists in cells, names that occur twice, any header; and the maps of these."""

# ruff: noqa: E501  # tables, one log a line

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from granite_lab.errors import InputError
from granite_lab.logs import inspect_logs, read_trial
from tests.logs import make
from tests.soak import SOAK, in_turn, sampled

SAMPLES = Path(__file__).parents[2] / "data" / "samples"
HEADER, *ROWS = make.lines()
ZEROS = ", ".join(["0.001", *["0.0"] * 8])

# How a cell with a list is written, and what the header calls it.
LISTS: dict[str, str] = {
    "a list": f'"[{ZEROS}]"',
    "a tuple": f'"({ZEROS})"',
    "a set": f'"{{{ZEROS}}}"',
    "lists in a list": '"[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]"',
    "blanks between numbers": f'"[{ZEROS.replace(",", "")}]"',
    "blanks between numbers without quotes": f"[{ZEROS.replace(',', '')}]",
    "semicolons": f'"{ZEROS.replace(",", ";")}"',
    "bars": f'"{ZEROS.replace(", ", "|")}"',
    "tabs": '"1\t2\t3\t4\t5\t6\t7\t8\t9\t10\t11\t12"',
    "doubled quotes": '"{""frame"": ""imu"", ""cov"": [0.0, 0.0, 0.0]}"',
    "a line break": '"[0.0, 0.0,\n 0.0, 0.0]"',
    "many line breaks": '"0.0\n0.0\n0.0\n0.0\n0.0\n0.0\n0.0\n0.0\n0.0\n0.0\n0.0\n0.0"',
    "a quote as a sign of inches": 'a wheel of 7"',
    "JSON without a name": '"{}"',
}


def with_lists(cell: str, place: int, lines: list[str], delimiter: str = ",") -> str:
    """Return a log with a further column of lists."""

    def put(line: str, text: str) -> str:
        cells = line.split(delimiter)
        return delimiter.join([*cells[:place], text, *cells[place:]])

    header, *rows = lines
    return "\n".join([put(header, "covariance"), *(put(row, cell) for row in rows)]) + "\n"


@pytest.mark.parametrize(("name", "place"), in_turn(LISTS, [1, 11]))  # behind the stamps, at the end
def test_lists_in_cells_are_no_columns(name: str, place: int, tmp_path: Path) -> None:
    path = make.written(tmp_path, with_lists(LISTS[name], place, [HEADER, *ROWS]))
    trial, report = read_trial(path), inspect_logs([path]).files[0]
    make.same(trial, make.plain())
    assert not any("left out" in line for line in trial.warnings)
    assert report.dialect.delimiter == ","
    assert report.columns[place].to == ()
    make.same(make.mapped(tmp_path, path), trial)


@pytest.mark.parametrize(
    ("style", "cell"),
    in_turn([";,", "\t,", ";.", "\t.", "|."], ['"[0.0, 0.0, 0.0]"', '"(1; 2; 3)"', '"a\tb"']),
)
def test_lists_in_cells_of_other_delimiters_and_decimal_commas(style: str, cell: str, tmp_path: Path) -> None:
    """The delimiter and the sign of decimals."""
    sign, decimal = style
    lines = [line.replace(".", decimal).replace(",", sign) if decimal == "." else
             line.replace(",", sign).replace(".", ",") for line in [HEADER, *ROWS]]  # fmt: skip
    path = make.written(tmp_path, with_lists(cell, 1, lines, sign))
    make.same(read_trial(path), make.plain())
    make.same(make.mapped(tmp_path, path), make.plain())


def test_a_sample_with_lists_reads_as_the_sample(tmp_path: Path) -> None:
    """A column of covariances in a comma-separated table, as exports of recordings have it."""
    sample = SAMPLES / "virtual_v0.3_r1.csv"
    text = sample.read_text(encoding="utf-8")
    begin = text.index("t_s,")
    body = with_lists('"(0.001, 0.0, 0.0, 0.0, 0.001, 0.0, 0.0, 0.0, 0.001)"', 1, text[begin:].splitlines())
    trial = read_trial(make.written(tmp_path, text[:begin] + body))
    make.same(trial, read_trial(sample))
    assert trial.warnings == ()


TWICE = ",".join(["t", "cov", *"xyzxyz", *make.WHEELS])


def twice() -> str:
    """Return a log whose gyroscope and accelerometer have the same names, the gyroscope first."""
    order = [0, 4, 5, 6, 1, 2, 3, 7, 8, 9, 10]
    rows = [[row.split(",")[i] for i in order] for row in ROWS]
    return "\n".join([TWICE, *(",".join([row[0], f'"[{ZEROS}]"', *row[1:]]) for row in rows)]) + "\n"


def a_map(columns: dict[str, tuple[str, str]], table: str = "") -> str:
    entries = [
        f'[[column]]\nname = "{n}"\nto = ["{to}"]\nunit = "{unit}"\n' for n, (to, unit) in columns.items()
    ]
    return "\n".join(['name = "twice"', table, *entries])


WHEELS = {name: (name[:6], "rad") for name in make.WHEELS}


def test_a_map_that_names_one_of_two_columns_is_told_how_to_tell_them_apart(tmp_path: Path) -> None:
    path = make.written(tmp_path, twice())
    text = a_map({"t": ("t", "s"), **{axis: (f"imu_a{axis}", "m/s^2") for axis in "xyz"}, **WHEELS})
    own = make.written(tmp_path, text, "map.toml")
    with pytest.raises(InputError) as caught:
        read_trial(path, map=own)
    assert caught.value.message == (
        f"{path}:1: 'x#1' (column 3) and 'x#2' (column 6) both are imu_ax, expected one column for it"
    )
    assert 'name = "x#2" in a column map' in caught.value.hint
    assert "names = […] under its [table]" in caught.value.hint
    report = inspect_logs([path], map=own).files[0]
    assert (report.problem, report.hint) == (caught.value.message, caught.value.hint)


def test_columns_of_one_name_are_told_apart_by_their_number_or_by_new_names(tmp_path: Path) -> None:
    path = make.written(tmp_path, twice())
    numbers = {"t": ("t", "s"), **WHEELS}
    numbers |= {
        f"{axis}#{k}": (f"imu_{'ga'[k - 1]}{axis}", ["rad/s", "m/s^2"][k - 1])
        for axis in "xyz"
        for k in (1, 2)
    }
    names = ["t", "cov", "gx", "gy", "gz", "ax", "ay", "az", *make.WHEELS]
    renamed = {"t": ("t", "s"), **WHEELS}
    renamed |= {n: (f"imu_{n}", "rad/s" if n[0] == "g" else "m/s^2") for n in names[2:8]}
    for text in (a_map(numbers), a_map(renamed, f"[table]\nnames = {names}")):
        own = make.written(tmp_path, text, "map.toml")
        trial = read_trial(path, map=own)
        make.same(trial, make.plain())
        report = inspect_logs([path], map=own).files[0]
        assert (report.layout, report.problem) == ("twice", "")
        back = make.written(tmp_path, report.to_map_toml(), "back.toml")
        make.same(read_trial(path, map=back), trial)


def test_names_that_occur_twice_are_one_doubt_and_the_draft_of_a_map_tells_them_apart(tmp_path: Path) -> None:
    path = make.written(tmp_path, twice())
    report = inspect_logs([path]).files[0]
    (said,) = (line for line in report.doubts if "more than once" in line)
    assert said == (
        "trial.csv:1: names that occur more than once: 'x' (column 3, column 6), 'y' (column 4, column 7), "
        "'z' (column 5, column 8); in a column map they are 'x#1' and 'x#2', …"
    )
    assert "'x#1' and 'x#2'" in report.hint
    assert {c.name: c.to for c in report.columns}["z#2"] == ("imu_az",)
    trial = make.mapped(tmp_path, path)
    np.testing.assert_array_equal(trial.imu.specific_force, make.plain().imu.specific_force)
    np.testing.assert_array_equal(trial.wheels.angle, make.plain().wheels.angle)


# How a log is written otherwise, so that its map must say so.
Change = Callable[[list[list[str]]], list[list[str]]]


def scaled(places: slice, factor: float) -> Change:
    def change(rows: list[list[str]]) -> list[list[str]]:
        for row in rows:
            row[places] = [repr(float(cell) * factor) for cell in row[places]]
        return rows

    return change


STRANGE = [
    "clock",
    *(f"accel_{a}" for a in "xyz"),
    *(f"gyro_{a}" for a in "xyz"),
    *(f"wheel_{w}" for w in ("FL", "FR", "RL", "RR")),
]
HEADERS: dict[str, list[str] | None] = {
    "canonical": make.COLUMNS,
    "strange": STRANGE,
    "unnamed first": ["", *STRANGE[1:]],
    "with units": [
        "clock [s]",
        *(f"{n} [m/s^2]" for n in STRANGE[1:4]),
        *(f"{n} (rad/s)" for n in STRANGE[4:7]),
        *(f"{n} [rad]" for n in STRANGE[7:]),
    ],
    "none": None,
}
UNITS: dict[str, Change] = {
    "as said": lambda rows: rows,
    "g": scaled(slice(1, 4), 1 / 9.80665),
    "mg": scaled(slice(1, 4), 1000 / 9.80665),
    "deg/s": scaled(slice(4, 7), 180 / np.pi),
    "ms": scaled(slice(0, 1), 1e3),
    "ns": scaled(slice(0, 1), 1e9),
    "deg": scaled(slice(7, 11), 180 / np.pi),
}
SIGNS = {
    "comma": (",", "."),
    "semicolon": (";", ","),
    "tab": ("\t", "."),
    "blank": ("  ", "."),
    "bar": ("|", "."),
}


def logged(header: list[str] | None, change: Change, sign: str, decimal: str, extra: str) -> str:
    rows = change([row.split(",") for row in ROWS])
    lines = [[cell.replace(".", decimal) for cell in row] for row in rows]
    names = [] if header is None else [header]
    table = [*([*line, extra] if extra else line for line in [*names, *lines])]
    return "\n".join(sign.join(line) for line in table) + "\n"


@given(
    header=st.sampled_from(sorted(HEADERS)), unit=st.sampled_from(sorted(UNITS)), way=st.sampled_from(sorted(SIGNS)),
    extra=st.sampled_from(["", "note", '"[0.0, 0.0]"']),
)  # fmt: skip
@settings(max_examples=200 if SOAK else 12, suppress_health_check=list(HealthCheck))
def test_the_map_that_inspection_writes_gives_the_trial_that_inspection_saw(
    header: str, unit: str, way: str, extra: str, tmp_path: Path
) -> None:
    sign, decimal = SIGNS[way]
    names = HEADERS[header]
    if way == "blank" and (header in ("with units", "unnamed first") or extra.startswith('"')):
        return
    path = make.written(tmp_path, logged(names, UNITS[unit], sign, decimal, extra))
    report = inspect_logs([path]).files[0]
    assert report.trial is not None, report.problem
    own = make.written(tmp_path, report.to_map_toml(), "map.toml")
    again = inspect_logs([path], map=own).files[0]
    assert again.layout == "trial"
    make.same(again.trial, report.trial, rtol=1e-12, atol=1e-12)
    assert not any("converted" in line or "not in the unit" in line for line in again.trial.warnings)
    assert [(c.name, c.to, c.unit) for c in again.columns if c.to] == [
        (c.name, c.to, c.unit) for c in report.columns if c.to
    ]
    if header != "none" and unit in ("as said", "g", "mg", "ms", "ns"):
        make.same(read_trial(path, map=own), make.plain(), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", sampled(sorted(path.name for path in SAMPLES.glob("*.csv"))))
def test_the_map_of_a_sample_reads_the_sample(name: str, tmp_path: Path) -> None:
    make.same(make.mapped(tmp_path, SAMPLES / name), read_trial(SAMPLES / name))


@pytest.mark.parametrize(
    "sign", ["(", "[", ")", "a(", "(s", "x (", "_", "a_", " ", "1", "1.", '"', '""', "-", "[s]"]
)
def test_a_header_of_40_000_signs_takes_no_longer_than_its_length(sign: str, tmp_path: Path) -> None:
    name = sign * (40_000 // len(sign))
    rows = "\n".join(f"{k / 100},{k % 7},{k % 5}" for k in range(200))
    path = make.written(tmp_path, f"t,a{name}x,b\n{rows}\n")
    begin = time.process_time()
    inspect_logs([path])
    assert time.process_time() - begin < 2.0


def test_a_row_of_100_000_cells_and_a_line_of_20_megabytes_are_read_past_in_time(tmp_path: Path) -> None:
    for line in ("1," * 100_000, "7" * 20_000_000):
        path = make.written(tmp_path, "\n".join([HEADER, *ROWS[:300], line, *ROWS[300:]]))
        begin = time.process_time()
        trial = read_trial(path)
        assert time.process_time() - begin < 5.0
        make.same(trial, make.plain())
        assert any(line.startswith("trial.csv:302: ") for line in trial.warnings)
