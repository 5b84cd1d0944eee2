"""Figures and pictures of logs: text whole and uncovered, units on every axis, the same bytes each time."""

import dataclasses
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from granite_lab.logs import inspect_logs
from granite_lab.reporting.canvas import Figure, converted, envelope, saved, styled
from granite_lab.reporting.pictures import log_figure
from granite_lab.reporting.plot_motion import comparison_figure
from granite_lab.reporting.plot_results import abscissae
from granite_lab.reporting.report import study_report
from granite_lab.reporting.speeds import speeds_of
from granite_lab.results import Source, StudyResult
from tests.corpus import cli
from tests.logs import make
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import made_up_finding
from tests.soak import sampled

SVG = "{http://www.w3.org/2000/svg}"
UNIT = re.compile(r"\[[^\]]+\]")


@pytest.fixture(scope="module")
def of_study() -> list[Figure]:
    result = made_up_study(speeds=(0.2, 0.7), repetitions=2)
    return [*study_report(result).figures, comparison_figure(result.trials[0], 1)]


@pytest.fixture(scope="module")
def of_search() -> list[Figure]:
    hostile = HOSTILE.replace("{", "").replace("}", "") + "$a_{{1}}$ {speed} {repetition}"
    findings = [made_up_finding(v, twins=("slip_sinkage",)) for v in sampled(["none", "named", "unknown"], 3)]
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


def no_text_is_cut_or_covered(drawn: Canvas) -> None:
    """Hold a figure to it that its texts stand within it, beside each other, and legends beside panels."""
    boxes, frame = texts(drawn), drawn.bbox
    assert len(boxes) > 5
    for text, box in boxes:
        assert frame.x0 <= box.x0 < box.x1 <= frame.x1, text
        assert frame.y0 <= box.y0 < box.y1 <= frame.y1, text
    low, high = (np.array([getattr(box, end) for _, box in boxes]) for end in ("min", "max"))
    over = np.minimum(high[:, None], high) - np.maximum(low[:, None], low)
    for i, j in np.argwhere((over[..., 0] > 1) & (over[..., 1] > 2)):
        assert i == j, (boxes[i][0], boxes[j][0])
    legends = [*drawn.legends, *filter(None, (axes.get_legend() for axes in drawn.axes))]
    taken = [axes.get_window_extent() for axes in drawn.axes]
    for box in [legend.get_window_extent() for legend in legends]:
        for other in taken:
            both = Bbox.intersection(box, other)
            assert both is None or both.width <= 1 or both.height <= 1
        taken.append(box)


@pytest.mark.parametrize("which", ["of_study", "of_search"])
def test_texts_are_whole_and_every_figure_says_what_to_see(
    which: str, request: pytest.FixtureRequest
) -> None:
    drawings: list[Figure] = request.getfixturevalue(which)
    assert len({drawing.name for drawing in drawings}) == len(drawings) or which == "of_search"
    for drawing in drawings:
        with styled():
            drawn = drawing.draw()
            no_text_is_cut_or_covered(drawn)
        labels = [axis.get_xlabel() for axis in drawn.axes]
        assert UNIT.search(next(reversed(list(filter(None, labels))))), drawing.name
        if which == "of_study":
            assert all(UNIT.search(axis.get_ylabel()) for axis in drawn.axes), drawing.name
        assert drawing.title
        assert drawing.caption.endswith((".", ")"))
        assert "nan" not in (drawing.caption + drawing.title).lower()


def test_svg_text_is_what_was_drawn(of_study: list[Figure]) -> None:
    """Shortening coordinates must not shorten the numbers a reader sees."""
    for drawing in of_study:
        drawn = drawing.draw()
        root = ElementTree.fromstring(saved(drawn, "svg"))
        shown = {"".join(node.itertext()).strip() for node in root.iter(f"{SVG}text")}
        drawn_lines = {line for t in drawn.findobj(Text) for line in t.get_text().split("\n")}
        assert {text for text in shown if re.search(r"[A-Za-z]", text)} <= drawn_lines
        assert len([text for text in shown if UNIT.search(text)]) >= 2


@pytest.mark.parametrize("trials", [1, 3, 300])
def test_all_trials_of_a_speed_stand_close_to_it(trials: int) -> None:
    """The speeds of the paper are 0.1 m/s apart: trials of one must not stand at another."""
    (speed,) = speeds_of(made_up_study(speeds=(0.2,), repetitions=1))
    x = abscissae(dataclasses.replace(speed, results=speed.results * trials))
    assert len(set(x)) == trials
    assert np.mean(x) == pytest.approx(0.2)
    assert max(x) - 0.2 < 0.03


