"""`verify`: a report made again from its inputs, and compared."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from granite_lab import __version__, reporting
from granite_lab.api.arguments import File, Logs, execution_of
from granite_lab.api.project import choose
from granite_lab.chain import over_trials
from granite_lab.errors import InputError, UsageError
from granite_lab.logs.trial import name_of, trial_files
from granite_lab.options import Options
from granite_lab.origin import Failure
from granite_lab.processes import Progress
from granite_lab.results import load_report
from granite_lab.running.cache import code, fingerprint
from granite_lab.running.output import raise_failed


@dataclass(frozen=True)
class Verification:
    """A report (``report.json``) that was made again from a number of trials.

    The differences, one line each, are empty where it can be made again byte by byte; notes name another
    version.
    """

    report: Path
    trials: int
    differences: tuple[str, ...]
    notes: tuple[str, ...]


def verify(
    report: str | Path,
    logs: Logs = (),
    *,
    effects: File = None,
    jobs: int = 0,
    scheduler: str | None = None,
    done: Callable[[Path], None] = lambda _: None,
    progress: Progress = lambda *_: None,
) -> Verification:
    """Compute a report again from its inputs, without stored results, and compare numbers and tables.

    The files of the report are first compared with the hashes in its ``report.json``. Nothing that a report
    names is run: the user's own effects come from `effects` alone.

    Args:
        report: a report's folder or its ``report.json``.
        logs: the logs, where they were moved since the report was made.
        effects: the file of the user's own effects, where the report was made with one.
        jobs, scheduler, done, progress: as in `study`.

    Raises:
        InputError: no report, or its logs cannot be found.
        UsageError: the report was made with effects of a file, and none is given, or the other way round.
        LabError: of `study`.
    """
    path = Path(report) / "report.json" if Path(report).is_dir() else Path(report)
    old = load_report(path)
    from granite_lab.study_folder import write  # noqa: PLC0415, heavy

    origin = old["provenance"]
    excluded = tuple(f for f in (Failure(**f) for f in old["failures"]) if f.excluded)
    left_out = {failure.trial for failure in excluded}
    given = [logs] if isinstance(logs, (str, Path)) else logs
    files = trial_files(given) if given else list(_recorded(old, left_out, path))
    files = [file for file in files if name_of(file) not in left_out]
    stated = [(o["name"], o["value"]) for o in origin["options"]]
    trusted = _agreed(dict(stated).get("effects"), None if effects is None else Path(effects), path)
    options = replace(Options.from_given(stated), effects=trusted)
    options = replace(options, of_trials=choose(files, options, everything=True).options.of_trials)
    differences = list(reporting.json_report.changed_files(old, path))
    result = over_trials(
        files, options, execution=execution_of(jobs, scheduler),
        discover=("discover", "no") not in stated, done=done, progress=progress,
    )  # fmt: skip
    result = replace(result, name=old["name"], failures=(*result.failures, *excluded))
    with tempfile.TemporaryDirectory(prefix="granite-lab-verify-") as temporary:
        folder = Path(temporary) / "report"
        raise_failed(write(result, options, folder).written.failures)
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


def _agreed(named: str | None, given: Path | None, report: Path) -> Path | None:
    """Return the given file of effects, if a report was made with one, too."""
    if named is not None and given is None:
        raise UsageError(
            f"{report}: was made with the effect file '{named}', which a verification would run",
            f"read that file; if you trust it, add --effects {named}",
        )
    if given is not None and named is None:
        raise UsageError(f"{report}: was made without an effect file", "leave out --effects")
    return given


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
    options = [
        o | {"value": Path(o["value"]).name} if o["name"] == "effects" else o for o in origin["options"]
    ]
    content = {
        "provenance": {"options": options, "parameters": origin["parameters"]},
        "inputs": {Path(i["file"]).name: i["sha256"] for i in origin["inputs"]},
        "files": {
            table["csv"]: fingerprint(folder / table["csv"])
            for table in document["tables"]
            if table["id"] != "inputs"  # which holds paths; the hashes are compared above
        },
    }
    return dict(_leaves(document | content))


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
