"""A report as HTML and as Markdown; whatever comes from a log is escaped in both."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from granite_lab.reporting.canvas import inline_svg, svg_size
from granite_lab.reporting.document import Block, Code, Fold, Gallery, Listing, Report, Words
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.table import Table

_KINDS = {
    "words": Words, "code": Code, "listing": Listing, "gallery": Gallery, "table": Table, "fold": Fold,
}  # fmt: skip
_SYMBOL = re.compile(r"\b(k_92|a_θ|λ_R|b_0|b_1)\b")
_UNIT = re.compile(r"(?<=\d) (?=[%°]|(?:m/s|mm/s|s/m|N m|ms)\b)")
_MARKDOWN = {c: f"\\{c}" for c in "\\`*_[]|~#$"} | {"&": "&amp;", "<": "&lt;", ">": "&gt;"}


def to_html(report: Report, pictures: Mapping[str, Markup]) -> str:
    """Return the report as one HTML page.

    Args:
        report: the report.
        pictures: what `picture` made of each figure, by its id.
    """
    return _environment(html=True).get_template("report.html").render(report=report, svg=pictures)


def picture(figure: Figure, svg: str, *, inline: bool) -> Markup:
    """Return the element that shows a figure: all of it, or a place that is filled when one looks at it."""
    if inline:
        return Markup(inline_svg(svg, figure.name, str(escape(figure.alt))))
    # Its shape is said, so that nothing moves on the page when the figure comes.
    width, height = (round(4 * float(size)) for size in svg_size(svg))
    return Markup('<img src="figures/{}.svg" alt="{}" width="{}" height="{}" loading="lazy">').format(
        figure.name, figure.alt, width, height
    )


def to_markdown(report: Report) -> str:
    """Return the report as Markdown that shows the figures beside it."""
    text = _environment(html=False).get_template("report.md").render(report=report)
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def blocks_to_markdown(title: str, blocks: Sequence[Block]) -> str:
    """Return a page of blocks below a title, as Markdown."""
    template = _environment(html=False).get_template("block.md")
    text = "".join([f"# {title}\n\n", *(template.render(b=block) for block in blocks)])
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def marked(text: object) -> Markup:
    """Escape a text, keep numbers on the line of their units, and set λ_R with its index low."""
    safe = _UNIT.sub("\u00a0", str(escape(text)))
    return Markup(_SYMBOL.sub(lambda m: m[1].replace("_", "<sub>", 1) + "</sub>", safe))


def plain_markdown(value: object) -> str:
    """Escape a text so that Markdown shows it as it is, on one line, also inside a table."""
    flat = re.sub(r"[\r\n\t\v\f\x00-\x1f]+", " ", str(value))
    return "".join(_MARKDOWN.get(c, c) for c in flat)


def _finalized(value: object) -> str:
    return str(value) if isinstance(value, Markup) else plain_markdown(value)


def fenced(text: object) -> Markup:
    """Return a command as it may stand in a fenced block of Markdown: on one line, no fence in it."""
    return Markup(re.sub(r"[\r\n\t\v\f\x00-\x1f`]+", " ", str(text)))


@lru_cache
def _environment(*, html: bool) -> Environment:
    environment = Environment(
        loader=PackageLoader("granite_lab.reporting"),
        autoescape=html,
        finalize=None if html else _finalized,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    environment.filters["marked"] = marked
    environment.filters["fenced"] = fenced
    for name, kind in _KINDS.items():
        environment.tests[name] = lambda value, kind=kind: isinstance(value, kind)
    return environment
