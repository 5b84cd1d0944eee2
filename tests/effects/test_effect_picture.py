"""The picture of an effect: what is drawn is what the sensors read, and what nothing else can imitate."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granite_lab.effects import get
from granite_lab.model.effect import Effect, EffectParameter, Own, activate
from granite_lab.model.symbols import ModelParameters
from granite_lab.parameters import GRAVITY, load_robot, load_soil, load_variants
from granite_lab.planning.imprint import Imprint, imprint
from granite_lab.reporting.pictures import ROWS, effect_drawing
from tests.corpus.cli import lab, refused
from tests.reporting.test_figures import no_text_is_cut_or_covered

TWO = (load_variants()[1], load_variants()[3])


def imprint_of(effect: Effect, **values: float) -> Imprint:
    return imprint(activate(effect, values), load_robot(), load_soil(), TWO)


@pytest.fixture(scope="module")
def slope() -> Imprint:
    return imprint_of(get("ground_slope"), slope=1.0)


def test_a_slope_is_seen_at_rest_but_a_tilted_or_biased_sensor_looks_the_same(slope: Imprint) -> None:
    for seen in slope.seen:
        before = seen.observation.t < -0.05
        assert seen.raw["accel_x"][before] == pytest.approx(GRAVITY * np.sin(np.radians(1.0)), rel=0.02)
        assert np.abs(seen.left["accel_x"][before]).max() < 0.1 * seen.raw["accel_x"][before].min()
    # what a sensor cannot imitate is the pull that sets in as the wheels begin to turn
    assert 0.02 < slope.share < 0.25


def test_a_wound_up_tyre_shows_in_jerks_that_nothing_else_makes() -> None:
    found = imprint_of(get("tyre_windup"), compliance=2e-3)
    assert found.share > 0.5  # the rest looks as if the currents were late
    fast = found.seen[1]
    steady = (fast.observation.t > 1.5) & (fast.observation.t < 4.0)
    assert np.abs(fast.raw["accel_x"][steady]).max() < 0.02 * np.abs(fast.raw["accel_x"]).max()


class CurrentOffset(Effect):
    """Not an effect but what every search allows for: a front current that reads too high."""

    id = "current_offset"
    title = "offset"
    equation = "i' = i + offset"
    source = "test"
    signature = "test"
    parameters = (EffectParameter("offset", "A", "offset", -1.0, 1.0, 0.0, -0.1, 0.1),)

    def sensors(self, signals: dict[str, Any], p: ModelParameters, own: Own) -> dict[str, Any]:  # noqa: ARG002
        return signals | {"cur_f_A": signals["cur_f_A"] + own.p["offset"]}


def test_nothing_is_left_of_what_the_sensors_offsets_imitate() -> None:
    found = imprint_of(CurrentOffset(), offset=0.1)
    for seen in found.seen:
        assert seen.raw["current_f"] == pytest.approx(0.1, abs=1e-9)
        assert np.abs(seen.left["current_f"]).max() < 0.01
    assert found.share < 0.1


def test_every_panel_has_units_and_no_text_is_cut_off_or_covered(slope: Imprint) -> None:
    drawing = effect_drawing(slope)
    figure = drawing.draw()
    no_text_is_cut_or_covered(figure)
    left = [axis.get_ylabel() for axis in figure.axes if axis.get_ylabel()]
    assert len(left) == len(ROWS)
    assert all("[" in label and "]" in label for label in left)
    assert sum("[s]" in axis.get_xlabel() for axis in figure.axes) == len(TWO)
    assert "1.0°" in figure.texts[0].get_text()
    assert drawing.caption.endswith("(blue).")


def test_the_command_writes_the_picture_it_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("granite_lab.parameters.load_variants", lambda: TWO[:1])
    show = ("effects", "show", "payload_mass")
    assert lab(*show, "--no-picture").code == 0
    assert not list(tmp_path.rglob("*.png"))
    document = json.loads(lab(*show, "--picture", "mass.svg", "--json").out)
    assert document["picture"] == "mass.svg"
    assert document["picture_shows"].endswith("are fitted again (blue).")
    assert "rear current" in Path("mass.svg").read_text()
    assert "reports/effects/payload_mass.png" in lab(*show).out
    assert Path("reports/effects/payload_mass.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("options", [["--picture", "a.gif"], ["--picture", "a.png", "--no-picture"]])
def test_a_picture_that_cannot_be_made_is_refused(options: list[str]) -> None:
    refused(lab("effects", "show", "payload_mass", *options), 2, "--picture")
