"""Two studies side by side: differences of slip, k_92, a_θ and effects, with 95 % intervals.

The interval of a difference follows from those of the two values, which may be lopsided [1]::

    d_l = d - sqrt((b - b_l)^2 + (a_u - a)^2),    d_u = d + sqrt((b_u - b)^2 + (a - a_l)^2),    d = b - a

References:
    [1] G. Y. Zou and A. Donner, Construction of confidence limits about effect measures: a general approach,
        Statistics in Medicine 27 (2008) 1693-1702.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from granite_lab.columns import Cell, Column, FilledTable, Table, number, words
from granite_lab.reporting.names import plain, scale_of
from granite_lab.results import load_report
from granite_lab.rounding import interval, tidy_unit
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd

SEEN = (1.959964 + 0.841621) / 1.959964
"""Smallest difference seen with a probability of 80 %, over half the width of the 95 % interval."""

DIFFERS, ALIKE, UNKNOWN = "differs", "no difference seen", "not known"


class Value(NamedTuple):
    """A number with its 95 % interval; NaN where it is not known."""

    value: float = math.nan
    low: float = math.nan
    high: float = math.nan

    def as_json(self) -> dict[str, Any]:
        """Return the number as it stands in JSON."""
        return {"value": self.value, "ci95": [self.low, self.high]}


@dataclass(frozen=True)
class Row:
    """One quantity in both studies.

    Attributes:
        quantity: as a reader calls it.
        unit: of all numbers.
        a, b: in the first and the second study.
        only: which study alone has it; empty where both do.
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
        below = math.hypot(b.value - b.low, a.high - a.value)
        return Value(d, d - below, d + math.hypot(b.high - b.value, a.value - a.low))

    @property
    def smallest(self) -> float:
        """The smallest difference that would have been seen with a probability of 80 %."""
        return SEEN * (self.difference.high - self.difference.low) / 2

    @property
    def verdict(self) -> str:
        """Whether the interval of the difference holds zero."""
        d = self.difference
        if self.only or not math.isfinite(d.low + d.high):
            return self.only or UNKNOWN
        return ALIKE if d.low <= 0 <= d.high else DIFFERS


@dataclass(frozen=True)
class Compared(Shown):
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

    def __repr__(self) -> str:
        differ = [row.quantity for row in self.rows if row.verdict == DIFFERS]
        return f"Compared({' and '.join(self.names)}: {len(differ)} of {len(self.rows)} quantities differ)"

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
    a, b = load_report(Path(first)), load_report(Path(second))
    names = (str(a["name"]), str(b["name"]))
    if names[0] == names[1]:
        names = (f"{names[0]} (A)", f"{names[1]} (B)")
    searched = a["discovery"] is not None and b["discovery"] is not None
    quantities = [dict(_quantities(d, effects=searched)) for d in (a, b)]
    rows = []
    for quantity in dict.fromkeys([*quantities[0], *quantities[1]]):
        pair = [study.get(quantity) for study in quantities]
        only = "" if all(pair) else f"only in {'A' if pair[0] else 'B'}"
        _, unit, effect, name = next(filter(None, pair))
        values, scale = [stated[0] if stated else Value() for stated in pair], 1.0
        if effect:
            largest = max((abs(v.value) for v in values if math.isfinite(v.value)), default=0.0)
            unit, scale = scale_of(effect, name, unit, largest)
        in_a, in_b = (Value(*(scale * x for x in v)) for v in values)
        rows.append(Row(quantity, unit, in_a, in_b, only))
    return Compared(names, tuple(rows), tuple(_notes(a, b, rows)), bool(a["virtual"] or b["virtual"]))


Stated = tuple[Value, str, str, str]
"""Value and unit as a report holds them; of an effect its id and the name of its number, else empty."""


