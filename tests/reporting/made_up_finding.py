"""Findings written down by hand: no search, no simulation. All of it is virtual unless said otherwise."""

from __future__ import annotations

import numpy as np

from granite_lab.discovery.empirical import EmpiricalLaw
from granite_lab.discovery.finding import (
    Candidate,
    Finding,
    FoundEffect,
    FoundParameter,
    Gap,
    Residual,
    Unrepeated,
    Verdict,
)
from granite_lab.discovery.lackfit import Disagreement
from granite_lab.discovery.shown import Detectable
from granite_lab.effects import library
from granite_lab.estimate import Estimate
from granite_lab.model.command import duration, phase_of
from granite_lab.model.effect import Active, activate
from granite_lab.parameters import Variant, load_robot, load_soil, load_variants

CHANNELS = {
    "accel_x": ("m/s^2", 0.05), "accel_z": ("m/s^2", 0.07), "pitch_rate": ("rad/s", 0.003),
    "wheel": ("rad", 1e-3), "wheel_split": ("rad", 3e-4), "current_f": ("A", 0.05), "current_r": ("A", 0.05),
}  # fmt: skip
WIDTH = 0.02
START = 102.03
"""Start of the command in the logs [s]; the comparison of the made-up trials has it at 102."""

BUMP = (0.5, 1.5)
"""When the rear wheels meet the rut [s]."""
STRENGTH = 12.0
"""Height of the bump in the pitch rate over its noise."""

RANKING = ("multi_pass", "com_offset", "slip_sinkage", "clock_offset", "gear_backlash", "payload_mass")


def made_up_finding(
    verdict: Verdict = "named",
    *,
    speeds: tuple[float, ...] = (0.2, 0.3, 0.5, 0.7),
    repetitions: int = 3,
    names: str = "virtual_{speed:g}_{repetition}",
    channels: tuple[str, ...] = tuple(CHANNELS),
    virtual: bool = True,
    twins: tuple[str, ...] = (),
) -> Finding:
    """Return a finding: multi-pass named, something unknown with a law for it, or nothing."""
    variants = {round(v.velocity, 2): v for v in load_variants()}
    rng = np.random.default_rng(7)
    residuals = [
        residual
        for speed in speeds
        for repetition in range(1, repetitions + 1)
        for residual in _residuals(
            names.format(speed=speed, repetition=repetition), variants[speed], channels, verdict, rng
        )
    ]
    trials = list(dict.fromkeys(r.trial for r in residuals))
    counts = {t: float(sum(r.t.size for r in residuals if r.trial == t)) for t in trials}
    before, after = (1.0, 1.0) if verdict == "none" else (3.0, 1.1 if verdict == "named" else 1.8)
    found, active = _effects(verdict, twins)
    many = len(trials) > 1
    where = tuple(d for d in _where(speeds) if d.channel in channels) if verdict != "none" else ()
    return Finding(
        verdict=verdict,
        sentence="made up by hand",
        effects=found,
        where=where,
        left=where[:1] if verdict == "unknown" else (),
        gap=Gap("all", "all", (before, after, 1.0), (before + 0.1, after + 0.05, 1.0)),
        gaps=_gaps(channels, before, after),
        rounds=_rounds(verdict),
        threshold=18.0,
        map_threshold=6.0,
        map_before=3.0 if verdict == "none" else 90.0,
        map_after={"none": 3.0, "named": 4.0, "unknown": 30.0}[verdict],
        detectable=tuple(
            Detectable(
                e.id, p.name, p.unit, np.nan if e.id == "imu_tilt" else 0.02 * (p.prior_high - p.neutral),
                ("bulldozing",) if e.id == "multi_pass" else (),
            )
            for e in library().values() for p in e.parameters if not p.shape
        ),
        confusion=np.fmin(1, np.eye(4) + 0.3),
        confusion_ids=RANKING[:4],
        residuals=tuple(residuals),
        sand={"a_theta": Estimate(0.01, 0.005)},
        sand_per_trial=tuple((t, {"a_theta": 4.9}) for t in trials),
        losses=tuple(
            (s, *(b**2 * sum(n for t, n in counts.items() if f"{s:g}" in t) for b in (before, after)))
            for s in speeds
        )
        if len(speeds) > 1
        else (),
        trial_losses=tuple((t, before**2 * n, after**2 * n) for t, n in counts.items()) if many else (),
        notes=("One thing could not be told.",),
        robot=load_robot(),
        soil=load_soil(),
        active=active,
        seed=0,
        virtual=virtual,
        runs=100,
        unrepeated=Unrepeated(),
    )  # fmt: skip


