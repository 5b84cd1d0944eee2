"""Uncertainty budgets of a study: what the std of λ_R, k_92 and a_θ is made of (JCGM 100:2008, 5.1 and 8)."""

from __future__ import annotations

from collections.abc import Sequence

from granite_lab.estimate import Estimate, Part
from granite_lab.fitting.budget import LEFT_OUT, Budget, of_a_theta, of_mean
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.names import percent
from granite_lab.reporting.rounding import NONE, significant, tidy_unit
from granite_lab.reporting.summary import Speed, mean_over
from granite_lab.reporting.table import Cell, Table, number, tabulate

COMBINED = "combined standard uncertainty"

TITLES = {"slip": "slip ratio λ_R", "k92": "contact-angle ratio k_92", "a_theta": "a_θ"}
PRINTED = {"slip": ("points", 100.0), "k92": ("–", 1.0), "a_theta": ("s/m", 1.0)}
"""Unit of the contributions, and the factor to it."""


def budgets(result: StudyResult, speeds: Sequence[Speed]) -> dict[str, tuple[Budget, ...]]:
    """Return the budgets by quantity: "slip" and "k92" of each speed, "a_theta" of the study.

    What has no stated std, or no components, has no budget.
    """
    slip, k92 = [], []
    for speed in speeds:
        motions = [r.comparison.motion for r in speed.results]
        known = [m for m in motions if m.slip_ratio.value == m.slip_ratio.value]
        fits = [r.comparison.fit for r in speed.results if r.comparison.fit.status == "ok"]
        mean = mean_over(m.slip_ratio for m in known)
        parts = [m.slip_parts for m in known]
        slip.append(of_mean("slip", speed.velocity, Estimate(mean.value, mean.std), parts))
        mean = mean_over(f.k92 for f in fits)
        k92.append(of_mean("k92", speed.velocity, Estimate(mean.value, mean.std), [f.parts for f in fits]))
    fit = result.a_theta
    law = of_a_theta(fit, [r.comparison.fit for r in result.trials]) if fit is not None else None
    every = {"slip": slip, "k92": k92, "a_theta": [law]}
    return {name: kept for name, of in every.items() if (kept := tuple(b for b in of if b is not None))}


def budget_table(quantity: str, of: Sequence[Budget], *, virtual: bool) -> Table:
    """Return the budgets of one quantity as one table, the combined uncertainty of each last.

    Args:
        quantity: "slip", "k92" or "a_theta".
        of: its budgets.
        virtual: its data were written by a simulator.
    """
    unit, scale = PRINTED[quantity]
    rows: list[tuple[Budget, Part]] = []
    for b in of:
        rows += [(b, part) for part in b.parts]
        rows.append((b, Part(COMBINED, "A", "", "", b.result.std, b.combined)))

    def whole(part: Part) -> bool:
        return part.name == COMBINED

    def sensitivity(part: Part) -> Cell:
        return number(part.sensitivity if part.unit else float("nan"), 2, scale=scale)

    def share(b: Budget, part: Part) -> Cell:
        value = 1.0 if whole(part) else b.share(part)
        return Cell(percent(value), (value,))

    return tabulate(
        f"budget_{quantity}", f"Uncertainty budget of {TITLES[quantity]}",
        f"{'Mean over the trials of a speed. ' if quantity != 'a_theta' else ''}Contribution: sensitivity "
        "times standard uncertainty, combined over the trials. Share: of the variance. Type A: from the "
        f"scatter of the data; type B: from other knowledge. {LEFT_OUT[quantity]}",
        rows,
        [
            ("component", "", lambda r: r[1].name),
            ("speed [m/s]", "speed_mps", lambda r: Cell(f"{r[0].speed:g}", (r[0].speed,)))
            if quantity != "a_theta" else None,
            ("type", "", lambda r: "" if whole(r[1]) else r[1].kind),
            ("distribution", "", lambda r: r[1].distribution or NONE),
            ("standard uncertainty", "std std_unit", lambda r: Cell(
                f"{significant(r[1].std, 2)} {tidy_unit(r[1].unit if r[1].unit != '1' else '')}".strip()
                if r[1].unit else NONE, (r[1].std if r[1].unit else None, r[1].unit),
            )),
            (f"sensitivity [{unit} per its unit]", "sensitivity", lambda r: sensitivity(r[1])),
            (f"contribution [{unit}]", "contribution",
             lambda r: number(r[1].contribution, 2, scale=scale)),
            ("share", "share", lambda r: share(*r)),
        ],
        virtual=virtual,
    )  # fmt: skip


def budget_tables(result: StudyResult, speeds: Sequence[Speed]) -> tuple[Table, ...]:
    """Return the table of each quantity that has a budget."""
    found = budgets(result, speeds)
    return tuple(budget_table(quantity, of, virtual=result.virtual) for quantity, of in found.items())
