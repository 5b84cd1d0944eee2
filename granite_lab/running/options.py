"""What a user may say about trials, and the trials that are read by it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from granite_lab import estimation, logs
from granite_lab.errors import UsageError
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.inference.constants import LATENCY_LIMIT, TOLERANCE
from granite_lab.logs.trial import Trial, TrialInfo
from granite_lab.parameters import Robot, Soil, load_robot, load_soil

GIVEN: dict[str, tuple[str, type]] = {
    "robot": ("robot", str), "soil": ("soil", str), "map": ("column_map", str),
    "model": ("model", Path), "effects": ("effects", Path),
}  # fmt: skip
"""Option of the command line to field and type."""


@dataclass(frozen=True)
class Options:
    """What a user may say about trials; None leaves it to the log and the catalogue.

    Attributes:
        robot, soil, column_map: names of the catalogue or paths of TOML files.
        imu, encoders, currents, reference: further files of a trial whose sensors were logged apart.
        rows: which rows of the log to take, as ``run_id = 4``.
        model: model.toml with effects to switch on.
        effects: the user's own effect file that the model may need.
        info: metadata that overrides the log's.
        rests: intervals in which the robot stood still (start, end) [s, the log's time].
        distance_measured: total distance by tape measure [m].
        topics: of a bag, what a topic is taken for (imu, joints, odom) and its name.
        tolerance: of a search, discrepancy that does not matter, as a share of a channel's rms in motion.
        latency: of a search, largest delay between the stamps of two sensors that passes for latency [s].
        window: begin and end [s, the log's time] of what is taken of every log, infinite where open.
    """

    robot: str | None = None
    soil: str | None = None
    column_map: str | None = None
    imu: Path | None = None
    encoders: Path | None = None
    currents: Path | None = None
    reference: Path | None = None
    rows: str | None = None
    model: Path | None = None
    effects: Path | None = None
    info: TrialInfo | None = None
    rests: tuple[tuple[float, float], ...] = ()
    distance_measured: Estimate | None = None
    topics: tuple[tuple[str, str], ...] = ()
    tolerance: float = TOLERANCE
    latency: float = LATENCY_LIMIT
    window: tuple[float, float] | None = None

    def files(self) -> tuple[Path, ...]:
        """Return the files that these options name, those of the catalogue left out."""
        named = [
            x for x in (self.robot, self.soil, self.column_map) if x and (x.endswith(".toml") or "/" in x)
        ]
        paths = (self.imu, self.encoders, self.currents, self.reference, self.model, self.effects)
        return (*map(Path, named), *(p for p in paths if p is not None))

    def given(self) -> tuple[tuple[str, str], ...]:
        """Return what was said about all trials, as the options of the command line."""
        start, end = self.window or (-math.inf, math.inf)
        named = {
            **{name: getattr(self, field) for name, (field, _) in GIVEN.items()},
            "tolerance": None if self.tolerance == TOLERANCE else f"{self.tolerance:.9g}",
            "latency": None if self.latency == LATENCY_LIMIT else f"{1e3 * self.latency:.9g}",
            "from": start if math.isfinite(start) else None,
            "to": end if math.isfinite(end) else None,
        }
        topics = tuple(("topic", f"{role}={topic}") for role, topic in self.topics)
        return (*((key, str(value)) for key, value in named.items() if value is not None), *topics)

    @classmethod
    def from_given(cls, given: Sequence[tuple[str, str]]) -> Options:
        """Return what `given` was made from; other names are passed over."""
        said = dict(given)
        fields: dict[str, Any] = {f: kind(said[name]) for name, (f, kind) in GIVEN.items() if name in said}
        if {"from", "to"} & set(said):
            fields["window"] = float(said.get("from", "-inf")), float(said.get("to", "inf"))
        return cls(
            **fields,
            topics=tuple(tuple(value.split("=", 1)) for key, value in given if key == "topic"),  # type: ignore[misc]
            tolerance=float(said.get("tolerance", TOLERANCE)),
            latency=float(said.get("latency", 1e3 * LATENCY_LIMIT)) / 1e3,
        )


def read(path: Path, options: Options) -> tuple[Trial, Robot]:
    """Return the trial of a log as it was logged, and its robot; raise an InputError if it cannot be used."""
    names = ("imu", "encoders", "currents", "reference", "rows", "robot", "info", "window")
    said: dict[str, Any] = {name: getattr(options, name) for name in names}
    trial = logs.read_trial(path, map=options.column_map, topics=dict(options.topics), **said)
    return trial, load_robot(options.robot or trial.info.robot or "granite")


def corrected(path: Path, options: Options) -> tuple[Trial, Robot, Motion]:
    """Return the trial of a log as estimation corrected it, its robot and its motion.

    Raises:
        InputError: the log cannot be used.
        EstimateError: the motion cannot be had from it.
    """
    logged, robot = read(path, options)
    trial, motion = estimation.correct(
        logged, robot, rests=options.rests, distance_measured=options.distance_measured,
        soil=soil_of(logged, options.soil),
    )  # fmt: skip
    return trial, robot, motion


def soil_of(trial: Trial, named: str | None) -> Soil:
    """Return the soil of that name, or else the one that the log names if it is known; dry sand by default.

    Raises:
        UsageError: the soil is not known.
        InputError: its file is wrong.
    """
    if named is None and trial.info.soil is not None:
        with suppress(UsageError):
            return load_soil(trial.info.soil)
    return load_soil(named or "dry_sand")
