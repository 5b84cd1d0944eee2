"""Tables: budgets that add up to the stated std, and LaTeX with the lines of booktabs."""

from __future__ import annotations

import csv
import io
import math
import re
from collections import defaultdict
from dataclasses import replace

import pytest

from granite_lab.estimate import Part
from granite_lab.fitting import fit_a_theta
from granite_lab.parameters import load_paper
from granite_lab.reporting.answers import by_speed
from granite_lab.reporting.render import LONG, escaped, to_latex
from granite_lab.reporting.report import study_report
from granite_lab.reporting.table import Cell, Column, Table, words
from granite_lab.reporting.tables import COMBINED, budget_tables
from granite_lab.results import StudyResult, TrialResult
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import made_up_finding


def with_parts(result: TrialResult) -> TrialResult:
    """Give the std of a trial two components that make it up."""

    def parts(std: float) -> tuple[Part, ...]:
        return (
            Part("accelerometer noise", "A", "normal", "m/s²/√Hz", 1e-3, 0.6 * std),
            Part("encoder counts and stamps", "B", "rectangular", "m", 1e-4, 0.8 * std),
        )

    c = result.comparison
    motion = replace(c.motion, slip_parts=parts(c.motion.slip_ratio.std))
    fit = replace(c.fit, parts=parts(c.fit.k92.std))
    return TrialResult(result.trial, replace(c, motion=motion, fit=fit))


@pytest.fixture(scope="module")
def budgeted() -> StudyResult:
    made = made_up_study()
    trials = tuple(map(with_parts, made.trials))
    return replace(made, trials=trials, a_theta=fit_a_theta([r.comparison.fit for r in trials]))


def test_the_contributions_add_up_to_the_stated_std_and_the_shares_to_one(budgeted: StudyResult) -> None:
    speeds = by_speed(budgeted, load_paper())
    squares: dict[tuple[str, str], float] = defaultdict(float)
    shares: dict[tuple[str, str], float] = defaultdict(float)
    for table in budget_tables(budgeted, speeds):
        for row in csv.DictReader(io.StringIO(table.to_csv())):
            if row["component"] != COMBINED:
                key = table.name, row.get("speed_mps", "")
                squares[key] += float(row["contribution"]) ** 2
                shares[key] += float(row["share"])
    sums = {key: math.sqrt(square) for key, square in squares.items()}
    assert {name for name, _ in sums} == {"budget_slip", "budget_k92", "budget_a_theta"}
    for s in speeds:  # the stated ones are rounded to two digits or fewer
        assert 100 * sums["budget_slip", f"{s.velocity:g}"] == pytest.approx(s.slip.std, rel=0.05)
        assert sums["budget_k92", f"{s.velocity:g}"] == pytest.approx(s.k92.std, rel=0.05)
    assert budgeted.a_theta is not None
    assert sums["budget_a_theta", ""] == pytest.approx(budgeted.a_theta.a_theta.std, rel=1e-6)
    assert [*shares.values()] == pytest.approx([1.0] * len(shares))


def test_the_budgets_stand_in_one_closed_part_of_the_report(budgeted: StudyResult) -> None:
    report = study_report(budgeted)
    folds = [b for s in report.sections for b in s.blocks if getattr(b, "title", "") == "Uncertainty budgets"]
    assert len(folds) == 1
    assert all(t.virtual for t in report.tables if t.name.startswith("budget"))
    made = made_up_study(speeds=(0.2, 0.3, 0.5), repetitions=2)  # without components
    assert budget_tables(made, by_speed(made, load_paper())) == []


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
    long = to_latex(table(LONG + 1))  # it may run over pages
    assert r"\begin{longtable}" in long
    assert r"\begin{table}" not in long


def test_every_table_of_a_report_is_valid_latex_whatever_its_texts_hold() -> None:
    result = replace(made_up_study(speeds=(0.3, 0.7), repetitions=2), finding=made_up_finding())
    for one in (*study_report(result).tables, table(3, HOSTILE)):
        content = to_latex(one).split("\n", 1)[1]  # the first line is a comment
        assert content.count("{") - content.count(r"\{") == content.count("}") - content.count(r"\}")
        # without commands and escaped characters nothing special is left; "~" is a space
        plain = re.sub(r"\$[^$]*\$|\\[A-Za-z]+|\\[&%$#_{}\\]", "", content)
        assert not set(plain) & set("%#_^\\$"), one.name
        for row in content.splitlines():
            if row.endswith(r" \\") and not row.startswith("\\"):
                assert len(re.findall(r"(?<!\\)&", row)) == len(one.columns) - 1
        assert content.isascii(), (one.name, {c for c in content if not c.isascii()})
