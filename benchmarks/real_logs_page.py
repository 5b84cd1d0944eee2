"""Text of the page on real logs; every figure in it is computed in the run that writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.against_truth import Velocities, errors, inside, rms, table
from benchmarks.blind_code import commit

if TYPE_CHECKING:
    from benchmarks.real_logs import LogSet

HIGH = 0.4
"""Slip ratio above which coverage is told apart."""

SNOW_RATIO, SNOW_INSIDE, SNOW_HIGH_INSIDE, SNOW_UNNAMED_INSIDE = 0.6, (0.88, 0.98), 0.80, 0.85
CAR_RMSE, CAR_INSIDE = 0.044, 0.88
"""Aims on snow: RMSE over that of the wheels, coverage. Car that brakes: RMSE [m/s], coverage."""

SOURCES = Path(__file__).parent / "robots" / "README.md"
"""Where the logs are, and what was written by hand for them."""


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
    """

    scenes: Mapping[str, tuple[Delay, Delay]]
    decay: float


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
        "rover on snow, 1_*, both standstills named": ones,
        "rover on snow, 2_*, both standstills named": [run for run in named if run not in ones],
        "rover on snow, none named": unnamed,
        "car brakes to a stop (0757)": braking,
        "car, stop and go (1100)": creeping,
        "car, seven scenes without a standstill": others,
        "rover Pathfinder, 50 s on rough ground": sets["pathfinder"].runs,
        "Husky, firm ground, GPS": sets["husky"].runs,
        "car at scale 1:10 that skids": sets["small car"].runs,
    }
    reached = [
        _aim("snow 1_*, both named: RMSE over that of the wheels", ratio(ones), 0.0, SNOW_RATIO),
        _aim("snow 1_*, both named: in 2σ", inside(ones), *SNOW_INSIDE),
        _aim("snow 1_*, both named: in 2σ above 40 % slip", inside(ones, HIGH), SNOW_HIGH_INSIDE, 1.0),
        _aim("snow, none named: RMSE over that of the wheels", ratio(unnamed), 0.0, 1.0),
        _aim("snow, none named: in 2σ", inside(unnamed), SNOW_UNNAMED_INSIDE, 1.0),
        _aim("car brakes to a stop: RMSE [m/s]", rms(errors(braking)), 0.0, CAR_RMSE),
        _aim("car brakes to a stop: in 2σ", inside(braking), CAR_INSIDE, 1.0),
    ]
    worse = sum(ratio(runs) > 1 for runs in groups.values())
    return f"""# Estimation on real logs

Logs of other robots, recorded by others; the references were never shown to the estimator.

## What was reached

{table(("aim", "reached", "asked"), reached)}
{table(HEAD, [summary(name, runs) for name, runs in groups.items()])}
RMSE of the velocity [m/s], of the estimate and of the wheels alone, against the reference; share of the
velocities within ±2σ. Bold: worse than the wheels, or less than 85 % inside. Car and Pathfinder are judged
where they move.

* **With both standstills known the IMU carries the velocity**, whatever the wheels do (snow).
* **Without them a steady slip cannot be told**: the estimate follows the wheels less an assumed slip of 3 %,
  and its std allows for 0 to 100 %. What is left outside is a rover that is stuck with spinning wheels.
* **The car's reference is no judge of a tenth of a second**: it is late, and seems to be made of its wheels.
* **The estimate is worse than the wheels** in {worse} of {len(groups)} rows.

## Rover on snow

A four-wheeled rover drives straight on snow and is drawn back until it is stuck: slip up to 100 %; IMU and
wheels at 10 Hz, against its inertial navigation, whose std of 0.03 m/s at rest is allowed for.

{_snow(sets["snow, named"], sets["snow"])}
![rover on snow, both standstills named: estimate with two std, wheels, reference](figures/real_snow.png)

## Car

A Renault Zoe of nuScenes, IMU and wheels at 100 Hz, against its fused velocity, while it moves.

{_by_run(scenes, {})}
{_delayed(late)}
![car in nine scenes: estimate with two std, wheels, reference](figures/real_car.png)

## Pathfinder, Husky and small car

{_others(sets)}
![Pathfinder, Husky, small car, Husky on snow and loam](figures/real_others.png)

## Without a reference, or without an IMU

{_boreal(sets["boreal"])}
*Robotino*, three wheels, no IMU, an overhead camera whose scale is not calibrated. Apparent slip:
{_slips(slides)}. The data set's own figures: brown 17.5 %, gray 22 to 24 %, green
39 to 45 %, table 13 %.

*Kobuki*, no IMU: counters that wrap are unwrapped exactly (`tests/logs/test_real_logs.py`).

## Where the logs are

{SOURCES.read_text(encoding="utf-8")}
Maps and robots written by hand are in `benchmarks/robots/`. Written by
`python -m benchmarks.real_logs --data FOLDER`, code {commit()}.
"""


