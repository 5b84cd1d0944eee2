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
from typing import Any, ParamSpec, TypeVar

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


@dataclass(frozen=True)
class Parameter:
    """A parameter of a function.

    Attributes:
        name: in Python.
        kinds: types that it may have.
        default: `inspect.Parameter.empty` where a value must be given.
        help: what it is, from the docstring.
        arg: what its annotation says besides.
    """

    name: str
    kinds: tuple[Any, ...]
    default: Any
    help: str
    arg: Arg


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function raise a TypeError that names the parameter, what was expected and what was given.

    Keywords that several functions share (``**said: Unpack[…]``) stand in its signature and docstring like
    its own, and are handed over with their defaults. Types that only a type checker imports are not checked.
    """
    signature, hints, shared = _spelt_out(function)

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

    called.__signature__ = signature  # type: ignore[attr-defined]
    lines = "".join(f"    {name}: {_arg(hints[name]).help}.\n" for name in shared)
    called.__doc__ = re.sub(r"(?s)(Args:\n.*?\n)(?=\n|$)", rf"\g<1>{lines}", f"{inspect.getdoc(function)}\n")
    return called


def parameters_of(function: Callable[..., Any]) -> list[Parameter]:
    """Return the parameters of a function with a docstring."""
    hints = hints_of(function)
    if "said" in hints:
        hints |= typing.get_type_hints(typing.get_args(hints["said"])[0], include_extras=True)
    section = (inspect.getdoc(function) or "").partition("Args:\n")[2].partition("\n\n")[0]
    entries = re.findall(r"(?ms)^    (\w[\w, ]*): (.*?)(?=^    \w|\Z)", section + "\n")
    helps = {name: " ".join(text.split()) for names, text in entries for name in re.split(r",\s*", names)}
    return [
        Parameter(p.name, _alternatives(hints[p.name]), p.default, helps.get(p.name, ""), _arg(hints[p.name]))
        for p in inspect.signature(function).parameters.values()
    ]


def hints_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the annotations of a function."""
    return typing.get_type_hints(function, localns=_Known(function), include_extras=True)


class _Known(dict[str, Any]):
    """Names in the annotations of a function; those that it does not import may be anything."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__()
        self._found = vars(typing) | vars(builtins) | inspect.unwrap(function).__globals__

    def __missing__(self, name: str) -> Any:
        return self._found.get(name, Any)


def _spelt_out(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any], list[str]]:
    """Return signature and types of a function, shared keywords one by one, and the names of these."""
    signature = inspect.signature(function)
    hints = hints_of(function)
    parameters, shared = list(signature.parameters.values()), {}
    if parameters and parameters[-1].kind is inspect.Parameter.VAR_KEYWORD:
        (said,) = typing.get_args(hints[parameters.pop().name])
        shared = typing.get_type_hints(said, include_extras=True)
        parameters += [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=_arg(hint).default)
            for name, hint in shared.items()
        ]
    return signature.replace(parameters=parameters), hints | shared, list(shared)


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
