"""`fit_k92`, `fit_a_theta`, `compare`, `study`, `discover`, `plan_next`: the model held against trials."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from granite_lab import __version__, fitting, reporting
from granite_lab.api import calls
from granite_lab.api.calls import Arg, checked
from granite_lab.api.project import Chain, Fit, Logs, Search, choose
from granite_lab.api.records import Origin, Records
from granite_lab.comparison.compare import Comparison
from granite_lab.discovery.finding import DESIGN, MODEL, Finding
from granite_lab.effects import library
from granite_lab.errors import InputError, UsageError
from granite_lab.files import refuse_special
from granite_lab.fitting.fit import AThetaFit, K92Fit
from granite_lab.folders import files_of
from granite_lab.logs.trial import name_of, trial_files
from granite_lab.results import Failure, StudyResult, TrialResult, load_report
from granite_lab.running import Execution, Options, each_trial, sifted
from granite_lab.running.cache import code, digest_of, fingerprint
from granite_lab.running.codec import content, encode
from granite_lab.running.options import corrected
from granite_lab.running.output import Guard, claimed, tell

if TYPE_CHECKING:
    from granite_lab.planning.plan import Plan
    from granite_lab.study import Written


PAGES = ("index.html", "report.md")
"""Files of every report: where others stand in their place, it is told before the work."""


def _analysed(command: str, logs: Logs, said: Fit) -> tuple[list[TrialResult], Origin]:
    """Return the trials that went through the chain, and what is to be said of all."""
    choice = choose(logs, said)
    from granite_lab.study import analyse, source_of  # noqa: PLC0415, heavy

    outcomes = each_trial(
        analyse, choice.files, choice.options, execution=choice.execution, done=said["done"]
    )
    found, failed = sifted(choice.files, outcomes, strict=said["strict"])
    lines = [f"{r.trial.name}: {line}" for r in found for line in r.comparison.motion.warnings]
    source = source_of(command, choice.files, [r.trial for r in found], choice.options)
    warnings = (*lines, *choice.execution.tidied())
    return found, Origin(source, (*choice.excluded, *failed), warnings)


@checked
def fit_k92(logs: Logs, **said: Unpack[Fit]) -> Records[K92Fit]:
    """Fit k_92 of each trial: by the steady slip ratio, as in the paper, and by the whole trajectory.

    Args:
        logs: paths of logs, or of folders with logs.

    Returns:
        one fit a trial; the table has a row for each.

    Raises:
        InputError: a log or file cannot be used.
        EstimateError: an estimate or fit cannot be had.
    """
    found, origin = _analysed("fit-k92", logs, said)
    return Records([result.comparison.fit for result in found], (), origin)


@checked
def fit_a_theta(
    logs: Logs | Sequence[K92Fit] = (), *, published: bool = False, **said: Unpack[Fit]
) -> AThetaFit:
    """Estimate a_θ of k_92 = exp(-a_θ v) over trials, beside the paper's 4.919 and rival laws.

    Args:
        logs: paths of logs or of folders, or the fits of `fit_k92`.
        published: use Table 3 of the paper instead of trials.

    Returns:
        the fit; its table has a row for each trial.

    Raises:
        UsageError: both or neither of `logs` and `published`.
        InputError, EstimateError: as in `fit_k92`, or the trials do not allow the fit.
    """
    fit, origin = a_theta_of(logs, published=published, **said)
    left_out = (f"{one.trial} left out: {one.reason}" for one in origin.left_out)
    return replace(fit, notes=(*fit.notes, *left_out))


@checked
def a_theta_of(
    logs: Logs | Sequence[K92Fit] = (), *, published: bool = False, **said: Unpack[Fit]
) -> tuple[AThetaFit, Origin]:
    """Run `fit_a_theta`, and say where the fit comes from."""
    if published and (isinstance(logs, (str, Path)) or len(logs) > 0):
        raise UsageError("--published takes no trials", "leave out one of the two")
    given = [logs] if isinstance(logs, (str, Path)) else list(logs)
    fits, origin = [item for item in given if isinstance(item, K92Fit)], Origin()
    if not (published or fits):
        found, origin = _analysed("fit-atheta", [x for x in given if not isinstance(x, K92Fit)], said)
        fits = [result.comparison.fit for result in found]
    by_name = sorted(fits, key=lambda fit: fit.trial)  # sums do not depend on the order of the logs
    return fitting.published_fit() if published else fitting.fit_a_theta(by_name), origin


@checked
def compare(logs: Logs, *, out: calls.File = None, **said: Unpack[Fit]) -> Records[Comparison]:
    """Compare measured and simulated motion: velocity, wheel speed, slip, torques and pitch.

    Args:
        logs: paths of logs, or of folders with logs.
        out: folder for tables and figures; without it nothing is written.

    Returns:
        one comparison a trial; the table has a row for each trial, channel and phase.

    Raises:
        InputError, EstimateError: as in `fit_k92`.
        LabError: a file cannot be written.
    """
    found, origin = _analysed("compare", logs, said)
    comparisons = [result.comparison for result in found]
    if out is not None:
        origin = replace(origin, written=tuple(reporting.write_comparison(comparisons, Path(out))))
    return Records(comparisons, [result.trial.name for result in found], origin)


@checked
def studied(logs: Logs, **said: Unpack[Chain]) -> tuple[Written, Origin]:
    """Run `study`, and say what was written; what could not be written is no error here."""
    choice, progress = choose(logs, said), said["progress"]
    from granite_lab.study import Written, record, write  # noqa: PLC0415, heavy
    from granite_lab.study import study as run  # noqa: PLC0415, heavy

    folder = None if said["out"] is None else Path(said["out"])
    options, execution, cache = choice.options, choice.execution, choice.execution.cache
    with claimed(folder, PAGES) if folder else nullcontext():
        result = run(
            choice.files, folder.name if folder else "study", options, execution=execution,
            discover=said["discover"], strict=said["strict"], done=said["done"], progress=progress,
        )  # fmt: skip
        result = replace(result, failures=(*result.failures, *choice.excluded))
        origin = Origin(result.source, result.failures, execution.tidied())
        if folder is None:
            return Written(result), origin
        key = digest_of(code(shows=True), content(result), content(options), said["recordings"])
        known: dict[str, str] | None = cache.get(key) if cache is not None else None
        if known and all(fingerprint(folder / name) == sha for name, sha in known.items()):
            model = folder / MODEL if MODEL in known else None
            return Written(result, folder / "index.html", model, unchanged=True), origin
        guard, jobs = Guard(folder), execution.jobs
        if said["recordings"]:
            place = folder / "recordings"
            guard.run("recordings", lambda: record(result, place, jobs=jobs, progress=progress))
        progress("report", 0)
        written = write(result, options, folder, failures=guard.lines, jobs=jobs)
        if cache is not None and not written.failures:
            known = {path.relative_to(folder).as_posix(): fingerprint(path) for path in files_of(folder)}
            cache.put(key, encode(((), known)))
    return written, origin


@checked
def study(logs: Logs, **said: Unpack[Chain]) -> StudyResult:
    """Analyse trials: estimate, fit, simulate, compare, a_θ, and the missing effect.

    A trial that cannot be used is left out and listed with the reason.

    Args:
        logs: paths of logs, or of folders with logs.

    Returns:
        the results; the table has a row for each trial.

    Raises:
        LabError: no trial went through, or a file cannot be written.
    """
    written, _ = studied(logs, **said)
    tell(written.failures)
    return written.result


@checked
def record(result: StudyResult, folder: str | Path) -> tuple[Path, ...]:
    """Write a Rerun recording of each trial of a study, and one of the whole; return their paths.

    Raises:
        LabError: a file cannot be written.
    """
    from granite_lab.study import record as record_all  # noqa: PLC0415, heavy

    return tuple(record_all(result, Path(folder)))


@checked
def report(result: StudyResult, folder: str | Path) -> Path:
    """Write the report of a study; return its first page.

    Raises:
        LabError: a file cannot be written.
    """
    model = MODEL if result.finding is not None else None
    return reporting.write_report(result, Path(folder), model=model)


@checked
def discovered(logs: Logs, *, out: calls.File = None, **said: Unpack[Search]) -> tuple[Written, Origin]:
    """Run `discover`, and say what was written."""
    choice, progress = choose(logs, said), said["progress"]
    execution, options = choice.execution, choice.options

    def ahead(_: Path) -> None:  # imports what follows while other processes work on the trials
        import granite_lab.study  # noqa: F401, PLC0415, heavy

    outcomes = each_trial(corrected, choice.files, options, execution=execution, done=ahead)
    from granite_lab.running.search import search  # noqa: PLC0415, heavy
    from granite_lab.study import Written, source_of, write  # noqa: PLC0415, heavy

    read, failed = sifted(choice.files, outcomes, strict=said["strict"])
    left_out = (*choice.excluded, *failed)
    trials, motions = [trial for trial, _, _ in read], [motion for _, _, motion in read]
    finding = search(trials, options, motions=motions, execution=execution, progress=progress)
    notes = (*finding.notes, *(f"{one.trial} left out: {one.message}" for one in left_out))
    source, name = source_of("discover", choice.files, trials, options), Path(out or "").resolve().name
    written = Written(StudyResult(name, (), (), None, source, replace(finding, notes=notes)))
    if out is not None:
        progress("writing the report", 0)
        with claimed(Path(out), PAGES):
            pairs = list(zip(trials, motions, strict=True))
            written = write(written.result, options, Path(out), pairs, jobs=execution.jobs)
    lines = (f"{trial.name}: {line}" for trial in trials for line in trial.warnings)
    return written, Origin(source, left_out, (*lines, *execution.tidied()))


@checked
def discover(logs: Logs, *, out: calls.File = None, **said: Unpack[Search]) -> Finding:
    """Find the physical effect that the model lacks.

    Args:
        logs: paths of logs, or of folders with logs; all of one robot on one soil.
        out: folder for the report, finding.json, design.json (for `plan_next`) and model.toml; without it
            nothing is written.

    Returns:
        the finding; its table has a row for each candidate. Its `failures` say what could not be written.

    Raises:
        InputError: a log cannot be used, or nothing says what was commanded.
        EstimateError: a trial has no sensor to compare with, or the simulation fails.
    """
    finding = discovered(logs, out=out, **said)[0].result.finding
    assert finding is not None
    return finding


@checked
def plan_next(
    folder: str | Path,
    *,
    room: Annotated[float | None, Arg(low=0.1)] = None,
    max_speed: Annotated[float | None, Arg(low=0.02)] = None,
    effects: calls.EffectFile = None,
    jobs: calls.Jobs = 0,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Plan:
    """Propose the most useful next trial.

    Args:
        folder: folder written by `discover` or `study`.
        room: longest distance that fits on the sand [m]; by default the longest so far.
        max_speed: fastest command [m/s]; by default 1.25 times the fastest so far.
        progress: told how many trials are looked at, and of how many.

    Returns:
        the proposals; the table has a row for each.

    Raises:
        InputError: the folder holds no search.
        UsageError: a named effect is neither in the library nor in the effect file.
        EstimateError: the trials at hand cannot be simulated.
    """
    refuse_special(Path(folder))
    path = Path(folder) / DESIGN
    if not path.is_file():
        raise InputError(
            f"{folder}: holds no search for a missing effect ('{DESIGN}' is missing)",
            f"run 'granite-lab discover TRIALS… --out {folder}', or 'study' without --no-discover, first",
        )
    from granite_lab.planning.design import load_design  # noqa: PLC0415, heavy
    from granite_lab.planning.plan import plan_next as rank  # noqa: PLC0415, heavy

    return rank(
        load_design(path), library(effects),
        room=room, max_speed=max_speed, jobs=jobs or os.cpu_count() or 1, progress=progress,
    )  # fmt: skip


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
    effects: Path | None = None,
    execution: Execution,
    done: Callable[[Path], None] = lambda _: None,
    progress: Callable[[str, int], None] = lambda *_: None,
) -> Verification:
    """Compute a report again from its inputs, nothing remembered, and compare its numbers and tables.

    The files of the report are first compared with the hashes in its ``report.json``. Nothing that a report
    names is run: the user's own effects come from `effects` alone.

    Args:
        report: a report's folder or its ``report.json``.
        logs: the logs, where they no longer lie where the report says.
        effects: the file of the user's own effects, where the report was made with one.
        done, progress: as in `study`.

    Raises:
        InputError: no report, or its logs cannot be found.
        UsageError: the report was made with effects of a file, and none is given, or the other way round.
        LabError: of `study`.
    """
    path = report / "report.json" if report.is_dir() else report
    old = load_report(path)
    from granite_lab.study import study as run  # noqa: PLC0415, heavy
    from granite_lab.study import write  # noqa: PLC0415, heavy

    origin = old["provenance"]
    excluded = tuple(f for f in (Failure(**f) for f in old["failures"]) if f.excluded)
    left_out = {failure.trial for failure in excluded}
    files = trial_files(logs) if logs else list(_recorded(old, left_out, path))
    files = [file for file in files if name_of(file) not in left_out]
    said = [(o["name"], o["value"]) for o in origin["options"]]
    options = replace(Options.from_given(said), effects=_agreed(dict(said).get("effects"), effects, path))
    differences = list(reporting.json_report.changed_files(old, path))
    result = run(
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
    own = {
        "provenance": {"options": options, "parameters": origin["parameters"]},
        "inputs": {Path(i["file"]).name: i["sha256"] for i in origin["inputs"]},
        "files": {
            table["csv"]: fingerprint(folder / table["csv"])
            for table in document["tables"]
            if table["id"] != "inputs"  # which holds paths; the hashes are compared above
        },
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
