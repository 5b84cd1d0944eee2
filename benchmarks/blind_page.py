"""The page of the blind benchmark: figures with their intervals, then what went wrong, by kind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.intervals import ratio
from benchmarks.judging import named, wrong_name
from benchmarks.lines import current
from benchmarks.reliability import Stated, section

Lines = Sequence[Mapping[str, Any]]
SURE = 0.9
"""Probability from which on a verdict is to hold in nine of ten sets."""

DIAGRAM = "figures/blind.png"
"""Path of the reliability diagram, from the page's folder."""

GROUPS = {
    "null": "nothing hidden",
    "2": "one effect at 2 times",
    "5": "one effect at 5 times",
    "less": "one effect at less than 1.5 times",
    "pair": "two effects at 5 times",
    "outside": "outside the library",
    "old": "one effect at 5 times, `bench` laboratory",
}


def group(line: Mapping[str, Any]) -> str:
    """Return the group of a set: a single effect counts at the strength that it really reached."""
    if line["kind"] != "single":
        return str(line["kind"])
    reached = min((line.get("reached") or {"": line["strength"]}).values())
    return "less" if reached < 1.5 else "2" if reached < 3.5 else "5"


def wrong_single(line: Mapping[str, Any]) -> bool:
    """Tell whether a name without twins beside it was given that is not hidden."""
    truth = line.get("truth") or {}
    alone = [e["id"] for e in line.get("effects") or [] if not e["indistinguishable_from"]]
    return wrong_name(line) and any(name not in truth for name in alone)


def share(lines: Lines, hit: Callable[[Mapping[str, Any]], bool]) -> tuple[str, float]:
    """Return how many of how many with the 95 % interval of the share, and the share in percent."""
    hits, total = sum(bool(hit(line)) for line in lines), len(lines)
    return ratio(hits, total, "/"), 100 * hits / total if total else float("nan")


def figures(lines: Lines) -> list[tuple[str, str, str, bool]]:
    """Return the figures: name, value, aim, and whether it is met or there is nothing to judge by."""
    of = {name: [line for line in lines if group(line) == name] for name in GROUPS}
    rows = []

    def add(
        name: str, some: Lines, hit: Callable[[Mapping[str, Any]], bool], low: float, high: float
    ) -> None:
        text, value = share(some, hit)
        aim = (
            "none"
            if high <= 0
            else f"≤ {high:g} %"
            if low <= 0
            else f"≥ {low:g} %"
            if high >= 100
            else f"{low:g}–{high:g} %"
        )
        rows.append((name, text, aim, not some or low <= value <= high))

    def right(line: Mapping[str, Any]) -> bool:
        return bool(line["right"])

    add(
        "right at 2 times the detectable size",
        of["2"],
        right,
        90,
        100,
    )
    add("right at 5 times", of["5"], right, 95, 100)
    add("wrong single name", lines, wrong_single, 0, 1)
    add("false alarm where nothing is hidden", of["null"], lambda x: x.get("verdict") != "none", 0, 1)
    add("right where the cause is outside the library", of["outside"], right, 90, 100)
    add("both of two effects at 5 times", of["pair"], right, 80, 100)
    add("right in the `bench` laboratory at 5 times", of["old"], right, 95, 100)
    sure = [line for line in lines if (line.get("probability") or 0.0) >= SURE]
    add(f"right where the stated probability is {100 * SURE:.0f} % or more", sure, right, 90, 100)
    sizes = [p for x in lines if x["right"] for p in x.get("parameters") or [] if p["z"] is not None]
    exact = [p for p in sizes if p["kind"] == "exact"]
    add("true size inside the stated 95 % interval", exact, lambda p: abs(p["z"]) < 1.96, 90, 98)
    add("crashed, refused or out of time", lines, lambda x: x["status"] != "judged", 0, 0)
    return rows


def every_stated(lines: Lines) -> Stated:
    """Return all effects that were named or described, with their stated probabilities."""
    return [one for line in lines for one in line.get("stated") or []]


