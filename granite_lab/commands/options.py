"""Options that several commands share, and records of those that go together."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
import typing
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from granite_lab.errors import UsageError


def _complete(kind: str) -> Any:
    def names(incomplete: str) -> list[str]:
        from granite_lab.parameters import names as known

        return [name for name in known(kind) if name.startswith(incomplete)]

    return names


LOGS = "Logs (CSV, ROS bag, MCAP), or folders of them."

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress display.")]
Jobs = Annotated[int, typer.Option("--jobs", "-j", min=0, help="Processes; 0 means one per core.")]
Trials = Annotated[
    list[Path] | None,
    typer.Argument(metavar="TRIALS…", help=LOGS, show_default=False),
]
Robot = Annotated[
    str | None,
    typer.Option(help="Robot: a name of the catalogue or a .toml file.", autocompletion=_complete("robots")),
]
Soil = Annotated[
    str | None,
    typer.Option(help="Soil: a name of the catalogue or a .toml file.", autocompletion=_complete("soils")),
]
Map = Annotated[
    str | None,
    typer.Option(
        "--map",
        help="Column map: a name of the catalogue, a .toml file, or a folder of these.",
        autocompletion=_complete("loggers"),
    ),
]
Model = Annotated[
    Path | None, typer.Option("--model", help="model.toml: the paper's model with effects switched on.")
]
Effects = Annotated[
    Path | None,
    typer.Option("--effects", help="Effect file (.py). It is executed: use only code you trust."),
]
Grade = Annotated[str | None, typer.Option(help="IMU grade instead of the robot's.")]
Format = Annotated[
    str | None,
    typer.Option("--format", help="Format of the tables: csv or parquet.", show_default="csv"),
]
Topic = Annotated[
    list[str] | None,
    typer.Option("--topic", help="Topic of a bag, as imu=/imu/data, joints=… or odom=…; may be repeated."),
]


@dataclass(frozen=True)
class About:
    """What may be said about logs."""

    robot: Robot = None
    column_map: Map = None
    topic: Topic = None
    start: Annotated[
        float | None, typer.Option("--from", help="Begin of the part to use [s of the log].")
    ] = None
    end: Annotated[float | None, typer.Option("--to", help="End of the part to use [s of the log].")] = None

    def said(self) -> dict[str, Any]:
        """Return it as keywords of the API.

        Raises:
            UsageError: a topic cannot be understood, or the window ends before it begins.
        """
        window = -math.inf if self.start is None else self.start, math.inf if self.end is None else self.end
        if not window[0] < window[1]:
            raise UsageError(
                f"--from {window[0]:g} --to {window[1]:g}: not a window", "--from comes before --to"
            )
        said = {"robot": self.robot, "column_map": self.column_map, "topics": topics_of(self.topic)}
        return said | ({"window": window} if (self.start, self.end) != (None, None) else {})


@dataclass(frozen=True)
class Work(About):
    """What else may be said of work over many trials, and how it is done."""

    soil: Soil = None
    effects: Effects = None
    strict: Annotated[
        bool, typer.Option("--strict", help="Stop at a trial that fails; by default it is left out.")
    ] = False
    jobs: Jobs = 0
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Work on the Dask cluster with this scheduler."),
    ] = None
    cache: Annotated[
        bool, typer.Option("--cache/--no-cache", help="Store results and reuse those with the same inputs.")
    ] = True
    quiet: Quiet = False
    as_json: Json = False

    def said(self) -> dict[str, Any]:
        """Return it as keywords of the API."""
        names = ("soil", "effects", "strict", "jobs", "scheduler", "cache")
        return super().said() | {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class Search(Work):
    """What else a search for a missing effect goes by."""

    tolerance: Annotated[
        float,
        typer.Option(help="Accepted discrepancy, as a share of a channel's rms in motion."),
    ] = 0.02
    latency: Annotated[
        float,
        typer.Option(help="Largest delay between two sensors that counts as latency [ms]."),
    ] = 20.0

    def said(self) -> dict[str, Any]:
        """Return it as keywords of the API."""
        return super().said() | {"tolerance": self.tolerance, "latency": self.latency / 1e3}


def spread(command: Callable[..., None]) -> Callable[..., None]:
    """Make each field of the records that a command takes an option of the command."""
    hints = typing.get_type_hints(command, include_extras=True)
    parameters: list[inspect.Parameter] = []
    records: dict[str, Any] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        if dataclasses.is_dataclass(hints[name]):
            records[name] = hints[name]
            kinds = typing.get_type_hints(hints[name], include_extras=True)
            own = {f.name: (kinds[f.name], f.default) for f in dataclasses.fields(records[name])}
        else:
            own = {name: (hints[name], parameter.default)}
        parameters += [
            inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
            for key, (kind, default) in own.items()
        ]

    @functools.wraps(command)
    def called(**values: Any) -> None:
        made = {
            name: kind(**{f.name: values.pop(f.name) for f in dataclasses.fields(kind)})
            for name, kind in records.items()
        }
        command(**values, **made)

    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {p.name: p.annotation for p in parameters}
    return called


def topics_of(given: Sequence[str] | None) -> dict[str, str]:
    """Return what topics of a bag are to be taken for, from texts like ``imu=/imu/data``.

    Raises:
        UsageError: a text cannot be understood.
    """
    if not given:
        return {}
    from granite_lab.logs.bag import ROLES

    found: dict[str, str] = {}
    for text in given:
        role, sign, topic = (part.strip() for part in text.partition("="))
        if not sign or not topic or role not in ROLES or role in found:
            raise UsageError(
                f"--topic {text}: cannot be understood",
                f"write {', '.join(f'{r}=/topic' for r in ROLES)}, once each",
            )
        found[role] = topic
    return found


def numbers_of(option: str, given: Sequence[str] | None, shape: str) -> dict[str, float]:
    """Return the numbers in texts like ``name=1.5``.

    Raises:
        UsageError: a text cannot be understood.
    """
    found = {}
    for text in given or ():
        name, _, value = text.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise UsageError(f"{option} {text}: cannot be understood", f"write {shape}=number") from None
    return found


def picture_of(option: str, path: Path | None) -> Path | None:
    """Return the file of a picture.

    Raises:
        UsageError: it ends neither in .png nor in .svg.
    """
    if path and path.suffix.lower() not in (".png", ".svg"):
        raise UsageError(f"{option} {path}: not a picture", "end the name in .png or .svg")
    return path
