"""``report.pdf``: the answers of a study on four pages of A4, with the figures and tables behind them."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import matplotlib as mpl
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure as Canvas
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.textpath import TextToPath
from pypdf import PageObject, PdfReader, PdfWriter
from pypdf.generic import ArrayObject, DecodedStreamObject, DictionaryObject, NameObject

from granite_lab.reporting.canvas import INK, styled
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.report import Report
from granite_lab.reporting.table import Table
from granite_lab.reporting.tables import COMBINED

PAGES = 4

WIDTH, HEIGHT, MARGIN = 595.28, 841.89, 45.0
"""Of A4, and around the text [pt]."""

BODY, SMALL, HEAD, TITLE = 9.0, 7.4, 11.5, 16.0
"""Sizes of type [pt]."""

LEADING = 1.33
PAD, BESIDE = 5.0, 14.0  # between columns of a table and between figures [pt]
TONES = {"good": "#00634a", "fair": "#8a4b00", "bad": "#a3211a", "": INK}
MUTED = "#595959"
BANNER = ("#fff3cf", "#5a3d00")  # ground and type, as on the page

LARGE = 0.1
"""Components with a smaller share of a budget are not printed."""

_MATH = {
    "λ_R": r"$\lambda_\mathrm{R}$", "k_92": r"$k_{92}$", "a_θ": r"$a_\theta$", "k_φ": r"$k_\varphi$",
}  # fmt: skip
_SYMBOL = re.compile("|".join(_MATH))
_TEXT = TextToPath()


def report_pdf(result: StudyResult, report: Report, made: str, figures: Mapping[str, bytes]) -> bytes:
    """Return the report as PDF.

    Args:
        result: the study.
        report: its report, whose answers, figures and tables are set.
        made: version, date and libraries, one phrase.
        figures: PDF of each figure of the report by its name.
    """
    drawn = {name: PdfReader(io.BytesIO(pdf)).pages[0] for name, pdf in figures.items()}
    pages = [Page(report, drawn, first=number == 1) for number in range(1, PAGES + 1)]
    _measured(pages[0], made)
    _law(pages[1])
    _model(pages[2])
    _missing(pages[3], result.source.command)
    buffer = io.BytesIO()
    metadata = {"CreationDate": None, "Creator": None, "Producer": None, "Title": report.name}
    # Type 42: whole TrueType fonts, so that the text can be searched.
    with styled(), mpl.rc_context({"pdf.fonttype": 42}), PdfPages(buffer, metadata=metadata) as book:
        for number, page in enumerate(pages, 1):
            page.y = MARGIN - 8
            foot = f"{report.name} · page {number} of {PAGES}"
            page.line(foot, WIDTH - MARGIN, size=SMALL, color=MUTED, right=True)
            book.savefig(page.figure)
    writer = PdfWriter(clone_from=PdfReader(buffer))
    for sheet, page in zip(writer.pages, pages, strict=True):
        for name, x, y, scale in page.placed:
            _place(writer, sheet, drawn[name], name, f"{scale:.5f} 0 0 {scale:.5f} {x:.2f} {y:.2f}")
    out = io.BytesIO()
    writer.write(out)
    return out.getvalue()


def _place(writer: PdfWriter, sheet: PageObject, drawn: PageObject, name: str, matrix: str) -> None:
    """Set a drawing on a page as a form of PDF, which keeps its lines and its text (ISO 32000-1, 8.10)."""
    form, shown = DecodedStreamObject(), DecodedStreamObject()
    contents = drawn.get_contents()
    assert contents is not None
    form.set_data(contents.get_data())
    form.update({
        NameObject("/Type"): NameObject("/XObject"), NameObject("/Subtype"): NameObject("/Form"),
        NameObject("/BBox"): drawn.mediabox, NameObject("/Resources"): drawn["/Resources"].clone(writer),
    })  # fmt: skip
    shown.set_data(f"q {matrix} cm /{name} Do Q\n".encode())
    resources = sheet["/Resources"].get_object()
    assert isinstance(resources, DictionaryObject)
    forms = resources.setdefault(NameObject("/XObject"), DictionaryObject()).get_object()
    forms[NameObject(f"/{name}")] = writer._add_object(form.flate_encode())
    before = sheet.raw_get("/Contents")
    parts = before if isinstance(before, ArrayObject) else ArrayObject([before])
    sheet[NameObject("/Contents")] = ArrayObject([*parts, writer._add_object(shown)])


@lru_cache
def font(size: float, *, bold: bool = False) -> FontProperties:
    """Return the font of a text."""
    return FontProperties(family="DejaVu Sans", size=size, weight="bold" if bold else "normal")


@lru_cache(maxsize=20_000)
def width_of(text: str, size: float, bold: bool = False) -> float:
    """Return the width of a text on one line [pt]."""
    wide, _, _ = _TEXT.get_text_width_height_descent(_SYMBOL.sub("kₐ", text), font(100, bold=bold), False)
    return float(wide) * size / 100


def wrapped(text: str, width: float, size: float, *, bold: bool = False) -> list[str]:
    """Break a text into lines of at most so many points; a longer word is cut."""
    lines = [""]
    for word in re.findall(r"[^ ]+ *", re.sub(r"[\x00-\x1f]+", " ", text)):
        for piece in [word] if width_of(word.rstrip(), size, bold) <= width + 0.01 else list(word):
            if lines[-1] and width_of((lines[-1] + piece).rstrip(), size, bold) > width + 0.01:
                lines.append("")
            lines[-1] += piece
    return [line.rstrip() for line in lines]


class Page:
    """A page of A4, filled from top to bottom with parts of a report.

    Attributes:
        figure: what is drawn on it.
        y: upper edge of the free room, from below [pt].
        placed: figures that are set into it afterwards: name, left and lower edge [pt], and scale.
    """

    def __init__(self, report: Report, pictures: Mapping[str, PageObject], *, first: bool = False) -> None:
        self.report, self.pictures = report, pictures
        self.figure = Canvas(figsize=(WIDTH / 72, HEIGHT / 72))
        self.y = HEIGHT - MARGIN
        self.placed: list[tuple[str, float, float, float]] = []
        if report.answers.virtual:
            short = "A simulator wrote the sensor logs. Nothing here is about real sand."
            self._banner(f"Virtual data. {report.answers.virtual if first else short}")

    def free(self) -> float:
        """Return the height that is left [pt]."""
        return self.y - MARGIN - 12

    def line(self, text: str, x: float, *, size: float, bold: bool = False, color: str = INK,
             right: bool = False) -> None:  # fmt: skip
        """Write one line whose upper edge is at `y`; `x` is its left or right end [pt]."""
        math = bool(_SYMBOL.search(text))
        if math:
            text = _SYMBOL.sub(lambda m: _MATH[m[0]], text.replace("\\", "").replace("$", r"\$"))
        self.figure.text(
            x / WIDTH, (self.y - 0.95 * size) / HEIGHT, text, va="baseline", ha="right" if right else "left",
            color=color, parse_math=math, fontproperties=font(size, bold=bold), math_fontfamily="dejavusans",
        )  # fmt: skip

    def lines(self, lines: Sequence[str], x: float, *, size: float, bold: bool = False, color: str = INK,
              right: bool = False) -> None:  # fmt: skip
        """Write lines below each other."""
        for line in lines:
            self.line(line, x, size=size, bold=bold, color=color, right=right)
            self.y -= LEADING * size

    def text(self, text: str, *, size: float = BODY, bold: bool = False, color: str = INK,
             after: float = 5.0) -> None:  # fmt: skip
        """Write a paragraph; what does not fit on the page ends with an ellipsis."""
        lines = wrapped(text, WIDTH - 2 * MARGIN, size, bold=bold)
        room = max(int((self.free() + 6) // (LEADING * size)), 1)
        if len(lines) > room:
            lines = [*lines[: room - 1], f"{lines[room - 1]} …"]
        self.lines(lines, MARGIN, size=size, bold=bold, color=color)
        self.y -= after

    def _banner(self, text: str) -> None:
        """Write a note in a box."""
        lines = wrapped(text, WIDTH - 2 * MARGIN - 12, 8.0)
        tall = LEADING * 8.0 * len(lines) + 7
        place, wide = (MARGIN / WIDTH, (self.y - tall) / HEIGHT), 1 - 2 * MARGIN / WIDTH
        box = Rectangle(place, wide, tall / HEIGHT, facecolor=BANNER[0], edgecolor="none", zorder=0)
        self.figure.add_artist(box)
        self.y -= 4.5
        self.lines(lines, MARGIN + 6, size=8.0, color=BANNER[1])
        self.y -= 10

    def answer(self, id_: str) -> None:
        """Set a question with its answer; nothing where the report does not ask it."""
        question = self.report.answers.question(id_)
        if question is None:
            return
        self.text(question.question, size=HEAD, bold=True, after=2)
        if question.verdict:
            self.text(question.verdict, size=BODY + 0.5, bold=True, color=TONES[question.tone], after=2)
        self.text(question.text)
        if question.command:
            self.text(question.command, size=SMALL, color=MUTED)

    def figures(self, *names: str, most: float = 300.0) -> None:
        """Reserve room for those figures that are there, beside each other, the title of each above it.

        Args:
            *names: of the figures.
            most: height of the room, titles included, at most [pt].
        """
        shown = [f for name in names for f in self.report.figures if f.name == name and name in self.pictures]
        wide = (WIDTH - 2 * MARGIN - BESIDE) / 2
        titles = [wrapped(f.heading, wide, SMALL, bold=True) for f in shown]
        head = LEADING * SMALL * max(map(len, titles), default=0) + 2
        room = max(min(most, self.free()) - head, 10.0)
        top, lowest = self.y, self.y
        for k, (figure, lines) in enumerate(zip(shown, titles, strict=True)):
            size = self.pictures[figure.name].mediabox
            x, scale = MARGIN + k * (wide + BESIDE), min(wide / float(size.width), room / float(size.height))
            self.y = top
            self.lines(lines, x, size=SMALL, bold=True)
            below = top - head - scale * float(size.height)
            self.placed.append((figure.name, x, below, scale))
            lowest = min(lowest, below)
        self.y = lowest - (8 if shown else 0)

    def table(self, name: str, *, most: int = 40) -> bool:
        """Draw a table of the report with lines as in a journal; return whether there is one.

        Rows that do not fit are counted below it, and of budgets the large components stand.
        """
        table = next((t for t in self.report.tables if t.name == name), None)
        if table is None:
            return False
        table = _large(table) if name.startswith("budget") else table
        self.text(table.heading, size=8.2, bold=True, after=1)
        widths = _widths(table)
        self._rule(0.9)
        self._row(table, [c.title for c in table.columns], widths, [""] * len(widths), bold=True)
        self._rule(0.5)
        shown = 0
        for row in table.rows[:most]:
            if not self._row(table, [cell.text for cell in row], widths, [cell.tone for cell in row]):
                break
            shown += 1
        self._rule(0.9)
        if shown < len(table.rows):
            rest = f"{len(table.rows) - shown} more rows: tables/{table.name}.csv"
            self.text(rest, size=SMALL, color=MUTED, after=2)
        self.y -= 6
        return True

    def _row(
        self, table: Table, texts: Sequence[str], widths: Sequence[float], tones: Sequence[str],
        *, bold: bool = False,
    ) -> bool:  # fmt: skip
        """Draw a row of a table; return False, with nothing drawn, where the page is full."""
        cells = [wrapped(text, w, SMALL, bold=bold) for text, w in zip(texts, widths, strict=True)]
        tall = LEADING * SMALL * max(map(len, cells))
        if tall + 12 > self.free():
            return False
        top, x = self.y, MARGIN
        for column, lines, wide, tone in zip(table.columns, cells, widths, tones, strict=True):
            self.y = top
            end = x + wide if column.number else x
            self.lines(lines, end, size=SMALL, bold=bold, color=TONES[tone], right=column.number)
            x += wide + PAD
        self.y = top - tall
        return True

    def _rule(self, width: float) -> None:
        self.y -= 1.5
        x, y = (MARGIN / WIDTH, 1 - MARGIN / WIDTH), (self.y / HEIGHT,) * 2
        self.figure.add_artist(Line2D(x, y, color=INK, linewidth=width))
        self.y -= 2.5


def _widths(table: Table) -> list[float]:
    """Return the width of each column: as its texts need, the widest ones wrapped until all fit [pt]."""
    natural, least = [], []
    for k, column in enumerate(table.columns):
        texts = [row[k].text for row in table.rows]
        head = max(width_of(w, SMALL, True) for w in column.title.split(" "))
        natural.append(max([head, *(width_of(t, SMALL) for t in texts)]))
        least.append(max([head, *(width_of(w, SMALL) for t in texts for w in t.split(" "))]))
    room = WIDTH - 2 * MARGIN - PAD * (len(natural) - 1)
    most = max(natural)
    widths = natural
    while sum(widths) > room and most > 0:
        most -= 2.0
        widths = [max(low, min(n, most)) for low, n in zip(least, natural, strict=True)]
    if sum(widths) > room:  # even single words are too long
        return [w * room / sum(widths) for w in widths]
    return [w + min((room - sum(widths)) / len(widths), 14.0) for w in widths]


def _large(table: Table) -> Table:
    """Return a budget with its large components and the combined uncertainty only."""
    shares = [k for k, c in enumerate(table.columns) if c.name == "share"]
    kept = [r for r in table.rows if r[0].text == COMBINED or float(r[shares[0]].raw[0] or 0) >= LARGE]
    return replace(table, rows=tuple(kept))


def _measured(page: Page, made: str) -> None:
    """Set what was measured, all answers in short, and the slip by speed."""
    answers = page.report.answers
    page.text(page.report.name, size=TITLE, bold=True, after=1)
    page.text(f"Report of a study, made by {made}.", size=SMALL, color=MUTED, after=6)
    page.text("What was measured", size=HEAD, bold=True, after=2)
    page.text(answers.lead, after=7)
    page.text("Answers in short", size=HEAD, bold=True, after=2)
    for question in (q for q in answers.questions if q.verdict):
        page.text(f"{question.question} {question.verdict}.", color=TONES[question.tone], after=1.5)
    page.y -= 6
    page.answer("slip")
    page.table("slip_by_speed", most=12)
    page.figures("slip_over_speed", "k92_over_slip", most=165)
    page.table("budget_slip")


def _law(page: Page) -> None:
    """Set k_92 and a_θ beside the paper's, with what their uncertainty is made of."""
    page.answer("a_theta")
    page.figures("k92_over_velocity", most=260)
    page.text("What the uncertainty is made of", size=HEAD, bold=True, after=2)
    if not any([page.table("budget_a_theta"), page.table("budget_k92")]):
        page.text("The components of the standard uncertainties are not known.")
        return
    caption = [t.caption for t in page.report.tables if t.name.startswith("budget")][-1]
    page.text(f"{caption} Components below 10 % are left out here.", size=SMALL, color=MUTED)


def _model(page: Page) -> None:
    """Set whether the model explains the measured motion."""
    page.answer("model")
    page.table("channels", most=12)
    motions = sorted(f.name for f in page.report.figures if f.name.startswith("motion_"))
    if motions:
        text = (
            "Blue: measured; orange: simulated, with k_92 fitted to the slip of the trial. Grey: the steady "
            "part of the motion. Bands: ±2σ of the measurement."
        )
        page.text(text, size=SMALL)
    page.figures(*dict.fromkeys(motions[:1] + motions[-1:]), most=520)


def _missing(page: Page, command: str) -> None:
    """Set what is missing, how much it closes, what to do next, how far to trust it, how to repeat it."""
    page.answer("missing")
    page.answer("closes")
    page.table("found_effects", most=8)
    page.figures("found_gap", "found_candidates", most=170)
    page.answer("next")
    page.answer("trust")
    page.text("How to repeat this", size=HEAD, bold=True, after=2)
    page.text(command, size=SMALL, color=MUTED)
    again = "granite-lab study --verify FOLDER computes the report again and says what differs."
    page.text(again, size=SMALL)
