"""Provenance of a report as RO-Crate 1.1 metadata: which software made which files from which logs [1].

References:
    [1] P. Sefton et al., RO-Crate Metadata Specification 1.1.3, https://w3id.org/ro/crate/1.1: root data
        entity, data entities, and software used to create files.
"""

from __future__ import annotations

import hashlib
import json
import mimetypes
import platform
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from urllib.parse import quote, unquote

from granite_lab.errors import InputError
from granite_lab.files import readable
from granite_lab.reporting.content import Source, shown_path
from granite_lab.reporting.render import rendered
from granite_lab.reporting.report import Report

NAME = "ro-crate-metadata.json"

_TYPES = {".md": "text/markdown", ".toml": "application/toml", ".tex": "text/x-tex", ".csv": "text/csv"}


def crate(
    report: Report, source: Source, date: str, libraries: Sequence[str], files: Sequence[Path], root: Path
) -> str:
    """Return the metadata of a report's folder as JSON-LD.

    Args:
        report: the report.
        source: where it comes from.
        date: of today, ISO 8601.
        libraries: names of the installed packages that matter.
        files: that belong to it.
        root: folder of `files` on which their names are based.
    """
    versions = {name: metadata.version(name) for name in libraries} | {"Python": platform.python_version()}
    text = rendered(
        NAME, report=report, source=source, date=date,
        parts=[_part(path, root) for path in sorted(files)],
        inputs=[
            {"@id": f"#input/{quote(name)}", "@type": "CreativeWork", "name": name, "sha256": file.sha256}
            for file in source.inputs  # what was read is not in the folder
            for name in [shown_path(file.path)]
        ],
        tools=[
            {"@id": f"#{name}", "@type": "SoftwareApplication", "name": name, "version": version}
            for name, version in versions.items()
        ],
    )  # fmt: skip
    return json.dumps(json.loads(text), indent=1, ensure_ascii=False) + "\n"


def _part(path: Path, root: Path) -> dict[str, str]:
    data = path.read_bytes()
    kind = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    return {
        "@id": quote(path.relative_to(root).as_posix()), "@type": "File", "name": path.name,
        "encodingFormat": kind, "contentSize": str(len(data)), "sha256": hashlib.sha256(data).hexdigest(),
    }  # fmt: skip


def changed_files(folder: Path) -> Iterator[str]:
    """Yield a line for each file of a folder that is not what its metadata record; nothing without metadata.

    Raises:
        InputError: the metadata are no RO-Crate metadata.
    """
    path = folder / NAME
    if not path.is_file():
        return
    try:
        graph = json.loads(path.read_bytes())["@graph"]
        known = {e["@id"]: e["sha256"] for e in graph if e["@type"] == "File"}
    except OSError as error:
        raise readable(error, path) from None
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"{path}: is not RO-Crate metadata with a SHA-256 of each file",
            "delete it to verify the report without it, or run the study again",
        ) from None
    for name, sha256 in known.items():
        file = folder / unquote(name)
        if not file.is_file():
            yield f"{unquote(name)}: {NAME} records it, but it is missing"
        elif hashlib.sha256(file.read_bytes()).hexdigest() != sha256:
            yield f"{unquote(name)}: its content is not what {NAME} records"
