"""Tables as LaTeX: every character escaped, units in the heads, the lines of booktabs."""

from __future__ import annotations

import re

import pytest

from granite_lab.reporting.report import study_report
from granite_lab.reporting.table import LONG, Cell, Column, Table, escaped, to_latex, words
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import made_up_finding


def table(rows: int, text: str = "a_b & c") -> Table:
    columns = (Column("trial", "", ("trial",), False), Column("slip λ_R", "%", ("slip",)))
    return Table(
        "mine", "Title 5 %", "", columns, ((words(text), Cell("−1.5 ± 0.2", (-1.5,))),) * rows, virtual=True
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("50 % & more_of #1", r"50 \% \& more\_of \#1"),
        ("k_92 = exp(−a_θ v)", r"$k_{92}$ = exp($-$$a_\theta$ v)"),
        ("3.8·10⁻⁵ m/s²", r"3.8$\cdot$10$^{-5}$ m/s$^{2}$"),
        ("{x}^~\\", r"\{x\}\textasciicircum{}\textasciitilde{}\textbackslash{}"),
    ],
)
def test_characters_are_escaped(text: str, expected: str) -> None:
    assert escaped(text) == expected


def test_a_table_has_the_lines_of_booktabs_and_units_in_its_head() -> None:
    lines = to_latex(table(2)).splitlines()
    assert [line for line in lines if line.endswith("rule")] == [r"\toprule", r"\midrule", r"\bottomrule"]
    assert r"trial & slip $\lambda_R$ {[}\%{]} \\" in lines
    assert lines.count(r"a\_b \& c & $-$1.5 $\pm$ 0.2 \\") == 2
    assert any("(virtual data)" in line for line in lines)


def test_a_long_table_may_run_over_pages() -> None:
    text = to_latex(table(LONG + 1))
    assert r"\begin{longtable}" in text
    assert r"\begin{table}" not in text


def plain(latex: str) -> str:
    """Leave out commands and escaped characters; what is left may hold no special character."""
    return re.sub(r"\$[^$]*\$|\\[A-Za-z]+|\\[&%$#_{}\\]", "", latex)


def test_every_table_of_a_report_is_valid_whatever_its_texts_hold() -> None:
    result = made_up_study(speeds=(0.3, 0.7), repetitions=2)
    report = study_report(result.__class__(**{**result.__dict__, "finding": made_up_finding()}))
    for one in (*report.tables, table(3, HOSTILE)):
        latex = to_latex(one)
        content = latex.split("\n", 1)[1]  # the first line is a comment
        assert content.count("{") - content.count(r"\{") == content.count("}") - content.count(r"\}")
        assert not set(plain(content)) & set("%#_^\\$"), one.name  # "~" is a space
        for row in content.splitlines():
            if row.endswith(r" \\") and not row.startswith("\\"):
                assert len(re.findall(r"(?<!\\)&", row)) == len(one.columns) - 1
        assert content.isascii(), (one.name, {c for c in content if not c.isascii()})