def _residuals(
    name: str, variant: Variant, channels: tuple[str, ...], verdict: Verdict, rng: np.random.Generator
) -> list[Residual]:
    t = np.arange(-0.5 + WIDTH / 2, duration(variant) + 1.5, WIDTH)
    phase = tuple(phase_of(t, variant))
    moving = np.clip(t * variant.acceleration, 0, variant.velocity) * (t < duration(variant))
    bump = STRENGTH * np.exp(-(((t - np.mean(BUMP)) / 0.2) ** 2))
    found = []
    for c in channels:
        unit, std = CHANNELS[c]
        white = rng.normal(size=t.size)
        missing = bump if c == "pitch_rate" and verdict != "none" else 0 * t
        left = 0 if verdict == "named" else missing if verdict == "none" else 0.5 * missing
        truth = (np.cumsum(moving) * WIDTH / 0.0965) if c == "wheel" else 20 * std * moving
        measured = truth + std * (white + missing)
        if c == "accel_x":
            measured[40:45] = np.nan  # a gap in the log
            white[40:45] = 0.0
        found.append(
            Residual(
                trial=name, channel=c, unit=unit, variant=variant.velocity, t=t, t_start=START, phase=phase,
                measured=measured, before=truth, after=truth + std * (missing - left),
                white_before=white + missing, white_after=white + left,
            )
        )  # fmt: skip
    return found


def _where(speeds: tuple[float, ...]) -> tuple[Disagreement, ...]:
    bumps = [
        Disagreement("pitch_rate", "steady", speed, *BUMP, frequency=0.5, strength=STRENGTH / 2 + k)
        for k, speed in enumerate(speeds)
    ]
    return (*bumps, Disagreement("current_r", "brake", speeds[-1], 4.0, 4.3, 3.0, 2.5))


def _gaps(channels: tuple[str, ...], before: float, after: float) -> tuple[Gap, ...]:
    phases = ("rest", "accelerate", "steady", "brake")
    keys = [*((c, "all") for c in channels), *(("all", p) for p in phases)]
    keys += [(c, p) for c in channels for p in phases]
    return tuple(
        Gap(
            c, p, (before * (2 if c == "pitch_rate" else 1), after, 1.0),
            (before * (2.2 if c == "pitch_rate" else 1), after, 1.0),
        )
        for c, p in keys
    )  # fmt: skip


def _rounds(verdict: Verdict) -> tuple[tuple[Candidate, ...], ...]:
    others = sorted(set(library()) - set(RANKING))
    if verdict == "none":
        evidence = [9.0, 6.0, 3.0, 2.0, 1.0, 0.5]
    else:
        evidence = [5000.0, 800.0, 300.0, 20.0, 12.0, -3.0]
    status = ["screened only" if verdict == "none" else "evaluated", "evaluated", "at a bound", "evaluated"]
    status += ["not converged", "screened only"]
    first = [Candidate(i, e, e, s, ()) for i, e, s in zip(RANKING, evidence, status, strict=True)]
    first += [Candidate(i, 0.3, 0.3, "screened only", ()) for i in others]
    if verdict == "none":
        return (tuple(first),)
    second = [Candidate(c.id, 9.0, 9.0, "screened only", ()) for c in first if c.id != RANKING[0]]
    return tuple(first), tuple(second)


def _effects(verdict: Verdict, twins: tuple[str, ...]) -> tuple[tuple[FoundEffect, ...], tuple[Active, ...]]:
    if verdict == "none":
        return (), ()
    if verdict == "unknown":
        law = EmpiricalLaw()
        values = {"force_start": -2.9, "moment_velocity": 1.2, "torque_r_slip": 0.05}
        parameters = tuple(
            FoundParameter(p.name, p.unit, Estimate(values[p.name], 0.1))
            for p in law.parameters
            if p.name in values
        )
        found = FoundEffect(law.id, law.title, parameters, (), 3000.0, empirical=True)
        return (found,), (activate(law, values),)
    effect = library()["multi_pass"]
    values = {p.name: p.neutral + 0.3 * (p.prior_high - p.neutral) for p in effect.parameters}
    parameters = tuple(
        FoundParameter(p.name, p.unit, Estimate(values[p.name], 0.004)) for p in effect.parameters
    )
    return (FoundEffect(effect.id, effect.title, parameters, twins, 5000.0),), (activate(effect, values),)
