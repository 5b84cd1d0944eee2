"""The catalogue holds the paper's numbers, and wrong files are refused in one clear line."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from granite_lab.errors import InputError, UsageError
from granite_lab.logs import read_trial
from granite_lab.parameters import (
    CATALOGUE,
    by_speed,
    load_paper,
    load_robot,
    load_soil,
    load_variants,
    names,
)
from granite_lab.parameters.catalogue import in_force


def test_robot_is_the_one_of_section_4() -> None:
    robot = load_robot()
    assert robot.chassis.total_mass == pytest.approx(43.10)
    assert (robot.wheels.radius, robot.wheels.width) == (0.0965, 0.128)
    assert robot.drive.inductance / robot.drive.resistance == pytest.approx(0.26e-3, rel=0.01)


def test_soil_is_table_1_in_si_units() -> None:
    soil = load_soil()
    assert soil.cohesive_modulus == pytest.approx(0.90e3)
    assert soil.frictional_modulus == pytest.approx(1523e3)
    # below this pressure tyre friction rules in (10), above it the soil's strength
    limit = soil.cohesion / (soil.tyre_friction - math.tan(math.radians(soil.friction_angle)))
    assert limit == pytest.approx(44e3, rel=0.01)


def test_variants_are_table_2_and_paper_is_table_3() -> None:
    assert [(v.velocity, v.acceleration, v.distance) for v in load_variants()] == [
        (0.2, 0.6, 1.0),
        (0.3, 1.2, 2.0),
        (0.5, 1.2, 2.5),
        (0.7, 2.4, 3.0),
    ]
    assert [p.k92 for p in load_paper().table3] == [0.33, 0.26, 0.111, 0.026]


@given(st.lists(st.floats(0.01, 5.0) | st.floats(0.498, 0.503), max_size=20))
def test_speeds_are_one_if_and_only_if_they_print_alike(velocities: list[float]) -> None:
    groups = by_speed(velocities)
    assert sorted(i for group in groups.values() for i in group) == list(range(len(velocities)))
    assert list(groups) == sorted(groups)
    for speed, group in groups.items():
        assert {f"{velocities[i]:.3g}" for i in group} == {f"{speed:.3g}"}


@pytest.mark.parametrize("name", names("robots"))
def test_every_robot_is_read_with_a_byte_order_mark_too(name: str, tmp_path: Path) -> None:
    text = (CATALOGUE / "robots" / f"{name}.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text("\ufeff" + text, encoding="utf-8")
    assert load_robot(tmp_path / "mine.toml").wheels == load_robot(name).wheels


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("radius_m = 0.0965", 'radius_m = "large"', "radius_m"),
        ("radius_m = 0.0965", "radius_mm = 96.5", "radius_mm"),
        ("[chassis]", "[chasis]", "[chasis]"),
    ],
)
def test_a_wrong_key_is_named_with_its_line(old: str, new: str, key: str, tmp_path: Path) -> None:
    text = (CATALOGUE / "robots" / "granite.toml").read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "mine.toml"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    line = next(n for n, row in enumerate(file.read_text().splitlines(), 1) if row.startswith(key))
    with pytest.raises(InputError) as refusal:
        load_robot(file)
    assert refusal.value.message.startswith(f"{file}:{line}: ")


def test_every_parameter_in_force_has_unit_range_and_origin() -> None:
    rows = in_force("granite", "dry_sand")
    assert len({(r.group, r.key) for r in rows}) == len(rows) > 50
    for row in rows:
        assert row.low <= row.value <= row.high
        assert row.meaning
        assert row.origin.endswith(".toml") or row.origin == "default"
    origins = {(r.group, r.key): r.origin for r in rows}
    assert origins["robot.wheels", "radius_m"] == "catalogue/robots/granite.toml"
    assert origins["robot.imu_grade", "rate_hz"] == "catalogue/imu_grades.toml"
    assert origins["soil", "exponent"] == "catalogue/soils/dry_sand.toml"


def test_robot_and_soil_are_found_by_the_names_that_files_beside_the_log_state(tmp_path: Path) -> None:
    sample = Path(__file__).parents[2] / "data" / "samples" / "virtual_v0.3_r1.csv"
    text = sample.read_text("utf-8").replace('robot = "granite"', 'robot = "rover"')
    log = tmp_path / "log.csv"
    log.write_text(text.replace('soil = "dry_sand"', 'soil = "bed"'), "utf-8")
    (tmp_path / "broken.toml").write_text("name = ", "utf-8")
    with pytest.raises(UsageError, match="unknown robot 'rover'"):
        read_trial(log)
    for kind, name, own, file in (
        ("robots", "granite", "rover", "robot.toml"), ("soils", "dry_sand", "bed", "soil.toml"),
    ):  # fmt: skip
        entry = (CATALOGUE / kind / f"{name}.toml").read_text("utf-8")
        assert f'name = "{name}"' in entry
        (tmp_path / file).write_text(entry.replace(f'name = "{name}"', f'name = "{own}"', 1), "utf-8")
    trial = read_trial(log)
    assert (trial.info.robot, trial.info.soil) == (
        str(tmp_path / "robot.toml"), str(tmp_path / "soil.toml"),
    )  # fmt: skip
    assert load_robot(trial.info.robot or "").wheels == load_robot().wheels
