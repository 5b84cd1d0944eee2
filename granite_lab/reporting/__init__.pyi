from . import (
    answers,
    canvas,
    grid,
    json_report,
    plot_log,
    plot_model,
    recording,
    rounding,
    tables,
    terminal,
    two_studies,
)
from .write import write_compared, write_comparison, write_finding, write_report

__all__ = [
    "answers",
    "canvas",
    "grid",
    "json_report",
    "plot_log",
    "plot_model",
    "recording",
    "rounding",
    "tables",
    "terminal",
    "two_studies",
    "write_compared",
    "write_comparison",
    "write_finding",
    "write_report",
]
