"""The how-to pages, followed literally: their files saved, their commands run."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from tests.corpus.cli import Done, lab
from tests.docs.pages import ROOT, blocks, save_files, text_of

SAMPLE = ROOT / "data" / "samples" / "virtual_v0.3_r1.csv"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as empty as a newcomer's, but for the samples."""
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def follow(page: str, *, without: tuple[str, ...] = ()) -> list[Done]:
    """Run the commands of a page in order, and hold each to exit code 0."""
    done = []
    for block in blocks(page):
        for words in block.commands():
            if words[0] in without:
                continue
            extra = ["-j", "1"] if words[0] in ("ingest", "fit-k92") else []
            done.append(lab(*words, *extra))
            assert done[-1].code == 0, (words, done[-1].err)
    return done


def slip_of(run: Done) -> float:
    """Return the slip ratio [%] that a simulation prints."""
    match = re.search(r"λ_R[^\d]*([\d.]+) ?%", run.out)
    assert match, run.out
    return float(match[1])


def measured(*words: object) -> float:
    """Return the slip ratio [%] that an estimation finds."""
    done = lab("ingest", *words, "-j", "1", "--json")
    return 100 * float(json.loads(done.out)["trials"][0]["slip_ratio"]["value"])


def test_a_robot_by_the_page_simulates_and_its_log_is_read(folder: Path) -> None:
    assert save_files("docs/how-to-robot.md", folder) == ["rover.toml"]
    params, first, second, _ = follow("docs/how-to-robot.md")
    assert re.search(r"body_mass_kg .* 18 ", params.out)
    assert 0 < slip_of(first) < 60
    assert slip_of(first) == slip_of(second)
    assert measured("rover_virtual.csv", "--robot", "rover.toml") == pytest.approx(slip_of(first), abs=4)


def test_a_soil_by_the_page_changes_the_slip(folder: Path) -> None:
    assert save_files("docs/how-to-soil.md", folder) == ["fine_sand.toml"]
    params, paper, fine, fit = follow("docs/how-to-soil.md")
    assert "fine_sand" in params.out or "Fine dry sand" in params.out
    assert abs(slip_of(fine) - slip_of(paper)) > 0.2
    assert "k_92" in fit.out


def foreign(log: Path, out: Path) -> None:
    """Write a sample as the logger of the page would: other names and units."""
    table = pd.read_csv(log, comment="#")
    deg = 57.29577951308232
    scale = {"t_s": 1000.0} | {f"imu_a{a}_mps2": 1 / 9.81 for a in "xyz"}
    scale |= {f"imu_g{a}_radps": deg for a in "xyz"}
    scale |= {f"enc_{w}_rad": deg for w in ("fl", "fr", "rl", "rr")}
    (header,) = (b.code.strip().split(";") for b in blocks("docs/how-to-logger.md") if b.language == "csv")
    made = pd.DataFrame({new: table[old] * k for new, (old, k) in zip(header, scale.items(), strict=True)})
    made.to_csv(out, sep=";", index=False)


def test_a_logger_by_the_page_gives_the_same_slip(folder: Path) -> None:
    foreign(SAMPLE, folder / "run.csv")
    assert save_files("docs/how-to-logger.md", folder) == ["my_logger.toml"]
    _, seen, ingested = follow("docs/how-to-logger.md")
    assert "not recognised" in (folder / "draft.toml").read_text(encoding="utf-8")
    assert "my_logger" in seen.out
    assert "variant 0.3 m/s" in " ".join(seen.out.split())
    assert "run" in ingested.out
    assert measured("run.csv", "--map", "my_logger.toml") == pytest.approx(measured(SAMPLE), abs=0.1)


def test_the_tutorial_goes_from_a_foreign_log_to_slip_and_k92(folder: Path) -> None:
    assert save_files("docs/tutorial.md", folder) == ["make_logs.py"]
    save_files("docs/how-to-logger.md", folder)
    done = subprocess.run(
        [sys.executable, "make_logs.py"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    # what follows takes minutes; tests/cli/test_study.py and tests/discovery have it
    long = ("study", "view", "discover", "reveal", "compare", "simulate", "plan-next")
    unknown, _, seen, checked, ingested, fit = follow("docs/tutorial.md", without=long)
    assert "the layout is not known" in unknown.out
    assert 'name = "clock [ms]"\nto = ["t"]\nunit = "ms"' in (folder / "draft.toml").read_text("utf-8")
    assert "2.50 m at the wheels" in seen.out
    assert "The run is good." in checked.out
    text = text_of("docs/tutorial.md")
    (stated,) = re.findall(r"it slipped by ([\d.]+) ± [\d.]+ %", text)
    found = re.search(r"run07.* (\d+\.\d+) ± \d\.\d+ ", ingested.out)
    assert found
    assert float(found[1]) == pytest.approx(float(stated), abs=0.2)
    assert "virtual" in fit.out  # what the small files beside the logs say is read


def test_an_effect_by_the_page_is_listed_and_slows_the_robot(folder: Path) -> None:
    assert save_files("docs/how-to-effect.md", folder) == ["towed_sledge.py", "model.toml"]
    listed, shown, checked, without, with_it = follow("docs/how-to-effect.md", without=("discover",))
    assert "machine code gives" in checked.out
    assert "FAILED" not in checked.out
    assert "towed_sledge" in listed.out
    assert "rolling_drag" in listed.out
    assert "spring balance" in shown.out
    assert slip_of(with_it) > slip_of(without) + 0.5
