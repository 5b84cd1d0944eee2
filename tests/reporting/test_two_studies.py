"""Differences of two studies: intervals that hold the truth as often as they say, and plain verdicts."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granite_lab.errors import InputError
from granite_lab.two_studies import ALIKE, DIFFERS, SEEN, Row, Value, compare_studies
from tests.corpus.cli import succeeded, told

Change = Callable[[dict[str, Any]], None]


@pytest.fixture
def changed(folder: Path, tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes the small study's numbers with a change."""

    def write(change: Change = lambda _: None) -> Path:
        document = json.loads((folder / "report.json").read_text(encoding="utf-8"))
        change(document)
        (tmp_path / "other").mkdir()
        (tmp_path / "other" / "report.json").write_text(json.dumps(document), encoding="utf-8")
        return tmp_path / "other"

    return write


def test_the_same_study_twice_shows_no_difference(folder: Path, changed: Callable[..., Path]) -> None:
    found = compare_studies(folder, changed())
    assert [r.quantity for r in found.rows] == [
        "slip at 0.3 m/s", "slip at 0.7 m/s", "k_92 at 0.3 m/s", "k_92 at 0.7 m/s", "a_θ",
    ]  # fmt: skip
    assert {r.verdict for r in found.rows} == {ALIKE}
    assert {r.difference.value for r in found.rows} == {0.0}
    assert found.virtual
    assert any(note.startswith("4 files are read by both studies") for note in found.notes)


def test_a_shift_differs_and_a_speed_of_one_study_is_said(folder: Path, changed: Callable[..., Path]) -> None:
    def shift(document: dict[str, Any]) -> None:
        slip = document["answers"]["speeds"][0]["slip"]
        width = slip["ci95"][1] - slip["ci95"][0]
        slip["value"] += width
        slip["ci95"] = [end + width for end in slip["ci95"]]
        document["answers"]["speeds"].pop()

    rows = compare_studies(folder, changed(shift)).rows
    assert [r.quantity for r in rows if r.verdict == DIFFERS] == ["slip at 0.3 m/s"]
    assert {r.verdict for r in rows if "0.7" in r.quantity} == {"only in A"}


def test_the_interval_holds_the_true_difference_and_the_smallest_is_seen_as_often_as_stated() -> None:
    rng, n = np.random.default_rng(5), 20_000
    stds = (0.3, 0.4)
    true = Row("x", "-", *(Value(0, -1.96 * s, 1.96 * s) for s in stds))
    assert true.smallest == pytest.approx(SEEN * 1.96 * 0.5)
    held = seen = 0
    for a, b in zip(*(rng.normal(0, s, n) for s in stds), strict=True):
        ends = [Value(x, x - 1.96 * s, x + 1.96 * s) for x, s in zip((a, b), stds, strict=True)]
        held += Row("x", "-", *ends).verdict == ALIKE
        x = ends[1].value + true.smallest
        seen += Row("x", "-", ends[0], Value(x, x - 1.96 * stds[1], x + 1.96 * stds[1])).verdict == DIFFERS
    lopsided = Row("x", "-", Value(0.0, -1.0, 3.0), Value(0.0, 0.0, 0.0)).difference
    assert (lopsided.low, lopsided.high) == (-3.0, 1.0)
    assert held / n == pytest.approx(0.95, abs=0.01)
    assert seen / n == pytest.approx(0.80, abs=0.015)


@pytest.mark.parametrize(
    "text", ["", "{}", '{"schema": "granite-lab/report/1"}'], ids=["empty", "other", "old"]
)
def test_what_is_no_report_is_refused(folder: Path, tmp_path: Path, text: str) -> None:
    (tmp_path / "report.json").write_text(text)
    with pytest.raises(InputError, match=r"report\.json: (not JSON|expected schema)"):
        compare_studies(folder, tmp_path)


def test_the_command_writes_the_table_and_prints_rows_or_json(
    folder: Path, changed: Callable[..., Path], tmp_path: Path
) -> None:
    studies = ("compare-studies", folder, changed())
    assert "no difference seen" in succeeded(*studies, "--out", tmp_path / "differences.csv").out
    head, *rows = (tmp_path / "differences.csv").read_text(encoding="utf-8").splitlines()
    assert "smallest_seen" in head
    assert len(rows) == 5
    assert [r["verdict"] for r in told(*studies)["rows"]] == [ALIKE] * 5
