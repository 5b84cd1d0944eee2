"""Does `discover` find several causes at once? Mixtures that `hide` draws, judged name by name.

Each seed is a set of its own: two to five causes, half of the sets on another contact law. A run that was
interrupted, or whose minutes are over, goes on where it ended; results of other code are refused.

``python -m benchmarks.mixtures [--first 300000] [--count 100] [--minutes 60] [--afresh] [--out FILE]``
"""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import granite_lab
from benchmarks.against_truth import percent, table
from benchmarks.blind_code import ROOT
from benchmarks.blind_page import every_stated
from benchmarks.command_line import parser_of_sets
from benchmarks.intervals import ratio
from benchmarks.judging import attempted, parallel, short, stated
from benchmarks.lines import Line, add, continued, current, show
from benchmarks.reliability import section, write_diagram
from granite_lab.errors import EstimateError

RESULTS = ROOT / "benchmarks" / "results" / "mixtures.jsonl"

FIRST = 355_000
"""First seed; no version was developed on it or on those behind it. Earlier ones were looked into."""

DIAGRAM = "figures/blind-mixtures.png"
"""Path of the reliability diagram, from the page's folder."""


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
        return line | attempted(partial(judged, folder))


def judged(folder: Path) -> Line:
    """Search and judge the set in a folder."""
    start = time.monotonic()
    finding = granite_lab.discover(sorted(folder.glob("*.csv")), out=folder / "finding", jobs=1)
    revealed = granite_lab.reveal(folder, folder / "finding")
    document = json.loads((folder / "finding" / "finding.json").read_text(encoding="utf-8"))
    score, reopens = revealed.score, revealed.answer["reopens_after_refit"]
    assert score is not None
    return {
        "status": "judged", "seconds": round(time.monotonic() - start, 1), "verdict": finding.verdict,
        "hidden": {name: short(reopens[name]) for name in score.hidden},
        "outside": [effect["id"] for effect in revealed.answer["effects"] if not effect["library"]],
        "right": list(score.names.right), "missed": list(score.names.missed),
        "absorbed": list(score.names.absorbed), "wrong": list(score.names.wrong),
        "withheld": short(score.closed_withheld),
        "closed": {key: short(document["closed"][key]["value"]) for key in ("trials", "speeds")},
        "stated": stated(score),
    }  # fmt: skip


def figures(lines: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Return the figures of judged sets: name, value and aim."""
    right, missed, absorbed, wrong = (
        [name for x in lines for name in x[key]] for key in ("right", "missed", "absorbed", "wrong")
    )
    seen = sum(len(set(x["right"]) - set(x["absorbed"])) for x in lines)

    def closing(share: float, value: Callable[[Mapping[str, Any]], float | None], some: Any = lines) -> str:
        known = [v for v in map(value, some) if v is not None]
        return ratio(sum(v >= share for v in known), len(known))

    inside = [x for x in lines if not x["outside"]]
    return [
        ("hidden effects that count, named", ratio(seen, seen + len(missed)), "≥ 80 %"),
        ("those that do not count, named", ratio(len(right) - seen, len(absorbed)), "–"),
        ("named effects that are not hidden", ratio(len(wrong), len(right) + len(wrong)), "≤ 2 %"),
        ("60 % closed on speeds left out, by the search's own account",
         closing(0.6, lambda x: x["closed"]["speeds"]), "–"),
        ("60 % closed at the withheld speed", closing(0.6, lambda x: x["withheld"]), "≥ 70 %"),
        ("the same, all causes in the library", closing(0.6, lambda x: x["withheld"], inside), "≥ 80 %"),
    ]  # fmt: skip


def page(lines: Sequence[Mapping[str, Any]]) -> str:
    """Return the page in Markdown, of the lines of the code that made the last one."""
    lines = current(lines)
    kept = [x for x in lines if x["status"] == "judged"]
    lost = sum(x["status"] in ("refused", "crashed") for x in lines)
    unmade = sum(x["status"] == "not made" for x in lines)
    rows = [
        [str(x["seed"]), ", ".join(f"{id_} ({percent(share)})" for id_, share in x["hidden"].items()),
         x["verdict"], ", ".join(x["right"]) or "–",
         ", ".join(x["wrong"]) or "–", percent(x["closed"]["speeds"]), percent(x["withheld"]),
         f"{x['seconds']:.0f}"]
        for x in kept
    ]  # fmt: skip
    columns = [
        "seed", "hidden (reopens after refit [%])", "verdict", "named rightly", "named wrongly",
        "closed, speeds left out [%]", "closed, withheld speed [%]", "time [s]",
    ]  # fmt: skip
    return f"""# Blind benchmark of mixtures

Virtual trials of `granite-lab hide --effect mixture` ([hidden effects](hidden.md#mixtures)): two to five
causes, half of the sets on another contact law, in laboratories drawn by the seed. All seeds were judged once
by code {lines[-1]["code"]} ({lines[-1]["commit"]}); no earlier version was developed on them.

An effect of the library counts where its absence reopens a tenth of the squared gap after sand, gains, tilt
and delays have been fitted again. Of the others these absorb so much that little is left to tell them by.

{table(["", "share (95 % interval after Wilson)", "aim"], figures(kept))}
{len(kept)} sets are judged, {lost} were refused or crashed, {unmade} could not be made.

{section(every_stated(kept), DIAGRAM)}
## Sets

{table(columns, rows)}"""


def main() -> None:
    """Continue the benchmark and write its page."""
    parser = parser_of_sets(__doc__, RESULTS)
    parser.add_argument("--first", type=int, default=FIRST, help="first seed")
    parser.add_argument("--count", type=int, default=100, help="number of sets; 0: only the page")
    parser.add_argument("--minutes", type=float, default=math.inf, help="no set is begun later")
    parser.add_argument("--afresh", action="store_true", help="drop results of other code")
    parser.add_argument("--lab", default="wild", help="laboratory of `hide`")
    options = parser.parse_args()
    lines, version = continued(options, judges=options.count > 0, page_only="--count 0")
    done = {x["key"] for x in lines}
    seeds = range(options.first, options.first + options.count)
    waiting = [s for s in seeds if f"{s}/{options.lab}" not in done]
    found = parallel(partial(one, lab=options.lab), waiting, options.minutes, options.jobs)
    add(options.results, lines, found, version)
    show(lines, page, options.out)
    if options.out is not None:
        write_diagram(every_stated(current(lines)), options.out, DIAGRAM)


if __name__ == "__main__":
    main()
