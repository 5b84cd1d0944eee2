"""What commands print: JSON or text on stdout, warnings and progress on stderr."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

from granite_lab.shown import jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from granite_lab.api.records import Origin


def print_json(document: Mapping[str, Any]) -> None:
    """Print one JSON document on stdout."""
    text = json.dumps(jsonable(document), indent=2, ensure_ascii=False, allow_nan=False)
    # A file's name may hold bytes that are no character; JSON can, the terminal's encoding cannot.
    sys.stdout.write(re.sub("[\ud800-\udfff]", lambda c: f"\\u{ord(c[0]):04x}", text) + "\n")


class _Shown:
    """A stream on which names cannot turn the reading direction, and every text can be encoded."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        return self._stream.write(re.sub("[\u202a-\u202e\u2066-\u2069\ud800-\udfff]", "\ufffd", text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def console(*, stderr: bool = False) -> Console:
    """Return a console: at most 100 columns on a terminal, 80 elsewhere; colours only on a terminal."""
    from rich.console import Console

    stream = cast("IO[str]", _Shown(sys.stderr if stderr else sys.stdout))
    plain = Console(file=stream, highlight=False, soft_wrap=False)
    if not plain.is_terminal:
        return Console(file=stream, highlight=False, width=80)
    return plain


def show(text: object, style: str = "") -> None:
    """Print a line as it is, however long: nothing in it is markup."""
    console().print(str(text), style=style or None, soft_wrap=True, markup=False)


def warn(lines: Sequence[str]) -> None:
    """Print warnings on stderr, one line each."""
    from granite_lab.errors import printable

    for line in lines:
        print(f"warning: {printable(line)}", file=sys.stderr)


def warn_of(origin: Origin) -> dict[str, Any]:
    """Tell which trials were left out and what else there is to know; return what is excluded, for JSON."""
    warn([f"{f.trial}: {'' if f.excluded else 'left out: '}{f.message}" for f in origin.left_out])
    warn(origin.warnings)
    excluded = [{"trial": f.trial, "reason": f.reason} for f in origin.left_out if f.excluded]
    return {"excluded": excluded} if excluded else {}


class Progress:
    """A line of progress.

    Args:
        bar: of rich.
        text: what is being done.
    """

    def __init__(self, bar: Any, text: str) -> None:
        self._bar, self._task = bar, bar.add_task(text, total=None)

    def done(self, _: object) -> None:
        """Tell that one step is done."""
        self._bar.advance(self._task)

    def progress(self, what: str | int, count: int) -> None:
        """Tell what is being done and how often it was done, or how many steps are done and of how many."""
        if isinstance(what, str):
            self._bar.update(self._task, description=what, completed=count, total=None)
        else:
            self._bar.update(self._task, completed=what, total=count)


@contextmanager
def progress(quiet: bool, text: str) -> Iterator[Progress]:
    """Show progress on stderr where it is a terminal, and nothing elsewhere."""
    from rich import progress as rich

    shown = console(stderr=True)
    columns = (
        rich.TextColumn("{task.description}"), rich.BarColumn(), rich.MofNCompleteColumn(),
        rich.TimeElapsedColumn(),
    )  # fmt: skip
    hidden = quiet or not shown.is_terminal
    with rich.Progress(*columns, console=shown, transient=True, disable=hidden) as bar:
        yield Progress(bar, text)


def write_picture(path: Path, figure: Figure) -> None:
    """Write a figure as SVG or PNG, as its file is called."""
    from granite_lab.files import write_bytes
    from granite_lab.reporting.canvas import saved

    write_bytes(path, saved(figure, path.suffix.lower().removeprefix(".")))
