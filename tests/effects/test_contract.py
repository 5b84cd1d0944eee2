"""Every effect keeps the contract; its file and its model file say what it does."""

import json
import math
import re
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.effects_page import markdown
from granite_lab.effects import get, library, load_effects
from granite_lab.effects.contract import CHANNELS, Check, contract, typical
from granite_lab.effects.library import neutral_gap, read_effects
from granite_lab.effects.model_file import FittedEffect, ModelFile, load_model, save_model
from granite_lab.errors import InputError
from granite_lab.estimate import Estimate
from granite_lab.model import interpreted, simulate
from granite_lab.model.effect import activate
from granite_lab.model.run import Run
from granite_lab.parameters import Variant, load_variants
from granite_lab.parameters.quantity import toml
from tests.corpus.cli import ROOT, lab, succeeded
from tests.effects.example import EXAMPLE
from tests.effects.runs import ROBOT, SOIL, run, variant_of
from tests.soak import examples

NOISE = dict(zip(CHANNELS, (0.05, 0.07, 0.003, 3e-5, 3e-5, 0.05, 0.05), strict=True))
"""Of a single sample (encoders: half a count)."""


@pytest.mark.parametrize("effect_id", library())
def test_an_effect_of_the_library_keeps_the_contract(effect_id: str) -> None:
    checks = contract(get(effect_id))
    assert len(checks) == 12
    assert [c for c in checks if c.passed is False] == []
    # the library's effects are the paper's model to the last digit, not only to rounding
    assert neutral_gap(get(effect_id)) == 0.0


@cache
def of_the_paper(variant: Variant) -> Run:
    return simulate(variant, ROBOT, SOIL)


@pytest.mark.parametrize("effect_id", library())
def test_a_typical_strength_shows_in_some_channel(effect_id: str) -> None:
    active = typical(get(effect_id))

    def largest(variant: Variant) -> float:
        plain, run = of_the_paper(variant), simulate(variant, ROBOT, SOIL, effects=(active,))
        return max(float(np.abs(run[c] - plain[c]).max()) / NOISE[c] for c in CHANNELS)

    assert any(largest(variant) > 1 for variant in load_variants())


def test_effects_add_up() -> None:
    """Several at once: the graph is built, each acts, and the order changes little."""
    pair = [typical(get(i)) for i in ("tyre_windup", "drive_reaction", "gear_backlash", "clock_offset")]
    a, b = (simulate(load_variants()[2], ROBOT, SOIL, effects=tuple(e)) for e in (pair, pair[::-1]))
    np.testing.assert_allclose(a["v_mps"], b["v_mps"], rtol=0, atol=5e-4)


def checks_of(tmp_path: Path, source: str) -> dict[str, Check]:
    file = tmp_path / "my_effect.py"
    file.write_text(source)
    (effect,) = read_effects(file).values()
    return {c.name: c for c in contract(effect)}


FORCE = 'x=load.x - own.p["force"]'


@pytest.mark.parametrize(
    ("old", "new", "name", "said"),
    [
        ('"wind against the robot"', '"wind"', "title and signature are given", "title: one word"),
        ('"a fan in front of the sand box"', '"todo"', "source is given", "does not say where"),
        ('"force of the wind"', '" "', "parameters have unit, meaning, bounds and an expected range",
         "meaning is missing"),
        (FORCE, 'x=load.x - 1e-3 - own.p["force"]', "neutral values give the paper's model", "difference"),
        (FORCE, 'x=load.x - 1e-3 - own.p["force"]', "a neutral run equals the paper's", "difference"),
        (FORCE, 'x=load.x - own.p["force"] * (body.x_rate**2) ** 0.25', "derivatives are finite",
         "at rest with force = 0: a derivative is not a number"),
        (FORCE, 'x=load.x - 1e-12 * own.p["force"]', "a typical size changes the readings", "changes"),
        (FORCE, 'x=load.x - 100 * own.p["force"]', "runs over the expected range converge", "force = "),
        (FORCE, 'x=load.x - own.p["force"] * erf(body.x_rate)', "machine code gives the same run",
         "is not compiled"),
        (FORCE, 'x=load.x - own.p["sail"]', "a typical size changes the readings", "KeyError: 'sail'"),
    ],
)  # fmt: skip
def test_a_breach_is_seen_and_told(tmp_path: Path, old: str, new: str, name: str, said: str) -> None:
    assert old in EXAMPLE
    source = EXAMPLE.replace(old, new).replace("from dataclasses", "from casadi import erf\nfrom dataclasses")
    found = checks_of(tmp_path, source)[name]
    assert found.passed is False
    assert said in found.detail


def test_a_parameter_that_is_declared_linear_is_held_to_it(tmp_path: Path) -> None:
    declared = EXAMPLE.replace("1.0, 10.0)", "1.0, 10.0, linear=True)")
    for source, passed in ((declared, True), (declared.replace(FORCE, f"{FORCE} ** 2"), False)):
        found = checks_of(tmp_path, source)["traces of parameters declared linear are proportional"]
        assert found.passed is passed
        assert "differs from proportional by" in found.detail


def test_where_there_is_no_compiler_that_check_is_left_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("granite_lab.effects.contract.engine_of", lambda _: interpreted)
    last = contract(get("ground_slope"))[-1]
    assert last.passed is None
    assert "no compiler" in last.detail


