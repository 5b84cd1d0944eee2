r"""A table as LaTeX, to be read by ``\input``: it needs booktabs, and longtable where it runs over pages.

It fits the text of an article on A4 in 11 pt, by an estimate of the widths of Computer Modern. A table that
is too wide gets headings and words on several lines, then a smaller type, then columns below the first ones.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import accumulate, count
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.ft2font import FT2Font

from granite_lab.columns import FilledTable, Heading
from granite_lab.reporting.render import rendered

TEXT = 360.0
"""Width of the text of an article on A4 in 11 pt [pt]."""

TALL = 420.0
"""Height of the rows above which a table may run over pages [pt]; a page has 592 pt, with title and note."""

TYPES = (
    ("small", 10.0, 5.0, 13.0),
    ("footnotesize", 9.25, 4.0, 13.0),
    ("scriptsize", 8.5, 3.0, 9.0),
    ("scriptsize", 8.5, 3.0, 0.0),
)
"""What is tried: size, its em and half the space between columns [pt], least width of wrapped words [em]."""

WHOLE = 20.0
"""Width of a number up to which it stays on one line [em]."""

LONG_WORD, PIECE = 10.0, 5.0
"""Widths above which a word may be broken, and of its pieces at most [em]."""

_SIGNS = {
    "−": "-", "±": r"\pm", "·": r"\cdot", "×": r"\times", "≤": r"\le", "≥": r"\ge", "≈": r"\approx",
    "√": r"\surd", "∞": r"\infty", "→": r"\to", "°": r"^\circ", "µ": r"\mu", "ϑ": r"\vartheta",
}  # fmt: skip
_GREEK = {
    letter: unicodedata.name(letter).split()[-1].replace("LAMDA", "LAMBDA")
    for letter in "αβγδεζηθικλμνξπρστυφχψωΓΔΘΛΞΠΣΥΦΨΩ"
}
SYMBOLS = {
    "λ_R": r"$\lambda_R$", "k_92": "$k_{92}$", "k₉₂": "$k_{92}$", "a_θ": r"$a_\theta$", "k_φ": r"$k_\varphi$",
    "μ_s": r"$\mu_s$", "k_c": "$k_c$", "b_0": "$b_0$", "b_1": "$b_1$", "J_t": "$J_t$",
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", '"': "''", "“": "``", "”": "''", "–": "--", "—": "---",
    "…": r"\dots{}", "\u00a0": "~",
    **{c: f"\\{c}" for c in "{}$&%#_"},
    **{c: f"{{{c}}}" for c in "[]*"},  # behind a line's end these would be its options
    **{c: f"$\\{name.lower() if c.islower() else name.title()}$" for c, name in _GREEK.items()},
    **{c: f"${sign}$" for c, sign in _SIGNS.items()},
    "φ": r"$\varphi$",
}  # fmt: skip
"""Characters that LaTeX does not show by themselves."""

_SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_TOKEN = re.compile("|".join([*map(re.escape, sorted(SYMBOLS, key=len, reverse=True)), "[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+"]))
_ACCENTS = dict(zip("\u0300\u0301\u0302\u0303\u0308\u030a\u030c\u0327", "`'^~\"rvc", strict=True))

_LETTERS = re.compile(r"[A-Za-z0-9 .,:;()\[\]/=+?!'@-]")
"""What matplotlib's Computer Modern has in the places where ASCII has it."""

_EM = {"\u00a0": 0.34, "·": 0.28, "°": 0.5, "…": 1.34, "—": 1.0} | dict.fromkeys("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", 0.65)
SIGN, CODE_POINT = 0.9, 3.7
"""Widths of other characters, of signs at most, and of a letter as its code point [em]."""


def escaped(text: str) -> str:
    """Return a text as LaTeX shows it, in one line of ASCII; a letter of another script as its code point."""

    def one(match: re.Match[str]) -> str:
        return SYMBOLS.get(match[0]) or f"$^{{{match[0].translate(_SUPERSCRIPTS)}}}$"

    flat = unicodedata.normalize("NFC", re.sub(r"[\x00-\x1f\x7f]+", " ", text))
    return "".join(c if c.isascii() else _letter(c) for c in _TOKEN.sub(one, flat))


def _letter(letter: str) -> str:
    parts = unicodedata.normalize("NFD", letter)
    accent = _ACCENTS.get(parts[1:]) if parts[0].isascii() else None
    return f"\\{accent}{{{parts[0]}}}" if accent else f"U+{ord(letter):04X}"


def width_of(text: str) -> float:
    """Return how wide a text is in Computer Modern [em], signs at most."""
    return sum(map(_em, text))


@cache
def _em(character: str) -> float:
    base = unicodedata.normalize("NFD", character)[0]
    if _LETTERS.match(base):
        return float(_font().load_char(ord(base)).linearHoriAdvance / 65536 / 10)
    return _EM.get(base, SIGN if base in SYMBOLS else CODE_POINT)


@cache
def _font() -> FT2Font:
    font = FT2Font(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / "cmr10.ttf"))
    font.set_size(10, 72)
    return font


def widest(texts: Sequence[str]) -> float:
    """Return the width of the widest text [em]."""
    return max(map(width_of, texts), default=0.0)


def words_of(text: str) -> list[str]:
    """Return the words of a text, a number with its unit as one."""
    return re.findall("[^ \x00-\x1f]+", text)


