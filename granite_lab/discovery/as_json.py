"""The finding as the document that ``discover --json`` prints."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from granite_lab.discovery.finding import Finding


def finding_as_json(finding: Finding, model: Path | str | None = None) -> dict[str, Any]:
    """Return the finding as the document of ``discover --json``; NaN becomes None.

    Args:
        finding: the record.
        model: path of the model file that was written.
    """

    def gap(of: tuple[float, float, float]) -> dict[str, float | None]:
        return {name: _number(v) for name, v in zip(("before", "after", "floor"), of, strict=True)}

    return {
        "schema": "granite-lab/discovery/1",
        "verdict": finding.verdict,
        "effects": [
            {
                "id": e.id,
                "empirical": e.empirical,
                "parameters": {
                    p.name: {
                        "value": _number(p.estimate.value),
                        "std": _number(p.estimate.std),
                        "unit": p.unit,
                    }
                    for p in e.parameters
                },
                "indistinguishable_from": list(e.twins),
            }
            for e in finding.effects
        ],
        "where": [
            {
                "channel": d.channel,
                "phase": d.phase,
                "variant_mps": d.variant,
                "t_start_s": _number(d.start),
                "t_end_s": _number(d.end),
                "frequency_hz": _number(d.frequency),
                "strength": _number(d.strength),
            }
            for d in finding.where
        ],
        "gap": {"train": gap(finding.gap.train), "held_out": gap(finding.gap.held_out)},
        "candidates": [
            {"id": c.id, "evidence": _number(c.evidence), "status": c.status}
            for c in (finding.rounds[0] if finding.rounds else ())
        ],
        "threshold": _number(finding.threshold),
        "detectable": [
            {
                "id": d.effect,
                "parameter": d.parameter,
                "size": _number(d.size),
                "unit": d.unit,
                "confused_with": list(d.confused_with),
            }
            for d in finding.detectable
        ],
        "self_check": _self_check(finding),
        "notes": list(finding.notes),
        "sentence": finding.sentence,
        "seed": finding.seed,
        "virtual": finding.virtual,
        "model": str(model) if model is not None else None,
    }


def _self_check(finding: Finding) -> dict[str, Any] | None:
    """Return what would be named if one candidate at a time were in the trials."""
    check = finding.self_check
    if check is None:
        return None
    return {
        "times_detectable": check.factor,
        "draws": check.draws,
        "candidates": [
            {
                "id": id_,
                "named": _number(check.kept[k]),
                "named_alone": _number(check.alone[k]),
                "missed": _number(check.missed[k]),
                "taken_for": {other: _number(x) for other, x in check.taken_for(id_)},
            }
            for k, id_ in enumerate(check.ids)
        ],
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
