"""Habits of loggers that public logs of other laboratories showed, each in a small log of known contents."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granite_lab.errors import InputError, UsageError
from granite_lab.estimation import correct
from granite_lab.estimation.clock_rate import clock_rate
from granite_lab.logs import inspect_logs, read_trial
from granite_lab.logs.sensors.imu import mounted
from granite_lab.logs.sensors.mounting import to_body
from granite_lab.logs.sensors.signs import check_signs
from granite_lab.logs.trial import ImuStream, Trial, WheelStream, trial_files
from granite_lab.parameters import load_robot
from tests.corpus.cli import SAMPLES, lab, succeeded
from tests.logs import make
from tests.logs.bags import Bag, rounded

ROBOT = load_robot("granite")
SENSED = [f"/{kind}_{axis}" for kind in ("accel", "gyro") for axis in "xyz"]
TURNED = [f"/wheel_{wheel}" for wheel in ("fl", "fr", "rl", "rr")]
ENTRY = '[[column]]\nname = "{}"\nto = [{}]\nunit = "{}"\n'


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Trial:
    return rounded(make.read(tmp_path_factory.mktemp("drive"), make.text()))


def entries(names: list[str]) -> str:
    """Return what a map says of the canonical columns in the order of some names."""
    lines = [ENTRY.format(names[0], '"t"', "s")]
    for name, column in zip(names[1:], make.COLUMNS[1:], strict=True):
        channel, unit = re.sub("_[a-z0-9]+$", "", column), column.rpartition("_")[2]
        lines.append(ENTRY.format(name, f'"{channel}"', unit))
    return "".join(lines)


def one_by_one(bag: Bag, trial: Trial, lost: int = -1) -> list[tuple[str, float, object]]:
    """Return messages of one number each, those of a sample 0.3 ms apart; one of them may get lost."""
    imu, wheels = trial.imu, trial.wheels
    assert imu is not None
    assert wheels is not None
    values = np.hstack([imu.specific_force, imu.angular_rate, wheels.angle])
    sent = [
        (topic, t + 3e-4 * place, bag.of("std_msgs/msg/Float64", float(value)))
        for t, row in zip(imu.t, values, strict=True)
        for place, (topic, value) in enumerate(zip([*SENSED, *TURNED], row, strict=True))
    ]
    return [message for k, message in enumerate(sent) if k != lost]


@pytest.mark.parametrize("lost", [-1, 1234])
def test_numbers_sent_one_by_one_are_mapped_and_make_rows(lost: int, trial: Trial, tmp_path: Path) -> None:
    """As small computers send them, without a header and each axis in a topic of its own."""
    bag = Bag("ros1")
    path = bag.write(tmp_path, "numbers", one_by_one(bag, trial, lost))
    with pytest.raises(InputError, match="no topic with sensor_msgs/msg/Imu") as caught:
        read_trial(path)
    assert "/accel_x.data" in caught.value.hint
    report = inspect_logs([path]).files[0]
    assert {c.name: c.to for c in report.columns}["/gyro_z.data"] == ("imu_gz",)
    names = ["t", *(f"{topic}.data" for topic in (*SENSED, *TURNED))]
    chart = make.written(tmp_path, 'name = "own"\n' + entries(names), "own.toml")
    got = read_trial(path, map=chart)
    whole = np.isin(np.arange(len(trial.imu.t)), [lost // 10] if lost >= 0 else [], invert=True)
    np.testing.assert_allclose(got.imu.specific_force, trial.imu.specific_force[whole], atol=1e-12)
    assert np.abs(got.imu.t - trial.imu.t[whole]).max() < 1e-6
    assert np.isfinite(got.wheels.angle).any(axis=0).all()


def test_a_map_names_any_field_of_any_message(trial: Trial, tmp_path: Path) -> None:
    """The second number of an array, here the angle of both left wheels, beside an IMU as usual."""
    bag = Bag("ros2")
    layout = bag.of("std_msgs/msg/MultiArrayLayout", [], 0)
    arrays = [
        ("/wheels", t, bag.of("std_msgs/msg/Float64MultiArray", layout, np.array([0.0, angle[0]])))
        for t, angle in zip(trial.wheels.t, trial.wheels.angle, strict=True)
    ]
    path = bag.write(tmp_path, "array", [*bag.of_imu(trial), *arrays])
    text = 'name = "own"\n' + ENTRY.format("t", '"t"', "s")
    for kind, channel, unit in (("linear_acceleration", "a", "m/s^2"), ("angular_velocity", "g", "rad/s")):
        for axis in "xyz":
            text += ENTRY.format(f"/imu/data.{kind}.{axis}", f'"imu_{channel}{axis}"', unit)
    text += ENTRY.format("/wheels.data.1", '"enc_fl", "enc_rl"', "rad")
    got = read_trial(path, map=make.written(tmp_path, text, "own.toml"))
    assert np.array_equal(got.wheels.angle[:, 0], trial.wheels.angle[:, 0])
    assert np.array_equal(got.imu.specific_force, trial.imu.specific_force)


@pytest.mark.parametrize("mark", ["% ", "%% ", "# "])
def test_comments_above_the_rows_are_no_header(mark: str, tmp_path: Path) -> None:
    """As MATLAB has them: a list of what the columns are, whose last line is no header."""
    rows = make.text().partition("\n")[2].replace(",", " ")
    noted = f"{mark}log of a robot\n{mark}1 time [s]\n{mark}2-4 accelerometer [m/s^2]\n"
    with pytest.raises(InputError, match="no header line"):
        make.read(tmp_path, noted + rows)
    names = [f"c{k}" for k in range(len(make.COLUMNS))]
    head = f'name = "own"\n[table]\nnames = {names!r}\n'.replace("'", '"')
    chart = make.written(tmp_path, head + entries(names), "own.toml")
    plain = make.read(tmp_path, make.text(), "plain.csv")
    make.same(make.read(tmp_path, noted + rows, map=chart), plain)
    named = f"{mark}a log\n{mark}{' '.join(make.COLUMNS)}\n"
    make.same(make.read(tmp_path, named + rows), plain)


def test_a_file_given_for_its_wheels_is_read_by_the_map_of_wheels(tmp_path: Path) -> None:
    """Odometry holds a place, too, which another map of the folder knows better; not all maps are needed."""
    t, imu, wheels = make.rows()
    table = np.column_stack([t, wheels[:, 0], 0 * t, 0 * t])
    lines = ["when,turned,x,y", *(",".join(f"{v:.9g}" for v in row) for row in table)]
    wheel = make.written(tmp_path, "\n".join(lines) + "\n", "odom.csv")
    body = make.written(tmp_path, make.only("t_s", *make.IMU), "inertial.csv")
    clock = ENTRY.format("when", '"t"', "s")
    turned = 'name = "turned"\n' + clock + ENTRY.format("turned", '"enc_fl", "enc_fr"', "rad")
    place = 'name = "place"\n' + clock + ENTRY.format("x", '"ref_x"', "m") + ENTRY.format("y", '"ref_y"', "m")
    one = make.written(tmp_path, turned, "maps/turned.toml")
    two = make.written(tmp_path, place, "maps/place.toml")
    idle = ENTRY.format("other", '"t"', "s") + ENTRY.format("more", '"enc_fl"', "rad")
    make.written(tmp_path, 'name = "idle"\n' + idle, "maps/idle.toml")
    got = read_trial(body, {"encoders": wheel}, map=tmp_path / "maps")
    assert got.wheels is not None
    assert len(got.wheels.t) == len(t)
    assert len(got.imu.t) == len(imu)
    with pytest.raises(InputError, match="column maps 'turned' and 'place' both fit; 'turned' is used"):
        read_trial(body, {"encoders": wheel}, map=[one, two])


def test_a_map_of_other_files_is_not_tried(tmp_path: Path) -> None:
    """Its key `file` is not in the file's name, though its columns are in the table."""
    t, _, wheels = make.rows()
    table = np.column_stack([t, wheels[:, 0], 0 * t, 0 * t])
    lines = ["when,turned,x,y", *(",".join(f"{v:.9g}" for v in row) for row in table)]
    make.written(tmp_path, "\n".join(lines) + "\n", "drive/odometry.csv")
    make.written(tmp_path, make.only("t_s", *make.IMU), "drive/imu.csv")
    clock = ENTRY.format("when", '"t"', "s")
    turned = 'name = "turned"\n' + clock + ENTRY.format("turned", '"enc_fl", "enc_fr"', "rad")
    place = 'name = "place"\n' + clock + ENTRY.format("x", '"ref_x"', "m") + ENTRY.format("y", '"ref_y"', "m")
    make.written(tmp_path, turned, "maps/turned.toml")
    make.written(tmp_path, place.replace("\n", '\nfile = "pose"\n', 1), "maps/place.toml")
    got = read_trial(tmp_path / "drive", map=tmp_path / "maps")
    assert got.wheels is not None
    assert got.reference_x is None


