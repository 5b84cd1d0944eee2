"""This search beside two peers that learn the residual: how much of the gap does each close?

All three see the same trials, residual (of the fit without effects), gap and left-out splits. The peers
predict the residual of each channel from the motion at that instant: sparse regression by PySINDy's STLSQ on
products of two inputs, and a Gaussian process of scikit-learn. Their inputs are smoothed: the motion as the
model without effects has it, which follows from the command; or as it was estimated from each trial itself.

A run that was interrupted, or whose minutes are over, goes on where it ended; results of other code are
refused.

``python -m benchmarks.peers [--outside DIR] [--mixtures DIR] [--blind 20] [--minutes 60] [--out FILE]``
"""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import granite_lab
from benchmarks.blind_code import ROOT
from benchmarks.command_line import parser_of_sets
from benchmarks.judging import attempted, parallel, short
from benchmarks.lines import Line, add, continued, show
from benchmarks.mixtures import task
from benchmarks.outside import ids_of
from benchmarks.peers_learn import INPUTS, PEERS, Places, Table, measured, residuals_without, simulated
from benchmarks.peers_page import GROUPS, page
from granite_lab.discovery import discover
from granite_lab.discovery.heldout import Equations, by_others, closed, gaps
from granite_lab.discovery.models import Search
from granite_lab.discovery.verdict import Judgement, judge, performance_of
from granite_lab.estimate import Estimate
from granite_lab.inference.fit import Fit
from granite_lab.inference.problem import Problem
from granite_lab.logs.trial import Array

RESULTS = ROOT / "benchmarks" / "results" / "peers.jsonl"

FIRST = 400_000
"""First seed of the blind sets; no version was developed on them."""

Seen = tuple[Problem, Search, Judgement, float]


def compared(logs: Sequence[Path]) -> Line:
    """Search some logs, and let the peers learn the residuals of the same run."""
    seen: list[Seen] = []

    def watched(problem: Problem, search: Search, tolerance: float) -> Judgement:
        seen.append((problem, search, judge(problem, search, tolerance), tolerance))
        return seen[-1][2]

    start = time.process_time()
    with mock.patch.object(discover, "judge", watched):  # the search hands its problem to nobody
        finding = granite_lab.discover(logs, jobs=1, cache=False)
    line: Line = {
        "verdict": finding.verdict, "named": [e.id for e in finding.effects],
        "seconds": round(time.process_time() - start, 1),
    }  # fmt: skip
    problem, search, judgement, tolerance = seen[-1]
    gap = performance_of(judgement.before, judgement.after).gap
    if judgement.verdict == "none" or not gap.sum() > 0:
        return line | {"status": "no gap"}
    own = {key: told(finding.closed[key]) for key in ("trials", "speeds")}
    line |= {"status": "compared", "closed": {"this": own}, "peer_seconds": {}}
    alone = search.model(())
    assert alone is not None
    scales = replace(alone.fit.scales, priors=search.best.fit.scales.priors)
    base = replace(alone.fit, scales=scales)
    motions = {r.motion.trial: r.motion for r in granite_lab.ingest(logs, jobs=1)}
    tables = {"command": simulated(problem, base), "trial": measured(problem, motions)}
    for name, learn in PEERS.items():
        for source in INPUTS:
            start = time.process_time()
            found = learn(Table(problem, base, tables[source]))
            shares = by_peer(problem, base, judgement, tolerance, found)
            line["closed"][f"{name}, {source}"] = shares
            line["peer_seconds"][f"{name}, {source}"] = round(time.process_time() - start, 1)
    return line


def told(share: Estimate) -> tuple[float | None, float | None]:
    """Return a share and its standard error, as JSON holds them."""
    return short(share.value), short(share.std)


def by_peer(
    problem: Problem,
    base: Fit,
    judgement: Judgement,
    tolerance: float,
    learnt: Callable[[Places], list[Array]],
) -> dict[str, Any]:
    """Return the share of the gap that a peer closes on trials and on speeds left out.

    Args:
        problem, base, judgement, tolerance: of the run.
        learnt: returns per trial the (C, n) predicted residual, by a peer that has not seen some trials.
    """
    before = judgement.before
    gap, gap_speeds = gaps(before, judgement.after)

    def misfits(out: Places) -> Array:
        left = residuals_without(base, learnt(out))
        return by_others(problem, Equations(problem, replace(base, residuals=left)), tolerance, out)

    trials, speeds = (np.full(len(problem.trials), np.nan) for _ in range(2))
    for out in (
        problem.commands if len(problem.commands) > 1 else ()
    ):  # first: what is learnt there serves below
        speeds[list(out)] = misfits(out)
    for i in range(len(problem.trials)) if len(problem.trials) > 1 else ():
        trials[[i]] = misfits((i,))
    return {
        "trials": told(closed(before.left_out, trials, gap)),
        "speeds": told(closed(before.speed_left_out, speeds, gap_speeds)),
    }


def sets(outside: Path, mixtures: Path, blind: int) -> list[str]:
    """Return what is to be compared: folders of logs, and seeds of blind sets."""
    found = []
    for folder in (outside, mixtures):
        if (folder / "answers.json").is_file():
            names = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
            found += [str(folder / name) for name in names]
    return [*found, *(f"seed {FIRST + k}" for k in range(blind))]


def one(name: str) -> Line:
    """Compare on one set; a failure becomes a line, too."""
    folder = Path(name)
    line: Line = {"key": folder.name, "of": folder.parent.name if folder.parent.name in GROUPS else "blind"}

    def found() -> Line:
        if not name.startswith("seed "):
            answer = json.loads((folder.parent / "answers.json").read_text("utf-8"))[folder.name]
            return {"hidden": "+".join(ids_of(answer)) or "none"} | compared(sorted(folder.glob("*.csv")))
        seed = int(name.removeprefix("seed "))
        with tempfile.TemporaryDirectory(prefix="granite-peers-") as made:
            hid = granite_lab.hide("mixture", made, seed=seed, lab="wild", **task(seed))
            hidden = "+".join(e["id"] for e in granite_lab.reveal(made).answer["effects"])
            return {"hidden": hidden} | compared(hid.trials)

    return line | attempted(found)


def main() -> None:
    """Continue the comparison and write its page."""
    parser = parser_of_sets(__doc__, RESULTS)
    parser.add_argument("--outside", type=Path, default=Path("../shared/outside"))
    parser.add_argument("--mixtures", type=Path, default=Path("../shared/mixtures"))
    parser.add_argument("--blind", type=int, default=20, help="number of sets made by hide")
    parser.add_argument("--only", default="", help="names of sets, with commas between")
    parser.add_argument(
        "--minutes", type=float, default=math.inf, help="no set is begun later; 0: only the page"
    )
    parser.add_argument("--afresh", action="store_true", help="drop results of other code")
    options = parser.parse_args()
    lines, version = continued(options, judges=options.minutes > 0, page_only="--minutes 0")
    done, only = {x["key"] for x in lines}, set(filter(None, options.only.split(",")))
    every = sets(options.outside, options.mixtures, options.blind)
    names = [n for n in every if Path(n).name not in done and (not only or Path(n).name in only)]
    judged = parallel(one, names, options.minutes, options.jobs)
    add(options.results, lines, judged, version)
    show(lines, partial(page, of=len(every)), options.out)


if __name__ == "__main__":
    main()
