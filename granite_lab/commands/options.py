"""Options of the command line: those of a function of the API, and what a text stands for.

Name, type, unit, default, limits and help come from the function. The table `FLAGS` says what the command
line does in another way.
"""

from __future__ import annotations

import inspect
import math
import re
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from granite_lab.api.calls import Parameter
from granite_lab.errors import UsageError
from granite_lab.estimate import Estimate

T = TypeVar("T")

TRIALS = "Logs (CSV, ROS bag, MCAP), or folders of them."

Table = Annotated[Path | None, typer.Option("--out", help="Also write the table to this file (CSV).")]
Format = Annotated[
    str | None, typer.Option("--format", help="Format of the tables: csv or parquet.", show_default="csv")
]


@dataclass(frozen=True)
class Flag:
    """What the command line does in another way than the API with a parameter.

    Attributes:
        names: of the option; by default the parameter's name.
        kind: type of its value; by default the parameter's.
        read: turns that value, or each of a list, into the parameter's; raises a ValueError where it cannot.
        help: in place of the parameter's.
        hint: how to write what cannot be read.
        gather: makes one value of what was read of a list; raises as `read` does.
        metavar: of an argument; without one the parameter becomes an option.
        default: as it is written, where `read` changes it.
        shown: the default, in words.
    """

    names: tuple[str, ...] = ()
    kind: Any = None
    read: Callable[[Any], Any] | None = None
    help: str = ""
    hint: str = ""
    gather: Callable[[list[Any]], Any] = list
    metavar: str | None = None
    default: Any = None
    shown: str | None = None

    def named(self, name: str) -> str:
        """Return what a parameter is called on the command line."""
        return self.metavar or (*self.names, f"--{name.replace('_', '-')}")[0]

    def value_of(self, option: str, given: Any) -> Any:
        """Return the parameter's value for what was given, or raise a UsageError."""
        if self.read is None:
            return given
        texts = given if isinstance(given, list) else [given]
        try:
            found = [self.read(text) for text in texts]
            return self.gather(found) if isinstance(given, list) else found[0]
        except (KeyError, ValueError):
            shown = " ".join(map(str, texts))
            raise UsageError(f"{option} {shown}: cannot be understood", self.hint) from None


def said_for(text: str, names: Mapping[str, str]) -> str:
    """Return a text of the API as the command line has it: `names` in place of parameters, no backticks."""
    return re.sub(r"(?<!`)`(\w+)`(?!`)", lambda m: names.get(m[1], m[1]), text).replace("`", "")


def _once(pairs: Sequence[tuple[str, T]]) -> dict[str, T]:
    if len(found := dict(pairs)) < len(pairs):
        raise ValueError
    return found


