"""Trials as canonical CSV text, in other units or with counters that wrap."""

import io
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from granite_lab.logs import write_canonical
from granite_lab.logs.trial import Trial


def to_csv(trial: Trial) -> str:
    """Return the trial as canonical CSV that says neither the encoder's step nor that it is virtual."""
    bare = replace(trial, info=replace(trial.info, virtual=False), wheels=replace(trial.wheels, step=0.0))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "trial.csv"
        write_canonical(path, bare)
        return path.read_text(encoding="utf-8")


def _split(text: str, prefix: str) -> tuple[str, pd.DataFrame, list[str]]:
    """Return comment lines, table, and names of the columns that begin with `prefix`."""
    head = "".join(line for line in text.splitlines(keepends=True) if line.startswith("#"))
    table = pd.read_csv(io.StringIO(text), comment="#")
    return head, table, [name for name in table if name.startswith(prefix)]


def _renamed(table: pd.DataFrame, names: list[str], suffix: str) -> str:
    return table.rename(columns={n: f"{n.rsplit('_', 1)[0]}_{suffix}" for n in names}).to_csv(index=False)


def converted(text: str, prefix: str, factor: float, suffix: str | None = None) -> str:
    """Multiply the columns that begin with `prefix`; the unit in their name becomes `suffix`, if given.

    Without `suffix` the name lies about the unit, as after a mistake in the logger's settings.
    """
    head, table, names = _split(text, prefix)
    table[names] *= factor
    return head + (_renamed(table, names, suffix) if suffix else table.to_csv(index=False))


def wrapped_counts(text: str, counts_per_rev: int, bits: int, start: int = 0) -> str:
    """Write the encoders as unsigned counters of some bits that begin near `start` and wrap."""
    head, table, names = _split(text, "enc_")
    counts = (start + (table[names] * counts_per_rev / (2 * np.pi)).round()) % 2**bits
    table = table.assign(**counts.astype("Int64"))
    return f"{head}# enc_counts_per_rev = {counts_per_rev}\n" + _renamed(table, names, "counts")
