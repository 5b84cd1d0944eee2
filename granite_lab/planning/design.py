"""What a plan needs to know of a search: trials without their data, noise, sand and what was found."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import welch

from granite_lab.discovery.finding import Finding, Residual
from granite_lab.errors import InputError
from granite_lab.files import readable, write_text
from granite_lab.inference.bench import SAND
from granite_lab.inference.conditions import PLAIN, Conditions, conditions_of
from granite_lab.inference.noise import CUT, FAST, NOMINAL, errors
from granite_lab.inference.observation import AFTER, BEFORE, BIN
from granite_lab.inference.setup import variant_of_trial
from granite_lab.logs.trial import Array, Trial
from granite_lab.model.command import desired_velocity, duration, peak_velocity
from granite_lab.parameters import Robot, Soil, Variant
from granite_lab.parameters.quantity import build, key_of, quantity

SCHEMA = "granite-lab/design/2"

NAME = "design.json"
"""Name of the file, beside the report."""

FREQUENCIES = 33
"""Number of frequencies, from 0 to half the rate of the bins, at which a spectrum is stored."""

ENOUGH = 16
"""Least number of bins from which a spectrum is estimated."""


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise of one channel, by bin [unit of the channel].

    Attributes:
        channel: its name.
        rest: std at standstill.
        driven: (FREQUENCIES,) power spectrum of what the full speed of the command adds; the mean is the
            variance. Empty where the noise is the same at all times.
    """

    channel: str
    rest: float = quantity("", 0, 1e9, "std at standstill")
    driven: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Driven:
    """The trials of one command.

    Attributes:
        variant, conditions: the command, and under what it was driven.
        count: number of trials.
        before, after: how much of the log precedes the start of the command and follows its end [s].
        noise: of the channels that were logged.
    """

    variant: Variant
    conditions: Conditions = PLAIN
    count: float = quantity("", 1, 1e6, "number of trials", default=1)
    before: float = quantity("s", -1e3, 1e3, "time before the start", default=BEFORE)
    after: float = quantity("s", -1e3, 1e3, "time after the end", default=AFTER)
    noise: tuple[Noise, ...]


@dataclass(frozen=True, kw_only=True)
class Named:
    """An effect that was named.

    Attributes:
        id: of the effect.
        values: of all its parameters.
        probability: that it is in the model.
        twins: effects that explain the trials as well in its place.
    """

    id: str
    values: tuple[float, ...]
    probability: float = quantity("", 0, 1, "that it is in the model", default=1.0)
    twins: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Possible:
    """A candidate that was not named, with the logarithm of its Bayes factor."""

    id: str
    gain: float = quantity("", -1e9, 1e9, "logarithm of the Bayes factor")


@dataclass(frozen=True, kw_only=True)
class Scale:
    """A number that differs from trial to trial, and its std as learnt."""

    name: str
    std: float = quantity("", 0, 1e9, "as learnt from the trials")


@dataclass(frozen=True, kw_only=True)
class Design:
    """The trials of a search without their data, and what came out.

    Attributes:
        verdict, provisional: of the finding.
        named: effects in the model, empirical laws excepted.
        possible: other candidates, the likeliest first.
        robot, soil: of all trials.
        sand: logarithms of the fitted numbers of the sand over the soil's, as `inference.bench.SAND`.
        latency: of the IMU's stamps [s].
        share: discrepancy of the model as a share of each channel's rms: learnt, at least the tolerance.
        scales: of what differs from trial to trial.
        width: of a bin [s].
        driven: per command and conditions.
        virtual: all trials were written by a simulator.
    """

    verdict: str
    provisional: tuple[str, ...] = ()
    named: tuple[Named, ...] = ()
    possible: tuple[Possible, ...] = ()
    robot: Robot
    soil: Soil
    sand: tuple[float, ...] = (0.0,) * len(SAND)
    latency: float = quantity("s", -10, 10, "of the IMU's stamps", default=0.0)
    share: float = quantity("", 0, 1e3, "discrepancy as a share of the rms")
    scales: tuple[Scale, ...] = ()
    width: float = quantity("s", 1e-4, 10, "of a bin", default=BIN)
    driven: tuple[Driven, ...]
    virtual: bool = False


