"""The page docs/validation.md: its numbers, put into the text of validation.md.jinja."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from benchmarks import validation as v
from benchmarks.validation_data import Series
from benchmarks.validation_fit import Needed, Setup, paper_law, residuals, total

TEXT = Path(__file__).with_name("validation.md.jinja")


def page(results: v.Results) -> str:
    """Return the page as Markdown."""
    template = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False).from_string(
        TEXT.read_text(encoding="utf-8")
    )
    tables = {
        f.__name__: f(results)
        for f in (v.given_table, v.needs_table, v.laws_table, v.effects_table, v.braking_table,
                  v.ripple_table, v.sensitivity_table, v.every_row)
    }  # fmt: skip
    return template.render(**tables, **_needed(results), **_fitted(results)) + "\n"


def _needed(results: v.Results) -> dict[str, Any]:
    """Return what the text says of the points, of nothing fitted, and of k_92 by slip."""
    needs = [n for s in results.series for n in results.needs[s.id]]
    driven = {s.id: [n for n in results.needs[s.id] if n.row.slip > -0.1] for s in results.series}
    without = [n for part in driven.values() for n in part]
    torque = [n for n in without if np.isfinite(n.best[1])]
    steep = [n for n in without if n.row.slip >= 0.3]
    slipping = [[n for n in part if n.row.slip > 0.05 and n.reached[0]] for part in driven.values()]
    reachable = [part for part in slipping if len(part) > 1]
    grown = [part[-1].row.sinkage / part[0].row.sinkage for part in driven.values()]
    spans = [
        zero[2] / law[2]
        for s in results.series
        for zero, law in zip(results.given[s.id]["zero"], results.given[s.id]["law"], strict=True)
    ]
    return {
        "rows": sum(len(s.rows) for s in results.series),
        "wheels": len(results.series),
        "figures": v.FIGURES,
        "law_at_10": f"{paper_law(0.0):.2f}",
        "ding": {
            **{way: f"{v.relative_pull(results, way, 'ding'):.0f}" for way in ("law", "zero", "rival")},
            "sinkage": f"{v.median_errors(results, 'zero', 'ding')[2]:.1f}",
        },
        "slips": len(needs),
        "common": sum(n.common is not None for n in needs),
        "torque_slips": len(torque),
        "three": sum(n.common is not None for n in torque),
        "driven": len(without),
        "pulled": sum(n.reached[0] for n in without),
        "sunk": sum(n.reached[2] for n in without),
        "steep": len(steep),
        "steep_sunk": sum(n.reached[2] for n in steep),
        "growth": _range(grown, 1),
        "span": f"{max(spans):.1f}",
        "reachable": len(reachable),
        "at_first": _range([float(part[0].best[0]) for part in reachable]),
        "at_half": f"{max(float(n.best[0]) for part in reachable for n in part if n.row.slip >= 0.45):.2f}",
        "at_tenth": _range(_at(reachable, 0.1)),
        "at_fifth": _range(_at(reachable, 0.2)),
    }


def _at(parts: Sequence[Sequence[Needed]], slip: float) -> list[float]:
    return [float(n.best[0]) for part in parts for n in part if abs(n.row.slip - slip) < 0.04]


def _range(values: Sequence[float], digits: int = 2) -> str:
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"


def _fitted(results: v.Results) -> dict[str, Any]:
    """Return what the text says of laws and effects."""
    full = results.full
    agree = [s for s in results.series if total(full[s.id].off) <= 1]
    grown = [s for s in results.series if v.expected(full[s.id], v.GROWTH)]
    pushed = [s for s in results.series if v.expected(full[s.id], v.STRENGTH)]
    both = [s.title for s in agree if s in grown and s in pushed]
    strengths = [full[s.id].values[".".join(v.STRENGTH)] for s in results.series if s not in pushed]
    totals = np.median([_totals(results, s) for s in results.series], axis=0)
    changes = [v.ripple(s, row)[0] for s in results.series if s.lug for row in s.driven]
    return {
        "totals": [f"{x:.1f}" for x in totals],
        "alone": sum(total(results.effects[s.id][0].off) <= 1 for s in results.series),
        "agree": len(agree),
        "left_out": _range([full[s.id].left_out for s in agree], 1),
        "grown": len(grown),
        "pushed": len(pushed),
        "strength": _range(strengths, 1),
        "both": f"{len(both)} wheels ({'; '.join(both)})" if both else "no wheel",
        "ripple": f"{max(map(abs, changes)):.1f}",
    }


def _totals(results: v.Results, s: Series) -> list[float]:
    free = np.array([n.joint_residuals for n in results.needs[s.id] if n.row.slip > -0.1])
    paper = residuals(s, s.driven, Setup(paper_law))
    return [total(x) for x in (paper, results.constants[s.id].off, results.linears[s.id].off, free)]