def _quantities(document: Mapping[str, Any], *, effects: bool) -> Iterator[tuple[str, Stated]]:
    """Yield each quantity of a report; those of effects if asked to."""
    for key, name, unit in (("slip", "slip", "%"), ("k92", "k_92", "–")):
        for s in document["answers"]["speeds"]:
            yield f"{name} at {s['speed_mps']:g} m/s", (_value(s[key]), unit, "", "")
    if document["a_theta"] is not None:
        yield "a_θ", (_value(document["a_theta"]), "s/m", "", "")
    for effect in document["discovery"]["effects"] if effects else ():
        for name, p in effect["parameters"].items():
            unit = "–" if p["unit"] in ("", "-") else p["unit"]
            quantity = f"{plain(effect['id'])}, {name.replace('_', ' ')}"
            yield quantity, (_value(p), unit, effect["id"], name)


def _value(stated: Mapping[str, Any]) -> Value:
    """Return a number of a report with its interval, by its std where it states none."""
    if stated.get("value") is None:
        return Value()
    value, std = float(stated["value"]), stated.get("std")
    low, high = stated.get("ci95") or (None, None)
    if low is not None and high is not None:
        return Value(value, float(low), float(high))
    half = 1.959964 * float(std) if std is not None else math.nan
    return Value(value, value - half, value + half)


def _notes(a: Mapping[str, Any], b: Mapping[str, Any], rows: Sequence[Row]) -> Iterator[str]:
    judged = sum(r.verdict in (DIFFERS, ALIKE) for r in rows)
    yield (
        f"Each interval holds the true difference in 95 of 100 cases: of {judged} rows, about "
        f"{0.05 * judged:.1f} would differ by chance."
    )
    first, second = ({i["sha256"] for i in d["provenance"]["inputs"]} for d in (a, b))
    if first & second:
        files = len(first & second)
        yield f"{files} files are read by both studies; the intervals take them as independent."
    yield "Errors that both studies share, such as that of the wheel radius, cancel only partly."
    p, q = ({(p["key"], p["value"]) for p in d["provenance"]["parameters"]} for d in (a, b))
    if other := sorted({key for key, _ in p ^ q}):
        names = f"{', '.join(other[:6])}{' and more' if len(other) > 6 else ''}"
        yield f"The parameter files differ in {names}."
    for name, d in zip("AB", (a, b), strict=True):
        if d["discovery"] is None:
            yield f"{name} has no search for a missing effect: effects are not compared."
    if a["virtual"] != b["virtual"]:
        study = "A" if a["virtual"] else "B"
        yield f"The data of {study} are virtual, those of the other study are not."


def compared_table(compared: Compared) -> FilledTable:
    """Return the rows as a table."""

    def value(v: Value) -> Cell:
        return Cell(number(v.value, 4 if abs(v.value) >= 10 else 3).text, v)

    tones = {DIFFERS: "fair", ALIKE: "good"}
    a, b = compared.names
    return Table[Row](
        "differences",
        f"{b} minus {a}",
        Column("quantity", lambda r: r.quantity),
        Column("unit", lambda r: tidy_unit(r.unit)),
        Column("A", lambda r: value(r.a), "a a_low95 a_high95"),
        Column("B", lambda r: value(r.b), "b b_low95 b_high95"),
        Column(
            "B − A, 95 %", lambda r: Cell(interval(r.difference.low, r.difference.high), r.difference),
            "difference difference_low95 difference_high95",
        ),
        Column("detectable", lambda r: r.smallest, "smallest_seen", digits=2),
        Column("verdict", lambda r: words(r.verdict, tones.get(r.verdict, ""))),
        note=f"A: {a}; B: {b}. B − A: 95 % interval of the difference. Detectable: the smallest difference "
        "that is found with a probability of 80 %.",
    ).fill(compared.rows, virtual=compared.virtual)  # fmt: skip


def compared_as_json(compared: Compared) -> dict[str, Any]:
    """Return the comparison as plain objects."""
    rows = [
        {
            "quantity": r.quantity, "unit": r.unit, "a": r.a.as_json(), "b": r.b.as_json(),
            "difference": r.difference.as_json(), "smallest_seen": r.smallest, "verdict": r.verdict,
        }
        for r in compared.rows
    ]  # fmt: skip
    about = {"studies": compared.names, "virtual": compared.virtual, "rows": rows, "notes": compared.notes}
    return {"schema": "granite-lab/compare-studies/1"} | about
