"""Wrong units and sensors that lie: each fault is put into a good trial and found there, by its column."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import granite_lab as gl
from granite_lab.errors import InputError
from granite_lab.logs import read_trial
from granite_lab.logs.trial import Trial
from granite_lab.parameters import CATALOGUE
from tests.logs import make
from tests.soak import in_turn, sampled

SAMPLE = Path(__file__).parents[2] / "data" / "samples" / "virtual_v0.5_r1.csv"
TEXT = SAMPLE.read_text(encoding="utf-8")
GOOD = pd.read_csv(SAMPLE, comment="#")
FORCE, RATE, ANGLES = make.IMU[:3], make.IMU[3:], make.WHEELS
DEG, G = 180 / np.pi, 9.80665
Change = Callable[[pd.DataFrame], pd.DataFrame | None]


@cache
def good(path: Path = SAMPLE) -> Trial:
    return read_trial(path)


def changed(folder: Path, change: Change) -> Trial:
    return read_trial(make.changed(folder, SAMPLE, change))


def constant(*names: str, at: float | None = None, between: tuple[float, float] = (0, 99)) -> Change:
    """Let every sample of some columns be the first of them, or a number, between two instants."""

    def change(table: pd.DataFrame) -> None:
        for name in names:
            rows = table[name].notna() & table["t_s"].between(*between)
            table.loc[rows, name] = table.loc[rows, name].iloc[0] if at is None else at

    return change


def exchanged(*pairs: tuple[str, str]) -> Change:
    def change(table: pd.DataFrame) -> None:
        for one, other in pairs:
            table[one], table[other] = table[other].copy(), table[one].copy()

    return change


def times(factor: float, *names: str) -> Change:
    def change(table: pd.DataFrame) -> None:
        table[list(names)] *= factor

    return change


WRONG = {
    # columns, factor on the values, suffix they get (None: the old one, which then lies), what is said
    "g as m/s^2": ("imu_a", 1 / G, None, r"declared in m/s\^2, reads .* it is in g"),
    "m/s^2 as g": ("imu_a", 1.0, "g", r"declared in g, reads .* it is in m/s\^2"),
    "mg as m/s^2": ("imu_a", 1000 / G, None, "it is in mg"),
    "g as mg": ("imu_a", 1 / G, "mg", "it is in g"),
    "deg/s as rad/s": ("imu_g", DEG, None, "declared in rad/s, is in deg/s"),
    "rad/s as deg/s": ("imu_g", 1.0, "dps", "declared in deg/s, is in rad/s"),
    "ms as s": ("t_", 1e3, None, "stamps are in ms"),
    "s as ms": ("t_", 1.0, "ms", "stamps are in s"),
    "ns as s": ("t_", 1e9, None, "stamps are in ns"),
    "deg as rad": ("enc", DEG, None, "declared in rad, .* they are in deg"),
    "rad as deg": ("enc", 1.0, "deg", "declared in deg, .* they are in rad"),
    "mA as A": ("cur", 1e3, None, "in mA"),
    "rev as rad": ("enc", 1 / (2 * np.pi), None, "declared in rad, .* they are in rev"),
}


RIGHT = [  # all axes and wheels change together: units are judged by their sum
    ("imu_a", 1 / G, "g"), ("imu_a", 1000 / G, "mg"), ("imu_g", DEG, "dps"), ("imu_g", DEG, "degps"),
    ("enc_", DEG, "deg"), ("enc_", 1 / (2 * np.pi), "rev"), ("t_", 1e3, "ms"), ("t_", 1e6, "us"),
    ("t_", 1e9, "ns"),
]  # fmt: skip


@pytest.mark.parametrize("how", sampled(RIGHT, 2), ids=str)
def test_the_suffix_gives_the_unit(how: tuple[str, float, str], tmp_path: Path) -> None:
    other = changed(tmp_path, lambda table: make.converted(table, *how))
    make.same(good(), other, rtol=1e-9, atol=1e-9)
    assert other.warnings == ()


@pytest.mark.parametrize(("name", "speed"), in_turn(WRONG, [0.2, 0.7, 0.3, 0.5]))
def test_a_wrong_unit_is_corrected_and_said(name: str, speed: float, tmp_path: Path) -> None:
    *how, said = WRONG[name]
    sample = SAMPLE.with_name(f"virtual_v{speed}_r2.csv")
    right = good(sample)
    assert right.warnings == ()
    wrong = read_trial(make.changed(tmp_path, sample, lambda table: make.converted(table, *how)))
    make.same(right, wrong, rtol=1e-3, atol=1e-3)
    assert any(re.search(said, line) for line in wrong.warnings), wrong.warnings
    assert all(doubt.grade == "good" for doubt in wrong.doubts)


@pytest.mark.parametrize("speed", sampled([0.2, 0.3, 0.5, 0.7]))
def test_an_angle_taken_for_a_rate_is_refused(speed: float, tmp_path: Path) -> None:
    path = SAMPLE.with_name(f"virtual_v{speed}_r1.csv")
    text = path.read_text(encoding="utf-8").replace("l_rad", "l_degps").replace("r_rad", "r_degps")
    with pytest.raises(InputError, match="follows the way by the IMU and not its speed"):
        make.read(tmp_path, text)


def without_gravity(table: pd.DataFrame) -> None:
    table[FORCE[2]] -= 9.81


def clipped(table: pd.DataFrame) -> None:
    table[FORCE[0]] = table[FORCE[0]].clip(-1.0, 1.5)


REPORTED: dict[str, tuple[Change, str]] = {
    "gravity that the logger takes out": (without_gravity, "has removed gravity"),
    "an axis at its limit": (clipped, "accelerometer x: saturated at"),
    "an axis that nothing needs": (constant(RATE[2], at=0.25), "gyroscope z: constant at 0.25"),
    "a wheel that stands": (constant(ANGLES[0], at=0.25), "encoder fl stands still"),
    "a wheel without encoder": (constant(ANGLES[3], at=np.nan), "'enc_rr_rad' is empty; that wheel"),
    "a wheel that is silent for a while": (
        constant(ANGLES[2], at=np.nan, between=(3.0, 4.5)), "'enc_rl_rad': no sample from t = 3.0",
    ),
    "an axis that is silent for a moment": (
        constant(RATE[1], at=np.nan, between=(3.0, 3.1)), "20 samples without 'imu_gy_radps' were left out",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REPORTED)
def test_what_does_not_matter_much_is_reported(name: str, tmp_path: Path) -> None:
    change, said = REPORTED[name]
    trial = changed(tmp_path, change)
    assert len([line for line in trial.warnings if re.search(said, line)]) == 1
    assert trial.imu.gravity_removed == (change is without_gravity)


def ticks(table: pd.DataFrame) -> None:
    """Sixteen times the wheels' angle in whole numbers: 8 m/s."""
    table[ANGLES] = np.rint(16 * table[ANGLES])


