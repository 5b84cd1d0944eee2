"""What a plan needs of a search: trials without their data, noise, sand and what was found."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granite_lab.discovery.finding import Finding, Residual
from granite_lab.errors import InputError
from granite_lab.files import read_json, write_text
from granite_lab.inference.conditions import PLAIN, Conditions, conditions_of
from granite_lab.inference.constants import BIN
from granite_lab.inference.noise import ABOVE, CUT, FAST, FLOOR, GRID, at_rest, errors
from granite_lab.inference.observation import AFTER, BEFORE
from granite_lab.inference.pool import SAND
from granite_lab.logs.trial import Array, Trial
from granite_lab.model.command import duration, peak_velocity, velocities_at
from granite_lab.parameters import Robot, Soil, Variant
from granite_lab.parameters.quantity import build, quantity, table_of

SCHEMA = "granite-lab/design/2"

FREQUENCIES = 33
"""Number of frequencies, from 0 to half the rate of the bins, at which a spectrum is stored."""

ENOUGH = 16
"""Least number of bins from which noise is estimated."""


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise of the bins of one channel: std at standstill, and power spectrum of what full speed adds.

    The mean of the spectrum is its variance. It is empty where the noise is the same at all times.
    """

    channel: str
    rest: float = quantity("", 0, 1e9, "std at standstill [unit of the channel]")
    driven: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Driven:
    """The trials of one command, with the noise of the channels that were logged."""

    variant: Variant
    conditions: Conditions = PLAIN
    count: float = quantity("", 1, 1e6, "number of trials", default=1)
    before: float = quantity("s", -1e3, 1e3, "what the logs have before the start", default=BEFORE)
    after: float = quantity("s", -1e3, 1e3, "what the logs have after the end", default=AFTER)
    noise: tuple[Noise, ...]


@dataclass(frozen=True, kw_only=True)
class NamedEffect:
    """An effect that was named, with the values of all its parameters and with its twins."""

    id: str
    values: tuple[float, ...]
    twins: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class NamedNumber:
    """A number with a name."""

    name: str
    value: float = quantity("", -1e9, 1e9, "the number")


@dataclass(frozen=True, kw_only=True)
class Design:
    """The trials of a search without their data, and what came out.

    Attributes:
        named: effects in the model, the surest first; no term of the dictionary.
        possible: log Bayes factors of the other effects, the likeliest first.
        sand: logarithms of the fitted sand over the soil's file, as `inference.pool.SAND`.
        share: discrepancy of the model as a share of each channel's rms: learnt, at least the tolerance.
        scales: std of each number that differs from trial to trial, as learnt.
        driven: per command and conditions.
        virtual: a simulator wrote all trials.
    """

    verdict: str
    provisional: tuple[str, ...] = ()
    named: tuple[NamedEffect, ...] = ()
    possible: tuple[NamedNumber, ...] = ()
    robot: Robot
    soil: Soil
    sand: tuple[float, ...] = (0.0,) * len(SAND)
    latency: float = quantity("s", -10, 10, "of the IMU's stamps", default=0.0)
    share: float = quantity("", 0, 1e3, "discrepancy as a share of the rms")
    scales: tuple[NamedNumber, ...] = ()
    width: float = quantity("s", 1e-4, 10, "of a bin", default=BIN)
    driven: tuple[Driven, ...]
    virtual: bool = False


