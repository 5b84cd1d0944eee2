"""Trials as canonical CSV text, and what can go wrong in such a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from granite_lab.logs import write_canonical
from granite_lab.logs.trial import Trial

Rows = list[list[str]]


def to_csv(trial: Trial) -> str:
    """Return the trial as canonical CSV that says neither the encoder's step nor that it is virtual."""
    bare = replace(trial, info=replace(trial.info, virtual=False), wheels=replace(trial.wheels, step=0.0))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "trial.csv"
        write_canonical(path, bare)
        return path.read_text(encoding="utf-8")


def split(text: str) -> tuple[list[str], list[str], Rows]:
    """Return comment lines, column names and rows of a canonical CSV."""
    lines = text.splitlines()
    head = [line for line in lines if line.startswith("#")]
    body = [line.split(",") for line in lines if not line.startswith("#")]
    return head, body[0], body[1:]


def join(head: list[str], columns: list[str], rows: Rows) -> str:
    """Return the text of the parts."""
    return "\n".join([*head, ",".join(columns), *(",".join(row) for row in rows), ""])


def converted(text: str, prefix: str, factor: float, suffix: str | None = None) -> str:
    """Multiply the columns that begin with `prefix`; the unit in their name becomes `suffix`, if given.

    Without `suffix` the name lies about the unit, as after a mistake in the logger's settings.
    """
    head, columns, rows = split(text)
    hit = [i for i, name in enumerate(columns) if name.startswith(prefix)]
    new = [
        f"{name.rsplit('_', 1)[0]}_{suffix}" if suffix and i in hit else name
        for i, name in enumerate(columns)
    ]
    changed = [
        [f"{float(cell) * factor:.12g}" if i in hit and cell else cell for i, cell in enumerate(row)]
        for row in rows
    ]
    return join(head, new, changed)


def wrapped_counts(text: str, counts_per_rev: int, bits: int, start: int = 0) -> str:
    """Write the encoders as unsigned counters of some bits that begin near `start` and wrap."""
    head, columns, rows = split(text)
    hit = [i for i, name in enumerate(columns) if name.startswith("enc_")]
    new = [f"{name.rsplit('_', 1)[0]}_counts" if i in hit else name for i, name in enumerate(columns)]

    def count(cell: str) -> str:
        return str((start + round(float(cell) * counts_per_rev / (2 * np.pi))) % 2**bits)

    changed = [[count(cell) if i in hit and cell else cell for i, cell in enumerate(row)] for row in rows]
    return join([*head, f"# enc_counts_per_rev = {counts_per_rev}"], new, changed)
