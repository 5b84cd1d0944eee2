"""``report.pdf``: the answers of a study on four pages of A4, with the figures and tables behind them."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace

from matplotlib.backends.backend_pdf import PdfPages
from pypdf import PageObject, PdfReader, PdfWriter, Transformation

from granite_lab.reporting import canvas
from granite_lab.reporting.answers import Answers
from granite_lab.reporting.budgets import COMBINED
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.document import Report
from granite_lab.reporting.paper.layout import (
    BODY,
    HEAD,
    MARGIN,
    MUTED,
    SMALL,
    TITLE,
    TONES,
    WIDTH,
    Page,
)
from granite_lab.reporting.table import Table

PAGES = 4

NOT_REAL = "Virtual data: a simulator wrote the sensor logs. Nothing here is about real sand."

LARGE = 0.1
"""Components with a smaller share of a budget are not printed."""


def report_pdf(result: StudyResult, report: Report, made: str, figures: Mapping[str, bytes]) -> bytes:
    """Return the report as PDF.

    Args:
        result: the study.
        report: its report, whose answers, figures and tables are set.
        made: version, date and libraries, one phrase.
        figures: PDF of each figure of the report by its name.
    """
    setter = _Setter(report, {name: _first_page(pdf) for name, pdf in figures.items()})
    pages = (_measured(setter, made), _law(setter), _model(setter), _missing(setter, result))
    buffer = io.BytesIO()
    settings = {"CreationDate": None, "Creator": None, "Producer": None, "Title": report.name}
    with canvas.styled(), canvas.embedded_fonts(), PdfPages(buffer, metadata=settings) as book:
        for number, page in enumerate(pages, 1):
            _foot(page, f"{report.name} · page {number} of {PAGES}")
            book.savefig(page.figure)
    writer = PdfWriter(clone_from=PdfReader(buffer))
    for sheet, page in zip(writer.pages, pages, strict=True):
        for place in page.pictures:
            drawn = setter.pictures[place.name]
            scale = place.width / float(drawn.mediabox.width)
            sheet.merge_transformed_page(drawn, Transformation().scale(scale).translate(place.x, place.y))
        sheet.compress_content_streams()
    out = io.BytesIO()
    writer.write(out)
    return out.getvalue()


def _first_page(pdf: bytes) -> PageObject:
    return PdfReader(io.BytesIO(pdf)).pages[0]


class _Setter:
    """Sets parts of a report on pages."""

    def __init__(self, report: Report, pictures: Mapping[str, PageObject]) -> None:
        self.report, self.pictures = report, pictures
        self.titles = {f.name: f.heading for f in report.figures}
        self.tables = {t.name: t for t in report.tables}

    @property
    def answers(self) -> Answers:
        return self.report.answers

    def page(self, *, note: str = NOT_REAL) -> Page:
        """Return an empty page; it says so where the data are virtual."""
        page = Page()
        if self.answers.virtual:
            page.banner(note)
        return page

    def answer(self, page: Page, id_: str) -> None:
        """Set a question with its answer; nothing where the report does not ask it."""
        question = self.answers.question(id_)
        if question is None:
            return
        page.text(question.question, size=HEAD, bold=True, after=2)
        if question.verdict:
            page.text(question.verdict, size=BODY + 0.5, bold=True, color=TONES[question.tone], after=2)
        page.text(question.text)
        if question.command:
            page.text(question.command, size=SMALL, color=MUTED)

    def table(self, page: Page, name: str, *, most: int = 40) -> None:
        """Set a table of the report; nothing where there is none."""
        if name in self.tables:
            page.table(self.tables[name], most=most)

    def pair(self, page: Page, *names: str, most: float = 300.0) -> None:
        """Set figures of the report beside each other, those that are there."""
        there = [n for n in names if n in self.pictures and n in self.titles]
        sizes = [
            (float(p.mediabox.width), float(p.mediabox.height)) for p in map(self.pictures.get, there) if p
        ]
        if there:
            shown = [(n, self.titles[n], size) for n, size in zip(there, sizes, strict=True)]
            page.pair(*shown, most=most)


def _foot(page: Page, text: str) -> None:
    page.y = MARGIN - 8
    page.line(text, WIDTH - MARGIN, size=SMALL, color=MUTED, right=True)


def _measured(setter: _Setter, made: str) -> Page:
    """What was measured, all answers in short, and the slip by speed."""
    answers = setter.answers
    page = setter.page(note=f"Virtual data. {answers.virtual}")
    page.text(setter.report.name, size=TITLE, bold=True, after=1)
    page.text(f"Report of a study, made by {made}.", size=SMALL, color=MUTED, after=6)
    page.text("What was measured", size=HEAD, bold=True, after=2)
    page.text(answers.lead, after=7)
    page.text("Answers in short", size=HEAD, bold=True, after=2)
    for question in answers.questions:
        if question.verdict:
            color = TONES[question.tone]
            page.text(f"{question.question} {question.verdict}.", color=color, after=1.5)
    page.y -= 6
    setter.answer(page, "slip")
    setter.table(page, "slip_by_speed", most=12)
    setter.pair(page, "slip_over_speed", "k92_over_slip", most=165)
    _budgets(setter, page, "budget_slip", explained=False)  # the next page does
    return page


def _law(setter: _Setter) -> Page:
    """k_92 and a_θ beside the paper's, with what their uncertainty is made of."""
    page = setter.page()
    setter.answer(page, "a_theta")
    setter.pair(page, "k92_over_velocity", most=260)
    page.text("What the uncertainty is made of", size=HEAD, bold=True, after=2)
    if not _budgets(setter, page, "budget_a_theta", "budget_k92"):
        page.text("The components of the standard uncertainties are not known.")
    return page


