"""A command: a function of the API, called as the command line says, and what is printed of its result."""

from __future__ import annotations

import inspect
import json as json_text
import re
import sys
import typing
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Any, Generic, TypeVar, cast

import typer

from granite_lab import reporting
from granite_lab.api.calls import hints_of, parameters_of
from granite_lab.commands.options import FLAGS, METAVARS, Flag, names_of, options_of, said_for, said_of
from granite_lab.errors import LabError, printable
from granite_lab.files import write_bytes
from granite_lab.shown import jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from granite_lab.api.records import Origin

T = TypeVar("T")
R = TypeVar("R")

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress display.")]


@dataclass(frozen=True)
class Output:
    """What a command prints, and how it ends.

    Attributes:
        schema: of its JSON, name and version.
        document: the JSON.
        text: prints the same for a reader.
        error: with which the command ends; None where all is well.
    """

    schema: str
    document: Mapping[str, Any]
    text: Callable[[Console], None]
    error: LabError | None = None


class Call(Generic[T]):
    """The call of the API that a command stands for.

    Args:
        function: of the API.
        said: its keywords.
        told: keywords by which it tells how far it is.
        busy: what is being done; an empty text shows no progress.
        as_json: JSON is asked for.
    """

    def __init__(
        self,
        function: Callable[..., T],
        said: Mapping[str, Any],
        told: Collection[str],
        busy: str,
        as_json: bool,
    ) -> None:
        self.said, self.as_json = dict(said), as_json
        self._function, self._told, self._busy = function, told, busy

    def __call__(self, **changes: Any) -> T:
        """Call it, with further keywords."""
        return self.of(self._function, **self.said | changes)

    def of(self, function: Callable[..., R], *args: Any, **said: Any) -> R:
        """Call another function in its place."""
        with progress(not self._busy, self._busy) as shown:
            return function(*args, **said, **{name: getattr(shown, name) for name in self._told})

    def folder(self, name: str) -> Path:
        """Return the folder for results: as asked for, else of this name, where the project keeps them."""
        from granite_lab.api.project import choose

        given = self.said.get("out")
        logs = self.said.get("logs") or [self.said[key] for key in ("imu",) if key in self.said]
        return Path(given) if given else choose(logs, self.said).out / name


def command(
    function: Callable[..., Any],
    *,
    run: Callable[..., Any] | None = None,
    busy: str = "",
    leave: Collection[str] = (),
    json: bool = True,
    **flags: Flag,
) -> Callable[[Callable[..., Output | None]], Callable[..., None]]:
    """Make a command of what shows the result of a function of the API.

    Its options are the parameters of the function, then those of what is decorated, which gets the call.

    Args:
        function: whose parameters and docstring the command has.
        run: that is called in its place; it takes the same.
        busy: what is being done, for the display of progress.
        leave: parameters that are no options.
        json: whether the output may be JSON.
        **flags: parameters that this command takes in its own way.
    """
    known = FLAGS | flags
    parameters = [p for p in parameters_of(function) if p.name not in leave]
    told = [p.name for p in parameters if p.name in ("done", "progress")]

    def decorate(show: Callable[..., Output | None]) -> Callable[..., None]:
        hints, keyword = hints_of(show), inspect.Parameter.KEYWORD_ONLY
        for hint in (hint for hint in hints.values() if hasattr(hint, "__metadata__")):
            kind, option = (*typing.get_args(hint.__origin__), hint.__origin__)[0], hint.__metadata__[0]
            option.metavar = option.metavar or METAVARS.get(kind)
        extra = [
            p.replace(kind=keyword, annotation=hints[p.name])
            for p in list(inspect.signature(show).parameters.values())[1:]
        ]

        def called(**values: Any) -> None:
            own = {p.name: values.pop(p.name) for p in extra}
            as_json, quiet = values.pop("as_json", False), values.pop("quiet", False)
            call = Call(run or function, said_of(values, known), told, "" if quiet else busy, as_json)
            output = show(call, **own)
            if output is None:
                return
            if as_json:
                print_json({"schema": f"granite-lab/{output.schema}"} | dict(output.document))
            else:
                output.text(console())
            if output.error is not None:
                raise output.error

        common = [("quiet", Quiet)] * bool(busy) + [("as_json", Json)] * json
        called.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [
                *options_of(parameters, known),
                *extra,
                *(inspect.Parameter(n, keyword, default=False, annotation=kind) for n, kind in common),
            ]
        )
        called.__annotations__ = {}
        about = re.split(r"\n\n(?:Args|Returns|Raises):", inspect.getdoc(function) or "")[0]
        called.__doc__ = said_for(f"{about}\n\n{show.__doc__}", names_of(parameters, known))
        return called

    return decorate


def print_json(document: Mapping[str, Any]) -> None:
    """Print one JSON document on stdout."""
    text = json_text.dumps(jsonable(document), indent=2, ensure_ascii=False, allow_nan=False)
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
    write_bytes(path, reporting.canvas.saved(figure, path.suffix.lower().removeprefix(".")))
