"""Text of the page on real logs; every figure in it was computed in the run that writes it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.real_logs_data import BLOCK, DIVISIONS, gps_noise, over

if TYPE_CHECKING:
    from benchmarks.real_logs_data import Comparison, Figures, Sliding
    from granite_lab.api.logs import Ingested

SURFACES = (("table", "13"), ("brown", "17.5"), ("gray", "22–24"), ("green", "39–45"))
"""Surfaces, and the apparent slip that the data set's authors measured there [%]."""

HEAD = """# Estimation on real logs

Written by `python -m benchmarks.real_logs --data FOLDER`. The logs were recorded by others, on other
robots, and are not part of this project; `FOLDER` holds a folder for each set. None of them is a trial
as this project wants it, with a standstill before and after on soft ground: they test the reading, the
clocks, and the part of the estimator that works far from standstills. The references were never shown to it.

What to expect: without a standstill nearby an IMU cannot tell a *steady* slip. The estimate then
follows the wheels, less an assumed slip of 3 ± 15 %, and only *quick* changes of slip are measured.
"""


def row(*cells: str) -> str:
    """One line of a table."""
    return "| " + " | ".join(cells) + " |"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join([row(*head), row(*["---"] * len(head)), *(row(*cells) for cells in rows)]) + "\n"


def metres(value: float) -> str:
    """A velocity error with its sign."""
    return f"{value:+.3f}"


def page(
    gps: Comparison,
    lag: float,
    cars: Sequence[Comparison],
    snow: Sequence[tuple[str, Ingested]],
    kobuki: Ingested,
    slides: Sequence[Sliding],
) -> str:
    """Return the whole page."""
    return "\n".join([HEAD, _husky(gps, lag), _cars(cars), _boreal(snow), _robotino(slides), _kobuki(kobuki)])


def _pair(name: str, estimate: Figures, wheels: Figures) -> list[str]:
    return [
        name, str(estimate.samples), f"{estimate.rmse:.3f}", metres(estimate.bias), f"{wheels.rmse:.3f}",
        metres(wheels.bias), f"{wheels.rmse / estimate.rmse:.2f}",
    ]  # fmt: skip


ERRORS = (
    "samples", "estimate: RMSE [m/s]", "bias [m/s]", "wheels: RMSE [m/s]", "bias [m/s]", "wheels / estimate",
)  # fmt: skip


def _husky(gps: Comparison, lag: float) -> str:
    noise, motion = gps_noise(gps.item), gps.item.motion
    offset, distance = motion.clock_offset, motion.distance
    slipped = 100 * float(np.sum(gps.wheels - gps.reference) / np.sum(gps.wheels))
    rest = (gps.t > 240.0) & (gps.t < 246.0)
    rows = [
        _pair("each fix", gps.estimate, gps.by_wheels),
        _pair(f"mean over {BLOCK:g} s", *over(gps)),
        _pair("in the stop (240–246 s)", *gps.where(rest)),
    ]
    both, alone = (100 * gps.coverage(std) for std in (gps.spread, gps.std))
    return f"""## `husky_gps`: against GPS

A Husky on firm ground for {np.ptp(motion.t):.0f} s, one stop of ten seconds; IMU 30 Hz and mounted on its
side, odometry 10 Hz, GPS 2.5 Hz. GPS speed is the slope of a line through five fixes (1.6 s); estimate
and wheels were smoothed in the same way. Errors: estimate, or wheels, minus GPS.

{table(("compared", *ERRORS), rows)}
* **GPS itself scatters by {noise:.2f} m/s** (how it differs from the wheels from one window to the next),
  which is most of the RMSE of each fix, for the estimate and for the wheels: single fixes hardly tell
  them apart.
* **2σ coverage**: {both:.0f} % with that noise beside the std of the estimate, NEES
  {gps.nees:.2f} (1 is ideal); {alone:.0f} % with the std of the estimate alone, which is
  {np.median(gps.std):.3f} m/s in the median.
* **The bias** of {metres(gps.estimate.bias)} m/s is mostly the assumed slip: by GPS these wheels slipped by
  {slipped:.1f} % only. The estimate is therefore {_against_wheels(gps)}: on firm ground far from
  standstills an IMU of this kind (30 Hz, on a shaking frame) adds nothing to them. Who knows that the
  wheels do not slip says so: `estimate(…, slip_std=0.02)`.
* **Clocks**: found {offset.value:+.2f} ± {offset.std:.2f} s for the encoders. The yaw rates of
  odometry and gyro, which the estimator does not compare, agree best at {lag:+.2f} s.
* **Distance**: estimate {distance.value:.0f} ± {distance.std:.0f} m,
  wheels {motion.distance_wheels.value:.0f} m.

![velocity of the Husky: estimate with two std, wheels, GPS](figures/husky_gps.png)
"""


def _against_wheels(run: Comparison) -> str:
    return "better than the wheels" if run.improvement > 1 else "**no better than the wheels** here"


WIDE = """The std is too wide (NEES far below 1): it allows for a steady slip of 15 %, as on sand, which this
floor does not have."""


