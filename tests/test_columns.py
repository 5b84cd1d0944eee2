"""A table in Python: what each kind of value is printed as, and what stands in the CSV."""

import csv
import io
import math
from typing import NamedTuple

import pytest

from granite_lab.columns import Cell, Column, FilledTable, Table, words
from granite_lab.estimate import Estimate


class Drive(NamedTuple):
    name: str
    speed: float
    slip: Estimate
    wheels: int = 4
    note: str | None = None


class Log(NamedTuple):
    drive: Drive


SLIP = Column[Drive]("slip", lambda d: d.slip, "slip slip_std", unit="%", scale=100)
DRIVES = Table[Drive](
    "drives",
    "Drives",
    Column("name of it", lambda d: d.name),
    Column("speed", lambda d: d.speed, "speed_mmps", unit="mm/s", scale=1e3, digits=2),
    SLIP,
    Column("wheels", lambda d: d.wheels, "wheels"),
    Column("note", lambda d: d.note),
    note="What drives are.",
)
ONE = Drive("a", 0.31234, Estimate(0.1234, 0.0051))


def texts(table: FilledTable) -> list[str]:
    return [cell.text for cell in table.rows[0]]


def test_values_are_printed_by_their_kind_and_the_csv_holds_them_in_the_unit_of_the_record() -> None:
    table = DRIVES.fill([ONE])
    assert texts(table) == ["a", "310", "12.3 ± 0.5", "4", "–"]
    assert [c.title for c in table.columns] == ["name of it", "speed [mm/s]", "slip [%]", "wheels", "note"]
    assert [c.number for c in table.columns] == [False, True, True, True, False]
    assert list(csv.reader(io.StringIO(table.to_csv()))) == [
        ["name_of_it", "speed_mmps", "slip", "slip_std", "wheels", "note"],
        ["a", "0.31234", "0.1234", "0.0051", "4", ""],
    ]


def test_an_estimate_that_says_nothing_is_a_dash_on_the_page_and_stands_in_the_csv() -> None:
    column = Column[Estimate]("slip", lambda e: e, "slip slip_std", unit="%", scale=100, widest=1.0)
    table = Table("slips", "Slips", column).fill([Estimate(0.15, 0.9), Estimate(0.15, 315.3)])
    assert [row[0].text for row in table.rows] == ["20 ± 90", "–"]
    assert table.to_csv().splitlines()[2] == "0.15,315.3"


@pytest.mark.parametrize("missing", [math.nan, math.inf, -math.inf])
def test_what_is_not_known_is_a_dash_on_the_page_and_nothing_in_the_csv(missing: float) -> None:
    table = DRIVES.fill([Drive("", missing, Estimate(math.nan, math.nan))])
    assert texts(table) == ["–", "–", "–", "4", "–"]
    assert table.to_csv().splitlines()[1] == ",,,,4,"


def test_a_cell_of_its_own_stands_as_it_is_and_words_of_nothing_are_blank() -> None:
    columns = (
        Column[Drive]("", lambda _: words("")),
        Column[Drive]("x", lambda _: Cell("yes", (True, 2.0)), "b c"),
    )
    table = Table("mine", "Mine", *columns).fill([ONE])
    assert texts(table) == ["", "yes"]
    assert table.to_csv().splitlines()[1] == ",true,2"


@pytest.mark.parametrize(
    ("form", "expected"), [(".2f", "−0.31"), ("g", "−0.31234"), ("+.1e", "−3.1e−01"), ("", "−0.312")]
)
def test_a_format_stands_in_place_of_significant_digits_and_minus_is_a_true_one(
    form: str, expected: str
) -> None:
    column = Column[float]("x", lambda x: x, "x", form=form)
    assert column.cell(-0.31234).text == expected


def test_a_column_serves_the_record_that_holds_its_own() -> None:
    column = SLIP.of(_drive)
    assert column.cell(Log(ONE)) == SLIP.cell(ONE)
    assert column.heading == SLIP.heading


def _drive(log: Log) -> Drive:
    return log.drive


def test_a_column_that_is_not_shown_is_in_neither_page_nor_csv() -> None:
    hidden = Column[Drive]("speed", lambda d: d.speed, "speed", shown=False)
    table = Table("mine", "Mine", SLIP, hidden).fill([ONE])
    assert len(table.columns) == len(table.rows[0]) == 1
    assert "speed" not in table.to_csv()


def test_virtual_data_are_named_in_the_heading_and_in_each_line_of_the_csv() -> None:
    table = DRIVES.fill([ONE, ONE], virtual=True)
    assert table.heading == "Drives (virtual data)"
    assert [line.rpartition(",")[2] for line in table.to_csv().splitlines()] == ["data", "virtual", "virtual"]


def test_a_table_without_rows_is_false() -> None:
    assert not DRIVES.fill([])
    assert DRIVES.fill([ONE])


@pytest.mark.parametrize("text", ["=1+1", "+cmd", "-2", "@x"])
def test_a_text_that_a_spreadsheet_would_run_is_quoted(text: str) -> None:
    assert DRIVES.fill([ONE._replace(name=text)]).to_csv().splitlines()[1].startswith(f"'{text},")
