"""The documentation as data: its code blocks, the files they ask to save, the lines they show to run."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from granite_lab.cli import app

ROOT = Path(__file__).parent.parent.parent
PAGES = [ROOT / "README.md", ROOT / "reports" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMANDS: Any = typer.main.get_command(app)

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

    def lines(self) -> list[str]:
        """Return the lines to run, without comments and with single blanks."""
        if self.language != "sh":
            return []
        shown = (re.sub(r"\s#.*", "", line) for line in self.code.splitlines())
        return [" ".join(line.split()) for line in shown if line.strip()]


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


def save_files(page: str, folder: Path) -> None:
    """Save every file that a page gives."""
    for block in blocks(page):
        if block.file:
            (folder / block.file).write_text(block.code, encoding="utf-8")


def lines_to_run(page: str | Path) -> list[tuple[str, str]]:
    """Return each line that a page shows to run, and the output shown behind it, or ""."""
    found: list[tuple[str, str]] = []
    for block in blocks(page):
        if block.language == "text":
            line, shown = found.pop()
            found.append((line, shown + block.code))
        found += [(line, "") for line in block.lines()]
    return found


def command_of(words: list[str]) -> tuple[Any, list[str]]:
    """Return the command of granite-lab that words name, and its arguments."""
    command, rest = COMMANDS, list(words)
    while rest and rest[0] in getattr(command, "commands", {}):
        command = command.get_command(None, rest.pop(0))
    return command, rest