def test_where_turns_and_metres_fit_alike_the_estimate_is_never_good(tmp_path: Path) -> None:
    """A wheel of 0.165 m rolls 1.04 m a turn: metres read as rad are those of turns, 4 % off."""
    robot = tmp_path / "robot.toml"
    source = (CATALOGUE / "robots" / "granite.toml").read_text(encoding="utf-8")
    robot.write_text(source.replace("radius_m = 0.0965", "radius_m = 0.165"), encoding="utf-8")
    path = make.changed(tmp_path, SAMPLE, times(0.0965, *ANGLES))
    (only,) = gl.ingest(path, robot=robot)
    assert "they are in rev or in m" in " ".join(only.motion.warnings)
    assert only.motion.health.grade == "poor"


def test_wheels_in_a_unit_that_nobody_can_guess_are_never_good(tmp_path: Path) -> None:
    """The angle of the motors, 27 times that of the wheels, of a robot whose motors are not known."""
    robot = tmp_path / "robot.toml"
    source = (CATALOGUE / "robots" / "granite.toml").read_text(encoding="utf-8")
    robot.write_text(re.sub(r"(?s)\[drive\].*?(?=\n\[)", "", source), encoding="utf-8")
    (only,) = gl.ingest(make.changed(tmp_path, SAMPLE, times(27.0, *ANGLES)), robot=robot)
    assert "times the speed that the IMU gains" in only.motion.health.verdict
    assert only.motion.health.grade == "poor"


def velocity(table: pd.DataFrame) -> None:
    """The wheels' velocity [m/s] in the place of their angle."""
    rows = table[ANGLES[0]].notna()
    for name in ANGLES:
        table.loc[rows, name] = 0.0965 * np.gradient(table.loc[rows, name], table.loc[rows, "t_s"])


def empty(table: pd.DataFrame) -> None:
    table[FORCE + RATE] = np.nan


