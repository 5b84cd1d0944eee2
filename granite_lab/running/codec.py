"""Records as bytes and back: arrays in an npz archive without pickle, everything else as JSON in it."""

from __future__ import annotations

import dataclasses
import importlib
import io
import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from granite_lab.model.effect import Active, Effect

TEXT = "record"
"""Name of the array that holds the JSON text in UTF-8."""


def encode(record: Any) -> bytes:
    """Return a record of this package as bytes; equal records give equal bytes.

    Args:
        record: frozen dataclasses, tuples, lists, dictionaries, texts, numbers and NumPy arrays.

    Raises:
        TypeError: something else is in it.
    """
    arrays: list[Any] = []
    text = json.dumps(_flat(record, arrays), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    named = {f"a{i}": array for i, array in enumerate(arrays)}
    named[TEXT] = np.frombuffer(text.encode("utf-8", errors="surrogatepass"), dtype=np.uint8)
    out = io.BytesIO()
    np.savez(out, allow_pickle=False, **named)
    return out.getvalue()


def decode(data: bytes, effects: Mapping[str, Effect] | None = None) -> Any:
    """Return the record that `encode` took.

    Args:
        data: the bytes.
        effects: by id, for records that hold effects which are switched on.

    Raises:
        ValueError, KeyError, OSError and others: the bytes are not whole or of another version.
    """
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        arrays = [archive[f"a{i}"] for i in range(len(archive.files) - 1)]
        text = archive[TEXT].tobytes().decode("utf-8", errors="surrogatepass")
    return _built(json.loads(text), arrays, effects or {})


def _flat(value: Any, arrays: list[Any]) -> Any:  # noqa: PLR0911, one line a type
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, np.generic):
        return _flat(value.item(), arrays)
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"float": repr(value)}
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise TypeError("an array of objects cannot be stored")
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, (tuple, list)):
        return {type(value).__name__: [_flat(v, arrays) for v in value]}
    if isinstance(value, Mapping):
        return {"dict": [[_flat(k, arrays), _flat(v, arrays)] for k, v in value.items()]}
    if isinstance(value, Path):
        return {"path": str(value)}
    if isinstance(value, Active):
        return {"active": value.id, "values": list(value.values)}
    cls = type(value)
    if dataclasses.is_dataclass(cls) and cls.__module__.startswith("granite_lab."):
        fields = {f.name: _flat(getattr(value, f.name), arrays) for f in dataclasses.fields(cls)}
        return {"record": f"{cls.__module__}:{cls.__qualname__}", "fields": fields}
    raise TypeError(f"a {cls.__name__} cannot be stored")


def _built(tree: Any, arrays: list[Any], effects: Mapping[str, Effect]) -> Any:  # noqa: PLR0911
    if isinstance(tree, str):
        return sys.intern(tree)  # a phase stands at each sample: one text for all
    if not isinstance(tree, dict):
        return tree
    kind, held = next(iter(tree.items()))
    match kind:
        case "float":
            return float(held)
        case "array":
            return arrays[held]
        case "tuple":
            return tuple(_built(v, arrays, effects) for v in held)
        case "list":
            return [_built(v, arrays, effects) for v in held]
        case "dict":
            return {_built(k, arrays, effects): _built(v, arrays, effects) for k, v in held}
        case "path":
            return Path(held)
        case "active":
            return Active(effects[held], tuple(float(v) for v in tree["values"]))
    fields = {name: _built(v, arrays, effects) for name, v in tree["fields"].items()}
    return _class(held)(**fields)


def _class(name: str) -> Any:
    module, _, path = name.partition(":")
    if not module.startswith("granite_lab."):
        raise ValueError(f"{name} is no record of this package")
    found: Any = importlib.import_module(module)
    for part in path.split("."):
        found = getattr(found, part)
    if not dataclasses.is_dataclass(found):
        raise ValueError(f"{name} is no record")
    return found
