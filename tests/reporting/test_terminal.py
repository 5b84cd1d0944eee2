"""What commands print: within 80 columns, plain off a terminal, and never steered by a log."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from granite_lab.parameters import load_variants
from granite_lab.parameters.catalogue import in_force
from granite_lab.reporting import terminal
from granite_lab.results import StudyResult
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study, rename
from tests.reporting.made_up_finding import made_up_finding

TWINS = ("slip_sinkage", "contact_angle_actual_speed")


def calls(result: StudyResult) -> dict[str, tuple[str, tuple[object, ...]]]:
    """Return functions and what they print, by a name for each."""
    comparisons = [r.comparison for r in result.trials]
    found = {
        f"finding {v}": ("show_study", (replace(result, trials=(), finding=made_up_finding(v, twins=TWINS)),))
        for v in ("named", "unknown", "none")
    }
    return {
        "study": ("show_study", (result,)),
        "motions": ("show_motions", ([(c.motion, Path("out") / "trial.csv", None) for c in comparisons],)),
        "k92": ("show_k92_fits", ([c.fit for c in comparisons],)),
        "a_theta": ("show_a_theta", (result.a_theta,)),
        "misfits": ("show_misfits", (comparisons,)),
        "parameters": ("show_parameters", (in_force("granite", "dry_sand"), load_variants())),
    } | found  # fmt: skip


def printed(result: StudyResult, name: str, *, colours: bool = False) -> str:
    out = io.StringIO()
    system = "standard" if colours else None
    console = Console(file=out, width=80, force_terminal=colours, color_system=system, highlight=False)
    show, records = calls(result)[name]
    getattr(terminal, show)(*records, console)
    return out.getvalue()


NAMES = list(calls(made_up_study(speeds=(0.2, 0.7), repetitions=1)))


@pytest.mark.parametrize("name", NAMES)
def test_tables_fit_eighty_columns_are_plain_off_a_terminal_and_marked_where_virtual(
    name: str, study: StudyResult
) -> None:
    text = printed(study, name)
    assert text.strip()
    assert max(map(len, text.splitlines())) <= 80
    assert "\x1b" not in text
    assert "nan" not in text.lower()
    assert "…" not in text.replace(" … ", "")  # nothing was cut
    assert ("virtual" in text) is (name not in ("a_theta", "parameters"))


def test_colours_appear_on_a_terminal(study: StudyResult) -> None:
    for name, colour in (("misfits", 31), ("finding named", 32)):
        assert f"\x1b[{colour}m" in printed(study, name, colours=True)


@pytest.mark.parametrize(
    ("name", "needed"),
    [
        ("finding named", (
            "What is missing from the model? Multi pass.", "Rear wheels in the compacted rut",
            "pressure 0.300 ± 0.004 97 %", "cannot tell multi pass from slip sinkage",
            "falls from 3.10 to 1.15 times", "IMU stamps 4.0 ± 1.0 ms behind",
            "left out: crashed: no model fits it", "note: One thing could not be told.",
        )),
        ("finding none", ("What is missing from the model? Nothing that these trials show.",)),
    ],
)  # fmt: skip
def test_the_answers_are_said(name: str, needed: tuple[str, ...], study: StudyResult) -> None:
    text = " ".join(printed(study, name).replace("\u00a0", " ").split())
    assert [part for part in needed if part not in text] == []


def test_names_from_logs_cannot_steer_the_terminal() -> None:
    steering = "[bold]\x1b[35m\x07\x1b]0;evil\x07[/]" + HOSTILE
    result = rename(made_up_study(speeds=(0.2, 0.7), repetitions=1), steering)
    for name in NAMES:
        text = printed(result, name, colours=True)
        assert "\x07" not in text
        assert re.sub(r"\x1b\[[0-9;]*m", "", text).count("\x1b") == 0
        assert "\x1b[35m" not in text
    assert "[bold]" in printed(result, "motions").replace("\n", "")
