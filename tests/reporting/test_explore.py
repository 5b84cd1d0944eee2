"""The page on which every line can be looked at: its size, what it keeps of a line, names from logs in it."""

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granite_lab.reporting.canvas import extremes
from granite_lab.reporting.explore import POINTS
from granite_lab.results import StudyResult
from tests.reporting.conftest import HOSTILE


def data_of(folder: Path) -> dict[str, Any]:
    text = (folder / "explore.html").read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, flags=re.S)
    assert found is not None
    return json.loads(found[1])


def numbers(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), "<f4").astype(float)


@pytest.mark.parametrize("lines", [1, 3])
def test_a_thinned_line_keeps_its_extremes_and_ends(lines: int) -> None:
    rng = np.random.default_rng(lines)
    traces = rng.normal(size=(lines, 50_000))
    for trace, k in zip(traces, (123, 4567, 43210), strict=False):
        trace[k], trace[k + 1000], trace[k + 2000 : k + 2500] = 9.0, -9.0, np.nan
    kept = extremes(list(traces), 900)
    assert {0, 49_999} <= set(kept)
    assert 700 < len(kept) <= 902 + 2 * lines
    for trace in traces:
        assert np.nanmax(trace[kept]) == 9.0
        assert np.nanmin(trace[kept]) == -9.0


def test_lines_of_every_channel_are_on_the_page(twelve: StudyResult, twelve_folder: Path) -> None:
    page, data = twelve_folder / "explore.html", data_of(twelve_folder)
    assert page.stat().st_size < 15e6
    assert [t["name"] for t in data["trials"]] == [r.trial.name for r in twelve.trials]
    c = twelve.trials[0]
    own = data["trials"][0]["curves"]
    assert c.measured.keys() <= own.keys()
    assert {f"search_{r.channel}" for r in twelve.finding.residuals} <= own.keys()
    assert "r" in own["wheel_fl"]  # the encoder behind an estimate
    for name, scale in (("velocity", 1.0), ("pitch", 180 / np.pi), ("torque_r", 1.0)):
        lines = {key: numbers(own[name][key]) for key in "tmsef"}
        assert len({len(values) for values in lines.values()}) == 1
        assert len(lines["t"]) <= POINTS + 10
        for key, values in (("m", c.measured[name]), ("s", c.simulated[name]), ("e", c.measured_std[name])):
            at = scale * np.interp(lines["t"], c.t, values)
            assert np.allclose(lines[key], at, atol=1e-4, equal_nan=True)
        gap = scale * (c.simulated[name] - c.measured[name])
        assert np.nanmax(lines["s"] - lines["m"]) == pytest.approx(np.nanmax(gap), rel=1e-3, abs=1e-6)
    assert not np.allclose(numbers(own["velocity"]["f"]), numbers(own["velocity"]["s"]), atol=1e-5)


def test_a_name_of_a_log_stays_text_and_nothing_is_fetched(hostile_folder: Path) -> None:
    text = (hostile_folder / "explore.html").read_text(encoding="utf-8")
    assert data_of(hostile_folder)["trials"][0]["name"] == HOSTILE
    assert "<script>alert" not in text
    assert text.count("<script") == text.count("</script>") == 3
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=\"(?!data:,)", text)
