"""Logs of other encoders, or of fewer sensors, give the slip of the whole log within the std they state."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from granite_lab.estimation.motion import Motion
from granite_lab.estimation.nodes import pace_of
from granite_lab.estimation.wheels import rolling_of
from granite_lab.logs import read_trial
from granite_lab.logs.trial import WheelStream
from granite_lab.parameters import load_robot
from tests.logs import make
from tests.soak import SOAK
from tests.truth.motion import estimate

SAMPLE = Path(__file__).parents[2] / "data" / "samples" / "virtual_v0.5_r1.csv"
TURN = 2 * np.pi
Change = Callable[[pd.DataFrame], pd.DataFrame | None]


def motion_of(path: Path) -> Motion:
    trial = read_trial(path)
    return estimate(trial, load_robot("granite"))


@cache
def whole() -> Motion:
    return motion_of(SAMPLE)


def changed(folder: Path, change: Change, counts_per_rev: int = 0) -> Path:
    """Write the sample with its table changed; the resolution is no longer the one that its head states."""
    path = make.changed(folder, SAMPLE, change)
    head = f"# enc_counts_per_rev = {counts_per_rev}\n" if counts_per_rev else ""
    lines = [line for line in path.read_text().splitlines(True) if not line.startswith("# enc_step_rad")]
    path.write_text(head + "".join(lines))
    return path


def counter(per_rev: int, width: int, every: int) -> Change:
    """Log whole counts of a counter that starts again after `width`, each `every`th sample."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        logged = np.flatnonzero(table["enc_fl_rad"].notna())
        for name in make.WHEELS:
            raw = np.mod(np.floor(table[name] / TURN * per_rev) + 40, width)
            raw.iloc[np.setdiff1d(logged, logged[::every])] = np.nan
            table[name] = raw
        return table.rename(columns={name: name.replace("_rad", "_counts") for name in make.WHEELS})

    return change


