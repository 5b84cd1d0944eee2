"""``report.pdf``: the answers of a study on four pages of A4, set by Typst from ``templates/report.typ``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from granite_lab.reporting.canvas import typeset
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.report import Report
from granite_lab.shown import jsonable

TEMPLATE = Path(__file__).parent / "templates" / "report.typ"


def report_pdf(result: StudyResult, report: Report, made: str, figures: Mapping[str, str]) -> bytes:
    """Return the report as PDF; the same study gives the same bytes.

    Args:
        result: the study.
        report: its report, whose answers, figures and tables are set.
        made: version, date and libraries, one phrase.
        figures: SVG of each figure of the report by its name.
    """
    answers = report.answers
    content = {
        "name": report.name, "made": made, "lead": answers.lead, "virtual": answers.virtual,
        "questions": answers.questions, "command": result.source.command,
        "figures": {f.name: {"title": f.title, "virtual": f.virtual} for f in report.figures},
        "tables": report.tables,
    }  # fmt: skip
    files = {f"figures/{name}.svg": svg.encode() for name, svg in figures.items()}
    return typeset(TEMPLATE.read_bytes(), files, "pdf", report=json.dumps(jsonable(content)))
