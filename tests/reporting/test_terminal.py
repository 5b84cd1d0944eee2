from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from granite_lab.parameters import load_variants
from granite_lab.parameters.catalogue import in_force
from granite_lab.reporting import terminal
from granite_lab.reporting.content import StudyResult
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study, rename


def printed(show: str, *records: object, colours: bool = False) -> str:
    out = io.StringIO()
    console = Console(
        file=out,
        width=80,
        force_terminal=colours,
        color_system="standard" if colours else None,
        highlight=False,
    )
    getattr(terminal, show)(*records, console)
    return out.getvalue()


def calls(result: StudyResult) -> dict[str, tuple[object, ...]]:
    comparisons = [r.comparison for r in result.trials]
    return {
        "show_study": (result,),
        "show_motions": ([(c.motion, Path("out") / "trial.csv", None) for c in comparisons],),
        "show_k92_fits": ([c.fit for c in comparisons],),
        "show_a_theta": (result.a_theta,),
        "show_misfits": (comparisons,),
        "show_parameters": (in_force("granite", "dry_sand"), load_variants()),
    }


@pytest.mark.parametrize("show", list(calls(made_up_study(speeds=(0.2, 0.7), repetitions=1))))
def test_tables_fit_eighty_columns_and_are_plain_off_a_terminal(show: str, study: StudyResult) -> None:
    text = printed(show, *calls(study)[show])
    assert text.strip()
    assert max(map(len, text.splitlines())) <= 80
    assert "\x1b" not in text
    assert "nan" not in text.lower()
    assert "…" not in text.replace(" … ", "")  # nothing was cut


def test_colours_appear_on_a_terminal(study: StudyResult) -> None:
    assert "\x1b[32m" in printed("show_misfits", *calls(study)["show_misfits"], colours=True)


def test_the_study_says_slip_paper_and_verdict(study: StudyResult) -> None:
    text = " ".join(printed("show_study", study).split())
    for needed in ("0.3", "8.35", "22.9", "4.919 s/m", "Not tested", "virtual", "noise"):
        assert needed in text.replace("\u00a0", " ")


def test_virtual_trials_are_marked(study: StudyResult) -> None:
    for show in ("show_motions", "show_k92_fits", "show_misfits"):
        assert "virtual data" in printed(show, *calls(study)[show])


def test_names_from_logs_cannot_steer_the_terminal() -> None:
    result = rename(
        made_up_study(speeds=(0.2, 0.7), repetitions=1), "[bold]\x1b[35m\x07\x1b]0;evil\x07[/]" + HOSTILE
    )
    for show, records in calls(result).items():
        text = printed(show, *records, colours=True)
        assert "\x07" not in text
        assert re.sub(r"\x1b\[[0-9;]*m", "", text).count("\x1b") == 0
        assert "\x1b[35m" not in text
    assert "[bold]" in printed("show_motions", *calls(result)["show_motions"]).replace("\n", "")
