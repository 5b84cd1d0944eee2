"""Which code a result belongs to."""

from __future__ import annotations

import ast
import hashlib
import subprocess
from pathlib import Path

ROOT = Path(__file__).parent.parent

LEFT_OUT = (
    "api", "cli.py", "commands", "comparison",
    "fitting", "planning", "reporting", "study_folder.py", "two_studies.py",
)  # fmt: skip
"""Packages and modules that decide neither what is hidden nor what is found."""


def code_hash(root: Path = ROOT) -> str:
    """Return a hash of the sources that decide a result, whatever their comments and docstrings say."""
    package, digest = root / "granite_lab", hashlib.sha256()
    for path in sorted([*package.rglob("*.py"), *package.rglob("*.toml")]):
        place = path.relative_to(package)
        if place.parts[0] in LEFT_OUT or place.name in LEFT_OUT:
            continue
        text = path.read_text("utf-8")
        digest.update(f"{place.as_posix()}\n{_bare(text) if path.suffix == '.py' else text}".encode())
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
