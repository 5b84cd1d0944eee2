"""A printed page, filled from top to bottom with texts, tables and room for pictures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from matplotlib.figure import Figure as Canvas
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.textpath import TextToPath

from granite_lab.reporting import canvas
from granite_lab.reporting.table import Table

WIDTH, HEIGHT, MARGIN = 595.28, 841.89, 45.0
"""Of A4, and around the text [pt]."""

BODY, SMALL, HEAD, TITLE = 9.0, 7.4, 11.5, 16.0
"""Sizes of type [pt]."""

LEADING = 1.33
PAD = 5.0  # between columns of a table [pt]
TONES = {"good": "#00634a", "fair": "#8a4b00", "bad": "#a3211a", "": canvas.INK}
MUTED = "#595959"
BANNER = ("#fff3cf", "#5a3d00")  # ground and type, as on the page

_MATH = {
    "λ_R": r"$\lambda_\mathrm{R}$", "k_92": r"$k_{92}$", "a_θ": r"$a_\theta$", "k_φ": r"$k_\varphi$",
}  # fmt: skip
_SYMBOL = re.compile("|".join(_MATH))
_TEXT = TextToPath()


@dataclass(frozen=True)
class Placed:
    """A picture's place on its page [pt], from the lower left corner."""

    name: str
    x: float
    y: float
    width: float


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
    lines, line = [], ""
    for word in re.sub(r"[\x00-\x1f]+", " ", text).split(" "):
        longer = f"{line} {word}" if line else word
        if width_of(longer, size, bold) <= width:
            line = longer
            continue
        if line:
            lines.append(line)
        line = word
        while width_of(line, size, bold) > width and len(line) > 1:
            cut = len(line) - 1
            while cut > 1 and width_of(line[:cut], size, bold) > width:
                cut -= 1
            lines.append(line[:cut])
            line = line[cut:]
    return [*lines, line] if line or not lines else lines


