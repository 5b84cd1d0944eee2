"""Study results made of smooth functions: no stage of the chain is needed to test a report."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from granite_lab.comparison.record import Comparison, Misfit
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Health, Motion
from granite_lab.fitting.fit import AThetaFit, K92Fit, Law
from granite_lab.logs.trial import ImuStream, InputFile, Trial, TrialInfo, WheelStream
from granite_lab.model.run import Run
from granite_lab.parameters import Variant, load_paper, load_robot, load_soil, load_variants
from granite_lab.reporting.content import Failure, Source, StudyResult, TrialResult

UNITS = {
    "velocity": "m/s",
    **{f"wheel_{w}": "m/s" for w in ("fl", "fr", "rl", "rr")},
    "slip_f": "-",
    "slip_r": "-",
    "torque_f": "N m",
    "torque_r": "N m",
    "pitch": "rad",
    "accel": "m/s^2",
    "pitch_rate": "rad/s",
}
STD = {"velocity": 3e-3, "wheel": 1e-3, "slip": 8e-3, "torque": 0.08, "pitch": 4e-4, "accel": 0.05}
LAMBDA = {0.2: 0.0531, 0.3: 0.0835, 0.5: 0.165, 0.7: 0.229}


def trapezoid(t: np.ndarray, variant: Variant) -> np.ndarray:
    end = variant.distance / variant.velocity + variant.velocity / variant.acceleration
    ramp = np.minimum(variant.acceleration * t, variant.acceleration * (end - t))
    return np.clip(ramp, 0, variant.velocity)


def lagged(t: np.ndarray, y: np.ndarray, constant: float) -> np.ndarray:
    out, step = np.zeros_like(y), t[1] - t[0]
    for k in range(1, len(t)):
        out[k] = out[k - 1] + step / constant * (y[k] - out[k - 1])
    return out


def channels(t: np.ndarray, variant: Variant, slip: float, rear: float) -> dict[str, np.ndarray]:
    desired = trapezoid(t, variant)
    wheel = lagged(t, desired, 0.03)
    body = lagged(t, wheel * (1 - slip), 0.12)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (wheel - body) / np.maximum(np.maximum(wheel, body), 0.02)  # (1)
    accel = np.gradient(body, t)
    load = 1.6 * np.tanh(body / 0.1) + 3 * slip * np.tanh(body / 0.1)
    return {
        "velocity": body,
        **{f"wheel_{w}": wheel for w in ("fl", "fr", "rl", "rr")},
        "slip_f": ratio,
        "slip_r": 0.97 * ratio,
        "torque_f": load + 0.6 * accel,
        "torque_r": rear * load + 0.9 * accel,
        "pitch": 0.0095 + 0.004 * np.tanh(body) - 0.004 * accel,
        "accel": accel,
        "pitch_rate": np.gradient(-0.004 * accel, t),
    }


def made_up_trial(variant: Variant, repetition: int, virtual: bool, seed: int) -> TrialResult:
    rng = np.random.default_rng(seed)
    robot, soil = load_robot(), load_soil()
    slip = LAMBDA.get(variant.velocity, 0.1) * (1 + 0.02 * rng.standard_normal())
    k92 = float(np.exp(-4.919 * variant.velocity) * (1 + 0.04 * rng.standard_normal()))
    end = variant.distance / variant.velocity + variant.velocity / variant.acceleration
    t = np.arange(-1.0, end + 2.5, 0.005)
    sim, true = channels(t, variant, slip, 1.08), channels(t, variant, slip, 1.3)
    std = {c: np.full(len(t), STD[c.split("_")[0]] if c != "pitch_rate" else 0.003) for c in UNITS}
    slow = 2e-3 * np.sin(2 * np.pi * t / 3.1 + rng.uniform(0, 6))
    measured = {c: true[c] + std[c] * rng.standard_normal(len(t)) for c in UNITS}
    measured["velocity"] = true["velocity"] + slow
    measured["pitch"] = true["pitch"] + 0.1 * slow
    for c in ("slip_f", "slip_r"):
        std[c] = np.minimum(0.5, 3e-3 / np.maximum(true["wheel_fl"], 1e-3))
        measured[c] = np.where(
            true["wheel_fl"] > 0.02, true[c] + std[c] * rng.standard_normal(len(t)), np.nan
        )
    ramp = variant.velocity / variant.acceleration
    names = np.select(
        [t < 0, t < ramp, t < end - ramp, t < end], ["rest", "accelerate", "steady", "brake"], "rest"
    )
    name = f"v{variant.velocity:g}_r{repetition}"
    origin, steady = 100.0, ((end) / 2, end - ramp)
    signals = {
        "t_s": t,
        "v_desired_mps": trapezoid(t, variant),
        "v_mps": sim["velocity"],
        "x_m": np.cumsum(sim["velocity"]) * 0.005,
        "pitch_rad": sim["pitch"],
        "slip_f": sim["slip_f"],
        "slip_r": sim["slip_r"],
        "torque_f_Nm": sim["torque_f"],
        "torque_r_Nm": sim["torque_r"],
    }
    run = Run(variant, robot, soil, "constant", k92, {}, signals, slip, steady, 0.01)
    moving = names != "rest"
    updates = t[~moving][::5]
    health = Health(
        t=np.concatenate([updates, t[moving][::20]]) + origin,
        kind=("zero_velocity",) * len(updates) + ("wheel_rest",) * len(t[moving][::20]),
        innovation=1e-3 * rng.standard_normal(len(updates) + len(t[moving][::20])),
        innovation_std=np.full(len(updates) + len(t[moving][::20]), 1e-3),
        nis={"zero_velocity": 1.04, "wheel_rest": 0.93},
        accel_bias=0.02 + 1e-3 * np.tanh(t),
        accel_bias_std=np.full(len(t), 2e-3),
        gyro_bias=np.full(len(t), 1e-4),
        gyro_bias_std=np.full(len(t), 3e-5),
        rests=((t[0] + origin, origin), (end + 1.8 + origin, t[-1] + origin)),
        verdict="The filter is consistent: innovations are white and as large as predicted.",
        good=True,
    )
    measured_slip = Estimate(slip * (1 + 0.005 * rng.standard_normal()), 0.003)
    n = len(t)
    motion = Motion(
        trial=name, virtual=virtual, t=t + origin, x=signals["x_m"], x_std=np.full(n, 4e-3),
        v=measured["velocity"], v_std=std["velocity"], pitch=measured["pitch"], pitch_std=std["pitch"],
        v_wheel=np.column_stack([measured[f"wheel_{w}"] for w in ("fl", "fr", "rl", "rr")]),
        v_wheel_std=np.full((n, 4), 1e-3),
        slip=np.column_stack([measured["slip_f"]] * 2 + [measured["slip_r"]] * 2),
        slip_std=np.column_stack([std["slip_f"]] * 4),
        slip_velocity=measured["wheel_fl"] - measured["velocity"], slip_velocity_std=std["velocity"],
        phase=tuple(names), slip_ratio=measured_slip,
        distance=Estimate(variant.distance * (1 - slip), 0.006),
        distance_wheels=Estimate(variant.distance, 1e-4),
        steady=(steady[0] + origin, steady[1] + origin), t_start=Estimate(origin, 0.002),
        clock_offset=Estimate(0.0123, 0.0011), variant=variant, variant_source="given",
        noise={"accel_white_mps2": 0.05}, health=health, warnings=(),
    )  # fmt: skip
    fit = K92Fit(
        trial=name, virtual=virtual, variant=variant, k92=Estimate(k92, 0.012),
        k92_trajectory=Estimate(k92 * 1.02, 0.008),
        t_start=Estimate(origin, 0.002), slip_measured=measured_slip, slip_simulated=slip, status="ok",
        status_trajectory="ok",
    )  # fmt: skip
    misfits = []
    for c, unit in UNITS.items():
        d = sim[c] - measured[c]
        for phase in ("all", "rest", "accelerate", "steady", "brake"):
            keep = np.isfinite(d) & ((names == phase) | (phase == "all"))
            if not keep.any():
                misfits.append(Misfit(c, unit, phase, *(float("nan"),) * 4, 0))
                continue
            e = d[keep]
            misfits.append(
                Misfit(c, unit, phase, float(np.sqrt(np.mean(e**2))), float(e.mean()), float(np.abs(e).max()),
                       float(np.sqrt(np.mean((e / std[c][keep]) ** 2))), int(keep.sum()))
            )  # fmt: skip
    comparison = Comparison(motion, run, fit, t, measured, std, sim, UNITS, tuple(misfits))
    info = TrialInfo(
        robot="granite", soil="dry_sand", v_desired=variant.velocity, repetition=repetition, virtual=virtual
    )
    trial = Trial(
        name=name, info=info, imu=ImuStream(t + origin, np.zeros((n, 3)), np.zeros((n, 3))),
        wheels=WheelStream(t + origin, np.zeros((n, 4))),
        inputs=(InputFile(Path(f"data/samples/{name}.csv"), f"{seed:064x}"),),
    )  # fmt: skip
    return TrialResult(trial, comparison)


def made_up_a_theta(results: tuple[TrialResult, ...]) -> AThetaFit:
    points = tuple(
        (
            r.trial.name,
            r.comparison.motion.variant.velocity,
            r.comparison.fit.k92,
            r.comparison.fit.slip_measured,
        )
        for r in results
    )
    laws = (
        Law("exponential", "k_92 = exp(-a_θ v)", {"a_theta": Estimate(4.93, 0.05)}, {"a_theta": "s/m"}, 1,
        0.011, -88.1, 0.97),
        Law("linear_slip", "k_92 = b_0 + b_1 λ_R",
        {"b_0": Estimate(0.411, 0.006), "b_1": Estimate(-1.74, 0.04)},
            {"b_0": "-", "b_1": "-"}, 2, 0.013, -80.2, 0.02),
        Law("free", "k_92 constant per speed",
        {f"k92_{v:g}": Estimate(float(np.exp(-4.919 * v)), 0.01) for v in LAMBDA},
            {f"k92_{v:g}": "-" for v in LAMBDA}, 4, 0.010, -77.6, 0.01),
    )  # fmt: skip
    return AThetaFit(
        Estimate(4.93, 0.052), (4.816, 5.044), 4.921, 4.94, 0.03, load_paper().a_theta, True, points, laws
    )


def made_up_study(
    virtual: bool = True, speeds: tuple[float, ...] = tuple(LAMBDA), repetitions: int = 3
) -> StudyResult:
    variants = [v for v in load_variants() if v.velocity in speeds]
    results = tuple(
        made_up_trial(variant, repetition, virtual, seed=10 * i + repetition)
        for i, variant in enumerate(variants)
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
    first = result.trials[0]
    c = first.comparison
    motion = dataclasses.replace(c.motion, trial=name, warnings=(f"line 3: {name}",))
    comparison = dataclasses.replace(
        c, motion=motion, fit=dataclasses.replace(c.fit, trial=name, notes=(name,))
    )
    trial = dataclasses.replace(
        first.trial, name=name, warnings=(name,), inputs=(InputFile(Path(name), "00"),)
    )
    a_theta = result.a_theta and dataclasses.replace(
        result.a_theta, points=((name, *result.a_theta.points[0][1:]), *result.a_theta.points[1:])
    )
    return dataclasses.replace(
        result,
        name=name,
        trials=(TrialResult(trial, comparison), *result.trials[1:]),
        failures=(Failure(name, name, name),),
        a_theta=a_theta,
        source=dataclasses.replace(result.source, command=name, parameters=((name, name, name, name),)),
    )