def test_an_attitude_and_flags_are_not_taken_for_gravity(tmp_path: Path) -> None:
    """Three parts of a quaternion of unit length; and readings of about 1 beside flags of 0 and 1."""
    t = np.arange(400) / 50
    yaw = 0.5 * np.sin(t)
    noise = np.random.default_rng(0).normal(0, 0.02, t.size)
    for columns in (
        (0 * t, np.sin(yaw / 2), np.cos(yaw / 2)),
        (np.ones_like(t), 0.1 * np.sin(t) + noise, 0.1 * np.cos(t)),
    ):
        rows = (",".join(f"{v:.6f}" for v in row) for row in zip(t, *columns, strict=True))
        path = make.written(tmp_path, "\n".join(["clock,k,l,m", *rows]) + "\n")
        assert not any("imu_az" in column.to for column in inspect_logs([path]).files[0].columns)


def test_an_imu_upside_down_is_refused_where_nothing_stands_still(tmp_path: Path) -> None:
    t, imu, wheels = make.rows()
    moving = (t > 1.5) & (t < 4.5)
    imu[:, [1, 2, 4, 5]] *= -1.0
    table = np.column_stack([t, imu, wheels])[moving]
    text = "\n".join([make.HEADER, *(",".join(f"{v:.9g}" for v in row) for row in table)]) + "\n"
    with pytest.raises(InputError, match=r"'imu_az_mps2' reads -9\.8\d m/s\^2 on average: gravity is on it"):
        make.read(tmp_path, text)


