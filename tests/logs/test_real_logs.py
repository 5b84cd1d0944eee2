"""Real logs of other robots, read with a robot file and a column map only.

Expected figures are worked out here from the raw files with the csv module, or stated in the data
sets' own notes.
"""

import csv
from pathlib import Path

import numpy as np
import pytest

from granite_lab.errors import InputError
from granite_lab.logs import Excerpt, inspect_logs, read_trial
from granite_lab.parameters import load_robot
from tests.logs import make
from tests.real_logs import DATA, MARKS

pytestmark = MARKS


def raw(path: Path, name: str, delimiter: str = ",", header: int = 0) -> np.ndarray:
    """Read one column with nothing but the csv module."""
    with path.open(newline="") as file:
        rows = list(csv.reader(file, delimiter=delimiter))
    place = rows[header].index(name)
    return np.array([float(row[place]) for row in rows[header + 1 :] if row])


def test_kobuki_counts_are_unwrapped_exactly() -> None:
    path = DATA / "kobuki" / "kobuki_core_uint16_wrap.csv"
    trial = read_trial(path)
    assert trial.info.robot == "kobuki"
    assert trial.imu is None
    counts = load_robot("kobuki").encoders.counts
    for wheels, name in (((0, 2), "field.left_encoder"), ((1, 3), "field.right_encoder")):
        logged = raw(path, name).astype(int)
        # Steps of a 16-bit counter, in the arithmetic of 16-bit signed numbers.
        steps = np.diff(logged).astype(np.int16).astype(int)
        true = np.concatenate(([0], np.cumsum(steps)))
        for wheel in wheels:
            angle = trial.wheels.angle[:, wheel]
            got = (angle - angle[0]) * counts / (2 * np.pi)
            np.testing.assert_allclose(got, true, atol=1e-6)
    said = " ".join(trial.warnings)
    assert "left_encoder': the counter wrapped 2 times at 65536" in said
    assert "right_encoder': the counter wrapped 1 times at 65536" in said


def test_kobuki_stamps_are_the_drivers_not_those_of_receipt() -> None:
    path = DATA / "kobuki" / "kobuki_core_uint16_wrap.csv"
    wheels = read_trial(path).wheels
    np.testing.assert_allclose(wheels.t, raw(path, "field.header.stamp") * 1e-9, rtol=0, atol=1e-6)
    # The device's own 16-bit millisecond clock runs beside them, but for its rate: no bursts.
    device = np.cumsum(np.diff(raw(path, "field.time_stamp")) % 65536) / 1000
    slope, offset = np.polyfit(device, wheels.t[1:] - wheels.t[0], 1)
    assert slope == pytest.approx(1, abs=2e-3)
    assert np.std(wheels.t[1:] - wheels.t[0] - slope * device - offset) < 2e-3


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("table_exp18", 12.5, 14.0), ("brown_exp18", 16.5, 18.0), ("gray_18", 22, 24), ("gray_90", 22, 24),
        ("gray_162", 22, 24), ("green_18", 39, 45), ("green_90", 39, 45), ("green_162", 39, 45),
    ],
)  # fmt: skip
def test_robotino_slips_as_its_camera_says(name: str, low: float, high: float) -> None:
    path = DATA / "robotino_slip" / f"{name}.csv"
    trial = read_trial(path)
    assert trial.imu is None
    # The camera's way against the raw file, whose third header row has the short names.
    steps = raw(path, "dy", ";", 2)
    np.testing.assert_allclose(trial.reference_x.value, np.cumsum(steps) / 1000, atol=1e-12)
    np.testing.assert_allclose(trial.wheels.rate[:, 0], -raw(path, "m2vel", ";", 2) / 16, atol=1e-12)
    # The steady part: the robot has sped up, and the camera sees it to the end.
    steady = trial.wheels.t > 1.5
    t = trial.wheels.t[steady]
    way = np.ptp(trial.reference_x.value[steady])
    wheels = np.ptp(trial.wheels.angle[steady, 0]) * 0.040
    assert low <= 100 * (1 - way / wheels) <= high
    assert trial.reference_v.value[steady].mean() == pytest.approx(way / np.ptp(t), rel=0.02)
    assert trial.command.value[0] in (0.1, 0.2, 0.3)


