"""Findings written down by hand: no search, no simulation. All of it is virtual unless said otherwise."""

from __future__ import annotations

import numpy as np

from granite_lab.discovery.empirical import EmpiricalLaw
from granite_lab.discovery.finding import (
    Candidate,
    Confusion,
    Detectable,
    Disagreement,
    Finding,
    FoundEffect,
    FoundParameter,
    Gap,
    LeftOut,
    Residual,
    Status,
    Verdict,
)
from granite_lab.effects import library
from granite_lab.estimate import Estimate
from granite_lab.model.command import duration, phase_of
from granite_lab.model.effect import Active, activate
from granite_lab.parameters import Variant, load_robot, load_soil, load_variants

CHANNELS = {
    "accel_x": ("m/s^2", 0.05), "accel_z": ("m/s^2", 0.07), "pitch_rate": ("rad/s", 0.003),
    "wheel": ("rad", 1e-3), "wheel_split": ("rad", 3e-4), "current_f": ("A", 0.05), "current_r": ("A", 0.05),
}  # fmt: skip
"""Channel to unit and std of the noise."""

SIZE = 20.0
"""rms of a channel in motion over its noise."""

WIDTH = 0.02
START = 102.03
"""Start of the command in the logs [s]; the comparison of the made-up trials has it at 102."""

BUMP = (0.5, 1.5)
"""When the rear wheels meet the rut [s]."""
STRENGTH = 12.0
"""Height of the bump in the pitch rate over its noise."""
LEFT = 0.25
"""Share of the bump that an empirical law leaves."""

RANKING = ("multi_pass", "com_offset", "slip_sinkage", "clock_offset", "gear_backlash", "payload_mass")
LAW = {"force_start": -2.9, "moment_velocity": 1.2, "torque_r_slip": 0.05}
"""Terms of the made-up empirical law."""

SENTENCES: dict[Verdict, str] = {
    "none": "The model explains the trials within noise and tolerance.",
    "named": "Missing from the model: multi_pass. On trials that were left out 93 % of the gap is closed.",
    "unknown": "Something is missing that no candidate explains; an empirical law stands in for it.",
}


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
    before, after = (1.0, 1.0) if verdict == "none" else (3.0, 1.1 if verdict == "named" else 1.8)
    many = len(trials) > 1
    nothing = (np.nan, np.nan)
    reasons = () if repetitions > 1 else ("no command was driven twice",)
    found, active = _effects(verdict, twins)
    where = tuple(d for d in _where(speeds) if d.channel in channels) if verdict != "none" else ()
    return Finding(
        verdict=verdict,
        sentence=(f"Provisional ({reasons[0]}): " if reasons else "") + SENTENCES[verdict],
        probability=0.97,
        provisional=reasons,
        effects=found,
        small=() if verdict == "none" else (_small(),),
        remainder={"none": np.nan, "named": 0.07, "unknown": 0.4}[verdict],
        tolerance=0.02,
        latency=Estimate(0.004, 0.001),
        gap=Gap("all", (before, after), (before + 0.1, after + 0.05) if many else nothing),
        gaps=tuple(
            Gap(
                c, (before * (2 if c == "pitch_rate" else 1), after),
                (before * (2.2 if c == "pitch_rate" else 1), after) if many else nothing,
            )
            for c in channels
        ),
        where=where,
        left=where[:1] if verdict == "unknown" else (),
        candidates=_candidates(verdict),
        detectable=tuple(
            Detectable(
                e.id, p.name, p.unit, np.nan if e.id == "imu_tilt" else 0.02 * (p.prior_high - p.neutral),
                "tolerance" if e.id == "payload_mass" else "noise",
                ("bulldozing",) if e.id == "multi_pass" else (),
            )
            for e in library().values() for p in e.parameters if not p.shape
        ),
        confusion=_confusion(),
        residuals=tuple(residuals),
        sand={"a_theta": Estimate(0.01, 0.005)},
        sand_per_trial=tuple((t, {"a_theta": 4.9}) for t in trials),
        scales={"a_theta": 0.05, "wheel gain": 0.002, "tilt": 0.01},
        discrepancy=0.01,
        trials_left_out=tuple(LeftOut(t, before, after) for t in trials) if many else (),
        speeds_left_out=tuple(LeftOut(f"{s:g}", before, after) for s in speeds) if len(speeds) > 1 else (),
        dropped=(("crashed", "no model fits it"),),
        notes=("One thing could not be told.",),
        robot=load_robot(),
        soil=load_soil(),
        active=active,
        virtual=virtual,
        runs=100,
    )  # fmt: skip


