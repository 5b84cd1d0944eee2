"""Write the files of a report (HTML, Markdown, JSON, PDF, tables), either all of them or none."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from granite_lab.columns import FilledTable
from granite_lab.comparison.compare import Comparison
from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import DESIGN, MODEL, Finding
from granite_lab.folders import replacing
from granite_lab.parameters import by_speed
from granite_lab.processes import forked_map
from granite_lab.reporting import canvas
from granite_lab.reporting.canvas import FORMATS, Figure, converted, drawn, on_page
from granite_lab.reporting.channels import CHANNEL_TABLE, MISFITS, judged_channels
from granite_lab.reporting.explore import to_explore
from granite_lab.reporting.json_report import dumps, to_json
from granite_lab.reporting.latex import to_latex
from granite_lab.reporting.names import LINES, from_here
from granite_lab.reporting.plot_motion import comparison_figure
from granite_lab.reporting.render import to_html, to_markdown, to_pdf
from granite_lab.reporting.report import made_by, study_report
from granite_lab.results import RECORDINGS, StudyResult, pooled_misfits, recordings_of


def write_report(
    result: StudyResult, folder: Path, *, model: Path | str | None = None, jobs: int = 1
) -> Path:
    """Write page, Markdown, PDF, ``figures/``, ``tables/``, and ``report.json`` with the hashes of them all.

    A search alone has ``finding.json`` in place of ``report.json``, and no PDF.
    All or nothing of it is written; files there of other origin stay (`folders.replacing`).

    Args:
        result: the study, with what a search found.
        folder: of the report; made if it does not exist.
        model: path of the model file, as the numbers shall name it.
        jobs: number of processes that draw figures, as in `processes.forked_map`.

    Returns:
        path of ``index.html``.

    Raises:
        LabError: a file cannot be written.
    """
    beside = Path(model).name if model is not None else None
    named = from_here(folder)
    there = [folder / RECORDINGS / name for name in recordings_of(result)]
    recordings = RECORDINGS if result.trials and all(path.is_file() for path in there) else ""
    report = study_report(result, model=beside, folder=named, recordings=recordings)
    with replacing(folder, "report") as new:
        pictures = _write_figures(report.figures, new, jobs)
        _write_tables(report.tables, new)
        _write(new / "report.md", to_markdown("report.md", report=report))
        on_pages = {f.name: on_page(f, pictures[f.name]) for f in report.figures}
        _write(new / "index.html", to_html(report, on_pages))
        if result.finding is not None and not result.trials:
            _write(new / "finding.json", dumps(finding_as_json(result.finding, model)))
        else:
            _write(new / LINES, to_explore(result, report.name, jobs))
            (new / "report.pdf").write_bytes(to_pdf(result, report, made_by(result.source), pictures))
            for name in (MODEL, DESIGN) if result.finding is not None else ():
                if (folder / name).is_file():
                    shutil.copyfile(folder / name, new / name)  # so that report and hash belong together
            _write(new / "report.json", to_json(result, report, model, new))
    return folder / "index.html"


def write_finding(finding: Finding, folder: Path, model: Path | str | None = None) -> Path:
    """Write ``finding.json`` alone and return its path; arguments as in `write_report`.

    Raises:
        LabError: it cannot be written.
    """
    with replacing(folder, "finding") as new:
        _write(new / "finding.json", dumps(finding_as_json(finding, model)))
    return folder / "finding.json"


def write_comparison(comparisons: Sequence[Comparison], folder: Path) -> list[Path]:
    """Write the panels of each trial and the tables of differences, without a report around them.

    Raises:
        LabError: a file cannot be written.
    """
    differences, virtual = pooled_misfits(comparisons), any(c.motion.virtual for c in comparisons)
    like = {
        k: [comparisons[i] for i in positions]
        for positions in by_speed(c.motion.variant.velocity for c in comparisons).values()
        for k in positions
    }
    figures = tuple(comparison_figure(c, k + 1, like[k]) for k, c in enumerate(comparisons))
    judged = CHANNEL_TABLE.fill(judged_channels(differences), virtual=virtual)
    with replacing(folder, "comparison") as new:
        _write_figures(figures, new)
        _write_tables([judged, MISFITS.fill(differences.values(), virtual=virtual)], new)
        return sorted(folder / p.relative_to(new) for p in new.rglob("*") if p.is_file())


def _write(path: Path, text: str) -> None:
    path.write_bytes(text.encode("utf-8", errors="replace"))


def _write_figures(figures: Sequence[Figure], folder: Path, jobs: int = 1) -> dict[str, str]:
    """Write each figure in all formats; return their SVG by name."""
    (folder / "figures").mkdir()
    pictures = forked_map(_drawn, figures, len(figures), "drew figures", jobs=jobs, few=2)
    drawings = {figure.name: svg for figure, svg in zip(figures, pictures, strict=True)}
    wanted = [(name, kind) for name in drawings for kind in FORMATS]
    with ThreadPoolExecutor(jobs or os.cpu_count()) as threads:  # which Typst does not block
        made = threads.map(lambda wish: converted(drawings[wish[0]], wish[1], canvas.DPI), wanted)
        for (name, kind), content in zip(wanted, made, strict=True):
            (folder / "figures" / f"{name}.{kind}").write_bytes(content)
    return {name: svg.decode() for name, svg in drawings.items()}


def _drawn(figures: Sequence[Figure], k: int) -> bytes:  # not converted: Typst hangs in forked processes
    return drawn(figures[k].draw())


def _write_tables(tables: Sequence[FilledTable], folder: Path) -> None:
    (folder / "tables").mkdir()
    for table in tables:
        _write(folder / "tables" / f"{table.name}.csv", table.to_csv())
        _write(folder / "tables" / f"{table.name}.tex", to_latex(table))