def _number(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    return name.strip(), float(value)


def _topic(text: str) -> tuple[str, str]:
    from granite_lab.logs.bag import ROLES

    role, _, topic = (part.strip() for part in text.partition("="))
    if role not in ROLES or not topic:
        raise ValueError
    return role, topic


def _active(given: Sequence[tuple[str, float]]) -> dict[str, dict[str, float]]:
    """Return effects and their parameters, from names like ``bulldozing.strength`` and numbers."""
    found: dict[str, dict[str, float]] = {}
    for name, value in given:
        found.setdefault(name.partition(".")[0], {})[name.partition(".")[2]] = value
    return found


def _interval(text: str) -> tuple[float, float]:
    start, end = map(float, text.split(":"))
    if not start < end:
        raise ValueError
    return start, end


def _measured(text: str) -> Estimate:
    value, _, std = text.replace("+-", "±").partition("±")
    measured = Estimate(float(value), float(std) if std else 0.005)
    if not (measured.value > 0 and measured.std > 0):
        raise ValueError
    return measured


def _slips(text: str) -> list[float]:
    """Return the slip ratios that a text asks for: one, or start:end:step with both ends."""
    parts = [float(part) for part in text.split(":")]
    if len(parts) == 1:
        return parts
    start, end, step = parts
    if not (0 <= end - start <= 2 and step > 2e-4):  # at most 10,000 steps
        raise ValueError
    return [round(start + k * step, 12) for k in range(round((end - start) / step) + 1)]


def picture(text: str, **more: Any) -> Any:
    """Return the option for the file of a picture; `more` as of `typer.Option`."""

    def checked(option: typer.CallbackParam, path: Path | None) -> Path | None:
        if path and path.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise UsageError(f"{option.opts[0]} {path}: not a picture", "end the name in .png, .svg or .pdf")
        return path

    return typer.Option(help=f"{text} (.png, .svg or .pdf).", callback=checked, **more)


FLAGS: dict[str, Flag] = {
    "logs": Flag(kind=list[Path], metavar="TRIALS…", help=TRIALS),
    "folder": Flag(metavar="DIR"),
    "effect_id": Flag(metavar="ID"),
    "robot": Flag(kind=str),
    "soil": Flag(kind=str),
    "column_map": Flag(("--map",), str),
    "topics": Flag(
        ("--topic",), list[str], _topic,
        help="Topic of a bag, as imu=/imu/data, joints=… or odom=…; may be repeated.",
        hint="write imu=/topic, joints=…, odom=… or reference=…, once each", gather=_once,
    ),
    "jobs": Flag(("--jobs", "-j")),
    "latency": Flag(
        read=lambda ms: ms / 1e3, default=20.0,
        help="Largest delay between two sensors that counts as latency [ms].",
    ),
    "rests": Flag(
        ("--rest",), list[str], _interval, help="Interval of standstill, as 0:1.2 [s]; may be repeated.",
        hint="write start:end in seconds, the start first, as 0:1.2",
    ),
    "distance_measured": Flag(
        kind=str, read=_measured, help="Total distance by tape [m], as 2.03 or 2.03±0.01.",
        hint="write 2.03 or 2.03±0.01 [m]",
    ),
    "against_reference": Flag(
        ("--against",), str, {"ref": True}.__getitem__, hint="use --against ref",
        help="'ref': judge the estimate by the log's reference, which the filter does not use.",
    ),
    "slip": Flag(
        kind=str, read=_slips, default="0.2", hint="write 0.2, or start:end:step, as 0:0.9:0.1",
        help="Slip ratio λ of (1), as 0.2, or a sweep start:end:step, as -0.5:0.9:0.1.",
    ),
    "sinkage": Flag(read=lambda mm: mm / 1000, help="Sinkage [mm] instead of a load."),
    "soil_values": Flag(
        ("--soil-value",), list[str], _number, hint="write key=number", gather=_once,
        help="A value instead of the soil's, as cohesion_Pa=500; may be repeated.",
    ),
    "active": Flag(
        ("--effect",), list[str], _number, hint="write id.parameter=number", gather=_active,
        help="Switch an effect on, as bulldozing.strength=0.5; may be repeated.",
    ),
    "sizes": Flag(
        ("--size",), list[str], _number, hint="write name=number", gather=_once,
        help="A parameter of the effect: name=value, or id.name=value; may be repeated.",
    ),
    "label": Flag(("--name",)),
}  # fmt: skip
"""By the parameter's name."""

AT_HAND = replace(
    FLAGS["logs"],
    help=f"{TRIALS} By default those that granite-lab.toml names, else those that ingest has read, else "
    "data/samples.",
)
"""Logs of commands that take those at hand where none are given."""

FROM, TO = "--from", "--to"


def options_of(
    parameters: Sequence[Parameter], flags: Mapping[str, Flag], names: Mapping[str, str]
) -> list[inspect.Parameter]:
    """Return the options of a command that stand for parameters of the API; a window is two of them.

    `names` says what all are called on the command line.
    """
    found: list[tuple[str, Any, Any]] = []
    for p in parameters:
        flag = flags.get(p.name, Flag())
        if p.name == "window":
            for name, what in ((FROM, "Start"), (TO, "End")):
                text = f"{what} of the part to use [s, the log's time]."
                found.append((name[2:] + "_", Annotated[float | None, typer.Option(name, help=text)], None))
            continue
        if typing.get_origin(p.kinds[0]) is Callable:
            continue
        kinds = [kind for kind in p.kinds if kind in (bool, int, float, str, Path)]
        kind: Any = flag.kind or (Path if Path in kinds else kinds[0])
        text = flag.help or p.help
        if re.match(r"[a-z]+[ ,;:]", text):  # a word, no symbol or value
            text = text[0].upper() + text[1:]
        text = said_for(text, names)
        if p.arg.low > 0 or p.arg.high < math.inf:
            text = f"{text.rstrip('.')} ({p.arg.limits})."
        if flag.metavar is not None:
            about: Any = typer.Argument(metavar=flag.metavar, help=text, show_default=False)
        else:
            name = names[p.name]
            own = flag.names or ((f"{name}/--no-{name[2:]}" if p.default is True else name),)
            about = typer.Option(*own, help=text, show_default=flag.shown or True)
        kind = kind | None if p.default is None or flag.kind is not None else kind
        default = flag.default if flag.default is not None else None if flag.kind else p.default
        found.append((p.name, Annotated[kind, about], default))
    keyword = inspect.Parameter.KEYWORD_ONLY
    return [inspect.Parameter(name, keyword, annotation=kind, default=d) for name, kind, d in found]


def said_of(values: Mapping[str, Any], flags: Mapping[str, Flag]) -> dict[str, Any]:
    """Return keywords of the API for values of the options; what was not given is left to the API.

    Raises:
        UsageError: a text cannot be understood, or the window ends before it begins.
    """
    said: dict[str, Any] = {"logs": []} if "logs" in values else {}
    for name, value in values.items():
        if value is not None and value != []:
            flag = flags.get(name, Flag())
            said[name] = flag.value_of(replace(flag, metavar=None).named(name), value)
    begin, end = said.pop("from_", -math.inf), said.pop("to_", math.inf)
    if not begin < end:
        raise UsageError(f"{FROM} {begin:g} {TO} {end:g}: not a window", f"{FROM} comes before {TO}")
    return said if (begin, end) == (-math.inf, math.inf) else said | {"window": (begin, end)}
