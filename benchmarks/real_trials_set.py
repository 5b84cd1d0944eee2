"""A set of public trials, and what comes out of it: the records of `benchmarks.real_trials`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granite_lab.estimate import Estimate


@dataclass(frozen=True)
class Prepared:
    """A set of trials, ready to be analysed.

    Attributes:
        title, source, licence: what it is and where it is from.
        logs: folder of the logs with their sidecars.
        robot, column_map: files or names; None where the log says it or is recognised.
        written: what was written by hand, one line each.
        soil: file or name; None where nobody states it.
        remark: what a reader of its numbers should know, in a paragraph.
        reference_is: what the reference is, whose std the sidecars state; empty where there is none.
    """

    title: str
    source: str
    licence: str
    logs: Path
    robot: str | None = None
    column_map: str | None = None
    written: tuple[str, ...] = ()
    soil: str | None = None
    reference_is: str = ""
    remark: str = ""

    @property
    def known(self) -> dict[str, Any]:
        """Keywords of the verbs that take the reference as a measurement."""
        return {"use_reference": True} if self.reference_is else {}

    @property
    def about(self) -> dict[str, Any]:
        """Keywords of the verbs."""
        said = {"robot": self.robot, "column_map": self.column_map, "soil": self.soil}
        return {name: value for name, value in said.items() if value is not None}


@dataclass(frozen=True)
class Row:
    """One trial: λ_R without and with the reference, by that alone, and k_92 or why there is none.

    `width` is that of the 95 % interval of k_92, NaN where there is none.
    """

    name: str
    grade: str
    slip: Estimate
    referred: Estimate
    truth: Estimate
    k92: str
    width: float = math.nan


@dataclass(frozen=True)
class Outcome:
    """What came out of a set: a row a trial, what the report says, and how long all of it took [s]."""

    prepared: Prepared
    rows: tuple[Row, ...]
    said: tuple[str, ...]
    seconds: float
