"""The HTML of a study in a notebook: its answer cards."""

from __future__ import annotations

from granite_lab.reporting.answers import of_study
from granite_lab.reporting.render import rendered
from granite_lab.reporting.speeds import first_table
from granite_lab.results import StudyResult
from granite_lab.shown import as_html

TONES = {"good": "#00634a", "fair": "#8a4b00", "bad": "#a3211a"}
"""Colour beside an answer, readable on a light ground; on a dark one the text has the notebook's colour."""


@as_html.register
def study_as_html(result: StudyResult) -> str:
    """Return the first screen of a study's report as a part of a page, with its styles in it."""
    decided = of_study(result)
    first = first_table(decided.speeds, silent=decided.silent, virtual=bool(decided.virtual))
    return rendered("notebook.html", answers=decided, first=first, tones=TONES)
