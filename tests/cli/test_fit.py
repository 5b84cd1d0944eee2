"""`fit-k92` and `fit-atheta` on the terminal: notes and tables on request, no verdict from one speed."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from tests.corpus.cli import lab

SAMPLES = Path(__file__).parent.parent.parent / "data" / "samples"
TRIALS = [SAMPLES / "virtual_v0.3_r1.csv", SAMPLES / "virtual_v0.7_r1.csv"]


def test_notes_are_counted_and_listed_on_request(tmp_path: Path) -> None:
    out = tmp_path / "k92 of trials.csv"
    short, long = lab("fit-k92", *TRIALS, "--out", out), lab("fit-k92", *TRIALS, "--verbose")
    notes = {n for fit in json.loads(lab("fit-k92", *TRIALS, "--json").out)["fits"] for n in fit["notes"]}
    assert notes
    assert f"{len(notes)} notes of the fits: --verbose lists them" in short.out
    assert len(long.out.splitlines()) > len(short.out.splitlines())
    assert "--verbose" not in long.out
    assert max(map(len, (short.out + long.out).splitlines())) <= 80
    table = pd.read_csv(out)
    assert list(table["trial"]) == [path.stem for path in TRIALS]
    assert set(table["data"]) == {"virtual"}


def test_fit_atheta_names_its_trials_and_needs_three_speeds_for_a_verdict(tmp_path: Path) -> None:
    out = tmp_path / "points.csv"
    done = lab("fit-atheta", *TRIALS, "--out", out)
    assert done.code == 0, done.err
    assert "Not tested" in done.out
    shown = " ".join(done.out.split())
    assert "Virtual trials: virtual_v0.3_r1, virtual_v0.7_r1." in shown
    assert set(pd.read_csv(out)["data"]) == {"virtual"}
    assert json.loads(lab("fit-atheta", *TRIALS, "--json").out)["agrees"] is None
    assert json.loads(lab("fit-atheta", "--published", "--json").out)["agrees"] is True
    bare = lab("fit-atheta")
    assert (bare.code, bare.error) == (2, "no trials given")
