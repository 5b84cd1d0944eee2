"""A report as data: its answers and sections, before they become HTML, Markdown or JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from granite_lab.reporting.answers import Answers
from granite_lab.reporting.table import Table

if TYPE_CHECKING:
    from granite_lab.reporting.figures import Figure


@dataclass(frozen=True)
class Words:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Listing:
    """A list of sentences."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Code:
    """A command that can be copied."""

    text: str


@dataclass(frozen=True)
class Gallery:
    """Figures that belong together; two beside each other where there is room."""

    figures: tuple[Figure, ...]


@dataclass(frozen=True)
class Fold:
    """Content that a reader opens when wanted; closed at first, and in print."""

    title: str
    blocks: tuple[Block, ...]


Block = Words | Listing | Code | Gallery | Table | Fold


@dataclass(frozen=True)
class Section:
    """A part of the report below the first screen."""

    id: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Report:
    """A whole report.

    Attributes:
        name: of the study.
        kind: what the page is, such as "Report of a study".
        answers: the first screen.
        first: table beside the answers; None where there is none.
        sections: the evidence.
        numbers: name of the file with all numbers.
    """

    name: str
    kind: str
    answers: Answers
    first: Table | None
    sections: tuple[Section, ...]
    numbers: str = "report.json"

    def blocks(self) -> Iterator[Block]:
        """Yield all blocks, those inside folds too."""
        yield from () if self.first is None else (self.first,)
        for section in self.sections:
            yield from _flat(section.blocks)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures in the order of the report."""
        return tuple(f for block in self.blocks() if isinstance(block, Gallery) for f in block.figures)

    @property
    def tables(self) -> tuple[Table, ...]:
        """All tables in the order of the report."""
        return tuple(block for block in self.blocks() if isinstance(block, Table))


def _flat(blocks: tuple[Block, ...]) -> Iterator[Block]:
    for block in blocks:
        yield block
        if isinstance(block, Fold):
            yield from _flat(block.blocks)
