"""What a user may say about trials: one record, made once from the arguments of a verb."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granite_lab.inference.constants import LATENCY_LIMIT, TOLERANCE
from granite_lab.logs.trial import TrialInfo, over
from granite_lab.parameters.course import DriveBy

GIVEN: dict[str, tuple[str, type]] = {
    "robot": ("robot", str), "soil": ("soil", str), "map": ("column_map", str),
    "model": ("model", Path), "effects": ("effects", Path), "drive": ("drive", str),
}  # fmt: skip
"""Option of the command line to field and type."""


RESTS = (("rest", "rests"), ("body-rest", "body_rests"))
"""Options that name standstills, and the fields of `TrialInfo` that hold them."""


def _texts_of(info: TrialInfo) -> dict[str, str | None]:
    """Return option to text of what else is known of a trial; None where nothing is said."""
    tape = None if info.distance_measured is None else f"{info.distance_measured:.9g}"
    if tape and info.distance_measured_std is not None:
        tape += f"±{info.distance_measured_std:.9g}"
    texts = {"distance-measured": tape, "use-reference": "" if info.use_reference else None}
    stds = {"ref-v-std": info.ref_v_std, "ref-x-std": info.ref_x_std}
    return texts | {name: None if std is None else f"{std:.9g}" for name, std in stds.items()}


def _info_of(given: Sequence[tuple[str, str]]) -> TrialInfo:
    """Return what is known of all trials; the inverse of what `Options.given` writes of it."""
    texts = dict(given)
    tape, _, std = texts.get("distance-measured", "").partition("±")
    named: dict[str, Any] = {
        field: tuple(tuple(map(float, value.split(":"))) for key, value in given if key == name)
        for name, field in RESTS
    }
    named["changes"] = tuple((key, float(value)) for key, value in _pairs(given, "set"))
    numbers = {"distance_measured": tape, "distance_measured_std": std}
    numbers |= {field: texts.get(field.replace("_", "-"), "") for field in ("ref_v_std", "ref_x_std")}
    named |= {field: float(text) for field, text in numbers.items() if text}
    return TrialInfo(**named, use_reference="use-reference" in texts)


def _pairs(given: Sequence[tuple[str, str]], option: str) -> tuple[tuple[str, str], ...]:
    """Return both sides of each ``name=text`` that an option was given."""
    parts = (value.partition("=") for key, value in given if key == option)
    return tuple((name, text) for name, _, text in parts)


@dataclass(frozen=True)
class Options:
    """What a user may say about trials; None leaves it to the log and the catalogue.

    Attributes:
        robot, soil, column_map: names of the catalogue or paths of TOML files.
        beside: of a trial whose sensors were logged apart, (imu, encoders, currents or reference, its file).
        rows: which rows of the log to take, as ``run_id = 4``.
        model: model.toml with effects to switch on.
        effects: the user's own effect file that the model may need.
        info: what is known of all trials; it overrides the log.
        of_trials: what is known of single ones, by the path of the log; `info` counts before it.
        topics: of a bag, what a topic is taken for (imu, joints, odom) and its name.
        tolerance: of a search, discrepancy that does not matter, as a share of a channel's rms in motion.
        latency: of a search, largest delay between the stamps of two sensors that passes for latency [s].
        window: begin and end [s, the log's time] of what is taken of every log, infinite where open.
        exclude: (trial, reason) of trials that are left out besides those of `granite-lab.toml`.
        drive: what drives the simulation: "wheels" as they were measured, "command", or "auto".
    """

    robot: str | None = None
    soil: str | None = None
    column_map: str | None = None
    beside: tuple[tuple[str, Path], ...] = ()
    rows: str | None = None
    model: Path | None = None
    effects: Path | None = None
    info: TrialInfo | None = None
    of_trials: tuple[tuple[str, TrialInfo], ...] = ()
    topics: tuple[tuple[str, str], ...] = ()
    tolerance: float = TOLERANCE
    latency: float = LATENCY_LIMIT
    window: tuple[float, float] | None = None
    drive: DriveBy = "auto"
    exclude: tuple[tuple[str, str], ...] = ()

    def files(self) -> tuple[Path, ...]:
        """Return the files that these options name, those of the catalogue left out."""
        named = [
            x for x in (self.robot, self.soil, self.column_map) if x and (x.endswith(".toml") or "/" in x)
        ]
        paths = (*(path for _, path in self.beside), self.model, self.effects)
        return (*map(Path, named), *(p for p in paths if p is not None))

    def info_of(self, log: Path) -> TrialInfo | None:
        """Return what is known of a trial besides what its log says."""
        of_trial = dict(self.of_trials).get(str(log))
        return over(self.info, of_trial) if self.info and of_trial else self.info or of_trial

    def given(self) -> tuple[tuple[str, str], ...]:
        """Return what was said about all trials, as the options of the command line."""
        start, end = self.window or (-math.inf, math.inf)
        named = {
            **{name: getattr(self, field) for name, (field, _) in GIVEN.items()},
            "tolerance": None if self.tolerance == TOLERANCE else f"{self.tolerance:.9g}",
            "latency": None if self.latency == LATENCY_LIMIT else f"{1e3 * self.latency:.9g}",
            "from": start if math.isfinite(start) else None,
            "to": end if math.isfinite(end) else None,
            "drive": None if self.drive == "auto" else self.drive,
        }
        info = self.info or TrialInfo()
        named |= _texts_of(info)
        rests = ((name, f"{a:.9g}:{b:.9g}") for name, field in RESTS for a, b in getattr(info, field))
        topics = tuple(("topic", f"{role}={topic}") for role, topic in self.topics)
        changes = (("set", f"{key}={value!r}") for key, value in info.changes)
        texts = ((key, str(value)) for key, value in named.items() if value is not None)
        excluded = (("exclude", f"{trial}={reason}") for trial, reason in self.exclude)
        return (*texts, *rests, *changes, *topics, *excluded)

    @classmethod
    def from_given(cls, given: Sequence[tuple[str, str]]) -> Options:
        """Return what `given` was made from; other names are passed over."""
        texts = dict(given)
        fields: dict[str, Any] = {f: kind(texts[name]) for name, (f, kind) in GIVEN.items() if name in texts}
        if {"from", "to"} & set(texts):
            fields["window"] = float(texts.get("from", "-inf")), float(texts.get("to", "inf"))
        info = _info_of(given)
        return cls(
            **fields,
            info=None if info == TrialInfo() else info,
            topics=_pairs(given, "topic"),
            exclude=_pairs(given, "exclude"),
            tolerance=float(texts.get("tolerance", TOLERANCE)),
            latency=float(texts.get("latency", 1e3 * LATENCY_LIMIT)) / 1e3,
        )
