"""The example notebook runs, and its stored outputs are what a run gives."""

import os
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from tests.corpus.cli import ROOT

NOTEBOOK = ROOT / "examples" / "first_look.ipynb"


AS_HERE = """
import os
os.cpu_count = lambda: 1  # workers of the kernel would import all again
from granite_lab import estimation, fitting
from granite_lab.stored import root
from tests.remembered import corrected, fitted
estimation.correct, fitting.fit_k92 = corrected(root() / "motions"), fitted(root() / "fits")
"""
"""What the kernel begins with: motions and fits are remembered as in tests that start no process."""


def texts(cell: Any) -> list[str]:
    return [output.data["text/plain"] for output in cell.get("outputs", []) if "data" in output]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Jupyter's own packages
def test_the_example_notebook_gives_what_it_shows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(AS_HERE, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, (ROOT, tmp_path))))
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path))
    stored, fresh = (nbformat.read(NOTEBOOK, as_version=4) for _ in range(2))
    place = {"metadata": {"path": str(NOTEBOOK.parent)}}
    NotebookClient(fresh, timeout=600, kernel_name="python3", resources=place).execute()
    pictures = 0
    for before, after in zip(stored.cells, fresh.cells, strict=True):
        assert texts(after) == texts(before), before.source
        pictures += sum("image/png" in output.get("data", {}) for output in after.get("outputs", []))
        assert not any(output.output_type in ("error", "stream") for output in after.get("outputs", []))
    assert pictures >= 4