def _residuals(
    name: str, variant: Variant, channels: tuple[str, ...], verdict: Verdict, rng: np.random.Generator
) -> list[Residual]:
    t = np.arange(-0.5 + WIDTH / 2, duration(variant) + 1.5, WIDTH)
    phase = tuple(phase_of(t, variant))
    moving = np.clip(t * variant.acceleration, 0, variant.velocity) * (t < duration(variant))
    driven = (t > 0) & (t < duration(variant))
    bump = STRENGTH * np.exp(-(((t - np.mean(BUMP)) / 0.2) ** 2)) * driven
    found = []
    for c in channels:
        unit, std = CHANNELS[c]
        missing = std * bump if c == "pitch_rate" and verdict != "none" else 0 * t
        left = {"none": 1.0, "named": 0.0, "unknown": LEFT}[verdict] * missing
        truth = (np.cumsum(moving) * WIDTH / 0.0965) if c == "wheel" else SIZE * std * moving
        measured = truth + missing + std * rng.normal(size=t.size)
        if c == "accel_x":
            measured[40:45] = np.nan  # a gap in the log
        found.append(
            Residual(
                trial=name, channel=c, unit=unit, variant=variant.velocity, t=t, t_start=START, phase=phase,
                measured=measured, before=truth, after=truth + missing - left,
                discrepancy_before=missing, discrepancy_after=left, std=0.1 * std * driven, size=SIZE * std,
            )
        )  # fmt: skip
    return found


def _where(speeds: tuple[float, ...]) -> tuple[Disagreement, ...]:
    bumps = [
        Disagreement("pitch_rate", "steady", s, *BUMP, frequency=0.5, share=0.30 + 0.05 * k, score=6.0 + k)
        for k, s in enumerate(speeds)
    ]
    return (*bumps, Disagreement("current_r", "brake", speeds[-1], 4.0, 4.3, 3.0, 0.04, 2.5))


def _candidates(verdict: Verdict) -> tuple[Candidate, ...]:
    others = sorted(set(library()) - set(RANKING))
    if verdict == "none":
        return tuple(Candidate(i, -2.0, 0.01, np.nan, "screened") for i in (*RANKING, *others))
    status: list[Status] = ["named" if verdict == "named" else "less likely", "less likely", "less likely"]
    status += ["small", "at a bound", "screened"]
    gain = (300.0, 80.0, 30.0, 4.0, 3.0, -1.0)
    closes = (0.93, 0.4, 0.2, 0.02, 0.3, np.nan)
    probability = (0.97, 0.02, 0.01, 0.3, 0.0, 0.0)
    first = [
        Candidate(i, g, p, c, s, ("backlash",) if s == "at a bound" else ())
        for i, g, p, c, s in zip(RANKING, gain, probability, closes, status, strict=True)
    ]
    return (*first, *(Candidate(i, -2.0, 0.0, np.nan, "screened") for i in others))


def _confusion() -> Confusion:
    """Four candidates; in a tenth of the sets the second comes first in place of the first."""
    matrix = np.eye(4)
    matrix[0] = [0.85, 0.10, 0.0, 0.0]
    matrix[3] = np.nan
    missed = np.array([0.05, 0.0, 0.0, np.nan])
    return Confusion(RANKING[:4], np.fmin(1, np.eye(4) + 0.3), matrix, missed, 2.0, 200)


def _small() -> FoundEffect:
    effect = library()["clock_offset"]
    offset = FoundParameter("offset", "s", Estimate(0.001, 0.0004))
    return FoundEffect(effect.id, effect.title, (offset,), (), 0.3, Estimate(0.02, 0.01))


def _effects(verdict: Verdict, twins: tuple[str, ...]) -> tuple[tuple[FoundEffect, ...], tuple[Active, ...]]:
    if verdict == "none":
        return (), ()
    if verdict == "unknown":
        law = EmpiricalLaw()
        units = {p.name: p.unit for p in law.parameters}
        terms = tuple(
            FoundEffect(
                f"empirical.{name}", law.title, (FoundParameter(name, units[name], Estimate(value, 0.1)),),
                (), 0.9, Estimate(0.6, 0.05), empirical=True,
            )
            for name, value in LAW.items()
        )  # fmt: skip
        return terms, (activate(law, LAW),)
    effect = library()["multi_pass"]
    values = {p.name: p.neutral + 0.3 * (p.prior_high - p.neutral) for p in effect.parameters}
    parameters = tuple(
        FoundParameter(p.name, p.unit, Estimate(values[p.name], 0.004)) for p in effect.parameters
    )
    found = FoundEffect(effect.id, effect.title, parameters, twins, 0.97, Estimate(0.93, 0.02))
    return (found,), (activate(effect, values),)
