"""The list of sets that were not judged right, with what stood against the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Line = Mapping[str, Any]


def misses(lines: Sequence[Line]) -> list[Line]:
    """Return the sets that were not judged right; half the smallest detectable size may pass unseen."""
    return [line for line in lines if not line.get("right") and not _half(line)]


def missed(lines: Sequence[Line], today: Mapping[str, Line] | None = None) -> list[str]:
    """Return the section of misses: what was hidden, what was said, and the evidence.

    Args:
        lines: of the results file.
        today: by their keys, what the newest code says of the same sets.
    """
    today = today or {}
    title = " the newest code says |" if today else ""
    rows = [
        "## What was not right, and why",
        "",
        "Evidence of the first candidates is the drop of χ² as of one number, in the first round of the",
        "search; a candidate marked *screen* was not fitted in full. After the hidden",
        "effect stands its strength in multiples of the smallest detectable size.",
        *_again(today),
        "",
        f"| hidden | noise | seed | said |{title} held-out gap before → after (floor) | first evidence |",
        "|---|---|---|---|---|---|" + "---|" * bool(today),
    ]
    bad = misses(lines)
    for line in sorted(bad, key=lambda x: (x["kind"], x["effect"], x["seed"])):
        noise = f"× {line['noise']:g}{' sand off' if line['sand_off'] else ''}"
        rows.append(
            f"| {_hidden(line)} | {noise} | {line['seed']} "
            f"| {_said(line)} |{f' {_said_today(line, today)} |' if today else ''} {_gap(line)} "
            f"| {_candidates(line)} |"
        )
    return [*rows, ""] if bad else [*rows[:2], "Nothing.", ""]


def _again(today: Mapping[str, Line]) -> list[str]:
    """Say how the newest code fares on the sets that older code missed."""
    if not today:
        return []
    right = sum(bool(line.get("right")) for line in today.values())
    return [
        "",
        f"The newest code judged {len(today)} sets again that older code missed: {right} come out right.",
        "They do not count above, for they were chosen because they went wrong.",
    ]


def _said_today(line: Line, today: Mapping[str, Line]) -> str:
    return _said(today[line["key"]]) if line["key"] in today else "–"


def _half(line: Line) -> bool:
    return line.get("strength") == 0.5 and line.get("verdict") == "none"


def _hidden(line: Line) -> str:
    if line["effect"] == "none":
        return "nothing"
    reached = line.get("reached") or {}
    parts = []
    for name in line["effect"].split("+"):
        strength = f"{reached[name]:g}" if name in reached else "drawn"
        if line["kind"] == "outside":
            strength = f"drawn × {line['strength']:g}"
        sizes = ", ".join(f"{k} {v:g}" for k, v in ((line.get("truth") or {}).get(name) or {}).items())
        parts.append(f"{name} ({strength}{': ' + sizes if sizes else ''})")
    return " + ".join(parts)


def _said(line: Line) -> str:
    if line["status"] != "judged":
        last = (line.get("error") or "").strip().splitlines() or [""]
        return f"{line['status']}: {last[-1]}".replace("|", "/")
    found = [
        f["id"] + (f" (or {', '.join(f['twins'])})" if f["twins"] else "") for f in line.get("found") or []
    ]
    return f"{line['outcome'].replace('_', ' ')}: {' + '.join(found) or line['verdict']}"


def _gap(line: Line) -> str:
    gap = (line.get("gap") or {}).get("held_out")
    if not gap or None in gap:
        return "–"
    return f"{gap[0]:.3f} → {gap[1]:.3f} ({gap[2]:.3f})"


def _candidates(line: Line) -> str:
    status = {"evaluated": "", "screened only": " (screen)"}
    return ", ".join(
        f"{name} {evidence:.0f}{status.get(state, f' ({state})')}"
        for name, evidence, state in line.get("candidates") or []
        if evidence is not None
    )
