"""What a user may say about trials: one record, made once from the arguments of a verb."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from granite_lab.inference.constants import LATENCY_LIMIT, TOLERANCE
from granite_lab.logs.trial import TrialInfo, over
from granite_lab.parameters.course import DriveBy


@dataclass(frozen=True)
class Options:
    """What a user may say about trials; None leaves it to the log and the catalogue.

    Attributes:
        robot, soil, column_map: names of the catalogue or paths of TOML files.
        imu, encoders, currents, reference: further files of a trial whose sensors were logged apart.
        rows: which rows of the log to take, as ``run_id = 4``.
        model: model.toml with effects to switch on.
        effects: the user's own effect file that the model may need.
        info: what is known of all trials; it overrides what a log says.
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
    imu: Path | None = None
    encoders: Path | None = None
    currents: Path | None = None
    reference: Path | None = None
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
        paths = (self.imu, self.encoders, self.currents, self.reference, self.model, self.effects)
        return (*map(Path, named), *(p for p in paths if p is not None))

    def known(self, log: Path) -> TrialInfo | None:
        """Return what is known of a trial besides what its log says."""
        of_trial = dict(self.of_trials).get(str(log))
        return over(self.info, of_trial) if self.info and of_trial else self.info or of_trial

    def given(self) -> tuple[tuple[str, str], ...]:
        """Return what was said about all trials, as the options of the command line."""
        info = self.info or TrialInfo()
        start, end = self.window or (-math.inf, math.inf)
        tape = None if info.distance_measured is None else f"{info.distance_measured:.9g}"
        if tape and info.distance_measured_std is not None:
            tape += f"±{info.distance_measured_std:.9g}"
        texts = {
            "robot": self.robot, "soil": self.soil, "map": self.column_map,
            "model": self.model, "effects": self.effects,
            "drive": None if self.drive == "auto" else self.drive,
            "tolerance": None if self.tolerance == TOLERANCE else f"{self.tolerance:.9g}",
            "latency": None if self.latency == LATENCY_LIMIT else f"{1e3 * self.latency:.9g}",
            "from": start if math.isfinite(start) else None,
            "to": end if math.isfinite(end) else None,
            "distance-measured": tape, "use-reference": "" if info.use_reference else None,
            "ref-v-std": None if info.ref_v_std is None else f"{info.ref_v_std:.9g}",
            "ref-x-std": None if info.ref_x_std is None else f"{info.ref_x_std:.9g}",
        }  # fmt: skip
        once = [(option, str(text)) for option, text in texts.items() if text is not None]
        rests = [("rest", f"{a:.9g}:{b:.9g}") for a, b in info.rests]
        rests += [("body-rest", f"{a:.9g}:{b:.9g}") for a, b in info.body_rests]
        changes = [("set", f"{key}={value!r}") for key, value in info.changes]
        topics = [("topic", f"{role}={topic}") for role, topic in self.topics]
        excluded = [("exclude", f"{trial}={reason}") for trial, reason in self.exclude]
        return (*once, *rests, *changes, *topics, *excluded)
