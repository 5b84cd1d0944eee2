"""Does `discover` find several causes at once? Mixtures that `hide` draws, judged name by name.

Each seed is a set of its own: two to five causes, half of the sets on another contact law. A run that was
interrupted goes on where it ended; results of other code are refused.

``python -m benchmarks.mixtures [--first 300000] [--count 12] [--jobs 2] [--lab wild] [--out FILE]``
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import granite_lab
from benchmarks.against_truth import table
from benchmarks.blind import read, write
from benchmarks.blind_code import ROOT, code_hash, commit
from benchmarks.intervals import wilson
from benchmarks.judging import Line, short
from granite_lab.errors import EstimateError, LabError
from granite_lab.files import write_text

RESULTS = ROOT / "benchmarks" / "results" / "mixtures.jsonl"

FIRST = 300_000
"""First seed; no version was developed on it or on those behind it."""

BINS = (0.0, 0.6, 0.8, 0.95, 0.99, 1.0)
"""Edges of the bins of the stated probability."""


def task(seed: int) -> dict[str, Any]:
    """Return what is hidden in the set of a seed: two to five causes in turn, each on both sorts of soil."""
    return {"causes": 2 + seed % 4, "soil_law": "random" if seed // 4 % 2 else ""}


def one(seed: int, lab: str) -> Line:
    """Make, search and judge one set."""
    line: Line = {"key": f"{seed}/{lab}", "seed": seed, **task(seed)}
    with tempfile.TemporaryDirectory(prefix="granite-mixture-") as name:
        folder = Path(name)
        try:
            granite_lab.hide("mixture", folder, seed=seed, lab=lab, **task(seed))
        except EstimateError as error:
            return line | {"status": "not made", "error": error.message}
        start = time.monotonic()
        try:
            finding = granite_lab.discover(sorted(folder.glob("*.csv")), out=folder / "finding", jobs=1)
            score = granite_lab.reveal(folder, folder / "finding").score
        except LabError as error:
            return line | {"status": "refused", "error": f"{error.message} ({error.hint})"}
        except Exception:  # a crash is a result
            return line | {"status": "crashed", "error": traceback.format_exc(limit=-4)}
        document = json.loads((folder / "finding" / "finding.json").read_text(encoding="utf-8"))
    assert score is not None
    return line | {
        "status": "judged", "seconds": round(time.monotonic() - start, 1), "verdict": finding.verdict,
        "hidden": list(score.hidden), "right": list(score.names.right), "missed": list(score.names.missed),
        "wrong": list(score.names.wrong), "withheld": short(score.closed_withheld),
        "closed": {key: short(document["closed"][key]["value"]) for key in ("trials", "speeds")},
        "probabilities": {e["id"]: short(e["probability"]) for e in document["effects"]},
    }  # fmt: skip


def ratio(hits: int, total: int) -> str:
    """Return a share with its 95 % interval after Wilson."""
    if not total:
        return "–"
    low, high = wilson(hits / total, total)
    return f"{hits} of {total} = {100 * hits / total:.0f} % ({100 * low:.0f}–{100 * high:.0f})"


def figures(lines: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Return the figures of judged sets: name, value and aim."""
    right, missed, wrong = (sum(len(x[key]) for x in lines) for key in ("right", "missed", "wrong"))

    def closing(share: float, value: Callable[[Mapping[str, Any]], float | None], some: Any = lines) -> str:
        known = [v for v in map(value, some) if v is not None]
        return ratio(sum(v >= share for v in known), len(known))

    inside = [x for x in lines if set(x["hidden"]) == {*x["right"], *x["missed"]}]
    return [
        ("hidden effects of the library named", ratio(right, right + missed), "≥ 80 %"),
        ("named effects that are not hidden", ratio(wrong, right + wrong), "≤ 2 %"),
        ("60 % closed on speeds left out, by the search's own account",
         closing(0.6, lambda x: x["closed"]["speeds"]), "–"),
        ("60 % closed at the withheld speed", closing(0.6, lambda x: x["withheld"]), "≥ 70 %"),
        ("the same, all causes in the library", closing(0.6, lambda x: x["withheld"], inside), "≥ 80 %"),
    ]  # fmt: skip


