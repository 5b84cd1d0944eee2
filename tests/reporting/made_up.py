"""Study results made of smooth functions beside a simulation: what a report and a recording need, no more.

The measured velocity follows the command with a lag and a constant slip.
"""

from __future__ import annotations

import dataclasses
import math
import zlib
from functools import cache
from pathlib import Path

import numpy as np

from granite_lab.comparison.compare import UNITS, misfits_of
from granite_lab.comparison.record import Comparison
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Health, Motion
from granite_lab.fitting.fit import AThetaFit, K92Fit, Law
from granite_lab.logs.trial import (
    Array,
    CurrentStream,
    ImuStream,
    InputFile,
    Series,
    Trial,
    TrialInfo,
    WheelStream,
)
from granite_lab.model.command import duration
from granite_lab.model.run import Run
from granite_lab.model.simulator import simulate
from granite_lab.parameters import WHEELS, Variant, load_paper, load_robot, load_soil, variant_of
from granite_lab.results import Failure, Source, StudyResult, TrialResult

ORIGIN, REST = 100.0, 2.0
"""First stamp of the log [s], and how much later the command begins."""
SLIP = {0.2: 0.055, 0.3: 0.083, 0.5: 0.163, 0.7: 0.231}


def trapezoid(t: Array, variant: Variant) -> Array:
    ramp = np.minimum(variant.acceleration * t, variant.acceleration * (duration(variant) - t))
    return np.clip(ramp, 0, variant.velocity)


def integral(t: Array, v: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t))])


@cache
def made_up_run(variant: Variant) -> Run:
    return simulate(variant, load_robot(), load_soil(), k92=math.exp(-4.919 * variant.velocity))