def save_design(finding: Finding, commanded: Sequence[tuple[Trial, Variant]], path: Path) -> None:
    """Write what a plan needs of a search to a file, where any trial's command is a trapezoid.

    Args:
        finding: the search.
        commanded: trials with their commands.
        path: of the file.

    Raises:
        LabError: the file cannot be written.
    """
    try:
        driven = _driven(finding.residuals, commanded)
    except InputError:
        driven = ()
    if not driven:
        return
    values = {a.id: a.values for a in finding.active}
    named = {e.id: e for e in finding.effects if not e.empirical and e.id in values}
    design = Design(
        verdict=finding.verdict,
        provisional=finding.provisional,
        named=tuple(
            NamedEffect(id=e.id, values=values[e.id], twins=tuple(t for t in e.twins if t not in named))
            for e in sorted(named.values(), key=lambda e: -e.probability)
        ),
        possible=_numbers({c.id: c.gain for c in finding.candidates if c.id not in named}),
        robot=finding.robot,
        soil=finding.soil,
        sand=tuple(finding.sand[n].value if n in finding.sand else 0.0 for n in SAND),
        latency=finding.latency.value,
        share=max(finding.discrepancy, finding.tolerance),
        scales=_numbers(finding.scales),
        width=float(np.median(np.diff(finding.residuals[0].t))),
        driven=driven,
        virtual=finding.virtual,
    )  # fmt: skip
    write_text(path, json.dumps({"schema": SCHEMA} | table_of(design), allow_nan=False) + "\n")


def _numbers(values: Mapping[str, float]) -> tuple[NamedNumber, ...]:
    return tuple(NamedNumber(name=n, value=v) for n, v in values.items() if abs(v) < 1e9 and "." not in n)


def load_design(path: Path) -> Design:
    """Read a design.

    Raises:
        InputError: the file cannot be read, or is none of this version.
    """
    again = "run 'granite-lab discover' again"
    document = read_json(path, again, SCHEMA)
    del document["schema"]
    design = build(Design, document, str(path))
    if not design.driven or not all(d.noise for d in design.driven):
        raise InputError(f"{path}: holds no trial", again)
    return design


def _driven(residuals: Sequence[Residual], commanded: Sequence[tuple[Trial, Variant]]) -> tuple[Driven, ...]:
    """Return the trials by command.

    Raises:
        InputError: a log's conditions cannot be used.
    """
    groups: dict[tuple[Variant, Conditions], list[Residual]] = {}
    for trial, variant in commanded:
        rows = [r for r in residuals if r.trial == trial.name and np.isfinite(r.measured).any()]
        if rows:
            groups.setdefault((variant, conditions_of(trial)), []).extend(rows)
    driven = []
    for (variant, conditions), rows in groups.items():
        seen = np.concatenate([r.t[np.isfinite(r.measured)] for r in rows])
        noise = [_noise([r for r in rows if r.channel == c], variant) for c in {r.channel: 0 for r in rows}]
        before, after = -float(seen.min()), float(seen.max()) - duration(variant)
        driven.append(
            Driven(variant=variant, conditions=conditions, count=len({r.trial for r in rows}),
                   before=before, after=after, noise=tuple(noise))
        )  # fmt: skip
    return tuple(driven)


def commanded_share(t: Array, variant: Variant) -> Array:
    """Return (n,) the commanded velocity over its largest."""
    return np.asarray(velocities_at(t, variant) / peak_velocity(variant))


def _noise(rows: Sequence[Residual], variant: Variant) -> Noise:
    """Estimate the noise of one channel from what the model with its discrepancy leaves.

    Without a standstill it is the same at all times. Without repetitions its slow part is taken to be as loud
    as the band above, as in `inference.noise`.
    """
    t = min((r.t for r in rows), key=np.size)
    error = errors([(r.measured - r.after - r.discrepancy_after)[: t.size] for r in rows])
    width, floor = float(np.median(np.diff(t))), FLOOR[rows[0].channel]
    still, fast = error[:, t < 0], error[:, commanded_share(t, variant) >= FAST]
    spectrum = at_rest(list(fast), floor, width)[:: GRID // (FREQUENCIES - 1)]
    if np.isfinite(still).sum() < ENOUGH:
        return Noise(channel=rows[0].channel, rest=float(np.sqrt(spectrum.mean())))
    rest = float(at_rest(list(still), floor, width).mean())
    if len(rows) < 2:
        f = np.linspace(0, 0.5 / width, FREQUENCIES)
        band = spectrum[(f >= CUT) & (f < ABOVE * CUT)]
        spectrum[f < CUT] = band.mean() if band.size else spectrum[-1]
    added = tuple(float(f"{x:.4g}") for x in np.fmax(spectrum - rest, 0.0))
    return Noise(channel=rows[0].channel, rest=float(np.sqrt(rest)), driven=added)
