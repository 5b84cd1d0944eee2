from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from markdown_it import MarkdownIt

from granite_lab.errors import LabError
from granite_lab.estimate import Estimate
from granite_lab.parameters import load_paper
from granite_lab.reporting import write_comparison, write_report
from granite_lab.reporting.content import Failure, StudyResult
from granite_lab.reporting.json_report import to_json
from granite_lab.reporting.report import study_report
from granite_lab.reporting.rounding import shown_as
from granite_lab.reporting.summary import Gap, by_speed, channels_of, gaps, mean_over
from granite_lab.reporting.tables import trial_table
from granite_lab.reporting.write import to_markdown
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study

VOID = {"meta", "link", "br", "img", "input", "hr"}


class Strict(HTMLParser):
    """Collects what a page holds, and fails where a tag is not closed in order."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.ids: list[str] = []
        self.attributes: list[tuple[str, str, str | None]] = []
        self.headings: list[int] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value) for name, value in attrs]
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def parsed(folder: Path) -> Strict:
    page = Strict()
    page.feed((folder / "index.html").read_text(encoding="utf-8"))
    page.close()
    assert page.open == []
    return page


@pytest.mark.parametrize("which", ["folder", "hostile_folder", "discovery_folder"])
def test_the_page_is_well_formed_and_needs_nothing_else(which: str, request: pytest.FixtureRequest) -> None:
    folder: Path = request.getfixturevalue(which)
    page = parsed(folder)
    tags = {tag for tag, _, _ in page.attributes} | set(page.open)
    assert not tags & {"script", "iframe", "object", "embed", "base", "form"}
    assert len(page.ids) == len(set(page.ids))
    for _, name, value in page.attributes:
        assert not name.startswith("on")
        if name in ("src", "href", "xlink:href", "data", "action", "poster"):
            assert value is not None
            assert value.startswith(("#", "data:,"))
            if value.startswith("#"):
                assert value[1:] in page.ids
    text = (folder / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)
    assert "@import" not in text
    assert set(re.findall(r"url\(([^)]*)\)", text)) <= {f"#{i}" for i in page.ids}


def test_a_screen_reader_finds_its_way(folder: Path) -> None:
    page = parsed(folder)
    assert ("html", "lang", "en") in page.attributes
    assert page.headings[0] == 1
    assert page.headings.count(1) == 1
    assert all(b <= a + 1 for a, b in zip(page.headings, page.headings[1:], strict=False))
    figures = [value for tag, name, value in page.attributes if (tag, name) == ("svg", "aria-label")]
    assert len(figures) == len(list((folder / "figures").glob("*.svg")))
    assert all(figures)
    text = (folder / "index.html").read_text(encoding="utf-8")
    assert all('scope="' in cell for cell in re.findall(r"<th[ >][^>]*>", text))


def test_the_first_page_answers_before_the_evidence(folder: Path) -> None:
    text = (folder / "index.html").read_text(encoding="utf-8")
    first = re.sub(r"<[^>]+>", "", text[text.index("<h1") : text.index("<section")]).replace("\u00a0", " ")
    for needed in ("0.3 m/s", "0.7 m/s", "95 %", "4.919", "Not tested", "Virtual data.", "noise", "missing"):
        assert needed in first


def test_virtual_data_are_labelled_everywhere(folder: Path) -> None:
    page = (folder / "index.html").read_text(encoding="utf-8")
    for title in re.findall(r"<h3 id=[^>]*>(.*?)</h3>", page):
        assert "(virtual data)" in title or title in ("Parameters in force", "Files that were read")
    for title in re.findall(r"<figcaption><strong>(.*?)</strong>", page):
        assert "(virtual data)" in title
    for path in (folder / "figures").glob("*.svg"):
        drawn = path.read_text(encoding="utf-8")
        assert "virtual" in drawn, path
    for name in ("trials", "slip_by_speed", "channels", "misfits"):
        rows = list(
            csv.DictReader((folder / "tables" / f"{name}.csv").read_text(encoding="utf-8").splitlines())
        )
        assert rows
        assert all(row["data"] == "virtual" for row in rows)
    assert json.loads((folder / "report.json").read_text(encoding="utf-8"))["virtual"] is True


def test_a_real_experiment_is_not_called_virtual(tmp_path: Path) -> None:
    write_report(made_up_study(virtual=False, speeds=(0.5,), repetitions=1), tmp_path / "real")
    for path in (tmp_path / "real").rglob("*"):
        if path.suffix in (".html", ".md", ".svg", ".csv"):
            text = path.read_text(encoding="utf-8")
            text = re.sub(r"<style>.*?</style>", "", text, flags=re.S)
            assert "virtual" not in text.lower(), path


def test_json_follows_its_schema(folder: Path, study: StudyResult) -> None:
    def refuse(constant: str) -> float:
        raise AssertionError(constant)

    text = (folder / "report.json").read_text(encoding="utf-8")
    report = json.loads(text, parse_constant=refuse)
    assert report["schema"] == "granite-lab/report/2"
    assert [row["speed_mps"] for row in report["answers"]["speeds"]] == [0.3, 0.7]
    slips = [t.comparison.motion.slip_ratio.value for t in study.trials[:2]]
    own = report["answers"]["speeds"][0]["slip"]
    assert own["unit"] == "%"
    assert own["value"] == pytest.approx(100 * np.mean(slips), abs=0.5 * own["std"])
    assert report["a_theta"]["ci95"] == [4.816, 5.044]
    assert report["a_theta"]["agrees"] is True
    assert [t["name"] for t in report["trials"]] == [t.trial.name for t in study.trials]
    assert report["discovery"] is None
    assert {row["phase"] for row in report["misfits"]} == {"all", "rest", "accelerate", "steady", "brake"}
    for figure in report["figures"]:
        assert (folder / figure["svg"]).is_file()
        assert (folder / figure["png"]).is_file()
        assert (folder / figure["pdf"]).read_bytes().startswith(b"%PDF")
    for table in report["tables"]:
        assert (folder / table["csv"]).is_file()
    assert len(report["provenance"]["inputs"]) == 4


def test_the_same_study_gives_the_same_bytes(tmp_path: Path) -> None:
    result = made_up_study(speeds=(0.5,), repetitions=1)
    for name in "ab":
        write_report(result, tmp_path / name / "report")
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert files
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_hostile_names_stay_text_in_html(hostile_folder: Path) -> None:
    page = parsed(hostile_folder)
    shown = " ".join("".join(page.text).split())
    assert " ".join(HOSTILE.split()) in shown


def test_hostile_names_stay_text_in_markdown(hostile_folder: Path) -> None:
    text = (hostile_folder / "report.md").read_text(encoding="utf-8")
    tokens = MarkdownIt("commonmark").enable("table").parse(text)
    inline = [child for token in tokens for child in token.children or ()]
    kinds = {token.type for token in [*tokens, *inline]}
    assert not kinds & {"html_block", "html_inline", "link_open", "code_inline", "code_block"}
    assert sum(token.type == "fence" for token in tokens) == 1  # the command, on one line
    assert all(token.content.count("\n") == 1 for token in tokens if token.type == "fence")
    assert " ".join(HOSTILE.split()) in " ".join(
        "".join(t.content for t in inline if t.type.startswith("text")).split()
    )
    for block in re.findall(r"(?:^\|.*\n)+", text, flags=re.M):
        widths = {len(re.findall(r"(?<!\\)\|", line)) for line in block.splitlines()}
        assert len(widths) == 1


def test_no_cell_of_a_csv_is_a_formula(hostile_folder: Path) -> None:
    number = re.compile(r"-?[\d.]+(e[-+]\d+)?")
    for path in (hostile_folder / "tables").glob("*.csv"):
        rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
        assert len({len(row) for row in rows}) == 1, path
        for cell in (cell for row in rows for cell in row):
            assert number.fullmatch(cell) or not cell.startswith(("=", "+", "-", "@", "\t", "\r")), (
                path,
                cell,
            )


def test_what_could_not_be_had_is_a_dash_and_null(tmp_path: Path) -> None:
    """A log without IMU, currents or a usable fit still ends in a report."""
    study = made_up_study(speeds=(0.5,), repetitions=1)
    r = study.trials[0]
    c, m, nothing = r.comparison, r.comparison.motion, np.full(len(r.comparison.t), math.nan)
    lost = ("velocity", "torque_f", "torque_r", "pitch", "accel", "pitch_rate", "slip_f", "slip_r")
    motion = dataclasses.replace(
        m, v=nothing, v_std=nothing, pitch=nothing, slip_ratio=Estimate(math.nan),
        clock_offset=Estimate(math.nan),
        health=dataclasses.replace(
            m.health, t=np.empty(0), kind=(), innovation=np.empty(0), innovation_std=np.empty(0), nis={},
            rests=(),
            accel_bias=nothing, accel_bias_std=nothing, gyro_bias=nothing, gyro_bias_std=nothing, good=False,
        ),
    )  # fmt: skip
    fit = dataclasses.replace(
        c.fit, k92=Estimate(math.nan), k92_trajectory=Estimate(math.nan), slip_measured=Estimate(math.nan),
        slip_simulated=math.nan, status="not_evaluated", status_trajectory="not_evaluated",
    )  # fmt: skip
    comparison = dataclasses.replace(
        c, motion=motion, fit=fit, measured=c.measured | dict.fromkeys(lost, nothing), misfits=()
    )
    trials = (dataclasses.replace(r, comparison=comparison),)
    write_report(dataclasses.replace(study, trials=trials, a_theta=None), tmp_path / "poor")
    report = json.loads((tmp_path / "poor" / "report.json").read_text(encoding="utf-8"))
    assert report["trials"][0]["slip_ratio"] == {"value": None, "std": None}
    assert report["a_theta"] is None
    assert "not measured" in (tmp_path / "poor" / "figures" / "motion_0p50.svg").read_text(encoding="utf-8")
    assert not re.search(
        r"\bnan\b", (tmp_path / "poor" / "report.md").read_text(encoding="utf-8"), flags=re.I
    )


def test_failures_alone_make_a_report_too(tmp_path: Path) -> None:
    study = made_up_study(speeds=(0.5,), repetitions=1)
    failed = dataclasses.replace(
        study, trials=(), a_theta=None, failures=(Failure("x", "x.csv: is empty", "log again"),)
    )
    page = write_report(failed, tmp_path / "failed").read_text(encoding="utf-8")
    assert "x.csv: is empty (log again)" in page


@pytest.fixture
def no_png(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what takes longest where a test is not about pictures."""
    from granite_lab.reporting import canvas

    monkeypatch.setattr(canvas, "DPI", 10)