def _cars(cars: Sequence[Comparison]) -> str:
    slips = {car.name: np.abs(car.true_slip) for car in cars}
    rows = [
        [
            *_pair(car.name, car.estimate, car.by_wheels),
            f"{100 * float(np.mean(slips[car.name] > 0.2)):.0f}",
            f"{100 * car.coverage(car.std):.0f}", f"{car.nees:.2f}", f"{car.cost:.0f}",
        ]
        for car in cars
    ]  # fmt: skip
    divided = []
    for low, high in DIVISIONS:
        pairs = [car.where((slips[car.name] >= low) & (slips[car.name] < high)) for car in cars]
        name = f"{100 * low:.0f} to {100 * high:.0f} %" if high < 1 else f"above {100 * low:.0f} %"
        divided.append([name, *(f"{e.rmse:.3f} / {w.rmse:.3f} ({e.samples})" for e, w in pairs)])
    said = "\n".join(f"* *{car.name}*: {_what_it_lacks(car)}" for car in cars)
    twice = [car.name for car in cars if car.improvement >= 2]
    fastest = max(float(car.reference.max()) for car in cars)
    wide = max(car.nees for car in cars) < 0.5
    return f"""## `f1tenth_optitrack`: against motion capture

A car at scale 1:10 with four driven wheels and one motor that drifts and skids at up to {fastest:.1f} m/s;
100 Hz. Errors: estimate, or wheels, minus motion capture.

{table(("run", *ERRORS, "slip > 20 % [% of samples]", "2σ coverage [%]", "NEES", "processor time [s]"), rows)}
At least twice as good as the wheels alone: {", ".join(twice) or "none"} ({len(twice)} of {len(cars)}).
{WIDE if wide else ""}

RMSE of estimate / wheels [m/s], by how much the wheels truly slipped (number of samples):

{table(("slip ratio", *(car.name for car in cars)), divided)}
What the sensors do not allow:

{said}
* *All*: no pitch gyro, so that gravity's share (0.17 m/s² a degree) of a pitching body cannot be told
  from thrust; one motor speed for four wheels; no standstill in any run, because rows below 0.5 m/s were
  cut, so that a steady slip cannot be told from none: where the wheels slip by less than 5 % they are the
  better speed, and the estimate pays for its doubt. Sideways velocity only through the yaw rate.

![velocity of the car where it slips most: estimate with two std, wheels, motion capture](figures/f1tenth.png)
"""


def _what_it_lacks(car: Comparison) -> str:
    motion = car.item.motion
    seconds = float(np.ptp(car.t))
    steady = float(np.mean(car.v - car.reference))
    quick = float(np.std(car.v - car.reference))
    n = len(motion.health.plateaus)
    limit = f"the IMU at its limit {'once' if n == 1 else f'{n} times'}, " if n else ""
    wander = next((p.strip() for p in motion.health.verdict.split(";") if "wander" in p), "")
    return (
        f"{seconds:.0f} s, {limit}bias {metres(steady)} m/s (steady slip, assumed), "
        f"{quick:.3f} m/s about it{f'; the health check says: {wander}' if wander else ''}."
    )


def _boreal(snow: Sequence[tuple[str, Ingested]]) -> str:
    rows = [
        [
            name,
            f"{np.ptp(item.motion.t):.0f}",
            f"{item.motion.distance.value:.1f} ± {item.motion.distance.std:.1f}",
            f"{item.motion.distance_wheels.value:.1f}",
            f"{np.median(item.motion.v_std):.3f}",
            f"{100 * _too_fast(item):.1f}",
            _offset(item),
            f"{item.motion.health.nis['wheel']:.2f}",
        ]
        for name, item in snow
    ]
    head = (
        "log", "length [s]", "distance [m]", "by the wheels [m]", "std of v, median [m/s]",
        "faster than its wheels by > 2 std [% of time]", "clock offset [s]", "NIS of the wheels",
    )  # fmt: skip
    return f"""## `borealtc_husky`: sandy loam and snow, without a reference

IMU 100 Hz, wheel speeds 6.5 Hz, two files a log, no standstill at either end: zero-velocity updates are
impossible, and each estimate says so. There is no reference. The wheels turn at a constant, commanded
speed; what the estimate shows beside are the frame's rocking and what the gyro makes of it. A body seldom
outruns its wheels; where the estimate says so by more than two std, that std is too small: 2.3 % of the time
would be chance (NIS of the wheels: 1 is ideal).

{table(head, rows)}
![velocity of the Husky on snow and sandy loam: estimate with two std, wheels](figures/borealtc.png)
"""


def _too_fast(item: Ingested) -> float:
    """Share of the stamps at which the body is faster than its wheels by more than two std."""
    wheels = np.nan_to_num(item.motion.v_wheel, nan=np.inf).max(axis=1)
    return float(np.mean(item.motion.v - wheels > 2 * item.motion.v_std))


def _offset(item: Ingested) -> str:
    offset = item.motion.clock_offset
    return f"{offset.value:+.2f} ± {offset.std:.2f}" if np.isfinite(offset.std) else "unobservable"


def _robotino(slides: Sequence[Sliding]) -> str:
    expected = dict(SURFACES)
    rows = [
        [s.name, f"{s.rolled:.3f}", f"{s.camera:.3f}", f"{100 * s.slip:.1f}", expected[s.name.split("_")[0]]]
        for s in slides
    ]
    head = (
        "run", "wheels [m]", "camera [m]", "apparent slip [%]", "the data set's own figure [%]",
    )  # fmt: skip
    return f"""## `robotino_slip`: wheels against an overhead camera

Three wheels, no IMU: no body velocity can be estimated, and none is. What is tested is the reading of
ticks, gear and camera. From 1.5 s on, when the robot has sped up; the camera's scale is not calibrated.

{table(head, rows)}"""


def _kobuki(item: Ingested) -> str:
    wraps = [line.split(": ", 1)[1] for line in item.trial.warnings if "wrapped" in line]
    motion = item.motion
    return f"""## `kobuki`: counters that wrap

No IMU and no reference; {np.ptp(motion.t):.0f} s, {motion.distance_wheels.value:.3f} m rolled.
What the reader says:

{chr(10).join(f"* {line}" for line in wraps)}

The unwrapped counts equal those of 16-bit arithmetic exactly (`tests/logs/test_real_logs.py`).
"""
