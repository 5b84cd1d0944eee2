"""The finding as the document that ``discover --json`` prints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from granite_lab.discovery.finding import Ceiling, Confusion, EffectFinding, Finding, Gap, GroundWave
from granite_lab.fitting.fit import View
from granite_lab.shown import jsonable, picked

SCHEMA = "granite-lab/discovery/3"


def finding_as_json(finding: Finding, model: Path | str | None = None) -> dict[str, Any]:
    """Return the finding as the document of ``discover --json``; NaN becomes None.

    The ``ceiling`` of what any force could close is None where nothing remains to be closed.

    Args:
        finding: the record.
        model: path of the model file that was written.
    """
    places = {"variant": "variant_mps", "start": "t_start_s", "end": "t_end_s", "frequency": "frequency_hz"}
    document = {
        "schema": SCHEMA,
        **picked(finding, "verdict", "sentence", "probability", "provisional"),
        "effects": [_effect(e) for e in finding.effects],
        "description": {"terms": [_effect(e) for e in finding.description]},
        "small": [_effect(e) for e in finding.small],
        **picked(finding, "closed"),
        "ceiling": None if finding.ceiling is None else _ceiling(finding.ceiling, places),
        **picked(finding, "remainder", "strained"),
        "a_theta": {v.by: _view(v) for v in finding.a_theta} or None,
        **picked(finding, "tolerance"),
        "latency_s": finding.latency,
        "gap": _gap(finding.gap),
        "channels": {g.channel: _gap(g) for g in finding.gaps},
        **picked(finding, "scatter"),
        "ground_wave": None if finding.ground_wave is None else _wave(finding.ground_wave),
        "where": [_renamed(d, places) for d in finding.where],
        "left": [_renamed(d, places) for d in finding.left],
        "candidates": [_renamed(c, {"gain": "log_bayes_factor"}) for c in finding.candidates],
        "detectable": [_renamed(d, {"effect": "id"}) for d in finding.detectable],
        "confusion": None if finding.confusion is None else _confusion(finding.confusion),
        **picked(finding, "sand"),
        "sand_per_trial": dict(finding.sand_per_trial),
        **picked(finding, "scales", "own_means", "discrepancy", "trials_left_out", "speeds_left_out"),
        "dropped": [{"trial": name, "reason": reason} for name, reason in finding.dropped],
        **picked(finding, "notes", "failures", "virtual"),
        "model": str(model) if model is not None else None,
    }
    plain: dict[str, Any] = jsonable(document)
    return plain


def _ceiling(ceiling: Ceiling, names: dict[str, str]) -> dict[str, Any]:
    """Return what any force could close, of the whole gap, and where forces are certain."""
    return picked(ceiling, "value", "left", "parts", "channels") | {
        "where": [_renamed(push, names) for push in ceiling.where]
    }


def _wave(wave: GroundWave) -> dict[str, Any]:
    """Return a wave of the ground; ``order`` is None where it cannot turn with the wheels."""
    return {"wavelength_m": wave.wavelength} | picked(wave, "channel", "unit", "amplitude", "share", "order")


def _view(view: View) -> dict[str, Any]:
    """Return a_θ by one view, with what its std is made of."""
    parts = {part.name: part.contribution for part in view.parts}
    return view.a_theta.as_json() | {"ci95": view.ci95, "unit": "s/m", "parts": parts}


def _renamed(record: object, names: dict[str, str]) -> dict[str, Any]:
    return {names.get(name, name): value for name, value in jsonable(record).items()}


def _gap(gap: Gap) -> dict[str, Any]:
    parts = {"train": gap.train, "held_out": gap.held_out}
    return {name: {"before": before, "after": after} for name, (before, after) in parts.items()}


def _effect(e: EffectFinding) -> dict[str, Any]:
    return picked(e, "id", "formula", "empirical", "probability", "closes", "speeds") | {
        "parameters": {
            p.name: p.estimate.as_json()
            | {"ci95": list(p.estimate.interval())}
            | {"unit": p.unit}
            | ({"per_trial": p.per_trial} if p.per_trial else {})
            for p in e.parameters
        },
        "indistinguishable_from": e.twins,
        "periodic": _periodic(e),
    }


def _periodic(e: EffectFinding) -> dict[str, Any]:
    """Return amplitude and phase in each trial of what turns with the wheels: a cos(N θ − phase)."""
    each = {p.name: np.array(p.per_trial) for p in e.parameters if p.per_trial}
    return {
        name.removeprefix("cos_"): {
            "amplitude": np.hypot(cos, each[sin]).tolist(), "phase_rad": np.arctan2(each[sin], cos).tolist()
        }
        for name, cos in each.items() if name.startswith("cos_") and (sin := f"sin_{name[4:]}") in each
    }  # fmt: skip


def _confusion(check: Confusion) -> dict[str, Any]:
    """Return what would come first if one candidate at a time were in the trials."""
    return {
        "times_detectable": check.factor,
        "draws": check.draws,
        "candidates": [
            {
                "id": id_,
                "first": check.matrix[k, k],
                "missed": check.missed[k],
                "taken_for": dict(check.taken_for(id_)),
                "cosines": {o: c for o, c in zip(check.ids, check.cosines[k], strict=True) if o != id_},
            }
            for k, id_ in enumerate(check.ids)
        ],
    }
