"""Arguments of the functions of the API are checked before anything is done."""

from __future__ import annotations

import difflib
import functools
import inspect
import numbers
import os
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_WORDS = {
    str: "a text", Path: "a path", float: "a number", int: "a whole number", bool: "True or False",
    type(None): "None", Mapping: "a dictionary", Sequence: "a list", Callable: "a function",
}  # fmt: skip


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function raise a TypeError that names the parameter, what was expected and what was given.

    Types that only a type checker imports are not checked.
    """
    signature = inspect.signature(function)

    @functools.cache
    def hints() -> dict[str, Any]:
        return typing.get_type_hints(function, localns=_Known(function))

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
            if name in hints() and not _fits(value, hints()[name]):
                expected, given = _words(hints()[name]), f"{value!r:.60} ({type(value).__name__})"
                raise TypeError(f"{function.__name__}(): {name}: expected {expected}, got {given}")
        return function(*args, **kwargs)

    return called


class _Known(dict[str, Any]):
    """Names in the annotations of a function; those that it does not import may be anything."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__()
        self._found = vars(typing) | vars(__import__("builtins")) | function.__globals__

    def __missing__(self, name: str) -> Any:
        return self._found.get(name, Any)


def _alternatives(hint: Any) -> tuple[Any, ...]:
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
    parts = _alternatives(hint)
    if len(parts) > 1:
        return any(_fits(value, part) for part in parts)
    kind, inside = typing.get_origin(hint) or hint, typing.get_args(hint)
    if kind in (float, int):
        number = numbers.Real if kind is float else numbers.Integral
        return isinstance(value, number) and not isinstance(value, bool)
    if kind is Path:
        return isinstance(value, os.PathLike)
    if kind is Sequence:
        listed = isinstance(value, Sequence) and not isinstance(value, str)
        return listed and (not inside or all(_fits(item, inside[0]) for item in value))
    if kind is Mapping:
        return isinstance(value, Mapping) and (
            len(inside) < 2 or all(_fits(v, inside[1]) for v in value.values())
        )
    return isinstance(value, kind) if isinstance(kind, type) else True
