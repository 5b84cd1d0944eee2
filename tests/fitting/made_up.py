"""Virtual trials whose estimate is made up: the truth of a simulated run with errors of known size on it.

The estimate's velocity carries an error that is correlated over seconds, as a smoother's is; the log is that
of the robot's virtual sensors. Sand and k_92 may differ per trial.
"""

import dataclasses
from typing import Any

import numpy as np
from scipy.signal import lfilter

from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Health, Motion
from granite_lab.fitting import K92Fit
from granite_lab.inference.constants import SAND_PER_TRIAL_STD
from granite_lab.inference.pool import SAND, SAND_PER_TRIAL
from granite_lab.logs.trial import Array, Trial
from granite_lab.model import Run, simulate
from granite_lab.model.command import phase_of
from granite_lab.model.virtual import virtual_trial
from granite_lab.parameters import Soil, Variant, load_robot, load_soil

SLIP = Estimate(0.2, 0.004)
VELOCITY_STD = 0.003
"""Std of the velocity [m/s], correlated over 2 s, where none is given."""

NOTHING = np.zeros(0)
HEALTHY = Health(
    t=NOTHING, kind=(), innovation=NOTHING, innovation_std=NOTHING, nis={}, accel_bias=NOTHING,
    accel_bias_std=NOTHING, gyro_bias=NOTHING, gyro_bias_std=NOTHING, rests=(), grade="good",
    verdict="made up",
)  # fmt: skip


def draw_soil(rng: np.random.Generator) -> Soil:
    """Return sand as one raking leaves it."""
    soil = load_soil()
    for name, std in zip(SAND[1:SAND_PER_TRIAL], SAND_PER_TRIAL_STD[1:], strict=True):
        ratio = np.exp(std * rng.standard_normal())
        soil = dataclasses.replace(soil, **{name: float(getattr(soil, name) * ratio)})
    return soil


def correlated(rng: np.random.Generator, size: int, dt: float, std: float, time: float) -> Array:
    keep = np.exp(-dt / time)
    shocks = std * np.sqrt(1 - keep**2) * rng.standard_normal(size)
    shocks[0] = std * rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -keep], shocks))


def made_up_trial(
    variant: Variant,
    k92: float,
    *,
    seed: int = 0,
    soil: Soil | None = None,
    slip_std: float = 0.004,
    velocity_std: float = VELOCITY_STD,
    start_error: float = 0.01,
    run: Run | None = None,
    name: str = "virtual",
) -> tuple[Motion, Trial, Run, float]:
    """Return estimate, log, run and start of the command of a virtual trial.

    Args:
        variant, k92, soil: of the truth, in which k_92 is constant.
        seed: of all errors; every std below may be 0.
        slip_std: std of λ_R.
        velocity_std: std of the velocity [m/s], correlated over 2 s.
        start_error: how far the estimate of the start is off [s].
        run: the truth, if it is not to be simulated here.
        name: of the trial.
    """
    rng = np.random.default_rng(seed)
    robot = load_robot()
    run = run or simulate(variant, robot, soil or load_soil(), k92=k92)
    trial, truth = virtual_trial(run, seed, name)
    start = float(truth.attrs["t_start_s"])
    t, x, v, pitch = (truth[column].to_numpy() for column in ("t_s", "x_m", "v_mps", "pitch_rad"))
    moving = np.abs(v) > 1e-3
    v = v + moving * correlated(rng, t.size, 0.005, velocity_std, 2.0)
    v_wheel = np.stack([truth[f"v_wheel_{axle}_mps"] for axle in "ffrr"], axis=1)
    floor = np.maximum(np.maximum(v_wheel, v[:, None]), 0.02)
    slip = np.where(v_wheel > 0.02, (v_wheel - v[:, None]) / floor, np.nan)
    motion = Motion(
        trial=name,
        virtual=True,
        t=t,
        x=x,
        x_std=np.full(t.size, 0.005),
        v=v,
        v_std=np.where(moving, velocity_std, 1e-4),
        pitch=pitch + 0.004,
        pitch_std=np.full(t.size, 0.002),
        v_wheel=v_wheel,
        v_wheel_std=np.full(v_wheel.shape, 0.001),
        slip=slip,
        slip_std=np.where(np.isnan(slip), np.nan, velocity_std / floor),
        slip_velocity=v_wheel.mean(axis=1) - v,
        slip_velocity_std=np.full(t.size, velocity_std),
        phase=tuple(phase_of(t - start, variant)),
        slip_ratio=Estimate(run.slip_ratio + slip_std * rng.standard_normal(), slip_std),
        distance=Estimate(float(run["x_m"][-1]), 0.005),
        distance_wheels=Estimate(float(run["theta_f_rad"][-1]) * robot.wheels.radius, 0.001),
        steady=(run.steady[0] + start, run.steady[1] + start),
        t_start=Estimate(start + start_error, max(abs(start_error), 0.005)),
        clock_offset=Estimate(0.0, 0.001),
        variant=variant,
        variant_source="given",
        noise={},
        health=HEALTHY,
    )
    corrected = dataclasses.replace(trial, imu=dataclasses.replace(trial.imu, robot_axes=True))
    return motion, corrected, run, start


def made_up_fit(trial: str, velocity: float, k92: Estimate, slip: Estimate = SLIP, **told: Any) -> K92Fit:
    """Return the fit of a trial by its steady slip alone."""
    fields = {"slip_simulated": slip.value, "status": "ok", "status_trajectory": "not_evaluated"} | told
    variant, nothing = Variant(velocity=velocity, acceleration=1.0, distance=2.0), Estimate(np.nan)
    return K92Fit(
        trial=trial, virtual=True, variant=variant, k92=k92, k92_trajectory=nothing, t_start=nothing,
        slip_measured=slip, **fields,
    )  # fmt: skip
