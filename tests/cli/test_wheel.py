"""`granite-lab wheel` and `gl.wheel`: tables, pictures, and what is said of a line that does not fit."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

import granite_lab as gl
from granite_lab.errors import InputError, LabError, UsageError
from granite_lab.model.single_wheel import FORCES
from granite_lab.parameters import GRAVITY
from tests.corpus.cli import lab, refused, succeeded, told


def test_a_sweep_becomes_a_table_and_a_picture(tmp_path: Path) -> None:
    out, plot, arc = tmp_path / "sweep.csv", tmp_path / "sweep.svg", tmp_path / "arc.csv"
    words = ["--slip", "-0.4:0.8:0.2", "--k92", "0.3", "--load", "60", "--effect", "bulldozing.strength=0.5"]
    shown = succeeded("wheel", *words, "--out", out, "--plot", plot, "--arc", arc).out
    assert "with bulldozing: strength = 0.5" in shown
    table = pd.read_csv(out)
    assert table["slip"].tolist() == pytest.approx([-0.4, -0.2, 0, 0.2, 0.4, 0.6, 0.8])
    assert table["load_N"].tolist() == pytest.approx([60] * 7)
    assert table["drawbar_pull_N"].is_monotonic_increasing
    assert "sinkage [mm]" in plot.read_text()
    stresses = pd.read_csv(arc)
    assert len(stresses) == 7 * 101
    assert (stresses["normal_stress_Pa"] >= 0).all()


def test_json_holds_what_the_function_returns(tmp_path: Path) -> None:
    printed = told("wheel", "--slip", "0.2", "--sinkage", "12", "--k92", "0.4")
    found = gl.wheel(0.2, sinkage=0.012, k92=0.4)
    assert printed["points"] == [pytest.approx(row) for row in found.to_frame().to_dict("records")]
    assert printed["wheel"]["radius"] == 0.0965
    assert len(FORCES) == 8


def test_a_quarter_of_the_robot_and_the_law_of_the_paper_are_the_default() -> None:
    one = gl.wheel(0.2, v=0.4).points[0]
    assert one.load == pytest.approx(43.1 * GRAVITY / 4)
    assert one.k92 == pytest.approx(2.718281828 ** (-4.919 * 0.5), rel=1e-3)  # ω r = 0.4 / 0.8


def test_the_soil_can_be_given_by_values() -> None:
    found = gl.wheel([0.1, 0.3], load=30, k92=0.5, soil_values={"cohesion_Pa": 0, "exponent": 1})
    assert (found.soil.cohesion, found.soil.exponent, found.soil.friction_angle) == (0, 1, 30)
    assert [p.slip for p in found.points] == [0.1, 0.3]


@pytest.mark.parametrize(
    ("words", "kind", "said"),
    [
        (["--slip", "2"], UsageError, "slip 2 is out of range"),
        (["--slip", "fast"], UsageError, "cannot be understood"),
        (["--slip", "0:1"], UsageError, "cannot be understood"),
        (["--slip", "1:0:0.1"], UsageError, "cannot be understood"),
        (["--slip", "nan"], UsageError, "out of range"),
        (["--slip", "0:nan:0.1"], UsageError, "cannot be understood"),
        (["--slip", "-1:1:1e-9"], UsageError, "cannot be understood"),
        (["--k92", "1.5"], UsageError, "out of range"),
        (["--k92", "0.5", "--a-theta", "2"], UsageError, "exclude"),
        (["--load", "5", "--sinkage", "5"], UsageError, "exclude"),
        (["--load", "-5"], UsageError, "out of range"),
        (["--robot", "kobuki"], UsageError, "the load is not given"),
        (["--soil-value", "cohesion_Pa=-1"], InputError, "out of range"),
        (["--soil-value", "cohesion=1"], InputError, "unknown key"),
        (["--effect", "bulldozing.strength=x"], UsageError, "cannot be understood"),
        (["--plot", "wheel.jpg"], UsageError, "not a picture"),
    ],
)
def test_a_line_that_does_not_fit_is_told(words: list[str], kind: type[LabError], said: str) -> None:
    refused(lab("wheel", *words), kind.exit_code, said)


def test_a_slow_wheel_and_an_idle_effect_are_told() -> None:
    found = gl.wheel(0.2, v=0.01, k92=0.3, active={"drive_reaction": {"share": 1.0}})
    assert found.fades
    assert found.left_out == ("drive_reaction",)
