"""Reports as HTML, Markdown and PDF, their first screen in a notebook, and tables as LaTeX, by templates.

All text from a log is escaped.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from granite_lab.reporting.answers import of_study
from granite_lab.reporting.canvas import typeset
from granite_lab.reporting.report import MODEL, Report
from granite_lab.results import StudyResult
from granite_lab.rounding import unbroken
from granite_lab.shown import as_html, jsonable

_SYMBOL = re.compile(r"\b(k_92|k_c|k_φ|a_θ|λ_R|μ_s|b_0|b_1|J_t)\b")
_MARKDOWN = {c: f"\\{c}" for c in "\\`*_[]|~#$"} | {"&": "&amp;", "<": "&lt;", ">": "&gt;"}
_BREAKS = re.compile(r"[\r\n\t\v\f\x00-\x1f]+")


def to_html(report: Report, pictures: Mapping[str, Markup]) -> str:
    """Return the report as one HTML page; `pictures` are its figures on the page, by name."""
    return rendered("report.html", report=report, svg=pictures)


def to_markdown(template: str, **content: object) -> str:
    """Return a page as Markdown that shows the figures beside it."""
    return re.sub(r"\n{3,}", "\n\n", rendered(template, **content)).rstrip() + "\n"


def marked(text: object) -> Markup:
    """Escape a text, keep numbers on the line of their units, and set λ_R with its index low."""
    return Markup(
        _SYMBOL.sub(lambda m: m[1].replace("_", "<sub>", 1) + "</sub>", unbroken(str(escape(text))))
    )


def plain_markdown(value: object) -> str:
    """Escape a text so that Markdown shows it as it is, on one line, also inside a table."""
    if isinstance(value, Markup):
        return value
    return "".join(_MARKDOWN.get(c, c) for c in _BREAKS.sub(" ", str(value)))


def to_pdf(result: StudyResult, report: Report, made: str, figures: Mapping[str, str]) -> bytes:
    """Return the report as four pages of A4, set by Typst; the same study gives the same bytes.

    `made` states version and date; `figures` are their SVG by name.
    """
    answers = report.answers
    content = {
        "name": report.name, "made": made, "lead": answers.lead, "virtual": answers.virtual,
        "questions": answers.questions, "command": result.source.command, "tables": report.tables,
        "model": MODEL,
        "figures": {f.name: {"title": f.title, "virtual": f.virtual} for f in report.figures},
    }  # fmt: skip
    files = {f"figures/{name}.svg": svg.encode() for name, svg in figures.items()}
    source = (Path(__file__).parent / "templates" / "report.typ").read_bytes()
    return typeset(source, files, "pdf", report=json.dumps(jsonable(content)))


TONES = {"good": "#00634a", "fair": "#8a4b00", "bad": "#a3211a"}
"""Colour beside an answer, readable on a light ground; on a dark one the text has the notebook's colour."""


@as_html.register
def study_as_html(result: StudyResult) -> str:
    """Return the first screen of a study's report as a part of a page, with its styles in it."""
    answers = of_study(result)
    return rendered("notebook.html", answers=answers, first=answers.table, tones=TONES)


def rendered(template: str, **content: object) -> str:
    """Return a template with its content; the ending of its name says how content is escaped."""
    return _environment(Path(template).suffix).get_template(template).render(**content)


@lru_cache
def _environment(kind: str) -> Environment:
    marks = ("<%", "%>", "<<", ">>") if kind == ".tex" else ("{%", "%}", "{{", "}}")
    environment = Environment(
        *marks, loader=PackageLoader("granite_lab.reporting"), autoescape=kind == ".html",
        finalize=plain_markdown if kind == ".md" else None, undefined=StrictUndefined,
        keep_trailing_newline=True, trim_blocks=kind == ".tex",
    )  # fmt: skip
    environment.filters["marked"] = marked
    environment.filters["fenced"] = lambda text: Markup(_BREAKS.sub(" ", str(text)).replace("`", " "))
    environment.filters["kind"] = lambda block: type(block).__name__
    return environment
