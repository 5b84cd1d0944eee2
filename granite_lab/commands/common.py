"""What the commands share: their options, JSON on stdout, tables on the terminal."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Any, cast

import typer

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from granite_lab.api.project import Chosen

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress display.")]
TrialsArgument = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="TRIALS…", help="Logs (CSV, ROS bag, MCAP), or folders of them.", show_default=False
    ),
]


def _complete(kind: str) -> Any:
    def names(incomplete: str) -> list[str]:
        from granite_lab.parameters import names as known

        return [name for name in known(kind) if name.startswith(incomplete)]

    return names


RobotOption = Annotated[
    str | None,
    typer.Option(help="Robot: a name of the catalogue or a .toml file.", autocompletion=_complete("robots")),
]
SoilOption = Annotated[
    str | None,
    typer.Option(help="Soil: a name of the catalogue or a .toml file.", autocompletion=_complete("soils")),
]
MapOption = Annotated[
    str | None,
    typer.Option(
        "--map",
        help="Column map: a name of the catalogue or a .toml file.",
        autocompletion=_complete("loggers"),
    ),
]
ModelOption = Annotated[
    Path | None, typer.Option("--model", help="model.toml: the paper's model with effects switched on.")
]
EffectsOption = Annotated[
    Path | None,
    typer.Option("--effects", help="Your own effect file (.py). It is run: use only code you trust."),
]
FormatOption = Annotated[
    str | None,
    typer.Option("--format", help="Format of the tables: csv or parquet.", show_default="csv"),
]
TopicOption = Annotated[
    list[str] | None,
    typer.Option("--topic", help="Topic of a bag, as imu=/imu/data, joints=… or odom=…; may be repeated."),
]
FromOption = Annotated[
    float | None, typer.Option("--from", help="Take every log from here on [s of the log].")
]
ToOption = Annotated[float | None, typer.Option("--to", help="Take every log up to here [s of the log].")]
ToleranceOption = Annotated[
    float,
    typer.Option(help="Discrepancy that does not matter, as a share of a channel's rms in motion."),
]
LatencyOption = Annotated[
    float,
    typer.Option(help="Largest delay between the stamps of two sensors that passes for latency [ms]."),
]
JobsOption = Annotated[int, typer.Option("--jobs", "-j", min=0, help="Processes; 0 means one per core.")]


def jsonable(value: Any) -> Any:
    """Return the value as JSON can hold it: NaN and infinity become null, records become objects."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: jsonable(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, str) or value is None or isinstance(value, bool):
        return value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Sequence):
        return [jsonable(v) for v in value]
    if hasattr(value, "tolist"):
        return jsonable(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


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


def warn(lines: Sequence[str]) -> None:
    """Print warnings on stderr, one line each."""
    from granite_lab.errors import printable

    for line in lines:
        print(f"warning: {printable(line)}", file=sys.stderr)


@contextmanager
def progress(quiet: bool) -> Iterator[Progress]:
    """Show progress on stderr where it is a terminal, and nothing elsewhere."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    shown = console(stderr=True)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=shown,
        transient=True,
        disable=quiet or not shown.is_terminal,
    ) as display:
        yield display


def chosen(
    paths: Sequence[Path] | None, robot: str | None, soil: str | None, column_map: str | None
) -> Chosen:
    """Return the logs that were named and what `granite-lab.toml` beside them says; tell which are excluded.

    Raises:
        UsageError, InputError: as `granite_lab.api.project.choose`.
    """
    from granite_lab.api.project import choose

    found = choose(list(paths or []), robot, soil, column_map)
    warn([f"{item.trial}: excluded: {item.reason}" for item in found.left_out])
    return found


def files_of(choice: Chosen) -> dict[str, Any]:
    """Return the trials that are excluded, as it stands in JSON; nothing where there are none."""
    return {"excluded": choice.left_out} if choice.left_out else {}


def refuse_missing(paths: Sequence[Path] | None) -> None:
    """Refuse logs of which none is there, before a command imports anything heavy.

    Raises:
        InputError: none of the paths exists.
    """
    if not paths:
        return
    with suppress(OSError):  # of a place that may not be searched, the refusal below says so
        if any(path.exists() for path in paths):
            return
    from granite_lab.files import refuse_special

    refuse_special(paths[0])


def window_of(start: float | None, end: float | None) -> tuple[float, float] | None:
    """Return the part of every log that is taken [s], infinite where open; None: the whole log.

    Raises:
        UsageError: it ends before it begins.
    """
    from granite_lab.errors import UsageError

    if start is None and end is None:
        return None
    window = -math.inf if start is None else start, math.inf if end is None else end
    if not window[0] < window[1]:
        raise UsageError(f"--from {window[0]:g} --to {window[1]:g}: not a window", "--from comes before --to")
    return window


def topics_of(given: Sequence[str] | None) -> dict[str, str]:
    """Return what topics of a bag are to be taken for, from texts like ``imu=/imu/data``.

    Raises:
        UsageError: a text cannot be understood.
    """
    from granite_lab.errors import UsageError
    from granite_lab.logs.bag import ROLES

    found: dict[str, str] = {}
    for text in given or ():
        role, sign, topic = (part.strip() for part in text.partition("="))
        if not sign or not topic or role not in ROLES or role in found:
            raise UsageError(
                f"--topic {text}: cannot be understood",
                f"write {', '.join(f'{r}=/topic' for r in ROLES)}, once each",
            )
        found[role] = topic
    return found
