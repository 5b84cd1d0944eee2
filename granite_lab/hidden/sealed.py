"""The answer beside a set of trials: sealed by `hide`, or written by another laboratory as `answer.json`.

The seal keeps an answer from being read by accident and changed unseen. It is no secret: anybody
can open it. The analysis does not.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import math
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from granite_lab.errors import InputError, nearest
from granite_lab.files import read_json, readable

HEAD = b"granite-lab sealed answer 1; opened by: granite-lab reveal\n"

NAME, OPEN = "sealed.bin", "answer.json"
"""Names of the sealed and of the open file beside the trials."""

OUTSIDE = "unknown"
"""Id of a cause outside of the library, in an open answer."""

LARGEST = 10_000_000
"""Size [bytes] of an answer at most: one of a thousand trials takes a tenth of it."""


def seal(answer: Mapping[str, Any]) -> bytes:
    """Return the answer as the bytes of a sealed file."""
    plain = json.dumps(answer, sort_keys=True, allow_nan=False).encode()
    body = base64.encodebytes(zlib.compress(plain, 9)[::-1])
    return HEAD + hashlib.sha256(plain).hexdigest().encode() + b"\n" + body


def unseal(data: bytes, where: Path | str) -> dict[str, Any]:
    """Return the answer from the bytes of a sealed file.

    Raises:
        InputError: they are not such a file, or it was changed.
    """
    if not data.startswith(HEAD):
        raise InputError(f"{where}: not a sealed answer", "give a folder written by `granite-lab hide`")
    digest, _, body = data[len(HEAD) :].partition(b"\n")
    try:
        plain = zlib.decompressobj().decompress(base64.b64decode(body)[::-1], LARGEST)
        answer = json.loads(plain)
    except (binascii.Error, zlib.error, ValueError, RecursionError):
        plain, answer = b"", None
    if hashlib.sha256(plain).hexdigest().encode() != digest or not isinstance(answer, dict):
        raise InputError(f"{where}: the sealed answer is damaged", "hide the set again with the same seed")
    if not _complete(answer):
        hint = "give the file that `granite-lab hide` wrote"
        raise InputError(f"{where}: the sealed answer is incomplete", hint)
    return answer


def _complete(answer: Mapping[str, Any]) -> bool:
    """Say whether an answer holds settings, trials with their hashes, and effects with their parameters."""
    try:
        parameters = [p for e in answer["effects"] for p in e["parameters"].values()]
        texts = [trial["sha256"] for trial in answer["trials"].values()]
        texts += [e[key] for e in answer["effects"] for key in ("id", "title", "account")]
        texts += [p["unit"] for p in parameters]
        numbers = all(math.isfinite(p["value"]) for p in parameters)
        settings = {"sand_off", "seed", "strength", "noise"} <= answer.keys()
        return bool(answer["trials"]) and numbers and settings and all(isinstance(x, str) for x in texts)
    except (KeyError, TypeError, AttributeError):
        return False


def open_answer(folder: Path) -> dict[str, Any]:
    """Return the sealed answer of a folder of trials.

    Raises:
        InputError: there is none, or it is damaged.
    """
    path = folder / NAME
    try:
        return unseal(path.read_bytes(), path)
    except OSError as error:
        raise readable(error, path) from None


def read_answer(path: Path, units: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """Return an open answer, in the form of a sealed one.

    Args:
        path: JSON, as ``{"effects": [{"id": "tyre_windup", "parameters": {"compliance": 0.002}}]}``.
        units: unit of each parameter of each effect of the library, which the answer may name.

    Raises:
        InputError: it cannot be read, is another document, or names what there is not.
    """
    example = 'expected {"effects": [{"id": "tyre_windup", "parameters": {"compliance": 0.002}}]}'
    document = read_json(path, example)
    try:
        effects = document["effects"]
        named = [(str(e["id"]), str(e.get("title", "")), dict(e.get("parameters", {}))) for e in effects]
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError(f"{path}: no answer that can be used", example) from None
    return {"effects": [_effect(path, *each, units) for each in named], "trials": {}}


def _effect(
    path: Path, name: str, title: str, parameters: Mapping[str, Any], units: Mapping[str, Mapping[str, str]]
) -> dict[str, Any]:
    """Return one effect of an open answer, in the form of a sealed one."""
    if name == OUTSIDE and not title.strip():
        raise InputError(f"{path}: '{OUTSIDE}' has no title", 'state the cause: "title": "a magnet"')
    if name != OUTSIDE and name not in units:
        other = f"`granite-lab effects` lists the ids; any other cause is '{OUTSIDE}' with a title"
        raise InputError(f"{path}: unknown effect '{name}'", f"{nearest(name, units)} {other}")
    allowed = units.get(name, {})
    for key, value in parameters.items():
        if key not in allowed:
            known = f"known: {', '.join(allowed)}" if allowed else "leave the parameters out"
            raise InputError(f"{path}: {name} has no parameter '{key}'", known)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise InputError(f"{path}: {name}: {key} = {value!r} is not a number", "write a plain number")
    sizes = {
        key: {"value": value, "unit": allowed[key], "kind": "equivalent"} for key, value in parameters.items()
    }
    return {"id": name, "title": title, "account": "", "library": name != OUTSIDE, "parameters": sizes}
