"""Virtual trials whose estimate is made up: a simulated run with errors of known size on it.

The estimate's velocity carries an error that is correlated over seconds, as a smoother's is; the
encoders and currents carry the errors of the robot's file. Sand and k_92 may differ per trial.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.signal import lfilter

from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Health, Motion
from granite_lab.fitting.sand import SAND_SCATTER, perturbed
from granite_lab.logs.trial import Array, CurrentStream, ImuStream, Trial, TrialInfo, WheelStream
from granite_lab.model import Run, simulate
from granite_lab.model.command import phase_of
from granite_lab.parameters import GRAVITY, Robot, Soil, Variant, load_robot, load_soil

T_START = 12.3
"""Where the command begins in the made-up logs [s]."""

NOTHING = np.zeros(0)
HEALTHY = Health(NOTHING, (), NOTHING, NOTHING, {}, NOTHING, NOTHING, NOTHING, NOTHING, (), "made up", True)


def draw_soil(rng: np.random.Generator, soil: Soil | None = None) -> Soil:
    """Return sand as one raking leaves it."""
    soil = soil or load_soil()
    for name, std in SAND_SCATTER.items():
        soil = perturbed(soil, name, std * rng.standard_normal())
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
    robot: Robot | None = None,
    velocity_std: float = 0.003,
    slip_std: float = 0.004,
    start_error: float = 0.01,
    run: Run | None = None,
    name: str = "virtual",
) -> tuple[Motion, Trial, Run]:
    """Return estimate, log and truth of a virtual trial.

    Args:
        variant, k92, soil, robot: of the truth.
        seed: of all errors; every std below may be 0.
        velocity_std: std of the velocity [m/s], correlated over 2 s.
        slip_std: std of λ_R.
        start_error: how far the estimate of the start is off [s].
        run: the truth, if it is not to be simulated here.
        name: of the trial.
    """
    rng = np.random.default_rng(seed)
    robot = robot or load_robot()
    run = run or simulate(variant, robot, soil or load_soil(), k92=k92)
    t = np.arange(run.t[0], run.t[-1], 0.005)

    def at(signal: str, instants: Array) -> Array:
        return np.interp(instants, run.t, run[signal])

    moving = np.abs(at("v_mps", t)) > 1e-3
    v = at("v_mps", t) + moving * correlated(rng, t.size, 0.005, velocity_std, 2.0)
    v_wheel = np.stack([at(f"v_wheel_{axle}_mps", t) for axle in "ffrr"], axis=1)
    floor = np.maximum(np.maximum(v_wheel, v[:, None]), 0.02)
    slip = np.where(v_wheel > 0.02, (v_wheel - v[:, None]) / floor, np.nan)
    motion = Motion(
        trial=name,
        virtual=True,
        t=t + T_START,
        x=at("x_m", t),
        x_std=np.full(t.size, 0.005),
        v=v,
        v_std=np.where(moving, velocity_std, 1e-4),
        pitch=at("pitch_rad", t) + 0.004,
        pitch_std=np.full(t.size, 0.002),
        v_wheel=v_wheel,
        v_wheel_std=np.full(v_wheel.shape, 0.001),
        slip=slip,
        slip_std=np.where(np.isnan(slip), np.nan, velocity_std / floor),
        slip_velocity=v_wheel.mean(axis=1) - v,
        slip_velocity_std=np.full(t.size, velocity_std),
        phase=tuple(phase_of(t, variant)),  # type: ignore[arg-type]
        slip_ratio=Estimate(run.slip_ratio + slip_std * rng.standard_normal(), slip_std),
        distance=Estimate(float(run["x_m"][-1]), 0.005),
        distance_wheels=Estimate(float(run["theta_f_rad"][-1]) * robot.wheels.radius, 0.001),
        steady=(run.steady[0] + T_START, run.steady[1] + T_START),
        t_start=Estimate(T_START + start_error, max(abs(start_error), 0.005)),
        clock_offset=Estimate(0.0, 0.001),
        variant=variant,
        variant_source="given",
        noise={},
        health=HEALTHY,
    )
    return motion, _log(rng, run, robot, name), run


def _log(rng: np.random.Generator, run: Run, robot: Robot, name: str) -> Trial:
    t = np.arange(run.t[0], run.t[-1], 0.01)
    axles = ("f", "f", "r", "r")
    step = 2 * np.pi / robot.encoders.counts
    jittered = t + robot.encoders.jitter * rng.standard_normal(t.size)
    angle = np.stack([np.interp(t, run.t, run[f"enc_{a}_rad"]) for a in axles], axis=1)
    current = np.stack([np.interp(t, run.t, run[f"cur_{a}_A"]) for a in axles], axis=1)
    sensor = robot.currents
    current = current * (1 + sensor.gain * rng.standard_normal(4)) + sensor.offset * rng.standard_normal(4)
    current += sensor.noise * rng.standard_normal(current.shape)
    t_imu = np.arange(run.t[0], run.t[-1], 0.005)
    force = np.zeros((t_imu.size, 3))
    force[:, 0] = np.interp(t_imu, run.t, run["imu_ax_mps2"]) + 0.03
    force[:, 2] = np.interp(t_imu, run.t, run["imu_az_mps2"])
    rate = np.zeros((t_imu.size, 3))
    rate[:, 1] = np.interp(t_imu, run.t, run["imu_gy_radps"]) - 0.002
    force += 0.05 * rng.standard_normal(force.shape)
    rate += 0.003 * rng.standard_normal(rate.shape)
    assert abs(force[:100, 2].mean() - GRAVITY) < 0.1
    return Trial(
        name=name,
        info=TrialInfo(robot=robot.name, virtual=True),
        imu=ImuStream(t_imu + T_START, force, rate),
        wheels=WheelStream(jittered + T_START, np.round(angle / step) * step, step=step),
        currents=CurrentStream(t + T_START, current),
    )


def without_currents(trial: Trial) -> Trial:
    return dataclasses.replace(trial, currents=None)