HEAD = (
    "logs", "runs", "samples", "estimate", "wheels", "ratio", "in 2σ [%]", "above 40 % slip",
    "good / fair / poor",
)  # fmt: skip


def ratio(runs: Sequence[Velocities]) -> float:
    """RMSE of the estimate over that of the wheels."""
    return rms(errors(runs)) / rms(errors(runs, "wheels"))


def percent(share: float) -> str:
    """A share in percent, a dash for none."""
    return f"{100 * share:.0f}" if np.isfinite(share) else "–"


def summary(name: str, runs: Sequence[Velocities]) -> list[str]:
    """One row of the first table."""
    grades = [run.grade for run in runs]
    worse, share = ratio(runs), inside(runs)
    return [
        name, str(len(runs)), str(errors(runs).size), f"{rms(errors(runs)):.3f}",
        f"{rms(errors(runs, 'wheels')):.3f}", f"{worse:.2f}" if worse <= 1 else f"**{worse:.2f}**",
        percent(share) if share >= SNOW_UNNAMED_INSIDE else f"**{percent(share)}**",
        percent(inside(runs, HIGH)), " / ".join(str(grades.count(g)) for g in ("good", "fair", "poor")),
    ]  # fmt: skip


def _aim(what: str, value: float, low: float, high: float) -> list[str]:
    text = f"{value:.3f}"
    return [what, text if low <= value <= high else f"**{text}**", f"{low:g} to {high:g}"]


def _by_run(runs: Sequence[Velocities], more: Mapping[str, Sequence[str]]) -> str:
    rows = [
        [run.name, f"{rms(errors([run])):.3f}", f"{rms(errors([run], 'wheels')):.3f}", percent(inside([run])),
         f"{np.median(run.std):.3f}", run.grade, *cells]
        for run, *cells in zip(runs, *more.values(), strict=True)
    ]  # fmt: skip
    head = ("run", "estimate [m/s]", "wheels [m/s]", "in 2σ [%]", "std, median [m/s]", "grade", *more)
    return table(head, rows)


def _snow(named: LogSet, unnamed: LogSet) -> str:
    by_name = {run.name: run for run in named.runs}
    rows = []
    for run in unnamed.runs:
        cells = [
            run.name,
            *(f"{rms(errors([run], what)):.3f}" for what in ("wheels", "v")),
            percent(inside([run])),
        ]
        one = by_name.get(run.name)
        if one is not None:
            cells += [f"{rms(errors([one])):.3f}", percent(inside([one])), percent(inside([one], HIGH))]
        rows.append(cells + ["–"] * (7 - len(cells)))
    head = (
        "run", "wheels [m/s]", "none named [m/s]", "in 2σ [%]", "both named [m/s]", "in 2σ [%]",
        "above 40 % slip",
    )  # fmt: skip
    refused = {**named.refused, **unnamed.refused}
    said = "".join(f"\n* {name} was refused: {why}" for name, why in sorted(refused.items()))
    return table(head, rows) + (said + "\n" if said else "")


