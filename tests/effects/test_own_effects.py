"""A user's own effect file is a full citizen, and trouble in it is told with file and line."""

from __future__ import annotations

from pathlib import Path

import pytest

from granite_lab.effects import load_effects
from granite_lab.effects.documentation import markdown
from granite_lab.errors import InputError
from granite_lab.model import simulate
from granite_lab.model.effect import activate
from tests.effects.example import EXAMPLE
from tests.effects.runs import CHASSIS, ROBOT, SOIL, run, variant_of

DOCS = Path(__file__).parents[2] / "docs" / "effects.md"


def test_the_page_of_effects_is_what_the_effects_say() -> None:
    assert DOCS.read_text(encoding="utf-8") == markdown(), "python -m granite_lab.effects.documentation"


def test_an_effect_file_is_loaded_and_acts(tmp_path: Path) -> None:
    file = tmp_path / "my_effect.py"
    file.write_text(EXAMPLE)
    effects = load_effects(file)
    assert list(effects) == ["head_wind"]
    assert load_effects(file)["head_wind"] is effects["head_wind"]  # one graph serves all runs
    windy = simulate(variant_of(0.5), ROBOT, SOIL, effects=(activate(effects["head_wind"], {"force": 5.0}),))
    assert windy.slip_ratio > run().slip_ratio + 0.005
    assert windy.effects == {"head_wind": {"force": 5.0}}
    assert CHASSIS.total_mass > 40


HEADER = EXAMPLE.replace('        return replace(load, x=load.x - own.p["force"])\n', "")


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("x = (\n", r"my_effect\.py:1: not valid Python"),
        ("import nowhere_at_all\n", r"my_effect\.py:1: ModuleNotFoundError"),
        ("a = 1\n", r"my_effect\.py: defines no effect"),
        (HEADER + "        return load.wind\n", r"my_effect\.py:22: effect 'head_wind': AttributeError"),
        (HEADER + "        return replace(load, x=load.x - 1)\n", "do not give the paper's model"),
        (EXAMPLE.replace('"head_wind"', '"multi_pass"'), "belongs to an effect of the library"),
        (EXAMPLE.replace('"head_wind"', '"Head Wind"'), "the id is not usable"),
        (EXAMPLE.replace("source =", "origin ="), "'source' is missing"),
        (EXAMPLE.replace("def body_load", "def body_loads"), "'body_loads' is not a hook"),
        (EXAMPLE.replace("-50.0, 50.0, 0.0, 1.0, 10.0", "1.0, 50.0, 0.0, 1.0, 10.0"), "neutral 0 is out"),
        (EXAMPLE.replace("1.0, 10.0)", "1.0, 60.0)"), "prior range 1 to 60"),
        *(
            (
                EXAMPLE.replace("    source =", f"    circles = {text}\n    source ="),
                "not a pair of parameters",
            )
            for text in (
                '(("force", "other"),)',
                '("force", "force")',
                "3",
                "((1, 2),)",
                '(("force", []),)',
                '(("force",),)',
            )
        ),
    ],
)
def test_trouble_in_the_file_is_told(tmp_path: Path, source: str, said: str) -> None:
    file = tmp_path / "my_effect.py"
    file.write_text(source)
    with pytest.raises(InputError, match=said):
        load_effects(file)


def test_a_hook_that_is_not_there_is_answered_with_the_one_that_was_meant(tmp_path: Path) -> None:
    file = tmp_path / "my_effect.py"
    file.write_text(EXAMPLE.replace("def body_load", "def bodyload"))
    with pytest.raises(InputError) as caught:
        load_effects(file)
    assert "did you mean 'body_load'?" in caught.value.hint


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        load_effects(tmp_path / "none.py")