def page(lines: Lines, planned: int) -> str:
    """Return the page in Markdown.

    Args:
        lines: of the results file; those of the code that made the last one count.
        planned: number of sets in the schedule.
    """
    head = ["# Blind benchmark of `discover`", ""]
    lines = current(lines)
    unseen = [line for line in lines if line["status"] == "not made"]
    kept = [line for line in lines if line["status"] != "not made"]
    if not kept:
        return "\n".join([*head, "No set has been judged yet.", ""])
    codes = dict.fromkeys(f"{line['code']} ({line['commit']})" for line in kept)
    seconds = [line["seconds"] for line in kept if "seconds" in line]
    closed = [
        x["closed"] for x in kept if x["right"] and x.get("closed") is not None and x["verdict"] == "named"
    ]
    words = [
        "Bold: aim missed.",
        f"{len(kept)} of {planned} sets are judged, code {', '.join(codes)};",
        f"{len(unseen)} more could not be made (no detectable size there, or the robot cannot drive).",
    ]
    if seconds:
        words.append(f"A search takes {np.median(seconds):.0f} s (median).")
    if closed:
        words.append(
            f"Correctly named effects close {100 * np.median(closed):.0f} % of the held-out gap (median)."
        )
    rows = [
        f"| {name} | {text if met else f'**{text}**'} | {aim} |"
        for name, text, aim, met in figures(kept)
        if text != "–"
    ]
    return "\n".join([
        *head,
        "| sets | share (95 % interval after Wilson) | aim |",
        "|---|---|---|",
        *rows,
        "",
        *words,
        "",
        *_conditions(kept),
        "Each seed is a laboratory (`granite-lab hide --lab wild`). Its set without an effect",
        "gives the detectable sizes. The others hide effects of about 2 or 5 times that size, by other",
        "formulas than the library's. `make blind` continues the frozen list",
        "([judgement](hidden.md#judgement)).",
        "",
        section(every_stated(kept), DIAGRAM),
        *_wrong(kept),
        *_sizes(kept),
    ]).rstrip() + "\n"  # fmt: skip


def _wrong(lines: Lines) -> list[str]:
    """Return the table of what went wrong, alike cases in one row."""
    cases: dict[tuple[str, str], Counter[str]] = {}
    for line in lines:
        if not line["right"]:
            said = named(line) or line.get("verdict", "")
            truth = line["effect"] if line["kind"] != "null" else ""
            case = f"{truth} → {said}" if truth and wrong_name(line) else truth or said
            cases.setdefault((group(line), line["outcome"]), Counter())[case] += 1
    if not cases:
        return []
    order = list(GROUPS)
    rows = [
        "## What went wrong",
        "",
        "| hidden | outcome | sets | which |",
        "|---|---|---|---|",
    ]
    for (name, outcome), c in sorted(cases.items(), key=lambda x: (order.index(x[0][0]), -x[1].total())):
        which = ", ".join(f"{case} ({n})" if n > 1 else case for case, n in c.most_common())
        rows.append(f"| {GROUPS[name]} | {outcome.replace('_', ' ')} | {c.total()} | {which} |")
    return [*rows, ""]


def _conditions(lines: Lines) -> list[str]:
    """Return how often the sets of a sort of laboratory are right."""
    wild = [line for line in lines if line.get("lab_drawn")]
    drawn = [line["lab_drawn"] for line in wild]
    sorts = {f"{n} repetitions": [x["repetitions"] == n for x in drawn] for n in (2, 3, 4)}
    for name in ("other robot", "other sand", "IMU more than 4 ms late", "gears that lock"):
        sorts[name] = [x[name] for x in drawn]
    said = [
        f"{name} {100 * np.mean(right):.0f} % of {len(right)}"
        for name, so in sorts.items()
        if (right := [line["right"] for line, yes in zip(wild, so, strict=True) if yes])
    ]
    return [f"Right by laboratory: {'; '.join(said)}.", ""] if said else []


def _sizes(lines: Lines) -> list[str]:
    """Return the list of fitted over hidden sizes that mean the same, of effects named rightly."""
    found: dict[str, list[tuple[float, float]]] = {}
    for line in lines:
        for p in (line.get("parameters") or []) if line["right"] else []:
            if p["kind"] == "exact" and p["true"] and p["z"] is not None:
                name = f"{p['effect']}.{p['name']}"
                found.setdefault(name, []).append((p["value"] / p["true"], p["z"]))
    if not found:
        return []
    sizes = [
        f"* `{name}`: {np.median([r for r, _ in pairs]):.2f}, "
        f"{sum(abs(z) < 1.96 for _, z in pairs)} of {len(pairs)}"
        for name, pairs in sorted(found.items())
    ]
    return [
        "## Sizes",
        "",
        "Median of found over hidden size, and sets with the hidden size inside the 95 % interval:",
        "",
        *sizes,
    ]