@dataclass(eq=False)
class Page:
    """A page of A4.

    Attributes:
        figure: what is drawn on it.
        y: upper edge of the free room, from below [pt].
        pictures: figures that are set into it afterwards.
    """

    figure: Canvas = field(default_factory=lambda: Canvas(figsize=(WIDTH / 72, HEIGHT / 72)))
    y: float = HEIGHT - MARGIN
    pictures: list[Placed] = field(default_factory=list)

    def free(self) -> float:
        """Return the height that is left [pt]."""
        return self.y - MARGIN - 12

    def line(self, text: str, x: float, *, size: float, bold: bool = False, color: str = canvas.INK,
             right: bool = False) -> None:  # fmt: skip
        """Write one line whose upper edge is at `y`; `x` is its left or right end [pt]."""
        math = bool(_SYMBOL.search(text))
        if math:
            text = _SYMBOL.sub(lambda m: _MATH[m[0]], text.replace("\\", "").replace("$", r"\$"))
        self.figure.text(
            x / WIDTH, (self.y - 0.95 * size) / HEIGHT, text, va="baseline", ha="right" if right else "left",
            color=color, parse_math=math, fontproperties=font(size, bold=bold), math_fontfamily="dejavusans",
        )  # fmt: skip

    def text(self, text: str, *, size: float = BODY, bold: bool = False, color: str = canvas.INK,
             after: float = 5.0) -> None:  # fmt: skip
        """Write a paragraph; what does not fit on the page ends with an ellipsis."""
        lines = wrapped(text, WIDTH - 2 * MARGIN, size, bold=bold)
        room = max(int((self.free() + 6) // (LEADING * size)), 1)
        if len(lines) > room:
            lines = [*lines[: room - 1], f"{lines[room - 1]} …"]
        for line in lines:
            self.line(line, MARGIN, size=size, bold=bold, color=color)
            self.y -= LEADING * size
        self.y -= after

    def banner(self, text: str) -> None:
        """Write a note in a box."""
        ground, ink = BANNER
        lines = wrapped(text, WIDTH - 2 * MARGIN - 12, 8.0)
        tall = LEADING * 8.0 * len(lines) + 7
        box = (MARGIN / WIDTH, (self.y - tall) / HEIGHT)
        self.figure.add_artist(
            Rectangle(
                box, 1 - 2 * MARGIN / WIDTH, tall / HEIGHT, facecolor=ground, edgecolor="none", zorder=0
            )
        )
        self.y -= 4.5
        for line in lines:
            self.line(line, MARGIN + 6, size=8.0, color=ink)
            self.y -= LEADING * 8.0
        self.y -= 10

    def pair(self, *shown: tuple[str, str, tuple[float, float]], most: float = 300.0) -> None:
        """Reserve room for pictures beside each other, the title of each above it.

        Args:
            *shown: name, title, and width and height [any unit] of each.
            most: height of the room, titles included, at most [pt].
        """
        gap = 14.0
        wide = (WIDTH - 2 * MARGIN - gap * (len(shown) - 1)) / max(len(shown), 2)
        titles = [wrapped(title, wide, SMALL, bold=True) for _, title, _ in shown]
        head = LEADING * SMALL * max(map(len, titles), default=0) + 2
        room = max(min(most, self.free()) - head, 10.0)
        top, lowest = self.y, self.y
        for k, ((name, _, (w, h)), lines) in enumerate(zip(shown, titles, strict=True)):
            x, own = MARGIN + k * (wide + gap), min(wide, room * w / h)
            self.y = top
            for line in lines:
                self.line(line, x, size=SMALL, bold=True)
                self.y -= LEADING * SMALL
            below = top - head - own * h / w
            self.pictures.append(Placed(name, x, below, own))
            lowest = min(lowest, below)
        self.y = lowest - 8

    def table(self, table: Table, *, most: int = 40) -> None:
        """Draw a table with lines as in a journal; rows that do not fit are counted below it."""
        self.text(table.heading, size=8.2, bold=True, after=1)
        widths = _widths(table)
        heads = [wrapped(c.title, w, SMALL, bold=True) for c, w in zip(table.columns, widths, strict=True)]
        self._rule(0.9)
        self._row(table, heads, widths, [""] * len(widths), bold=True)
        self._rule(0.5)
        shown = 0
        for row in table.rows[:most]:
            cells = [wrapped(cell.text, w, SMALL) for cell, w in zip(row, widths, strict=True)]
            if max(map(len, cells)) * LEADING * SMALL + 12 > self.free():
                break
            self._row(table, cells, widths, [cell.tone for cell in row])
            shown += 1
        self._rule(0.9)
        if shown < len(table.rows):
            rest = f"{len(table.rows) - shown} more rows: tables/{table.name}.csv"
            self.text(rest, size=SMALL, color=MUTED, after=2)
        self.y -= 6

    def _row(
        self, table: Table, cells: Sequence[Sequence[str]], widths: Sequence[float], tones: Sequence[str],
        *, bold: bool = False,
    ) -> None:  # fmt: skip
        top, x = self.y, MARGIN
        for column, lines, wide, tone in zip(table.columns, cells, widths, tones, strict=True):
            self.y = top
            for line in lines:
                at = x + wide if column.number else x
                self.line(line, at, size=SMALL, bold=bold, color=TONES[tone], right=column.number)
                self.y -= LEADING * SMALL
            x += wide + PAD
        self.y = top - LEADING * SMALL * max(map(len, cells))

    def _rule(self, width: float) -> None:
        self.y -= 1.5
        x, y = (MARGIN / WIDTH, 1 - MARGIN / WIDTH), (self.y / HEIGHT,) * 2
        self.figure.add_artist(Line2D(x, y, color=canvas.INK, linewidth=width))
        self.y -= 2.5


def _widths(table: Table) -> list[float]:
    """Return the width of each column: as its texts need, the widest ones cut until all fit [pt]."""
    natural, least = [], []
    for k, column in enumerate(table.columns):
        texts = [row[k].text for row in table.rows]
        words = [width_of(w, SMALL, True) for w in column.title.split(" ")]
        natural.append(max([*words, *(width_of(t, SMALL) for t in texts)]))
        least.append(max([*words, *(width_of(w, SMALL) for t in texts for w in t.split(" "))]))
    room = WIDTH - 2 * MARGIN - PAD * (len(natural) - 1)
    while sum(natural) > room:
        spare = [n - max(low, 20.0) for n, low in zip(natural, least, strict=True)]
        if max(spare) <= 0:
            return [n * room / sum(natural) for n in natural]
        at = spare.index(max(spare))
        natural[at] -= min(5.0, spare[at])
    left = (room - sum(natural)) / len(natural)
    return [n + min(left, 14.0) for n in natural]
