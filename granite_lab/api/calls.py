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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ParamSpec, TypeVar

from granite_lab.errors import UsageError

P = ParamSpec("P")
R = TypeVar("R")

_WORDS = {
    str: "a text", Path: "a path", float: "a number", int: "a whole number", bool: "True or False",
    type(None): "None", Mapping: "a dictionary", Sequence: "a list", Callable: "a function",
}  # fmt: skip


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
        """Refuse a number that is out of its limits.

        Raises:
            UsageError: it is.
        """
        if isinstance(value, (int, float)) and not self.low <= value <= self.high:
            option = f"--{name.replace('_', '-')} {value:g}"
            raise UsageError(f"{option} is out of range", f"expected a number of {self.limits}")

    @property
    def limits(self) -> str:
        """The limits in words."""
        if self.high < math.inf:
            return f"{self.low:g} to {self.high:g}"
        return f"{self.low:g} or more"


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
Jobs = Annotated[int, Arg("number of processes; 0 means one per core", 0, low=0)]
Done = Annotated[Callable[[Path], None], Arg("called with each path once it is finished", lambda _: None)]


@dataclass(frozen=True)
class Parameter:
    """A parameter of a function: its name, the types that it may have, its default and what is said of it."""

    name: str
    kinds: tuple[Any, ...]
    default: Any
    help: str
    arg: Arg


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
        parameters += [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=_arg(hint).default)
            for name, hint in shared.items()
        ]
        signature = signature.replace(parameters=parameters)

    @functools.wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        for name in kwargs:
            if name not in signature.parameters:
                close = difflib.get_close_matches(name, signature.parameters, n=1)
                hint = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(signature.parameters)}"
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
    called.__doc__ = _completed(inspect.getdoc(function) or "", hints)
    return called


def _completed(doc: str, hints: Mapping[str, Any]) -> str:
    """Return a docstring with the arguments that are described in their annotations."""
    lines = [f"\n    {name}: {_arg(hint).help}." for name, hint in hints.items() if _arg(hint).help]
    if not lines:
        return doc
    parts = doc.split("\n\n")
    known = (i for i, part in enumerate(parts) if part.startswith(("Args:", "Returns:", "Raises:")))
    place = next(known, len(parts))
    if not any(part.startswith("Args:") for part in parts):
        parts.insert(place, "Args:")
    parts[place] += "".join(lines)
    return "\n\n".join(parts)


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
    return typing.get_type_hints(
        function, localns=_Known(vars(typing) | function.__globals__), include_extras=True
    )


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


def _words(hint: Any) -> str:
    words = []
    for part in _alternatives(hint):
        kind, inside = typing.get_origin(part) or part, typing.get_args(part)
        word = _WORDS.get(kind, getattr(kind, "__name__", str(kind)))
        words.append(f"{word} of ({_words(inside[0])})" if kind is Sequence and inside else word)
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _fits(value: Any, hint: Any) -> bool:
    return any(_is(value, typing.get_origin(x) or x, typing.get_args(x)) for x in _alternatives(hint))


def _is(value: Any, kind: Any, inside: tuple[Any, ...]) -> bool:
    if kind in (float, int):
        number = numbers.Real if kind is float else numbers.Integral
        return isinstance(value, number) and not isinstance(value, bool)
    if kind is Path:
        return isinstance(value, os.PathLike)
    if kind is Sequence:
        listed = isinstance(value, Sequence) and not isinstance(value, str)
        return listed and (not inside or all(_fits(item, inside[0]) for item in value))
    if kind is Mapping:
        return isinstance(value, Mapping) and all(_fits(v, inside[1]) for v in value.values())
    return isinstance(value, kind) if isinstance(kind, type) else True
