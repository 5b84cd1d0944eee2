"""Study results of virtual trials whose estimate is made up: what a report and a recording need."""

import dataclasses
import math
import zlib
from functools import cache
from pathlib import Path

import numpy as np

from granite_lab.comparison.compare import Comparison, compare
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Health
from granite_lab.fitting import fit_a_theta
from granite_lab.fitting.fit import K92Fit
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.trial import InputFile
from granite_lab.model.run import Run
from granite_lab.model.simulator import simulate
from granite_lab.parameters import Variant, load_robot, load_soil, variant_of
from granite_lab.results import Failure, Source, StudyResult
from tests.fitting import made_up as virtual_trials
from tests.truth.faults import shifted_time

SPEEDS = (0.2, 0.3, 0.5, 0.7)
ORIGIN = 102.0
"""Stamp in every log at which the command begins [s]."""


@cache
def made_up_run(variant: Variant) -> Run:
    return simulate(variant, load_robot(), load_soil(), k92=math.exp(-4.93 * variant.velocity))


def made_up_trial(
    velocity: float = 0.3, repetition: int = 1, name: str | None = None, *, virtual: bool = True
) -> Comparison:
    """Return a trial of a variant of Table 2 with everything that a report and a recording show."""
    variant = variant_of(velocity)
    name = name or f"{'virtual' if virtual else 'trial'}_{velocity:g}_{repetition}"
    run, seed = made_up_run(variant), round(1000 * velocity) + repetition
    motion, trial, _, start = virtual_trials.made_up_trial(
        variant, run.k92_value, seed=seed, run=run, name=name, velocity_std=0.001, start_error=0.0
    )
    later = ORIGIN - start
    warnings = ("3 duplicate stamps were dropped",) if repetition == 2 else ()
    t, t_start = motion.t + later, Estimate(ORIGIN, 0.002)
    motion = dataclasses.replace(
        motion, virtual=virtual, t=t, steady=(motion.steady[0] + later, motion.steady[1] + later),
        t_start=t_start, slip_ratio=Estimate(run.slip_ratio + 0.004 * (repetition - 2), 0.004),
        clock_offset=Estimate(0.0123, 0.0011), noise={"accel_mps2": 0.01},
        health=made_up_health(t, ORIGIN + motion.variant.distance / velocity, seed), warnings=warnings,
    )  # fmt: skip
    k92 = run.k92_value * (1 + 0.04 * (repetition - 2))
    fit = K92Fit(
        trial=name, virtual=virtual, variant=variant, k92=Estimate(k92, 0.012),
        k92_trajectory=Estimate(1.02 * k92, 0.008), t_start=t_start, slip_measured=motion.slip_ratio,
        slip_simulated=run.slip_ratio, status="ok", status_trajectory="ok", notes=("made up by hand",),
    )  # fmt: skip
    trial = shifted_time(trial, later)
    current = 1.1 * trial.currents.current  # a gain that is off, so that something differs
    trial = dataclasses.replace(
        trial, info=dataclasses.replace(trial.info, virtual=virtual), doubts=tuple(map(Doubt, warnings)),
        currents=dataclasses.replace(trial.currents, current=current),
        inputs=(InputFile(Path(f"data/samples/{name}.csv"), f"{zlib.crc32(name.encode()):064x}"),),
    )  # fmt: skip
    return compare(motion, trial, fit, run)


def made_up_health(t: np.ndarray, stop: float, seed: int) -> Health:
    """Return a filter's account of a trial that rests at both ends."""
    rng, n = np.random.default_rng(seed), len(t)
    rests = ((float(t[0]), ORIGIN - 0.05), (stop + 1.5, float(t[-1])))
    updates = np.flatnonzero((t < rests[0][1]) | (t > rests[1][0]))[::4]
    return Health(
        t=np.repeat(t[updates], 2), kind=("zero_velocity", "zero_rate") * len(updates),
        innovation=rng.normal(0, 1e-3, 2 * len(updates)), innovation_std=np.full(2 * len(updates), 1e-3),
        nis={"zero_velocity": 1.02, "zero_rate": 0.97}, accel_bias=0.02 + 1e-4 * np.sin(t),
        accel_bias_std=np.full(n, 2e-3), gyro_bias=np.full(n, -0.001), gyro_bias_std=np.full(n, 1e-4),
        rests=rests, verdict="The innovations are white and as large as predicted.", grade="good",
    )  # fmt: skip


def made_up_study(
    virtual: bool = True, speeds: tuple[float, ...] = SPEEDS, repetitions: int = 3
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
    a_theta = fit_a_theta([r.fit for r in results]) if len(results) > 1 else None
    return StudyResult("made-up", results, (), a_theta, source)


def rename(result: StudyResult, name: str) -> StudyResult:
    """Give the first trial another name everywhere, and put it into warnings and failures too."""
    replace, first = dataclasses.replace, result.trials[0]
    motion = replace(first.motion, trial=name, warnings=(f"line 3: {name}",))
    trial = replace(first.trial, name=name, doubts=(Doubt(name),), inputs=(InputFile(Path(name), "00"),))
    renamed = replace(first, trial=trial, motion=motion, fit=replace(first.fit, trial=name, notes=(name,)))
    a_theta = result.a_theta
    if a_theta is not None:
        a_theta = replace(a_theta, points=((name, *a_theta.points[0][1:]), *a_theta.points[1:]))
    return replace(
        result, name=name, trials=(renamed, *result.trials[1:]),
        failures=(Failure(name, name, name),), a_theta=a_theta,
        source=replace(result.source, command=name, parameters=((name, name, name, name),)),
    )  # fmt: skip
