"""Faults of loggers and mounts that a log shows: put right within the std, or never called good."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from granite_lab.estimation import Motion, correct
from granite_lab.logs import read_trial
from granite_lab.logs.sensors.repeats import between_readings
from granite_lab.logs.sensors.stamps import evened, tidy
from granite_lab.logs.trial import Trial
from granite_lab.parameters import load_robot
from tests.logs import make
from tests.soak import sampled
from tests.truth import field

SAMPLE = field.SAMPLES[3]
EVERY_OTHER = field.SAMPLES[:6:2]
FORCE, ANGLES = field.FORCE, make.WHEELS
Change = Callable[[pd.DataFrame], pd.DataFrame | None]


def read(folder: Path, change: Change, sample: Path = SAMPLE) -> Trial:
    """Read a sample whose table was changed; the resolution is no longer the one that its head states."""
    path = make.changed(folder, sample, change)
    kept = [line for line in path.read_text().splitlines(True) if not line.startswith("# enc_step_rad")]
    path.write_text("".join(kept))
    return read_trial(path)


def motion_of(trial: Trial) -> Motion:
    return correct(trial, load_robot("granite"))[1]


def errors(motion: Motion, sample: Path = SAMPLE) -> tuple[float, float]:
    """Errors of slip ratio and distance against the sample's truth, in std."""
    truth = field.of_sample(sample)
    slip, distance = motion.slip_ratio, motion.distance
    return (slip.value - truth.slip) / slip.std, (distance.value - truth.distance) / distance.std


@pytest.mark.parametrize("degrees", sampled([-20.0, 10.0]))
def test_an_imu_that_is_turned_about_the_vertical_is_turned_back(degrees: float, tmp_path: Path) -> None:
    x, y = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))

    def turn(table: pd.DataFrame) -> None:
        for names in (field.FORCE, field.TURN):
            forward, left = table[names[0]].copy(), table[names[1]].copy()
            table[names[0]], table[names[1]] = x * forward + y * left, x * left - y * forward

    motion = motion_of(read(tmp_path, turn))
    assert max(map(abs, errors(motion))) < 3.0
    assert motion.health.grade == "fair"
    assert f"turned by {-degrees:.0f} ±" in motion.health.verdict


@pytest.mark.parametrize("shares", sampled([(0.93, 1.0, 0.93, 1.0), (1.0, 1.0, 1.06, 1.06)]), ids=str)
def test_wheels_that_roll_unlike_each_other_on_a_straight_way_widen_the_std(
    shares: tuple[float, ...], tmp_path: Path
) -> None:
    def scale(table: pd.DataFrame) -> None:
        table[ANGLES] = table[ANGLES] * np.array(shares)

    motion = motion_of(read(tmp_path, scale))
    assert max(map(abs, errors(motion))) < 3.0
    assert motion.health.grade == "fair"
    assert "unlike each other" in motion.health.verdict


def filled(rate: float) -> Change:
    """Write the encoders at `rate` [Hz], each reading in all rows of the IMU until the next one."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        t = table["t_s"].to_numpy()
        logged, imu = table["enc_fl_rad"].notna().to_numpy(), table[FORCE[0]].notna().to_numpy()
        instants = np.arange(t[logged][0], t[logged][-1], 1.0 / rate)
        last = np.maximum(np.searchsorted(instants, t[imu], side="right") - 1, 0)
        rows = table[imu].copy()
        for name in ANGLES:
            rows[name] = np.interp(instants, t[logged], table[name].to_numpy()[logged])[last]
        return rows

    return change


@pytest.mark.parametrize("rate", sampled([84.0, 20.0, 170.0], 3))
def test_readings_that_a_table_repeats_until_the_next_are_no_lost_counts(rate: float, tmp_path: Path) -> None:
    trial = read(tmp_path, filled(rate))
    assert trial.wheels is not None
    turned = np.nanmax(trial.wheels.angle, axis=0)
    np.testing.assert_allclose(turned, pd.read_csv(SAMPLE, comment="#")[ANGLES].max(), rtol=0.002)
    motion = motion_of(trial)
    assert max(map(abs, errors(motion))) < 3.0
    assert motion.health.grade == "good"


def test_neither_lost_counts_nor_coarse_ones_are_repeated_readings() -> None:
    t, rng = np.arange(1000) / 100.0, np.random.default_rng(4)
    counts = np.cumsum(np.where(rng.random(t.size) < 0.05, 0.0, 40.0))
    assert not between_readings(t, counts, 1.0).any()
    assert not between_readings(t, np.floor(23.0 * t), 1.0).any()  # a count every four rows
    held = np.floor(4000.0 * np.floor(84.0 * t) / 84.0)
    assert between_readings(t, held, 1.0)[50:].mean() == pytest.approx(0.16, abs=0.02)


def rate_of(table: pd.DataFrame, name: str) -> np.ndarray:
    """Rate of a wheel [rad/s] in the rows that have its angle."""
    rows = table[name].notna()
    return np.gradient(table.loc[rows, name].to_numpy(), table.loc[rows, "t_s"].to_numpy())


def as_rates(make_rate: Callable[[np.ndarray], np.ndarray], unit: str) -> Change:
    """Write rates in place of angles, as `make_rate` makes them of true ones [rad/s]."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        for name in ANGLES:
            table.loc[table[name].notna(), name] = make_rate(rate_of(table, name))
        return table.rename(columns={name: name.replace("rad", unit) for name in ANGLES})

    return change


