"""The figures of the blind benchmark: shares with their intervals, and the aims."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

Line = Mapping[str, Any]


@dataclass(frozen=True)
class Share:
    """How many of how many, with the 95 % Wilson interval, in percent."""

    hits: int
    total: int

    @property
    def text(self) -> str:
        """As the tables show it."""
        if not self.total:
            return "–"
        interval = binomtest(self.hits, self.total).proportion_ci(0.95, method="wilson")
        return (
            f"{self.hits}/{self.total} = {100 * self.hits / self.total:.0f} % "
            f"({100 * interval.low:.0f}–{100 * interval.high:.0f})"
        )

    @property
    def value(self) -> float:
        """The share itself; NaN of nothing."""
        return self.hits / self.total if self.total else float("nan")


def share(lines: Iterable[Line], hit: Callable[[Line], bool]) -> Share:
    """Count the lines that hit."""
    found = [bool(hit(line)) for line in lines]
    return Share(sum(found), len(found))


def is_right(line: Line) -> bool:
    """Tell whether the name or an exact set of twins was right; a crash or a refusal is not."""
    return bool(line.get("right"))


def is_wrong_name(line: Line) -> bool:
    """Tell whether a name was given that is not hidden."""
    return line.get("outcome") in ("wrong_name", "spurious") and line.get("verdict") == "named"


def is_wrong_single(line: Line) -> bool:
    """Tell whether one name alone, without twins beside it, was given and is not hidden."""
    found = line.get("found") or []
    return is_wrong_name(line) and any(not f["twins"] and f["id"] not in line["truth"] for f in found)


def saw_nothing(line: Line) -> bool:
    """Tell whether the verdict was "none"."""
    return line.get("verdict") == "none"


def newest(lines: Sequence[Line]) -> list[Line]:
    """Return the lines of the code that made the last one."""
    return [line for line in lines if line.get("code") == lines[-1].get("code")] if lines else []


def strength_of(line: Line) -> str:
    """Return the group of strengths that a set really reached, "drawn" where `hide` chose the size."""
    if line["strength"] is None:
        return "drawn"
    reached = min((line.get("reached") or {"": line["strength"]}).values())
    for bound, name in ((1.4, "0.5"), (3.5, "2"), (10.0, "5")):
        if reached < bound:
            return name
    return "20"


def median_closed(lines: Iterable[Line]) -> tuple[float, int]:
    """Return the median share of the held-out gap that closed, and of how many sets."""
    values = [v for line in lines if (v := (line.get("closed") or {}).get("held_out")) is not None]
    return (float(np.median(values)) if values else float("nan")), len(values)


def z_scores(lines: Iterable[Line], kinds: Sequence[str]) -> list[float]:
    """Return (found - hidden) / std of the parameters of these kinds, of effects named rightly."""
    return [
        p["z"]
        for line in lines
        for p in line.get("parameters") or []
        if p["kind"] in kinds and p["z"] is not None and is_right(line)
    ]


def headline(lines: Sequence[Line]) -> list[tuple[str, str, str, bool | None]]:
    """Return the figures that have an aim: name, value, aim, and whether it is met."""
    of = {kind: [line for line in lines if line["kind"] == kind] for kind in (
        "null", "single", "drawn", "outside", "pair", "loud")}  # fmt: skip
    library = [line for kind in ("single", "drawn", "pair", "loud") for line in of[kind]]
    rows: list[tuple[str, str, str, bool | None]] = []

    def add(name: str, figure: Share, aim: str, met: bool) -> None:
        rows.append((name, figure.text, aim, met if figure.total else None))

    for strength, least in (("2", 0.90), ("5", 0.97), ("20", 0.97)):
        found = share([line for line in of["single"] if strength_of(line) == strength], is_right)
        add(f"right name or exact set of twins at {strength} times the smallest detectable size",
            found, f"≥ {100 * least:.0f} %", found.value >= least)  # fmt: skip
    found = share(of["drawn"], is_right)
    add("the same at the size that `hide` draws", found, "≥ 97 %", found.value >= 0.97)
    half = share([line for line in of["single"] if strength_of(line) == "0.5"], saw_nothing)
    add("nothing found at half the smallest detectable size", half, "mostly", half.value > 0.5)
    wrong = share(lines, is_wrong_single)
    add("a wrong single name, over all sets", wrong, "≤ 1 %", wrong.value <= 0.01)
    wrong = share(library, is_wrong_name)
    add("any wrong name, over the sets with an effect of the library", wrong, "", True)
    alarm = share(of["null"], lambda line: not saw_nothing(line))
    add("false alarms where nothing is hidden", alarm, "≤ 1 %", alarm.value <= 0.01)
    found = share(of["outside"], is_right)
    add("`unknown` where the effect is outside the library", found, "≥ 90 %", found.value >= 0.9)
    found = share(of["pair"], is_right)
    add("both of a pair named", found, "≥ 85 %", found.value >= 0.85)
    found = share(of["loud"], is_right)
    add("right at 3 times the noise (2, 5 and 20 times the size detectable there)", found, "", True)
    closed, n = median_closed(line for line in library if is_right(line) and strength_of(line) != "0.5")
    median = f"{100 * closed:.1f} % of {n} sets" if n else "–"
    name = "median share of the held-out gap closed, of what was named rightly"
    rows.append((name, median, "≥ 90 %", closed >= 0.9 if n else None))
    z = np.abs(z_scores(library, ("exact",)))
    inside = Share(int((z < 1.96).sum()), z.size)
    add("true value inside the stated 95 % interval", inside, "90–98 %", 0.9 <= inside.value <= 0.98)
    return rows
