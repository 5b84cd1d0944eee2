"""A made-up trial with its comparison: smooth curves written down by hand, no simulator, no filter.

The velocity follows the command with a lag and a constant slip; the measured signals differ from
the simulated ones by known amounts. All of it is virtual.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from granite_lab.comparison.record import Comparison, Misfit
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Health, Motion
from granite_lab.fitting.fit import K92Fit
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
from granite_lab.model.run import Run
from granite_lab.parameters import WHEELS, Variant, load_robot, load_soil, variant_of
from granite_lab.reporting.content import Failure, Source, StudyResult, TrialResult

ORIGIN = 100.0
"""First stamp of the log [s]; the command begins REST later."""
REST = 2.0
SLIP = {0.2: 0.055, 0.3: 0.083, 0.5: 0.163, 0.7: 0.231}


def _trapezoid(t: Array, variant: Variant) -> Array:
    end = variant.distance / variant.velocity + variant.velocity / variant.acceleration
    ramp = np.minimum(variant.acceleration * t, variant.acceleration * (end - t))
    return np.clip(ramp, 0, variant.velocity)


def _integral(t: Array, v: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t))])


def _run(variant: Variant, slip: float) -> Run:
    robot = load_robot()
    r = robot.wheels.radius
    end = variant.distance / variant.velocity + variant.velocity / variant.acceleration
    t = np.arange(-1.0, end + 1.0, 0.005)
    desired = _trapezoid(t, variant)
    wheel = _trapezoid(t - 0.03, variant)
    body = (1 - slip) * _trapezoid(t - 0.06, variant)
    accel = np.gradient(body, t)
    pitch = -0.008 - 0.01 * accel
    load = {"f": 105.7 - 8 * accel, "r": 105.7 + 8 * accel}
    signals = {
        "t_s": t,
        "x_m": _integral(t, body),
        "v_mps": body,
        "v_desired_mps": desired,
        "pitch_rad": pitch,
        "pitch_rate_radps": np.gradient(pitch, t),
        "imu_ax_mps2": accel - 9.81 * pitch,
        "imu_az_mps2": np.full_like(t, 9.81),
        "k92": np.exp(-4.919 * desired),
    }
    for axle, depth in (("f", 0.0150), ("r", 0.0161)):
        torque = (1.6 if axle == "f" else 1.9) * np.tanh(wheel / 0.05) + 1.2 * accel
        signals |= {
            f"theta_{axle}_rad": _integral(t, wheel) / r,
            f"omega_{axle}_radps": wheel / r,
            f"v_wheel_{axle}_mps": wheel,
            f"slip_{axle}": (wheel - body) / np.maximum(np.maximum(wheel, body), 0.02),
            f"sinkage_{axle}_m": depth + 0.006 * wheel / variant.velocity,
            f"force_x_{axle}_N": 2.0 * accel,
            f"force_z_{axle}_N": load[axle],
            f"thrust_{axle}_N": 18 * np.tanh(wheel / 0.05),
            f"resistance_{axle}_N": -18 * np.tanh(wheel / 0.05) + 2.0 * accel,
            f"torque_{axle}_Nm": torque,
            f"current_{axle}_A": torque / (53 * 0.8 * 0.03),
        }
    steady = (variant.velocity / variant.acceleration, end - variant.velocity / variant.acceleration)
    return Run(variant, robot, load_soil(), "constant", 0.26, {}, signals, slip, steady, 0.01)


def made_up_trial(velocity: float = 0.3, repetition: int = 1, name: str | None = None) -> TrialResult:
    """Return a virtual trial of a variant of Table 2 with everything that a recording shows."""
    variant = variant_of(velocity)
    rng = np.random.default_rng(round(1000 * velocity) + repetition)
    slip = SLIP[velocity] + 0.004 * (repetition - 2)
    run = _run(variant, SLIP[velocity])
    name = name or f"virtual_{velocity:g}_{repetition}"
    start = ORIGIN + REST
    t = ORIGIN + np.arange(0, run.t[-1] + 2 * REST, 0.005)
    τ = t - start

    v_true = (1 - slip) * _trapezoid(τ - 0.09, variant)
    wander = 0.002 * np.sin(1.3 * τ + repetition)
    v = v_true + wander * (v_true > 0)
    v_std = 0.0005 + 0.003 * np.sin(np.pi * np.clip(τ / run.t[-1], 0, 1)) ** 2
    wheel = _trapezoid(τ - 0.04, variant)
    v_wheel = wheel[:, None] + 0.003 * (wheel > 0)[:, None] * np.sin(9 * τ[:, None] + np.arange(4))
    moving = wheel > 0.01
    ratio = (v_wheel - v[:, None]) / np.maximum(np.maximum(v_wheel, v[:, None]), 0.02)
    λ = np.where(moving[:, None], ratio, np.nan)
    λ_std = np.where(moving, v_std / np.maximum(wheel, 0.02), np.nan)[:, None].repeat(4, axis=1)
    accel = np.gradient(v, t)
    pitch = -0.006 - 0.013 * np.gradient(v_true, t)
    phase = np.where(τ < 0, "rest", np.where(τ < run.steady[0], "accelerate", "steady"))
    phase = np.where(τ > run.steady[1], "brake", phase)
    phase = np.where(τ > run.t[-1] - 0.8, "rest", phase)
    rests = ((t[0], start - 0.05), (t[phase == "brake"][-1] + 0.3, t[-1]))
    still = (t < rests[0][1]) | (t > rests[1][0])
    updates = np.flatnonzero(still)[::4]

    health = Health(
        t=np.repeat(t[updates], 2),
        kind=("zero_velocity", "zero_rate") * len(updates),
        innovation=rng.normal(0, 1e-3, 2 * len(updates)),
        innovation_std=np.full(2 * len(updates), 1e-3),
        nis={"zero_velocity": 1.02, "zero_rate": 0.97},
        accel_bias=0.02 + 1e-4 * np.sin(τ),
        accel_bias_std=np.full_like(t, 2e-3),
        gyro_bias=np.full_like(t, -0.001),
        gyro_bias_std=np.full_like(t, 1e-4),
        rests=rests,
        verdict="the filter's innovations are as large as it says",
        good=True,
    )
    slip_estimate = Estimate(slip, 0.004)
    warnings = ("3 duplicate stamps were dropped",) if repetition == 2 else ()
    motion = Motion(
        trial=name,
        virtual=True,
        t=t,
        x=_integral(t, v),
        x_std=0.0004 + 0.0005 * np.clip(τ, 0, None),
        v=v,
        v_std=v_std,
        pitch=pitch,
        pitch_std=np.full_like(t, 0.0009),
        v_wheel=v_wheel,
        v_wheel_std=np.full_like(v_wheel, 0.001),
        slip=λ,
        slip_std=λ_std,
        slip_velocity=wheel - v,
        slip_velocity_std=v_std,
        phase=tuple(phase.tolist()),
        slip_ratio=slip_estimate,
        distance=Estimate(float(_integral(t, v)[-1]), 0.004),
        distance_wheels=Estimate(float(_integral(t, wheel)[-1]), 0.0005),
        steady=(start + run.steady[0], start + run.steady[1]),
        t_start=Estimate(start, 0.002),
        clock_offset=Estimate(0.0, 0.001),
        variant=variant,
        variant_source="given",
        noise={"accel_mps2": 0.01},
        health=health,
        warnings=warnings,
    )
    fit = K92Fit(
        trial=name,
        virtual=True,
        variant=variant,
        k92=Estimate(0.26, 0.012),
        k92_trajectory=Estimate(0.255, 0.02),
        t_start=Estimate(start, 0.002),
        slip_measured=slip_estimate,
        slip_simulated=run.slip_ratio,
        status="ok",
        status_trajectory="ok",
        notes=("made up by hand",),
    )
    specific_force = np.column_stack([accel - 9.81 * pitch, 0 * t, np.full_like(t, 9.81)])
    rate = np.column_stack([0 * t, np.gradient(pitch, t) - 0.001, 0 * t])
    torque = {axle: np.interp(τ, run.t, run[f"torque_{axle}_Nm"]) for axle in "fr"}
    current = np.column_stack([1.1 * torque[axle] / (53 * 0.8 * 0.03) for axle in "ffrr"])
    trial = Trial(
        name=name,
        info=TrialInfo(
            robot="granite", soil="dry_sand", v_desired=velocity, repetition=repetition, virtual=True
        ),
        imu=ImuStream(
            t, specific_force + rng.normal(0, 0.08, (len(t), 3)), rate + rng.normal(0, 0.002, (len(t), 3))
        ),
        wheels=WheelStream(t[::2], np.cumsum(v_wheel, axis=0)[::2] * 0.005 / run.robot.wheels.radius),
        currents=CurrentStream(t[::2], current[::2] + rng.normal(0, 0.05, (len(t[::2]), 4))),
        command=Series(t[::2], _trapezoid(τ, variant)[::2]),
        warnings=warnings,
        inputs=(InputFile(Path(f"{name}.csv"), "0" * 64),),
    )
    return TrialResult(trial, _comparison(motion, run, fit, trial, torque))


def _comparison(motion: Motion, run: Run, fit: K92Fit, trial: Trial, torque: dict[str, Array]) -> Comparison:
    τ = motion.t - fit.t_start.value
    assert trial.imu is not None

    def model(name: str) -> Array:
        return np.interp(τ, run.t, run[name])

    measured = {"velocity": motion.v, "pitch": motion.pitch, "accel": trial.imu.specific_force[:, 0],
                "pitch_rate": trial.imu.angular_rate[:, 1]}  # fmt: skip
    std = {"velocity": motion.v_std, "pitch": motion.pitch_std, "accel": np.full_like(τ, 0.08),
           "pitch_rate": np.full_like(τ, 0.002)}  # fmt: skip
    simulated = {"velocity": model("v_mps"), "pitch": model("pitch_rad"), "accel": model("imu_ax_mps2"),
                 "pitch_rate": model("pitch_rate_radps")}  # fmt: skip
    units = {"velocity": "m/s", "pitch": "rad", "accel": "m/s^2", "pitch_rate": "rad/s"}
    for i, name in enumerate(WHEELS):
        axle = "f" if i < 2 else "r"
        measured[f"wheel_{name}"], std[f"wheel_{name}"] = motion.v_wheel[:, i], motion.v_wheel_std[:, i]
        simulated[f"wheel_{name}"], units[f"wheel_{name}"] = model(f"v_wheel_{axle}_mps"), "m/s"
    for axle, pair in (("f", slice(0, 2)), ("r", slice(2, 4))):
        measured[f"slip_{axle}"], std[f"slip_{axle}"] = motion.slip[:, pair].mean(1), motion.slip_std[:, 0]
        simulated[f"slip_{axle}"], units[f"slip_{axle}"] = model(f"slip_{axle}"), ""
        measured[f"torque_{axle}"], std[f"torque_{axle}"] = 1.1 * torque[axle], np.full_like(τ, 0.05)
        simulated[f"torque_{axle}"], units[f"torque_{axle}"] = model(f"torque_{axle}_Nm"), "N m"
    misfits = tuple(
        Misfit(c, units[c], "all", float(np.sqrt(np.nanmean(d**2))), float(np.nanmean(d)),
               float(np.nanmax(np.abs(d))), 1.0, int(np.isfinite(d).sum()))
        for c, d in ((c, simulated[c] - measured[c]) for c in measured)
    )  # fmt: skip
    return Comparison(motion, run, fit, τ, measured, std, simulated, units, misfits)


def made_up_study(repetitions: int = 3, velocities: tuple[float, ...] = (0.2, 0.3, 0.5, 0.7)) -> StudyResult:
    """Return a study of virtual trials, with one failure."""
    trials = tuple(made_up_trial(v, k) for v in velocities for k in range(1, repetitions + 1))
    failures = (Failure("broken", "broken.csv: column 'imu_gy' is missing", "see the log format"),)
    return StudyResult("made_up", trials, failures, None, Source("0.1.0", "study", (), ()))
