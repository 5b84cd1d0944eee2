"""Which analyses the file of a robot allows, and which numbers the others need."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from granite_lab.columns import Column, Table, words
from granite_lab.parameters.catalogue import DEFAULT, Provenance
from granite_lab.parameters.quantity import key_of
from granite_lab.parameters.records import Chassis, Drive, Wheels
from granite_lab.shown import frame

if TYPE_CHECKING:
    import pandas as pd

WHOLE: Mapping[str, type[Any]] = {"chassis": Chassis, "drive": Drive}
"""Tables of a robot's file that are there as a whole or not at all."""


@dataclass(frozen=True)
class Analysis:
    """What can be done with the logs of a robot.

    Attributes:
        id: word for it in `granite-lab robot --analysis`.
        title: for people.
        commands: that do it.
        needs: keys of the numbers without which it cannot be done.
        expects: keys of numbers that have a default, which is a guess.
    """

    id: str
    title: str
    commands: str
    needs: tuple[str, ...]
    expects: tuple[str, ...] = ()


@dataclass(frozen=True)
class Allowed:
    """Whether the file of a robot allows an analysis.

    Attributes:
        analysis: its title; commands: that do it.
        missing: keys of numbers that the file lacks; where there are none it is allowed.
        assumed: keys of numbers for which a default stands in.
    """

    analysis: str
    commands: str
    missing: tuple[str, ...]
    assumed: tuple[str, ...]

    @property
    def allowed(self) -> bool:
        """Whether nothing is missing."""
        return not self.missing

    def to_frame(self) -> pd.DataFrame:
        """Return one row."""
        row = dataclasses.asdict(self) | {k: " ".join(getattr(self, k)) for k in ("missing", "assumed")}
        return frame([row | {"allowed": self.allowed}])


def needed(record: type[Any]) -> tuple[str, ...]:
    """Return the keys of a table that have no default: without one of them the table is refused."""
    return tuple(key_of(f) for f in dataclasses.fields(record) if f.default is dataclasses.MISSING)


@cache
def analyses() -> tuple[Analysis, ...]:
    """Return all analyses, the one that needs the fewest numbers first."""
    wheels, chassis, drive = (
        tuple(f"{table}.{key}" for key in needed(record))
        for table, record in (("wheels", Wheels), *WHOLE.items())
    )
    place = ("imu.x_m", "imu.z_m")
    width = ("wheels.width_m",)
    return (
        Analysis("estimate", "velocity and slip", "check, ingest", wheels, place),
        Analysis(
            "counts", "the same from encoder counts", "check, ingest",
            (*wheels, "encoders.counts_per_rev"), place,
        ),
        Analysis(
            "wheels", "k_92, a_θ, comparison, search: measured wheels drive",
            "fit-k92, fit-atheta, compare, study, discover, simulate --wheels", (*wheels, *chassis),
            (*width, *place),
        ),
        Analysis(
            "motors", "the same: the command drives; torques, effects of the drive",
            "the same with --drive command, simulate, hide", (*wheels, *chassis, *drive), (*width, *place),
        ),
    )  # fmt: skip


def allowed_by(rows: Iterable[Provenance]) -> tuple[Allowed, ...]:
    """Return for each analysis whether a robot allows it.

    Args:
        rows: the numbers in force, as of `in_force`.
    """
    known = {f"{row.group.removeprefix('robot.')}.{row.key}": row for row in rows if row.group != "soil"}

    def lacks(key: str) -> bool:
        row = known.get(key)
        return row is None or (key == "encoders.counts_per_rev" and not row.value > 0)

    def guessed(keys: Sequence[str]) -> tuple[str, ...]:
        return tuple(key for key in keys if key in known and known[key].origin == DEFAULT)

    return tuple(
        Allowed(a.title, a.commands, tuple(filter(lacks, a.needs)), guessed(a.expects)) for a in analyses()
    )


def _listed(keys: Sequence[str]) -> str:
    """Return keys for people: a table of which most is missing by its name."""
    tables = list(dict.fromkeys(key.split(".")[0] for key in keys))
    named = []
    for table in tables:
        lacking = [key for key in keys if key.startswith(f"{table}.")]
        whole = table in WHOLE and len(lacking) == len(needed(WHOLE[table]))
        named += [f"[{table}]"] if whole else lacking
    return ", ".join(named)


ALLOWED = Table[Allowed](
    "allowed",
    "Analyses that the robot's file allows",
    Column("analysis", lambda a: words(a.analysis)),
    Column("allowed", lambda a: "yes" if a.allowed else "no"),
    Column("missing", lambda a: words(_listed(a.missing))),
    Column("by default", lambda a: words(_listed(a.assumed))),
)
