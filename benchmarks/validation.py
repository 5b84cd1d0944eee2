"""The contact model held against measured single wheels; writes docs/validation.md and its figures.

``python -m benchmarks.validation [--out docs/validation.md]``
"""

from __future__ import annotations

import csv
import io
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from benchmarks import validation_plots as plots
from benchmarks.against_truth import table
from benchmarks.command_line import parser_of
from benchmarks.validation_data import Row, Series, all_series
from benchmarks.validation_fit import (
    Array,
    Fit,
    Needed,
    Setup,
    bekker_wong,
    constant,
    fit,
    law_forms,
    measured,
    model,
    needed,
    numbers,
    paper_law,
    residuals,
    total,
)
from granite_lab.effects import get
from granite_lab.files import write_bytes, write_text
from granite_lab.model.effect import activate
from granite_lab.model.single_wheel import Ratio, SingleWheel, rolling
from granite_lab.reporting.canvas import saved

GROWTH, STRENGTH = ("slip_sinkage", "growth"), ("bulldozing", "strength")
CHOICES: tuple[tuple[tuple[str, str], ...], ...] = ((GROWTH,), (STRENGTH,), (GROWTH, STRENGTH))
LAWS = (GROWTH, ("stress_ahead", "share"), ("shear_softening", "loss"), ("exit_by_sinkage", "share"))
"""Contact laws of the library that do not go by the speed, each with what says how much of it there is."""

TEXT = Path(__file__).with_name("validation.md.jinja")
FIGURES = (("k10", "K10-mini"), ("ding", "Ding 2011"), ("kls1", "KLS-1"), ("rashid", "Rashid-1"))


@dataclass(frozen=True)
class Results:
    """All that the page tells.

    Attributes:
        series: the measured wheels.
        given: series id to name of a model to (rows, 3) pull, torque, sinkage, nothing fitted.
        needs: series id to the k_92 that each slip needs.
        constants, linears: the laws of k_92, by series.
        laws: series id to the fits of the contact laws in the order of `LAWS`, each with a constant k_92.
        effects: series id to the fits with effects, in the order of `CHOICES`, k_92 linear in slip.
        braking: the same for braked wheels with a constant k_92; without effects first.
    """

    series: Sequence[Series]
    given: Mapping[str, Mapping[str, Array]]
    needs: Mapping[str, Sequence[Needed]]
    constants: Mapping[str, Fit]
    linears: Mapping[str, Fit]
    laws: Mapping[str, Sequence[Fit]]
    effects: Mapping[str, Sequence[Fit]]
    braking: Mapping[str, Sequence[Fit]]

    @property
    def full(self) -> dict[str, Fit]:
        """The fits with both effects."""
        return {name: fits[-1] for name, fits in self.effects.items()}


def measure() -> Results:
    """Compute all of it."""
    series = all_series()
    ways: dict[str, Callable[[Series, Row], Array]] = {
        "law": lambda s, row: numbers(model(s, row, Setup(paper_law))),
        "zero": lambda s, row: numbers(model(s, row, Setup(constant(0.0)))),
        "rival": bekker_wong,
        "lug radius": lambda s, row: numbers(model(s, row, Setup(constant(0.0), radius=s.lug))),
        "rubber": lambda s, row: numbers(model(s, row, Setup(constant(0.0), tyre_friction=0.6))),
    }
    given = {
        s.id: {name: np.array([way(s, row) for row in s.rows]) for name, way in ways.items()} for s in series
    }
    forms = law_forms()
    braked = {s.id: [row for row in s.groups if row.slip < -0.1] for s in series}
    return Results(
        series,
        given,
        {s.id: [needed(s, row) for row in s.groups] for s in series},
        {s.id: fit(s, forms[0]) for s in series},
        {s.id: fit(s, forms[1]) for s in series},
        {s.id: [fit(s, law_forms((law,))[0], leave_out=False) for law in LAWS] for s in series},
        {s.id: [fit(s, law_forms(c)[1]) for c in CHOICES] for s in series},
        {
            s.id: [fit(s, law_forms(c)[0], braked[s.id], leave_out=False) for c in ((), *CHOICES)]
            for s in series
            if braked[s.id]
        },
    )


def median_errors(results: Results, way: str, ids: str = "") -> tuple[float, float, float]:
    """Return the median error of pull and torque [% of load, of load times radius] and sinkage [mm]."""
    errors = []
    for s in results.series:
        if s.id.startswith(ids):
            for row, found in zip(s.rows, results.given[s.id][way], strict=True):
                scale = np.array([row.load / 100, row.load * s.wheels.radius / 100, 1.0])
                errors.append(np.abs(found - measured(row)) / scale)
    a, b, c = (float(x) for x in np.array([_median(col) for col in np.array(errors).T]))
    return a, b, c


def _median(values: Array) -> float:
    there = values[~np.isnan(values)]
    return float(np.median(there)) if there.size else math.nan