REFUSED = {
    "accelerometer constant": (constant(*FORCE), FORCE[0], "every sample is"),
    "forward axis constant": (constant(FORCE[0]), FORCE[0], "every sample is"),
    "gyroscope constant": (constant(*RATE), RATE[1], "every sample is"),
    "gyroscope hangs from some time on": (constant(*RATE, between=(4, 99)), RATE[1], "is the same"),
    "roll and pitch rate exchanged": (exchanged((RATE[0], RATE[1])), RATE[1], "rate about x fits"),
    "pitch and yaw rate exchanged": (exchanged((RATE[1], RATE[2])), RATE[1], "rate about z fits"),
    "x and z exchanged": (
        exchanged((FORCE[0], FORCE[2]), (RATE[0], RATE[2])), FORCE[0], r"gravity is on it.*imu_az_mps2",
    ),
    "z downwards": (times(-1, FORCE[2]), FORCE[2], "gravity is on it"),
    "pitch rate of the wrong sign": (times(-1, RATE[1]), RATE[1], "its sign or that of"),
    "forward axis of the wrong sign": (times(-1, FORCE[0]), FORCE[0], "is wrong"),
    "ticks taken for rad": (ticks, ANGLES[0], "motors|whole numbers"),
    "velocity taken for an angle": (velocity, ANGLES[0], "follows the speed by the IMU and not its way"),
    "every cell of the IMU empty": (empty, FORCE[0], "every cell is empty"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_column_that_cannot_be_what_it_is_called_is_refused(name: str, tmp_path: Path) -> None:
    change, column, said = REFUSED[name]
    with pytest.raises(InputError, match=said) as caught:
        changed(tmp_path, change)
    assert column in caught.value.message
    assert caught.value.hint


@pytest.mark.parametrize(
    ("columns", "left"),
    sampled([(FORCE, "accelerometer"), (RATE, "gyroscope"), (RATE[:2], "no pitch rate was logged")], 2),
    ids=sampled(["accelerometer", "gyroscope", "all but yaw"], 2),
)
def test_what_is_zero_throughout_is_not_measured(columns: list[str], left: str, tmp_path: Path) -> None:
    """As in messages of ROS; what remains is estimated, and said to be less."""
    found = gl.ingest(make.changed(tmp_path, SAMPLE, times(0, *columns)), jobs=1)[0]
    said = " ".join(found.motion.warnings)
    assert "every sample is 0; taken as not measured" in said
    assert all(name in said for name in columns)
    assert left in said
    assert np.isnan(found.motion.distance.value) == (columns == FORCE)


@pytest.mark.parametrize(
    "columns",
    sampled([FORCE[:1], [FORCE[0], RATE[1]], FORCE[1:], [FORCE[0], *ANGLES[1:]], [*RATE, *ANGLES[1:]]], 2),
    ids=" ".join,
)
def test_empty_columns_end_in_an_estimate_with_less_in_it(columns: list[str], tmp_path: Path) -> None:
    found = gl.ingest(make.changed(tmp_path, SAMPLE, constant(*columns, at=np.nan)), jobs=1)[0]
    assert np.isfinite(found.motion.distance.value) != (FORCE[0] in columns)
    said = any("the accelerometer is not used" in line for line in found.motion.warnings)
    assert said == (FORCE[0] in columns)


@pytest.mark.parametrize("to", [1e6, 0.0, -3.0])
def test_a_burst_of_bad_stamps_is_left_out_and_its_line_named(to: float, tmp_path: Path) -> None:
    middle = len(GOOD) // 2

    def change(table: pd.DataFrame) -> None:
        burst = slice(middle, middle + 40)
        table.loc[burst, "t_s"] = 0.0 if to == 0 else table.loc[burst, "t_s"] + to

    right, trial = good(), changed(tmp_path, change)
    keep = np.isin(right.imu.t, trial.imu.t)
    assert 0 < np.count_nonzero(~keep) < 41
    np.testing.assert_array_equal(trial.imu.specific_force, right.imu.specific_force[keep])
    line = TEXT[: TEXT.index("t_s,")].count("\n") + 2 + middle
    assert any(f"trial.csv:{line}: column 't_s'" in said for said in trial.warnings)


def test_a_wheel_off_the_ground_is_named_and_left_out(tmp_path: Path) -> None:
    trial = changed(tmp_path, times(1.5, ANGLES[0]))
    assert np.isnan(trial.wheels.angle[:, 0]).sum() > 100
    assert np.isfinite(trial.wheels.angle[:, 1:]).all()
    assert any(ANGLES[0] in line and "off the ground" in line for line in trial.warnings)


def test_a_wheel_whose_encoder_slips_on_its_shaft_is_named_and_left_out_there(tmp_path: Path) -> None:
    """It turns a third as fast as the others for half a second, which they do not."""
    seen = GOOD["t_s"][GOOD[ANGLES[2]].notna()].to_numpy()
    begin = float(np.median(seen))

    def change(table: pd.DataFrame) -> None:
        rows = table[ANGLES[2]].notna()
        angle, t = table.loc[rows, ANGLES[2]].to_numpy(), table.loc[rows, "t_s"].to_numpy()
        lost = np.interp(t, [begin, begin + 0.5], np.interp([begin, begin + 0.5], t, angle))
        table.loc[rows, ANGLES[2]] = angle - 2 / 3 * (lost - lost[0])

    trial = changed(tmp_path, change)
    blank = trial.wheels.t[np.isnan(trial.wheels.angle[:, 2])]
    assert begin - 0.15 < blank[0] < begin + 0.15
    assert begin + 0.35 < blank[-1] < begin + 0.65
    assert np.isfinite(trial.wheels.angle[:, [0, 1, 3]]).all()
    assert any(ANGLES[2] in line and "slipped on the shaft" in line for line in trial.warnings)


@pytest.mark.parametrize("filler", [0.0, -999.0, 99999.0])
def test_a_number_in_place_of_no_value_is_named(filler: float, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"all axes read {filler:g} again and again") as caught:
        changed(tmp_path, lambda table: table.fillna(filler))
    assert "leave cells empty" in caught.value.hint


@pytest.mark.parametrize("empty", ["-", "--"])
def test_a_dash_stands_for_no_value(empty: str, tmp_path: Path) -> None:
    trial = changed(tmp_path, lambda table: table.astype(object).fillna(empty))
    make.same(trial, good())
