"""What a command prints: tables, one JSON document, progress and warnings."""

from __future__ import annotations

import json as json_text
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TypeVar, cast

from granite_lab import reporting
from granite_lab.errors import printable
from granite_lab.files import write_bytes
from granite_lab.processes import Progress
from granite_lab.shown import jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from granite_lab.columns import Table
    from granite_lab.origin import Origin


R = TypeVar("R")


class Printer:
    """Prints the result of a command on stdout; if JSON is asked for, nothing but its document."""

    def __init__(self, as_json: bool) -> None:
        self.as_json, self.shown = as_json, console(quiet=as_json)

    def json(self, schema: str, document: Mapping[str, Any]) -> None:
        """Print a JSON document on stdout if --json was given; `schema` is its name and version."""
        if not self.as_json:
            return
        whole = jsonable({"schema": f"granite-lab/{schema}"} | dict(document))
        text = json_text.dumps(whole, indent=2, ensure_ascii=False, allow_nan=False)
        # A file's name may hold bytes that are no character; JSON can, the terminal's encoding cannot.
        sys.stdout.write(text.encode(errors="backslashreplace").decode() + "\n")

    def line(self, text: object, style: str = "") -> None:
        """Print a line as it is, however long: nothing in it is markup."""
        self.shown.print(str(text), soft_wrap=True, markup=False, style=style or None)

    def say(self, text: str, style: str = "") -> None:
        """Print a sentence."""
        reporting.table.say(self.shown, text, style)

    def rows(self, table: Table[R], rows: Iterable[R], *, virtual: bool = False) -> None:
        """Print a table; `virtual` as in `FilledTable`."""
        reporting.table.show_table(table.fill(rows, virtual=virtual), self.shown)


class _Encodable:
    """A stream on which names cannot turn the reading direction, and every text can be encoded."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        return self._stream.write(re.sub("[\u202a-\u202e\u2066-\u2069\ud800-\udfff]", "\ufffd", text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def console(*, stderr: bool = False, quiet: bool = False) -> Console:
    """Return a console: 80 columns and no colours where it is no terminal."""
    from rich.console import Console

    stream = cast("IO[str]", _Encodable(sys.stderr if stderr else sys.stdout))
    width = None if stream.isatty() else 80
    return Console(file=stream, highlight=False, width=width, quiet=quiet)


def warn(lines: Sequence[str]) -> None:
    """Print warnings on stderr, one line each."""
    for line in lines:
        print(f"warning: {printable(line)}", file=sys.stderr)


def warn_of(origin: Origin) -> dict[str, Any]:
    """Warn of trials that were left out and of what else there is to know; return the excluded, for JSON."""
    warn([f"{f.trial}: {'' if f.excluded else 'left out: '}{f.message}" for f in origin.left_out])
    warn(origin.warnings)
    excluded = [{"trial": f.trial, "reason": f.reason} for f in origin.left_out if f.excluded]
    return {"excluded": excluded} if excluded else {}


def provenance(origin: Origin) -> dict[str, Any]:
    """Warn as `warn_of`; return provenance and what is excluded, for JSON."""
    source = origin.source
    return {"provenance": source and reporting.json_report.provenance_as_json(source)} | warn_of(origin)


@dataclass(frozen=True)
class Watch:
    """Callbacks by which functions of the API report progress.

    Attributes:
        done: after each step.
        stage: with what is being done, how many steps of it are done, and of how many; 0 where that is not
            known.
    """

    done: Callable[[object], None]
    stage: Progress


@contextmanager
def progress(text: str, *, quiet: bool, total: int | None = None) -> Iterator[Watch]:
    """Show progress on stderr where it is a terminal, and nothing elsewhere or if `quiet`.

    `total` is the number of steps, with which the time that is left is shown; None where it is not known.
    """
    from rich import progress as rich

    shown = console(stderr=True)
    columns = (
        rich.TextColumn("{task.description}"), rich.BarColumn(), rich.MofNCompleteColumn(),
        rich.TimeElapsedColumn(), rich.TextColumn("left"), rich.TimeRemainingColumn(),
    )  # fmt: skip
    hidden = quiet or not shown.is_terminal
    with rich.Progress(*columns, console=shown, transient=True, disable=hidden) as bar:
        task = bar.add_task(text, total=total)
        yield Watch(
            done=lambda _: bar.advance(task),
            stage=lambda stage, count, total: bar.update(
                task, description=stage, completed=count, total=total or None
            ),
        )


def write_picture(path: Path, figure: Figure) -> None:
    """Write a figure as SVG, PNG or PDF, as its file is called."""
    write_bytes(path, reporting.canvas.saved(figure, path.suffix.lower().removeprefix(".")))