@pytest.mark.usefixtures("no_png")
def test_a_second_report_replaces_the_first_and_nothing_else(tmp_path: Path) -> None:
    folder = tmp_path / "report"
    (folder / "recordings").mkdir(parents=True)
    (folder / "recordings" / "a.rrd").write_bytes(b"kept")
    (folder / "figures").mkdir()
    (folder / "figures" / "stale.svg").write_text("old")
    write_report(made_up_study(speeds=(0.5,), repetitions=1), folder)
    assert (folder / "recordings" / "a.rrd").read_bytes() == b"kept"
    assert not (folder / "figures" / "stale.svg").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["report"]


@pytest.mark.usefixtures("no_png")
def test_an_interrupted_report_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from granite_lab.reporting import write

    folder = tmp_path / "report"
    folder.mkdir()
    (folder / "index.html").write_text("old")

    def fail(*_: object, **__: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(write, "to_markdown", fail)
    with pytest.raises(KeyboardInterrupt):
        write_report(made_up_study(speeds=(0.5,), repetitions=1), folder)
    assert [p.name for p in folder.iterdir()] == ["index.html"]
    assert [p.name for p in tmp_path.iterdir()] == ["report"]


def test_a_folder_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(LabError, match="file") as caught:
        write_report(made_up_study(speeds=(0.5,), repetitions=1), tmp_path / "file" / "report")
    assert caught.value.hint


def test_a_comparison_is_figures_and_tables(tmp_path: Path, study: StudyResult) -> None:
    written = write_comparison([study.trials[0].comparison], tmp_path / "compare")
    assert all(path.is_file() for path in written)
    assert {path.suffix for path in written} == {".svg", ".png", ".pdf", ".csv", ".tex"}


def test_svg_files_are_valid_xml(folder: Path) -> None:
    for path in (folder / "figures").glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")


def test_the_mean_takes_the_wider_of_two_intervals() -> None:
    # Scatter 0.01 over three trials: Student's t with two degrees of freedom is 4.3027.
    scattered = mean_over([Estimate(0.1, 1e-4), Estimate(0.11, 1e-4), Estimate(0.12, 1e-4)])
    assert scattered.high - scattered.value == pytest.approx(4.302653 * 0.01 / math.sqrt(3), rel=1e-6)
    # Alike by chance: the stated uncertainty holds.
    alike = mean_over([Estimate(0.1, 0.03)] * 3)
    assert alike.high - alike.value == pytest.approx(1.959964 * 0.03 / math.sqrt(3), rel=1e-6)
    assert mean_over([Estimate(0.1, 0.02)]).low == pytest.approx(0.1 - 1.959964 * 0.02)
    assert mean_over([Estimate(math.nan)]).n == 0


def test_repetitions_are_grouped_and_the_middle_one_is_drawn(study: StudyResult) -> None:
    speeds = by_speed(study, load_paper())
    assert [(s.velocity, len(s.results)) for s in speeds] == [(0.3, 2), (0.7, 2)]
    assert speeds[1].paper_k92 == 0.026
    three = by_speed(made_up_study(speeds=(0.2,), repetitions=3), load_paper())[0]
    slips = sorted(r.comparison.motion.slip_ratio.value for r in three.results)
    assert three.typical.comparison.motion.slip_ratio.value == slips[1]


def gap(normalised: float, rms: float = 0.05, phase: str = "steady", channel: str = "velocity") -> Gap:
    return Gap(channel, "m/s", phase, rms, 0.0, rms, normalised, size=1.0, trials=1)


def verdict(normalised: float, rms: float = 0.05) -> str:
    (judged,) = channels_of({("velocity", "all"): gap(normalised, rms, phase="all")})
    return judged.verdict


def test_a_quantity_is_judged_by_its_noise_and_its_largest_value() -> None:
    assert verdict(1.4) == "agrees"
    assert verdict(2.0) == "differs"
    assert verdict(50.0) == "differs clearly"
    assert verdict(50.0, rms=0.009) == "differs by less than 1\u00a0%"
    assert verdict(math.nan).startswith("not judged")
    # a difference of 74 % of the largest value, hidden in the noise, is no agreement
    assert verdict(0.61, rms=0.74) == "not judged, noise too large"


def test_the_worst_phase_is_the_one_furthest_beyond_its_noise() -> None:
    phases = {"all": 99.0, "brake": 2.0, "steady": 9.0, "rest": math.nan}
    (judged,) = channels_of({("velocity", p): gap(x, phase=p) for p, x in phases.items()})
    assert judged.worst == "in steady motion"


def test_the_speeds_of_four_wheels_are_pooled_by_their_squares(study: StudyResult) -> None:
    pooled = gaps([r.comparison for r in study.trials])
    own = [m for r in study.trials for m in r.comparison.misfits if m.phase == "all"]
    wheels = [m for m in own if m.channel.startswith("wheel_")]
    mean = np.average([m.rms**2 for m in wheels], weights=[m.samples for m in wheels])
    assert pooled["wheels", "all"].rms == pytest.approx(math.sqrt(mean))
    assert not any(channel.startswith("wheel_") for channel, _ in pooled)


def test_stamps_that_come_late_are_said_to_be_late() -> None:
    # `clock_offset` is to be added to the wheels' stamps: 12.3 ms to add means that they are early.
    table = trial_table(made_up_study(speeds=(0.5,), repetitions=1))
    at = next(k for k, c in enumerate(table.columns) if c.title == "wheel stamps late [ms]")
    assert table.rows[0][at].text == "−12.3 ± 1.1"
    assert table.rows[0][at].raw == (-0.0123, 0.0011)


def test_a_difference_of_slip_ratios_is_in_points() -> None:
    assert shown_as("-") == ("points", 100.0)
    whole = Gap("slip_f", "-", "all", 0.15, 0.0, 0.3, 28.0, 0.5, 3)
    (judged,) = channels_of({("slip_f", "all"): whole})
    assert (judged.rms, judged.unit) == (15.0, "points")


def test_a_command_that_names_a_thousand_logs_is_shortened_on_the_page_alone(study: StudyResult) -> None:
    command = "granite-lab study " + " ".join(f"trial_{k}.csv" for k in range(1000)) + " --soil wet_sand"
    result = dataclasses.replace(study, source=dataclasses.replace(study.source, command=command))
    report = study_report(result)
    page = to_markdown("report.md", report=report)
    assert "trial_1.csv" in page
    assert "trial_500.csv" not in page
    assert "--soil wet_sand (shortened)" in page
    assert json.loads(to_json(result, report))["provenance"]["command"] == command
