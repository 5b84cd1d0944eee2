"""Results of a benchmark as a file with one line a set: read, written, continued, and shown as a page."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.blind_code import code_hash, commit
from granite_lab.files import write_text

Line = dict[str, Any]


def read(path: Path) -> list[Line]:
    """Return the lines of a results file; one on which a run was killed is dropped."""
    lines = []
    for text in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            lines.append(json.loads(text))
        except ValueError:
            continue
    return lines


def write(path: Path, lines: Sequence[Line]) -> None:
    """Write the results, whole or not at all."""
    write_text(path, "".join(json.dumps(x, allow_nan=False, separators=(",", ":")) + "\n" for x in lines))


def current(lines: Sequence[Mapping[str, Any]]) -> Sequence[Mapping[str, Any]]:
    """Return the lines of the code that made the last one."""
    return [line for line in lines if line["code"] == lines[-1]["code"]]


def continued(options: Namespace, *, judges: bool, page_only: str) -> tuple[list[Line], Line]:
    """Return the lines that a benchmark continues, and the version of those to come.

    The program ends where they are of other code.

    Args:
        options: `results`: file of the lines; `afresh`: drop those of other code.
        judges: sets are to be judged; else the lines are kept whatever their code.
        page_only: option that shows what there is.
    """
    version, lines = {"code": code_hash(), "commit": commit()}, read(options.results)
    if judges and options.afresh:
        lines = [line for line in lines if line["code"] == version["code"]]
    elif judges and lines and lines[-1]["code"] != version["code"]:
        sys.exit(
            f"error: {options.results} is of code {lines[-1]['code']}, this is {version['code']}\n"
            f"hint: --afresh begins anew; {page_only} shows what there is"
        )
    return lines, version


def add(path: Path, lines: list[Line], judged: Iterable[Line], version: Line) -> None:
    """Add lines to the results as sets are judged; the file is written after each."""
    for line in judged:
        lines.append(line | version)
        write(path, lines)
        print(
            f"{len(lines)} {line['key']}: {line.get('outcome') or line['status']}",
            file=sys.stderr,
            flush=True,
        )


def show(lines: Sequence[Line], page: Callable[[Sequence[Line]], str], out: Path | None) -> None:
    """Print the page of a benchmark, and write it to `out`; end the program where there is no line."""
    if not lines:
        sys.exit("error: no set was judged")
    text = page(lines)
    print(text)
    if out is not None:
        write_text(out, text)