def relative_pull(results: Results, way: str) -> float:
    """Return the median error of the drawbar pull of Ding's wheels over the pull itself [%]."""
    errors = [
        abs(found[0] - row.pull) / abs(row.pull)
        for s in results.series
        if s.id.startswith("ding")
        for row, found in zip(s.rows, results.given[s.id][way], strict=True)
    ]
    return 100 * float(np.median(errors))


def number(value: float, digits: int = 1) -> str:
    """Return a number, a dash where there is none."""
    return "–" if not math.isfinite(value) else f"{value:.{digits}f}".replace("-", "−")


def given_table(results: Results) -> str:
    """Return the errors of each series with nothing fitted."""
    rows = []
    for s in results.series:
        cells = [s.title, str(len(s.rows))]
        errors = [median_errors(results, way, s.id) for way in ("law", "zero", "rival")]
        for c, digits in ((0, 0), (1, 0), (2, 1)):
            cells.append(" / ".join(number(e[c], digits) for e in errors))
        rows.append(cells)
    return table(
        ["wheel", "rows", "drawbar pull [% of load]", "torque [% of load · r]", "sinkage [mm]"], rows
    )


def needs_rows(results: Results) -> str:
    """Return the k_92 that each quantity needs at each slip, as CSV."""
    each = [cell for name in ("pull", "torque", "sinkage") for cell in (f"k92_{name}", f"{name}_reached")]
    head = ["wheel", "slip", *each, "k92_all_from", "k92_all_to", "k92_least_squares"]
    rows = [head]
    for s in results.series:
        for n in results.needs[s.id]:
            each = [cell for c in range(3) for cell in _need(float(n.best[c]), n.reached[c])]
            common = ["", ""] if n.common is None else [f"{value:.2f}" for value in n.common]
            rows.append([s.title, f"{n.row.slip:.2f}", *each, *common, f"{n.joint:.2f}"])
    return comma_separated(rows)


def _need(value: float, reached: bool) -> tuple[str, str]:
    return (f"{value:.2f}", "yes" if reached else "no") if math.isfinite(value) else ("", "")


