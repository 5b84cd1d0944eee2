"""Broken column maps, robots, soils, models and effect files: one line, a hint and the exit code."""

# ruff: noqa: E501  # tables, one broken file a line

from functools import partial
from pathlib import Path

import pytest

from tests.corpus.cli import GRANITE, LOG, SAND, lab, refused
from tests.effects.example import EXAMPLE
from tests.logs import make

MAP = """name = "mine"
[[column]]
name = "t_s"
to = ["t"]
unit = "s"
[[column]]
name = "imu_ax_mps2"
to = ["imu_ax"]
unit = "m/s^2"
[[column]]
name = "enc_fl_rad"
to = ["enc_fl"]
unit = "rad"
"""

# name: (content, what the message says, what the hint says)
Cases = dict[str, tuple[str | bytes, str, str]]

MAPS: Cases = {
    "empty": ("", "'name' is missing", "add name"),
    "no columns": ('name = "a"\n', "'column' is missing", "column"),
    "not TOML": ("name = mine\n", "not valid TOML", "toml.io"),
    "UTF-16": (MAP.encode("utf-16"), "is not UTF-8 text", "UTF-8"),
    "unknown key": ("nme = 3\n" + MAP, "unknown key 'nme'", "did you mean 'name'?"),
    "unknown key of a column": (MAP.replace('unit = "rad"', 'unit = "rad"\nscal = 2'), "unknown key 'scal'", "did you mean 'scale'?"),
    "no clock": (MAP.replace('to = ["t"]', 'to = ["v_cmd"]').replace('unit = "s"', 'unit = "m/s"'), "no column feeds 't'", "to ="),
    "unknown channel": (MAP.replace('"imu_ax"', '"imu_aq"'), "unknown channel 'imu_aq'", "imu_ax"),
    "no unit": (MAP.replace('unit = "rad"', ""), "the unit is missing", ""),
    "unknown unit": (MAP.replace('unit = "rad"', 'unit = "radian/h"'), "unit 'radian/h' is not known", ""),
    "unit of another kind": (MAP.replace('unit = "rad"', 'unit = "A"'), "unit 'A' is one of current", "expected one of"),
    "neither name nor pattern": (MAP.replace('name = "enc_fl_rad"', ""), "needs either 'name' or 'pattern'", "which column"),
    "name and pattern": (MAP.replace('name = "enc_fl_rad"', 'name = "a"\npattern = "b"'), "needs either 'name' or 'pattern'", "which column"),
    "not a regular expression": (MAP.replace('name = "enc_fl_rad"', "pattern = '('"), "is not a regular expression", "quotes"),
    "scale of zero": (MAP.replace('unit = "rad"', 'unit = "rad"\nscale = 0'), "scale = 0", "leave it out"),
    "scale as text": (MAP.replace('unit = "rad"', 'unit = "rad"\nscale = "two"'), "scale = 'two' is not a number", "expected a number"),
    "negative wrap": (MAP.replace('unit = "rad"', 'unit = "rad"\nwrap = -5'), "wrap = -5 is out of range", "expected a number"),
    "channels as a text": (MAP.replace('to = ["t"]', 'to = "t"'), "is not a list", "write it as"),
    "columns as a table": ('name = "a"\n[column]\nname = "t"\n', "'column' must be a list of tables", "[[column]]"),
    "a flag as a number": (MAP.replace('unit = "rad"', 'unit = "rad"\noptional = 1'), "neither true nor false", "write true or false"),
    "unknown delimiter": (MAP + '[table]\ndelimiter = "&"\n', "delimiter = '&' is not known", "one of"),
    "of another log": (MAP.replace("enc_fl_rad", "wheel_1"), "column 'wheel_1' is missing", ""),
}  # fmt: skip


