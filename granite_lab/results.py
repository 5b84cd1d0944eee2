"""The results of a study: its trials, how far they are from the model together, and where they come from."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granite_lab.comparison.compare import Comparison, Misfit
from granite_lab.discovery.as_json import SCHEMA as DISCOVERY
from granite_lab.discovery.finding import Finding
from granite_lab.errors import InputError, LabError
from granite_lab.files import read_json
from granite_lab.fitting.fit import AThetaFit
from granite_lab.folders import distinct
from granite_lab.logs.trial import trial_files
from granite_lab.origin import NOTHING, Failure, Origin, Source, Written
from granite_lab.shown import Shown

if TYPE_CHECKING:
    import pandas as pd


SCHEMA = "granite-lab/report/2"
"""Of ``report.json``."""


RECORDINGS = "recordings"
"""Folder of recordings beside a report."""


def warnings_of(result: Comparison) -> tuple[str, ...]:
    """Return every doubt about a trial, of its log, its estimate and its fit, one line each."""
    of = (result.trial.warnings, result.motion.warnings, result.fit.warnings)
    return tuple(dict.fromkeys(line for lines in of for line in lines))


def shown_path(path: Path) -> str:
    """Return a path as a report may show it: of an absolute one only the name."""
    return path.name if path.is_absolute() else path.as_posix()


def recordings_of(result: StudyResult) -> list[str]:
    """Return the file names of the recordings of a study's trials."""
    return [f"{name}.rrd" for name in distinct([r.trial.name for r in result.trials])]


def command_of(name: str, logs: Sequence[Path], options: Sequence[tuple[str, str]] = ()) -> str:
    """Return the command that makes a result again, as a shell takes it; all logs of a folder by its name."""
    folders = list(dict.fromkeys(path.parent for path in logs))
    with suppress(LabError, OSError):  # a folder may be gone, or hold logs that were not named
        logs = folders if len(logs) > 1 and set(trial_files(folders)) == set(logs) else logs
    given = [part for key, value in options for part in (f"--{key}", value) if part]
    return shlex.join(["granite-lab", name, *map(str, logs), *given])


@dataclass(frozen=True, eq=False)
class StudyResult(Shown):
    """A whole study, or a search alone.

    Attributes:
        name: of the report.
        trials: those that went through; at least one, or none of a search alone, which has a finding.
        failures: those that did not.
        a_theta: over the trials; None where fewer than two could be fitted.
        source: provenance.
        finding: what a search for a missing effect found; None where none was run.
        unsearched: why none was run, one sentence; empty where one was.
        warnings: what a reader should know, one line each.
        written: the files of it.
    """

    name: str
    trials: tuple[Comparison, ...]
    failures: tuple[Failure, ...]
    a_theta: AThetaFit | None
    source: Source
    finding: Finding | None = None
    unsearched: str = ""
    warnings: tuple[str, ...] = ()
    written: Written = NOTHING

    def __repr__(self) -> str:
        left = f", {len(self.failures)} left out" if self.failures else ""
        law = "" if self.a_theta is None else f", a_θ {self.a_theta.a_theta.value:.3f} s/m"
        name = f"'{self.name}'{', virtual' if self.virtual else ''}"
        return f"StudyResult({name}: {len(self.trials)} trials{left}{law}, {self.finding or 'no search'!s})"

    @property
    def origin(self) -> Origin:
        """Where it comes from, as of every result."""
        return Origin(self.source, self.failures, self.warnings, self.written)

    @property
    def virtual(self) -> bool:
        """Whether any of the logs was written by a simulator; of a search alone, whether all were."""
        searched = self.finding is not None and self.finding.virtual
        return searched or any(result.trial.info.virtual for result in self.trials)

    def to_frame(self) -> pd.DataFrame:
        """Return one row a trial that went through: slip, distance and k_92, units in the column names."""
        import pandas as pd  # noqa: PLC0415

        frames = [
            r.fit.to_frame().assign(
                distance_m=r.motion.distance.value,
                distance_std_m=r.motion.distance.std,
                verdict=r.motion.health.verdict,
            )
            for r in self.trials
        ]
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def of_search(finding: Finding, folder: Path) -> StudyResult:
    """Return a search alone as the report in that folder shows it: a study without trials."""
    source = finding.origin.source
    assert source is not None
    return StudyResult(folder.resolve().name, (), (), None, source, finding)