def _delayed(late: Delays) -> str:
    rows = []
    for name, (body, wheels) in late.scenes.items():
        found = (f"{body.by:.2f}", f"{wheels.by:.2f}", f"{body.rmse:.3f}", f"{wheels.rmse:.3f}")
        rows.append([name, *found, percent(body.inside)])
    head = (
        "run", "late against the estimate [s]", "against the wheels [s]", "estimate then [m/s]",
        "wheels then [m/s]", "in 2σ then [%]",
    )  # fmt: skip
    braking, (body, wheels) = late.scenes["0757"][0], late.scenes["1100"]
    return f"""The reference is late: the table says with which delays it agrees best with the estimate and
with the wheels, and how well it does so then. While the wheels stand it decays as a low-pass of
{late.decay:.3f} s does, and in scene 1100 it follows the delayed wheels to {wheels.rmse:.3f} m/s: it does
not judge them independently. The estimate is on the clock of the IMU, against which the wheels' stamps are
late as well: in scene 1100 the reference lies {body.by:.2f} s behind the estimate and {wheels.by:.2f} s
behind the wheels. In scene 0757 the RMSE with the delay taken out is {braking.rmse:.3f} m/s ({CAR_RMSE:g}
asked), and {percent(braking.inside)} % lie within ±2σ ({percent(CAR_INSIDE)} asked).

{table(head, rows)}"""


def _others(sets: Mapping[str, LogSet]) -> str:
    (rover,), (husky,) = sets["pathfinder"].runs, sets["husky"].runs
    (motion,), (driven,) = sets["pathfinder"].motions.values(), sets["husky"].motions.values()
    true_way = float(np.trapezoid(rover.truth, rover.t))
    offset = driven.clock_offset
    runs = [rover, husky, *sets["small car"].runs]
    return f"""{_by_run(runs, {})}
* *Pathfinder*: planetary test rover, IMU 250 Hz, wheels and differential GPS 10 Hz, a standstill at both
  ends. Distance {motion.distance.value:.1f} ± {motion.distance.std:.1f} m, by GPS {true_way:.1f} m. The
  shaken gyro loses the pitch: the level at the next standstill shows it, and its noise in motion grows. The
  GPS speed scatters by {rover.truth_std:.2f} m/s, which is allowed for.
* *Husky*: firm ground, {np.ptp(driven.t):.0f} s with one stop, IMU 30 Hz on its side. GPS speed is the slope
  of a line through five fixes and scatters by {husky.truth_std:.2f} m/s, which is most of the RMSE and is
  allowed for. Clocks: {offset.value:+.2f} ± {offset.std:.2f} s; by the yaw rates, that are unused, −0.38 s.
* *Small car*: motion capture, skids up to 4 m/s, one speed for four wheels, no pitch gyro, and no standstill,
  since rows below 0.5 m/s were cut. Quick changes of slip are measured, a steady slip is assumed.
"""


def _boreal(found: LogSet) -> str:
    rows = []
    for run in found.runs:
        motion = found.motions[run.name]
        rows.append([
            run.name, f"{np.ptp(run.t):.0f}", f"{motion.distance.value:.1f} ± {motion.distance.std:.1f}",
            f"{motion.distance_wheels.value:.1f}", f"{np.median(run.std):.3f}",
            f"{100 * np.mean(run.v - run.wheels > 2 * run.std):.1f}",
        ])  # fmt: skip
    head = (
        "log", "length [s]", "distance [m]", "by the wheels [m]", "std of v, median [m/s]",
        "faster than its wheels by > 2σ [% of time]",
    )  # fmt: skip
    return f"""*BorealTC*: a Husky on snow and sandy loam, IMU 100 Hz, wheels 6.5 Hz, no standstill, no
reference. A body seldom outruns its wheels; 2.3 % of the time would be chance.

{table(head, rows)}"""


def _slips(slides: Mapping[str, tuple[float, float]]) -> str:
    by_surface: dict[str, list[float]] = {}
    for name, (rolled, camera) in slides.items():
        by_surface.setdefault(name.split("_")[0], []).append(100 * (1 - camera / rolled))
    return ", ".join(f"{surface} {np.mean(slips):.1f} %" for surface, slips in by_surface.items())
