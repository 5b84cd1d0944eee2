"""A report as data: its answers and sections, before they become HTML, Markdown or JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from granite_lab.reporting.table import Table

if TYPE_CHECKING:
    from granite_lab.reporting.figures import Figure


@dataclass(frozen=True)
class Words:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Heading:
    """A title inside a section."""

    text: str


@dataclass(frozen=True)
class Listing:
    """A list of sentences."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Gallery:
    """Figures that belong together; beside each other where there is room."""

    figures: tuple[Figure, ...]
    title: str = ""


@dataclass(frozen=True)
class Fold:
    """Content that a reader opens when wanted; always open in print."""

    title: str
    blocks: tuple[Block, ...]
    open: bool = False


Block = Words | Heading | Listing | Gallery | Table | Fold


@dataclass(frozen=True)
class Section:
    """A part of the evidence."""

    id: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Answer:
    """One question of the first page with its answer.

    Attributes:
        id: for JSON.
        question, text: as printed.
        verdict: one or two words.
        tone: "good", "fair", "bad" or "" for the colour beside the verdict.
    """

    id: str
    question: str
    text: str
    verdict: str = ""
    tone: str = ""


@dataclass(frozen=True)
class Discovery:
    """What a search for a missing effect adds to a report: an answer and a section of evidence."""

    answer: Answer
    section: Section
    data: dict[str, object]


@dataclass(frozen=True)
class Report:
    """A whole report.

    Attributes:
        name: of the study.
        lead: what was measured, in one or two sentences.
        virtual: what a reader must know about simulated data; empty for a real experiment.
        answers: questions and answers of the first page.
        first_page: tables and figures beside them.
        sections: the evidence.
        version: of granite-lab.
        command: how it was made.
        numbers: name of the file with all numbers.
    """

    name: str
    lead: str
    virtual: str
    answers: tuple[Answer, ...]
    first_page: tuple[Block, ...]
    sections: tuple[Section, ...]
    version: str
    command: str
    numbers: str = "report.json"

    def blocks(self) -> Iterator[Block]:
        """Yield all blocks, those inside folds too."""
        yield from _flat(self.first_page)
        for section in self.sections:
            yield from _flat(section.blocks)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures in the order of the report."""
        return tuple(d for block in self.blocks() if isinstance(block, Gallery) for d in block.figures)

    @property
    def tables(self) -> tuple[Table, ...]:
        """All tables in the order of the report."""
        return tuple(block for block in self.blocks() if isinstance(block, Table))


def _flat(blocks: tuple[Block, ...]) -> Iterator[Block]:
    for block in blocks:
        yield block
        if isinstance(block, Fold):
            yield from _flat(block.blocks)
