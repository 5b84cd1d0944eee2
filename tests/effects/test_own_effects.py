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


@pytest.mark.parametrize(
    "text",
    ['(("force", "other"),)', '("force", "force")', "3", "((1, 2),)", '(("force", []),)', '(("force",),)'],
)
def test_circles_are_pairs_of_parameters(tmp_path: Path, text: str) -> None:
    file = tmp_path / "my_effect.py"
    file.write_text(EXAMPLE.replace("    source =", f"    circles = {text}\n    source ="))
    with pytest.raises(InputError, match="not a pair of parameters"):
        load_effects(file)
