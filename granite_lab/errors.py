"""The errors a user can meet; each ends in one line, one hint and an exit code."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path


def printable(text: str) -> str:
    """Return a text as one line that a terminal shows and does not obey.

    Names and cells come from files; control characters in them, changes of the reading direction
    and what is no character at all become U+FFFD.
    """
    return "".join(c if c.isprintable() else "\ufffd" for c in " ".join(text.split()))


def nearest(text: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Ask whether the known name was meant that a text resembles; empty where it resembles none."""
    close = difflib.get_close_matches(text, list(known), n=1, cutoff=cutoff)
    return f"did you mean '{close[0]}'?" if close else ""


def known_names(text: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Say for a hint which names are known, behind the one that `nearest` asks about."""
    names = list(known)
    return f"{nearest(text, names, cutoff)} known: {', '.join(names)}"


class LabError(Exception):
    """Known trouble: what is wrong, what to do about it, and how the process ends.

    Args:
        message: one line, beginning with the file (and line) it is about where there is one.
        hint: one line that says what to do.
    """

    exit_code = 1

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = printable(message)
        self.hint = printable(hint)

    def __reduce__(self) -> tuple[type[LabError], tuple[str, str]]:
        """Keep the hint when the error crosses a process border."""
        return type(self), (self.message, self.hint)


class UsageError(LabError):
    """The command line asks for something that does not exist or does not fit together."""

    exit_code = 2


class InputError(LabError):
    """A file holds something that cannot be used."""

    exit_code = 3


class EstimateError(LabError):
    """The data are readable, but they do not allow the estimate or fit."""

    exit_code = 4


def at(path: Path | str, line: int | None = None) -> str:
    """Name a place in a file as ``file:line``, the way editors open it."""
    return f"{path}:{line}" if line is not None else str(path)
