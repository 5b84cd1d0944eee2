"""A command: a function of the API, called as the command line says, and what is printed of its result."""

from __future__ import annotations

import inspect
import json as json_text
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Any, Generic, TypeVar, cast

import typer

from granite_lab import reporting
from granite_lab.api.calls import hints_of, parameters_of
from granite_lab.commands.options import FLAGS, Flag, options_of, said_for, said_of
from granite_lab.errors import printable
from granite_lab.files import write_bytes
from granite_lab.shown import jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from granite_lab.api.records import Origin
    from granite_lab.columns import Table

T = TypeVar("T")
R = TypeVar("R")

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress display.")]


class Call(Generic[T]):
    """The call of the API that a command stands for, and what is printed of it.

    `said` are its keywords, `told` those by which it tells how far it is; `busy` is shown as progress, unless
    it is empty. If JSON is asked for, nothing else is printed.
    """

    def __init__(
        self,
        function: Callable[..., T],
        said: dict[str, Any],
        told: Collection[str],
        busy: str,
        as_json: bool,
    ) -> None:
        self.said, self.as_json, self.shown = said, as_json, console(quiet=as_json)
        self._function, self._told, self._busy = function, told, busy

    def __call__(self, **changes: Any) -> T:
        """Call it, with further keywords."""
        return self.of(self._function, **self.said | changes)

    def of(self, function: Callable[..., R], *args: Any, **said: Any) -> R:
        """Call another function in its place."""
        with progress(self._busy) as told:
            return function(*args, **said, **{name: told[name] for name in self._told})

    def folder(self, name: str) -> Path:
        """Return the folder for results: as asked for, else of this name, where the project keeps them."""
        from granite_lab.api.project import choose

        given = self.said.get("out")
        logs = self.said.get("logs") or [self.said[key] for key in ("imu",) if key in self.said]
        return Path(given) if given else choose(logs, self.said).out / name

    def take_logs_at_hand(self) -> None:
        """Take the logs at hand where none are given, and say which on stderr."""
        from granite_lab.api.at_hand import logs_at_hand

        if not self.said["logs"]:
            found = logs_at_hand()
            print(printable(found.line), file=sys.stderr)
            self.said = {**found.said, **self.said, "logs": list(found.logs)}

    def json(self, schema: str, document: Mapping[str, Any]) -> None:
        """Print one JSON document on stdout where it is asked for; `schema` is its name and version."""
        if not self.as_json:
            return
        whole = jsonable({"schema": f"granite-lab/{schema}"} | dict(document))
        text = json_text.dumps(whole, indent=2, ensure_ascii=False, allow_nan=False)
        # A file's name may hold bytes that are no character; JSON can, the terminal's encoding cannot.
        sys.stdout.write(re.sub("[\ud800-\udfff]", lambda c: f"\\u{ord(c[0]):04x}", text) + "\n")

    def line(self, text: object, style: str = "") -> None:
        """Print a line as it is, however long: nothing in it is markup."""
        self.shown.print(str(text), soft_wrap=True, markup=False, style=style or None)

    def say(self, text: str, style: str = "") -> None:
        """Print a sentence."""
        reporting.table.say(self.shown, text, style)

    def rows(self, table: Table[R], rows: Iterable[R]) -> None:
        """Print a table."""
        reporting.table.show_table(table.fill(rows), self.shown)


def command(
    function: Callable[..., Any],
    *,
    run: Callable[..., Any] | None = None,
    busy: str = "",
    json: bool = True,
    **flags: Flag,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a command of what shows the result of a function of the API.

    Its options are the parameters of the function, then those of what is decorated, which gets the call.

    Args:
        function: whose parameters and docstring the command has.
        run: that is called in its place; it takes the same.
        busy: what is being done, for the display of progress.
        json: whether the output may be JSON.
        **flags: parameters that this command takes in its own way.
    """
    known = FLAGS | flags
    parameters = parameters_of(function)
    names = {p.name: known.get(p.name, Flag()).named(p.name) for p in parameters}
    told = [p.name for p in parameters if p.name in ("done", "progress")]

    def decorate(show: Callable[..., None]) -> Callable[..., None]:
        hints, keyword = hints_of(show), inspect.Parameter.KEYWORD_ONLY
        extra = [
            p.replace(kind=keyword, annotation=hints[p.name])
            for p in list(inspect.signature(show).parameters.values())[1:]
        ]

        def called(**values: Any) -> None:
            own = {p.name: values.pop(p.name) for p in extra}
            as_json, quiet = values.pop("as_json", False), values.pop("quiet", False)
            show(Call(run or function, said_of(values, known), told, "" if quiet else busy, as_json), **own)
            if (kept := sys.modules.get("granite_lab.model.kept")) is not None:  # it was needed
                warn(kept.doubts())

        common = [("quiet", Quiet)] * bool(busy) + [("as_json", Json)] * json
        called.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [
                *options_of(parameters, known, names),
                *extra,
                *(inspect.Parameter(n, keyword, default=False, annotation=kind) for n, kind in common),
            ]
        )
        called.__annotations__ = {}
        about = re.split(r"\n\n(?:Args|Returns|Raises):", inspect.getdoc(function) or "")[0]
        called.__doc__ = said_for(f"{about}\n\n{show.__doc__}", names)
        return called

    return decorate


class _Shown:
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

    stream = cast("IO[str]", _Shown(sys.stderr if stderr else sys.stdout))
    width = None if stream.isatty() else 80
    return Console(file=stream, highlight=False, width=width, quiet=quiet)


def warn(lines: Sequence[str]) -> None:
    """Print warnings on stderr, one line each."""
    for line in lines:
        print(f"warning: {printable(line)}", file=sys.stderr)


def warn_of(origin: Origin) -> dict[str, Any]:
    """Tell which trials were left out and what else there is to know; return what is excluded, for JSON."""
    warn([f"{f.trial}: {'' if f.excluded else 'left out: '}{f.message}" for f in origin.left_out])
    warn(origin.warnings)
    excluded = [{"trial": f.trial, "reason": f.reason} for f in origin.left_out if f.excluded]
    return {"excluded": excluded} if excluded else {}


@contextmanager
def progress(text: str) -> Iterator[dict[str, Callable[..., None]]]:
    """Show progress on stderr where it is a terminal, and nothing elsewhere or without a text.

    Yields what functions of the API call: ``done`` after each step, ``progress`` with what is being done and
    how often it was done, or with how many steps are done and of how many.
    """
    from rich import progress as rich

    shown = console(stderr=True)
    columns = (
        rich.TextColumn("{task.description}"), rich.BarColumn(), rich.MofNCompleteColumn(),
        rich.TimeElapsedColumn(),
    )  # fmt: skip
    hidden = not text or not shown.is_terminal
    with rich.Progress(*columns, console=shown, transient=True, disable=hidden) as bar:
        task = bar.add_task(text, total=None)

        def told(what: str | int, count: int) -> None:
            if isinstance(what, str):
                bar.update(task, description=what, completed=count, total=None)
            else:
                bar.update(task, completed=what, total=count)

        yield {"done": lambda _: bar.advance(task), "progress": told}


def write_picture(path: Path, figure: Figure) -> None:
    """Write a figure as SVG or PNG, as its file is called."""
    write_bytes(path, reporting.canvas.saved(figure, path.suffix.lower().removeprefix(".")))
