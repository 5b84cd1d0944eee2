"""LaTeX: every table compiles in an article on A4, is no wider than its text, and shows what its cells "
"hold."""

import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from granite_lab.columns import Column, FilledTable, Table, number, words
from granite_lab.reporting.latex import WORDS, breakable, escaped, to_latex
from granite_lab.reporting.report import study_report
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study, rename
from tests.reporting.made_up_finding import made_up_finding
from tests.reporting.test_paper import with_parts

LETTERS = "試験 Прогон é ø Σ ≈ “x” – …  ½ 🚙"
"""Letters and signs that Computer Modern has not, and some that it has."""


def table(rows: int, text: str = "a_b & c", columns: int = 1, note: str = "") -> FilledTable:
    shown = [Column[str]("trial", words)]
    shown += [Column[str]("slip λ_R", lambda _: number(-1.5), "slip", unit="%") for _ in range(columns)]
    return Table("mine", "Title 5 %", *shown, note=note).fill([text] * rows, virtual=True)


def every_table() -> list[FilledTable]:
    """Return all kinds of tables, of studies of all sizes, and some with texts that no log should hold."""
    small = made_up_study(speeds=(0.3, 0.7), repetitions=2)
    budgets = replace(small, trials=tuple(map(with_parts, small.trials)))
    found = [replace(small, finding=made_up_finding(verdict)) for verdict in ("named", "unknown", "none")]
    twins = replace(small, finding=made_up_finding(twins=("slip_sinkage", "com_offset", "payload_mass")))
    long = replace(small, trials=small.trials * 20)
    studies = (
        budgets,
        *found,
        twins,
        long,
        rename(small, HOSTILE),
        rename(small, LETTERS),
        rename(small, "x" * 200),
    )
    tables = [one for study in studies for one in study_report(study).tables]
    made = [table(2, columns=0)]
    made += [
        table(rows, text, n, text)
        for rows in (1, 90)
        for n in (1, 11, 30)
        for text in ("a", HOSTILE, "word " * 40)
    ]
    return [*tables, *made]


@pytest.fixture(scope="module")
def tables() -> list[FilledTable]:
    return every_table()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("50 % & more_of #1", r"50 \% \& more\_of \#1"),
        ("k_92 = exp(−a_θ v)", r"$k_{92}$ = exp($-$$a_\theta$ v)"),
        ("3.8·10⁻⁵ m/s²", r"3.8$\cdot$10$^{-5}$ m/s$^{2}$"),
        ("{x}^~\\", r"\{x\}\textasciicircum{}\textasciitilde{}\textbackslash{}"),
        ("ΩλΣφ", r"$\Omega$$\lambda$$\Sigma$$\varphi$"),
        ("éa\u0308", r"\'{e}\"{a}"),
        ("試", r"U+8A66\allowbreak{}"),
    ],
)
def test_characters_are_escaped(text: str, expected: str) -> None:
    assert escaped(text) == expected


def test_a_table_has_the_lines_of_booktabs_units_in_its_head_and_its_note_below() -> None:
    lines = to_latex(table(2, note="Means of 5 % & more.")).splitlines()
    assert [line for line in lines if line.endswith("rule")] == [r"\toprule", r"\midrule", r"\bottomrule"]
    assert r"trial & slip $\lambda_R$ {[}\%{]} \tabularnewline" in lines
    assert lines.count(r"a\_b \& c & $-$1.50 \tabularnewline") == 2
    assert any(r"\caption{Title 5 \% (virtual data)}" in line for line in lines)
    note = next(i for i, line in enumerate(lines) if r"Means of 5 \% \& more." in line)
    assert note > lines.index(r"\end{tabular}")


def test_a_tall_table_is_continued_under_its_number_and_repeats_its_head() -> None:
    tall = to_latex(table(60))
    assert tall.count(r"\toprule") == 2
    assert tall.count(r"\label") == tall.count(r"\addtocounter{table}{-1}") == 1
    assert "(continued)" in tall
    assert tall.count(r"a\_b \& c") == 60


def test_columns_beyond_the_width_of_the_text_follow_beside_the_name_of_the_row() -> None:
    content = to_latex(table(3, columns=30))
    assert content.count(r"\begin{tabular}{@{}l") > 1
    assert content.count("a\\_b") == 3 * content.count(r"\begin{tabular}{@{}l")
    assert content.count("$-$1.50") == 3 * 30


def test_every_table_is_balanced_escaped_and_has_all_columns_in_each_row(
    tables: Sequence[FilledTable],
) -> None:
    for one in tables:
        content = to_latex(one).split("\n", 1)[1]  # the first line is a comment
        assert content.count("{") - content.count(r"\{") == content.count("}") - content.count(r"\}")
        # without commands and escaped characters nothing special is left; "~" is a space
        plain = re.sub(r"\$[^$]*\$|\\[A-Za-z]+|\\[&%$#_{}\\'\"`^~.=]", "", content)
        assert not set(plain) & set("%#_^\\$"), one.name
        assert content.isascii(), one.name
        assert len(re.findall(r"\\begin\{(\w+)\}", content)) == len(re.findall(r"\\end\{(\w+)\}", content))
        tabular = r"\\begin\{tabular\}\{@\{\}([^@]*)@\{\}\}\n(.*?)\\end\{tabular\}\n\\unskip"
        blocks = re.findall(tabular, content, re.S)
        rows = 0
        for kinds, body in blocks:
            columns = len(re.sub(r"\{[^}]*\}", "", kinds))
            lines = [line for line in body.splitlines() if line.endswith(r"\tabularnewline")]
            assert {len(re.findall(r"(?<!\\)&", line)) for line in lines} == {columns - 1}, one.name
            rows += (columns - 1 or 1) * (len(lines) - 1)
        assert rows == (len(one.columns) - 1 or 1) * len(one.rows), one.name


def test_a_long_word_may_be_broken_and_a_short_one_not() -> None:
    assert r"\allowbreak{}" in breakable("0123456789abcdef" * 4)
    assert r"\allowbreak" not in breakable("x" * WORDS)


@pytest.mark.skipif(
    shutil.which("pdflatex") is None, reason="pdflatex is not installed: tables are not compiled"
)
def test_every_table_compiles_in_an_article_without_an_error_or_a_box_that_is_too_wide(
    tables: Sequence[FilledTable], tmp_path: Path
) -> None:
    lines = [
        r"\documentclass[11pt,a4paper]{article}",
        r"\usepackage{booktabs,graphicx}",
        r"\begin{document}",
    ]
    for k, one in enumerate(tables):
        (tmp_path / f"t{k}.tex").write_text(to_latex(one), encoding="utf-8")
        lines += [rf"\typeout{{table {k} {one.name}}}", rf"\input{{t{k}.tex}}", r"\clearpage"]
    (tmp_path / "all.tex").write_text("\n".join([*lines, r"\end{document}"]), encoding="utf-8")
    command = ["pdflatex", "-draftmode", "-interaction=nonstopmode", "all.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    log = (tmp_path / "all.log").read_text(encoding="utf-8", errors="replace")
    assert [line for line in log.splitlines() if re.match("!|Overfull|.*[Ff]loat too large", line)] == []
    assert done.returncode == 0, log[-2000:]
    assert f"table {len(tables) - 1} " in log
