"""One table, written as HTML and Markdown (by the templates), CSV, LaTeX, or on a terminal."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from granite_lab.estimate import Estimate
from granite_lab.reporting.rounding import NONE, percent, plus_minus, significant, with_unit

Raw = float | int | bool | str | None


@dataclass(frozen=True)
class Column:
    """A column: what stands above it, and the names of the plain columns it becomes in a CSV.

    Attributes:
        name: above the column, without a unit.
        unit: of the printed cells; empty where the cells state theirs or have none.
        keys: names in the CSV, with the unit behind them; one per raw value of a cell.
        number: set flush right.
    """

    name: str
    unit: str
    keys: tuple[str, ...]
    number: bool = True

    @property
    def title(self) -> str:
        """What stands above the column: the name with the unit in brackets."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Cell:
    """What is printed, and the plain values behind it.

    Attributes:
        text: as printed.
        raw: as in the CSV, one per key of the column.
        tone: "", "good", "fair" or "bad"; the text says the same.
    """

    text: str
    raw: tuple[Raw, ...]
    tone: str = ""


T = TypeVar("T")
Spec = tuple[str, str, Callable[[T], Cell | str | int]]
"""A column of `tabulate`."""


@dataclass(frozen=True)
class Table:
    """A table of the report.

    Attributes:
        name: stem of its CSV.
        title: what it lists.
        caption: what to see in it.
        columns, rows: its content; the first cell of a row names the row.
        virtual: its data were written by a simulator; `heading` and a column of the CSV then say so.
    """

    name: str
    title: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    virtual: bool = False

    @property
    def heading(self) -> str:
        """The title, with "(virtual data)" behind it where that is so."""
        return f"{self.title} (virtual data)" if self.virtual else self.title

    def to_csv(self) -> str:
        """Return the plain values as CSV, a column "data" last where they are virtual.

        A text that a spreadsheet would run gets a leading quote.
        """
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        data = ["virtual"] if self.virtual else []
        writer.writerow([key for column in self.columns for key in column.keys] + ["data"] * len(data))
        for row in self.rows:
            writer.writerow([_plain(value) for cell in row for value in cell.raw] + data)
        return out.getvalue()


def tabulate(
    name: str,
    title: str,
    caption: str,
    items: Iterable[T],
    specs: Sequence[Spec[T] | None],
    *,
    virtual: bool = False,
) -> Table:
    """Return a table with a row for each item.

    Args:
        name, title, caption, virtual: as in `Table`.
        items: what the rows are about.
        specs: of each column its heading with the unit in brackets; its names in the CSV, none for a column
            of words; and what makes the cell, its text, or its whole number, of an item. None is no column.
    """
    kept = [spec for spec in specs if spec is not None]
    columns = []
    for heading, keys, _ in kept:
        match = re.fullmatch(r"(.*) \[(.*)\]", heading)
        label, unit = match.groups() if match else (heading, "")
        plain = re.sub(r"\W+", "_", heading.lower()).strip("_")
        columns.append(Column(label, unit, tuple(keys.split()) or (plain,), bool(keys)))
    rows = tuple(tuple(_cell(make(item)) for _, _, make in kept) for item in items)
    return Table(name, title, caption, tuple(columns), rows, virtual)


def _cell(made: Cell | str | int) -> Cell:
    return made if isinstance(made, Cell) else Cell(str(made), (made,))


def words(text: str, tone: str = "") -> Cell:
    """Return a cell that holds a text."""
    return Cell(text, (text,), tone)


def number(value: float, digits: int = 3, unit: str = "", scale: float = 1.0) -> Cell:
    """Return a cell that holds a number without uncertainty; the raw value stays in the record's unit."""
    text = with_unit(significant(value * scale, digits), unit) if math.isfinite(value) else NONE
    return Cell(text, (value,))


def share(value: float) -> Cell:
    """Return a cell with a share in percent."""
    return Cell(percent(value), (value,))


def estimate(value: Estimate, scale: float = 1.0) -> Cell:
    """Return a cell with value ± std; the raw values stay in the record's unit."""
    return Cell(plus_minus(value, scale=scale), (value.value, value.std))


