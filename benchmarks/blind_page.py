"""The page of the blind benchmark: figures with their intervals, then what went wrong, by kind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.intervals import wilson
from benchmarks.judging import named, wrong_name

Lines = Sequence[Mapping[str, Any]]
SURE = 0.9
"""Probability from which on a verdict is to hold in nine of ten sets."""

GROUPS = {
    "null": "nothing hidden",
    "2": "one effect at 2 times",
    "5": "one effect at 5 times",
    "less": "one effect at less than 1.5 times",
    "pair": "two effects at 5 times",
    "outside": "outside the library",
    "old": "one effect at 5 times, old laboratory",
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
    if not total:
        return "–", float("nan")
    low, high = wilson(hits / total, total)
    value = 100 * hits / total
    return f"{hits}/{total} = {value:.0f} % ({100 * low:.0f}–{100 * high:.0f})", value


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
        "right name or exact set of twins at twice the smallest size that can be seen",
        of["2"],
        right,
        90,
        100,
    )
    add("the same at five times", of["5"], right, 95, 100)
    add("a wrong single name, over all sets", lines, wrong_single, 0, 1)
    add("false alarms where nothing is hidden", of["null"], lambda x: x.get("verdict") != "none", 0, 1)
    add("`unknown`, or named with what is left, outside the library", of["outside"], right, 90, 100)
    add("both of a pair at five times", of["pair"], right, 80, 100)
    add("right in the old laboratory at five times", of["old"], right, 95, 100)
    sure = [line for line in lines if (line.get("probability") or 0.0) >= SURE]
    add(f"right where the stated probability is {100 * SURE:.0f} % or more", sure, right, 90, 100)
    sizes = [p for x in lines if x["right"] for p in x.get("parameters") or [] if p["z"] is not None]
    exact = [p for p in sizes if p["kind"] == "exact"]
    add("true size inside the stated 95 % interval", exact, lambda p: abs(p["z"]) < 1.96, 90, 98)
    add("crashed, refused or out of time", lines, lambda x: x["status"] != "judged", 0, 0)
    return rows


def page(lines: Lines, planned: int) -> str:
    """Return the page in Markdown.

    Args:
        lines: of the results file; those of the code that made the last one count.
        planned: number of sets in the schedule.
    """
    head = [
        "# Blind benchmark of `discover`",
        "",
        "A frozen range of seeds, each a laboratory of its own (`granite-lab hide --lab wild`: logger, robot",
        "and sand are drawn), judged once by one code. The first set of a seed hides nothing and states the",
        "smallest sizes that can be seen there; other sets of the seed hide effects of so many times that",
        "size, by other formulas than the library's. `make blind` goes on where it was interrupted.",
        "",
    ]
    lines = [line for line in lines if line["code"] == lines[-1]["code"]]
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
        f"{len(lines)} of {planned} sets, code {', '.join(codes)}. {len(unseen)} could not be made:",
        "no size of the effect can be seen there, or the robot cannot drive.",
    ]
    if seconds:
        words.append(f"A search takes {np.median(seconds):.0f} s (median).")
    if closed:
        words.append(
            f"Named rightly, effects close {100 * np.median(closed):.0f} % of the held-out gap (median)."
        )
    return "\n".join([
        *head,
        *words,
        "Intervals are 95 % Wilson intervals. Bold: aim missed.",
        "",
        "| figure (95 % interval) | measured | aim |",
        "|---|---|---|",
        *(f"| {name} | {text if met else f'**{text}**'} | {aim} |" for name, text, aim, met in figures(kept)),
        "",
        *_wrong(kept),
        *_conditions(kept),
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
        "What the words mean stands in `docs/hidden.md`.",
        "",
        "| hidden | outcome | sets | which |",
        "|---|---|---|---|",
    ]
    for (name, outcome), c in sorted(cases.items(), key=lambda x: (order.index(x[0][0]), -x[1].total())):
        which = ", ".join(f"{case} ({n})" if n > 1 else case for case, n in c.most_common())
        rows.append(f"| {GROUPS[name]} | {outcome.replace('_', ' ')} | {c.total()} | {which} |")
    return [*rows, ""]


def _conditions(lines: Lines) -> list[str]:
    """Return the table of how often the sets of a sort of laboratory are right."""
    wild = [line for line in lines if line.get("lab_drawn")]
    rows = ["## By laboratory", "", "| laboratory | right where so | elsewhere |", "|---|---|---|"]

    def add(name: str, so: Callable[[Mapping[str, Any]], bool]) -> None:
        parts = [line for line in wild if so(line)], [line for line in wild if not so(line)]
        rows.append(f"| {name} | {' | '.join(share(part, lambda x: x['right'])[0] for part in parts)} |")

    for count in sorted({line["lab_drawn"]["repetitions"] for line in wild}):
        add(f"{count} repetitions", lambda x, count=count: x["lab_drawn"]["repetitions"] == count)  # type: ignore[misc]
    for name in ("other robot", "other sand", "IMU more than 4 ms late", "gears that lock"):
        add(name, lambda x, name=name: x["lab_drawn"][name])  # type: ignore[misc]
    return [*rows, ""] if wild else []


def _sizes(lines: Lines) -> list[str]:
    """Return the table of fitted over hidden sizes, of effects named rightly."""
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for line in lines:
        for p in (line.get("parameters") or []) if line["right"] else []:
            if p["kind"] in ("exact", "equivalent") and p["true"] and p["z"] is not None:
                name = f"{p['effect']}: {p['name']}"
                found.setdefault((p["kind"], name), []).append((p["value"] / p["true"], p["z"]))
    rows = [
        "## Sizes",
        "",
        "An *exact* size means the same in the hidden formula and in the library's; an *equivalent* one only",
        "shows how alike the two are.",
        "",
        "| size | sets | median of found / hidden | inside 95 % |",
        "|---|---|---|---|",
    ]
    for (kind, name), pairs in sorted(found.items(), key=lambda x: (x[0][0] != "exact", x[0][1])):
        ratio, inside = np.median([r for r, _ in pairs]), sum(abs(z) < 1.96 for _, z in pairs)
        rows.append(
            f"| {name}{'' if kind == 'exact' else ' (equivalent)'} | {len(pairs)} | {ratio:.2f} | {inside} |"
        )
    return [*rows, ""] if found else []
