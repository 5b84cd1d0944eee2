"""Writing after a search, so that a defect in one part loses nothing of the others."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from granite_lab.errors import LabError, printable
from granite_lab.files import write_text

T = TypeVar("T")


class Guard:
    """Runs the parts of an output one after the other; one that fails is told and the rest goes on.

    Args:
        folder: of the output; tracebacks are written into it as ``failure-<part>.txt``.

    Attributes:
        lines: what failed, one line each.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.lines: list[str] = []

    def run(self, part: str, call: Callable[[], T]) -> T | None:
        """Return what a part gives, None where it fails.

        Args:
            part: its name, a word.
            call: does it; known trouble becomes its own line, any other exception one with a traceback.
        """
        path = self.folder / f"failure-{part}.txt"
        try:
            found = call()
        except LabError as error:
            self.lines.append(f"{part}: {error.message}" + (f" ({error.hint})" if error.hint else ""))
        except Exception as error:  # a defect of this package
            line = f"{part}: {type(error).__name__}: {printable(str(error))}"
            try:
                write_text(path, traceback.format_exc())
                line += f"; the traceback is in {path}"
            except LabError as full:
                line += f"; {full.message}"
            self.lines.append(line)
        else:
            with suppress(OSError):
                path.unlink(missing_ok=True)  # that of an earlier run would be wrong
            return found
        return None


def tell(lines: Sequence[str]) -> None:
    """Tell what failed, now that everything else is written.

    Raises:
        LabError: there is a line.
    """
    if lines:
        raise LabError("; ".join(lines), "everything else was written")
