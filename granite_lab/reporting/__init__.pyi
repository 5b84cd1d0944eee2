from . import (
    answers,
    canvas,
    channels,
    json_report,
    names,
    pictures,
    recording,
    search_tables,
    speeds,
    table,
    tables,
    terminal,
)
from .write import write_comparison, write_finding, write_report

__all__ = [
    "answers",
    "canvas",
    "channels",
    "json_report",
    "names",
    "pictures",
    "recording",
    "search_tables",
    "speeds",
    "table",
    "tables",
    "terminal",
    "write_comparison",
    "write_finding",
    "write_report",
]
