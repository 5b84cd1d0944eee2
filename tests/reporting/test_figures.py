"""Figures: text whole and uncovered, units on every axis, the same bytes whoever draws them."""

from __future__ import annotations

import dataclasses
import io
import re
import time
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from granite_lab.parameters import load_paper
from granite_lab.reporting import write_report
from granite_lab.reporting.answers import by_speed
from granite_lab.reporting.canvas import Figure, envelope, saved, styled
from granite_lab.reporting.plot_motion import comparison_figure
from granite_lab.reporting.plot_results import spread
from granite_lab.reporting.report import study_report
from granite_lab.results import Source, StudyResult
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import made_up_finding

SVG = "{http://www.w3.org/2000/svg}"
UNIT = re.compile(r"\[[^\]]+\]")


@pytest.fixture(scope="module")
def of_study() -> list[Figure]:
    result = made_up_study(speeds=(0.2, 0.7), repetitions=2)
    return [*study_report(result).figures, comparison_figure(result.trials[0].comparison, 1)]


@pytest.fixture(scope="module")
def of_search() -> list[Figure]:
    hostile = HOSTILE.replace("{", "").replace("}", "") + "$a_{{1}}$ {speed} {repetition}"
    findings = [made_up_finding(v, twins=("slip_sinkage",)) for v in ("named", "unknown", "none")]
    source = Source("0.1.0", "granite-lab discover trials", (), ())
    alone = [
        StudyResult("mine", (), (), None, source, f) for f in (*findings, made_up_finding(names=hostile))
    ]
    return [figure for result in alone for figure in study_report(result).figures]


def texts(figure: Canvas) -> list[tuple[str, Bbox]]:
    """Return every text that is drawn, with its place; ticks outside the axis are not drawn."""
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(100)
    canvas.draw()
    renderer = canvas.get_renderer()
    found: list[Text] = list(figure.texts)
    for axes in figure.axes:
        found += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            found += [label for tick in axis._update_ticks() for label in (tick.label1, tick.label2)]
    for legend in [*figure.legends, *filter(None, (axes.get_legend() for axes in figure.axes))]:
        found += legend.get_texts()
    shown = [t for t in found if t.get_visible() and t.get_text().strip()]
    return [(t.get_text(), t.get_window_extent(renderer)) for t in shown]


@pytest.mark.parametrize("which", ["of_study", "of_search"])
def test_no_text_is_cut_or_covered_and_every_figure_says_what_to_see(
    which: str, request: pytest.FixtureRequest
) -> None:
    for drawing in request.getfixturevalue(which):
        with styled():
            drawn = drawing.draw()
            boxes = texts(drawn)
        assert len(boxes) > 5
        frame = drawn.bbox
        for text, box in boxes:
            inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
            assert inside, (drawing.name, text)
        low, high = (np.array([getattr(box, end) for _, box in boxes]) for end in ("min", "max"))
        over = np.minimum(high[:, None], high) - np.maximum(low[:, None], low)
        for i, j in np.argwhere((over[..., 0] > 1) & (over[..., 1] > 2)):
            assert i == j, (drawing.name, boxes[i][0], boxes[j][0])
        labels = [axis.get_xlabel() for axis in drawn.axes]
        assert UNIT.search(next(reversed(list(filter(None, labels))))), drawing.name
        assert drawing.title
        assert drawing.caption.endswith((".", ")"))
        assert "nan" not in (drawing.caption + drawing.title).lower()


def test_no_legend_covers_a_panel(of_study: list[Figure], of_search: list[Figure]) -> None:
    for drawing in (*of_study, *of_search):
        drawn = drawing.draw()
        FigureCanvasAgg(drawn).draw()
        legends = [*drawn.legends, *filter(None, (axes.get_legend() for axes in drawn.axes))]
        panels = [axes.get_window_extent() for axes in drawn.axes]
        boxes = [legend.get_window_extent() for legend in legends]
        for k, box in enumerate(boxes):
            for other in [*panels, *boxes[:k]]:
                over = Bbox.intersection(box, other)
                assert over is None or over.width <= 1 or over.height <= 1, drawing.name


def test_axes_are_named_with_their_units(of_study: list[Figure]) -> None:
    for drawing in of_study:
        assert all(UNIT.search(a.get_ylabel()) for a in drawing.draw().axes), drawing.name


def test_svg_text_is_what_was_drawn(of_study: list[Figure]) -> None:
    """Shortening coordinates must not shorten the numbers a reader sees."""
    for drawing in of_study:
        drawn = drawing.draw()
        root = ElementTree.fromstring(saved(drawn, "svg"))
        shown = {"".join(node.itertext()).strip() for node in root.iter(f"{SVG}text")}
        drawn_lines = {line for t in drawn.findobj(Text) for line in t.get_text().split("\n")}
        assert {text for text in shown if re.search(r"[A-Za-z]", text)} <= drawn_lines
        assert len([text for text in shown if UNIT.search(text)]) >= 2


def test_names_of_figures_are_unique(of_study: list[Figure]) -> None:
    assert len({d.name for d in of_study}) == len(of_study)


@pytest.mark.parametrize("trials", [1, 3, 300])
def test_all_trials_of_a_speed_stand_close_to_it(trials: int) -> None:
    """The speeds of the paper are 0.1 m/s apart: trials of one must not stand at another."""
    (speed,) = by_speed(made_up_study(speeds=(0.2,), repetitions=1), load_paper())
    x = spread(dataclasses.replace(speed, results=speed.results * trials))
    assert len(set(x)) == trials
    assert np.mean(x) == pytest.approx(0.2)
    assert max(x) - 0.2 < 0.03


def test_thinning_keeps_peaks_and_gaps() -> None:
    t = np.linspace(0, 10, 20_000)
    y = np.sin(t)
    y[12_345] = 9.0
    y[5_000:5_400] = np.nan
    s, thin = envelope(t, y, points=400)
    assert len(s) < 900
    assert np.nanmax(thin) == 9.0
    assert np.isnan(thin[(s > t[5_050]) & (s < t[5_350])]).all()
    assert np.all(np.diff(s) > 0)


def cost_of_a_plain_figure() -> float:
    """Return what matplotlib takes for three panels with legends as SVG and PNG: a unit on any machine."""
    begin = time.process_time()
    figure = Canvas(figsize=(7, 6))
    for axis in figure.subplots(3, sharex=True):
        for phase in range(3):
            axis.plot(np.sin(np.linspace(0, 30, 700) + phase), label=f"line {phase}")
        axis.legend()
    figure.savefig(io.BytesIO(), format="svg")
    figure.savefig(io.BytesIO(), format="png", dpi=150)
    return time.process_time() - begin


@pytest.mark.slow
def test_a_report_of_twelve_trials_with_its_discovery_stays_small_and_quick(tmp_path: Path) -> None:
    study = dataclasses.replace(made_up_study(), finding=made_up_finding())
    before, begin = cost_of_a_plain_figure(), time.process_time()
    write_report(study, tmp_path / "study", model="model.toml")
    cost = time.process_time() - begin
    plain = (before + cost_of_a_plain_figure()) / 2
    drawn = len(list((tmp_path / "study").rglob("*.svg")))
    assert drawn > 12
    assert cost <= 2 * drawn * plain
    assert sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file()) <= 15_000_000