@pytest.mark.parametrize("backwards", [0, 1])
def test_a_side_that_counts_backwards_shows_where_the_robot_drives_and_turns_by_turns(backwards: int) -> None:
    """A square: four straight sides of 0.5 m and four turns of a quarter in place."""
    t = np.arange(0.0, 24.0, 0.01)
    phase = t % 6.0
    ahead, turn = np.where((phase > 1) & (phase < 2), 0.5, 0.0), np.where((phase > 3) & (phase < 5), 0.8, 0.0)
    half = 0.5 * ROBOT.chassis.track
    speed = np.stack([ahead - half * turn, ahead + half * turn] * 2, axis=1)
    right = np.cumsum(speed, axis=0) * 0.01 / ROBOT.wheels.radius
    rng = np.random.default_rng(0)
    force = rng.normal(0, 0.02, (t.size, 3)) + np.array([0.0, 0.0, 9.81])
    rate = rng.normal(0, 0.002, (t.size, 3))
    rate[:, 2] += turn
    imu = to_body(ImuStream(t, force, rate), mounted(ROBOT))
    assert check_signs(WheelStream(t, right), imu, ROBOT, forward_given=True)[1] == ()
    logged = right.copy()
    logged[:, backwards::2] *= -1.0
    wheels, said = check_signs(WheelStream(t, logged), imu, ROBOT, forward_given=True)
    assert np.array_equal(wheels.angle, right)
    assert ["fl, rl", "fr, rr"][backwards] in str(said[0])


def test_clocks_are_not_said_to_differ_by_less_than_their_stamps_scatter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stamps that were spread evenly may be late at one ramp and early at the other."""
    trial = read_trial(SAMPLES / "virtual_v0.3_r2.csv")
    seen = []

    def kept(problem: object) -> object:
        seen.append((problem.stamp_std, rate := clock_rate(problem)))  # type: ignore[attr-defined, arg-type]
        return rate

    monkeypatch.setattr("granite_lab.estimation.clock_rate.clock_rate", kept)
    correct(trial, ROBOT)
    correct(replace(trial, wheels=replace(trial.wheels, stamp_std=0.08)), ROBOT)
    (_, sharp), (std, spread) = seen[0], seen[-1]
    assert std == pytest.approx(0.08, rel=0.1)
    length = 2.0 / 0.3
    assert spread.std**2 - sharp.std**2 == pytest.approx(2 * (0.08 / length) ** 2, rel=0.3)


def test_an_option_of_one_value_is_not_taken_twice() -> None:
    done = lab("inspect", SAMPLES / "virtual_v0.3_r1.csv", "--map", "rover", "--map=kobuki")
    assert done.code == 2
    assert "--map is given 2 times" in done.error
    assert "a folder stands for several maps" in done.hint


def test_a_folder_of_texts_is_refused_with_the_name_they_have(tmp_path: Path) -> None:
    make.written(tmp_path, make.text(), "run.txt")
    with pytest.raises(UsageError, match="holds no log") as caught:
        trial_files(tmp_path)
    assert str(tmp_path / "*.txt") in caught.value.hint
    assert len(trial_files(tmp_path / "run.txt")) == 1


def test_measured_wheels_of_a_log_by_a_map_drive_a_simulation(tmp_path: Path) -> None:
    names = [f"c{k}" for k in range(len(make.COLUMNS))]
    log = make.written(tmp_path, make.text().replace(make.HEADER, ",".join(names)), "run.csv")
    chart = make.written(tmp_path, 'name = "own"\n' + entries(names), "own.toml")
    done = succeeded("simulate", "--wheels", log, "--map", chart, "--out", tmp_path / "run_sim.csv")
    assert "slip ratio of the robot" in done.out
