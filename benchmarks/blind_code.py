"""Which code a result belongs to."""

from __future__ import annotations

import hashlib
import subprocess
from pathlib import Path
from typing import Any

from granite_lab import __version__

ROOT = Path(__file__).parent.parent

JUDGED = ("discovery", "model", "effects", "hidden")
"""Packages that decide what is found, and what is hidden."""


def code_hash() -> str:
    """Return a hash of the sources that decide a result."""
    digest = hashlib.sha256()
    for package in JUDGED:
        for path in sorted((ROOT / "granite_lab" / package).rglob("*.py")):
            digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:10]


def commit() -> str:
    """Return the git commit, "-" outside of a repository."""
    try:
        found = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "-"
    return found.stdout.strip()


def origin() -> dict[str, Any]:
    """Return version, commit and hash of the code."""
    return {"version": __version__, "commit": commit(), "code": code_hash()}
