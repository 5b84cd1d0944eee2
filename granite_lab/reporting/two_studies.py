"""Two studies side by side: differences of slip, k_92, a_θ and effects, with 95 % intervals.

The interval of a difference follows from those of the two values, which may be lopsided [1]::

    d_l = d - sqrt((b - b_l)^2 + (a_u - a)^2),    d_u = d + sqrt((b_u - b)^2 + (a - a_l)^2),    d = b - a

References:
    [1] G. Y. Zou and A. Donner, Construction of confidence limits about effect measures: a general approach,
        Statistics in Medicine 27 (2008) 1693-1702.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure as Canvas

from granite_lab.errors import InputError
from granite_lab.files import readable
from granite_lab.reporting import canvas
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.json_report import SCHEMA
from granite_lab.reporting.names import plain
from granite_lab.reporting.rounding import NONE, interval, significant, tidy_unit
from granite_lab.reporting.table import Cell, Table, tabulate, words

if TYPE_CHECKING:
    import pandas as pd

SEEN = (1.959964 + 0.841621) / 1.959964
"""Smallest difference seen with a probability of 80 %, over half the width of the 95 % interval."""

DIFFERS, ALIKE, UNKNOWN = "differs", "no difference seen", "not known"


@dataclass(frozen=True)
class Value:
    """A number of one study with its 95 % interval; NaN where it is not known."""

    value: float = math.nan
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True)
class Row:
    """One quantity in both studies.

    Attributes:
        quantity: as a reader calls it.
        unit: of all numbers.
        a, b: in the first and the second study.
        only: why the two cannot be compared; empty where they can.
    """

    quantity: str
    unit: str
    a: Value
    b: Value
    only: str = ""

    @property
    def difference(self) -> Value:
        """Second minus first."""
        a, b = self.a, self.b
        d = b.value - a.value
        low, high = (
            math.hypot(b.value - b.low, a.high - a.value),
            math.hypot(b.high - b.value, a.value - a.low),
        )
        return Value(d, d - low, d + high)

    @property
    def smallest(self) -> float:
        """The smallest difference that would have been seen with a probability of 80 %."""
        return SEEN * (self.difference.high - self.difference.low) / 2

    @property
    def verdict(self) -> str:
        """Whether the interval of the difference holds zero."""
        d = self.difference
        if self.only:
            return self.only
        if not math.isfinite(d.low + d.high):
            return UNKNOWN
        return ALIKE if d.low <= 0 <= d.high else DIFFERS


@dataclass(frozen=True)
class Compared:
    """Two studies side by side.

    Attributes:
        names: of the two.
        rows: slip, k_92, a_θ, and the sizes of effects.
        notes: what a reader should know, one sentence each.
        virtual: the data of either were written by a simulator.
    """

    names: tuple[str, str]
    rows: tuple[Row, ...]
    notes: tuple[str, ...]
    virtual: bool

    def to_frame(self) -> pd.DataFrame:
        """Return one row a quantity, as in the CSV."""
        import pandas as pd  # noqa: PLC0415

        return pd.read_csv(io.StringIO(compared_table(self).to_csv()))


def compare_studies(first: Path | str, second: Path | str) -> Compared:
    """Compare two studies by the numbers of their reports.

    Args:
        first, second: folders that ``granite-lab study`` wrote, or their ``report.json``.

    Raises:
        InputError: one of them is no report of a study.
    """
    a, b = _load(Path(first)), _load(Path(second))
    names = (str(a["name"]), str(b["name"]))
    if names[0] == names[1]:
        names = (f"{names[0]} (A)", f"{names[1]} (B)")
    rows = (*_speeds(a, b, "slip", "slip"), *_speeds(a, b, "k92", "k_92"), *_law(a, b), *_effects(a, b))
    virtual = bool(a["virtual"] or b["virtual"])
    return Compared(names, rows, tuple(_notes(a, b, rows)), virtual)


def _load(given: Path) -> Mapping[str, Any]:
    path = given / "report.json" if given.is_dir() else given
    try:
        document = json.loads(path.read_bytes())
    except OSError as error:
        raise readable(error, path) from None
    except ValueError:
        raise InputError(f"{path}: is not JSON", "give the folder of a study") from None
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputError(
            f"{path}: is not the report of a study of this version",
            "give a folder that 'granite-lab study' wrote, or run the study again",
        )
    return document


def _value(number: Mapping[str, Any] | None) -> Value:
    """Return a number of a report with its interval, by its std where it states none."""
    if number is None or number.get("value") is None:
        return Value()
    value, std = float(number["value"]), number.get("std")
    low, high = number.get("ci95") or (None, None)
    if low is not None and high is not None:
        return Value(value, float(low), float(high))
    half = 1.959964 * float(std) if std is not None else math.nan
    return Value(value, value - half, value + half)


def _speeds(a: Mapping[str, Any], b: Mapping[str, Any], key: str, name: str) -> Iterator[Row]:
    own = [{s["speed_mps"]: s[key] for s in d["answers"]["speeds"]} for d in (a, b)]
    for speed in sorted(own[0].keys() | own[1].keys()):
        only = "" if speed in own[0] and speed in own[1] else f"only in {'A' if speed in own[0] else 'B'}"
        unit = "%" if key == "slip" else "–"
        first, second = (_value(o.get(speed)) for o in own)
        yield Row(f"{name} at {speed:g} m/s", unit, first, second, only)


def _law(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[Row]:
    if a["a_theta"] is not None or b["a_theta"] is not None:
        yield Row("a_θ", "s/m", _value(a["a_theta"]), _value(b["a_theta"]))


def _effects(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[Row]:
    """Yield the sizes of the effects that either study names."""
    if a["discovery"] is None or b["discovery"] is None:
        return
    own = [{e["id"]: e["parameters"] for e in d["discovery"]["effects"]} for d in (a, b)]
    for effect in dict.fromkeys([*own[0], *own[1]]):
        only = (
            ""
            if effect in own[0] and effect in own[1]
            else f"named in {'A' if effect in own[0] else 'B'} only"
        )
        parameters = dict.fromkeys([*own[0].get(effect, ()), *own[1].get(effect, ())])
        for name in parameters:
            found = [o.get(effect, {}).get(name) for o in own]
            unit = next(p["unit"] for p in found if p is not None)
            title = f"{plain(effect)}, {name.replace('_', ' ')}"
            first, second = map(_value, found)
            yield Row(title, "–" if unit in ("", "-") else unit, first, second, only)
        if not parameters:
            yield Row(plain(effect), "–", Value(), Value(), only or "named in both")


def _notes(a: Mapping[str, Any], b: Mapping[str, Any], rows: tuple[Row, ...]) -> Iterator[str]:
    judged = [r for r in rows if r.verdict in (DIFFERS, ALIKE)]
    yield (
        f"Each interval holds the true difference in 95 of 100 cases: of {len(judged)} rows, about "
        f"{0.05 * len(judged):.1f} would differ by chance."
    )
    first, second = ({i["sha256"] for i in d["provenance"]["inputs"]} for d in (a, b))
    if first & second:
        yield f"{len(first & second)} files are read by both studies; the intervals take them as independent."
    yield "Errors that both studies share, as of the wheel radius, cancel in a difference only in part."
    parameters = [{p["key"]: p["value"] for p in d["provenance"]["parameters"]} for d in (a, b)]
    other = [
        k for k in parameters[0].keys() | parameters[1].keys() if parameters[0].get(k) != parameters[1].get(k)
    ]
    if other:
        more = " and more" if len(other) > 6 else ""
        yield f"The parameter files differ in {', '.join(sorted(other)[:6])}{more}."
    for name, d in zip("AB", (a, b), strict=True):
        if d["discovery"] is None:
            yield f"{name} has no search for a missing effect: effects are not compared."
    if a["virtual"] != b["virtual"]:
        yield f"The data of {'A' if a['virtual'] else 'B'} are virtual, those of the other study are not."


def compared_table(found: Compared) -> Table:
    """Return the rows as a table."""

    def value(v: Value) -> Cell:
        digits = 4 if abs(v.value) >= 10 else 3
        return Cell(
            significant(v.value, digits) if math.isfinite(v.value) else NONE, (v.value, v.low, v.high)
        )

    def difference(r: Row) -> Cell:
        d = r.difference
        text = interval(d.low, d.high) if math.isfinite(d.low + d.high) else NONE
        return Cell(text, (d.value, d.low, d.high))

    def smallest(r: Row) -> Cell:
        return Cell(significant(r.smallest, 2) if math.isfinite(r.smallest) else NONE, (r.smallest,))

    tones = {DIFFERS: "fair", ALIKE: "good"}
    return tabulate(
        "differences", f"{found.names[1]} minus {found.names[0]}",
        f"A: {found.names[0]}; B: {found.names[1]}. B − A: 95 % interval of the difference. Seen from: the "
        "smallest difference that would have been seen with a probability of 80 %.",
        found.rows,
        [
            ("quantity", "", lambda r: r.quantity),
            ("unit", "", lambda r: tidy_unit(r.unit)),
            ("A", "a a_low95 a_high95", lambda r: value(r.a)),
            ("B", "b b_low95 b_high95", lambda r: value(r.b)),
            ("B − A, 95 %", "difference difference_low95 difference_high95", difference),
            ("seen from", "smallest_seen", smallest),
            ("verdict", "", lambda r: words(r.verdict, tones.get(r.verdict, ""))),
        ],
        virtual=found.virtual,
    )  # fmt: skip


def compared_figure(found: Compared) -> Figure | None:
    """Draw the differences over half of their intervals; None without any."""
    rows = [r for r in found.rows if r.verdict in (DIFFERS, ALIKE)]
    if not rows:
        return None
    differ = [r.quantity for r in rows if r.verdict == DIFFERS]
    title = f"{len(differ)} of {len(rows)} quantities differ" if differ else "No difference is seen"
    return Figure(
        "differences", title,
        f"{found.names[1]} minus {found.names[0]}, over half the width of its 95 % interval. Bars that miss "
        "the line at 0 differ.",
        "Differences between two studies with their 95 % intervals, one row a quantity.",
        partial(_draw, rows, found.virtual), found.virtual,
    )  # fmt: skip


def _draw(rows: list[Row], virtual: bool) -> Canvas:
    figure, (axis,) = canvas.named_rows([r.quantity for r in rows], left=2.1)
    with canvas.styled():
        for k, row in enumerate(rows):
            d = row.difference
            half = (d.high - d.low) / 2 or 1.0
            color = canvas.SIMULATED if row.verdict == DIFFERS else canvas.MEASURED
            bars = [[(d.value - d.low) / half], [(d.high - d.value) / half]]
            axis.errorbar(d.value / half, k, xerr=bars, color=color, marker="o", markersize=3.5, capsize=2)
        axis.axvline(0, color=canvas.INK, linewidth=0.8)
        axis.set_xlabel("(B − A) over half its 95 % interval [–]")
        canvas.mark_virtual(figure, virtual)
    return figure


def compared_as_json(found: Compared) -> dict[str, Any]:
    """Return the comparison as plain objects."""

    def value(v: Value) -> dict[str, Any]:
        return {"value": v.value, "ci95": [v.low, v.high]}

    return {
        "schema": "granite-lab/compare-studies/1",
        "studies": list(found.names),
        "virtual": found.virtual,
        "rows": [
            {
                "quantity": r.quantity, "unit": r.unit, "a": value(r.a), "b": value(r.b),
                "difference": value(r.difference), "smallest_seen": r.smallest, "verdict": r.verdict,
            }
            for r in found.rows
        ],
        "notes": list(found.notes),
    }  # fmt: skip
