r"""A table as LaTeX, to be read by ``\input``: it needs booktabs, and longtable where it runs over pages.

It fits the text of an article on A4 in 11 pt, by an estimate of the widths of Computer Modern. A table that
is too wide gets headings and words on several lines, then a smaller type, then columns below the first ones.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, count

from granite_lab.columns import FilledTable, Heading

TEXT = 360.0
"""Width of the text of an article on A4 in 11 pt [pt]."""

TALL = 420.0
"""Height of the rows above which a table may run over pages [pt]; a page has 592 pt, with title and note."""

TYPES = (
    ("small", 10.0, 5.0, 9.0),
    ("footnotesize", 9.25, 4.0, 9.0),
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

_EM = {
    character: width
    for width, characters in (
        (0.28, "il.,:;'!|·"),
        (0.39, " \u00a0I()[]-fj"),
        (0.42, "rst°⁰¹²³⁴⁵⁶⁷⁸⁹"),
        (0.47, "cez"),
        (0.53, "agkovxqy0123456789/?*$_J"),
        (0.58, "bdhnpuS{}~^“”"),
        (0.66, "⁻–αβδθλμµρσφψωπτ"),
        (0.78, "ABCDEFHKLNOPQRTUVXYZw=+"),
        (0.86, "Gm%±−×≤≥√→&@#<>ΔΩ"),
        (1.04, "MW∞…—"),
    )
    for character in characters
}
"""Widths of characters in Computer Modern [em], rather too large; of others the width of a code point."""
CODE_POINT = 3.7


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
    """Return about how wide a text is in Computer Modern [em], rather too much."""
    return sum(_EM.get(c) or _EM.get(unicodedata.normalize("NFD", c)[0], CODE_POINT) for c in text)


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
class Measured:
    """A column with its widths [em].

    Attributes:
        heading: what stands above it.
        texts: its cells.
        cells: width of the widest cell.
        whole: no cell is broken.
        least: width where all is broken that can be.
        full: width where nothing is.
    """

    heading: Heading
    texts: tuple[str, ...]
    cells: float
    whole: bool
    least: float
    full: float

    @classmethod
    def of(cls, heading: Heading, texts: tuple[str, ...]) -> Measured:
        """Measure a column."""
        cells = widest(texts)
        whole = heading.number and cells <= WHOLE
        pieces = [piece for text in texts for word in words_of(text) for piece in pieces_of(word)]
        least = max(widest(words_of(heading.title)), cells if whole else widest(pieces))
        return cls(heading, texts, cells, whole, least, max(cells, width_of(heading.title)))


@dataclass(frozen=True)
class Block:
    """Columns beside each other, with their widths [pt] in a type of an `em` [pt]."""

    columns: tuple[Measured, ...]
    widths: tuple[float, ...]
    em: float

    @property
    def wrapped(self) -> tuple[bool, ...]:
        """Whether the words of a column stand on several lines."""
        pairs = zip(self.columns, self.widths, strict=True)
        return tuple(not c.whole and c.cells * self.em > width + 1e-6 for c, width in pairs)

    @property
    def kinds(self) -> str:
        """The columns as LaTeX declares them."""
        kinds = [
            "r" if c.whole else f"p{{{width / TEXT:.3f}\\linewidth}}" if wraps else "l"
            for c, width, wraps in zip(self.columns, self.widths, self.wrapped, strict=True)
        ]
        return f"{{@{{}}{''.join(kinds)}@{{}}}}"

    @property
    def head(self) -> str:
        """The row of headings, each on as many lines as its column needs."""
        cells = []
        for c, width in zip(self.columns, self.widths, strict=True):
            lines = [escaped(line) for line in lines_of(c.heading.title, width / self.em + 1e-6)]
            side, stack = "r" if c.whole else "l", r" \\ ".join(lines)
            stack = rf"\begin{{tabular}}[b]{{@{{}}{side}@{{}}}}{stack}\end{{tabular}}"
            cells.append(stack if len(lines) > 1 else lines[0])
        return f"\\toprule\n{' & '.join(cells)} \\tabularnewline\n\\midrule"

    @property
    def rows(self) -> Iterator[str]:
        """The rows."""
        for texts in zip(*(c.texts for c in self.columns), strict=True):
            pairs = zip(texts, self.wrapped, strict=True)
            cells = [rf"\raggedright {breakable(t)}" if wraps else escaped(t) for t, wraps in pairs]
            yield f"{' & '.join(cells)} \\tabularnewline"

    @property
    def height(self) -> float:
        """About how tall the rows are [pt]."""
        lines = [
            [len(lines_of(text, width / self.em)) if wraps else 1 for text in c.texts]
            for c, width, wraps in zip(self.columns, self.widths, self.wrapped, strict=True)
        ]
        total: int = sum(max(row) for row in zip(*lines, strict=True))
        return 1.2 * self.em * total


def beside(columns: Sequence[Measured], em: float, space: float, comfort: float) -> Block | None:
    """Share the width of the text by what columns need; None where it is too little.

    `em`, `space` and `comfort` as in `TYPES`.
    """
    least = [em * (c.least if c.whole else max(c.least, min(c.full, comfort))) for c in columns]
    wanted = [em * c.full - low for c, low in zip(columns, least, strict=True)]
    spare = TEXT - 2 * space * (len(columns) - 1) - sum(least)
    part = min(1.0, spare / max(sum(wanted), 1e-6))
    widths = tuple(low + part * more for low, more in zip(least, wanted, strict=True))
    return Block(tuple(columns), widths, em) if spare >= 0 else None


def laid_out(table: FilledTable) -> tuple[str, float, list[Block]]:
    """Return size of the type, half the space between columns [pt], and blocks of columns.

    The first column stands in each block.
    """
    texts = [tuple(row[k].text for row in table.rows) for k in range(len(table.columns))]
    first, *rest = map(Measured.of, table.columns, texts)
    ends = list(accumulate(column.full + 1.0 for column in rest))
    for n in count(1):
        part_of = [math.ceil(n * end / ends[-1]) for end in ends]
        parts = [
            [c for c, part in zip(rest, part_of, strict=True) if part == k] for k in sorted(set(part_of))
        ]
        for size, em, space, comfort in TYPES:
            blocks = [block for part in parts if (block := beside((first, *part), em, space, comfort))]
            if len(blocks) == len(parts):
                return size, space, blocks
    raise AssertionError  # two columns fit, for no piece is wider than `WHOLE`


def to_latex(table: FilledTable) -> str:
    """Return a table as LaTeX, its note below it."""
    size, space, blocks = laid_out(table)
    long = sum(block.height for block in blocks) > TALL
    title = rf"\caption{{{breakable(table.heading)}}}\label{{tab:{table.name.replace('_', '-')}}}"
    setting = rf"\{size}\setlength{{\tabcolsep}}{{{space:g}pt}}"
    if long:
        lines = [r"% needs \usepackage{booktabs,longtable}", r"\begingroup\sloppy" + setting]
        lines.append(r"\setlength{\LTcapwidth}{\linewidth}\setlength{\LTpost}{0pt}")
        for k, block in enumerate(blocks):
            above = [r"\addtocounter{table}{-1}"] if k else [rf"{title}\tabularnewline"]
            lines += [rf"\begin{{longtable}}{block.kinds}", *(above if not k else [])]
            lines += [block.head, r"\endfirsthead", block.head, r"\endhead", r"\bottomrule", r"\endfoot"]
            lines += [*block.rows, r"\end{longtable}", *(above if k else [])]
    else:
        lines = [
            r"% needs \usepackage{booktabs}",
            r"\begin{table}[htbp]",
            rf"\centering\sloppy{title}",
            setting,
        ]
        for block in blocks:
            lines += [r"\par\medskip", rf"\begin{{tabular}}{block.kinds}", block.head]
            lines += [*block.rows, r"\bottomrule", r"\end{tabular}"]
    if table.note:
        note = breakable(table.note)
        lines.append(rf"\par\smallskip\noindent\parbox{{\linewidth}}{{\raggedright\footnotesize {note}}}\par")
    return "\n".join([*lines, r"\endgroup" if long else r"\end{table}", ""])
