"""Progress has an end where that is known, and is shown on a terminal alone."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from granite_lab.commands import printer
from granite_lab.commands.options import count_of
from granite_lab.discovery.discover import STEPS
from tests.corpus.cli import SAMPLES


@pytest.mark.parametrize("terminal", [True, False])
def test_trials_are_counted_to_their_number(monkeypatch: pytest.MonkeyPatch, terminal: bool) -> None:
    shown = io.StringIO()

    def made(**_: object) -> Console:
        return Console(file=shown, force_terminal=terminal, width=100)

    monkeypatch.setattr(printer, "console", made)
    with printer.progress("trials", quiet=False, total=3) as watch:
        watch.done(None)
    with printer.progress("trials", quiet=False, total=3) as watch:
        watch.stage("screening", 2, STEPS)  # of the search that follows
    for text in ("1/3", "left", "screening", f"2/{STEPS}"):
        assert (text in shown.getvalue()) is terminal, text


def test_the_number_is_that_of_the_logs_of_all_folders(tmp_path: Path) -> None:
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("")
    assert count_of([tmp_path]) == 2
    assert count_of([tmp_path, SAMPLES / "virtual_v0.3_r1.csv"]) == 3
    assert count_of([tmp_path / "none"]) in (None, 1)  # the command itself says that it is not there
    assert count_of([]) is None