def comma_separated(rows: Iterable[Sequence[str]]) -> str:
    """Return rows as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def fits_table(results: Results) -> str:
    """Return how well laws of k_92, and effects of the library beside one, describe the driven wheels."""
    rows = []
    for s in results.series:
        laws = _totals(results, s)
        effects = [total(found.off) for found in results.effects[s.id]]
        full = results.full[s.id]
        rows.append([
            s.title, *map(number, (*laws, *effects)), number(full.left_out), size_of(full, GROWTH),
            size_of(full, STRENGTH),
        ])  # fmt: skip
    head = ["wheel", "paper's law", "constant", "linear", "free", "+ sinkage", "+ bulldozing", "+ both",
            "held out", "n1", "strength"]  # fmt: skip
    return table(head, rows)


def laws_table(results: Results) -> str:
    """Return what each contact law leaves of the residuals, and its size."""
    rows = [
        [s.title, number(total(results.constants[s.id].off)),
         *(f"{number(total(found.off))} ({size_of(found, law)})"
           for law, found in zip(LAWS, results.laws[s.id], strict=True))]
        for s in results.series
    ]  # fmt: skip
    return table(["wheel", "paper's", *(f"`{id_}` ({name})" for id_, name in LAWS)], rows)


def size_of(found: Fit, effect: tuple[str, str]) -> str:
    """Return a fitted size, in bold where the literature does not lead to expect it."""
    key = ".".join(effect)
    if key not in found.values:
        return ""
    text = number(found.values[key], 2)
    return text if expected(found, effect) else f"**{text}**"


def expected(found: Fit, effect: tuple[str, str]) -> bool:
    """Tell whether a fitted size lies in the range that the library gives with its sources, or is nothing."""
    value = found.values[".".join(effect)]
    p = next(q for q in get(effect[0]).parameters if q.name == effect[1])
    return p.prior_low <= value <= p.prior_high or abs(value - p.neutral) < 0.01


def ripple(series: Series, row: Row) -> float:
    """Return how much lugs that modulate the pressure by 0.3 change the mean of the pull over a lug [N]."""
    wheels = replace(series.wheels, lugs=1.0)
    lugs = [activate(get("tread_ripple"), {"cos_front": 0.3})]
    plain = numbers(model(series, row, Setup(constant(0.3))))
    found = [
        numbers(
            SingleWheel(wheels, series.soil, lugs).at_load(
                row.load, rolling(row.slip, wheels.radius, angle=angle), Ratio(0.3)
            )
        )
        for angle in np.arange(16) * 2 * np.pi / 16
    ]
    return float(np.mean(found, axis=0)[0] - plain[0])


def changes(results: Results, way: str) -> tuple[str, str]:
    """Return how far another reading moves the median errors of pull [% of load] and sinkage [mm] at most."""
    given, other = (np.array([median_errors(results, w, ids) for ids, _ in FIGURES]) for w in ("zero", way))
    pull, _, sinkage = np.max(np.abs(given - other), axis=0)
    return f"{pull:.0f}", f"{sinkage:.1f}"


def every_row(results: Results) -> str:
    """Return every measured point beside the model with nothing fitted, as CSV."""
    rows = [["wheel", "slip", "load_N", "pull_std_N"]]
    for name in ("pull_N", "torque_Nm", "sinkage_mm"):
        rows[0] += [name, f"{name}_paper_k92", f"{name}_zero_k92"]
    for s in results.series:
        ways = [results.given[s.id][way] for way in ("law", "zero")]
        for k, row in enumerate(s.rows):
            values = [[measured(row)[c], *(way[k][c] for way in ways)] for c in range(3)]
            known = [v if math.isfinite(v[0]) else [math.nan] * 3 for v in values]
            figures = [row.pull_std, *known[0], *known[1], *known[2]]
            cells = [f"{x:.4g}" if math.isfinite(x) else "" for x in map(float, figures)]
            rows.append([s.title, f"{row.slip:.2f}", f"{row.load:.1f}", *cells])
    return comma_separated(rows)


def page(results: Results) -> str:
    """Return the page as Markdown."""
    template = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False).from_string(
        TEXT.read_text(encoding="utf-8")
    )
    tables: dict[str, Any] = {f.__name__: f(results) for f in (given_table, fits_table, laws_table)}
    tables |= {"tips": changes(results, "lug radius"), "rubber": changes(results, "rubber")}
    return template.render(**tables, **_needed(results), **_fitted(results)) + "\n"


def _needed(results: Results) -> dict[str, Any]:
    """Return what the text says of the points, of nothing fitted, and of k_92 by slip."""
    needs = [n for s in results.series for n in results.needs[s.id]]
    driven = {s.id: [n for n in results.needs[s.id] if n.row.slip > -0.1] for s in results.series}
    without = [n for part in driven.values() for n in part]
    torque = [n for n in without if np.isfinite(n.best[1])]
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
        "figures": FIGURES,
        "law_at_10": f"{paper_law(0.0):.2f}",
        "ding": {
            **{way: f"{relative_pull(results, way):.0f}" for way in ("law", "zero", "rival")},
            "sinkage": f"{median_errors(results, 'zero', 'ding')[2]:.1f}",
        },
        "slips": len(needs),
        "common": sum(n.common is not None for n in needs),
        "torque_slips": len(torque),
        "three": sum(n.common is not None for n in torque),
        "driven": len(without),
        "pulled": sum(n.reached[0] for n in without),
        "sunk": sum(n.reached[2] for n in without),
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


def _fitted(results: Results) -> dict[str, Any]:
    """Return what the text says of laws and effects."""
    full = results.full
    agree = [s for s in results.series if total(full[s.id].off) <= 1]
    grown = [s for s in results.series if expected(full[s.id], GROWTH)]
    pushed = [s for s in results.series if expected(full[s.id], STRENGTH)]
    both = [s.title for s in agree if s in grown and s in pushed]
    strengths = [full[s.id].values[".".join(STRENGTH)] for s in results.series if s not in pushed]
    totals = np.median([_totals(results, s) for s in results.series], axis=0)
    changes = [ripple(s, row) for s in results.series if s.lug for row in s.driven]
    braked = [fits for fits in results.braking.values() if fits]
    return {
        "braked": " and ".join(f"{total(fits[0].off):.1f}" for fits in braked),
        "braked_both": " and ".join(f"{total(fits[-1].off):.1f}" for fits in braked),
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


def _totals(results: Results, s: Series) -> list[float]:
    free = np.array([n.joint_residuals for n in results.needs[s.id] if n.row.slip > -0.1])
    paper = residuals(s, s.driven, Setup(paper_law))
    return [total(x) for x in (paper, results.constants[s.id].off, results.linears[s.id].off, free)]


def main() -> None:
    """Write the page and its figures."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/validation.md"))
    options = parser.parse_args()
    start = time.monotonic()
    results = measure()
    folder = options.out.parent / "figures" / "validation"
    for ids, _ in FIGURES:
        wheels = [s for s in results.series if s.id.startswith(ids)]
        write_bytes(
            folder / f"{ids}.png", saved(plots.against(wheels, results.linears, results.full), "png", 110)
        )
    found = {s.id: (s, results.needs[s.id]) for s in results.series}
    write_bytes(folder / "k92.png", saved(plots.ratios(found), "png", 110))
    write_text(options.out.parent / "tables" / "validation-points.csv", every_row(results))
    write_text(options.out.parent / "tables" / "validation-k92.csv", needs_rows(results))
    write_text(options.out, page(results))
    print(f"{options.out}: {sum(len(s.rows) for s in results.series)} rows, {time.monotonic() - start:.0f} s")


if __name__ == "__main__":
    main()
