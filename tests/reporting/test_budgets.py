"""The components of an uncertainty budget, as printed, add up to the std that the report states."""

from __future__ import annotations

import csv
import io
import math
from collections import defaultdict
from dataclasses import replace

import pytest

from granite_lab.estimate import Part
from granite_lab.fitting import fit_a_theta
from granite_lab.parameters import load_paper
from granite_lab.reporting.content import StudyResult, TrialResult
from granite_lab.reporting.report import study_report
from granite_lab.reporting.summary import by_speed
from granite_lab.reporting.table import Table
from granite_lab.reporting.tables import COMBINED, budget_tables
from tests.reporting.made_up import made_up_study


def with_parts(result: TrialResult) -> TrialResult:
    """Give the std of a trial two components that make it up."""
    comparison = result.comparison
    slip, k92 = comparison.motion.slip_ratio.std, comparison.fit.k92.std
    parts = [
        (
            Part("accelerometer noise", "A", "normal", "m/s²/√Hz", 1e-3, 0.6 * std),
            Part("encoder counts and stamps", "B", "rectangular", "m", 1e-4, 0.8 * std),
        )
        for std in (slip, k92)
    ]
    motion, fit = (
        replace(comparison.motion, slip_parts=parts[0]),
        replace(comparison.fit, parts=parts[1]),
    )
    return TrialResult(result.trial, replace(comparison, motion=motion, fit=fit))


@pytest.fixture(scope="module")
def study() -> StudyResult:
    made = made_up_study(speeds=(0.2, 0.3, 0.5, 0.7), repetitions=3)
    trials = tuple(map(with_parts, made.trials))
    return replace(made, trials=trials, a_theta=fit_a_theta([r.comparison.fit for r in trials]))


def combined(table: Table) -> dict[str, float]:
    """Return the root of the sum of squares of the contributions in the CSV, by speed."""
    squares: dict[str, float] = defaultdict(float)
    for row in csv.DictReader(io.StringIO(table.to_csv())):
        if row["component"] != COMBINED:
            squares[row.get("speed_mps", "")] += float(row["contribution"]) ** 2
    return {speed: math.sqrt(square) for speed, square in squares.items()}


def test_the_contributions_add_up_to_the_stated_std(study: StudyResult) -> None:
    speeds = by_speed(study, load_paper())
    tables = {t.name: combined(t) for t in budget_tables(study, speeds)}
    assert set(tables) == {"budget_slip", "budget_k92", "budget_a_theta"}
    for s in speeds:  # the stated ones are rounded to two digits or fewer
        assert 100 * tables["budget_slip"][f"{s.velocity:g}"] == pytest.approx(s.slip.std, rel=0.05)
        assert tables["budget_k92"][f"{s.velocity:g}"] == pytest.approx(s.k92.std, rel=0.05)
    assert study.a_theta is not None
    assert tables["budget_a_theta"][""] == pytest.approx(study.a_theta.a_theta.std, rel=1e-6)


def test_shares_add_up_to_one(study: StudyResult) -> None:
    (table,) = (t for t in budget_tables(study, by_speed(study, load_paper())) if t.name == "budget_a_theta")
    rows = list(csv.DictReader(io.StringIO(table.to_csv())))
    assert sum(float(r["share"]) for r in rows if r["component"] != COMBINED) == pytest.approx(1)


def test_the_budgets_stand_in_one_closed_part_of_the_report(study: StudyResult) -> None:
    report = study_report(study)
    folds = [b for s in report.sections for b in s.blocks if getattr(b, "title", "") == "Uncertainty budgets"]
    assert len(folds) == 1
    assert all(t.virtual for t in report.tables if t.name.startswith("budget"))


def test_without_components_there_is_no_budget() -> None:
    made = made_up_study(speeds=(0.2, 0.3, 0.5), repetitions=2)
    assert budget_tables(made, by_speed(made, load_paper())) == []
