"""Files: whole or not at all when written, readable trouble when they cannot be used."""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from granite_lab.errors import InputError, LabError

_REASONS = {
    errno.ENOENT: ("does not exist", "check the path"),
    errno.EISDIR: ("is a directory", "give the path of a file inside it"),
    errno.EEXIST: ("a part of its path is not a directory", "check the path"),
    errno.ENOTDIR: ("a part of its path is not a directory", "check the path"),
    errno.EACCES: ("permission denied", "check the permissions of the file and its folder"),
    errno.EPERM: ("permission denied", "check the permissions of the file and its folder"),
    errno.EROFS: ("the file system is read-only", "choose another folder"),
    errno.ENOSPC: ("no space left on the device", "free some space or choose another folder"),
    errno.EDQUOT: ("disk quota exceeded", "free some space or choose another folder"),
    errno.ELOOP: ("its symbolic links form a loop", "give the path of the file itself"),
    errno.ENAMETOOLONG: ("the file name is too long", "choose a shorter one"),
}


def readable(error: OSError, path: Path | str, doing: str = "read") -> LabError:
    """Return the user's version of an operating system error.

    Args:
        error: what the operating system said.
        path: the file it is about.
        doing: "read" gives an `InputError` (exit 3), anything else a plain `LabError` (exit 1).
    """
    what, hint = _REASONS.get(error.errno or 0, (error.strerror or type(error).__name__, ""))
    kind = InputError if doing == "read" else LabError
    return kind(f"{path}: cannot be {'read' if doing == 'read' else 'written'}: {what}", hint)


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file's content in hexadecimal.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise readable(error, path) from None


@contextmanager
def writing(path: Path) -> Iterator[BinaryIO]:
    """Open a new file beside `path` and rename it to `path` once the block has ended well.

    Readers see the old content or the new one, never a part. Missing folders are made; the mode
    follows the umask; a symbolic link keeps pointing where it did.

    Raises:
        LabError: the file cannot be written; nothing is left behind then.
    """
    try:
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        target.parent.mkdir(parents=True, exist_ok=True)
        # The name is cut so that the temporary one is never longer than the file system allows.
        temporary = target.with_name(f".{target.name[:200]}.{secrets.token_hex(6)}.part")
        try:
            with temporary.open("xb") as file:
                yield file
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise readable(error, path, "write") from error


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all.

    Raises:
        LabError: the file cannot be written.
    """
    with writing(path) as file:
        file.write(data)


def write_text(path: Path, text: str) -> None:
    r"""Write a UTF-8 text file, lines ending in ``\n``, whole or not at all.

    Raises:
        LabError: the file cannot be written.
    """
    write_bytes(path, text.encode("utf-8", errors="replace"))
