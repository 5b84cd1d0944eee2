"""Files are written whole or not at all, tables as pandas writes them, to the letter."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from granite_lab.errors import LabError
from granite_lab.files import BLOCK, DIGITS, write_bytes, write_table, write_text, writing


@pytest.mark.parametrize("trouble", [RuntimeError, KeyboardInterrupt])
def test_the_old_content_stays_until_the_new_is_complete(
    trouble: type[BaseException], tmp_path: Path
) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old\n")

    def fail() -> None:
        with writing(path) as file:
            file.write(b"half")
            raise trouble

    with pytest.raises(trouble):
        fail()
    assert path.read_text() == "old\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_the_mode_follows_the_umask(tmp_path: Path) -> None:
    old = os.umask(0o027)
    try:
        write_bytes(tmp_path / "a", b"x")
    finally:
        os.umask(old)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640


def test_a_link_keeps_pointing_where_it_did(tmp_path: Path) -> None:
    """Text is UTF-8 with plain line ends, in folders that are made."""
    target, link = tmp_path / "new" / "target", tmp_path / "link"
    write_text(target, "old")
    link.symlink_to(target)
    write_text(link, "λ_R = 8 %\n")
    assert link.is_symlink()
    assert target.read_bytes() == "λ_R = 8 %\n".encode()


def test_a_long_name_is_no_trouble_but_a_too_long_one_is_said(tmp_path: Path) -> None:
    write_text(tmp_path / ("a" * 250), "x")
    with pytest.raises(LabError, match="file name is too long") as caught:
        write_text(tmp_path / ("a" * 300), "x")
    assert caught.value.exit_code == 1


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


@pytest.mark.parametrize(
    "part",
    [
        every_kind(), every_kind().iloc[:0], every_kind().iloc[:1], every_kind()[["phase"]].iloc[:3],
        every_kind()[["empty"]].iloc[:4], every_kind()[["b, c"]].iloc[:9],
        every_kind()[["a", "empty"]].iloc[:3], every_kind()[["a", "w"]].set_axis(["x", "x"], axis=1).iloc[:3],
        pd.DataFrame(),
    ],
    ids=["all", "none", "one", "text", "empty", "gaps", "pair", "same name", "nothing"],
)  # fmt: skip
def test_a_table_is_written_as_pandas_does(part: pd.DataFrame, tmp_path: Path) -> None:
    write_table(tmp_path / "t.csv", part)
    expected = part.to_csv(index=False, float_format=DIGITS, lineterminator="\n")
    assert (tmp_path / "t.csv").read_bytes() == expected.encode()
