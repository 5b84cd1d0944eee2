"""Reports without k_92: what the trials determine, why they do not determine k_92, and what was assumed."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

from granite_lab.comparison.compare import Comparison
from granite_lab.estimation.motion import no_slip_is_known
from granite_lab.fitting.fit import BOUNDS
from granite_lab.reporting.names import inside, listed
from granite_lab.reporting.speeds import Speed
from granite_lab.results import StudyResult
from granite_lab.rounding import significant

REMEDY = (
    "Let the robot stand for 2 s before and after each run, name its standstills (rests, body_rests), or use "
    "a reference with its std (--use-reference)."
)


def silent(result: StudyResult) -> bool:
    """Whether no trial of a study has a slip ratio that is known to 5 points."""
    return no_slip_is_known([r.motion for r in result.trials])


def why_no_k92(result: StudyResult) -> str:
    """Say why no trial of a study determines k_92; empty where a trial does, or where there is no trial."""
    if not result.trials or any(r.fit.tells for r in result.trials):
        return ""
    reasons: dict[str, list[Comparison]] = defaultdict(list)
    for r in result.trials:
        reasons[_reason(r)].append(r)
    parts: list[str] = []
    for reason, trials in reasons.items():
        stds = [100 * r.fit.slip_measured.std for r in trials]
        low, high = (significant(f(stds), 2) for f in (min, max))
        uncertainty = f"± {low}" if low == high else f"± {low} to {high}"
        which = "that of" if parts else "λ_R of"
        names = [r.trial.name for r in trials]
        several = f"{len(names)} trials" if len(names) > 3 else listed(names)
        parts.append(f"{which} {several} {reason.format(known=uncertainty)}")
    return f"k_92 cannot be determined from these trials, because {'; '.join(parts)}."


def _reason(r: Comparison) -> str:
    """Return what is wrong with the λ_R of a trial, with a place for how well it is known."""
    fit, motion = r.fit, r.motion
    if not math.isfinite(fit.slip_measured.value):
        return "does not exist: nothing in it is steady"
    if not fit.slip_known:
        causes = [reason for reason in motion.health.reasons if "known to ±" not in reason]
        # the std of slip depends most on what anchors the velocity
        causes.sort(key=lambda reason: "anchor" not in reason and "standstill" not in reason)
        because = f" ({causes[0].split(': ')[0]})" if causes else ""
        return f"is known to {{known}} points only{because.replace('{', '{{').replace('}', '}}')}"
    if fit.status in BOUNDS:
        low, high = (significant(100 * x, 2) for x in fit.reach)
        side = "above" if fit.status == "at_lower_bound" else "below"
        return f"lies {side} the {low} to {high} % that the model reaches on this soil"
    return "could not be fitted"


def reach_in_words(speeds: Sequence[Speed]) -> str:
    """Say which slip the model can reach on the soil of the trials, by its k_92 alone."""
    reached = [s for s in speeds if all(map(math.isfinite, s.reach))]
    if not reached:
        return ""
    ends = [f"{significant(max(s.reach[0], 0.0), 2)} to {significant(s.reach[1], 2)} %" for s in reached]
    if len(reached) > 3:
        low, high = min(s.reach[0] for s in reached), max(s.reach[1] for s in reached)
        where = f"{significant(max(low, 0.0), 2)} to {significant(high, 2)} %, depending on speed"
    else:
        where = listed([f"{end} at {s.velocity:.3g} m/s" for s, end in zip(reached, ends, strict=True)])
    return f"On this soil the model reaches a slip of {where}."


def assumptions(result: StudyResult) -> str:
    """Say which robot and soil were assumed because they were not named; empty where all are named."""
    given = dict(result.source.options)
    parts = []
    for kind in ("robot", "soil"):
        unnamed = [r for r in result.trials if getattr(r.trial.info, kind) is None]
        if kind in given or not unnamed:
            continue
        titles = list(dict.fromkeys(getattr(r.run, kind).title for r in unnamed))
        every = "" if len(unnamed) == len(result.trials) else f" of {len(unnamed)} trials"
        parts.append(f"the {kind}{every} is {listed([inside(title) for title in titles])}")
    if not parts:
        return ""
    keys = " and ".join(f"--{part.split()[1]}" for part in parts)
    return f"Assumed, because no log and no option says it: {listed(parts)} ({keys} says which)."
