"""A report for programs: its numbers as JSON, with the SHA-256 of its other files and of the logs.

Slip ratios are fractions, NaN is null.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from granite_lab.comparison.compare import Comparison
from granite_lab.discovery.as_json import finding_as_json
from granite_lab.errors import InputError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.files import sha256
from granite_lab.fitting.fit import BOUNDS, AThetaFit, K92Fit
from granite_lab.origin import Source
from granite_lab.parameters import load_paper
from granite_lab.reporting.answers import Answers
from granite_lab.reporting.canvas import FORMATS
from granite_lab.reporting.report import Report
from granite_lab.results import SCHEMA, StudyResult, pooled_misfits, shown_path, warnings_of
from granite_lab.shown import jsonable, picked


def to_json(
    result: StudyResult, report: Report, model: Path | str | None = None, files: Path | None = None
) -> str:
    """Return the report as one JSON document; the same study gives the same bytes on the same day.

    Args:
        result: the study.
        report: what is shown of it.
        model: path of the model file, as the document shall name it.
        files: folder of the report's other files, whose hashes the document holds.
    """
    finding = result.finding
    document = {
        "schema": SCHEMA,
        "name": result.name,
        "virtual": result.virtual,
        "answers": answers_as_json(report.answers),
        "a_theta": a_theta_as_json(result.a_theta),
        "misfits": list(pooled_misfits(result.trials).values()),
        "discovery": finding_as_json(finding, model) if finding is not None else None,
        "trials": [_trial(r) for r in result.trials],
        "failures": result.failures,
        "figures": [
            {"id": f.name, "title": f.title, "caption": f.caption}
            | {kind: f"figures/{f.name}.{kind}" for kind in FORMATS}
            for f in report.figures
        ],
        "tables": [
            {"id": t.name, "title": t.title, "csv": f"tables/{t.name}.csv", "latex": f"tables/{t.name}.tex"}
            for t in report.tables
        ],
        "provenance": provenance_as_json(result.source),
        "files": [] if files is None else hashes_of(files),
    }
    return dumps(document)


def answers_as_json(answers: Answers) -> dict[str, Any]:
    """Return the answers with their numbers as they are printed everywhere."""
    law = {"paper": load_paper().a_theta, "paper_inside_interval": answers.a_theta_agrees}
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
        "a_theta": None if answers.a_theta is None else answers.a_theta.as_json() | law,
        "channels": answers.channels,
        "questions": [
            picked(q, "id", "question", "text") | {"verdict": q.verdict or None} for q in answers.questions
        ],
    }  # fmt: skip


def provenance_as_json(source: Source) -> dict[str, Any]:
    """Return where a result comes from as plain objects."""
    columns = ("key", "value", "unit", "origin")
    return picked(source, "version", "command") | {
        "code_sha256": source.code,
        "options": [{"name": name, "value": value} for name, value in source.options],
        "inputs": [{"file": shown_path(i.path), "sha256": i.sha256} for i in source.inputs],
        "parameters": [dict(zip(columns, row, strict=True)) for row in source.parameters],
    }


def a_theta_as_json(fit: AThetaFit | None) -> dict[str, Any] | None:
    """Return the fit of a_θ over trials as plain objects; None where there is none."""
    if fit is None:
        return None
    return fit.a_theta.as_json() | picked(
        fit, "ci95", "log_linear", "ordinary", "scatter", "published", "agrees", "laws", "notes"
    ) | {
        "points": [
            {"trial": trial, "speed_mps": v, "k92": k92.as_json(), "slip_ratio": slip.as_json()}
            for trial, v, k92, slip in fit.points
        ],
    }  # fmt: skip


def motion_as_json(m: Motion) -> dict[str, Any]:
    """Return what was estimated of a trial as plain objects, without its time histories."""
    return picked(m, "slip_ratio", "noise") | {
        "variant": picked(m.variant, "velocity", "acceleration", "distance") | {"source": m.variant_source},
        "distance_m": m.distance.as_json(),
        "distance_wheels_m": m.distance_wheels.as_json(),
        "steady_s": m.steady,
        "t_start_s": m.t_start.as_json(),
        "clock_offset_s": m.clock_offset.as_json(),
        "health": picked(m.health, "grade", "good", "verdict", "reasons", "nis", "whiteness", "ljung_box")
        | {"rests_s": m.health.rests},
    }


def k92_as_json(fit: K92Fit) -> dict[str, Any]:
    """Return both fits of k_92 of a trial as plain objects."""
    k92 = Estimate(math.nan) if fit.status in BOUNDS else fit.k92
    return {
        "k92": k92.as_json() | {"status": fit.status, "known": fit.k92_known},
        "k92_trajectory": fit.k92_trajectory.as_json() | {"status": fit.status_trajectory},
        "slip_ratio_simulated": fit.slip_simulated,
        "notes": fit.notes,
    }


def _trial(r: Comparison) -> dict[str, Any]:
    motion = r.motion
    about = picked(r.trial, "name", "layout") | {
        "virtual": motion.virtual,
        "repetition": r.trial.info.repetition,
        "effects": r.run.effects,
        "misfits": r.misfits,
        "warnings": warnings_of(r),
    }
    return about | motion_as_json(motion) | k92_as_json(r.fit)


def dumps(document: Mapping[str, Any]) -> str:
    """Write JSON; NaN and infinity become null."""
    return json.dumps(jsonable(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def hashes_of(folder: Path) -> list[dict[str, str]]:
    """Return path and SHA-256 of each file in a folder."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return [{"file": path.relative_to(folder).as_posix(), "sha256": sha256(path)} for path in files]


def changed_files(document: Mapping[str, Any], path: Path) -> Iterator[str]:
    """Yield a line for each file of a report that is not what its ``report.json`` holds of it.

    Args:
        document: content of ``report.json``.
        path: where that is.

    Raises:
        InputError: it holds no hashes, or names files outside its folder.
    """
    try:
        recorded = {str(entry["file"]): str(entry["sha256"]) for entry in document["files"]}
    except (KeyError, TypeError):
        raise InputError(f"{path}: holds no hashes of the report's files", "run the study again") from None
    for name, sha in recorded.items():
        place = PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts:
            raise InputError(
                f"{path}: file '{name}' is not in the folder of the report", "run the study again"
            )
        file = path.parent / place
        if not file.is_file():
            yield f"{name}: is missing"
        elif sha256(file) != sha:
            yield f"{name}: its content was changed"
