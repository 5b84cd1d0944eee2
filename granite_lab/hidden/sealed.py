"""The sealed answer beside a set: not to be read by accident, and not to be changed unseen.

It is no secret: whoever wants to open it can. Nothing of the analysis does.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import zlib
from pathlib import Path
from typing import Any

from granite_lab.errors import InputError
from granite_lab.files import readable
from granite_lab.hidden.kit_check import HASH, HEAD, SEALED, seal

NAME = SEALED
"""Name of the file beside the trials."""

LARGEST = 10_000_000
"""Size [bytes] of an answer at most: one of a thousand trials takes a tenth of it."""

__all__ = ["NAME", "open_answer", "seal", "unseal"]


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
    if missing := _missing(answer):
        hint = "ask for the file that `granite-lab hide` or `check.py --seal` wrote"
        raise InputError(f"{where}: the sealed answer holds no {missing}", hint)
    return answer


def _missing(answer: dict[str, Any]) -> str:
    """Return what an answer lacks, in words."""
    trials, effects = answer.get("trials"), answer.get("effects")
    if not isinstance(trials, dict) or not trials:
        return "trials"
    if not all(isinstance(t, dict) and isinstance(t.get("sha256"), str) for t in trials.values()):
        return "hash of each trial"
    if not isinstance(effects, list) or not all(map(_is_effect, effects)):
        return "list of effects with their parameters"
    if "made_by" not in answer and not {"sand_off", "seed", "strength", "noise"} <= answer.keys():
        return "word on who or what made it"
    return ""


def _is_effect(effect: Any) -> bool:
    texts = isinstance(effect, dict) and all(
        isinstance(effect.get(key), str) for key in ("id", "title", "account")
    )
    parameters = effect.get("parameters") if texts else None
    known = isinstance(parameters, dict) and all(
        isinstance(p, dict) and isinstance(p.get("value"), (int, float)) and isinstance(p.get("unit"), str)
        for p in parameters.values()
    )
    return known and isinstance(effect.get("library"), bool)


def open_answer(folder: Path) -> dict[str, Any]:
    """Return the answer of a set's folder.

    Raises:
        InputError: there is none or not yet, it is damaged, or not the one whose hash was given beforehand.
    """
    path, promised = folder / NAME, folder / HASH
    if promised.is_file() and not path.exists():
        raise InputError(
            f"{path}: is missing, only its hash is present",
            "search with `granite-lab discover`, then ask the laboratory for it",
        )
    try:
        data = path.read_bytes()
        digest = promised.read_text(encoding="utf-8").split()[0] if promised.is_file() else None
    except (OSError, UnicodeDecodeError, IndexError) as error:
        if isinstance(error, OSError):
            raise readable(error, path) from None
        raise InputError(f"{promised}: contains no hash", "write it by `python check.py --seal`") from None
    if digest is not None and digest != hashlib.sha256(data).hexdigest():
        raise InputError(
            f"{path}: does not match the hash in {HASH}",
            "ask the laboratory for the file it sealed",
        )
    return unseal(data, path)
