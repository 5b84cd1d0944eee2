from __future__ import annotations

import dataclasses
import itertools
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from granite_lab.parameters import load_paper
from granite_lab.reporting.canvas import Figure, envelope, saved, styled
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.plot_motion import comparison_figure
from granite_lab.reporting.plot_results import spread
from granite_lab.reporting.report import study_report
from granite_lab.reporting.summary import by_speed
from tests.reporting.made_up import made_up_study

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def drawings() -> list[Figure]:
    result: StudyResult = made_up_study(speeds=(0.2, 0.7), repetitions=2)
    return [*study_report(result).figures, comparison_figure(result.trials[0].comparison, 1)]


def texts(figure: Figure) -> list[tuple[str, Bbox]]:
    """Return every text that is drawn, with its place; ticks outside the axis are not drawn."""
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(100)
    canvas.draw()
    renderer = canvas.get_renderer()
    found: list[Text] = list(figure.texts)
    for axes in figure.axes:
        found += [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        found += list(axes.get_legend().get_texts()) if axes.get_legend() else []
        for axis in (axes.xaxis, axes.yaxis):
            for tick in axis._update_ticks():
                found += [tick.label1, tick.label2]
    shown = [t for t in found if t.get_visible() and t.get_text().strip()]
    return [(t.get_text(), t.get_window_extent(renderer)) for t in shown]


def test_no_text_is_cut_or_covered(drawings: list[Figure]) -> None:
    for drawing in drawings:
        with styled():
            drawn = drawing.draw()
            boxes = texts(drawn)
        assert len(boxes) > 5
        canvas = drawn.bbox
        for text, box in boxes:
            inside = (
                canvas.x0 <= box.x0 and box.x1 <= canvas.x1 and canvas.y0 <= box.y0 and box.y1 <= canvas.y1
            )
            assert inside, (drawing.name, text)
        for (a, box_a), (b, box_b) in itertools.combinations(boxes, 2):
            over = Bbox.intersection(box_a, box_b)
            covered = over is not None and over.width > 1 and over.height > 2
            assert not covered, (drawing.name, a, b)


def test_no_legend_covers_a_panel(drawings: list[Figure]) -> None:
    for drawing in drawings:
        drawn = drawing.draw()
        FigureCanvasAgg(drawn).draw()
        legends = [axes.get_legend() for axes in drawn.axes if axes.get_legend()]
        panels = [axes.get_window_extent() for axes in drawn.axes]
        boxes = [legend.get_window_extent() for legend in legends]
        for box in boxes:
            for other in [*panels, *(b for b in boxes if b is not box)]:
                over = Bbox.intersection(box, other)
                assert over is None or over.width <= 1 or over.height <= 1, drawing.name


def test_axes_are_named_with_their_units(drawings: list[Figure]) -> None:
    unit = re.compile(r"\[[^\]]+\]")
    for drawing in drawings:
        axes = drawing.draw().axes
        if drawing.name == "misfit":  # names on both axes; the scale carries the unit
            assert unit.search(axes[1].get_xlabel())
            continue
        assert all(unit.search(a.get_ylabel()) for a in axes), drawing.name
        assert unit.search(axes[-1].get_xlabel()), drawing.name


def test_svg_files_carry_the_labels_as_text(folder: Path) -> None:
    for path in (folder / "figures").glob("*.svg"):
        root = ElementTree.parse(path).getroot()
        shown = ["".join(node.itertext()) for node in root.iter(f"{SVG}text")]
        labels = [text for text in shown if re.search(r"\[[^\]]+\]", text)]
        assert len(labels) >= (1 if path.stem == "misfit" else 2), path
        assert not path.read_text(encoding="utf-8").count("<dc:date>")


def test_svg_text_is_what_was_drawn(drawings: list[Figure]) -> None:
    """Shortening coordinates must not shorten the numbers a reader sees."""
    for drawing in drawings:
        drawn = drawing.draw()
        root = ElementTree.fromstring(saved(drawn, "svg"))
        shown = {"".join(node.itertext()).strip() for node in root.iter(f"{SVG}text")}
        wanted = {t.get_text() for t in drawn.findobj(Text) if re.search(r"[A-Za-z]", t.get_text())}
        assert {line for text in wanted for line in text.split("\n")} >= shown - {
            text for text in shown if not re.search(r"[A-Za-z]", text)
        }
        assert len(shown) > 5


def test_every_figure_says_what_to_see(drawings: list[Figure]) -> None:
    ids = [d.name for d in drawings]
    assert len(set(ids)) == len(ids)
    for d in drawings:
        assert d.title
        assert d.caption.endswith((".", ")"))
        assert "nan" not in d.caption.lower()


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
