"""The finding as the document that ``discover --json`` prints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from granite_lab.discovery.finding import Disagreement, Finding, FoundEffect, LeftOut
from granite_lab.estimate import Estimate

SCHEMA = "granite-lab/discovery/2"


def finding_as_json(finding: Finding, model: Path | str | None = None) -> dict[str, Any]:
    """Return the finding as the document of ``discover --json``; NaN becomes None.

    Args:
        finding: the record.
        model: path of the model file that was written.
    """
    return {
        "schema": SCHEMA,
        "verdict": finding.verdict,
        "sentence": finding.sentence,
        "probability": _number(finding.probability),
        "provisional": list(finding.provisional),
        "effects": [_effect(e) for e in finding.effects],
        "small": [_effect(e) for e in finding.small],
        "remainder": _number(finding.remainder),
        "tolerance": finding.tolerance,
        "latency_s": _estimate(finding.latency),
        "gap": {"train": _pair(finding.gap.train), "held_out": _pair(finding.gap.held_out)},
        "channels": {
            g.channel: {"train": _pair(g.train), "held_out": _pair(g.held_out)} for g in finding.gaps
        },
        "scatter": dict(finding.scatter),
        "where": [_place(d) for d in finding.where],
        "left": [_place(d) for d in finding.left],
        "candidates": [
            {
                "id": c.id,
                "log_bayes_factor": _number(c.gain),
                "probability": _number(c.probability),
                "closes": _number(c.closes),
                "status": c.status,
                "bounds": list(c.bounds),
            }
            for c in finding.candidates
        ],
        "detectable": [
            {
                "id": d.effect,
                "parameter": d.parameter,
                "size": _number(d.size),
                "unit": d.unit,
                "limit": d.limit,
                "confused_with": list(d.confused_with),
            }
            for d in finding.detectable
        ],
        "confusion": _confusion(finding),
        "sand": {name: _estimate(e) for name, e in finding.sand.items()},
        "sand_per_trial": {trial: dict(own) for trial, own in finding.sand_per_trial},
        "scales": dict(finding.scales),
        "discrepancy": _number(finding.discrepancy),
        "trials_left_out": _left_out(finding.trials_left_out),
        "speeds_left_out": _left_out(finding.speeds_left_out),
        "dropped": [{"trial": name, "reason": reason} for name, reason in finding.dropped],
        "notes": list(finding.notes),
        "failures": list(finding.failures),
        "virtual": finding.virtual,
        "model": str(model) if model is not None else None,
    }


def _effect(e: FoundEffect) -> dict[str, Any]:
    return {
        "id": e.id,
        "empirical": e.empirical,
        "parameters": {
            p.name: _estimate(p.estimate)
            | {"unit": p.unit}
            | ({"per_trial": list(p.per_trial)} if p.per_trial else {})
            for p in e.parameters
        },
        "indistinguishable_from": list(e.twins),
        "probability": _number(e.probability),
        "closes": _estimate(e.closes),
    }


def _place(d: Disagreement) -> dict[str, Any]:
    return {
        "channel": d.channel,
        "phase": d.phase,
        "variant_mps": d.variant,
        "t_start_s": _number(d.start),
        "t_end_s": _number(d.end),
        "frequency_hz": _number(d.frequency),
        "share": _number(d.share),
        "score": _number(d.score),
    }


def _confusion(finding: Finding) -> dict[str, Any] | None:
    """Return what would come first if one candidate at a time were in the trials."""
    check = finding.confusion
    if check is None:
        return None
    return {
        "times_detectable": check.factor,
        "draws": check.draws,
        "candidates": [
            {
                "id": id_,
                "first": _number(check.matrix[k, k]),
                "missed": _number(check.missed[k]),
                "taken_for": {other: _number(x) for other, x in check.taken_for(id_)},
                "cosines": {
                    o: _number(c) for o, c in zip(check.ids, check.cosines[k], strict=True) if o != id_
                },
            }
            for k, id_ in enumerate(check.ids)
        ],
    }


def _left_out(found: Sequence[LeftOut]) -> list[dict[str, Any]]:
    return [{"name": x.name, "before": _number(x.before), "after": _number(x.after)} for x in found]


def _pair(of: tuple[float, float]) -> dict[str, float | None]:
    return {"before": _number(of[0]), "after": _number(of[1])}


def _estimate(of: Estimate) -> dict[str, Any]:
    return {"value": _number(of.value), "std": _number(of.std)}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