@pytest.mark.parametrize("sample", sampled(EVERY_OTHER, 3), ids=lambda path: path.stem)
def test_rates_below_a_dead_band_are_no_sure_standstill(sample: Path, tmp_path: Path) -> None:
    dead = as_rates(lambda rate: np.where(np.abs(rate) < 0.8, 0.0, rate), "radps")
    assert max(map(abs, errors(motion_of(read(tmp_path, dead, sample)), sample))) < 3.0


@pytest.mark.parametrize("sample", sampled(EVERY_OTHER, 3), ids=lambda path: path.stem)
def test_rates_that_are_rounded_alike_share_the_error(sample: Path, tmp_path: Path) -> None:
    coarse = as_rates(lambda rate: np.round(rate * make.RADIUS, 1), "mps")
    motion = motion_of(read(tmp_path, coarse, sample))
    assert max(map(abs, errors(motion, sample))) < 3.0
    assert motion.slip_ratio.std > 0.05  # a step of 0.1 m/s is a third to a half of the speed
    assert motion.health.grade == "fair"


@pytest.mark.parametrize("sample", sampled(EVERY_OTHER, 3), ids=lambda path: path.stem)
def test_rates_that_were_cut_off_to_whole_numbers_are_never_good(sample: Path, tmp_path: Path) -> None:
    motion = motion_of(read(tmp_path, as_rates(lambda rate: np.trunc(rate * 30.0 / np.pi), "rpm"), sample))
    assert max(map(abs, errors(motion, sample))) < 3.0
    assert motion.health.grade == "fair"
    assert "cut off" in motion.health.verdict


def test_a_dead_band_of_the_accelerometer_is_never_good(tmp_path: Path) -> None:
    def mute(table: pd.DataFrame) -> None:
        rest = table.loc[table["t_s"] < table["t_s"].iloc[0] + 0.5, FORCE].mean()
        off = table[FORCE] - rest
        table[FORCE] = off.where(off.abs() >= 0.1, 0.0).where(off.notna())
        table[FORCE[2]] += 9.81

    motion = motion_of(read(tmp_path, mute))
    assert motion.health.grade == "poor"
    assert "dead band" in motion.health.verdict


def test_stamps_in_ticks_longer_than_the_period_keep_every_sample_and_are_spaced_evenly() -> None:
    true, doubts = np.arange(2000) / 126.0, list[Any]()
    values = np.random.default_rng(2).normal(size=(true.size, 1))
    found = tidy(np.floor(true * 100.0) / 100.0, values, "IMU", str, doubts)
    assert found.t.size == true.size
    error = found.t - true
    assert float(np.std(error)) < 1e-3


def test_steps_by_whole_ticks_count_as_scatter() -> None:
    true = np.arange(2000) * 0.0079
    ticks = np.round(true, 2) + np.arange(2000) % 2 * 1e-4
    even, scatter = evened(ticks)
    assert 0.002 < scatter < 0.005
    assert float(np.std(even - true)) < 0.5 * float(np.std(ticks - true))