def rates(wrong: Callable[[np.ndarray], None]) -> Change:
    """Log rates [rad/s], of which some are `wrong`, in place."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        logged = table["enc_fl_rad"].notna()
        t = table.loc[logged, "t_s"].to_numpy()
        values = np.gradient(table.loc[logged, make.WHEELS].to_numpy(), t, axis=0).round(4)
        wrong(values)
        table.loc[logged, make.WHEELS] = values
        return table.rename(columns={name: name.replace("_rad", "_radps") for name in make.WHEELS})

    return change


def without(*names: str) -> Change:
    return lambda table: table.drop(columns=[name for name in table if name.startswith(names)])


def dead(table: pd.DataFrame) -> None:
    table["enc_fr_rad"] *= 0


def sticking(table: pd.DataFrame) -> None:
    table["enc_fr_rad"] = table["enc_fr_rad"].clip(upper=12.0)


def reversed_sign(table: pd.DataFrame) -> None:
    table["enc_fr_rad"] *= -1


def wild(values: np.ndarray) -> None:
    values[500] = -64_678.0  # -6,241 m/s


def zeros(values: np.ndarray) -> None:
    values[np.random.default_rng(1).choice(np.arange(250, 700), 40, replace=False)] = 0.0


def silent(values: np.ndarray) -> None:
    values[450:, 2] = 0.0


CASES: dict[str, tuple[Change, int, str]] = {
    "absolute encoder at 20 Hz": (counter(4096, 4096, 5), 4096, "wrapped 4 times at 4096; unwrapped"),
    "8 bits": (counter(1000, 256, 1), 1000, "wrapped 16 times at 256; unwrapped"),
    "8 bits by two thirds": (counter(4096, 256, 5), 4096, "which the IMU confirms; log faster"),
    "a wild rate": (rates(wild), 0, "1 reading thrown off or 0 for a lost sample"),
    "zeros among rates": (rates(zeros), 0, "40 readings thrown off or 0 for a lost sample"),
    "a rate that dies": (rates(silent), 0, "encoder rl gives no counts for"),
    "rear axle": (without("enc_f"), 0, "no encoder fl, fr in the log"),
    "left side": (without("enc_fr", "enc_rr"), 0, "no encoder fr, rr in the log"),
    "one encoder": (without("enc_f", "enc_rr"), 0, "no encoder fl, fr, rr in the log"),
    "no gyro": (without("imu_g"), 0, "no gyroscope in the log"),
    "one axis each": (without("imu_ay", "imu_az", "imu_gx", "imu_gz"), 0, "accelerometer: no axis y, z"),
    "dead": (dead, 0, "encoder fr stands still while the others turn, as if not connected; left out"),
    "sticks": (sticking, 0, "encoder fr gives no counts for"),
    "reversed": (reversed_sign, 0, "encoder fr counts against the others"),
}


ALIKE = {
    "8 bits": "8 bits by two thirds",
    "a wild rate": "zeros among rates",
    "left side": "one encoder",
    "rear axle": "one encoder",
    "dead": "sticks",
    "a rate that dies": "sticks",
    "reversed": "test_faults.test_reversed_encoders_are_the_good_ones",
}
"""What another one, or another test, shows outside of `make soak`."""


@pytest.mark.parametrize("case", [case for case in CASES if SOAK or case not in ALIKE])
def test_other_encoders_give_the_slip_of_the_whole_log(case: str, tmp_path: Path) -> None:
    change, counts, words = CASES[case]
    motion, full = motion_of(changed(tmp_path, change, counts)), whole()
    assert any(words in line for line in motion.warnings), motion.warnings
    assert abs(motion.slip_ratio.value - full.slip_ratio.value) < 2 * motion.slip_ratio.std
    assert abs(motion.distance.value - full.distance.value) < 2 * motion.distance.std
    assert motion.distance_wheels.value == pytest.approx(full.distance_wheels.value, abs=0.01)
    # It knows at least half as well as the whole log does, but for what is lost.
    assert case == "no gyro" or motion.slip_ratio.std < 0.02


def test_where_no_encoder_is_there_is_no_slip_of_the_wheel(tmp_path: Path) -> None:
    motion = motion_of(changed(tmp_path, without("enc_f")))
    assert np.isnan(motion.slip[:, :2]).all()
    assert np.isfinite(motion.slip[:, 2:]).any(axis=0).all()
    steady = (motion.t > motion.steady[0]) & (motion.t < motion.steady[1])
    np.testing.assert_allclose(
        np.nanmean(motion.slip[steady, 2:], axis=0), np.nanmean(whole().slip[steady, 2:], axis=0), atol=0.004
    )


@pytest.mark.parametrize("axes", ["imu_a", ("imu_ax", "imu_ay")], ids=["no accelerometer", "z alone"])
def test_without_an_accelerometer_along_x_only_the_wheels_are_known(
    axes: str | tuple[str, ...], tmp_path: Path
) -> None:
    names = (axes,) if isinstance(axes, str) else axes
    motion = motion_of(changed(tmp_path, without(*names)))
    assert np.isnan(motion.slip_ratio.value)
    assert np.isnan(motion.v).all()
    assert motion.health.grade == "poor"
    assert "No accelerometer along the robot's x axis" in motion.health.verdict
    assert motion.distance_wheels.value == pytest.approx(2.5, abs=0.001)


@pytest.mark.parametrize("per_rev", [64, 100, 256, 4096])
def test_ramps_of_coarse_encoders_are_seen(per_rev: int) -> None:
    """Slip changes in ramps: where they are not seen, the body is taken to follow the wheels through them."""
    rest, ramp, top, radius = 2.0, 0.8, 0.4, load_robot("granite").wheels.radius
    corners = np.cumsum([0.0, rest, ramp, 4.0, ramp, rest])
    t = np.arange(0.0, corners[-1], 0.01)
    speed = np.interp(t, corners, [0.0, 0.0, top, top, 0.0, 0.0])
    angle = np.cumsum(speed) * 0.01 / radius
    phase = np.random.default_rng(per_rev).random(4)
    step = TURN / per_rev
    ticks = np.floor(angle[:, None] / step + phase) * step
    rolling = rolling_of(WheelStream(t, ticks, resolution=(step,) * 4), load_robot("granite"))
    pace = pace_of(rolling, 0.0, t)
    for begin, end in ((corners[1], corners[2]), (corners[3], corners[4])):
        assert not pace.steady[(t > begin) & (t < end)].any()
        # the slip ratio may change by as much as the speed does: by all of it
        assert pace.unrest[(t > begin) & (t < end)].mean() > 0.5 / ramp
    assert pace.steady[(t > corners[2] + 1.2) & (t < corners[3] - 1.2)].all()