@pytest.mark.parametrize("name", ["SANDY_LOAM_{}_01", "SANDY_LOAM_{}_06", "SNOW_{}_01"])
def test_boreal_husky_in_two_files(name: str) -> None:
    folder = DATA / "borealtc_husky"
    imu, pro = folder / (name.format("imu") + ".csv"), folder / (name.format("pro") + ".csv")
    trial = read_trial(imu, {"encoders": pro})
    assert trial.info.robot == "husky"
    assert trial.warnings == ()
    np.testing.assert_array_equal(trial.imu.specific_force[:, 1], raw(imu, "ay"))
    np.testing.assert_array_equal(trial.imu.angular_rate[:, 2], raw(imu, "wz"))
    np.testing.assert_array_equal(trial.currents.current[:, 3], raw(pro, "curR"))
    np.testing.assert_allclose(trial.wheels.rate[:, 2], raw(pro, "velL") / 0.165, rtol=1e-12)
    assert np.median(np.diff(trial.imu.t)) == pytest.approx(0.01)
    assert np.median(np.diff(trial.wheels.t)) == pytest.approx(1 / 6.5)
    report = inspect_logs([pro]).files[0]
    assert report.rests == ()


def test_husky_with_gps_is_a_folder_with_a_file_a_sensor() -> None:
    folder = DATA / "husky_gps"
    trial = read_trial(folder)
    apart = {"encoders": folder / "odom.csv", "reference": folder / "fix.csv"}
    make.same(trial, read_trial(folder / "imu.csv", apart))
    assert (trial.name, trial.info.robot) == ("husky_gps", "husky_gps")
    rates = [1 / np.median(np.diff(s.t)) for s in (trial.imu, trial.wheels, trial.reference_v)]
    np.testing.assert_allclose(rates, [30, 10, 2.5], rtol=0.02)
    # Gravity is on the sensor's y axis, and stays the only unit that fits.
    np.testing.assert_allclose(trial.imu.specific_force.mean(axis=0), [0, 9.8, 0], atol=0.3)
    # GPS and wheels agree: speed to half a decimetre a second in the median, way to a few percent.
    wheels = np.interp(trial.reference_v.t, trial.wheels.t, raw(folder / "odom.csv", "vx"))
    assert abs(np.median(trial.reference_v.value - wheels)) < 0.05
    assert trial.reference_x.value[-1] == pytest.approx(trial.wheels.angle[-1, 0] * 0.165, rel=0.03)


def test_one_run_of_the_small_car() -> None:
    path = DATA / "f1tenth_optitrack" / "hoons_all_test.csv"
    with pytest.raises(InputError, match="holds several runs: run_id = 4, 21, 22") as caught:
        read_trial(path)
    assert "--rows 'run_id = 4'" in caught.value.hint
    run = raw(path, "run_id")
    for number in (4, 21, 22):
        trial = read_trial(path, excerpt=Excerpt(f"run_id = {number}"))
        mine = run == number
        np.testing.assert_array_equal(trial.imu.t, raw(path, "")[mine])
        np.testing.assert_array_equal(trial.imu.specific_force[:, 0], raw(path, "ax_imu")[mine])
        np.testing.assert_array_equal(trial.reference_v.value, raw(path, "v_x")[mine])
        np.testing.assert_allclose(
            trial.wheels.angle[-1, 0], np.trapezoid(raw(path, "omega_wheels")[mine], trial.imu.t) / 0.052
        )
        # Slip beyond 20 % in 8 to 19 % of the samples, as the data set's notes say.
        wheels = raw(path, "omega_wheels")[mine]
        slip = np.abs(wheels - trial.reference_v.value) / trial.reference_v.value
        assert 0.075 < (slip > 0.2).mean() < 0.195


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("borealtc_husky/SNOW_imu_01.csv", None), ("borealtc_husky/SNOW_pro_01.csv", None),
        ("husky_gps/imu.csv", None), ("husky_gps/odom.csv", None),
        ("kobuki/kobuki_core_uint16_wrap.csv", None), ("robotino_slip/green_18.csv", None),
        ("f1tenth_optitrack/hoons_all_test.csv", "run_id = 21"),
    ],
)  # fmt: skip
def test_the_map_that_inspection_writes_reads_the_log_back(
    name: str, rows: str | None, tmp_path: Path
) -> None:
    path = DATA / name
    right, back = (
        read_trial(path, excerpt=Excerpt(rows)),
        make.mapped(tmp_path, path, excerpt=Excerpt(rows)),
    )
    assert back.layout == path.stem
    assert back.warnings == right.warnings
    make.same(right, back)
