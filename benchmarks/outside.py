"""Sets of trials that other programs made, searched and judged by their answers.

A folder holds ``answers.json``, which says of each set what is missing from the model: as ``answer`` "none",
"unknown" for what the library does not hold, an id, or ids joined by +; or as ``library`` a list of ids, with
the law of the soil, by a name in `LAWS` or an id. The set's logs are ``<set>/*.csv``.

``python -m benchmarks.outside [DIR] [--jobs 2] [--only o01,o03] [--drive auto] [--out lines.jsonl]``
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command_line import parser_of
from benchmarks.intervals import wilson
from benchmarks.judging import judged, named, searched, wrong_name
from benchmarks.lines import Line
from granite_lab.effects import library
from granite_lab.errors import InputError
from granite_lab.files import write_text

DEFAULT = Path("../shared/outside")

LAWS = {"paper": (), "Wong-Reece": ("stress_ahead",)}
"""Law of the soil to the effects that it is."""


def answers_of(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the answers of a folder by set, as `granite_lab.hidden.scoring` reads them.

    Raises:
        InputError: of a set the law of the soil is not known.
    """
    file = folder / "answers.json"
    told = json.loads(file.read_text(encoding="utf-8"))
    answers = {}
    for name, entry in told.items():
        try:
            ids = ids_of(entry)
        except InputError as error:
            raise InputError(f"{file}: set '{name}': {error.message}", error.hint) from None
        effects = [{"id": id_, "library": id_ != "unknown", "parameters": {}} for id_ in ids]
        answers[name] = {"effects": effects}
    return answers


def ids_of(entry: Mapping[str, Any]) -> list[str]:
    """Return the ids of what is missing from the model in a set, by either form of its answer.

    Raises:
        InputError: the law of the soil is neither of `LAWS` nor one of the library.
    """
    if "answer" in entry:
        return [id_ for id_ in str(entry["answer"]).split("+") if id_ != "none"]
    law = entry["soil_law"]
    if law in LAWS:
        return [*entry["library"], *LAWS[law]]
    by_id = [id_ for id_, effect in library().items() if effect.law]
    if law in by_id:
        return [*entry["library"], law]
    raise InputError(f"unknown law of the soil '{law}'", f"known: {', '.join([*LAWS, *by_id])}")


def row(name: str, answer: Mapping[str, Any], line: Line) -> str:
    """Return a line of the table: what is hidden, what was said, and how that is judged."""
    hidden = "+".join(e["id"] for e in answer["effects"]) or "none"
    said = f"{line['verdict']}: {named(line)}" if named(line) else line.get("verdict", line["status"])
    closed = "–" if line.get("closed") is None else f"{100 * line['closed']:.0f} %"
    sure = "–" if line.get("probability") is None else f"{line['probability']:.2f}"
    mark = "right" if line["right"] else "WRONG"
    return (
        f"{name:8} {hidden:36} {said:44} {line['outcome']:14} {mark:6} {sure:>5} {closed:>6} "
        f"{line['seconds']:6.0f} s"
    )


def summary(lines: Sequence[Line], answers: Sequence[Mapping[str, Any]]) -> str:
    """Return the shares with their 95 % Wilson intervals."""
    both = list(zip(lines, answers, strict=True))
    nulls = [line for line, answer in both if not answer["effects"]]
    closed = [
        c
        for line in lines
        if line.get("verdict") in ("named", "partly named") and (c := line.get("closed")) is not None
    ]

    closing = "held-out gap closed where named: –"
    if closed:
        closing = closing[:-1] + f"median {100 * np.median(closed):.0f} %, least {100 * min(closed):.0f} %"

    def share(what: str, hits: Sequence[bool]) -> str:
        if not hits:
            return f"{what}: –"
        low, high = wilson(sum(hits) / len(hits), len(hits))
        return f"{what}: {sum(hits)} of {len(hits)} ({100 * low:.0f} to {100 * high:.0f} %)"

    return "\n".join([
        share("right, or in a stated set of twins", [line["right"] for line in lines]),
        share("wrong name", [wrong_name(line) for line in lines]),
        share("none where nothing is missing", [line["right"] for line in nulls]),
        share("crashed or refused", [line["status"] != "judged" for line in lines]),
        closing,
        f"time of a set: median {np.median([line['seconds'] for line in lines]):.0f} s",
    ])  # fmt: skip


def main() -> None:
    """Judge a folder of sets, print a row each and the summary; the exit code tells of crashes only."""
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=DEFAULT)
    parser.add_argument("--jobs", type=int, default=2, help="processes of each search")
    parser.add_argument("--only", default="", help="names of sets, with commas between")
    parser.add_argument("--drive", default="auto", help="what drives the simulations, as in `discover`")
    parser.add_argument("--out", type=Path, help="keep a line of JSON for each set")
    options = parser.parse_args()
    if not (options.folder / "answers.json").is_file():
        sys.exit(f"error: {options.folder}: holds no answers.json\nhint: make outside DIR=…")
    try:
        answers = answers_of(options.folder)
    except InputError as error:
        sys.exit(f"error: {error.message}\nhint: {error.hint}")
    asked = [name for name in options.only.split(",") if name] or list(answers)
    if unknown := [name for name in asked if name not in answers]:
        sys.exit(f"error: no set is called {', '.join(unknown)}\nhint: known: {', '.join(answers)}")
    lines: list[Line] = []
    for name in asked:
        logs = sorted((options.folder / name).glob("*.csv"))
        lines.append(judged(searched(logs, options.jobs, options.drive), answers[name]))
        print(row(name, answers[name], lines[-1]), flush=True)
        if "error" in lines[-1]:
            print(lines[-1]["error"], file=sys.stderr, flush=True)
    print(summary(lines, [answers[name] for name in asked]))
    if options.out is not None:
        named_lines = ({"set": name} | line for name, line in zip(asked, lines, strict=True))
        write_text(options.out, "".join(json.dumps(line, allow_nan=False) + "\n" for line in named_lines))
    sys.exit(any(line["status"] == "crashed" for line in lines))


if __name__ == "__main__":
    main()
