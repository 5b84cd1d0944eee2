"""The files of a report: well formed, safe, complete, marked where virtual, and the same bytes each time."""

import csv
import dataclasses
import io
import json
import math
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from markdown_it import MarkdownIt

from granite_lab.estimate import Estimate
from granite_lab.files import write_table
from granite_lab.folders import LIST, replacing
from granite_lab.reporting import render, write, write_report
from granite_lab.reporting.json_report import to_json
from granite_lab.reporting.names import from_here
from granite_lab.reporting.report import study_report
from granite_lab.results import Source, StudyResult, command_of
from tests.corpus.cli import strict
from tests.fitting.made_up import HEALTHY
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import made_up_finding

VOID = {"meta", "link", "br", "img", "input", "hr"}
FOLDERS = ["folder", "hostile_folder", "discovery_folder"]


class Strict(HTMLParser):
    """Collects what a page holds, and fails where a tag is not closed in order.

    Attributes:
        open: tags that are not closed yet.
        ids, attributes, headings, text: all of the page.
        seen: text that a reader sees while all details are closed, inside figures too.
        figures: how many of them are seen.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.ids: list[str] = []
        self.attributes: list[tuple[str, str, str | None]] = []
        self.headings: list[int] = []
        self.text: list[str] = []
        self.seen: list[str] = []
        self.figures = 0
        self.feed((folder / "index.html").read_text(encoding="utf-8"))
        self.close()
        assert self.open == []

    def hidden(self) -> bool:
        folded = "details" in self.open and "summary" not in self.open
        return folded or "script" in self.open or "style" in self.open or "title" in self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value) for name, value in attrs]
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag not in VOID:
            self.open.append(tag)
        self.figures += tag == "figure" and not self.hidden()

    def handle_endtag(self, tag: str) -> None:
        assert tag in VOID or self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)
        self.seen += [] if self.hidden() else [data]


@pytest.mark.parametrize("which", FOLDERS)
def test_the_page_is_well_formed_and_needs_nothing_else(which: str, request: pytest.FixtureRequest) -> None:
    folder: Path = request.getfixturevalue(which)
    page = Strict(folder)
    tags = {tag for tag, _, _ in page.attributes}
    assert not tags & {"iframe", "object", "embed", "base", "form"}
    scripts = re.findall(r"<script>(.*?)</script>", (folder / "index.html").read_text(encoding="utf-8"), re.S)
    template = Path(render.__file__).parent / "templates" / "report.js"
    assert [s.strip() for s in scripts] == [template.read_text(encoding="utf-8").strip()]
    assert len(page.ids) == len(set(page.ids))
    for tag, name, value in page.attributes:
        assert not name.startswith("on")
        assert (tag, name) != ("details", "open")
        if name in ("src", "href", "xlink:href", "data", "action", "poster"):
            inside = value[0] == "#" and value[1:] in page.ids
            assert value.startswith("data:,") or inside or (folder / value.partition("#")[0]).exists(), value
    text = (folder / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)
    assert "@import" not in text
    assert set(re.findall(r"url\(([^)]*)\)", text)) <= {f"#{i}" for i in page.ids}


def test_a_screen_reader_finds_its_way(folder: Path) -> None:
    page = Strict(folder)
    assert ("html", "lang", "en") in page.attributes
    assert page.headings[0] == 1
    assert page.headings.count(1) == 1
    assert all(b <= a + 1 for a, b in zip(page.headings, page.headings[1:], strict=False))
    figures = [value for tag, name, value in page.attributes if (tag, name) == ("svg", "aria-label")]
    assert len(figures) == len(list((folder / "figures").glob("*.svg")))
    assert all(figures)
    text = (folder / "index.html").read_text(encoding="utf-8")
    assert all('scope="' in cell for cell in re.findall(r"<th[ >][^>]*>", text))


@pytest.mark.parametrize("which", ["folder", "discovery_folder"])
def test_virtual_data_are_labelled_everywhere(which: str, request: pytest.FixtureRequest) -> None:
    folder: Path = request.getfixturevalue(which)
    page = (folder / "index.html").read_text(encoding="utf-8")
    captions = re.findall(r"<figcaption><strong>(.*?)</strong>", page)
    titles = re.findall(r"<h3 id=[^>]*>(.*?)</h3>", page)
    plain = {title for title in [*captions, *titles] if "(virtual data)" not in title}
    assert plain <= {"Parameters in force", "Files that were read"}
    assert len(captions) > 3
    assert len(titles) > 3
    figures, tables = list((folder / "figures").glob("*.svg")), list((folder / "tables").glob("*.csv"))
    assert len(figures) > 3
    assert len(tables) > 3
    for path in figures:
        assert ElementTree.parse(path).getroot().tag.endswith("svg")
        assert "virtual" in path.read_text(encoding="utf-8"), path
    for path in tables:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
        assert rows
        if path.stem not in ("parameters", "inputs"):
            assert all(row["data"] == "virtual" for row in rows), path
    numbers = folder / ("report.json" if which == "folder" else "finding.json")
    assert json.loads(numbers.read_text(encoding="utf-8"))["virtual"] is True


Writer = Callable[[Path, bool], Path]


def write_small_study(folder: Path, virtual: bool) -> Path:
    return write_report(made_up_study(virtual, speeds=(0.5,), repetitions=1), folder)


def write_small_search(folder: Path, virtual: bool) -> Path:
    finding = made_up_finding(virtual=virtual, names="trial {speed} {repetition}", speeds=(0.3,))
    source = Source("0.1.0", "granite-lab discover trials", (), ())
    return write_report(StudyResult("real", (), (), None, source, finding), folder)


@pytest.mark.parametrize("writer", [write_small_study, write_small_search])
def test_a_real_experiment_is_not_virtual_and_gives_the_same_bytes(
    writer: Writer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in "ab":
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        writer(tmp_path / name / "report", False)
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert files
    for file in files:
        data = (tmp_path / "a" / file).read_bytes()
        assert data == (tmp_path / "b" / file).read_bytes(), file
        if file.suffix in (".html", ".md", ".svg", ".csv"):
            text = re.sub(r"<(style|script)>.*?</\1>", "", data.decode(), flags=re.S)
            assert "virtual" not in text.lower(), file


def test_json_follows_its_schema(folder: Path, study: StudyResult) -> None:
    report = strict((folder / "report.json").read_text(encoding="utf-8"))
    assert report["schema"] == "granite-lab/report/2"
    assert [row["speed_mps"] for row in report["answers"]["speeds"]] == [0.3, 0.7]
    slips = [t.motion.slip_ratio.value for t in study.trials[:2]]
    own = report["answers"]["speeds"][0]["slip"]
    assert own["unit"] == "%"
    assert own["value"] == pytest.approx(100 * np.mean(slips), abs=0.5 * own["std"])
    assert report["a_theta"]["ci95"] == list(study.a_theta.ci95)
    assert report["a_theta"]["agrees"] is True
    assert [t["name"] for t in report["trials"]] == [t.trial.name for t in study.trials]
    assert report["discovery"] is None
    assert {row["phase"] for row in report["misfits"]} == {"all", "rest", "accelerate", "steady", "brake"}
    for figure in report["figures"]:
        assert all((folder / figure[kind]).is_file() for kind in ("svg", "png"))
        assert (folder / figure["pdf"]).read_bytes().startswith(b"%PDF")
    assert all((folder / table[kind]).is_file() for table in report["tables"] for kind in ("csv", "latex"))
    assert len(report["provenance"]["inputs"]) == 4


def test_hostile_names_stay_text_on_the_page_and_in_markdown(hostile_folder: Path) -> None:
    assert " ".join(HOSTILE.split()) in " ".join("".join(Strict(hostile_folder).text).split())
    text = (hostile_folder / "report.md").read_text(encoding="utf-8")
    tokens = MarkdownIt("commonmark").enable("table").parse(text)
    inline = [child for token in tokens for child in token.children or ()]
    kinds = {token.type for token in [*tokens, *inline]}
    assert not kinds & {"html_block", "html_inline", "link_open", "code_inline", "code_block"}
    fences = [token.content for token in tokens if token.type == "fence"]
    assert [content.count("\n") for content in fences] == [1]  # the command, on one line
    assert " ".join(HOSTILE.split()) in " ".join(
        "".join(t.content for t in inline if t.type.startswith("text")).split()
    )
    for block in re.findall(r"(?:^\|.*\n)+", text, flags=re.M):
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in block.splitlines()}) == 1


def test_no_cell_of_a_csv_is_a_formula(hostile_folder: Path) -> None:
    number = re.compile(r"-?[\d.]+(e[-+]\d+)?")
    tables = list((hostile_folder / "tables").glob("*.csv"))
    assert len(tables) > 3
    for path in tables:
        rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
        assert len({len(row) for row in rows}) == 1, path
        for cell in (cell for row in rows for cell in row):
            plain = not cell.startswith(("=", "+", "-", "@", "\t", "\r"))
            assert number.fullmatch(cell) or plain, (path, cell)


FORMULAS = ("=cmd|' C calc'!A0", "+1+1", "-2+3", "@SUM(A1)", " =1", "\t=1", "plain\n=1")


def test_no_text_of_a_table_of_numbers_is_a_formula(tmp_path: Path) -> None:
    """Also of `simulate`, `ingest` and all others that write without a report."""
    table = pd.DataFrame({"=name": FORMULAS, "x": np.linspace(-3.0, 3.0, len(FORMULAS))})
    for one, numbers in ((table, ["-3"]), (table[["=name"]], [])):
        write_table(tmp_path / "t.csv", one)
        rows = list(csv.reader(io.StringIO((tmp_path / "t.csv").read_text(encoding="utf-8"))))
        assert len(rows) == 1 + len(FORMULAS)
        assert not any(row[0].lstrip().startswith(("=", "+", "-", "@")) for row in rows)
        assert rows[1][1:] == numbers  # numbers stay numbers


def test_what_could_not_be_had_is_a_dash_and_null(tmp_path: Path) -> None:
    """A log without IMU, currents or a usable fit still ends in a report."""
    study = made_up_study(speeds=(0.5,), repetitions=1)
    c = study.trials[0]
    nothing = np.full(len(c.t), math.nan)

    def lost(record: Any, *names: str, **others: Any) -> Any:
        unknown = Estimate(math.nan)
        known = {name: getattr(record, name) for name in names}
        gone = {name: unknown if isinstance(x, Estimate) else nothing for name, x in known.items()}
        return dataclasses.replace(record, **gone, **others)

    biases = [f"{sensor}_bias{std}" for sensor in ("accel", "gyro") for std in ("", "_std")]
    health = lost(HEALTHY, *biases, grade="poor")
    motion = lost(c.motion, "v", "v_std", "pitch", "slip_ratio", "clock_offset", health=health)
    status = dict.fromkeys(("status", "status_trajectory"), "not_evaluated")
    fit = lost(c.fit, "k92", "k92_trajectory", "slip_measured", slip_simulated=math.nan, **status)
    measured = {name: values if name.startswith("wheel") else nothing for name, values in c.measured.items()}
    trials = (dataclasses.replace(c, motion=motion, fit=fit, measured=measured, misfits=()),)
    folder = tmp_path / "poor"
    write_report(dataclasses.replace(study, trials=trials, a_theta=None), folder)
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert report["trials"][0]["slip_ratio"] == {"value": None, "std": None}
    assert report["a_theta"] is None
    assert "not measured" in (folder / "figures" / "motion_0p50.svg").read_text(encoding="utf-8")
    assert not re.search(r"\bnan\b", (folder / "report.md").read_text(encoding="utf-8"), flags=re.I)


def test_a_second_report_replaces_the_first_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "report"
    (folder / "recordings").mkdir(parents=True)
    (folder / "recordings" / "a.rrd").write_text("old")
    with replacing(folder, "report") as new:
        for name in ("figures/stale.svg", "index.html"):
            (new / name).parent.mkdir(parents=True, exist_ok=True)
            (new / name).write_text("old")

    def fail(*_: object, **__: object) -> str:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(write, "to_markdown", fail)
        with pytest.raises(KeyboardInterrupt):
            write_small_study(folder, True)
    held = {p.read_text() for p in folder.rglob("*.*") if p.name != LIST}
    assert held == {"old"}  # an interrupted report leaves the old one
    write_small_study(folder, True)
    assert (folder / "recordings" / "a.rrd").read_text() == "old"
    assert not (folder / "figures" / "stale.svg").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["report"]


def test_a_command_that_names_a_thousand_logs_is_shortened_on_the_page_alone(study: StudyResult) -> None:
    command = "granite-lab study " + " ".join(f"trial_{k}.csv" for k in range(1000)) + " --soil wet_sand"
    result = dataclasses.replace(study, source=dataclasses.replace(study.source, command=command))
    report = study_report(result)
    page = write.to_markdown("report.md", report=report)
    assert "trial_1.csv" in page
    assert "trial_500.csv" not in page
    assert "--soil wet_sand (shortened)" in page
    assert json.loads(to_json(result, report))["provenance"]["command"] == command


def test_the_command_of_a_folder_names_the_folder_and_can_be_pasted(tmp_path: Path) -> None:
    folder = tmp_path / "my sand"
    folder.mkdir()
    logs = [folder / f"{k}.csv" for k in range(3)]
    for log in logs:
        log.write_text("")
    assert command_of("study", logs, (("soil", "wet sand.toml"),)) == (
        f"granite-lab study '{folder}' --soil 'wet sand.toml'"
    )
    assert command_of("study", logs[:2]).count(".csv") == 2


def test_commands_name_the_folder_so_that_they_run_from_where_one_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert from_here(tmp_path / "reports" / "a") == "reports/a"
    assert from_here(Path("reports/a")) == "reports/a"
    assert from_here(tmp_path.parent / "b") == (tmp_path.parent / "b").as_posix()
