"""Where results come from and what was written of them: a part of each result that a verb returns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from granite_lab.logs.trial import InputFile

EXCLUDED = "excluded: "
"""How the message of a trial begins that the user excludes, in `granite-lab.toml` or by `--exclude`."""


@dataclass(frozen=True)
class Failure:
    """A trial that was left out, and why: it could not be used, or the user excluded it."""

    trial: str
    message: str
    hint: str = ""

    @property
    def excluded(self) -> bool:
        """Whether the user excluded it."""
        return self.message.startswith(EXCLUDED)

    @property
    def reason(self) -> str:
        """Why it was left out."""
        return self.message.removeprefix(EXCLUDED)


@dataclass(frozen=True)
class Source:
    """Where a result comes from: enough to make it again.

    Attributes:
        version: of granite-lab.
        command: the options that matter, as text.
        inputs: the files that were read, with their hashes.
        parameters: rows (key with group, value, unit, origin).
        options: (name, value) of what was asked for beyond the inputs.
        code: SHA-256 over the sources and the library versions that made it.
    """

    version: str
    command: str
    inputs: tuple[InputFile, ...]
    parameters: tuple[tuple[str, str, str, str], ...]
    options: tuple[tuple[str, str], ...] = ()
    code: str = ""


@dataclass(frozen=True)
class Written:
    """What was written of a result.

    Attributes:
        page: first page of the report; None where none was asked for, or it could not be written.
        model: file of the model with what was found; None where nothing was searched, or as for `page`.
        files: tables and figures, where no report was asked for.
        failures: what could not be written, one line each.
        unchanged: the folder held all of it already, so that nothing was written.
    """

    page: Path | None = None
    model: Path | None = None
    files: tuple[Path, ...] = ()
    failures: tuple[str, ...] = ()
    unchanged: bool = False


NOTHING = Written()
"""Nothing was written."""


@dataclass(frozen=True)
class Origin:
    """Where a result comes from.

    Attributes:
        source: command, inputs, parameters and code; None where no log was read for it.
        left_out: trials that the user excluded, and those that could not be used.
        warnings: what a reader of the result should know, one line each.
        written: files that were written.
    """

    source: Source | None = None
    left_out: tuple[Failure, ...] = ()
    warnings: tuple[str, ...] = ()
    written: Written = NOTHING


NOWHERE = Origin()
"""Origin of results for which it is not recorded."""
