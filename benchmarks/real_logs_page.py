"""Text of the page on real logs; every figure in it is computed in the run that writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from benchmarks.against_truth import Velocities, errors, inside, percent, rms, table
from benchmarks.blind_code import commit
from benchmarks.log_set import LogSet

HIGH = 0.4
"""Slip ratio above which coverage is told apart."""

SNOW_RATIO, SNOW_INSIDE, SNOW_HIGH_INSIDE, SNOW_UNNAMED_INSIDE = 0.6, (0.88, 0.98), 0.80, 0.85
CAR_RMSE, CAR_INSIDE = 0.044, 0.88
"""Aims on snow: RMSE over that of the wheels, coverage. Car that brakes: RMSE [m/s], coverage."""


@dataclass(frozen=True)
class Delay:
    """How a reference agrees with a velocity that is delayed by `by` [s]: RMSE [m/s], share within ±2σ."""

    by: float
    rmse: float
    inside: float


@dataclass(frozen=True)
class Delays:
    """How the car's reference is delayed.

    Attributes:
        scenes: against the estimate and against the wheels, by scene.
        decay: time constant with which it comes to zero while the wheels stand [s].
        unseen: largest velocity of the estimate while the wheels read zero [m/s], by scene.
    """

    scenes: Mapping[str, tuple[Delay, Delay]]
    decay: float
    unseen: Mapping[str, float]


def page(sets: Mapping[str, LogSet], late: Delays, slides: Mapping[str, tuple[float, float]]) -> str:
    """Return the page.

    Args:
        sets: data sets by name.
        late: how the car's reference is delayed.
        slides: way by wheels and by camera of the robot without IMU [m], by run.
    """
    named, unnamed, scenes = sets["snow, named"].runs, sets["snow"].runs, sets["car"].runs
    ones = [run for run in named if run.name.startswith("1")]
    braking, creeping, others = scenes[:1], scenes[1:2], scenes[2:]
    groups = {
        "snow 1_*, named": ones,
        "snow 2_*, named": [run for run in named if run not in ones],
        "snow, none named": unnamed,
        "car 0757, brakes to a stop": braking,
        "car 1100, stop and go": creeping,
        "car, seven scenes, no standstill": others,
        "Pathfinder, rough ground": sets["pathfinder"].runs,
        "Husky, firm ground": sets["husky"].runs,
        "car at scale 1:10, skids": sets["small car"].runs,
    }
    aims = {
        "snow 1_*, named: ratio": (ratio(ones), 0.0, SNOW_RATIO),
        "snow 1_*, named: inside": (inside(ones), *SNOW_INSIDE),
        "snow 1_*, named: inside above 40 % slip": (inside(ones, HIGH), SNOW_HIGH_INSIDE, 1.0),
        "snow, none named: ratio": (ratio(unnamed), 0.0, 1.0),
        "snow, none named: inside": (inside(unnamed), SNOW_UNNAMED_INSIDE, 1.0),
        "car that brakes: RMSE [m/s]": (rms(errors(braking)), 0.0, CAR_RMSE),
        "car that brakes: inside": (inside(braking), CAR_INSIDE, 1.0),
    }
    missed = [
        f"{what} {value:.3f} ({low:g} to {high:g})"
        for what, (value, low, high) in aims.items()
        if not low <= value <= high
    ]
    worse = sum(ratio(runs) > 1 for runs in groups.values())
    grades = [run.grade for runs in groups.values() for run in runs]
    verdicts = ", ".join(f"{grades.count(grade)} {grade}" for grade in ("good", "fair", "poor"))
    return f"""# Estimation on real logs

Logs of other robots, recorded by others. The estimator does not see the references.

## What was reached

{table(HEAD, [summary(name, runs) for name, runs in groups.items()])}
RMSE of the velocity [m/s] of the estimate and of the wheels alone, and the share of velocities within ±2σ.
Bold: worse than the wheels, or less than 85 % inside. *Named*: both standstills are given. Each run is in
[a table](tables/real-logs.csv).

* **With both standstills known the IMU measures the velocity** at any slip of the wheels (snow).
* **Otherwise a constant slip cannot be measured.** The estimate follows the wheels minus the slip expected
  on the ground, and as much again for each m/s² gained: 2.5 % with a std for 0 to 100 %; for car and Husky
  with GPS 0.5 ± 2 %, by a [soil file](../benchmarks/robots/firm.toml). The 2.5 % were chosen on these logs,
  from 2 to 4, the 0.5 % with knowledge of them: the figures without a standstill are not blind.
* **The estimate is worse than the wheels** in {worse} of {len(groups)} rows. Verdicts: {verdicts}.

Aims missed, {len(missed)} of {len(aims)}: {"; ".join(missed) or "none"}.

## The logs

*Rover on snow*: four wheels, straight, drawn back until it is stuck (slip up to 100 %). IMU and wheels 10 Hz;
reference: its inertial navigation, whose std of 0.03 m/s at rest is allowed for.{_refused(sets)}

![rover on snow, both standstills named: estimate with two std, wheels, reference](figures/real_snow.png)

*Car*: a Renault Zoe of nuScenes, judged while it moves. IMU and wheels 100 Hz; reference: fused velocity.
{_delayed(late)}

![car in nine scenes: estimate with two std, wheels, reference](figures/real_car.png)

{_others(sets)}
![Pathfinder, Husky, small car, Husky on snow and loam](figures/real_others.png)

{_boreal(sets["boreal"])}