def pieces_of(word: str) -> list[str]:
    """Return the pieces of a word between which it may be broken."""
    if width_of(word) <= LONG_WORD:
        return [word]
    pieces = [""]
    for letter in word:
        full = width_of(pieces[-1] + letter) > PIECE
        pieces[-1:] = [pieces[-1], letter] if full else [pieces[-1] + letter]
    return pieces


def breakable(text: str) -> str:
    """Return a text as LaTeX in which long words may be broken."""
    return " ".join(r"\allowbreak{}".join(map(escaped, pieces_of(word))) for word in words_of(text))


def lines_of(text: str, width: float) -> list[str]:
    """Return a text on lines of a width [em], which single words may exceed."""
    lines = [""]
    for word in words_of(text):
        longer = f"{lines[-1]} {word}".strip()
        lines[-1:] = [longer] if width_of(longer) <= width or not lines[-1] else [lines[-1], word]
    return lines


@dataclass(frozen=True)
class Laid:
    """A column with its widths [em].

    Attributes:
        heading: what stands above it.
        texts: its cells.
        whole: no cell is broken.
        least: width where all is broken that can be.
        cells_whole: width where no cell is.
        full: width where the heading stands on one line, too.
        width, em: the width that it gets, and the size of an em [pt].
    """

    heading: Heading
    texts: tuple[str, ...]
    whole: bool
    least: float
    cells_whole: float
    full: float
    width: float = 0.0
    em: float = 0.0

    @classmethod
    def of(cls, heading: Heading, texts: tuple[str, ...]) -> Laid:
        """Measure a column."""
        cells = widest(texts)
        whole = heading.number and cells <= WHOLE
        pieces = [piece for text in texts for word in words_of(text) for piece in pieces_of(word)]
        least = max(widest(words_of(heading.title)), cells if whole else widest(pieces))
        unbroken = max(cells, least)
        return cls(heading, texts, whole, least, unbroken, max(unbroken, width_of(heading.title)))

    @property
    def wraps(self) -> bool:
        """Whether its words stand on several lines."""
        return not self.whole and widest(self.texts) > self.width + 1e-6

    @property
    def kind(self) -> str:
        """The column as LaTeX declares it."""
        wide = f"p{{{self.em * self.width / TEXT:.3f}\\linewidth}}"
        return "r" if self.whole else wide if self.wraps else "l"

    @property
    def head(self) -> str:
        """Its heading, on as many lines as it needs."""
        lines = [escaped(line) for line in lines_of(self.heading.title, self.width + 1e-6)]
        side, stack = "r" if self.whole else "l", r" \\ ".join(lines)
        return rf"\begin{{tabular}}[b]{{@{{}}{side}@{{}}}}{stack}\end{{tabular}}" if lines[1:] else stack

    @cached_property
    def cells(self) -> list[str]:
        """Its cells."""
        if self.wraps:
            return [rf"\raggedright {breakable(text)}" for text in self.texts]
        return [escaped(text) for text in self.texts]

    @property
    def lines(self) -> list[int]:
        """About how many lines each cell has."""
        return [len(lines_of(text, self.width)) if self.wraps else 1 for text in self.texts]


Block = tuple[Laid, ...]
"""Columns that stand beside each other."""


def beside(columns: Sequence[Laid], em: float, space: float, comfort: float) -> Block | None:
    """Share the width of the text by what cells need, then by what headings do; None where it is too little.

    `em`, `space` and `comfort` as in `TYPES`.
    """
    width = np.array([c.least if c.whole else max(c.least, min(c.full, comfort)) for c in columns])
    spare = (TEXT - 2 * space * (len(columns) - 1)) / em - width.sum()
    if spare < 0:
        return None
    for goal in ([c.cells_whole for c in columns], [c.full for c in columns]):
        wanted = np.maximum(goal - width, 0.0)
        more = min(1.0, spare / max(wanted.sum(), 1e-6)) * wanted
        width, spare = width + more, spare - more.sum()
    return tuple(replace(c, width=float(w), em=em) for c, w in zip(columns, width, strict=True))


def laid_out(table: FilledTable) -> tuple[str, float, list[Block]]:
    """Return size of the type, half the space between columns [pt], and blocks of columns.

    The first column stands in each block.
    """
    texts = [tuple(row[k].text for row in table.rows) for k in range(len(table.columns))]
    first, *rest = map(Laid.of, table.columns, texts)
    ends = list(accumulate(column.full + 1.0 for column in rest))
    for n in count(1):
        places = [math.ceil(n * end / ends[-1]) for end in ends]
        parts = [
            [c for c, k in zip(rest, places, strict=True) if k == part] for part in sorted({*places} or {0})
        ]
        for size, em, space, comfort in TYPES:
            blocks = [block for part in parts if (block := beside((first, *part), em, space, comfort))]
            if len(blocks) == len(parts):
                return size, space, blocks
    raise AssertionError  # two columns fit, for no piece is wider than `WHOLE`


def to_latex(table: FilledTable) -> str:
    """Return a table as LaTeX, its note below it."""
    size, space, blocks = laid_out(table)
    lines: int = sum(max(row) for block in blocks for row in zip(*(c.lines for c in block), strict=True))
    title = rf"\caption{{{breakable(table.heading)}}}\label{{tab:{table.name.replace('_', '-')}}}"
    return rendered(
        "table.tex", blocks=blocks, rows=len(table.rows), size=size, space=f"{space:g}", title=title,
        note=breakable(table.note), long=1.2 * blocks[0][0].em * lines > TALL,
    )  # fmt: skip
