"""Arguments of the functions of the API: declared once, checked before anything is done.

The command line takes its options from here, too: `parameters_of`.
"""

from __future__ import annotations

import builtins
import difflib
import functools
import inspect
import math
import numbers
import os
import re
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, ParamSpec, TypeVar

from granite_lab.errors import UsageError

P = ParamSpec("P")
R = TypeVar("R")

_KINDS: dict[Any, tuple[str, Any]] = {
    str: ("a text", str), Path: ("a path", os.PathLike), bool: ("True or False", bool),
    float: ("a number", numbers.Real), int: ("a whole number", numbers.Integral),
    type(None): ("None", type(None)), Mapping: ("a dictionary", Mapping), Sequence: ("a list", Sequence),
    Callable: ("a function", Callable),
}  # fmt: skip
"""Type of an annotation to what it is called, and to the type of its values."""


@dataclass(frozen=True)
class Arg:
    """What an annotation says of an argument besides its type, as ``Annotated[float, Arg(low=0)]``.

    Attributes:
        help: what it is; of a keyword that several functions share, whose docstrings it completes.
        default: of such a keyword.
        low, high: limits of a number.
    """

    help: str = ""
    default: Any = None
    low: float = -math.inf
    high: float = math.inf

    def refuse(self, name: str, value: Any) -> None:
        """Raise a UsageError for a number that is out of its limits."""
        if isinstance(value, (int, float)) and not self.low <= value <= self.high:
            option = f"--{name.replace('_', '-')} {value:g}"
            raise UsageError(f"{option} is out of range", f"expected a number of {self.limits}")

    @property
    def limits(self) -> str:
        """The limits in words."""
        return f"{self.low:g} to {self.high:g}" if self.high < math.inf else f"{self.low:g} or more"


NAMED = "a name of the catalogue or a .toml file"
File = str | Path | None

RobotFile = Annotated[
    File, Arg(f"the robot: {NAMED}; by default as granite-lab.toml or the log says, else granite")
]
SoilFile = Annotated[
    File, Arg(f"the soil: {NAMED}; by default as granite-lab.toml or the log says, else dry_sand")
]
MapFile = Annotated[File, Arg(f"column map: {NAMED}, or a folder of these")]
ModelFile = Annotated[File, Arg("file (model.toml) of the paper's model with effects switched on")]
EffectFile = Annotated[File, Arg("your own effect file (.py). It is executed: use only code you trust")]
Topics = Annotated[
    Mapping[str, str] | None, Arg("of bags, ``imu``, ``joints`` and ``odom`` to the name of a topic")
]
Strict = Annotated[
    bool, Arg("a trial that fails is an error; by default it is left out and listed in the result", False)
]
Jobs = Annotated[int, Arg("number of processes; 0 means one per core", 0, low=0)]
Done = Annotated[Callable[[Path], None], Arg("called with each path once it is finished", lambda _: None)]


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function raise a TypeError that names the parameter, what was expected and what was given.

    Keywords that several functions share (``**said: Unpack[…]``) stand in its signature like its own, and are
    handed over with their defaults; what their annotations say of them completes its docstring. Types that
    only a type checker imports are not checked.
    """
    signature, hints = inspect.signature(function), hints_of(function)
    parameters = list(signature.parameters.values())
    if parameters and parameters[-1].kind is inspect.Parameter.VAR_KEYWORD:
        (said,) = typing.get_args(hints.pop(parameters.pop().name))
        hints |= (shared := typing.get_type_hints(said, include_extras=True))
        keyword = inspect.Parameter.KEYWORD_ONLY
        parameters += [inspect.Parameter(n, keyword, default=_arg(h).default) for n, h in shared.items()]
        signature = signature.replace(parameters=parameters)

    @functools.wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        known = signature.parameters
        for name in (n for n in kwargs if n not in known):
            close = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(known)}"
            raise TypeError(f"{function.__name__}(): unknown parameter '{name}'; {hint}")
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError as error:
            raise TypeError(f"{function.__name__}(): {error}") from None
        for name, value in bound.arguments.items():
            if not _fits(value, hints[name]):
                expected, given = _words(hints[name]), f"{value!r:.60} ({type(value).__name__})"
                raise TypeError(f"{function.__name__}(): {name}: expected {expected}, got {given}")
            _arg(hints[name]).refuse(name, value)
        bound.apply_defaults()
        return function(*bound.args, **bound.kwargs)

    vars(called).update(__signature__=signature, hints=hints)
    parts = (inspect.getdoc(function) or "").split("\n\n")
    if lines := [f"\n    {name}: {_arg(h).help}." for name, h in hints.items() if _arg(h).help]:
        sections = (i for i, part in enumerate(parts) if part.startswith(("Args:", "Returns:", "Raises:")))
        place = next(sections, len(parts))
        parts[place:place] = [] if any(part.startswith("Args:") for part in parts) else ["Args:"]
        parts[place] += "".join(lines)
    called.__doc__ = "\n\n".join(parts)
    return called


class Parameter(NamedTuple):
    """A parameter of a function: its name, the types that it may have, its default and what is said of it."""

    name: str
    kinds: tuple[Any, ...]
    default: Any
    help: str
    arg: Arg


def parameters_of(function: Callable[..., Any]) -> list[Parameter]:
    """Return the parameters of a function with a docstring."""
    hints = vars(function).get("hints") or hints_of(function)
    section = (inspect.getdoc(function) or "").partition("Args:\n")[2].partition("\n\n")[0]
    entries = re.findall(r"(?ms)^    (\w[\w, ]*): (.*?)(?=^    \w|\Z)", section + "\n")
    helps = {name: " ".join(text.split()) for names, text in entries for name in re.split(r",\s*", names)}
    return [
        Parameter(p.name, _alternatives(hints[p.name]), p.default, helps.get(p.name, ""), _arg(hints[p.name]))
        for p in inspect.signature(function).parameters.values()
    ]


def hints_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the annotations of a function; names in them that it does not import may be anything."""
    known = _Known(vars(typing) | function.__globals__)
    return typing.get_type_hints(function, localns=known, include_extras=True)


class _Known(dict[str, Any]):
    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name, Any)


def _arg(hint: Any) -> Arg:
    return next((x for x in getattr(hint, "__metadata__", ()) if isinstance(x, Arg)), Arg())


def _alternatives(hint: Any) -> tuple[Any, ...]:
    if typing.get_origin(hint) is typing.Annotated:
        return _alternatives(hint.__origin__)
    if isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union:
        return tuple(dict.fromkeys(p for part in typing.get_args(hint) for p in _alternatives(part)))
    return (hint,)


def _parts(hint: Any) -> Iterator[tuple[Any, tuple[Any, ...], str, Any]]:
    """Yield of each alternative its kind, what is inside, what it is called and the type of its values."""
    for part in _alternatives(hint):
        kind = typing.get_origin(part) or part
        yield kind, typing.get_args(part), *_KINDS.get(kind, (getattr(kind, "__name__", str(kind)), kind))


def _words(hint: Any) -> str:
    words = [f"{w} of ({_words(k[0])})" if kind is Sequence and k else w for kind, k, w, _ in _parts(hint)]
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _fits(value: Any, hint: Any) -> bool:
    for kind, inside, _, accepted in _parts(hint):
        if not isinstance(accepted, type):  # anything
            return True
        mistaken = {bool: (float, int), str: (Sequence,)}.get(type(value), ())
        if kind not in mistaken and isinstance(value, accepted):
            given: Any = value
            items = given.values() if kind is Mapping else given if kind is Sequence else ()
            if not inside or all(_fits(item, inside[-1]) for item in items):
                return True
    return False
