"""Sets of `benchmarks.real_trials` whose loggers were written by students and hobbyists.

Their robots drive on floors, a car and a field robot outdoors. Tables of several sensors become a folder of
each run, with names that say which sensor is in them.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

from benchmarks.real_logs import BY_HAND
from benchmarks.real_trials_set import Prepared

PLACE_STD = 0.05
"""Std of a place by the particle filter of the F1TENTH car [m]: its scatter at standstill."""

GPS_STD = 0.25
"""Std of a place of the field robot [m]: latitude and longitude are rounded to 0.4 and 0.7 m (float32)."""

FLOOR = (
    "On a floor the wheels hardly slip. Nothing but the wheels says how far the robot went, so that the std "
    "must hold a slip of nearly 0."
)
"""What is known of the truth where the robot drove on a floor."""


def own_folder(work: Path, name: str, files: Mapping[str, Path]) -> None:
    """Copy the files of a run into a folder of their own, under the names of their sensors."""
    own = work / name
    own.mkdir()
    for sensor, path in files.items():
        shutil.copy(path, own / f"{sensor}.csv")


def car(data: Path, work: Path) -> Prepared:
    """F1TENTH car, remotely driven on a closed course, with lidar localisation."""
    names = {"imu": "imuData", "odometry": "odomData", "reference": "pfPoseData"}
    for run in sorted((data / "f1tenth_penn").glob("DS*")):
        own_folder(work, run.name, {sensor: run / f"{name}.csv" for sensor, name in names.items()})
        (work / f"{run.name}.toml").write_text(f"ref_x_std_m = {PLACE_STD}\n", encoding="utf-8")
    return Prepared(
        "F1TENTH car, lidar localisation", "AhmadAmine998/FrictionMaps, DataSets", "MIT", work,
        str(BY_HAND / "f1tenth_penn.toml"), str(BY_HAND / "f1tenth_penn_maps"),
        ("a folder for each run with imu.csv, odometry.csv and reference.csv",
         "column maps: three, by the drafts of inspect",
         "robot: chassis by its parts, the IMU a quarter turn round",
         "sidecar of each run: std of the reference"),
        reference_is=f"particle filter on lidar, ± {1000 * PLACE_STD:.0f} mm",
        remark="The page of the set states m/s², rad/s and x ahead. The log has g, °/s and an IMU turned by "
        "90°: units were found by their values, and the mounting was refused until the robot's file "
        "had it. The car is hardly ever on a straight for 2 s. In the part of DS2 that is used, between two "
        "gaps, the particle filter moves by 3.3 m while the wheels roll 1.1 m and stand: its std does not "
        "hold there. In DS4 and DS5 its way between two places on straights, 1 s apart, is 0.77 and 0.93 of "
        "that of the wheels (medians), so that the car slips.",
    )  # fmt: skip


def roomba(data: Path, work: Path) -> Prepared:
    """Roomba on a floor, without a header."""
    for path in sorted((data / "roomba").glob("*.txt")):
        shutil.copy(path, work / f"{path.stem}.csv")
    return Prepared(
        "Roomba on a floor", "mathman93/RoombaCI-Clemson, Data_Files", "none: not committed", work,
        str(BY_HAND / "roomba.toml"), str(BY_HAND / "roomba_maps"),
        ("column maps: two, for the orders of columns of two years; names by the programs that logged",
         "robot: wheels and counts of the data sheet"),
        remark=f"{FLOOR} No file has a header. The counters run over at 16 bits. With the gyro's y as logged "
        "IMUData_2-18-21 was refused, because its sign or that of ax is wrong: while ax falls by 0.2 m/s² "
        "gy adds up to -1°. Two wheels and a castor: no [chassis], so that nothing is simulated.",
    )  # fmt: skip


def robomaster(data: Path, work: Path) -> Prepared:
    """RoboMaster with four motors, in squares on a floor."""
    for imu in sorted((data / "robomaster").glob("*_imu_data.csv.csv")):
        esc = imu.with_name(imu.name.replace("imu", "esc"))
        own_folder(work, imu.name.split("_")[1], {"imu": imu, "wheels": esc})
    return Prepared(
        "RoboMaster, squares on a floor", "jamInwza007x/robmaster-lab3-Araigodai, data/raw",
        "none: not committed", work, str(BY_HAND / "robomaster.toml"), str(BY_HAND / "robomaster_maps"),
        ("a folder for each run with imu.csv and wheels.csv",
         "column maps: two; the names of 16 columns, of which the header of the log names one",
         "robot: chassis by its data sheet, z of the IMU downwards"),
        remark=f"{FLOOR} The robot's own position says 2.4 m, the wheels 2.8 m. IMU 8 Hz, stamps that "
        "scatter by 88 ms; the left wheels count backwards. Straight sides and turns in place follow each "
        "other: an earlier version found no side that counts backwards, and gave -1.3 ± 0.5 m. It let the "
        "IMU of 20260715 pass upside down, because nothing stands still there, and found clocks that differ "
        "by 1.7 ± 0.2 %, where stamps agree within 50 ms throughout.",
    )  # fmt: skip


def robobot(data: Path, work: Path) -> Prepared:
    """Robobot of a course at DTU: a mission to a marker on a floor."""
    files = {"imu": data / "robobot/accgyro.txt", "motors": data / "robobot/motor.txt"}
    own_folder(work, "aruco_2", files)
    return Prepared(
        "Robobot of DTU, on a floor", "SebastianBitsch/robobot-project, regbot/doc/robobot_mission_aruco_2",
        "none: not committed", work, str(BY_HAND / "robobot.toml"), str(BY_HAND / "robobot_maps"),
        ("column maps: two, with the names that stand as comments above the rows",
         "a folder with imu.csv and motors.csv", "robot: its wheels"),
        remark=f"{FLOOR} Comments as in MATLAB (%) list the columns; an earlier version took the last of "
        "them for a header. Half of the IMU's rows repeat the one before. The yaw gyro turns against the "
        "encoders: which of the two has the wrong sign no log tells. No [chassis].",
    )  # fmt: skip


def field_robot(data: Path, work: Path) -> Prepared:
    """Field robot with GPS, every number in a topic of its own."""
    for path in sorted((data / "terrasentia").glob("*.bag")):
        shutil.copy(path, work)
        (work / f"{path.stem}.toml").write_text(f"ref_x_std_m = {GPS_STD}\n", encoding="utf-8")
    robot, chart = (str(BY_HAND / f"terrasentia{end}.toml") for end in ("", "_map"))
    return Prepared(
        "Field robot with GPS", "kulbir-ahluwalia/RTKGPS_IMU_Encoders_Plot_trajectory_using_ROS",
        "none: not committed", work, robot, chart,
        ("column map: 12 lines, by the draft of inspect", "robot: its wheels",
         "sidecar: std of the reference"),
        reference_is=f"RTK-GPS as float32, ± {1000 * GPS_STD:.0f} mm",
        remark="A bag of 13 topics with one number each; an earlier version refused it whatever the map. It "
        "was recorded while a log of 50 s was played in 208 s: by the times of arrival the wheels gain "
        "0.008 times the speed that the IMU gains, which ingest says; the topic Timestamp is the clock. The "
        "accelerometer throws off to its limit of 320 m/s² 16 times. No [chassis].",
    )  # fmt: skip


FIELD: dict[str, Callable[[Path, Path], Prepared]] = {
    "f1tenth_penn": car,
    "roomba": roomba,
    "robomaster": robomaster,
    "robobot": robobot,
    "terrasentia": field_robot,
}
"""What must be in the data's folder, and what prepares the set."""
