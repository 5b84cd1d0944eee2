"""A design on its way through a JSON file."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from granite_lab.discovery.finding import Finding
from granite_lab.discovery.plan_conditions import Conditions, conditions_of
from granite_lab.discovery.plan_design import Design, Driven, Noise, design_of
from granite_lab.errors import InputError
from granite_lab.files import readable, write_text
from granite_lab.inference.setup import variant_of_trial
from granite_lab.logs.trial import Trial
from granite_lab.parameters import Robot, Soil, Variant
from granite_lab.parameters.quantity import build, key_of

SCHEMA = "granite-lab/design/1"

NAME = "design.json"
"""Name of the file, beside the finding."""


def as_document(design: Design) -> dict[str, Any]:
    """Return a design as it stands in JSON."""
    return {
        "schema": SCHEMA,
        "robot": _table(design.robot),
        "soil": _table(design.soil),
        "sand": list(design.sand),
        "bin_s": design.width,
        "virtual": design.virtual,
        "driven": [
            {
                "variant": _table(d.variant),
                "conditions": dataclasses.asdict(d.conditions),
                "channels": list(d.channels),
                "count": d.count,
                "noise": {c: {"rest": list(n.rest), "driven": list(n.driven)} for c, n in d.noise.items()},
            }
            for d in design.driven
        ],
    }


def _table(record: Any) -> dict[str, Any]:
    """Return a record as the table that `build` reads."""
    found = {}
    for f in dataclasses.fields(record):
        value = getattr(record, f.name)
        if value is not None:
            value = _table(value) if dataclasses.is_dataclass(value) else value
            found[key_of(f)] = list(value) if isinstance(value, tuple) else value
    return found


def design_from(document: Mapping[str, Any], path: Path) -> Design:
    """Read a design.

    Raises:
        InputError: the document is not one.
    """
    if document.get("schema") != SCHEMA:
        raise InputError(
            f"{path}: schema = {document.get('schema')!r} is not a design's", f'expected "{SCHEMA}"'
        )
    try:
        driven = tuple(
            Driven(
                build(Variant, d["variant"], str(path)),
                tuple(str(c) for c in d["channels"]),
                int(d["count"]),
                {c: Noise(tuple(n["rest"]), tuple(n["driven"])) for c, n in d["noise"].items()},
                Conditions(**d.get("conditions", {})),
            )
            for d in document["driven"]
        )
        return Design(
            build(Robot, document["robot"], str(path)),
            build(Soil, document["soil"], str(path)),
            tuple(float(x) for x in document["sand"]),
            float(document["bin_s"]),
            driven,
            bool(document["virtual"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: is not complete ({error})", "run 'granite-lab discover' again") from None


def save_design(finding: Finding, trials: Sequence[Trial], path: Path) -> None:
    """Write what a plan needs beside the finding; nothing where no log or table says what was commanded.

    Args:
        finding: the discovery.
        trials: its logs.
        path: of the JSON file.

    Raises:
        LabError: the file cannot be written.
    """
    speeds = {r.trial: r.variant for r in finding.residuals}
    variants, under = {}, {}
    for trial in trials:
        if trial.name not in speeds:
            continue
        info = dataclasses.replace(trial.info, v_desired=trial.info.v_desired or speeds[trial.name])
        try:
            variants[trial.name] = variant_of_trial(dataclasses.replace(trial, info=info), None)
            under[trial.name] = conditions_of(trial)
        except InputError:
            path.unlink(missing_ok=True)  # that of an earlier search would be wrong
            return
    text = json.dumps(as_document(design_of(finding, variants, under)), allow_nan=False)
    write_text(path, text + "\n")


def load_design(path: Path) -> Design:
    """Read a design.

    Raises:
        InputError: the file cannot be read, or is not one.
    """
    return design_from(load_document(path), path)


def load_document(path: Path) -> Mapping[str, Any]:
    """Read a JSON object.

    Raises:
        InputError: the file cannot be read, or holds something else.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise readable(error, path) from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({error})", "run 'granite-lab discover' again") from None
    if not isinstance(document, dict):
        raise InputError(f"{path}: is not a JSON object", "run 'granite-lab discover' again")
    return document