CHANNELS = {
    "velocity": "body velocity",
    "wheels": "wheel speeds",
    "slip_f": "front slip ratio",
    "slip_r": "rear slip ratio",
    "torque_f": "front driving torque",
    "torque_r": "rear driving torque",
    "pitch": "pitch",
    "accel": "forward acceleration",
    "pitch_rate": "pitch rate",
}
PHASES = {
    "all": "whole trial",
    "rest": "at rest",
    "accelerate": "while accelerating",
    "steady": "in steady motion",
    "brake": "while braking",
}
"""Channels and phases of a comparison in the order of a report, and as a reader calls them; "wheels" are all
four."""


@dataclass(frozen=True)
class PooledMisfit:
    """How far simulation and measurement are apart in one channel and phase, over trials.

    Attributes:
        channel, unit, phase: as in `Misfit`.
        rms, bias, peak: root mean square, mean and largest absolute difference over the trials.
        normalised: root mean square over the noise (1 is the noise floor); NaN if unknown.
        size: largest simulated magnitude of the channel, rare spikes left out, same unit.
        trials: how many trials have this channel.
    """

    channel: str
    unit: str
    phase: str
    rms: float
    bias: float
    peak: float
    normalised: float
    size: float
    trials: int

    @property
    def name(self) -> str:
        """The channel as a reader calls it."""
        return CHANNELS[self.channel]


def pooled_misfits(comparisons: Sequence[Comparison]) -> dict[tuple[str, str], PooledMisfit]:
    """Pool the misfits of several trials, weighted by samples; (channel, phase) to gap.

    The speeds of the four wheels are one channel, "wheels".
    """
    pooled: dict[tuple[str, str], list[Misfit]] = {}
    sizes: dict[str, float] = {}
    for c in comparisons:
        largest = {}
        for name in {m.channel for m in c.misfits} & c.simulated.keys():
            values = np.abs(c.simulated[name])
            values = values[np.isfinite(values)]
            largest[name] = float(np.percentile(values, 99.5)) if values.size else 0.0
        for m in c.misfits:
            channel = "wheels" if m.channel.startswith("wheel_") else m.channel
            sizes[channel] = max(sizes.get(channel, 0.0), largest.get(m.channel, 0.0))
            if m.samples and math.isfinite(m.rms):
                pooled.setdefault((channel, m.phase), []).append(m)
    keys = [(c, p) for c in CHANNELS for p in PHASES if (c, p) in pooled]
    return {key: _pool(*key, sizes[key[0]], pooled[key]) for key in keys}


def _pool(channel: str, phase: str, size: float, misfits: list[Misfit]) -> PooledMisfit:
    def mean(values: list[float], of: list[Misfit]) -> float:
        return float(np.average(values, weights=[m.samples for m in of]))

    judged = [m for m in misfits if math.isfinite(m.normalised)]
    rms = math.sqrt(mean([m.rms**2 for m in misfits], misfits))
    normalised = math.sqrt(mean([m.normalised**2 for m in judged], judged)) if judged else math.nan
    bias, peak = mean([m.bias for m in misfits], misfits), max(m.peak for m in misfits)
    trials = max(Counter(m.channel for m in misfits).values())  # of the four wheels of a trial each has one
    return PooledMisfit(channel, misfits[0].unit, phase, rms, bias, peak, normalised, size, trials)


def load_report(path: Path) -> dict[str, Any]:
    """Return the numbers of a study's report.

    Args:
        path: of ``report.json``, or of the folder that holds it.

    Raises:
        InputError: there is none, or it is not that of a study by this version.
    """
    file = path / "report.json" if path.is_dir() else path
    hint = "give a folder that 'granite-lab study' of this version wrote, or run the study again"
    document = read_json(file, hint, SCHEMA)
    search = document.get("discovery")
    if search is not None and (not isinstance(search, dict) or search.get("schema") != DISCOVERY):
        raise InputError(f"{file}: its search is of another version", "run the study again")
    return document
