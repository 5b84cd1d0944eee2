"""What `discover` prints at its end, and what the command leaves in its folder."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path

import pytest
from rich.console import Console

from granite_lab.discovery.finding import Verdict
from granite_lab.reporting.terminal import show_finding
from tests.cli.test_cli import lab
from tests.reporting.made_up_finding import made_up_finding

SAMPLES = Path(__file__).parent.parent.parent / "data" / "samples"
VERDICTS: tuple[Verdict, ...] = ("named", "unknown", "none")


def printed(verdict: Verdict, *, colours: bool = False, twins: tuple[str, ...] = ()) -> str:
    out = io.StringIO()
    system = "standard" if colours else None
    console = Console(file=out, width=80, force_terminal=colours, color_system=system, highlight=False)
    show_finding(made_up_finding(verdict, twins=twins), console)
    return out.getvalue()


@pytest.mark.parametrize("verdict", VERDICTS)
def test_it_fits_eighty_columns_and_is_plain_off_a_terminal(verdict: Verdict) -> None:
    text = printed(verdict, twins=("slip_sinkage", "contact_angle_actual_speed"))
    assert max(map(len, text.splitlines())) <= 80
    assert "\x1b" not in text
    assert "nan" not in text.lower().split()
    assert "…" not in text
    assert "virtual data" in text


def test_colours_appear_on_a_terminal() -> None:
    assert "\x1b[32m" in printed("named", colours=True)


def test_a_named_effect_comes_with_size_twins_gap_and_place() -> None:
    text = " ".join(printed("named", twins=("slip_sinkage",)).replace("\u00a0", " ").split())
    for needed in (
        "What is missing from the model? Multi pass.", "Rear wheels in the compacted rut",
        "pressure 0.300 ± 0.004 97 %", "cannot tell multi pass from slip sinkage",
        "falls from 3.10 to 1.15 times",
        "IMU stamps 4.0 ± 1.0 ms behind", "left out: crashed: no model fits it",
        "note: One thing could not be told.",
    ):  # fmt: skip
        assert needed in text, needed


def test_nothing_found_has_no_after() -> None:
    text = " ".join(printed("none").split())
    assert "What is missing from the model? Nothing that these trials show." in text
    assert "missing effect effect" not in text


@pytest.fixture(scope="module")
def searched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A search, which tests/cli/test_study.py makes too, with its report beside somebody else's file."""
    root = tmp_path_factory.mktemp("discover")
    (root / "trials").mkdir()
    for name in ("v0.5_r2", "v0.7_r1"):
        shutil.copy(SAMPLES / f"virtual_{name}.csv", root / "trials")
    (root / "found").mkdir()
    (root / "found" / "mine.txt").write_text("kept")
    done = lab("discover", "trials", "--out", "found", "--jobs", "1", "--json", cwd=root)
    assert done.returncode == 0, done.stderr
    (root / "stdout").write_text(done.stdout, encoding="utf-8")
    (root / "stderr").write_text(done.stderr, encoding="utf-8")
    return root


@pytest.mark.slow
def test_the_command_writes_page_model_and_numbers(searched: Path) -> None:
    for name in ("index.html", "report.md", "finding.json", "model.toml"):
        assert (searched / "found" / name).stat().st_size > 100, name
    assert list((searched / "found" / "figures").glob("found_gap.*"))
    assert list((searched / "found" / "tables").glob("found_*.csv"))
    assert (searched / "found" / "mine.txt").read_text() == "kept"
    assert not [p for p in searched.rglob("*") if p.name.startswith(".")]
    assert "Traceback" not in (searched / "stderr").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_command_prints_one_document_with_all_that_was_promised(searched: Path) -> None:
    def refuse(constant: str) -> float:
        raise AssertionError(constant)

    document = json.loads((searched / "stdout").read_text(encoding="utf-8"), parse_constant=refuse)
    assert document == json.loads((searched / "found" / "finding.json").read_text(encoding="utf-8"))
    assert document["schema"] == "granite-lab/discovery/2"
    assert document["verdict"] in ("none", "named", "unknown")
    for effect in document["effects"]:
        assert set(effect) >= {"id", "parameters", "indistinguishable_from", "probability", "closes"}
        for parameter in effect["parameters"].values():
            assert set(parameter) >= {"value", "std", "unit"}
    for place in document["where"]:
        assert set(place) == {
            "channel", "phase", "variant_mps", "t_start_s", "t_end_s", "frequency_hz", "share",
            "score",
        }  # fmt: skip
        assert place["phase"] in ("rest", "accelerate", "steady", "brake")
    for part in ("train", "held_out"):
        assert set(document["gap"][part]) == {"before", "after"}
    assert document["provisional"]  # two speeds
    assert document["model"] == "found/model.toml"
    assert "virtual_v0.7_r1" in (searched / "found" / "index.html").read_text(encoding="utf-8")


def test_a_log_that_cannot_be_read_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("")
    done = lab("discover", "empty.csv", "--out", "found", cwd=tmp_path)
    assert done.returncode == 3
    assert done.stderr.startswith("error: ")
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "found").exists()
