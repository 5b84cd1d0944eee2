"""The commands of the README and of the page on the model, run as they are printed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.corpus.cli import lab
from tests.docs.pages import ROOT, blocks
from tests.effects.example import EXAMPLE

LONG = ("study", "compare-studies", "view", "discover", "plan-next", "fit-k92")
"""Commands that take minutes, a viewer or the result of one of these; tests of their own run them."""

SAID = {
    "inspect": "trial.csv",
    "check": "The run is good.",
    "ingest": "slip",
    "simulate": "λ_R",
    "wheel": "drawbar pull",
    "fit-atheta": "4.919",
    "compare": "pitch rate",
    "effects": "tyre_windup",
    "effects check": "machine code gives the same run",
    "params": "wheel_base_m",
    "hide": "virtual",
    "reveal": "seed 1",
    "kit": "check.py",
}
"""Command to a text of its output."""

FILES = {"simulate": ("virtual.csv",), "hide": ("set/sealed.bin",), "kit": ("for-another-lab/answer.json",)}


def lines(page: str) -> list[list[str]]:
    """Return the quick commands of a page."""
    found = [words for block in blocks(page) for words in block.commands() if words[0] not in LONG]
    all_samples = ["fit-atheta", "data/samples"]
    return [words for words in found if words != all_samples]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A clone with the samples, a log and an effect of one's own."""
    (tmp_path / "data").symlink_to(ROOT / "data")
    shutil.copy(ROOT / "data" / "samples" / "virtual_v0.3_r1.csv", tmp_path / "trial.csv")
    (tmp_path / "my_effect.py").write_text(EXAMPLE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_quick_commands_of_the_readme_run_and_say_what_they_are_for(folder: Path) -> None:
    commands = lines("README.md")
    assert len(commands) > 12
    for words in commands:
        done = lab(*words)
        assert done.code == 0, (words, done.err)
        two = " ".join(words[:2])
        expected = SAID[two if two in SAID else words[0]]
        assert expected in " ".join((done.out + done.err).split()), (words, done.out)
        if words[0] != "simulate" or "--log" in words:
            for name in FILES.get(words[0], ()):
                assert (folder / name).exists(), words


def test_the_wheel_commands_of_the_page_on_the_model_write_their_files(folder: Path) -> None:
    for words in lines("docs/model.md"):
        done = lab(*words)
        assert done.code == 0, (words, done.err)
    for name in ("wheel.png", "wheel.csv", "arc.png", "stresses.csv"):
        assert (folder / name).stat().st_size > 500
