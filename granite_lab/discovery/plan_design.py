"""What a plan needs to know of a discovery: the trials that were driven, their noise, and the sand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from granite_lab.discovery.baseline import FLOOR, NOMINAL
from granite_lab.discovery.bench import SAND
from granite_lab.discovery.finding import Finding
from granite_lab.discovery.noise import FAST, Whitener, learn
from granite_lab.discovery.observation import BIN, CHANNELS
from granite_lab.discovery.plan_conditions import PLAIN, Conditions
from granite_lab.logs.trial import Array
from granite_lab.model.command import duration, peak_velocity
from granite_lab.parameters import Robot, Soil, Variant
from granite_lab.processes import one_thread

LAGS = 60
"""Bins over which the noise is remembered, 1.2 s of a bin of 20 ms; it fades to nothing towards their end."""


@dataclass(frozen=True)
class Noise:
    """Autocovariance of one channel's noise by lag in bins [unit^2]: at rest, and what driving adds."""

    rest: tuple[float, ...]
    driven: tuple[float, ...] = ()


@dataclass(frozen=True)
class Driven:
    """The trials of one command.

    Attributes:
        variant, conditions: the command, and under what it was driven.
        channels: what was logged.
        count: repetitions.
        noise: by channel.
    """

    variant: Variant
    channels: tuple[str, ...]
    count: int
    noise: Mapping[str, Noise]
    conditions: Conditions = PLAIN


@dataclass(frozen=True)
class Design:
    """The trials of a discovery without their data.

    Attributes:
        robot, soil: of all trials.
        sand: logarithms of the fitted numbers of the sand over the soil's, as `bench.SAND`.
        width: of a bin [s].
        driven: per command.
        virtual: all trials were written by a simulator.
    """

    robot: Robot
    soil: Soil
    sand: tuple[float, ...]
    width: float
    driven: tuple[Driven, ...]
    virtual: bool


@one_thread()
def design_of(
    finding: Finding, variants: Mapping[str, Variant], under: Mapping[str, Conditions] | None = None
) -> Design:
    """Take the design from a finding.

    Args:
        finding: the discovery.
        variants: the command of each trial, by its name.
        under: its conditions, where they are not plain.
    """
    rows = [r for r in finding.residuals if np.isfinite(r.measured).any()]
    staged = {r.trial: (variants[r.trial], (under or {}).get(r.trial, PLAIN)) for r in rows}
    commands = sorted(
        set(staged.values()), key=lambda s: (s[0].velocity, s[0].acceleration, s[0].distance, s[1])
    )
    driven = []
    for command, conditions in commands:
        own = [r for r in rows if staged[r.trial] == (command, conditions)]
        channels = tuple(c for c in CHANNELS if any(r.channel == c for r in own))
        width = float(np.median(np.diff(own[0].t)))
        noise = {}
        for c in channels:
            having = [r for r in own if r.channel == c]
            bins = min(r.t.size for r in having)
            speed = commanded_share(having[0].t[:bins], command)
            left = [np.nan_to_num(r.measured - r.after)[:bins] for r in having]
            slope = np.gradient(np.nanmean([r.after[:bins] for r in having], axis=0))
            noise[c] = _noise(learn(left, speed, slope, FLOOR[c], width)[0], speed)
        driven.append(Driven(command, channels, len({r.trial for r in own}), noise, conditions))
    sand = tuple(float(finding.sand[name].value) for name in SAND)
    return Design(finding.robot, finding.soil, sand, width, tuple(driven), finding.virtual)


def nominal(
    robot: Robot, soil: Soil, variants: Sequence[Variant], channels: Sequence[str] = CHANNELS
) -> Design:
    """Return the design of trials of which nothing is known: white noise of a common strength."""
    noise = {c: Noise((NOMINAL[c] ** 2,)) for c in channels}
    driven = tuple(Driven(v, tuple(channels), 1, noise) for v in variants)
    return Design(robot, soil, (0.0,) * len(SAND), BIN, driven, True)


def commanded_share(t: Array, variant: Variant) -> Array:
    """Return (n,) the commanded velocity over its largest."""
    v, a = peak_velocity(variant), variant.acceleration
    left = duration(variant) - t
    return np.asarray(np.clip(np.minimum(a * t, a * left), 0, v) / v)


def _noise(whitener: Whitener, speed: Array) -> Noise:
    """Read the two autocovariances off the covariance that a whitener stands for."""
    factor = np.diag(whitener.factor) if whitener.factor.ndim == 1 else whitener.factor
    Σ = factor @ factor.T
    rest = Σ[0, :LAGS]
    fast = np.flatnonzero(speed >= FAST)
    lags = min(LAGS, fast.size)
    driven = [
        float(np.mean([(Σ[i, i + k] - rest[k]) / (speed[i] * speed[i + k]) for i in fast[: fast.size - k]]))
        for k in range(lags)
    ]
    fade = 0.5 * (1 + np.cos(np.pi * np.arange(LAGS) / LAGS))
    return Noise(
        tuple(float(f"{x:.4g}") for x in rest * fade[: rest.size]),
        tuple(float(f"{x:.4g}") for x in driven * fade[:lags]),
    )
