"""model.toml comes back as it was written, and what is wrong in it is named."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from granite_lab.effects import get, load_effects
from granite_lab.effects.model_file import FittedEffect, ModelFile, load_model, save_model
from granite_lab.errors import InputError
from granite_lab.estimate import Estimate
from granite_lab.parameters.quantity import toml
from tests.effects.example import EXAMPLE

MODEL = ModelFile(
    "granite",
    "dry_sand",
    "exponential",
    Estimate(4.87, 0.04),
    (
        FittedEffect(
            get("tyre_windup"),
            {
                "compliance": Estimate(2.1e-3, 1e-4),
                "retardation": Estimate(0.012, 0.003),
                "tread_share": Estimate(0.18, 0.05),
            },
            ("clock_offset",),
        ),
        FittedEffect(get("drive_reaction"), {"share": Estimate(0.97)}),
    ),
    {"version": "0.1.0", "trials": ['a "quoted".csv', "ß.csv"], "seed": 7, "inputs": {"a.csv": "12ab"}},
)


def test_a_model_comes_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    save_model(MODEL, path)
    back = load_model(path)
    assert math.isnan(back.fitted[1].values["share"].std)
    assert repr(back) == repr(MODEL)  # NaN differs from itself, its text does not
    assert [a.id for a in back.effects] == ["tyre_windup", "drive_reaction"]
    assert back.effects[0].as_dict() == {"compliance": 2.1e-3, "retardation": 0.012, "tread_share": 0.18}
    assert (back.k92, back.a_theta) == (None, 4.87)


@settings(max_examples=200, deadline=None)
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
    effect = load_effects(code)["head_wind"]
    save_model(
        ModelFile(
            "granite",
            "dry_sand",
            "constant",
            Estimate(0.2),
            (FittedEffect(effect, {"force": Estimate(3.0)}),),
        ),
        path,
    )
    assert load_model(path, code).effects[0].as_dict() == {"force": 3.0}
    assert load_model(path, code).k92 == 0.2
    with pytest.raises(
        InputError, match=r"model\.toml: \[\[effect\]\] 1: unknown effect 'head_wind'"
    ) as caught:
        load_model(path)
    assert "--effects" in caught.value.hint