def made_up_trial(
    velocity: float = 0.3, repetition: int = 1, name: str | None = None, *, virtual: bool = True
) -> TrialResult:
    """Return a trial of a variant of Table 2 with everything that a report and a recording show."""
    variant = variant_of(velocity)
    rng = np.random.default_rng(round(1000 * velocity) + repetition)
    slip = SLIP[velocity] + 0.004 * (repetition - 2)
    run = made_up_run(variant)
    name = name or f"{'virtual' if virtual else 'trial'}_{velocity:g}_{repetition}"
    start = ORIGIN + REST
    t = ORIGIN + np.arange(0, run.t[-1] + 2 * REST, 0.005)
    τ, n = t - start, len(t)

    v_true = (1 - slip) * trapezoid(τ - 0.09, variant)
    v = v_true + 0.002 * np.sin(1.3 * τ + repetition) * (v_true > 0)
    v_std = 0.0005 + 0.003 * np.sin(np.pi * np.clip(τ / run.t[-1], 0, 1)) ** 2
    wheel = trapezoid(τ - 0.04, variant)
    moving = wheel > 0.01
    v_wheel = wheel[:, None] + 0.003 * moving[:, None] * np.sin(9 * τ[:, None] + np.arange(4))
    ratio = (v_wheel - v[:, None]) / np.maximum(np.maximum(v_wheel, v[:, None]), 0.02)
    pitch = -0.006 - 0.013 * np.gradient(v_true, t)
    end = duration(variant)
    conditions = [τ < 0, τ < run.steady[0], τ < run.steady[1], τ < end + 0.2]
    phase = np.select(conditions, ["rest", "accelerate", "steady", "brake"], "rest")
    rests = ((float(t[0]), start - 0.05), (start + end + 0.5, float(t[-1])))
    updates = np.flatnonzero((t < rests[0][1]) | (t > rests[1][0]))[::4]
    health = Health(
        t=np.repeat(t[updates], 2), kind=("zero_velocity", "zero_rate") * len(updates),
        innovation=rng.normal(0, 1e-3, 2 * len(updates)), innovation_std=np.full(2 * len(updates), 1e-3),
        nis={"zero_velocity": 1.02, "zero_rate": 0.97}, accel_bias=0.02 + 1e-4 * np.sin(τ),
        accel_bias_std=np.full(n, 2e-3), gyro_bias=np.full(n, -0.001), gyro_bias_std=np.full(n, 1e-4),
        rests=rests, verdict="The innovations are white and as large as predicted.", good=True,
    )  # fmt: skip
    warnings = ("3 duplicate stamps were dropped",) if repetition == 2 else ()
    slip_ratio, t_start = Estimate(slip, 0.004), Estimate(start, 0.002)
    motion = Motion(
        trial=name, virtual=virtual, t=t, x=integral(t, v), x_std=0.0004 + 0.0005 * np.clip(τ, 0, None),
        v=v, v_std=v_std, pitch=pitch, pitch_std=np.full(n, 0.0009),
        v_wheel=v_wheel, v_wheel_std=np.full_like(v_wheel, 0.001),
        slip=np.where(moving[:, None], ratio, np.nan),
        slip_std=np.where(moving, v_std / np.maximum(wheel, 0.02), np.nan)[:, None].repeat(4, axis=1),
        slip_velocity=wheel - v, slip_velocity_std=v_std, phase=tuple(phase.tolist()), slip_ratio=slip_ratio,
        distance=Estimate(float(integral(t, v)[-1]), 0.004),
        distance_wheels=Estimate(float(integral(t, wheel)[-1]), 0.0005),
        steady=(start + run.steady[0], start + run.steady[1]), t_start=t_start,
        clock_offset=Estimate(0.0123, 0.0011), variant=variant, variant_source="given",
        noise={"accel_mps2": 0.01}, health=health, warnings=warnings,
    )  # fmt: skip
    k92 = run.k92_value * (1 + 0.04 * (repetition - 2))
    fit = K92Fit(
        trial=name, virtual=virtual, variant=variant, k92=Estimate(k92, 0.012),
        k92_trajectory=Estimate(1.02 * k92, 0.008), t_start=t_start, slip_measured=slip_ratio,
        slip_simulated=run.slip_ratio, status="ok", status_trajectory="ok", notes=("made up by hand",),
    )  # fmt: skip
    torque = {axle: np.interp(τ, run.t, run[f"torque_{axle}_Nm"]) for axle in "fr"}
    current = np.column_stack([1.1 * torque[axle] / (53 * 0.8 * 0.03) for axle in "ffrr"])
    force = np.column_stack([np.gradient(v, t) - 9.81 * pitch, 0 * t, np.full(n, 9.81)])
    rate = np.column_stack([0 * t, np.gradient(pitch, t) - 0.001, 0 * t])
    info = TrialInfo(
        robot="granite", soil="dry_sand", v_desired=velocity, repetition=repetition, virtual=virtual
    )
    trial = Trial(
        name=name, info=info,
        imu=ImuStream(t, force + rng.normal(0, 0.08, (n, 3)), rate + rng.normal(0, 0.002, (n, 3))),
        wheels=WheelStream(t[::2], np.cumsum(v_wheel, axis=0)[::2] * 0.005 / run.robot.wheels.radius),
        currents=CurrentStream(t[::2], current[::2] + rng.normal(0, 0.05, (len(t[::2]), 4))),
        command=Series(t[::2], trapezoid(τ, variant)[::2]), warnings=warnings,
        inputs=(InputFile(Path(f"data/samples/{name}.csv"), f"{zlib.crc32(name.encode()):064x}"),),
    )  # fmt: skip
    return TrialResult(trial, compared(motion, run, fit, trial, torque))


