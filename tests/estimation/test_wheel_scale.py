"""Wheels whose scale is not that of the robot's file: what a log shows of it, and what the std holds."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granite_lab.estimation import Motion, correct
from granite_lab.fitting import fit_k92
from granite_lab.logs import read_trial
from granite_lab.logs.sensors.counts import other_counts
from granite_lab.logs.trial import Trial, WheelStream
from granite_lab.parameters import load_robot, load_soil
from tests.logs import make
from tests.soak import sampled
from tests.truth import field

SAMPLE, SLIP = field.SAMPLES[3], 0.0970
ROBOT = load_robot("granite")
TURN = 2.0 * math.pi


@cache
def motion() -> tuple[Trial, Motion]:
    return correct(read_trial(SAMPLE), ROBOT)


@pytest.mark.parametrize("scale", sampled([0.85, 1.06]))
def test_angles_that_were_divided_by_another_number_of_counts_are_fair_and_within_their_std(
    scale: float, tmp_path: Path
) -> None:
    path = make.changed(tmp_path, SAMPLE, lambda table: make.converted(table, "enc_", scale).round(6))
    lines = [line for line in path.read_text().splitlines(True) if not line.startswith("# enc_step_rad")]
    path.write_text("".join(lines))
    seen = correct(read_trial(path), ROBOT)[1]
    assert seen.health.grade == "fair"
    steps = re.search(r"a turn over (\d+)", seen.health.verdict)
    assert steps
    assert float(steps[1]) == pytest.approx(106_000 / scale, rel=1e-3)
    assert "hard floor" in seen.health.verdict
    assert abs(seen.slip_ratio.value - SLIP) < 2.0 * seen.slip_ratio.std


@pytest.mark.parametrize("scale", sampled([2.0, 3.0, 0.25]))
def test_a_gear_ratio_that_is_wrong_by_a_whole_number_is_poor_and_within_its_std(
    scale: float, tmp_path: Path
) -> None:
    """Twice the angle looks like a slip of 55 %, a quarter like angles in turns."""
    path = make.changed(tmp_path, SAMPLE, lambda table: make.converted(table, "enc_", scale))
    seen = correct(read_trial(path), ROBOT)[1]
    assert seen.health.grade == "poor"
    assert "gear ratio" in seen.health.verdict
    assert abs(seen.slip_ratio.value - SLIP) < 2.0 * seen.slip_ratio.std
    assert abs(seen.distance.value - motion()[1].distance.value) < seen.distance.std


def counted(per_turn: float, digits: int = 6) -> Callable[[np.ndarray], np.ndarray]:
    """Angles [rad] in whole counts, written with so many decimals."""
    return lambda angle: np.round(np.floor(angle / TURN * per_turn) / per_turn * TURN, digits)


@pytest.mark.parametrize(
    ("logged", "scaled"),
    [
        (counted(106_000), False),
        (counted(98_500), True),
        (counted(512), False),
        (counted(16_384), False),
        (counted(50_000), False),
        (counted(1e9), False),
        (counted(1e9, 4), False),
        (counted(98_500, 5), True),
        (counted(98_500, 4), False),
    ],
    ids=["file's", "near it", "coarse", "14 bits", "half", "fine", "rounding", "near, 5 digits", "4 digits"],
)
def test_only_steps_near_those_of_the_file_contradict_it(
    logged: Callable[[np.ndarray], np.ndarray], scaled: bool
) -> None:
    """A drive at 3 rad/s that sets off with 4 rad/s²; its wheels differ by a thousandth."""
    t = np.arange(0.0, 5.0, 0.01)
    speed = 3.0 * np.clip((t - 1.0) / 0.75, 0.0, 1.0) * (1.0 + 0.02 * np.sin(9.0 * t))
    angle = np.cumsum(speed)[:, None] * 0.01 * (1.0 + 0.001 * np.arange(4))
    doubt = other_counts(WheelStream(t, logged(angle), None, (0.0,) * 4), 106_000)
    assert (doubt is not None) == scaled
    if doubt is not None:
        assert doubt.rolled_std == pytest.approx(math.sqrt(0.5) * (106_000 / 98_500 - 1.0), rel=0.01)


def test_a_stated_std_of_the_radius_is_in_the_slip_and_once_in_k92() -> None:
    share = 0.02
    radius = ROBOT.wheels.radius
    unsure = replace(ROBOT, wheels=replace(ROBOT.wheels, radius_std=share * radius))
    trial, exact = motion()
    wide = correct(read_trial(SAMPLE), unsure)[1]
    part = next(p for p in wide.slip_parts if p.name == "wheel radius")
    assert part.contribution == pytest.approx(share * (1.0 - exact.slip_ratio.value))
    assert wide.slip_ratio.std == pytest.approx(math.hypot(exact.slip_ratio.std, part.contribution))
    total = math.hypot(*(p.contribution for p in wide.slip_parts))
    assert total == pytest.approx(wide.slip_ratio.std, rel=1e-3)
    assert wide.distance == exact.distance
    fits = [fit_k92(m, trial, r, load_soil(), trajectory=False) for m, r in ((exact, ROBOT), (wide, unsure))]
    assert fits[1].std_measurement == pytest.approx(fits[0].std_measurement, rel=1e-6)
    assert "wheel radius" not in {p.name for p in fits[1].parts}
    one, other = (next(s for s in fit.shared if s.name == "wheel radius") for fit in fits)
    assert abs(other.up) > 3.0 * abs(one.up)
