"""The documentation as data: its code blocks, the files they ask to save, the commands they show."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
PAGES = [ROOT / "README.md", ROOT / "reports" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
_SAVED = re.compile(r"[Ss]aved?(?: this)? as\s+`([^`]+)`")


@dataclass(frozen=True)
class Block:
    """A fenced code block.

    Attributes:
        language: after the fence.
        code: inside.
        file: the name that the text since the last block asks to save it under, or "".
    """

    language: str
    code: str
    file: str

    def commands(self) -> Iterator[list[str]]:
        """Yield the arguments of each `granite-lab` line."""
        for line in self.code.replace("\\\n", " ").splitlines():
            if line.startswith("granite-lab "):
                words = shlex.split(line, comments=True)
                yield words[1 : words.index(">")] if ">" in words else words[1:]


def text_of(page: str | Path) -> str:
    """Return a page's text."""
    return (ROOT / page).read_text(encoding="utf-8")


def blocks(page: str | Path) -> list[Block]:
    """Return a page's code blocks in order."""
    text, found, end = text_of(page), [], 0
    for match in _BLOCK.finditer(text):
        names = _SAVED.findall(text[end : match.start()])
        found.append(Block(match[1], match[2], names[-1] if names else ""))
        end = match.end()
    return found


def save_files(page: str, folder: Path) -> list[str]:
    """Save every file that a page gives, and return their names."""
    named = [block for block in blocks(page) if block.file]
    for block in named:
        (folder / block.file).write_text(block.code, encoding="utf-8")
    return [block.file for block in named]
