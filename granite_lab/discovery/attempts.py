"""Parts of the analysis after the search: one that fails loses nothing of the others."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

T = TypeVar("T")


@dataclass
class Attempts:
    """What failed, one line each, with the tracebacks."""

    lines: list[str] = field(default_factory=list)
    tracebacks: list[str] = field(default_factory=list)

    def of(self, part: str, make: Callable[[], T], otherwise: T) -> T:
        """Return what a part gives, or a value in its place where a defect ends it.

        Args:
            part: its name.
            make: does it.
            otherwise: stands in for it.
        """
        try:
            return make()
        except Exception as error:
            self.lines.append(f"{part}: {type(error).__name__}: {error}")
            self.tracebacks.append(traceback.format_exc())
            return otherwise
