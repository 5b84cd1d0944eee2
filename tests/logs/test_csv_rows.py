"""Tables are written as pandas writes them, to the letter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from granite_lab.csv_rows import BLOCK, DIGITS, csv_blocks
from granite_lab.files import write_table

ROWS = 2 * BLOCK + 1


def every_kind() -> pd.DataFrame:
    rng = np.random.default_rng(1)
    return pd.DataFrame(
        {
            "a": rng.standard_normal(ROWS) * 10.0 ** rng.integers(-20, 20, ROWS),
            "b, c": np.where(rng.random(ROWS) < 0.3, np.nan, rng.random(ROWS)),
            "phase": rng.choice(["rest", "nan", 'say "x", y'], ROWS),
            "count": np.arange(ROWS),
            "zero": -0.0,
            "inf": np.inf,
            "yes": rng.random(ROWS) > 0.5,
            "w": 1.0,
            "empty": ["", *["", "µ"] * BLOCK],
        }
    )


def test_every_kind_of_cell() -> None:
    table = every_kind()
    assert "".join(csv_blocks(table)) == table.to_csv(index=False, float_format=DIGITS, lineterminator="\n")


@pytest.mark.parametrize(
    "part",
    [
        every_kind().iloc[:0], every_kind().iloc[:1], every_kind()[["phase"]].iloc[:3],
        every_kind()[["empty"]].iloc[:4], every_kind()[["b, c"]].iloc[:9],
        every_kind()[["a", "empty"]].iloc[:3], every_kind()[["a", "w"]].set_axis(["x", "x"], axis=1).iloc[:3],
        pd.DataFrame({"a": [1.0, 2.0], "text": ["one\ntwo", "three"]}), pd.DataFrame(),
    ],
    ids=["none", "one", "text", "empty", "gaps", "pair", "same name", "line break", "nothing"],
)  # fmt: skip
def test_small_and_odd_tables(part: pd.DataFrame) -> None:
    assert "".join(csv_blocks(part)) == part.to_csv(index=False, float_format=DIGITS, lineterminator="\n")


def test_the_file_holds_it(tmp_path: Path) -> None:
    table = every_kind()
    write_table(tmp_path / "t.csv", table)
    expected = table.to_csv(index=False, float_format=DIGITS, lineterminator="\n")
    assert (tmp_path / "t.csv").read_bytes() == expected.encode()


def test_stamps_since_1970_keep_their_microseconds() -> None:
    table = pd.DataFrame({"t_s": [1_700_000_000.123456, 1_700_000_000.123457], "v_mps": [1.0, 2.0]})
    assert "".join(csv_blocks(table)).splitlines()[1:] == ["1700000000.123456,1", "1700000000.123457,2"]
