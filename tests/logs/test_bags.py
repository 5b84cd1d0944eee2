"""Recordings by ROS 1 and 2 and MCAP files give the trial that the CSV of the same samples gives."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from granite_lab.errors import InputError, LabError, UsageError
from granite_lab.logs import inspect_logs, read_trial, write_canonical
from granite_lab.logs.bag import assign
from granite_lab.logs.trial import Trial, name_of, trial_files
from tests.logs import make
from tests.logs.bags import EPOCH, IMU, JOINTS, KINDS, ODOM, OUTSIDE, WHEELS, Bag, rounded
from tests.logs.test_texts import check
from tests.soak import SOAK


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Trial:
    """The rest before a drive and its beginning; a bag is written and read message by message."""
    return rounded(make.read(tmp_path_factory.mktemp("drive"), make.text(duration=3.0)))


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Trial:
    """A drive with the rest after it."""
    return rounded(make.read(tmp_path_factory.mktemp("drive"), make.text()))


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_gives_the_trial_of_the_csv(kind: str, trial: Trial, tmp_path: Path) -> None:
    csv = tmp_path / "csv" / "drive_v0.3_r1.csv"
    write_canonical(csv, trial)
    bag = Bag(kind)
    path = bag.write(tmp_path, "drive_v0.3_r1", bag.trial(trial))
    got = read_trial(path)
    make.same(got, read_trial(csv))
    assert got.name.startswith("drive_v0.3_r1")
    assert got.layout == f"ROS: imu {IMU}, joints {WHEELS}"
    assert got.inputs[0].path == path
    assert len(got.inputs[0].sha256) == 64


@pytest.mark.parametrize("bag", [Bag("ros2", epoch=EPOCH), Bag("ros1", stamped=False)])
def test_stamps_keep_their_nanoseconds_and_without_them_arrival_counts(
    bag: Bag, trial: Trial, tmp_path: Path
) -> None:
    got = read_trial(bag.write(tmp_path, "late", bag.trial(trial)))
    make.same(got, trial)
    assert any("have no stamps" in line for line in got.warnings) is not bag.stamped


@pytest.mark.parametrize("stuck", [7.0, None], ids=["constant", "whole seconds"])
def test_stamps_that_stand_still_give_way_to_the_time_of_arrival(
    stuck: float | None, trial: Trial, tmp_path: Path
) -> None:
    bag = Bag("ros2", epoch=EPOCH)
    messages = []
    for topic, t, message in bag.trial(trial):
        if topic == WHEELS:
            message.header.stamp = bag.header(math.floor(t) if stuck is None else stuck).stamp
        messages.append((topic, t, message))
    got = read_trial(bag.write(tmp_path, "stuck", messages))
    make.same(got, trial)
    assert len([line for line in got.warnings if "the time of arrival is used" in line]) == 1


@pytest.mark.parametrize("fast", [0.008, -0.006, 0.02])
def test_a_clock_that_runs_unlike_the_others_is_corrected_by_the_times_of_arrival(
    fast: float, trial: Trial, tmp_path: Path
) -> None:
    rng, late = np.random.default_rng(1), []
    bag = Bag("mcap", epoch=EPOCH)
    for topic, t, message in bag.trial(trial):
        if topic == IMU:
            message.header.stamp = bag.header((1.0 + fast) * t).stamp
        late.append((topic, t + rng.exponential(0.003), message))
    got = read_trial(bag.write(tmp_path, "fast", late))
    assert got.imu is not None
    assert trial.imu is not None
    assert np.ptp(got.imu.t) == pytest.approx(np.ptp(trial.imu.t), rel=3e-4)
    assert any(f"the clock of {IMU} runs" in line for line in got.warnings)


@pytest.mark.parametrize("share", [0.0, 0.02], ids=["a computer", "a simulation"])
def test_stamps_of_one_clock_stay_whatever_the_times_of_arrival(
    share: float, trial: Trial, tmp_path: Path
) -> None:
    rng, bag = np.random.default_rng(2), Bag("mcap", epoch=EPOCH)
    late = [(topic, (1.0 + share) * t + rng.exponential(0.01), m) for topic, t, m in bag.trial(trial)]
    make.same(read_trial(bag.write(tmp_path, "one", late)), trial)


def test_a_file_beside_the_bag_says_what_it_is(trial: Trial, tmp_path: Path) -> None:
    bag = Bag("mcap")
    path = bag.write(tmp_path, "drive_v0.3", bag.trial(trial))
    (tmp_path / "drive_v0.3.toml").write_text('robot = "granite"\nv_desired_mps = 0.3\nvirtual = true\n')
    got = read_trial(path)
    assert got.name == "drive_v0.3"
    assert (got.info.robot, got.info.v_desired, got.info.virtual) == ("granite", 0.3, True)
    assert [file.path.name for file in got.inputs] == ["drive_v0.3", "drive_v0.3.toml"]


def test_of_two_imus_the_fuller_topic_is_taken_and_said(trial: Trial, tmp_path: Path) -> None:
    bag = Bag("ros2")
    other = [("/imu/raw", t, bag.imu(t, (0, 0, 9.81), (0, 0, 0))) for t in trial.imu.t[::2]]
    path = bag.write(tmp_path, "two", [*bag.trial(trial), *other])
    got = read_trial(path)
    make.same(got, trial)
    said = [line for line in got.warnings if "/imu/raw" in line]
    assert said == ["two: topic /imu/data taken as imu, not /imu/raw; --topic imu=… chooses another"]
    chosen = read_trial(path, topics={"imu": "/imu/raw"})
    assert len(chosen.imu.t) == len(other)
    assert not [line for line in chosen.warnings if "taken as imu" in line]
    assert read_trial(path, topics={"joints": "none"}).wheels is None


def test_a_doubt_about_joints_names_the_bag_and_no_folder_of_the_machine(
    trial: Trial, tmp_path: Path
) -> None:
    bag = Bag("ros2")
    arm = [(WHEELS, t, bag.joints(t, ["shoulder", "elbow"], [0.1, t])) for t in trial.imu.t[::4]]
    got = read_trial(bag.write(tmp_path, "arm", [*bag.of_imu(trial), *arm]))
    (said,) = [line for line in got.warnings if "no wheel" in line]
    assert said == f"arm: no wheel among the joints of {WHEELS}; a column map can name them"
    assert str(tmp_path) not in "".join(got.warnings)


def test_velocities_serve_where_positions_are_not_published(trial: Trial, tmp_path: Path) -> None:
    bag = Bag("ros1")
    rate = np.gradient(trial.wheels.angle, trial.wheels.t, axis=0)
    joints = [
        (WHEELS, t, bag.joints(t, JOINTS, velocity=row)) for t, row in zip(trial.wheels.t, rate, strict=True)
    ]
    got = read_trial(bag.write(tmp_path, "rates", [*bag.of_imu(trial), *joints]))
    np.testing.assert_array_equal(got.wheels.rate, rate)


def test_odometry_stands_for_wheels_where_there_are_no_joints_and_says_so(
    trial: Trial, tmp_path: Path
) -> None:
    bag = Bag("ros2")
    v = np.gradient(trial.wheels.angle[:, 0], trial.wheels.t) * make.RADIUS
    odom = [(ODOM, t, bag.odometry(t, 0.0, x)) for t, x in zip(trial.wheels.t, v, strict=True)]
    got = read_trial(bag.write(tmp_path, "odom", [*bag.of_imu(trial), *odom]))
    np.testing.assert_allclose(got.wheels.rate[:, 2] * make.RADIUS, v, rtol=1e-12, atol=1e-12)
    assert any(f"the wheels' velocity is that of odometry {ODOM}" in line for line in got.warnings)


@pytest.mark.parametrize(
    "kind",
    ["Odometry", "Pose", "PoseStamped", "PoseWithCovariance", "PoseWithCovarianceStamped", "NavSatFix"],
)
def test_places_from_outside_are_a_reference_only_when_asked_for(
    kind: str, trial: Trial, tmp_path: Path
) -> None:
    """What has no header is put on the clock of the others, though it arrives later by as much as they."""
    bag = Bag("ros2", late=0.25)
    outside = [(OUTSIDE, t, bag.place(kind, t, 0.2 * t)) for t in trial.wheels.t]
    path = bag.write(tmp_path, "outside", [*bag.trial(trial), *outside])
    assert read_trial(path).reference_v is None
    got = read_trial(path, topics={"reference": OUTSIDE})
    np.testing.assert_allclose(got.reference_x.t, trial.wheels.t, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.median(got.reference_v.value), 0.2, rtol=1e-3)
    assert np.ptp(got.reference_x.value) == pytest.approx(0.2 * np.ptp(trial.wheels.t), rel=1e-3)
    assert any("have no stamps" in line for line in got.warnings) == (kind in ("Pose", "PoseWithCovariance"))


def test_a_covariance_that_begins_with_minus_one_means_that_there_is_no_sample(
    trial: Trial, tmp_path: Path
) -> None:
    bag = Bag("ros2")
    imu = [(IMU, t, bag.imu(t, (0, 0, 0), (0, 0.1, 0), no_force=True)) for t in trial.imu.t]
    got = read_trial(bag.write(tmp_path, "gyro", [*imu, *bag.of_wheels(trial)]))
    assert np.isnan(got.imu.specific_force).all()
    assert set(got.imu.angular_rate[:, 1]) == {0.1}
    assert any("no accelerometer" in line for line in got.warnings)


def test_a_column_map_names_topic_and_field(trial: Trial, tmp_path: Path) -> None:
    """A written map reads the bag as it was read; edited, it turns a sign or takes effort for current."""
    bag, own = Bag("mcap"), tmp_path / "own.toml"
    joints = bag.of_wheels(trial, effort=(1.0, 2.0, 3.0, 4.0))
    path = bag.write(tmp_path, "mapped", [*bag.of_imu(trial), *joints])
    text = inspect_logs([path]).to_map_toml()
    own.write_text(text)
    make.same(read_trial(path, map=own), read_trial(path))
    name = f"{WHEELS}.effort.{JOINTS[1]}"
    assert f'# name = "{name}"' in text
    own.write_text(text + f'\n[[column]]\nname = "{name}"\nto = ["cur_fr"]\nunit = "A"\nscale = -0.5\n')
    assert set(read_trial(path, map=own).currents.current[:, 1]) == {-1.0}


def test_a_bag_can_be_inspected(drive: Trial, tmp_path: Path) -> None:
    bag = Bag("ros2")
    report = inspect_logs([bag.write(tmp_path, "seen", bag.trial(drive))])
    file = report.files[0]
    assert not file.problem
    assert file.layout.startswith("ROS: imu /imu/data")
    assert {s.what: round(s.rate) for s in file.streams} == {"imu": 100, "encoders": 100}
    assert len(file.rests) == 2
    channels = {c for column in file.columns for c in column.to}
    assert channels == {name.rpartition("_")[0] for name in make.COLUMNS}
    assert report.as_json()["files"][0]["text"] is None
    frame = report.to_frame()
    assert list(frame.loc[frame["channels"] == "enc_fl", "column"]) == [f"{WHEELS}.position.{JOINTS[0]}"]


@pytest.mark.parametrize(
    ("topics", "message"),
    [
        ({"imu": "/nothing"}, "there is no topic '/nothing'"),
        ({"imu": WHEELS}, r"topic '/joint_states' holds sensor_msgs/msg/JointState, expected .*Imu"),
    ],
)
def test_a_wrong_topic_is_refused_with_those_there_are(
    topics: dict[str, str], message: str, trial: Trial, tmp_path: Path
) -> None:
    bag = Bag("ros1")
    path = bag.write(tmp_path, "t", bag.trial(trial))
    with pytest.raises(UsageError, match=message):
        read_trial(path, topics=topics)


def test_a_bag_without_sensors_is_refused_with_what_it_holds(tmp_path: Path) -> None:
    bag = Bag("ros2")
    text = [("/chatter", k / 10, bag.of("std_msgs/msg/String", "hello")) for k in range(3)]
    with pytest.raises(InputError, match=r"no topic with sensor_msgs/msg/Imu") as caught:
        read_trial(bag.write(tmp_path, "talk", text))
    assert "std_msgs/msg/String" in caught.value.hint
    arm = [("/joint_states", k / 10, bag.joints(k / 10, ["shoulder", "elbow"], [0.1, k])) for k in range(9)]
    with pytest.raises(InputError, match="no wheel among the joints of /joint_states"):
        read_trial(bag.write(tmp_path, "arm", arm))


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_bag_is_one_line_and_never_a_traceback(kind: str, trial: Trial, tmp_path: Path) -> None:
    """Cut off at many places, and with bytes changed."""
    bag = Bag(kind)
    path = bag.write(tmp_path, "cut", bag.trial(rounded(trial, 50)))
    file = next(p for p in path.iterdir() if p.suffix in (".db3", ".mcap")) if path.is_dir() else path
    whole = file.read_bytes()
    rng, refused, tries = np.random.default_rng(1), 0, 40 if SOAK else 20
    for k in range(tries):
        data = bytearray(whole)
        if k % 2:
            del data[int(rng.integers(0, len(data))) :]
        else:
            for place in rng.integers(0, len(data), 20):
                data[place] = int(rng.integers(0, 256))
        file.write_bytes(data)
        refused += check(path)
    assert refused > tries // 4


def test_a_text_that_is_no_bag(tmp_path: Path) -> None:
    make.written(tmp_path, "a: [1, 2\n", "folder/metadata.yaml")
    for path in (make.written(tmp_path, "t_s\n0\n", "text.bag"), tmp_path / "folder"):
        with pytest.raises(InputError, match="cannot be read as a ROS bag"):
            read_trial(path)


def test_without_the_library_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(LabError, match="needs rosbags, which is not installed") as caught:
        read_trial(tmp_path / "a.bag")
    assert caught.value.hint == "pip install 'granite-lab[ros]'"


def test_a_folder_stands_for_its_logs_of_every_kind(trial: Trial, tmp_path: Path) -> None:
    make.written(tmp_path, make.text(), "a_v0.2.csv")
    make.written(tmp_path, "", "notes.txt")
    make.written(tmp_path, b"", "e.mat")
    for name in ("imu.csv", "wheel_encoders.csv", "Barometer.csv"):
        make.written(tmp_path, "", f"f_v0.3/{name}")
    for name in ("imu_1.csv", "imu_2.csv"):  # two trials
        make.written(tmp_path, "", f"g/{name}")
    for kind, name in (("ros1", "b"), ("ros2", "c_v0.5"), ("mcap", "d")):
        Bag(kind).write(tmp_path, name, Bag(kind).trial(rounded(trial, 3)))
    names = [name_of(path) for path in trial_files(tmp_path)]
    assert names == ["a_v0.2", "b", "c_v0.5", "d", "e", "f_v0.3"]
    with pytest.raises(UsageError, match="two logs are called 'b'"):
        trial_files([tmp_path / "b.bag", tmp_path / "x" / "b.csv"])


@pytest.mark.parametrize(
    ("joint", "wheels"),
    [
        ("front_left_wheel_joint", ("fl",)),
        ("wheel_FR", ("fr",)),
        ("RearLeftWheel", ("rl",)),
        ("joint_back_right_wheel", ("rr",)),
        ("rearright", ("rr",)),
        ("left_wheel_joint", ("fl", "rl")),
        ("wheel_r_joint", ("fr", "rr")),
        ("front_left_steer_joint", ()),
        ("shoulder_left", ()),
        ("torso", ()),
    ],
)
def test_wheels_are_known_by_the_names_of_their_joints(joint: str, wheels: tuple[str, ...]) -> None:
    assert assign([joint]).get(joint, ()) == wheels


def test_a_wheel_has_one_joint() -> None:
    found = assign(["front_left", "front_left_wheel", "left_wheel"])
    assert found == {"front_left_wheel": ("fl",), "left_wheel": ("rl",)}
