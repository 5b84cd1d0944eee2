"""Arguments of the functions of the API are checked before anything is done."""

from __future__ import annotations

import builtins
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

from granite_lab.inference.constants import LATENCY_LIMIT, TOLERANCE

P = ParamSpec("P")
R = TypeVar("R")

DEFAULTS = {
    "tolerance": TOLERANCE, "latency": LATENCY_LIMIT, "strict": False, "jobs": 0, "cache": True,
    "done": lambda _: None, "progress": lambda *_: None,
}  # fmt: skip
"""Defaults of keywords that several functions share; that of the others is None."""

_WORDS = {
    str: "a text", Path: "a path", float: "a number", int: "a whole number", bool: "True or False",
    type(None): "None", Mapping: "a dictionary", Sequence: "a list", Callable: "a function",
}  # fmt: skip


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function raise a TypeError that names the parameter, what was expected and what was given.

    Keywords that several functions share (``**said: Unpack[…]``) stand in its signature like its own.
    Types that only a type checker imports are not checked.
    """
    signature, hints = _spelt_out(function)

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
        return function(*args, **kwargs)

    called.__signature__ = signature  # type: ignore[attr-defined]
    return called


class _Known(dict[str, Any]):
    """Names in the annotations of a function; those that it does not import may be anything."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__()
        self._found = vars(typing) | vars(builtins) | function.__globals__

    def __missing__(self, name: str) -> Any:
        return self._found.get(name, Any)


def _spelt_out(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    """Return the signature of a function with its shared keywords one by one, and the type of each."""
    signature = inspect.signature(function)
    hints = typing.get_type_hints(function, localns=_Known(function))
    parameters = list(signature.parameters.values())
    if parameters and parameters[-1].kind is inspect.Parameter.VAR_KEYWORD:
        (shared,) = typing.get_args(hints[parameters.pop().name])
        hints |= typing.get_type_hints(shared)
        parameters += [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=DEFAULTS.get(name))
            for name in typing.get_type_hints(shared)
        ]
    return signature.replace(parameters=parameters), hints


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
