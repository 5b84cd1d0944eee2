"""The page of the blind benchmark."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.blind_figures import (
    Line,
    headline,
    is_right,
    median_closed,
    newest,
    saw_nothing,
    share,
    strength_of,
)
from benchmarks.blind_misses import missed
from benchmarks.blind_schedule import REFERENCES


def report(lines: Sequence[Line], *, every: bool = False, again: Sequence[Line] = ()) -> str:
    """Return the page in Markdown.

    Args:
        lines: of the results file, in its order.
        every: results of older code, too; the newest has a column of its own.
        again: sets that older code missed, as newer code judged them.
    """
    made = [line for line in lines if line["status"] != "not made"]
    kept = made if every else newest(made)
    older = len(made) - len(kept)
    words = [
        "# Blind benchmark of `discover`",
        "",
        "`make blind`, that is `python -m benchmarks.blind --minutes 60 --jobs 2 --out docs/blind.md`, makes",
        "sets of twelve virtual trials as `granite-lab hide` does, by a simulator that shares no code with",
        "the model, runs `granite-lab discover` on each, opens the sealed answer and judges. Each run goes",
        "on where the last one ended, and writes this page from `benchmarks/results/blind.jsonl`.",
        "",
    ]
    if not kept:
        return "\n".join([*words, "No set has been judged yet.", ""])
    cpu = [sum((line.get("cpu") or {}).values()) for line in kept]
    codes = ", ".join(sorted({f"{line.get('code')}" for line in kept}))
    words += [
        f"{_sets(len(kept))}, code {codes}, last commit {kept[-1].get('commit')}"
        + (f"; {_sets(older)} of older code left out (`--all` shows them)" if older else "")
        + f". A set takes {np.median(cpu):.0f} s of one core (median).",
        "Strengths are multiples of the smallest size that the tool itself says it can detect in twelve such",
        f"trials, the median of {REFERENCES} sets without an effect (`benchmarks/results/detectable.json`;",
        "the first 1,009 sets refer to one such set). Intervals are 95 % Wilson intervals.",
        "Bold: aim missed.",
        "",
        *_headline(kept, newest(kept)),
        "",
    ]
    for section in (_nulls, _outcomes, _effects, _gaps, _outside, _parameters):
        rows = section(kept)
        # a table that ends with its rule has no rows
        words += [] if rows[-2].startswith("|---") else rows
    today = {x["key"]: x for x in again if x.get("code") == kept[-1].get("code")}
    return "\n".join([*words, *missed(kept, today), ""])


def _headline(lines: Sequence[Line], last: Sequence[Line]) -> list[str]:
    """Return the table of the figures that have an aim; beside them those of the newest code alone."""
    alone = len(last) < len(lines)
    title = f" {_sets(len(last))} of the newest code | all {len(lines)} |" if alone else " measured |"
    rows = [f"| figure (95 % interval) |{title} aim |", "|---|---|---|" + "---|" * alone]
    for (name, value, aim, met), (_, own, _, well) in zip(headline(lines), headline(last), strict=True):
        whole, newer = (f"**{x}**" if good is False else x for x, good in ((value, met), (own, well)))
        rows.append(f"| {name} |{f' {newer} |' if alone else ''} {whole} | {aim} |")
    return rows


def _sets(count: int) -> str:
    return f"{count} set" if count == 1 else f"{count} sets"


def _nulls(lines: Sequence[Line]) -> list[str]:
    rows = ["## Sets without an effect", "", "| sand | noise | false alarms |", "|---|---|---|"]
    null = [line for line in lines if line["kind"] == "null"]
    for noise, off in sorted({(line["noise"], line["sand_off"]) for line in null}):
        own = [line for line in null if (line["noise"], line["sand_off"]) == (noise, off)]
        alarms = share(own, lambda line: not saw_nothing(line)).text
        rows.append(f"| {'φ, K, n, μ_s 5–20 % off' if off else 'as filed'} | × {noise:g} | {alarms} |")
    return [*rows, ""]


def _outcomes(lines: Sequence[Line]) -> list[str]:
    """Return a table of what became of the sets of each kind."""
    names = ["right", "twin_set", "vague", "partial", "spurious", "wrong_name", "missed", "abstained",
             "false_alarm", "refused", "crashed"]  # fmt: skip
    counts: dict[tuple[str, str], Counter[str]] = {}
    for line in lines:
        group = strength_of(line) if line["kind"] in ("single", "loud") else ""
        outcome = str(line["outcome"] if line["status"] == "judged" else line["status"])
        counts.setdefault((line["kind"], group), Counter())[outcome] += 1
    used = [name for name in names if any(c[name] for c in counts.values())]
    rows = [
        "## What became of each set",
        "",
        "What the words mean stands in `docs/hidden.md`. Outside the library, abstained is right.",
        "",
        f"| hidden | times detectable | sets | {' | '.join(n.replace('_', ' ') for n in used)} |",
        "|---" * (3 + len(used)) + "|",
    ]
    order = ["null", "single", "loud", "drawn", "pair", "outside"]
    for (kind, group), c in sorted(counts.items(), key=lambda x: (order.index(x[0][0]), float(x[0][1] or 0))):
        cells = " | ".join(str(c[name] or "") for name in used)
        rows.append(f"| {kind} | {group} | {sum(c.values())} | {cells} |")
    return [*rows, ""]


def _effects(lines: Sequence[Line]) -> list[str]:
    groups = ("0.5", "2", "5", "20", "drawn")
    rows = [
        "## Effect by effect",
        "",
        "Right of all sets at each strength; at 0.5, sets in which nothing was found. At the ordinary noise.",
        "",
        f"| effect | {' | '.join(f'× {g}' if g != 'drawn' else 'as drawn' for g in groups)} |",
        "|---" * (1 + len(groups)) + "|",
    ]
    single = [line for line in lines if line["kind"] in ("single", "drawn")]
    for effect in sorted({line["effect"] for line in single}):
        cells = []
        for group in groups:
            own = [line for line in single if line["effect"] == effect and strength_of(line) == group]
            good = share(own, saw_nothing if group == "0.5" else is_right)
            cells.append(f"{good.hits}/{good.total}" if good.total else "")
        rows.append(f"| {effect} | {' | '.join(cells)} |")
    return [*rows, ""]


def _gaps(lines: Sequence[Line]) -> list[str]:
    """Return a table of the gap by strength: a weak effect leaves little gap to be closed."""
    rows = [
        "## Gap on held-out trials",
        "",
        "Root mean square of the residual over its standard deviation, median of the sets that were judged",
        "right; the floor is the scatter between repetitions.",
        "",
        "| times detectable | sets | before | after | floor | closed |",
        "|---|---|---|---|---|---|",
    ]
    good = [line for line in lines if is_right(line) and line["kind"] in ("single", "drawn", "loud", "pair")]
    for group in ("2", "5", "20", "drawn"):
        own = [line for line in good if strength_of(line) == group and None not in line["gap"]["held_out"]]
        if own:
            before, after, floor = np.median([line["gap"]["held_out"] for line in own], axis=0)
            closed = 100 * median_closed(own)[0]
            rows.append(
                f"| {group} | {len(own)} | {before:.3f} | {after:.3f} | {floor:.3f} | {closed:.1f} % |"
            )
    return [*rows, ""]


def _outside(lines: Sequence[Line]) -> list[str]:
    outside = [line for line in lines if line["kind"] == "outside"]
    rows = [
        "## Outside the library",
        "",
        "| effect | `unknown` | otherwise |",
        "|---|---|---|",
    ]
    for effect in sorted({line["effect"] for line in outside}):
        own = [line for line in outside if line["effect"] == effect]
        other = Counter(
            " + ".join(f["id"] for f in line.get("found") or []) or line.get("verdict") or line["status"]
            for line in own
            if not is_right(line)
        )
        good = share(own, is_right)
        rows.append(
            f"| {effect} | {good.hits}/{good.total} | {', '.join(f'{n}: {k}' for n, k in other.items())} |"
        )
    return [*rows, ""]


def _parameters(lines: Sequence[Line]) -> list[str]:
    """Return a table of the errors of fitted numbers, by what the hidden number means in the library."""
    rows = [
        "## Fitted numbers",
        "",
        "z is the error over the stated standard deviation. An *exact* number means the same in the hidden",
        "set and in the library; an *equivalent* one belongs to another formula: it only shows how alike",
        "the two are.",
        "",
        "| number | meaning | sets | inside 95 % | mean z | rms z | median of found / hidden |",
        "|---|---|---|---|---|---|---|",
    ]
    found: dict[tuple[str, str, str], list[Mapping[str, Any]]] = {}
    for line in lines:
        for p in line.get("parameters") or []:
            if is_right(line) and p["z"] is not None and p["kind"] != "shape":
                found.setdefault((p["kind"], p["effect"], p["name"]), []).append(p)
    for (kind, effect, name), own in sorted(found.items(), key=lambda x: (x[0][0] != "exact", x[0])):
        z = np.array([p["z"] for p in own])
        ratio = [p["value"] / p["true"] for p in own if p["true"]]
        rows.append(
            f"| {effect}: {name} | {kind} | {z.size} | {int((np.abs(z) < 1.96).sum())} | {z.mean():+.1f} "
            f"| {np.sqrt((z**2).mean()):.1f} | {f'{np.median(ratio):.2f}' if ratio else '–'} |"
        )
    return [*rows, ""]
