"""Folders of results: filled all at once; of the files that are there only one's own are replaced or removed.

Each folder keeps a list of the files that were written into it. What is not on the list belongs to the user.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import chain, count
from pathlib import Path

from granite_lab.errors import LabError
from granite_lab.files import readable, sha256, write_text

LIST, SCHEMA = "written-files.json", "granite-lab/written/1"
"""Name and schema of the list of a folder."""

MARK, UNFINISHED = "unfinished", "an unfinished folder of results of granite-lab\n"
"""File, and its content, by which a folder that a killed run left behind is known."""


def written_in(folder: Path) -> dict[str, dict[str, str]]:
    """Return the files that were written into a folder: part of the results to path in it to SHA-256.

    Raises:
        LabError: what stands in place of the list is no list, or cannot be read.
    """
    path = folder / LIST
    try:
        document = json.loads(path.read_bytes())
        if document["schema"] != SCHEMA:
            raise ValueError
        parts = {
            part: {str(n): str(sha) for n, sha in files.items()} for part, files in document["parts"].items()
        }
        if any(
            Path(name).is_absolute() or ".." in Path(name).parts for part in parts.values() for name in part
        ):
            raise ValueError  # by such a list, of a foreign folder, files outside of it would be removed
        return parts
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise readable(error, path, "write") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise LabError(f"{path}: is no list of written files", "choose another folder") from None


def files_of(folder: Path) -> list[Path]:
    """Return the files that were written into a folder and into the folders in it, by their lists."""
    lists = [path for path in (folder / LIST, *sorted(folder.glob(f"*/{LIST}"))) if path.is_file()]
    names = [
        (path.parent, name) for path in lists for files in written_in(path.parent).values() for name in files
    ]
    return sorted(parent / name for parent, name in names)


def distinct(names: Sequence[str]) -> list[str]:
    """Return names of files, later ones numbered where they repeat, be it in capitals."""
    seen: list[str] = []
    for name in names:
        taken = {other.casefold() for other in seen}
        again = (f"{name} ({k})" for k in count(2))
        seen.append(
            next(candidate for candidate in chain([name], again) if candidate.casefold() not in taken)
        )
    return seen


@contextmanager
def replacing(folder: Path, part: str) -> Iterator[Path]:
    """Give a new folder to write into, and move its files into `folder` once the block ended well.

    Files that an earlier run wrote as the same part and this one did not are removed, unless they were
    changed since. All other files stay.

    Args:
        folder: of the results; made if it does not exist.
        part: name of the part of the results that is written.

    Raises:
        LabError: something cannot be written, or a file is in the way that was not written by granite-lab;
            `folder` is then as it was before.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name[:100]}.", dir=folder.parent) as temporary:
            (Path(temporary) / MARK).write_text(UNFINISHED, encoding="utf-8")
            new = Path(temporary) / "new"
            new.mkdir()
            yield new
            _move(new, folder, part)
    except OSError as error:
        raise readable(error, folder, "write") from error


def refuse_foreign(folder: Path, names: Iterable[str | Path]) -> None:
    """Refuse to write files into a folder where others are that granite-lab did not write.

    Raises:
        LabError: one of the files is in the way.
    """
    written = {name for files in written_in(folder).values() for name in files}
    for name in map(Path, names):
        target = folder / name
        if os.path.lexists(target) and (name.as_posix() not in written or target.is_dir()):
            hint = "move it away, or choose another --out"
            raise LabError(f"{target}: is in the way, and granite-lab did not write it", hint)


def _move(new: Path, folder: Path, part: str) -> None:
    """Move the files of a new folder into an old one and bring its list up to date."""
    files = [path.relative_to(new) for path in new.rglob("*") if path.is_file()]
    # The page comes last, so that all files to which it refers are there.
    files.sort(key=lambda name: (name.suffix == ".html", name.as_posix()))
    refuse_foreign(folder, files)
    parts = written_in(folder)
    made = {name.as_posix(): sha256(new / name) for name in files}
    stale = {name: sha for name, sha in parts.get(part, {}).items() if name not in made}
    if not made and not stale:
        return
    parts = {other: {n: sha for n, sha in known.items() if n not in made} for other, known in parts.items()}
    folder.mkdir(exist_ok=True)
    # A run that is killed in between has its files on the list already.
    _save(folder, parts | {part: stale | made})
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (new / name).replace(folder / name)
    _remove(folder, stale)
    _save(folder, parts | {part: made})


def _remove(folder: Path, files: Mapping[str, str]) -> None:
    """Remove files of a folder that still have the content of that SHA-256, and folders that this empties."""
    for name, sha in files.items():
        path = folder / name
        if path.is_file() and not path.is_symlink() and sha256(path) == sha:
            path.unlink()
            with suppress(OSError):  # the first that is not empty
                for above in path.parents[: len(Path(name).parts) - 1]:
                    above.rmdir()


def _save(folder: Path, parts: Mapping[str, Mapping[str, str]]) -> None:
    known = {part: dict(sorted(files.items())) for part, files in sorted(parts.items()) if files}
    if known:
        write_text(folder / LIST, json.dumps({"schema": SCHEMA, "parts": known}, indent=1) + "\n")
    else:
        (folder / LIST).unlink(missing_ok=True)


def remove_part(folder: Path, part: str) -> None:
    """Remove the files of a part of the results from a folder, unless they were changed since."""
    parts = written_in(folder)
    if part in parts:
        _remove(folder, parts.pop(part))
        _save(folder, parts)


def remove_unfinished(folder: Path) -> None:
    """Remove what killed runs left beside a folder and in it.

    These are folders of `replacing`, known by their mark, and unfinished lists, which have the list's name.
    """
    for path in (*folder.glob(f".{LIST}.*.part"), *folder.glob(f"*/.{LIST}.*.part")):
        path.unlink(missing_ok=True)
    for path in (*folder.parent.glob(".*"), *folder.glob(".*")):
        with suppress(OSError):
            beside = path.parent == folder or path.name.startswith(f".{folder.name[:100]}.")
            marked = beside and not path.is_symlink() and (path / MARK).read_bytes() == UNFINISHED.encode()
            if marked:
                shutil.rmtree(path, ignore_errors=True)