def _plain(value: Raw) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.9g}"
    flat = re.sub(r"[\r\n\t\v\f\x00]+", " ", str(value))
    return f"'{flat}" if isinstance(value, str) and flat.lstrip().startswith(("=", "+", "-", "@")) else flat


LONG = 30
"""A LaTeX table with more rows is a ``longtable``, which may run over pages."""

WORDS = 34
"""A column of words with a longer text gets a fixed width in LaTeX, so that its lines wrap."""

_SYMBOLS = {
    "λ_R": r"$\lambda_R$", "k_92": "$k_{92}$", "k₉₂": "$k_{92}$", "a_θ": r"$a_\theta$", "k_φ": r"$k_\varphi$",
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "%": r"\%", "#": r"\#",
    "_": r"\_", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", '"': r"\textquotedbl{}",
    "[": "{[}", "]": "{]}", "*": "{*}",  # behind a line's end they would be its options
    "−": "$-$", "±": r"$\pm$", "·": r"$\cdot$", "×": r"$\times$", "≤": r"$\le$", "≥": r"$\ge$",
    "√": r"$\surd$", "∞": r"$\infty$", "→": r"$\to$", "°": r"$^\circ$", "Δ": r"$\Delta$", "Ω": r"$\Omega$",
    "α": r"$\alpha$", "β": r"$\beta$", "δ": r"$\delta$", "θ": r"$\theta$", "λ": r"$\lambda$", "μ": r"$\mu$",
    "µ": r"$\mu$", "π": r"$\pi$", "ρ": r"$\rho$", "σ": r"$\sigma$", "τ": r"$\tau$", "φ": r"$\varphi$",
    "ψ": r"$\psi$", "ω": r"$\omega$", "–": "--", "—": "---", "“": "``", "”": "''", "…": r"\dots{}",
    "\u00a0": "~",
}  # fmt: skip
_SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_TOKEN = re.compile("|".join([*map(re.escape, sorted(_SYMBOLS, key=len, reverse=True)), "[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+"]))


def escaped(text: str) -> str:
    """Return a text as LaTeX shows it, on one line; letters of other scripts stay as they are."""

    def one(match: re.Match[str]) -> str:
        return _SYMBOLS.get(match[0]) or f"$^{{{match[0].translate(_SUPERSCRIPTS)}}}$"

    return _TOKEN.sub(one, re.sub(r"[\x00-\x1f\x7f]+", " ", text))


def to_latex(table: Table) -> str:
    """Return a table as LaTeX, to be read by ``\\input``.

    It needs the package booktabs, and longtable where it has more than `LONG` rows. Units stand in the heads.
    """
    longest = [max((len(row[k].text) for row in table.rows), default=0) for k in range(len(table.columns))]
    wraps = [n > WORDS and not c.number for n, c in zip(longest, table.columns, strict=True)]
    wide = f"p{{{0.6 / max(sum(wraps), 1):.2f}\\linewidth}}"
    kinds = ["r" if c.number else wide if wrap else "l" for c, wrap in zip(table.columns, wraps, strict=True)]
    columns = f"{{@{{}}{''.join(kinds)}@{{}}}}"
    head, *body = (
        " & ".join(map(escaped, texts)) + r" \\"
        for texts in ([c.title for c in table.columns], *([cell.text for cell in r] for r in table.rows))
    )
    caption = rf"\caption{{{escaped(f'{table.heading}. {table.caption}'.strip())}}}"
    label = rf"\label{{tab:{table.name.replace('_', '-')}}}"
    top = [r"\toprule", head, r"\midrule"]
    if len(table.rows) > LONG:
        lines = [
            r"% needs \usepackage{booktabs,longtable}", rf"\begin{{longtable}}{columns}",
            f"{caption}{label}\\\\", *top, r"\endfirsthead", *top, r"\endhead", r"\bottomrule", r"\endfoot",
            *body, r"\end{longtable}",
        ]  # fmt: skip
    else:
        lines = [
            r"% needs \usepackage{booktabs}", r"\begin{table}", r"\centering", caption, label,
            rf"\begin{{tabular}}{columns}", *top, *body, r"\bottomrule", r"\end{tabular}", r"\end{table}",
        ]  # fmt: skip
    return "\n".join(lines) + "\n"
