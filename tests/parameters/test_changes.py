"""Numbers that are set in place of those of a file act as another file would."""

from pathlib import Path

import pytest

import granite_lab as gl
from granite_lab.effects.model_file import ModelFile, load_model, save_model
from granite_lab.errors import InputError
from granite_lab.estimate import Estimate
from granite_lab.parameters.catalogue import in_force, load_robot
from granite_lab.parameters.changes import checked, quantities
from tests.corpus.cli import GRANITE, SAMPLES
from tests.running.processes import short

RADIUS, COHESION = "robot.wheels.radius_m", "soil.cohesion_Pa"
LOG = SAMPLES / "virtual_v0.3_r1.csv"


def test_every_number_in_force_can_be_set_within_the_bounds_that_are_listed() -> None:
    rows = {f"{p.group}.{p.key}": p for p in in_force("granite", "dry_sand")}
    assert rows.keys() == {key for key in quantities() if not key.startswith("robot.tow.")}  # it tows nothing
    for key, row in rows.items():
        assert checked({key: row.high}) == ((key, row.high),)
        with pytest.raises(InputError, match="out of range"):
            checked({key: row.high + max(1.0, abs(row.high))})
    (changed,) = (
        p for p in in_force("granite", "dry_sand", changes=((RADIUS, 0.106),)) if p.key == "radius_m"
    )
    assert (changed.value, changed.origin) == (0.106, "--set")


@pytest.mark.parametrize("key", ["robot.wheels.radius", "wheels.radius_m", "robot.wheel.radius_m"])
def test_an_unknown_key_is_told_the_nearest_one(key: str) -> None:
    with pytest.raises(InputError, match=f"unknown key '{key}'") as raised:
        checked({key: 0.1})
    assert RADIUS in raised.value.hint


def test_a_part_that_the_robot_lacks_cannot_be_set() -> None:
    with pytest.raises(InputError, match="the file of 'kobuki' has no"):
        load_robot("kobuki", changes=(("robot.chassis.track_m", 1.0),))


def test_a_number_that_is_set_acts_as_in_a_file_of_ones_own(tmp_path: Path) -> None:
    own = tmp_path / "mine.toml"
    own.write_text(GRANITE.replace("radius_m = 0.0965", "radius_m = 0.106"), encoding="utf-8")
    change, log = {RADIUS: 0.106}, tmp_path / "short.csv"
    log.write_text(short("short_v0.5_r1"), encoding="utf-8")
    filed, given = (gl.ingest(log, jobs=1, **said)[0] for said in ({"robot": own}, {"changes": change}))  # type: ignore[arg-type]
    assert given.robot.wheels.radius == 0.106
    assert given.to_frame().equals(filed.to_frame())
    assert gl.simulate(0.5, changes=change).to_frame().equals(gl.simulate(0.5, robot=own).to_frame())
    assert gl.wheel(0.2, load=80, changes={COHESION: 500}).soil.cohesion == 500


def test_a_model_file_keeps_what_was_set(tmp_path: Path) -> None:
    changes = checked({RADIUS: 0.106, COHESION: 500})
    model = ModelFile("granite", "dry_sand", "exponential", Estimate(4.9, 0.1), changes=changes)
    save_model(model, tmp_path / "model.toml")
    read = load_model(tmp_path / "model.toml")
    assert read == model
    assert (read.machine.wheels.radius, read.ground.cohesion) == (0.106, 500)