def reliability(lines: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Return how often a named effect is right, by bins of its stated probability."""
    named = [(p, name in x["wrong"]) for x in lines for name, p in x["probabilities"].items()]
    rows = []
    for low, high in pairwise(BINS):
        some = [(p, bad) for p, bad in named if low <= p < high or p == high == 1.0]
        if some:
            stated = float(np.mean([p for p, _ in some]))
            rows.append(
                [f"{low:g}–{high:g}", f"{stated:.3f}", ratio(sum(not bad for _, bad in some), len(some))]
            )
    return rows


def page(lines: Sequence[Mapping[str, Any]]) -> str:
    """Return the page in Markdown, of the lines of the code that made the last one."""
    lines = [x for x in lines if x["code"] == lines[-1]["code"]]
    judged = [x for x in lines if x["status"] == "judged"]
    lost = sum(x["status"] in ("refused", "crashed") for x in lines)
    unmade = sum(x["status"] == "not made" for x in lines)
    rows = [
        [str(x["seed"]), ", ".join(x["hidden"]), x["verdict"], ", ".join(x["right"]) or "–",
         ", ".join(x["wrong"]) or "–", percent(x["closed"]["speeds"]), percent(x["withheld"]),
         f"{x['seconds']:.0f}"]
        for x in judged
    ]  # fmt: skip
    columns = [
        "seed", "hidden", "verdict", "named rightly", "named wrongly", "closed, speeds left out [%]",
        "closed, withheld speed [%]", "time [s]",
    ]  # fmt: skip
    return f"""# Blind benchmark of mixtures

Virtual trials of `granite-lab hide --effect mixture` ([hidden effects](hidden.md#mixtures)): two to five
causes, half of the sets on another contact law, in laboratories drawn by the seed. All seeds were judged once
by code {lines[-1]["code"]} ({lines[-1]["commit"]}); no version was developed on them.

{table(["", "share (95 % interval after Wilson)", "aim"], figures(judged))}
{len(judged)} sets are judged, {lost} were refused or crashed, {unmade} could not be made.

## Stated probability of a name

{table(["stated", "mean", "right"], reliability(judged))}
## Sets

{table(columns, rows)}"""


def percent(share: float | None) -> str:
    """Return a share in percent."""
    return "–" if share is None else f"{100 * share:.0f}"


def main() -> None:
    """Continue the benchmark and write its page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=FIRST, help="first seed")
    parser.add_argument("--count", type=int, default=100, help="number of sets; 0: only the page")
    parser.add_argument("--jobs", type=int, default=2, help="sets side by side")
    parser.add_argument("--lab", default="wild", help="laboratory of `hide`")
    parser.add_argument("--results", type=Path, default=RESULTS, help="one line for each set")
    parser.add_argument("--out", type=Path, help="write the page here, too")
    options = parser.parse_args()
    version = {"code": code_hash(), "commit": commit()}
    lines = read(options.results)
    if options.count and lines and lines[-1]["code"] != version["code"]:
        sys.exit(f"error: {options.results} is of other code\nhint: move it away to begin anew")
    done = {line["seed"] for line in lines}
    seeds = [s for s in range(options.first, options.first + options.count) if s not in done]
    with ProcessPoolExecutor(options.jobs) as pool:
        for future in as_completed([pool.submit(partial(one, lab=options.lab), seed) for seed in seeds]):
            lines.append(future.result() | version)
            write(options.results, lines)
            print(f"{lines[-1]['key']}: {lines[-1]['status']}", file=sys.stderr, flush=True)
    if not lines:
        sys.exit("error: no set was judged")
    text = page(lines)
    print(text)
    if options.out is not None:
        write_text(options.out, text)


if __name__ == "__main__":
    main()
