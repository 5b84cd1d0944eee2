"""The example report: small, whole, of the samples that are there, no kinder than the sealed answer."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest

from granite_lab.files import sha256
from granite_lab.hidden.scoring import MEANING, score
from granite_lab.hidden.sealed import open_answer
from tests.docs.pages import ROOT, text_of

EXAMPLE = ROOT / "reports" / "example"
SAMPLES = ROOT / "data" / "samples"


@pytest.fixture(scope="module")
def report() -> dict[str, Any]:
    document: dict[str, Any] = json.loads((EXAMPLE / "report.json").read_text(encoding="utf-8"))
    return document


def test_it_is_small_and_has_no_recordings() -> None:
    files = [path for path in EXAMPLE.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 6e6
    assert not [path for path in files if path.suffix == ".rrd"]


def test_its_markdown_shows_every_figure_and_no_other_lies_there() -> None:
    text = (EXAMPLE / "report.md").read_text(encoding="utf-8").replace("\\", "")
    shown = set(re.findall(r"\]\(figures/([^)]+)\)", text))
    assert shown == {path.name for path in (EXAMPLE / "figures").iterdir()}


def test_it_is_of_the_samples_that_are_there(report: dict[str, Any]) -> None:
    text = json.dumps(report["provenance"])
    for log in sorted(SAMPLES.glob("*.csv")):
        assert sha256(log) in text, f"{log.name} has changed: run reports/make_example.py"


def test_its_first_screen_says_slip_a_theta_and_what_is_missing(report: dict[str, Any]) -> None:
    page = (EXAMPLE / "report.md").read_text(encoding="utf-8").split("\n## ")[0]
    said = " ".join(page.replace("\\", "").split())  # no-break spaces, too
    for s in report["answers"]["speeds"]:
        low, high = (f"{x:.{2 if s['slip']['std'] < 0.355 else 1}f}" for x in s["slip"]["ci95"])
        assert re.search(rf"\| {s['speed_mps']:g} \| [\d.]+ \| {low} to {high} \|", said)
    assert re.search(r"4\.919 s/m\?\*\* (Yes|No)\. a_θ = [\d.]+ ± [\d.]+ s/m", said)
    if report["discovery"]["verdict"] == "named":
        assert re.search(r"How much of the gap does it close\?\*\* (Over )?\d+ %", said)


def test_the_readme_beside_it_tells_how_the_finding_was_judged(report: dict[str, Any]) -> None:
    judged = score(open_answer(SAMPLES), report["discovery"])
    said = " ".join(text_of("reports/README.md").split())
    assert MEANING[judged.outcome] in said
    for effect in (*judged.hidden, *judged.named):
        assert f"`{effect}`" in said
