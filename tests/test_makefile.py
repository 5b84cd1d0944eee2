"""The Makefile takes the Python that it is told, and no environment that another has made."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def fake(path: Path, does: str) -> Path:
    """Write a program that stands for a Python."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{does}\n")
    path.chmod(0o755)
    return path


def make(folder: Path, python: Path | str) -> list[str]:
    """Return what `make study` says before it gives up."""
    shutil.copy(ROOT / "Makefile", folder)
    shutil.copy(ROOT / "pyproject.toml", folder)
    command = ["make", "--no-print-directory", f"PYTHON={python}", "study"]
    environment = {name: value for name, value in os.environ.items() if name != "MAKEFLAGS"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    return done.stdout.splitlines()


def test_a_python_that_is_too_old_is_refused_in_one_line_with_a_hint(tmp_path: Path) -> None:
    old = fake(tmp_path / "old", "exit 1")
    said = make(tmp_path, old)
    assert said == [f"error: {old} is not there or older than 3.11", "hint: make PYTHON=python3.12 study"]
    assert make(tmp_path, tmp_path / "none")[0].startswith("error: ")
    assert not (tmp_path / ".venv").exists()


def test_an_environment_of_another_python_is_not_used(tmp_path: Path) -> None:
    fake(tmp_path / ".venv" / "bin" / "python", "echo 3.99")
    said = make(tmp_path, sys.executable)
    assert said == [f"error: .venv was made by Python 3.99, not by {sys.executable}", "hint: make clean"]