def changed(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


robot, soil = partial(changed, GRANITE), partial(changed, SAND)


ROBOTS: Cases = {
    "empty": ("", "'name' is missing", "add name"),
    "only a name": ('name = "a"\ntitle = "A"\n', "'wheels' is missing", "wheels"),
    "not TOML": (robot("[wheels]", "[wheels"), "not valid TOML", "toml.io"),
    "a duplicate key": (robot("radius_m = 0.0965", "radius_m = 0.0965\nradius_m = 0.1"), "not valid TOML", "toml.io"),
    "negative mass": (robot("body_mass_kg = 36.54", "body_mass_kg = -36.54"), "body_mass_kg = -36.54 is out of range", "from 0.1 to 2000 kg"),
    "NaN": (robot("body_mass_kg = 36.54", "body_mass_kg = nan"), "body_mass_kg = nan is out of range", "kg"),
    "a text": (robot("body_mass_kg = 36.54", 'body_mass_kg = "36.54 kg"'), "is not a number", "kg"),
    "a truth value": (robot("body_mass_kg = 36.54", "body_mass_kg = true"), "is not a number", "kg"),
    "missing key": (robot("body_mass_kg = 36.54", ""), "'body_mass_kg' is missing", "add body_mass_kg"),
    "no unit in the key": (robot("body_mass_kg", "body_mass"), "unknown key 'body_mass'", "did you mean 'body_mass_kg'?"),
    "another unit in the key": (robot("radius_m = 0.0965", "radius_mm = 96.5"), "unknown key 'radius_mm'", "did you mean 'radius_m'?"),
    "misspelt table": (robot("[chassis]", "[chasis]"), "unknown key 'chasis'", "did you mean 'chassis'?"),
    "a table as a number": ('name = "a"\ntitle = "A"\nwheels = 3\n', "'wheels' must be a table", "[wheels]"),
    "an unknown IMU grade": (robot('grade = "industrial"', 'grade = "golden"'), "unknown IMU grade 'golden'", "industrial"),
    "an unknown forward axis": (robot('grade = "industrial"', 'grade = "industrial"\nforward = "up"'), "forward = 'up' is not known", "given"),
    "a number as a name": (robot('name = "granite"', "name = 7"), "name = 7 is not a text", "quotes"),
}  # fmt: skip

SOILS: Cases = {
    "empty": ("", "'name' is missing", "add name"),
    "a robot": (GRANITE, "unknown key", ""),
    "an angle in radians": (soil("friction_angle_deg = 30", "friction_angle_deg = 0.52"), "friction_angle_deg = 0.52 is out of range", "5 to 60 deg"),
    "unknown key": (soil("cohesion_Pa", "cohesiom_Pa"), "unknown key 'cohesiom_Pa'", "did you mean"),
}  # fmt: skip

MODEL = """schema = "granite-lab/model/1"
robot = "granite"
soil = "dry_sand"
[k92]
law = "exponential"
value = 4.9
[[effect]]
id = "drive_reaction"
[effect.parameters]
share = { value = 1.0, std = 0.1 }
"""

MODELS: Cases = {
    "empty": ("", "schema = None is not that of a model file", "granite-lab/model/3"),
    "a robot": (GRANITE, "unknown key", ""),
    "a later schema": (MODEL.replace("model/1", "model/9"), "schema = 'granite-lab/model/9'", "granite-lab/model/3"),
    "no robot": (MODEL.replace('robot = "granite"\n', ""), "'robot' is missing", "add robot"),
    "no soil": (MODEL.replace('soil = "dry_sand"\n', ""), "'soil' is missing", "add soil"),
    "an unknown robot": (MODEL.replace('"granite"\n', '"granit"\n'), "robot: unknown robot 'granit'", "granite"),
    "a robot's file that is not there": (MODEL.replace('"granite"\n', '"mine.toml"\n'), "mine.toml: cannot be read", ""),
    "a soil's file that is not there": (MODEL.replace('"dry_sand"', '"mine.toml"'), "mine.toml: cannot be read", ""),
    "no k92": (MODEL.replace('[k92]\nlaw = "exponential"\nvalue = 4.9\n', ""), "[k92] is missing", "add [k92]"),
    "an unknown law": (MODEL.replace('"exponential"', '"cubic"'), "law = 'cubic' is not known", "exponential, constant"),
    "a law without a value": (MODEL.replace("value = 4.9\n", ""), "'value' is missing", "add value"),
    "an unknown table": (MODEL.replace("[k92]", "[k29]"), "unknown key 'k29'", "k92"),
    "another unit": (MODEL.replace("std = 0.1", 'unit = "deg"'), "unit = 'deg' does not fit", ""),
    "an unknown effect": (MODEL.replace('"drive_reaction"', '"drive_reactoin"'), "unknown effect 'drive_reactoin'", "did you mean 'drive_reaction'"),
    "an unknown parameter": (MODEL.replace("share =", "shar ="), "unknown key 'shar'", "did you mean 'share'"),
    "a size out of bounds": (MODEL.replace("value = 1.0", "value = 1000.0"), "share: value = 1000 is out of range", "from "),
    "a size as a bare number": (MODEL.replace("{ value = 1.0, std = 0.1 }", "1.0"), "must hold a table for each parameter", "value"),
    "an effect twice": (MODEL + MODEL[MODEL.index("[[effect]]") :], "is listed twice", "keep one"),
    "effects as a table": (MODEL.replace("[[effect]]", "[effect]").replace("[effect.parameters]", "[effect.p]"), "'effect' must be a list of tables", "[[effect]]"),
    "an effect without an id": (MODEL.replace('id = "drive_reaction"\n', ""), "'id' is missing", "add id"),
    "provenance as a text": (MODEL.replace("[k92]", 'provenance = "me"\n[k92]'), "'provenance' must be a table", "[provenance]"),
}  # fmt: skip

HOOK = '        return replace(load, x=load.x - own.p["force"])\n'
assert HOOK in EXAMPLE

EFFECTS: Cases = {
    "empty": ("", "defines no effect", "subclass"),
    "not Python": ("effect = (\n", ":1: not valid Python", "Python module"),
    "not UTF-8": (b"a = '\xff\xfe'\n", "not valid Python", "Python module"),
    "raises at once": ("raise RuntimeError('no \\n sand')\n", ":1: RuntimeError: no sand", "docs/effects.md"),
    "ends the process": ("import sys\nsys.exit(0)\n", ":2: SystemExit: 0", "docs/effects.md"),
    "imports what is not there": ("import granite_sand\n", ":1: ModuleNotFoundError", "docs/effects.md"),
    "a hook that raises": (EXAMPLE.replace(HOOK, "        raise ValueError('wind')\n"), ":22: effect 'head_wind': ValueError: wind", "docs/effects.md"),
    "a hook that returns nothing": (EXAMPLE.replace(HOOK, "        return None\n"), "AttributeError", "docs/effects.md"),
    "a hook that divides by zero": (EXAMPLE.replace(HOOK, "        return replace(load, x=1 / 0)\n"), "ZeroDivisionError", "docs/effects.md"),
    "a hook that makes NaN": (EXAMPLE.replace(HOOK, "        return replace(load, x=load.x * float('nan'))\n"), "do not give the paper's model", "neutral"),
    "a hook that acts at neutral values": (EXAMPLE.replace(HOOK, "        return replace(load, x=load.x - 1)\n"), "do not give the paper's model", "neutral"),
    "no source": (EXAMPLE.replace("source =", "origin ="), "'source' is missing", ""),
    "a neutral value out of bounds": (EXAMPLE.replace("-50.0, 50.0, 0.0,", "1.0, 50.0, 0.0,"), "neutral 0 is out", "low, high, neutral"),
    "an expected range out of bounds": (EXAMPLE.replace("1.0, 10.0)", "1.0, 60.0)"), "prior range 1 to 60", "expected from"),
    "an unknown hook": (EXAMPLE.replace("def body_load", "def body_lod"), "'body_lod' is not a hook", "did you mean 'body_load'?"),
    "an id of the library": (EXAMPLE.replace('"head_wind"', '"ground_slope"'), "belongs to an effect of the library", "another id"),
    **{
        f"circles = {text}": (EXAMPLE.replace("    source =", f"    circles = {text}\n    source ="), "not a pair of parameters", "")
        for text in ('(("force", "other"),)', '("force", "force")', "3", "((1, 2),)", '(("force", []),)', '(("force",),)')
    },
    "an id with markup": (EXAMPLE.replace('"head_wind"', '"<script>"'), "the id is not usable", "small letters"),
}  # fmt: skip


# kind: (cases, name of the file, commands that take it)
SIMULATE = ("simulate", "--variant", "0.5", "--out", "OUT")
KINDS: dict[str, tuple[Cases, str, tuple[tuple[str, ...], ...]]] = {
    "map": (MAPS, "map.toml", (("ingest", "LOG", "--out", "OUT", "--jobs", "1", "--map"),)),
    "robot": (ROBOTS, "robot.toml", (("params", "--robot"), (*SIMULATE, "--robot"))),
    "soil": (SOILS, "soil.toml", ((*SIMULATE, "--soil"),)),
    "model": (MODELS, "model.toml", ((*SIMULATE, "--model"),)),
    "effect": (EFFECTS, "mine.py", (("effects", "--effects"),)),
}


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind, (cases, *_) in KINDS.items() for name in cases]
)
def test_a_broken_file_is_refused_in_one_line(kind: str, name: str, tmp_path: Path) -> None:
    cases, called, commands = KINDS[kind]
    content, error, hint = cases[name]
    log, path = make.written(tmp_path, LOG, "trial.csv"), make.written(tmp_path, content, called)
    out = tmp_path / "out.csv"
    for command in commands:
        done = lab(*({"LOG": log, "OUT": out}.get(word, word) for word in command), path)
        refused(done, 2 if kind == "robot" and "grade" in name else 3, error, hint)
        assert str(tmp_path) in done.error or kind == "robot"
    assert not out.exists()


def test_the_files_that_the_cases_start_from_are_good(tmp_path: Path) -> None:
    log, own = make.written(tmp_path, LOG, "trial.csv"), make.written(tmp_path, MAP, "map.toml")
    assert lab("inspect", log, "--map", own).code == 0
    for text, option in ((GRANITE, "--robot"), (SAND, "--soil")):
        assert lab("params", option, make.written(tmp_path, text, f"x{option}.toml")).code == 0
    model = make.written(tmp_path, MODEL, "model.toml")
    assert lab("simulate", "--variant", "0.5", "--model", model, "--out", tmp_path / "run.csv").code == 0
    assert lab("effects", "--effects", make.written(tmp_path, EXAMPLE, "mine.py")).code == 0
