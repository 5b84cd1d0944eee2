"""The verdict of a search for the missing effect, in the words of the first page."""

from __future__ import annotations

import math
from collections.abc import Mapping

from granite_lab.discovery.finding import CHANCE, Finding
from granite_lab.model.effect import Effect
from granite_lab.reporting.discovery.names import describe, either, listed, plain, quantities, spoken
from granite_lab.reporting.discovery.sizes import picked, shares
from granite_lab.reporting.document import Answer
from granite_lab.reporting.rounding import evidence, places, significant
from granite_lab.reporting.summary import IN_PHASE

QUESTION = "What is missing from the model?"

TENTH = 10.0
"""Share of the largest size expected [%] at which an effect counts as small."""

SMALL = 0.005
"""A noise floor this close to 1 is not worth a word."""


def missing_answer(finding: Finding) -> Answer:
    """Say what is missing, how sure that is, and how much of the gap it closes on left-out trials."""
    if finding.verdict == "none":
        text = " ".join(["These trials show no missing effect.", *_best(finding), _gap(finding)])
        return Answer("missing", QUESTION, text, "nothing", "good")
    if finding.verdict == "named":
        named = _capital(listed([describe(e) for e in finding.effects]))
        text = f"{named}. {_evidence(finding)} {_gap(finding)}"
        left = finding.map_after > finding.map_threshold
        return Answer(
            "missing", QUESTION, f"{text} What is left is more than noise." if left else text,
            ("one effect", "two effects", "three effects")[min(len(finding.effects), 3) - 1],
            "fair" if left or any(e.twins for e in finding.effects) else "good",
        )  # fmt: skip
    apart = _apart(finding)
    if apart and not finding.effects and finding.map_after <= finding.map_threshold:
        said = ["Something that is not the same in each trial.", apart, "What repeats is explained."]
        return Answer("missing", QUESTION, " ".join([*said, _gap(finding)]), "not known", "bad")
    n = len(finding.rounds[0]) if finding.rounds else 0
    parts = [f"Something that none of the {n} candidates explains."]
    if apart:
        parts.append(f"It is not the same in each trial. {apart}")
    tried = [plain(i) for i in (picked(finding, k) for k in range(len(finding.rounds))) if i is not None]
    if tried:
        one = len(tried) == 1
        little = ("explains" if one else "together explain") + " too little to be named"
        unlike = ("does" if one else "do") + " not explain that, however much of the rest"
        parts.append(f"What came closest, {listed(tried)}, {unlike if apart else little}.")
    parts.append(
        f"An empirical law stands in for it, {quantities(finding.effects[0])}: a description, no physics."
        if finding.effects
        else "No empirical law explains it either."
    )
    return Answer("missing", QUESTION, " ".join([*parts, _gap(finding)]), "not known", "bad")


def sure_answer(finding: Finding, known: Mapping[str, Effect]) -> Answer:
    """Say what speaks for the verdict: left-out trials and speeds, twins, what is left, what would be "
    "seen."""
    question = "How sure is that?"
    if finding.verdict == "none":
        sizes = shares(finding, known)
        seen = sum(low <= TENTH for low, _ in sizes.values())
        text = (
            f"{seen} of {len(sizes)} candidates would have been seen at a tenth of the largest size "
            "expected of them. A false alarm is allowed in one set of trials in a hundred."
        )
        return Answer("sure", question, text)
    parts = []
    if finding.effects and finding.trial_losses:
        better = sum(after < before for _, before, after in finding.trial_losses)
        text = f"{better} of {len(finding.trial_losses)} trials that a fit had not seen are predicted better"
        text += " with the empirical law" if finding.verdict == "unknown" else ""
        if finding.losses:
            of = sum(after < before for _, before, after in finding.losses)
            text += f", and so are {of} of {len(finding.losses)} speeds that it had not seen"
        parts.append(f"{text}.")
    elif not finding.trial_losses:
        parts.append("With one trial nothing can be left out, so that nothing proves it.")
    twins = [e for e in finding.effects if e.twins]
    for e in twins:
        parts.append(
            f"{_capital(plain(e.id))} may as well be {either([plain(t) for t in e.twins])}: another trial "
            "is needed."
        )
    if finding.verdict == "named" and not twins:
        parts.append("No other candidate explains these trials as well.")
    if finding.unrepeated.plain:
        parts.append(
            "What is left is more than noise: the sensors agree about it, though it is never the same."
        )
    elif finding.map_after <= finding.map_threshold:
        parts.append("What is left is noise.")
    else:
        parts.append("What is left is more than noise.")
    tone = "fair" if twins or finding.map_after > finding.map_threshold else "good"
    return Answer("sure", question, " ".join(parts), "", tone if finding.verdict == "named" else "fair")


