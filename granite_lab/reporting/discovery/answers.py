"""The verdict of a search for the missing effect, in the words of the first page."""

from __future__ import annotations

import math

from granite_lab.discovery.finding import Finding
from granite_lab.reporting.discovery.names import describe, listed
from granite_lab.reporting.document import Answer
from granite_lab.reporting.rounding import significant

QUESTION = "What is missing from the model?"


def missing_answer(finding: Finding) -> Answer:
    """Say what is missing, how sure that is, and how much of the gap it closes on held-out trials."""
    if finding.verdict == "none":
        return Answer(
            "missing", QUESTION, f"Nothing that these trials can show. {_gap(finding)}", "nothing", "good"
        )
    if finding.verdict == "named":
        text = f"{_capital(listed([describe(e) for e in finding.effects]))}. {_sure(finding)} {_gap(finding)}"
        return Answer("missing", QUESTION, text, _count(len(finding.effects)), "good")
    stands_in = "; an empirical law stands in for it" if finding.effects else ""
    text = f"Something is missing that no candidate explains{stands_in}. {_gap(finding)}"
    return Answer("missing", QUESTION, text, "unknown effect", "fair")


def closed(gap: tuple[float, float, float]) -> float:
    """Return the share of a gap above its floor that closes; NaN where there was none."""
    before, after, floor = gap
    return (before - after) / (before - floor) if before > floor else math.nan


def _sure(finding: Finding) -> str:
    least = min((e.evidence for e in finding.effects), default=math.nan)
    return (
        f"Chance reaches an evidence of {significant(finding.threshold, 2)} in one set of trials out of a "
        f"hundred; these reach {significant(least, 2)}."
    )


def _gap(finding: Finding) -> str:
    held = finding.gap.held_out
    before, after, floor = (significant(v, 3) for v in held)
    share = closed(held)
    if finding.verdict == "none" or not finding.effects or not math.isfinite(share):
        return f"On trials that were left out the model misses by {before} times the noise (noise: {floor})."
    return (
        f"On trials that were left out of the fit the gap falls from {before} to {after} times the noise "
        f"(noise: {floor}): {significant(100 * share, 2)} % of it closes."
    )


def _count(n: int) -> str:
    return "one effect" if n == 1 else f"{n} effects"


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]
