"""A report against itself: everything computed again from its inputs, and what differs then."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from granite_lab import __version__, reporting
from granite_lab.errors import InputError
from granite_lab.logs.named import name_of, trial_files
from granite_lab.results import Failure, load_report
from granite_lab.running import Execution, Options
from granite_lab.running.cache import code, fingerprint
from granite_lab.running.output import tell


@dataclass(frozen=True)
class Verification:
    """A report (``report.json``) that was made again from a number of trials.

    The differences, one line each, are empty where it can be made again byte by byte; notes tell of another
    version.
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
        done, progress: as in `study`.

    Raises:
        InputError: no report, or its logs cannot be found.
        LabError: of `study`.
    """
    path = report / "report.json" if report.is_dir() else report
    old = load_report(path)
    from granite_lab.study import study, write  # noqa: PLC0415, heavy

    origin = old["provenance"]
    excluded = tuple(f for f in (Failure(**f) for f in old["failures"]) if f.excluded)
    left_out = {failure.trial for failure in excluded}
    files = trial_files(logs) if logs else list(_recorded(old, left_out, path))
    files = [file for file in files if name_of(file) not in left_out]
    said = [(o["name"], o["value"]) for o in origin["options"]]
    options = Options.from_given(said)
    differences = list(reporting.json_report.changed_files(path.parent))
    result = study(
        files, old["name"], options, execution=Execution(execution.jobs, execution.scheduler),
        discover=("discover", "no") not in said, done=done, progress=progress,
    )  # fmt: skip
    result = replace(result, failures=(*result.failures, *excluded))
    with tempfile.TemporaryDirectory(prefix="granite-lab-verify-") as temporary:
        folder = Path(temporary) / "report"
        tell(write(result, options, folder).failures)
        was, now = _values(old, path.parent), _values(load_report(folder / "report.json"), folder)
    for place in sorted(was.keys() | now.keys()):
        if place not in now:
            differences.append(f"{place}: only in the report")
        elif place not in was:
            differences.append(f"{place}: missing in the report")
        elif was[place] != now[place]:
            differences.append(f"{place}: {was[place]:.60} in the report, {now[place]:.60} now")
    version = origin["version"]
    other = f"granite-lab {version}, whose sources or libraries were not those of this {__version__}"
    same = version == __version__ and origin["code_sha256"] == code()
    notes = () if same else (f"the report was made by {other}",)
    return Verification(path, len(files), tuple(differences), notes)


def _recorded(document: dict[str, Any], left_out: Collection[str], report: Path) -> Iterator[Path]:
    """Yield the logs where the report found them."""
    paths = [Path(i["file"]) for i in document["provenance"]["inputs"]]
    logs = {name_of(p): p for p in paths[::-1] if p.suffix.lower() not in (".toml", ".py")}
    names = [t["name"] for t in document["trials"]] + [f["trial"] for f in document["failures"]]
    for name in names:
        if name in logs and logs[name].exists():
            yield logs[name]
        elif name not in left_out:
            raise InputError(
                f"{report}: the log of trial '{name}' is not where the report found it",
                "go to the folder the study was run in, or name the logs before --verify",
            )


def _values(document: dict[str, Any], folder: Path) -> dict[str, str]:
    """Return the values of a report by their place, with the hashes of inputs and tables."""
    origin = document["provenance"]
    own = {
        "provenance": {key: origin[key] for key in ("options", "parameters")},
        "inputs": {Path(i["file"]).name: i["sha256"] for i in origin["inputs"]},
        "files": {table["csv"]: fingerprint(folder / table["csv"]) for table in document["tables"]},
    }
    return dict(_leaves(document | own))


def _leaves(value: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Yield each value of a document with its place."""
    if isinstance(value, dict):
        for key, inside in value.items():
            yield from _leaves(inside, f"{place}.{key}")
    elif isinstance(value, list):
        names = [v.get("name", v.get("id", i)) if isinstance(v, dict) else i for i, v in enumerate(value)]
        for i, inside in enumerate(value):
            yield from _leaves(inside, f"{place}.{names[i] if names.count(names[i]) == 1 else i}")
    else:
        yield place.removeprefix("."), json.dumps(value, ensure_ascii=False)