def _budgets(setter: _Setter, page: Page, *names: str, explained: bool = True) -> bool:
    """Set the large components of budgets; return whether there are any."""
    shown = [name for name in names if name in setter.tables]
    for name in shown:
        page.table(_large(setter.tables[name]))
    if shown and explained:
        text = setter.tables[shown[-1]].caption
        page.text(f"{text} Components below 10 % are left out here.", size=SMALL, color=MUTED)
    return bool(shown)


def _large(table: Table) -> Table:
    """Return a budget with its large components and the combined uncertainty only."""
    share = next(k for k, c in enumerate(table.columns) if c.name == "share")
    kept = tuple(
        row for row in table.rows
        if row[0].text == COMBINED or (isinstance(x := row[share].raw[0], float) and x >= LARGE)
    )  # fmt: skip
    return replace(table, rows=kept)


def _model(setter: _Setter) -> Page:
    """Whether the model explains the measured motion."""
    page = setter.page()
    setter.answer(page, "model")
    setter.table(page, "channels", most=12)
    motions = sorted(name for name in setter.titles if name.startswith("motion_"))
    ends: Sequence[str] = motions if len(motions) < 2 else (motions[0], motions[-1])
    if ends:
        page.text(
            "Blue: measured; orange: simulated, with k_92 fitted to the slip of the trial. Grey: the steady "
            "part of the motion. Bands: ±2σ of the measurement.",
            size=SMALL,
        )
    setter.pair(page, *ends, most=520)
    return page


def _missing(setter: _Setter, result: StudyResult) -> Page:
    """What is missing, how much it closes, what to do next, how far to trust it, how to repeat it."""
    page = setter.page()
    setter.answer(page, "missing")
    setter.answer(page, "closes")
    setter.table(page, "found_effects", most=8)
    setter.pair(page, "found_gap", "found_candidates", most=170)
    setter.answer(page, "next")
    setter.answer(page, "trust")
    page.text("How to repeat this", size=HEAD, bold=True, after=2)
    page.text(result.source.command, size=SMALL, color=MUTED)
    page.text(
        "granite-lab study --verify FOLDER computes the report again and says what differs.", size=SMALL
    )
    return page
