"""One hidden set from beginning to end: made, searched with the user's command, opened, judged.

``python -m benchmarks.blind_set JSON`` prints one line of JSON; `benchmarks.blind` calls it.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.blind_code import origin
from benchmarks.blind_schedule import REFERENCES, Detectable, Task, wish_of
from granite_lab.cli import app
from granite_lab.effects import library
from granite_lab.errors import EstimateError, LabError
from granite_lab.hidden.making import make_set
from granite_lab.hidden.scoring import Score, score
from granite_lab.hidden.sealed import NAME, open_answer, seal
from granite_lab.hidden.wish import Wish
from granite_lab.logs import write_canonical
from granite_lab.parameters import Variant, load_robot, load_soil

ROBOT, SOIL = "granite", "dry_sand"

LIMIT = 900
"""Longest that a set may take [s of CPU time]."""

SHRINK = 0.7
"""Step by which an effect is made smaller that would make the robot dig itself in."""


def hide(
    wish: Wish, folder: Path, repetitions: int = 3, variants: tuple[Variant, ...] = ()
) -> tuple[Wish, float]:
    """Write a set; return the wish as it was fulfilled, and the factor on its sizes.

    Args:
        wish: what to hide.
        folder: of the set.
        repetitions: of each variant.
        variants: those of Table 2 when empty.

    Raises:
        EstimateError: the robot digs itself in whatever the size.
    """
    robot, soil, factor = load_robot(ROBOT), load_soil(SOIL), 1.0
    for attempt in range(8):
        smaller = replace(
            wish,
            sizes={name: factor * value for name, value in wish.sizes.items()},
            strength=wish.strength * (1.0 if wish.sizes else factor),
        )
        try:
            trials, answer = make_set(smaller, robot, soil, repetitions=repetitions, variants=variants)
        except EstimateError:
            if wish.effect == "none" or attempt == 7:
                raise
            factor *= SHRINK
            continue
        for trial in trials:
            write_canonical(folder / f"{trial.name}.csv", trial)
        (folder / NAME).write_bytes(seal(answer))
        break
    return smaller, factor


def discover(folder: Path) -> dict[str, Any]:
    """Run `granite-lab discover --json` and return its document.

    Raises:
        LabError: as the command does.
    """
    printed, said = io.StringIO(), io.StringIO()
    arguments = ["discover", str(folder), "--out", str(folder / "out"), "--json", "--quiet", "--no-cache"]
    arguments += ["--jobs", "1"]
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        app(arguments, standalone_mode=False)
    document: dict[str, Any] = json.loads(printed.getvalue())
    return document


def run(
    task: Task,
    detectable: Detectable,
    folder: Path | None = None,
    repetitions: int = 3,
    variants: tuple[Variant, ...] = (),
) -> dict[str, Any]:
    """Make, search and judge one set; return the line for the results file.

    Args:
        task: which set.
        detectable: smallest detectable sizes, which the task's strength multiplies.
        folder: where the set stays; without one it is deleted.
        repetitions: of each variant.
        variants: those of Table 2 when empty.
    """
    line: dict[str, Any] = {
        "key": task.key,
        **task.record(),
        **origin(),
        "status": "crashed",
    }
    with contextlib.ExitStack() as stack:
        place = folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="granite-blind-")))
        place.mkdir(parents=True, exist_ok=True)
        start = time.process_time()
        cpu: dict[str, float] = {}
        line["cpu"] = cpu
        try:
            wish, reached = wish_of(task, detectable)
            wish, factor = hide(wish, place, repetitions, variants)
            line["reached"] = {name: round(factor * x, 3) for name, x in reached.items()}
            cpu["make"] = round(time.process_time() - start, 2)
            start = time.process_time()
            document = discover(place)
            cpu["discover"] = round(time.process_time() - start, 2)
            answer = open_answer(place)
            line |= result_of(document, answer, score(answer, document)) | {"status": "judged"}
        except LabError as error:
            line |= {
                "status": "refused" if "make" in cpu else "not made",
                "error": f"{error.message} ({error.hint})",
            }
        except Exception:  # a crash is a result, too
            line["error"] = traceback.format_exc(limit=-6)
    return line


def result_of(document: Mapping[str, Any], answer: Mapping[str, Any], judged: Score) -> dict[str, Any]:
    """Return what the results file keeps of a discovery."""
    truth = {
        effect["id"]: {name: _short(p["value"]) for name, p in effect["parameters"].items()}
        for effect in answer["effects"]
    }
    shapes = {id_: {p.name for p in effect.parameters if p.shape} for id_, effect in library().items()}
    return {
        "truth": truth,
        "sand": {name: _short(x) for name, x in answer["sand_off"].items()},
        "outcome": judged.outcome,
        "right": judged.right,
        "verdict": judged.verdict,
        "found": [
            {
                "id": effect["id"],
                "twins": effect.get("indistinguishable_from") or [],
                "empirical": bool(effect.get("empirical")),
                "parameters": {
                    name: [_short(p["value"]), _short(p["std"])] for name, p in effect["parameters"].items()
                },
            }
            for effect in document["effects"]
        ],
        "parameters": [
            {
                "effect": p.effect,
                "name": p.name,
                "kind": "shape" if p.name in shapes.get(p.effect, ()) else p.kind,
                "true": _short(p.true),
                "value": _short(p.value),
                "std": _short(p.std),
                "z": _short(p.z),
            }
            for p in judged.parameters
        ],
        "gap": {part: [_short(x) for x in document["gap"][part].values()] for part in document["gap"]},
        "closed": {part: _short(x) for part, x in judged.gap_closed.items()},
        "threshold": _short(document.get("threshold")),
        "candidates": [
            [c["id"], _short(c["evidence"]), c["status"]] for c in (document.get("candidates") or [])[:4]
        ],
        "own_detectable": {
            f"{d['id']}.{d['parameter']}": _short(d["size"])
            for d in document.get("detectable") or []
            if d["id"] in truth
        },
        "notes": document.get("notes") or [],
    }


def detectable_of(noise: float) -> dict[str, dict[str, float | None]]:
    """Return the smallest detectable sizes that the tool computes for sets without an effect: their median.

    What one set lets be seen depends on its sand and its noise, for some effects by half.
    """
    found: dict[str, dict[str, list[float]]] = {}
    for seed in range(1, REFERENCES + 1):
        with tempfile.TemporaryDirectory(prefix="granite-blind-") as name:
            hide(Wish("none", seed, noise=noise), Path(name))
            document = discover(Path(name))
        for entry in document["detectable"]:
            size = math.inf if entry["size"] is None else float(entry["size"])
            found.setdefault(entry["id"], {}).setdefault(entry["parameter"], []).append(size)
    return {id_: {name: _short(median(sizes)) for name, sizes in own.items()} for id_, own in found.items()}


def _short(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(f"{value:.5g}")


def _too_long(*_: object) -> None:
    raise TimeoutError(f"longer than {LIMIT} s of CPU time")


def main() -> None:
    """Do what the argument asks and print one line."""
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT + 10))
    signal.signal(signal.SIGXCPU, _too_long)
    asked = json.loads(sys.argv[1])
    if "detectable_at" in asked:
        found: dict[str, Any] = origin() | {"sizes": detectable_of(asked["detectable_at"])}
    else:
        folder = Path(asked["folder"]) if asked.get("folder") else None
        found = run(Task(**asked["task"]), asked["detectable"], folder)
    print(json.dumps(found, allow_nan=False))


if __name__ == "__main__":
    main()
