"""Stated probabilities held against what was hidden."""

from pathlib import Path

import numpy as np

from benchmarks.reliability import bins, section, write_diagram
from granite_lab.hidden.scoring import score


def test_effects_fall_into_bins_and_the_interval_of_each_is_held_against_the_stated_mean() -> None:
    stated = [("a", 0.97, k < 97) for k in range(100)] + [("b", 0.85, k < 2) for k in range(10)]
    low, high = bins(stated)
    assert (low.low, low.right, low.total, low.holds) == (0.8, 2, 10, False)
    assert (high.low, high.right, high.total, high.holds) == (0.95, 97, 100, True)
    assert np.isclose(high.mean, 0.97)
    assert bins([("a", 1.0, True)])[0].high == 1.0
    text = section(stated, "figures/x.png")
    assert "| 0.8–0.9 | 0.850 | **2/10 = 20 % (6–51)** | no |" in text
    assert "(figures/x.png)" in text
    assert "No effect" in section([], "figures/x.png")


def test_the_diagram_is_written_beside_the_page_where_there_is_one(tmp_path: Path) -> None:
    write_diagram([], tmp_path / "page.md", "figures/x.png")
    assert not list(tmp_path.iterdir())
    write_diagram([("a", 0.97, True)], tmp_path / "page.md", "figures/x.png")
    assert (tmp_path / "figures" / "x.png").read_bytes()[1:4] == b"PNG"


def test_what_is_only_described_counts_with_its_probability_and_a_formula_does_not() -> None:
    answer = {"effects": [{"id": x, "library": True, "parameters": {}} for x in ("a", "b")]}
    finding = {
        "verdict": "partly named",
        "effects": [{"id": "a", "probability": 0.97, "indistinguishable_from": []}],
        "description": {"terms": [
            {"id": "c", "probability": 0.7, "indistinguishable_from": ["b"], "empirical": False},
            {"id": "d", "probability": 0.4, "indistinguishable_from": [], "empirical": False},
            {"id": "empirical.force_motion", "probability": 1.0, "empirical": True},
        ]},
    }  # fmt: skip
    stated = score(answer, finding).stated
    assert [(s.id, s.right, s.named) for s in stated] == [
        ("a", True, True), ("c", True, False), ("d", False, False),
    ]  # fmt: skip