def compared(motion: Motion, run: Run, fit: K92Fit, trial: Trial, torque: dict[str, Array]) -> Comparison:
    τ = motion.t - fit.t_start.value
    channels: dict[str, tuple[Array, Array | float, str]] = {
        "velocity": (motion.v, motion.v_std, "v_mps"),
        **{f"wheel_{w}": (motion.v_wheel[:, i], 0.001, f"v_wheel_{w[0]}_mps") for i, w in enumerate(WHEELS)},
        "slip_f": (motion.slip[:, :2].mean(axis=1), motion.slip_std[:, 0], "slip_f"),
        "slip_r": (motion.slip[:, 2:].mean(axis=1), motion.slip_std[:, 0], "slip_r"),
        "torque_f": (1.1 * torque["f"], 0.05, "torque_f_Nm"),
        "torque_r": (1.1 * torque["r"], 0.05, "torque_r_Nm"),
        "pitch": (motion.pitch, motion.pitch_std, "pitch_rad"),
        "accel": (trial.imu.specific_force[:, 0], 0.08, "imu_ax_mps2"),
        "pitch_rate": (trial.imu.angular_rate[:, 1], 0.002, "pitch_rate_radps"),
    }
    measured = {c: value for c, (value, _, _) in channels.items()}
    std = {c: np.broadcast_to(s, τ.shape).copy() for c, (_, s, _) in channels.items()}
    simulated = {c: np.interp(τ, run.t, run[name]) for c, (_, _, name) in channels.items()}
    phase = np.array(motion.phase)
    misfits = [m for c in UNITS for m in misfits_of(c, measured[c], std[c], simulated[c], phase)]
    return Comparison(motion, run, fit, τ, measured, std, simulated, UNITS, tuple(misfits))


def made_up_a_theta(results: tuple[TrialResult, ...]) -> AThetaFit:
    fits = [r.comparison.fit for r in results]
    points = tuple((f.trial, f.variant.velocity, f.k92, f.slip_measured) for f in fits)
    free = {f"k92_{v:g}": Estimate(math.exp(-4.919 * v), 0.01) for v in SLIP}
    line = {"b_0": Estimate(0.411, 0.006), "b_1": Estimate(-0.0174, 0.0004)}
    exponential = {"a_theta": Estimate(4.93, 0.05)}
    laws = (
        Law("exponential", "k_92 = exp(-a_θ v)", exponential, {"a_theta": "s/m"}, 1, 0.011, -88.1, 0.97),
        Law("linear_slip", "k_92 = b_0 + b_1 λ_R", line, {"b_0": "", "b_1": "1/%"}, 2, 0.013, -80.2, 0.02),
        Law("free", "k_92 constant per speed", free, dict.fromkeys(free, ""), 4, 0.010, -77.6, 0.01),
    )
    return AThetaFit(
        Estimate(4.93, 0.052), (4.816, 5.044), 4.921, 4.94, 0.03, load_paper().a_theta, True, points, laws
    )


def made_up_study(
    virtual: bool = True, speeds: tuple[float, ...] = tuple(SLIP), repetitions: int = 3
) -> StudyResult:
    results = tuple(
        made_up_trial(speed, repetition, virtual=virtual)
        for speed in speeds
        for repetition in range(1, repetitions + 1)
    )
    source = Source(
        version="0.1.0",
        command="study data/samples",
        inputs=tuple(i for r in results for i in r.trial.inputs),
        parameters=(
            ("robot.wheels.radius", "0.0965", "m", "catalogue/robots/granite.toml"),
            ("soil.friction_angle", "30", "deg", "catalogue/soils/dry_sand.toml"),
        ),
    )
    return StudyResult("made-up", results, (), made_up_a_theta(results) if len(results) > 1 else None, source)


def rename(result: StudyResult, name: str) -> StudyResult:
    """Give the first trial another name everywhere, and put it into warnings and failures too."""
    replace, first = dataclasses.replace, result.trials[0]
    c = first.comparison
    motion = replace(c.motion, trial=name, warnings=(f"line 3: {name}",))
    comparison = replace(c, motion=motion, fit=replace(c.fit, trial=name, notes=(name,)))
    trial = replace(first.trial, name=name, warnings=(name,), inputs=(InputFile(Path(name), "00"),))
    a_theta = result.a_theta
    if a_theta is not None:
        a_theta = replace(a_theta, points=((name, *a_theta.points[0][1:]), *a_theta.points[1:]))
    return replace(
        result, name=name, trials=(TrialResult(trial, comparison), *result.trials[1:]),
        failures=(Failure(name, name, name),), a_theta=a_theta,
        source=replace(result.source, command=name, parameters=((name, name, name, name),)),
    )  # fmt: skip