def save_design(finding: Finding, trials: Sequence[Trial], path: Path) -> None:
    """Write what a plan needs beside the report; nothing where nothing says what was commanded.

    Args:
        finding: the record of the search.
        trials: its logs.
        path: of the JSON file.

    Raises:
        LabError: the file cannot be written.
    """
    speeds = {r.trial: r.variant for r in finding.residuals}
    commands = {}
    try:
        for trial in trials:
            if trial.name in speeds:
                info = dataclasses.replace(trial.info, v_desired=trial.info.v_desired or speeds[trial.name])
                variant = variant_of_trial(dataclasses.replace(trial, info=info), None)
                commands[trial.name] = (variant, conditions_of(trial))
    except InputError:
        commands = {}
    driven = driven_in(finding.residuals, commands)
    if not driven:
        path.unlink(missing_ok=True)  # that of an earlier search would be wrong
        return
    values = {a.id: a.values for a in finding.active}
    named = [e for e in finding.effects if not e.empirical and e.id in values]
    mine = {e.id for e in named}
    design = Design(
        verdict=finding.verdict,
        provisional=finding.provisional,
        named=tuple(
            Named(
                id=e.id, values=values[e.id], probability=float(np.clip(e.probability, 0, 1)),
                twins=tuple(t for t in e.twins if t not in mine),
            )
            for e in named
        ),
        possible=tuple(
            Possible(id=c.id, gain=float(np.clip(c.gain, -1e9, 1e9)))
            for c in finding.candidates
            if c.id not in mine and "." not in c.id and math.isfinite(c.gain)
        ),
        robot=finding.robot,
        soil=finding.soil,
        sand=tuple(_finite(finding.sand[n].value) if n in finding.sand else 0.0 for n in SAND),
        latency=_finite(finding.latency.value),
        share=max(_finite(finding.discrepancy), finding.tolerance),
        scales=tuple(Scale(name=n, std=s) for n, s in finding.scales.items() if math.isfinite(s)),
        width=float(np.median(np.diff(finding.residuals[0].t))),
        driven=driven,
        virtual=finding.virtual,
    )  # fmt: skip
    write_text(path, json.dumps({"schema": SCHEMA} | _table(design), allow_nan=False) + "\n")


def load_design(path: Path) -> Design:
    """Read a design.

    Raises:
        InputError: the file cannot be read, or is not one.
    """
    again = "run 'granite-lab discover' again"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise readable(error, path) from None
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({error})", again) from None
    if not isinstance(document, dict) or document.pop("schema", None) != SCHEMA:
        raise InputError(f"{path}: is not the design of a search of this version", again)
    design = build(Design, document, str(path))
    if not design.driven or not all(d.noise for d in design.driven):
        raise InputError(f"{path}: holds no trial", again)
    return design


def _table(record: Any) -> Any:
    """Return a record as `build` reads it."""
    if dataclasses.is_dataclass(record):
        fields = ((key_of(f), getattr(record, f.name)) for f in dataclasses.fields(record))
        return {key: _table(value) for key, value in fields if value is not None}
    return [_table(value) for value in record] if isinstance(record, tuple) else record


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def driven_in(
    residuals: Sequence[Residual], commands: dict[str, tuple[Variant, Conditions]]
) -> tuple[Driven, ...]:
    """Return the trials of a finding by command.

    Args:
        residuals: of the finding.
        commands: name of a trial to its command and conditions; trials without are left out.
    """
    rows = [r for r in residuals if r.trial in commands and np.isfinite(r.measured).any()]
    found = []
    for variant, conditions in sorted(
        {commands[r.trial] for r in rows},
        key=lambda c: (c[0].velocity, c[0].acceleration, c[0].distance, c[1]),
    ):
        own = [r for r in rows if commands[r.trial] == (variant, conditions)]
        names = dict.fromkeys(r.channel for r in own)
        seen = np.concatenate([r.t[np.isfinite(r.measured)] for r in own])
        found.append(
            Driven(
                variant=variant,
                conditions=conditions,
                count=len({r.trial for r in own}),
                before=-float(seen.min()),
                after=float(seen.max()) - duration(variant),
                noise=tuple(_noise([r for r in own if r.channel == c], variant) for c in names),
            )
        )
    return tuple(found)


def commanded_share(t: Array, variant: Variant) -> Array:
    """Return (n,) the commanded velocity over its largest."""
    velocity = np.array([float(desired_velocity(float(x), variant)) for x in t])
    return np.asarray(velocity / peak_velocity(variant))


def _noise(rows: Sequence[Residual], variant: Variant) -> Noise:
    """Estimate the noise of one channel from what the model with its discrepancy leaves.

    Without a standstill the noise counts as the same at all times. Without repetitions the slow part of the
    spectrum is taken to be as loud as the band above, as in `inference.noise`.
    """
    bins = min(r.t.size for r in rows)
    t = rows[0].t[:bins]
    error = errors([(r.measured - r.after - r.discrepancy_after)[:bins] for r in rows])
    share = commanded_share(t, variant)
    still, fast = error[:, t < 0], error[:, share >= FAST]
    channel = rows[0].channel
    known = [part for part in (still, fast, error) if np.isfinite(part).sum() >= ENOUGH]
    rest = float(np.sqrt(np.nanmean(known[0] ** 2))) if known else NOMINAL[channel]
    runs = [row[np.isfinite(row)] for row in fast]
    runs = [row for row in runs if row.size >= ENOUGH]
    if not runs or not known or known[0] is not still:
        return Noise(channel=channel, rest=rest)
    width = float(np.median(np.diff(t)))
    grid = np.linspace(0, 0.5, FREQUENCIES)
    spectra = []
    for row in runs:
        size = min(64, row.size) // 2 * 2
        _, power = welch(row, nperseg=size, detrend=False, return_onesided=False)
        spectra.append(np.interp(grid, np.linspace(0, 0.5, size // 2 + 1), power[: size // 2 + 1]))
    spectrum = np.mean(spectra, axis=0)
    if len(rows) < 2:
        f = grid / width
        band = (f >= CUT) & (f < 2.5 * CUT)
        spectrum[f < CUT] = spectrum[band].mean() if band.any() else spectrum[-1]
    added = np.fmax(spectrum - rest**2, 0.0)
    return Noise(channel=channel, rest=rest, driven=tuple(float(f"{x:.4g}") for x in added))
