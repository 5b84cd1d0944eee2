"""The metadata of a report follow RO-Crate 1.1 and tell when a file was changed afterwards."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from granite_lab.errors import InputError
from granite_lab.reporting.json_report import CRATE as NAME
from granite_lab.reporting.json_report import changed_files
from granite_lab.results import StudyResult


@pytest.fixture(scope="module")
def entities(folder: Path) -> dict[str, dict[str, Any]]:
    document = json.loads((folder / NAME).read_text(encoding="utf-8"))
    assert document["@context"][0] == "https://w3id.org/ro/crate/1.1/context"
    found = {e["@id"]: e for e in document["@graph"]}
    assert len(found) == len(document["@graph"])
    return found


def linked(value: Any) -> set[str]:
    """Return all ids that an entity refers to."""
    if isinstance(value, dict):
        return {value["@id"]} if set(value) == {"@id"} else set().union(*map(linked, value.values()))
    return set().union(*map(linked, value)) if isinstance(value, list) else set()


def test_descriptor_and_root_are_as_the_specification_asks(entities: dict[str, dict[str, Any]]) -> None:
    assert entities[NAME]["@type"] == "CreativeWork"
    assert entities[NAME]["about"] == {"@id": "./"}
    assert entities[NAME]["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    root = entities["./"]
    assert root["@type"] == "Dataset"
    assert {"name", "description", "datePublished", "license"} <= set(root)
    assert "virtual" in root["description"]


def test_every_reference_leads_somewhere(entities: dict[str, dict[str, Any]]) -> None:
    known = set(entities) | {"https://w3id.org/ro/crate/1.1"}
    assert linked(list(entities.values())) <= known


def test_files_software_and_logs_are_recorded(
    folder: Path, study: StudyResult, entities: dict[str, dict[str, Any]]
) -> None:
    files = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()} - {NAME}
    assert {name for name, e in entities.items() if e["@type"] == "File"} == files
    page = hashlib.sha256((folder / "index.html").read_bytes()).hexdigest()
    assert entities["index.html"]["sha256"] == page
    action = entities["#study"]
    assert action["@type"] == "CreateAction"
    assert entities[action["instrument"]["@id"]]["version"] == study.source.version
    assert {entities[o["@id"]]["sha256"] for o in action["object"]} == {i.sha256 for i in study.source.inputs}


def test_a_changed_and_a_missing_file_are_named(folder: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(folder, tmp_path / "copy")
    assert list(changed_files(copy)) == []
    (copy / "report.md").write_text("edited")
    (copy / "report.pdf").unlink()
    assert list(changed_files(copy)) == [
        f"report.md: its content is not what {NAME} records",
        f"report.pdf: {NAME} records it, but it is missing",
    ]


def test_other_metadata_are_refused(tmp_path: Path) -> None:
    assert list(changed_files(tmp_path)) == []
    (tmp_path / NAME).write_text("{}")
    with pytest.raises(InputError, match="is not RO-Crate metadata"):
        list(changed_files(tmp_path))
