r"""A table as LaTeX, to be read by ``\input``: it needs booktabs and graphicx.

It fits the text of an article on A4. Headings and words stand on several lines. Columns and rows for which
there is no room follow in tables of the same number. What is still too wide is scaled down by LaTeX.
"""

from __future__ import annotations

import re
import textwrap
import unicodedata
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from granite_lab.columns import FilledTable, Heading
from granite_lab.reporting.render import rendered

LINE, LINES = 100, 45
"""Characters of a row, with two for each gap, and lines of a page: footnotesize in an article of 11 pt."""

WORDS, PIECE = 28, 10
"""Longest cell on one line and longest unbroken word, and the pieces of a longer word [characters]."""

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


def escaped(text: str) -> str:
    """Return a text as LaTeX shows it, in one line of ASCII; a letter of another script as its code point."""

    def one(match: re.Match[str]) -> str:
        return SYMBOLS.get(match[0]) or f"$^{{{match[0].translate(_SUPERSCRIPTS)}}}$"

    flat = unicodedata.normalize("NFC", re.sub(r"[\x00-\x1f\x7f]+", " ", text))
    return "".join(c if c.isascii() else _letter(c) for c in _TOKEN.sub(one, flat))


def _letter(letter: str) -> str:
    parts = unicodedata.normalize("NFD", letter)
    accent = _ACCENTS.get(parts[1:]) if parts[0].isascii() else None
    return f"\\{accent}{{{parts[0]}}}" if accent else rf"U+{ord(letter):04X}\allowbreak{{}}"


def breakable(text: str) -> str:
    """Return a text as LaTeX in which long words may be broken."""
    words = re.findall("[^ \x00-\x1f]+", text)  # a number with its unit is one
    pieces = (textwrap.wrap(word, PIECE) if len(word) > WORDS else [word] for word in words)
    return " ".join(r"\allowbreak{}".join(map(escaped, parts)) for parts in pieces)


class Laid(NamedTuple):
    """A column as LaTeX: its kind, heading and cells; about how many characters wide; lines of each cell."""

    kind: str
    head: str
    cells: list[str]
    width: int
    lines: list[int]


def laid(heading: Heading, texts: Sequence[str]) -> Laid:
    """Return a column; words that are long are wrapped, and so is a heading longer than its cells."""
    longest = max(map(len, texts), default=0)
    wraps = not heading.number and longest > WORDS
    heads = textwrap.wrap(heading.title, max(min(longest, WORDS), WORDS // 2), break_long_words=False) or [""]
    width = max(min(longest, WORDS) if wraps else longest, *map(len, heads))
    side, stack = "r" if heading.number else "l", r" \\ ".join(map(escaped, heads))
    return Laid(
        f"p{{{WORDS / 2:g}em}}" if wraps else side,
        rf"\begin{{tabular}}[b]{{@{{}}{side}@{{}}}}{stack}\end{{tabular}}" if heads[1:] else stack,
        [rf"\raggedright {breakable(text)}" if wraps else escaped(text) for text in texts],
        width,
        [-(-len(text) // WORDS) if wraps else 1 for text in texts],
    )


def beside(columns: Sequence[Laid]) -> list[list[Laid]]:
    """Return columns in groups that fit a row, the first column in front of each."""
    first, *rest = columns
    groups, room = [[first]], LINE - first.width
    for column in rest:
        if column.width + 2 > room and groups[-1][1:]:
            groups, room = [*groups, [first]], LINE - first.width
        groups[-1].append(column)
        room -= column.width + 2
    return groups


def below(columns: Sequence[Laid], count: int) -> list[range]:
    """Return the rows of columns in parts that fit a page."""
    starts, lines = [0], 0
    for k in range(count):
        lines += max(column.lines[k] for column in columns)
        if lines > LINES and k > starts[-1]:
            starts, lines = [*starts, k], max(column.lines[k] for column in columns)
    return [range(a, b) for a, b in pairwise([*starts, count])]


def to_latex(table: FilledTable) -> str:
    """Return a table as LaTeX, its note below; what does not fit a page follows in tables of its number."""
    texts = [[row[k].text for row in table.rows] for k in range(len(table.columns))]
    groups = beside(list(map(laid, table.columns, texts)))
    parts = [(group, rows) for group in groups for rows in below(group, len(table.rows))]
    label = table.name.replace("_", "-")
    return rendered(
        "table.tex", parts=parts, title=breakable(table.heading), label=label, note=breakable(table.note)
    )
