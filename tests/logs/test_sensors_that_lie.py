"""Each fault of a sensor is found in a good trial into which it was put, and its column is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import granite_lab as gl
from granite_lab.errors import InputError
from granite_lab.logs import read_trial

SAMPLE = Path(__file__).parents[2] / "data" / "samples" / "virtual_v0.5_r1.csv"
TEXT = SAMPLE.read_text(encoding="utf-8")
HEAD = "".join(f"{line}\n" for line in TEXT.splitlines() if line.startswith("#"))
GOOD = pd.read_csv(SAMPLE, comment="#")
FORCE = [f"imu_a{axis}_mps2" for axis in "xyz"]
RATE = [f"imu_g{axis}_radps" for axis in "xyz"]
ANGLES = [f"enc_{wheel}_rad" for wheel in ("fl", "fr", "rl", "rr")]
CURRENTS = [f"cur_{wheel}_A" for wheel in ("fl", "fr", "rl", "rr")]


def written(folder: Path, change: Callable[[pd.DataFrame], None]) -> Path:
    table = GOOD.copy()
    change(table)
    path = folder / "trial.csv"
    path.write_text(HEAD + table.to_csv(index=False), encoding="utf-8")
    return path


def constant(*names: str) -> Callable[[pd.DataFrame], None]:
    def change(table: pd.DataFrame) -> None:
        for name in names:
            table.loc[table[name].notna(), name] = table[name].dropna().iloc[0]

    return change


def exchanged(*pairs: tuple[str, str]) -> Callable[[pd.DataFrame], None]:
    def change(table: pd.DataFrame) -> None:
        for one, other in pairs:
            table[one], table[other] = table[other].copy(), table[one].copy()

    return change


def times(factor: float, *names: str) -> Callable[[pd.DataFrame], None]:
    def change(table: pd.DataFrame) -> None:
        table[list(names)] *= factor

    return change


def hanging(table: pd.DataFrame) -> None:
    late = table[RATE[0]].notna() & (table.index > len(table) // 3)
    table.loc[late, RATE] = table.loc[late, RATE].iloc[0].to_numpy()


def ticks(table: pd.DataFrame) -> None:
    """Sixteen times the wheels' angle in whole numbers: 8 m/s."""
    table[ANGLES] = np.rint(16 * table[ANGLES])


def empty(table: pd.DataFrame) -> None:
    table[FORCE + RATE] = np.nan


REFUSED = {
    "accelerometer constant": (constant(*FORCE), FORCE[0], "every sample is"),
    "forward axis constant": (constant(FORCE[0]), FORCE[0], "every sample is"),
    "gyroscope constant": (constant(*RATE), RATE[1], "every sample is"),
    "gyroscope hangs from some time on": (hanging, RATE[1], "is the same"),
    "roll and pitch rate exchanged": (exchanged((RATE[0], RATE[1])), RATE[1], "rate about x fits"),
    "pitch and yaw rate exchanged": (exchanged((RATE[1], RATE[2])), RATE[1], "rate about z fits"),
    "x and z exchanged": (
        exchanged((FORCE[0], FORCE[2]), (RATE[0], RATE[2])), FORCE[0], r"gravity is on it.*imu_az_mps2",
    ),
    "z downwards": (times(-1, FORCE[2]), FORCE[2], "gravity is on it"),
    "pitch rate of the wrong sign": (times(-1, RATE[1]), RATE[1], "its sign or that of"),
    "forward axis of the wrong sign": (times(-1, FORCE[0]), FORCE[0], "is wrong"),
    "ticks taken for rad": (ticks, ANGLES[0], "motors|whole numbers"),
    "every cell of the IMU empty": (empty, FORCE[0], "every cell is empty"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_column_that_cannot_be_what_it_is_called_is_refused(name: str, tmp_path: Path) -> None:
    change, column, said = REFUSED[name]
    with pytest.raises(InputError, match=said) as caught:
        read_trial(written(tmp_path, change))
    assert column in caught.value.message
    assert caught.value.hint


def test_the_good_trial_is_read_without_a_doubt(tmp_path: Path) -> None:
    assert read_trial(written(tmp_path, lambda _: None)).warnings == ()


@pytest.mark.parametrize(
    ("columns", "left"),
    [(FORCE, "accelerometer"), (RATE, "gyroscope"), (RATE[:2], "no pitch rate was logged")],
    ids=["accelerometer", "gyroscope", "all but yaw"],
)
def test_what_is_zero_throughout_is_not_measured(columns: list[str], left: str, tmp_path: Path) -> None:
    """As in messages of ROS; what remains is estimated, and said to be less."""
    found = gl.ingest(written(tmp_path, times(0, *columns)), jobs=1)[0]
    said = " ".join(found.motion.warnings)
    assert "every sample is 0: taken as not measured" in said
    assert all(name in said for name in columns)
    assert left in said
    assert np.isnan(found.motion.distance.value) == (columns == FORCE)


def test_currents_in_milliamperes_are_converted_and_said(tmp_path: Path) -> None:
    good, trial = read_trial(SAMPLE), read_trial(written(tmp_path, times(1000, *CURRENTS)))
    np.testing.assert_allclose(trial.currents.current, good.currents.current, rtol=1e-9)
    assert any(CURRENTS[0] in line and "in mA" in line for line in trial.warnings)


def test_one_current_that_flows_against_the_others_is_named(tmp_path: Path) -> None:
    said = read_trial(written(tmp_path, times(-1, CURRENTS[2]))).warnings
    assert len(said) == 1
    assert CURRENTS[2] in said[0]
    assert "scale = -1" in said[0]


@pytest.mark.parametrize("to", [1e6, 0.0, -3.0])
def test_a_burst_of_bad_stamps_is_left_out_and_its_line_named(to: float, tmp_path: Path) -> None:
    middle = len(GOOD) // 2

    def change(table: pd.DataFrame) -> None:
        burst = slice(middle, middle + 40)
        table.loc[burst, "t_s"] = 0.0 if to == 0 else table.loc[burst, "t_s"] + to

    good, trial = read_trial(SAMPLE), read_trial(written(tmp_path, change))
    keep = np.isin(good.imu.t, trial.imu.t)
    assert 0 < np.count_nonzero(~keep) < 41
    np.testing.assert_array_equal(trial.imu.specific_force, good.imu.specific_force[keep])
    line = TEXT[: TEXT.index("t_s,")].count("\n") + 2 + middle
    assert any(f"trial.csv:{line}: column 't_s'" in said for said in trial.warnings)


def test_a_wheel_off_the_ground_is_named_and_left_out(tmp_path: Path) -> None:
    trial = read_trial(written(tmp_path, times(1.5, ANGLES[0])))
    assert np.isnan(trial.wheels.angle[:, 0]).sum() > 100
    assert np.isfinite(trial.wheels.angle[:, 1:]).all()
    assert any(ANGLES[0] in line and "off the ground" in line for line in trial.warnings)
