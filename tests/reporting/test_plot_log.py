"""`inspect --plot`: every recognised channel, with its unit, over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from granite_lab.logs import inspect_logs
from granite_lab.reporting.pictures import log_figure
from tests.corpus import cli
from tests.logs import make

SAMPLE = cli.SAMPLES / "virtual_v0.3_r1.csv"
PNG = b"\x89PNG"


def test_each_sensor_has_a_panel_with_its_unit_and_the_logged_values(tmp_path: Path) -> None:
    path = tmp_path / "drive.csv"
    path.write_text(make.text())
    report = inspect_logs([path]).files[0]
    assert report.trial is not None
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
    path = tmp_path / "gap.csv"
    lines = make.lines()
    rows = [lines[0]]
    for k, line in enumerate(lines[1:]):
        stamp, _, rest = line.partition(",")
        if not 250 <= k < 300:
            rows.append(f"{float(stamp) + 1.7e9:.6f},{rest}")
    path.write_text("\n".join(rows) + "\n")
    report = inspect_logs([path]).files[0]
    assert report.trial is not None
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


def test_what_cannot_be_drawn_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    text = tmp_path / "text.csv"
    text.write_text("a,b\nx,y\n")
    for given, code in (
        ((SAMPLE, "--plot", tmp_path / "a.jpg"), 2),
        ((SAMPLE, SAMPLE, "--plot", tmp_path / "a.png"), 2),
        ((text, "--plot", tmp_path / "a.png"), 3),
    ):
        done = cli.lab("inspect", *given)
        assert done.code == code
        assert done.err.startswith("error: ")
        assert "\nhint: " in done.err
    assert list(tmp_path.iterdir()) == [text]
