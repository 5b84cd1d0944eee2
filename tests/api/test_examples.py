"""The examples of docs/api.md and the example script run as they stand."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
SAMPLES = ROOT / "data" / "samples"
BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_a_block_of_the_page_runs(number: int, tmp_path: Path) -> None:
    (tmp_path / "data").symlink_to(ROOT / "data")
    code = "import matplotlib; matplotlib.use('agg')\n" + BLOCKS[number]
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_the_example_script_goes_from_logs_to_a_report(tmp_path: Path) -> None:
    logs = [SAMPLES / "virtual_v0.3_r1.csv", SAMPLES / "virtual_v0.7_r1.csv"]
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / "trial_to_report.py"), *map(str, logs)],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "reports" / "example" / "report" / "index.html").is_file()
    assert (tmp_path / "reports" / "example" / "motion.csv").stat().st_size > 100_000
    assert "a_θ = " in done.stdout
    assert "virtual_v0.3_r1: slip ratio" in done.stdout
    assert done.stderr == ""


def test_the_example_script_ends_known_trouble_in_two_lines(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / "trial_to_report.py"), "none.csv"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
    assert "Traceback" not in done.stderr
