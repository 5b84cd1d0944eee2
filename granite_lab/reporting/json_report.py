"""A report as JSON: the numbers behind it, slip ratios as fractions, NaN as null."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from granite_lab.discovery.as_json import finding_as_json
from granite_lab.reporting.answers import Answers
from granite_lab.reporting.content import Source, StudyResult, TrialResult, shown_path
from granite_lab.reporting.report import Report
from granite_lab.reporting.summary import gaps

SCHEMA = "granite-lab/report/2"


def to_json(result: StudyResult, report: Report, model: Path | str | None = None) -> str:
    """Return the report as one JSON document; the same study gives the same bytes.

    Args:
        result: the study.
        report: its report.
        model: path of the model file with what was found, as the document shall name it.
    """
    finding = result.finding
    document = {
        "schema": SCHEMA,
        "name": result.name,
        "virtual": result.virtual,
        "answers": answers_as_json(report.answers),
        "a_theta": _a_theta(result),
        "misfits": [dataclasses.asdict(g) for g in gaps([r.comparison for r in result.trials]).values()],
        "discovery": finding_as_json(finding, model) if finding is not None else None,
        "trials": [_trial(r) for r in result.trials],
        "failures": [dataclasses.asdict(f) for f in result.failures],
        "figures": [
            {"id": f.name, "title": f.title, "caption": f.caption, "svg": f"figures/{f.name}.svg",
             "png": f"figures/{f.name}.png", "pdf": f"figures/{f.name}.pdf"}
            for f in report.figures
        ],
        "tables": [
            {"id": t.name, "title": t.title, "csv": f"tables/{t.name}.csv", "latex": f"tables/{t.name}.tex"}
            for t in report.tables
        ],
        "provenance": provenance_as_json(result.source),
    }  # fmt: skip
    return dumps(document)


def answers_as_json(answers: Answers) -> dict[str, Any]:
    """Return the answers with their numbers as they are printed everywhere."""
    return {
        "measured": answers.lead,
        "virtual": answers.virtual or None,
        "speeds": [
            {
                "speed_mps": s.velocity, "trials": [r.trial.name for r in s.results],
                "slip": s.slip.as_json(), "k92": s.k92.as_json(),
                "slip_paper": s.paper_slip, "k92_paper": s.paper_k92, "paper_inside_interval": s.agrees,
            }
            for s in answers.speeds
        ],
        "a_theta": None
        if answers.a_theta is None
        else answers.a_theta.as_json()
        | {"paper": answers.a_theta_paper, "paper_inside_interval": answers.a_theta_agrees},
        "channels": [dataclasses.asdict(c) for c in answers.channels],
        "questions": [
            {"id": q.id, "question": q.question, "verdict": q.verdict or None, "text": q.text}
            for q in answers.questions
        ],
    }  # fmt: skip


def provenance_as_json(source: Source) -> dict[str, Any]:
    """Return where a result comes from as plain objects."""
    return {
        "version": source.version,
        "code_sha256": source.code,
        "options": [{"name": name, "value": value} for name, value in source.options],
        "command": source.command,
        "inputs": [{"file": shown_path(i.path), "sha256": i.sha256} for i in source.inputs],
        "parameters": [
            {"key": key, "value": value, "unit": unit, "origin": origin}
            for key, value, unit, origin in source.parameters
        ],
    }


def _a_theta(result: StudyResult) -> dict[str, Any] | None:
    fit = result.a_theta
    if fit is None:
        return None
    return {
        "value": fit.a_theta.value,
        "std": fit.a_theta.std,
        "ci95": fit.ci95,
        "log_linear": fit.log_linear,
        "ordinary": fit.ordinary,
        "scatter": fit.scatter,
        "published": fit.published,
        "agrees": fit.agrees,
        "points": [
            {"trial": trial, "speed_mps": v, "k92": k92.as_json(), "slip_ratio": slip.as_json()}
            for trial, v, k92, slip in fit.points
        ],
        "laws": [dataclasses.asdict(law) for law in fit.laws],
        "notes": fit.notes,
    }


def _trial(r: TrialResult) -> dict[str, Any]:
    m, fit = r.comparison.motion, r.comparison.fit
    return {
        "name": r.trial.name,
        "virtual": r.trial.info.virtual or m.virtual,
        "layout": r.trial.layout,
        "repetition": r.trial.info.repetition,
        "variant": dataclasses.asdict(m.variant) | {"source": m.variant_source},
        "slip_ratio": m.slip_ratio.as_json(),
        "distance_m": m.distance.as_json(),
        "distance_wheels_m": m.distance_wheels.as_json(),
        "steady_s": m.steady,
        "t_start_s": m.t_start.as_json(),
        "clock_offset_s": m.clock_offset.as_json(),
        "noise": m.noise,
        "k92": fit.k92.as_json() | {"status": fit.status},
        "k92_trajectory": fit.k92_trajectory.as_json() | {"status": fit.status_trajectory},
        "slip_ratio_simulated": fit.slip_simulated,
        "effects": r.comparison.run.effects,
        "health": {
            "good": m.health.good,
            "verdict": m.health.verdict,
            "nis": m.health.nis,
            "whiteness": m.health.whiteness,
            "ljung_box": m.health.ljung_box,
            "rests_s": m.health.rests,
        },
        "misfits": [dataclasses.asdict(x) for x in r.comparison.misfits],
        "warnings": list(dict.fromkeys((*r.trial.warnings, *m.warnings))),
        "notes": list(fit.notes),
    }


def dumps(document: Mapping[str, Any]) -> str:
    """Write JSON; NaN and infinity become null."""
    return json.dumps(_plain(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, str) or value is None or isinstance(value, bool):
        return value
    if isinstance(value, Sequence):
        return [_plain(v) for v in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
