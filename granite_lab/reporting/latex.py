"""A table of a report as LaTeX, with the lines of the package booktabs."""

from __future__ import annotations

import re

from granite_lab.reporting.table import Table

LONG = 30
"""A table with more rows is a ``longtable``, which may run over pages."""

WORDS = 34
"""A column with a longer text gets a fixed width, so that its lines wrap."""

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
        token = match[0]
        return _SYMBOLS.get(token) or f"$^{{{token.translate(_SUPERSCRIPTS)}}}$"

    return _TOKEN.sub(one, re.sub(r"[\x00-\x1f\x7f]+", " ", text))


def to_latex(table: Table) -> str:
    """Return a table as LaTeX, to be read by ``\\input``.

    It needs the package booktabs, and longtable where it has more than `LONG` rows. Units stand in the heads.
    """
    widths = [
        max((len(row[k].text) for row in table.rows), default=0) > WORDS and not column.number
        for k, column in enumerate(table.columns)
    ]
    wide = f"p{{{0.6 / max(sum(widths), 1):.2f}\\linewidth}}"
    kinds = "".join(
        "r" if column.number else (wide if wraps else "l")
        for column, wraps in zip(table.columns, widths, strict=True)
    )
    head = " & ".join(escaped(column.title) for column in table.columns) + r" \\"
    body = [" & ".join(escaped(cell.text) for cell in row) + r" \\" for row in table.rows]
    caption = rf"\caption{{{escaped(f'{table.heading}. {table.caption}'.strip())}}}"
    label = rf"\label{{tab:{table.name.replace('_', '-')}}}"
    top, rule, bottom = r"\toprule", r"\midrule", r"\bottomrule"
    if len(table.rows) > LONG:
        lines = [
            r"% needs \usepackage{booktabs,longtable}",
            rf"\begin{{longtable}}{{@{{}}{kinds}@{{}}}}", f"{caption}{label}\\\\", top, head, rule,
            r"\endfirsthead", top, head, rule, r"\endhead", bottom, r"\endfoot", *body, r"\end{longtable}",
        ]  # fmt: skip
    else:
        lines = [
            r"% needs \usepackage{booktabs}", r"\begin{table}", r"\centering", caption, label,
            rf"\begin{{tabular}}{{@{{}}{kinds}@{{}}}}", top, head, rule, *body, bottom, r"\end{tabular}",
            r"\end{table}",
        ]  # fmt: skip
    return "\n".join(lines) + "\n"