*Robotino*: three wheels, no IMU, a camera of unknown scale. Apparent slip: {_slips(slides)}. Published: brown
17.5 %, gray 22 to 24 %, green 39 to 45 %, table 13 %.

Sources and licences of the logs, and what was written by hand:
[`benchmarks/robots`](../benchmarks/robots/README.md). Written by
`python -m benchmarks.real_logs --data FOLDER`, code {commit()}.
"""


def run_table(sets: Mapping[str, LogSet], late: Delays) -> pd.DataFrame:
    """Return a row for each run: RMSE [m/s], shares within ±2σ, and for the car the same at its delay [s]."""
    rows = []
    for name, found in sets.items():
        for run in found.runs:
            judged = {
                "logs": name, "run": run.name, "verdict": run.grade, "rmse_mps": rms(errors([run])),
                "rmse_wheels_mps": rms(errors([run], "wheels")), "inside": inside([run]),
                "inside_above_40_percent_slip": inside([run], HIGH), "median_std_mps": np.median(run.std),
            }  # fmt: skip
            if name == "car":
                body, wheels = late.scenes[run.name]
                judged |= {
                    "delay_s": body.by, "delay_wheels_s": wheels.by, "rmse_at_delay_mps": body.rmse,
                    "rmse_wheels_at_delay_mps": wheels.rmse, "inside_at_delay": body.inside,
                }  # fmt: skip
            rows += [judged] if np.isfinite(run.truth).all() else []
    return pd.DataFrame(rows).round(3)


HEAD = (
    "logs", "runs", "estimate", "wheels", "ratio", "in 2σ [%]", "above 40 % slip",
)  # fmt: skip


def ratio(runs: Sequence[Velocities]) -> float:
    """RMSE of the estimate over that of the wheels."""
    return rms(errors(runs)) / rms(errors(runs, "wheels"))


def summary(name: str, runs: Sequence[Velocities]) -> list[str]:
    """One row of the first table."""
    worse, share = ratio(runs), inside(runs)
    return [
        name, str(len(runs)), f"{rms(errors(runs)):.3f}",
        f"{rms(errors(runs, 'wheels')):.3f}", f"{worse:.2f}" if worse <= 1 else f"**{worse:.2f}**",
        percent(share) if share >= SNOW_UNNAMED_INSIDE else f"**{percent(share)}**",
        percent(inside(runs, HIGH)),
    ]  # fmt: skip


def _refused(sets: Mapping[str, LogSet]) -> str:
    refused = {**sets["snow, named"].refused, **sets["snow"].refused}
    return "".join(f" {name} was refused: {why}." for name, why in sorted(refused.items()))


def _delayed(late: Delays) -> str:
    braking, (body, wheels) = late.scenes["0757"][0], late.scenes["1100"]
    return f"""The reference cannot judge tenths of a second. At standstill it decays like a low-pass of
{late.decay:.3f} s. In scene 1100 it equals the wheels {wheels.by:.2f} s ago within {wheels.rmse:.3f} m/s,
and is {body.by:.2f} s behind the estimate, which is on the clock of the IMU: wheels that count few pulses
read zero there until the car goes at {late.unseen["1100"]:.2f} m/s by the IMU. With the delays taken out, the
RMSE is {body.rmse:.3f} m/s in scene 1100, with {percent(body.inside)} % inside, and {braking.rmse:.3f} m/s in
scene 0757 (delay {braking.by:.2f} s), with {percent(braking.inside)} % inside."""


def _others(sets: Mapping[str, LogSet]) -> str:
    (rover,), (husky,) = sets["pathfinder"].runs, sets["husky"].runs
    (motion,), (driven,) = sets["pathfinder"].motions.values(), sets["husky"].motions.values()
    true_way = float(np.trapezoid(rover.truth, rover.t))
    offset = driven.clock_offset
    return f"""*Pathfinder*: planetary test rover, a standstill at both ends; IMU 250 Hz, wheels and
differential GPS 10 Hz. Distance {motion.distance.value:.1f} ± {motion.distance.std:.1f} m, by GPS
{true_way:.1f} m. Vibration makes the gyro lose the pitch, which the level at the next standstill shows. The
scatter of the GPS speed, {rover.truth_std:.2f} m/s, is allowed for.

*Husky*: firm ground, {np.ptp(driven.t):.0f} s with one stop; IMU 30 Hz. GPS speed is the slope of a line
through five fixes. Its scatter of {husky.truth_std:.2f} m/s is most of the RMSE and is allowed for. Clock
offset: {offset.value:+.2f} ± {offset.std:.2f} s; the yaw rates, which are not used, give −0.38 s.

*Car at scale 1:10*: motion capture, skids up to 4 m/s, one speed for four wheels, no pitch gyro, no
standstill. Fast changes of slip are measured, a constant slip is assumed.
"""


def _boreal(found: LogSet) -> str:
    ahead = [100 * float(np.mean(run.v - run.wheels > 2 * run.std)) for run in found.runs]
    return f"""*BorealTC*: a Husky on snow and sandy loam, no standstill, no reference. A body is seldom
faster than its wheels. In {len(ahead)} logs the estimate exceeds them by more than 2σ in {min(ahead):.1f} to
{max(ahead):.1f} % of the time; chance alone gives 2.3 %."""


def _slips(slides: Mapping[str, tuple[float, float]]) -> str:
    by_surface: dict[str, list[float]] = {}
    for name, (rolled, camera) in slides.items():
        by_surface.setdefault(name.split("_")[0], []).append(100 * (1 - camera / rolled))
    return ", ".join(f"{surface} {np.mean(slips):.1f} %" for surface, slips in by_surface.items())