def gap_answer(finding: Finding) -> Answer:
    """Say how much of the gap closes, on trials of the fit and on trials left out."""
    question = "How much of the gap does it close?"
    if finding.verdict == "none" or not finding.effects:
        return Answer("gap", "How far is the model from the trials?", _gap(finding))
    before, after, _ = (times(v) for v in finding.gap.train)
    text = f"{_gap(finding)} On the trials of the fit it falls from {before} to {after}."
    share = closed(finding.gap.held_out)
    good = math.isfinite(share) and share >= 0.9
    return Answer("gap", question, text, share_in_words(share), "good" if good else "fair")


def where_answer(finding: Finding) -> Answer:
    """Say where the model without effects is off most."""
    question = "Where does it show?" if finding.verdict != "none" else "Is there a place where it is off?"
    if not finding.where and finding.unrepeated.plain:
        text = "No interval is off in the same way each time beyond what chance explains."
        return Answer("where", question, f"{text} {_apart(finding)}", "elsewhere each time", "fair")
    if not finding.where:
        text = "No interval is off beyond what chance explains."
        return Answer("where", question, text, "nowhere", "good")
    ranked = sorted(finding.where, key=lambda d: -d.strength)
    seen: dict[tuple[str, str], str] = {}
    for d in ranked:
        start, end = places(d.start, 2), places(d.end, 2)
        at = f"{d.variant:g} m/s from {start} s to {end} s, {significant(d.strength, 2)} times"
        seen.setdefault(
            (d.channel, d.phase), f"the {spoken(d.channel)} {IN_PHASE[d.phase]} (at {at} the noise)"
        )
    n = len(finding.where)
    count = "One interval is" if n == 1 else f"{n} intervals are"
    return Answer(
        "where", question, f"{count} off beyond chance, most of all {listed(list(seen.values())[:3])}."
    )


def closed(gap: tuple[float, float, float]) -> float:
    """Return the share of a gap above its floor that closes; NaN where there was none."""
    before, after, floor = gap
    return (before - after) / (before - floor) if before > floor else math.nan


def times(gap: float) -> str:
    """Return a gap in multiples of the noise, with two decimals where it is small."""
    return places(gap, 2) if abs(gap) < 10 else significant(gap)


def share_in_words(share: float) -> str:
    """Say how much of a gap closes; empty where there was none."""
    if not math.isfinite(share):
        return ""
    return "all of it" if share >= 0.995 else f"{significant(100 * share, 2)} % of it"


def _evidence(finding: Finding) -> str:
    brought = {
        c.id: c.evidence
        for k, found in enumerate(finding.rounds)
        for c in found
        if c.id == picked(finding, k)
    }
    least = min((brought.get(e.id, e.evidence) for e in finding.effects), default=math.nan)
    each = "The evidence for it is" if len(finding.effects) == 1 else "The evidence for each is at least"
    return (
        f"{each} {evidence(least)}; chance alone reaches {significant(finding.threshold, 2)} in one set "
        "of trials in a hundred."
    )


def _apart(finding: Finding) -> str:
    """Say which sensors see what the repetitions do not share; empty where it is no more than chance."""
    seen = finding.unrepeated
    if not seen.plain:
        return ""
    return (
        f"In what the repetitions do not share, {spoken(seen.first)} and {spoken(seen.second)} go together "
        f"between {seen.low:g} Hz and {seen.high:g} Hz ({significant(seen.score, 2)} standard deviations; "
        f"chance stays below {CHANCE:g})."
    )


def _best(finding: Finding) -> list[str]:
    found = finding.rounds[0] if finding.rounds else ()
    if not found:
        return []
    best = max(found, key=lambda c: c.evidence)
    if best.evidence > finding.threshold:
        return []
    text = (
        f"The best of {len(found)} candidates, {plain(best.id)}, has an evidence of "
        f"{evidence(best.evidence)}; chance alone reaches {significant(finding.threshold, 2)} in one "
        "set of trials in a hundred."
    )
    return [text]


def _gap(finding: Finding) -> str:
    known = finding.gap.held_out if finding.trial_losses else finding.gap.train
    which = "On trials that were left out of the fit" if finding.trial_losses else "On the trial of the fit"
    before, after, floor = (times(v) for v in known)
    share = closed(known)
    if finding.verdict == "none" or not finding.effects or not math.isfinite(share):
        alone = "" if abs(known[2] - 1) < SMALL else f", where noise alone gives {floor}"
        return f"{which} sensors and model differ by {before} times the noise{alone}."
    return (
        f"{which} the gap between sensors and model falls from {before} to {after} times the noise: "
        f"{share_in_words(share)} closes."
    )


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]
