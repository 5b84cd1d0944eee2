"""The verdict of a search for the missing effect, in the words of the first page."""

from __future__ import annotations

import math

from granite_lab.discovery.finding import Finding
from granite_lab.estimate import Estimate
from granite_lab.reporting.discovery.names import (
    capital,
    describe,
    in_plain_words,
    latency_in_words,
    listed,
    plain,
    spoken,
)
from granite_lab.reporting.document import Answer
from granite_lab.reporting.rounding import places, plus_minus, significant, with_unit
from granite_lab.reporting.summary import IN_PHASE

MUCH = 0.2
"""Share of the gap that is left from which on an answer is no longer "good"."""


def missing_answer(finding: Finding) -> Answer:
    """Say the verdict and the sizes of what was named; the sentence says why it is provisional."""
    parts = [in_plain_words(finding.sentence, finding)]
    if finding.effects:
        parts.append(f"{capital(listed([describe(e) for e in finding.effects]))}.")
    verdict, tone = "not known", "bad"
    if finding.verdict == "none":
        verdict, tone = "nothing", "good"
    elif finding.verdict == "named":
        verdict = ("one effect", "two effects", "three effects")[min(len(finding.effects), 3) - 1]
        tone = "fair" if finding.remainder > MUCH or any(e.twins for e in finding.effects) else "good"
    tone = "fair" if finding.provisional and tone == "good" else tone
    return Answer("missing", "What is missing from the model?", " ".join(parts), verdict, tone)


def sure_answer(finding: Finding) -> Answer:
    """Say what speaks for the verdict: its probability, trials and speeds left out, twins, latency."""
    parts = [f"The verdict has a posterior probability of {percent(finding.probability)}."]
    left = [
        (finding.trials_left_out, "trials"),
        (finding.speeds_left_out, "speeds"),
    ]
    counts = [
        f"{sum(x.after < x.before for x in found)} of {len(found)} {what}" for found, what in left if found
    ]
    if finding.effects and counts:
        law = " with the empirical law" if finding.verdict == "unknown" else ""
        parts.append(f"{listed(counts)} that a fit had not seen are predicted better{law}.")
    elif not finding.trials_left_out:
        parts.append("Nothing was left out of the fit, so that no prediction tests it.")
    for e in finding.effects:
        if e.twins:
            parts.append(
                f"{capital(plain(e.id))} may as well be {listed([plain(t) for t in e.twins], 'or')}: "
                "another trial is needed."
            )
    if latency := latency_in_words(finding.latency):
        parts.append(f"{latency}.")
    return Answer("sure", "How sure is that?", " ".join(parts), "", "fair" if finding.provisional else "")


def gap_answer(finding: Finding) -> Answer:
    """Say how far model and trials are apart, in the fit and on trials left out."""
    before, after = finding.gap.train
    out = finding.gap.held_out
    if not finding.effects:
        text = (
            f"In the fit, sensors and model differ by {times(before)} times what noise and tolerance explain."
        )
        return Answer("gap", "How far is the model from the trials?", text)
    text = f"In the fit the gap falls from {times(before)} to {times(after)}"
    if math.isfinite(out[0]):
        text += f", on trials that were left out from {times(out[0])} to {times(out[1])}"
    allowed = f"a tolerance of {percent(finding.tolerance)} of each channel's rms"
    text += f"; 1 is as good as noise and {allowed} allow."
    closes = 1 - finding.remainder
    verdict = f"{percent(closes)} of it" if math.isfinite(closes) else ""
    tone = "good" if finding.remainder <= MUCH else "fair"
    return Answer("gap", "How much of the gap does it close?", text, verdict, tone)


def where_answer(finding: Finding) -> Answer:
    """Say where the model without effects is off most."""
    question = "Where does it show?" if finding.verdict != "none" else "Is there a place where it is off?"
    if not finding.where:
        text = "No interval is off by more than the tolerance."
        return Answer("where", question, text, "nowhere", "good")
    seen: dict[tuple[str, str], str] = {}
    for d in sorted(finding.where, key=lambda d: -d.share):
        seen.setdefault(
            (d.channel, d.phase),
            f"the {spoken(d.channel)} {IN_PHASE[d.phase]} (at {d.variant:g} m/s from {places(d.start, 2)} s "
            f"to {places(d.end, 2)} s, {percent(d.share)} of its rms)",
        )
    n = len(finding.where)
    count = "One interval is" if n == 1 else f"{n} intervals are"
    most = listed(list(seen.values())[:3])
    return Answer("where", question, f"{count} off by more than the tolerance, most of all {most}.")


def times(gap: float) -> str:
    """Return a gap with two decimals where it is small."""
    return places(gap, 2) if abs(gap) < 10 else significant(gap)


def percent(share: float) -> str:
    """Return a share in percent; never 100 % where something is left."""
    if not math.isfinite(share):
        return "–"
    if 0.99 < share < 1:
        return with_unit("over 99", "%")
    return with_unit(significant(100 * share, 3 if share > 0.1 else 2).removesuffix(".0"), "%")


def percent_of(share: Estimate) -> str:
    """Return a share ± its standard error in percent."""
    return plus_minus(share, "%", 100)
