"""The examples of docs/api.md and the example script run as they stand."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from tests.corpus.cli import ROOT, SAMPLES

SCRIPT = str(ROOT / "examples" / "trial_to_report.py")
BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")


@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_of_the_page_runs(block: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("data").symlink_to(ROOT / "data")
    exec(block, {"__name__": "__main__"})
    assert capsys.readouterr().out


def test_the_example_script_goes_from_logs_to_a_report(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = [str(SAMPLES / f"virtual_{name}.csv") for name in ("v0.3_r1", "v0.7_r1")]
    monkeypatch.setattr("sys.argv", [SCRIPT, *logs])
    runpy.run_path(SCRIPT, run_name="__main__")
    said = capsys.readouterr()
    assert Path("reports/example/report/index.html").is_file()
    assert Path("reports/example/motion.csv").stat().st_size > 100_000
    assert "a_θ = " in said.out
    assert "virtual_v0.3_r1: slip ratio" in said.out
    assert said.err == ""


def test_the_example_script_ends_known_trouble_in_two_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", [SCRIPT, "none.csv"])
    with pytest.raises(SystemExit, match=r"^error: [^\n]+\nhint: [^\n]+$"):
        runpy.run_path(SCRIPT, run_name="__main__")
