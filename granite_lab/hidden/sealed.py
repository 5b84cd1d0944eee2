"""The sealed answer beside a set: not to be read by accident, and not to be changed unseen.

It is no secret: whoever wants to open it can. Nothing of the analysis does.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from granite_lab.errors import InputError
from granite_lab.files import readable

NAME = "sealed.bin"
"""Name of the file beside the trials."""

_HEAD = b"granite-lab sealed answer 1; opened by: granite-lab reveal\n"


def seal(answer: Mapping[str, Any]) -> bytes:
    """Return the answer as the bytes of a sealed file."""
    plain = json.dumps(answer, sort_keys=True, allow_nan=False).encode()
    body = base64.encodebytes(zlib.compress(plain, 9)[::-1])
    return _HEAD + hashlib.sha256(plain).hexdigest().encode() + b"\n" + body


def unseal(data: bytes, where: Path | str) -> dict[str, Any]:
    """Return the answer from the bytes of a sealed file.

    Raises:
        InputError: they are not such a file, or it was changed.
    """
    if not data.startswith(_HEAD):
        raise InputError(f"{where}: not a sealed answer", "give a folder written by `granite-lab hide`")
    digest, _, body = data[len(_HEAD) :].partition(b"\n")
    try:
        plain = zlib.decompress(base64.b64decode(body)[::-1])
        answer = json.loads(plain)
    except (binascii.Error, zlib.error, ValueError):
        plain, answer = b"", None
    if hashlib.sha256(plain).hexdigest().encode() != digest or not isinstance(answer, dict):
        raise InputError(f"{where}: the sealed answer is damaged", "hide the set again with the same seed")
    return answer


def open_answer(folder: Path) -> dict[str, Any]:
    """Return the answer of a set's folder.

    Raises:
        InputError: there is none, or it is damaged.
    """
    path = folder / NAME
    try:
        return unseal(path.read_bytes(), path)
    except OSError as error:
        raise readable(error, path) from None
