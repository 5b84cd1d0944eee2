"""Six minutes of log, a tenth of the longest that is promised: what it costs and how good it is.

`benchmarks/long_log.py` measures the whole hour, with memory: `docs/bench-long-log.md`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from granite_lab.estimation import estimate
from granite_lab.estimation.motion import Motion
from granite_lab.estimation.nodes import MOST, choose
from granite_lab.estimation.nominal import Nominal
from granite_lab.files import write_table
from granite_lab.logs import read_trial
from granite_lab.parameters import load_robot
from tests.truth.long_drives import Drive
from tests.truth.long_logs import long_drive, write_log

T = TypeVar("T")

DURATION = 360.0

HOUR = 60.0 / 3600.0
"""Processor time promised for a second of an hour's log [s]."""


@dataclass(frozen=True, eq=False)
class Ingested:
    log: Drive
    motion: Motion
    reading: float
    estimating: float
    writing: float


def clocked(run: Callable[[], T]) -> tuple[T, float]:
    begin = time.process_time()
    result = run()
    return result, time.process_time() - begin


@pytest.fixture(scope="module")
def six_minutes(tmp_path_factory: pytest.TempPathFactory) -> Ingested:
    folder: Path = tmp_path_factory.mktemp("long")
    log = long_drive("trials", DURATION)
    write_log(folder / "log.csv", log)
    trial, reading = clocked(lambda: read_trial(folder / "log.csv"))
    robot = load_robot("granite")
    motion, estimating = clocked(lambda: estimate(trial, robot))
    _, writing = clocked(lambda: write_table(folder / "motion.csv", motion.to_frame()))
    return Ingested(log, motion, reading, estimating, writing)


def test_reading_and_writing_leave_the_time_to_the_estimate(six_minutes: Ingested) -> None:
    assert (six_minutes.reading + six_minutes.writing) / DURATION < 0.4 * HOUR


def test_the_estimate_costs_little_for_a_second_of_log(six_minutes: Ingested) -> None:
    # up to five minutes of motion every sample is a node; beyond, their number stays the same
    assert six_minutes.estimating / DURATION < 2.5 * HOUR


def test_an_hour_has_no_more_nodes_than_six_minutes() -> None:
    t = np.arange(0.0, 3600.0, 0.005)
    for rest in (t < 3.0, t % 30.0 < 3.0):
        nominal = Nominal(t, rest, *(np.zeros(t.size) for _ in range(4)), 0.0, 0.0, np.zeros(t.size), 0.0)
        index = choose(nominal, float(t[1] - t[0]), 0.0)
        assert (~rest[index]).sum() <= MOST + 2 * np.count_nonzero(np.diff(rest.astype(int)))
        # at rest one in 50 ms
        assert rest[index].sum() <= 1.1 * rest.sum() / 10 + 300
        # and nowhere more than 60 ms apart
        assert np.max(np.diff(t[index])) < 0.0651


def test_velocity_and_distance_are_inside_their_std(six_minutes: Ingested) -> None:
    motion, log = six_minutes.motion, six_minutes.log
    moving = log.at(motion.t, "wheel") > 0
    error = (motion.v - log.at(motion.t, "v"))[moving]
    assert np.sqrt(np.mean(error**2)) < 0.010
    assert np.mean(np.abs(error) < 2 * motion.v_std[moving]) > 0.92
    travelled = np.trapezoid(log.v, log.t)
    assert abs(motion.distance.value - travelled) < 2 * motion.distance.std < 0.02 * travelled


def test_every_stamp_of_the_imu_has_its_velocity_and_every_stop_is_found(six_minutes: Ingested) -> None:
    motion, log = six_minutes.motion, six_minutes.log
    np.testing.assert_allclose(motion.t, log.trial.imu.t, atol=1e-6)
    assert np.isfinite(motion.v).all()
    assert len(motion.health.rests) == DURATION / 30.0 + 1