def test_the_command_reports_every_check_and_ends_with_3_on_failure(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.py", tmp_path / "bad.py"
    good.write_text(EXAMPLE)
    bad.write_text(EXAMPLE.replace("sand box", "x").replace('"a fan in front of the x"', '"none"'))
    done = succeeded("effects", "check", good, "--json")
    checks = json.loads(done.out)["effects"]["head_wind"]
    assert [c["passed"] for c in checks].count(True) == 10
    done = lab("effects", "check", bad)
    assert done.code == 3
    assert "FAILED" in done.out
    assert done.err.splitlines()[0].startswith(f"error: {bad}: effect 'head_wind': 1 of 12 checks failed")
    assert lab("effects", "check", "no_such_effect").code == 2


def test_the_page_of_effects_is_what_the_effects_say() -> None:
    page = ROOT / "docs" / "effects.md"
    assert page.read_text(encoding="utf-8") == markdown(), "python -m benchmarks.effects_page"


def test_an_effect_file_is_loaded_and_acts(tmp_path: Path) -> None:
    file = tmp_path / "my_effect.py"
    file.write_text(EXAMPLE)
    effects = load_effects(file)
    assert list(effects) == ["head_wind"]
    assert load_effects(file)["head_wind"] is effects["head_wind"]  # one graph serves all runs
    windy = simulate(variant_of(0.5), ROBOT, SOIL, effects=(activate(effects["head_wind"], {"force": 5.0}),))
    assert windy.slip_ratio > run().slip_ratio + 0.005
    assert windy.effects == {"head_wind": {"force": 5.0}}


WOUND = {
    "compliance": Estimate(2.1e-3, 1e-4), "retardation": Estimate(0.012, 0.003),
    "tread_share": Estimate(0.18, 0.05),
}  # fmt: skip
REACTION = FittedEffect(get("drive_reaction"), {"share": Estimate(0.97)})
FITTED = (FittedEffect(get("tyre_windup"), WOUND, ("clock_offset",)), REACTION)
TOLD = {"version": "0.1.0", "trials": ['a "quoted".csv', "ß.csv"], "seed": 7, "inputs": {"a.csv": "12ab"}}
GROUND = {"friction_angle": Estimate(28.4, 0.6), "frictional_modulus": Estimate(1.6e6, 4e4)}
MODEL = ModelFile("granite", "dry_sand", "exponential", Estimate(4.87, 0.04), FITTED, TOLD, GROUND)


def test_a_model_comes_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    save_model(MODEL, path)
    back = load_model(path)
    assert math.isnan(back.fitted[1].values["share"].std)
    assert repr(back) == repr(MODEL)  # NaN differs from itself, its text does not
    assert [a.id for a in back.effects] == ["tyre_windup", "drive_reaction"]
    assert back.effects[0].as_dict() == {"compliance": 2.1e-3, "retardation": 0.012, "tread_share": 0.18}
    assert (back.k92, back.a_theta) == (None, 4.87)
    assert (back.ground.friction_angle, back.ground.frictional_modulus) == (28.4, 1.6e6)
    assert back.ground.shear_modulus == SOIL.shear_modulus


@pytest.mark.parametrize("version", [1, 2])
def test_a_model_of_an_earlier_version_is_read(tmp_path: Path, version: int) -> None:
    path = tmp_path / "model.toml"
    save_model(replace(MODEL, sand={}), path)
    path.write_text(path.read_text().replace("granite-lab/model/3", f"granite-lab/model/{version}"))
    assert load_model(path).ground == SOIL
    path.write_text(path.read_text().replace(f"granite-lab/model/{version}", "granite-lab/model/9"))
    with pytest.raises(InputError, match="schema = 'granite-lab/model/9' is not that of a model file"):
        load_model(path)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("friction_angle = { value = 30.0 }", "unknown key 'friction_angle'"),
        ("friction_angle_deg = { value = 90.0 }", "value = 90 is out of range"),
        ("friction_angle_deg = { std = 1.0 }", "'value' is missing"),
        ("friction_angle_deg = 30.0", "is not a table of numbers"),
    ],
)
def test_a_wrong_number_of_the_sand_is_told(tmp_path: Path, row: str, said: str) -> None:
    path = tmp_path / "model.toml"
    save_model(replace(MODEL, sand={}), path)
    path.write_text(f"{path.read_text()}\n[sand]\n{row}\n")
    with pytest.raises(InputError, match=re.escape(said)):
        load_model(path)


@settings(max_examples=examples(200))
@given(
    st.recursive(
        st.booleans() | st.integers(-(2**53), 2**53) | st.floats(allow_nan=False) | st.text(
            st.characters(exclude_categories=["Cs"])
        ),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(
            st.characters(exclude_categories=["Cs"])), inner, max_size=3),
        max_leaves=6,
    )
)  # fmt: skip
def test_every_value_is_read_back_from_the_toml_written(value: object) -> None:
    assert tomllib.loads(f"v = {toml(value)}")["v"] == value


def test_an_effect_of_one_s_own_needs_its_file(tmp_path: Path) -> None:
    code, path = tmp_path / "my_effect.py", tmp_path / "model.toml"
    code.write_text(EXAMPLE)
    fitted = (FittedEffect(load_effects(code)["head_wind"], {"force": Estimate(3.0)}),)
    save_model(ModelFile("granite", "dry_sand", "constant", Estimate(0.2), fitted), path)
    assert load_model(path, code).effects[0].as_dict() == {"force": 3.0}
    assert load_model(path, code).k92 == 0.2
    with pytest.raises(InputError, match=r"\[\[effect\]\] 1: unknown effect 'head_wind'") as caught:
        load_model(path)
    assert "--effects" in caught.value.hint
