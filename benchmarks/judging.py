"""Sets of trials, searched and judged side by side: what the benchmarks of `discover` have in common."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any, TypeVar

import granite_lab
from benchmarks.lines import Line
from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import Finding
from granite_lab.errors import LabError
from granite_lab.hidden.scoring import Score, score

T = TypeVar("T")
R = TypeVar("R")

Work = tuple[Callable[..., R], tuple[Any, ...]]
"""A function that makes and judges a set, as a rule returning a line, and its arguments."""


def as_judged(pool: Executor, following: Callable[[], Work[R] | None], jobs: int) -> Iterator[R]:
    """Yield what comes out of sets as they are judged, so many side by side.

    Args:
        pool: that does the work.
        following: returns the work that is to be begun next; None where there is none now.
        jobs: how many sets side by side.
    """
    running: set[Future[R]] = set()
    while True:
        while len(running) < jobs and (work := following()) is not None:
            function, given = work
            running.add(pool.submit(function, *given))
        if not running:
            return
        ended, running = wait(running, return_when=FIRST_COMPLETED)
        yield from (future.result() for future in ended)


def parallel(judge: Callable[[T], R], sets: Sequence[T], minutes: float, jobs: int) -> Iterator[R]:
    """Yield what comes out of sets as they are judged, each in a process; none is begun after `minutes`."""
    end, waiting = time.monotonic() + 60 * minutes, list(sets)

    def following() -> Work[R] | None:
        return (judge, (waiting.pop(0),)) if waiting and time.monotonic() < end else None

    with ProcessPoolExecutor(jobs) as pool:
        yield from as_judged(pool, following, jobs)


def attempted(work: Callable[[], Line]) -> Line:
    """Return the line that some work makes; of work that fails, one that says why."""
    try:
        return work()
    except LabError as error:
        return {"status": "refused", "error": f"{error.message} ({error.hint})"}
    except Exception:  # a crash is a result
        return {"status": "crashed", "error": traceback.format_exc(limit=-4)}


def searched(logs: list[Path], jobs: int = 1, drive: str = "auto") -> Line:
    """Search some logs and return what came out, as JSON holds it; a failure becomes a line, too."""
    start = time.monotonic()
    line = attempted(
        lambda: document_of(granite_lab.discover(logs, jobs=jobs, drive=drive)) | {"status": "judged"}
    )
    return line | {"seconds": round(time.monotonic() - start, 1)}


def document_of(finding: Finding) -> Line:
    """Return what a judge needs of a finding: the keys of `discover --json` that count."""
    document = finding_as_json(finding)
    kept = ("verdict", "probability", "remainder", "effects", "description", "gap", "closed")
    return {key: document[key] for key in kept} | {
        "ceiling": None if finding.ceiling is None else short(finding.ceiling.value),
        "detectable": {f"{d.effect}.{d.parameter}": short(d.size) for d in finding.detectable},
    }


def judged(line: Line, answer: Mapping[str, Any]) -> Line:
    """Return a line with the judgement of its finding; one that failed is not right."""
    if line["status"] != "judged":
        return line | {"outcome": line["status"], "right": False}
    s = score(answer, line)
    return line | {
        "outcome": s.outcome,
        "right": s.right,
        "closed": short(s.gap_closed["held_out"]),
        "stated": stated(s),
        "parameters": [
            {"effect": p.effect, "name": p.name, "kind": p.kind, "true": short(p.true),
             "value": short(p.value), "std": short(p.std), "z": short(p.z)}
            for p in s.parameters
        ],
    }  # fmt: skip


def stated(judged: Score) -> list[tuple[str, float, bool]]:
    """Return effect, stated probability and whether it is right, of all that was named or described."""
    return [(one.id, round(one.probability, 5), one.right) for one in judged.stated]


def wrong_name(line: Mapping[str, Any]) -> bool:
    """Tell whether something was named that is not hidden."""
    wrong = ("wrong_name", "near_twin", "spurious", "false_alarm")
    return line.get("verdict") in ("named", "partly named") and line["outcome"] in wrong


def named(line: Mapping[str, Any]) -> str:
    """Return the names that were given, twins behind a slash."""
    sets = ("/".join([e["id"], *e["indistinguishable_from"]]) for e in line.get("effects", []))
    return "+".join(sets)


def short(value: float | None) -> float | None:
    """Return five digits; None for what is no number."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.5g}")
