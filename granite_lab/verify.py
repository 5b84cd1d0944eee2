"""A report against itself: everything computed again from its inputs, and what differs then."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from granite_lab import __version__
from granite_lab.errors import InputError
from granite_lab.files import readable
from granite_lab.logs.named import name_of, trial_files
from granite_lab.reporting.content import Failure
from granite_lab.reporting.crate import changed_files
from granite_lab.reporting.json_report import SCHEMA
from granite_lab.running import Execution, Options
from granite_lab.running.fingerprint import code, fingerprint
from granite_lab.study import EXCLUDED, study, write


@dataclass(frozen=True)
class Verification:
    """What came out of a report that was made again.

    Attributes:
        report: its ``report.json``.
        trials: how many were computed again.
        differences: what differs, one line each; empty where the report can be made again byte by byte.
        notes: what a reader should know besides, such as another version.
    """

    report: Path
    trials: int
    differences: tuple[str, ...]
    notes: tuple[str, ...]


def verify(
    report: Path,
    logs: Sequence[Path] = (),
    *,
    execution: Execution,
    done: Callable[[Path], None] = lambda _: None,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> Verification:
    """Compute a report again from its inputs, nothing remembered, and compare numbers and tables.

    The files of the report are first compared with its ``ro-crate-metadata.json``, where it has one.

    Args:
        report: a report's folder or its ``report.json``.
        logs: the logs, where they no longer lie where the report says.
        execution: where the work is done.
        done, progress: as in `study`.

    Raises:
        InputError: no report, or its logs cannot be found.
        LabError: of `study`.
    """
    path = report / "report.json" if report.is_dir() else report
    old = _load(path)
    origin = old["provenance"]
    excluded = [Failure(**f) for f in old["failures"] if f["message"].startswith(EXCLUDED)]
    left_out = {failure.trial for failure in excluded}
    names = [t["name"] for t in old["trials"]] + [f["trial"] for f in old["failures"]]
    names = [name for name in names if name not in left_out]
    files = trial_files(logs) if logs else _recorded(origin, names, path)
    files = [file for file in files if name_of(file) not in left_out]
    said = [(o["name"], o["value"]) for o in origin["options"]]
    options = Options.from_given(said)
    differences = [*changed_files(path.parent), *_inputs(origin, [*files, *options.files()])]
    how = Execution(execution.jobs, execution.scheduler)
    searching = ("discover", "no") not in said
    result = study(
        files, old["name"], options, execution=how, discover=searching, done=done, progress=progress
    )
    result = replace(result, failures=(*result.failures, *excluded))
    with tempfile.TemporaryDirectory(prefix="granite-lab-verify-") as temporary:
        folder = Path(temporary) / "report"
        write(result, options, folder)
        new = _load(folder / "report.json")
        differences += _leaves(_results(old), _results(new))
        differences += _tables(path.parent / "tables", folder / "tables")
    notes = []
    if origin["version"] != __version__ or origin["code_sha256"] != code(search=True):
        notes.append(
            f"the report was made by granite-lab {origin['version']}, whose sources or libraries were not "
            f"those of this {__version__}"
        )
    return Verification(path, len(files), tuple(differences), tuple(notes))


def _load(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_bytes())
    except OSError as error:
        raise readable(error, path) from None
    except ValueError:
        raise InputError(f"{path}: is not JSON", "give the folder of a report") from None
    origin = document.get("provenance") if isinstance(document, dict) else None
    if origin is None or document.get("schema") != SCHEMA or "options" not in origin:
        raise InputError(
            f"{path}: is not a report that can be made again", "give a folder that 'granite-lab study' wrote"
        )
    return dict(document)


def _recorded(origin: dict[str, Any], names: Sequence[str], report: Path) -> list[Path]:
    """Return the logs where the report found them."""
    paths = [Path(i["file"]) for i in origin["inputs"]]
    logs = {name_of(p): p for p in paths[::-1] if p.suffix.lower() not in (".toml", ".py")}
    for name in names:
        if name not in logs or not logs[name].exists():
            raise InputError(
                f"{report}: the log of trial '{name}' is not where the report found it",
                "go to the folder the study was run in, or name the logs before --verify",
            )
    return [logs[name] for name in names]


def _inputs(origin: dict[str, Any], files: Sequence[Path]) -> Iterator[str]:
    known = {Path(i["file"]).name: i["sha256"] for i in origin["inputs"]}
    for path in files:
        if path.name not in known:
            yield f"{path}: is no input of the report"
        elif fingerprint(path) != known[path.name]:
            yield f"{path}: its content is not what the report was made from"


def _results(document: dict[str, Any]) -> dict[str, Any]:
    """Leave out what does not come from the logs: how the command was written."""
    origin = {k: v for k, v in document["provenance"].items() if k in ("options", "parameters")}
    return document | {"provenance": origin}


def _leaves(old: Any, new: Any, place: str = "") -> Iterator[str]:
    """Yield a line for each value that differs."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(old.keys() | new.keys()):
            if key not in old or key not in new:
                yield f"{place}{key}: {'only in the report' if key in old else 'missing in the report'}"
            else:
                yield from _leaves(old[key], new[key], f"{place}{key}.")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for i, (a, b) in enumerate(zip(old, new, strict=True)):
            name = a.get("name", a.get("id", i)) if isinstance(a, dict) else i
            yield from _leaves(a, b, f"{place}{name}.")
    elif old != new:
        yield f"{place.rstrip('.')}: {_short(old)} in the report, {_short(new)} now"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}…"


def _tables(old: Path, new: Path) -> Iterator[str]:
    for path in sorted(new.glob("*.csv")):
        known = old / path.name
        if not known.is_file():
            yield f"tables/{path.name}: missing in the report"
        elif known.read_bytes() != path.read_bytes():
            yield f"tables/{path.name}: differs"
