"""The file of a new robot: what is asked, what is written, and which analyses it allows."""

import os
import pty
import select
import sys
import tomllib
from pathlib import Path

import pytest

import granite_lab as gl
from granite_lab.errors import InputError, UsageError
from granite_lab.parameters import load_robot
from granite_lab.parameters.analyses import allowed_by, analyses
from granite_lab.parameters.catalogue import in_force
from granite_lab.parameters.new_robot import questions
from tests.corpus.cli import ROOT, lab

RADIUS = {"robot.wheels.radius_m": 0.075}
CHASSIS = {
    "wheel_base_m": 0.36, "track_m": 0.45, "body_mass_kg": 18.0, "wheel_mass_kg": 0.9, "com_x_m": -0.01,
    "com_z_m": 0.05, "wheel_inertia_kgm2": 0.004, "pitch_inertia_kgm2": 0.25, "contact_damping_Nspm": 500.0,
    "tyre_stiffness_Npm": 30000.0,
}  # fmt: skip


def allowed(made: object) -> list[bool]:
    return [one.allowed for one in made.analyses]  # type: ignore[attr-defined]


def test_a_radius_is_enough_for_velocity_and_slip_and_a_chassis_for_the_measured_wheels(
    tmp_path: Path,
) -> None:
    made = gl.robot(tmp_path / "a.toml", changes=RADIUS)
    assert allowed(made) == [True, False, False, False]
    assert made.analyses[1].missing == ("encoders.counts_per_rev",)
    assert made.analyses[0].assumed == ("imu.x_m", "imu.z_m")
    whole = RADIUS | {f"robot.chassis.{key}": value for key, value in CHASSIS.items()}
    made = gl.robot(tmp_path / "b.toml", changes=whole | {"robot.encoders.counts_per_rev": 5000.0})
    assert allowed(made) == [True, True, True, False]
    assert all(key.startswith("drive.") for key in made.analyses[3].missing)
    back = load_robot(str(tmp_path / "b.toml"))
    assert back.chassis is not None
    assert (back.name, back.wheels.radius, back.chassis.track) == ("b", 0.075, 0.45)
    assert list(made.to_frame()["allowed"]) == allowed(made)


def test_a_table_that_is_incomplete_is_a_comment_with_what_is_known_in_it(tmp_path: Path) -> None:
    made = gl.robot(tmp_path / "a.toml", changes=RADIUS | {"robot.chassis.track_m": 0.45})
    text = made.path.read_text(encoding="utf-8")
    assert "chassis" not in tomllib.loads(text)
    assert "# track_m = 0.45" in text
    assert "# wheel_base_m = …   # distance between the axles" in text
    uncommented = text.replace("# [chassis]", "[chassis]").replace("# track_m", "track_m")
    made.path.write_text(uncommented, encoding="utf-8")
    gl.params()  # reads files anew
    with pytest.raises(InputError, match="'wheel_base_m' is missing"):
        load_robot(str(made.path))


def test_another_robot_stands_in_and_the_file_says_so(tmp_path: Path) -> None:
    made = gl.robot(tmp_path / "a.toml", changes=RADIUS, like="granite")
    assert allowed(made) == [True] * 4
    text, back, granite = made.path.read_text(encoding="utf-8"), load_robot(str(made.path)), load_robot()
    assert back.drive == granite.drive
    assert back.chassis == granite.chassis
    assert back.wheels.radius == 0.075
    for line in text.splitlines():
        if line.startswith("wheel_base_m"):
            assert "of granite, to be measured" in line
        if line.startswith("radius_m"):
            assert "to be measured" not in line


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("a.toml", {}, "the radius of the wheels is needed"),
        ("a.txt", RADIUS, "ends in .toml"),
        ("a.toml", RADIUS | {"soil.exponent": 1.0}, "is no number of a robot"),
        ("a.toml", {"robot.wheels.radius_m": 7.0}, "is out of range"),
        ("a.toml", {"robot.wheels.radus_m": 0.1}, "the nearest known|unknown key"),
    ],
)
def test_what_is_no_robot_is_refused(name: str, changes: dict[str, float], said: str, tmp_path: Path) -> None:
    with pytest.raises((UsageError, InputError), match=said):
        gl.robot(tmp_path / name, changes=changes)
    assert not (tmp_path / name).exists()


def test_a_file_that_is_there_stays(tmp_path: Path) -> None:
    gl.robot(tmp_path / "a.toml", changes=RADIUS)
    with pytest.raises(UsageError, match="exists already"):
        gl.robot(tmp_path / "a.toml", changes={"robot.wheels.radius_m": 0.2})
    assert load_robot(str(tmp_path / "a.toml")).wheels.radius == 0.075


def test_each_analysis_asks_for_what_it_needs_and_no_more() -> None:
    numbers = [len(questions(one.id)) for one in analyses()]
    assert numbers == sorted(set(numbers))
    assert list(questions("estimate")) == [
        "robot.wheels.radius_m", "robot.imu.x_m", "robot.imu.z_m",
    ]  # fmt: skip
    assert questions("estimate")["robot.wheels.radius_m"] == "wheel radius [m] (0.01 to 1)"
    with pytest.raises(UsageError, match="unknown analysis 'slip'"):
        questions("slip")


@pytest.mark.parametrize(("robot", "expected"), [("granite", 4), ("kobuki", 1)])
def test_params_says_which_analyses_a_robot_allows(robot: str, expected: int, tmp_path: Path) -> None:
    found = sum(one.allowed for one in allowed_by(in_force(robot, "dry_sand")))
    assert found >= expected
    done = lab("params", "--robot", robot, cwd=tmp_path)
    assert "analyses that the robot's file allows" in done.out
    assert done.out.count(" yes ") == found
    assert ("[chassis]" in done.out.split("analyses that")[1]) == (expected == 1)


def test_on_a_terminal_each_number_is_asked_until_it_is_one(tmp_path: Path) -> None:
    """A pseudo-terminal types: a wrong radius, a right one, and Enter for all others."""
    run = "import sys; from granite_lab.cli import main; main()"
    words = ["robot", "typed.toml", "--analysis", "estimate", "--set", "robot.imu.z_m=0.1"]
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(tmp_path)
        os.environ["PYTHONPATH"] = str(ROOT)
        os.execv(sys.executable, [sys.executable, "-c", run, *words])
    shown = b""

    def until(text: bytes, times: int = 1) -> None:
        nonlocal shown
        while shown.count(text) < times:
            assert select.select([terminal], [], [], 120)[0], shown
            shown += os.read(terminal, 1024)

    until(b"wheel radius [m] (0.01 to 1): ")
    os.write(terminal, b"75\n")
    until(b"wheel radius [m] (0.01 to 1): ", 2)
    os.write(terminal, b"0.075\n")
    until(b"position forward of R")
    os.write(terminal, b"\n")
    until(b"granite-lab params --robot typed.toml")
    assert os.waitpid(child, 0)[1] == 0
    assert b"is out of range" in shown
    assert b"position above" not in shown
    made = load_robot(str(tmp_path / "typed.toml"))
    assert (made.wheels.radius, made.imu.x, made.imu.z) == (0.075, 0.0, 0.1)
