"""Which code a result belongs to."""

from __future__ import annotations

import ast
import hashlib
import subprocess
from pathlib import Path
from typing import Any

from granite_lab import __version__

ROOT = Path(__file__).parent.parent

JUDGED = ("discovery", "model", "effects", "hidden")
"""Packages that decide what is found, and what is hidden."""


TEXTS = ("documentation.py",)
"""Modules of theirs that only write pages."""


def code_hash(root: Path = ROOT) -> str:
    """Return a hash of the sources that decide a result, whatever their comments and docstrings say."""
    digest = hashlib.sha256()
    for package in JUDGED:
        for path in sorted((root / "granite_lab" / package).rglob("*.py")):
            if path.name not in TEXTS:
                digest.update(
                    f"{path.relative_to(root).as_posix()}\n{_bare(path.read_text('utf-8'))}".encode()
                )
    return digest.hexdigest()[:10]


def _bare(source: str) -> str:
    """Return a source without comments and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [x for x in node.body if not _is_text(x)] or [ast.Pass()]
    return ast.unparse(tree)


def _is_text(node: ast.stmt) -> bool:
    """Tell whether a statement is a string that stands alone."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


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
