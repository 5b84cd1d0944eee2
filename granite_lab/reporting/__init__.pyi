from . import (
    answers,
    canvas,
    json_report,
    names,
    pictures,
    recording,
    report,
    rounding,
    table,
    tables,
    terminal,
)
from .write import write_comparison, write_finding, write_parts, write_report

__all__ = [
    "answers",
    "canvas",
    "json_report",
    "names",
    "pictures",
    "recording",
    "report",
    "rounding",
    "table",
    "tables",
    "terminal",
    "write_comparison",
    "write_finding",
    "write_parts",
    "write_report",
]