def test_speeds_that_round_alike_have_figures_of_their_own() -> None:
    """0.4983 and 0.5021 m/s are two speeds, 0.49831 and 0.49834 m/s print alike and are one."""
    for near, names in (((0.4983, 0.5021), {"0p498", "0p502"}), ((0.49831, 0.49834), {"0p498"})):
        driven = dict(zip((0.3, 0.5), near, strict=True))
        result, finding = made_up_study(speeds=(0.3, 0.5), repetitions=2), made_up_finding(speeds=(0.3, 0.5))
        trials = []
        for r in result.trials:
            motion = r.motion
            variant = dataclasses.replace(motion.variant, velocity=driven[motion.variant.velocity])
            motion = dataclasses.replace(motion, variant=variant)
            trials.append(dataclasses.replace(r, motion=motion))
        residuals, where = (
            tuple(dataclasses.replace(x, variant=driven[x.variant]) for x in rows)
            for rows in (finding.residuals, finding.where)
        )
        finding = dataclasses.replace(finding, residuals=residuals, where=where)
        result = dataclasses.replace(result, trials=tuple(trials), finding=finding)
        figures = [figure.name for figure in study_report(result).figures]
        assert len(set(figures)) == len(figures)
        assert {f"{kind}_{name}" for kind in ("motion", "found_history") for name in names} == {
            name for name in figures if name.startswith(("motion_", "found_history_"))
        }


@pytest.mark.parametrize("later", [400.0, -400.0])
def test_a_trial_whose_log_holds_nothing_of_the_command_has_a_figure_too(later: float) -> None:
    """The start of a command may be misjudged by minutes: no sample is in the window that is drawn."""
    c = made_up_study(speeds=(0.3,), repetitions=1).trials[0]
    drawn = comparison_figure(dataclasses.replace(c, t=c.t + later), 1).draw()
    low, high = drawn.axes[0].get_xlim()
    assert low == -0.5
    assert high > 5
    assert all(np.asarray(line.get_xdata()).size == 0 for axis in drawn.axes for line in axis.get_lines())
    assert {axis.texts[0].get_text() for axis in drawn.axes[::2]} == {"not measured"}
    assert len(saved(drawn, "svg")) > 1000


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


def test_a_report_of_twelve_trials_with_its_discovery_stays_small(
    twelve_folder: Path, full_resolution: int
) -> None:
    """Its PNG are coarse, and are made again as fine as they would be."""
    files = [path for path in twelve_folder.rglob("*") if path.is_file()]
    drawn = [path for path in files if path.suffix == ".svg"]
    coarse = [path for path in files if path.suffix == ".png"]
    assert len(drawn) == len(coarse) > 12
    fine = sum(len(converted(path.read_bytes(), "png", full_resolution)) for path in drawn)
    assert fine > sum(path.stat().st_size for path in coarse)
    assert fine + sum(path.stat().st_size for path in {*files} - {*coarse}) <= 15_000_000


SAMPLE = cli.SAMPLES / "virtual_v0.3_r1.csv"
PNG = b"\x89PNG"


def test_each_sensor_has_a_panel_with_its_unit_and_the_logged_values(tmp_path: Path) -> None:
    report = inspect_logs([make.written(tmp_path, make.text(), "drive.csv")]).files[0]
    figure = log_figure(report.trial, report.rests)
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels == ["specific force [m/s²]", "angular rate [rad/s]", "wheel angle [rad]"]
    t, imu, wheels = make.rows()
    lines = {line.get_label(): line for line in (*figure.axes[0].lines, *figure.axes[2].lines)}
    assert set(lines) == {"x", "y", "z", "fl", "fr", "rl", "rr"}
    for name, logged in (("z", imu[:, 2]), ("rr", wheels[:, 3] - wheels[0, 3])):
        drawn = np.asarray(lines[name].get_xydata())
        np.testing.assert_allclose(drawn[:, 1], np.interp(drawn[:, 0], t, logged), atol=1e-6)
        assert drawn[:, 1].max() == pytest.approx(logged.max())
    assert [text.get_text() for text in figure.texts] == ["drive"]
    assert figure.axes[-1].get_xlabel() == "time [s]; grey: standstill"


def test_a_gap_interrupts_the_line_and_dates_begin_at_the_first_second(tmp_path: Path) -> None:
    lines = make.lines()
    rows = [lines[0]]
    for k, line in enumerate(lines[1:]):
        stamp, _, rest = line.partition(",")
        if not 250 <= k < 300:
            rows.append(f"{float(stamp) + 1.7e9:.6f},{rest}")
    report = inspect_logs([make.written(tmp_path, "\n".join(rows) + "\n", "gap.csv")]).files[0]
    figure = log_figure(report.trial)
    x = np.asarray(figure.axes[0].lines[0].get_xdata())
    assert np.isnan(x).sum() == 1
    assert np.nanmin(x) == 0
    assert figure.axes[-1].get_xlabel() == "time − 1700000000 s [s]"


def test_the_command_writes_the_picture_and_marks_virtual_data(tmp_path: Path) -> None:
    for name in ("log.png", "log.svg"):
        done = cli.succeeded("inspect", SAMPLE, "--plot", tmp_path / name)
        assert name in done.out
    assert (tmp_path / "log.png").read_bytes().startswith(PNG)
    drawn = (tmp_path / "log.svg").read_text()
    assert "virtual_v0.3_r1 (virtual)" in drawn
    assert "motor current" in drawn
