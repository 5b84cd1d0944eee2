"""The case for a discovery: what it says, what its pictures and tables show, and what it never leaves out."""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import json
import math
import re
import time
from pathlib import Path
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas
from matplotlib.transforms import Bbox

from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.finding import Finding, Verdict
from granite_lab.effects import library
from granite_lab.estimate import Estimate
from granite_lab.reporting import figures, write_discovery, write_report
from granite_lab.reporting.canvas import RC
from granite_lab.reporting.content import Source
from granite_lab.reporting.discovery import bare_section, section
from granite_lab.reporting.discovery.evidence import steps
from granite_lab.reporting.discovery.plot_history import history_drawings
from granite_lab.reporting.discovery.plot_where import intervals_drawing
from granite_lab.reporting.discovery.report import assemble
from granite_lab.reporting.discovery.residue import discrepancies, means
from granite_lab.reporting.discovery.tables import effects_table, gaps_table, sand_table, scales_table
from granite_lab.reporting.document import Section
from granite_lab.reporting.figures import Figure
from granite_lab.reporting.table import Table
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import BUMP, LEFT, SIZE, STRENGTH, made_up_finding
from tests.reporting.test_figures import texts
from tests.reporting.test_report import parsed

SOURCE = Source("0.1.0", "granite-lab discover trials", (), ())
VERDICTS: tuple[Verdict, ...] = ("named", "unknown", "none")


@pytest.fixture(scope="module")
def findings() -> dict[str, Finding]:
    return {v: made_up_finding(v, twins=("slip_sinkage",)) for v in VERDICTS}


@pytest.fixture
def no_png(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "to_png", lambda _: b"")


def titles(parts: tuple[Section, ...]) -> list[str]:
    return [re.sub(r"^\d+\. ", "", part.title) for part in parts]


def test_the_steps_stand_in_their_order(findings: dict[str, Finding]) -> None:
    failed = dataclasses.replace(findings["named"], failures=("design: ValueError: no bins",))
    assert titles(steps(failed, "model.toml")) == [
        "What do these trials say?", "Effects that do not matter here", "Where does the model disagree?",
        "Which candidates were tried?", "What could these trials have shown?",
        "How late are the stamps of the IMU?", "What was learnt of sand and sensors?",
        "Does it hold on trials and speeds that were left out?", "Which trials could not be used?",
        "What could not be told?", "What failed?", "What next?",
    ]  # fmt: skip


def test_a_step_without_content_is_left_out() -> None:
    alone = made_up_finding("none", speeds=(0.3,), repetitions=1)
    alone = dataclasses.replace(
        alone, dropped=(), latency=Estimate(math.nan), scales={}, sand={}, confusion=None
    )
    gone = {
        "Effects that do not matter here", "How late are the stamps of the IMU?", "What failed?",
        "What was learnt of sand and sensors?", "Which trials could not be used?",
        "Does it hold on trials and speeds that were left out?",
    }  # fmt: skip
    assert not gone & set(titles(steps(alone)))
    assert "found_held_out" not in {d.name for d in assemble(alone, "mine", SOURCE).figures}
    table = gaps_table(alone)
    assert table is not None
    assert not [c.title for c in table.columns if "left out" in c.title]


def test_the_first_page_says_what_is_missing_how_sure_and_how_much_it_closes(
    findings: dict[str, Finding],
) -> None:
    report = assemble(findings["named"], "mine", SOURCE)
    text = {a.id: a.text.replace("\u00a0", " ") for a in report.answers}
    for needed in ("Missing from the model: multi pass", "rear wheels in the compacted rut", "0.300 ± 0.004"):
        assert needed.lower() in text["missing"].lower()
    for needed in (
        "probability of 97 %", "12 of 12 trials and 4 of 4 speeds", "may as well be slip sinkage",
        "IMU stamps 4.0 ± 1.0 ms behind those of wheels and currents.",
    ):  # fmt: skip
        assert needed in text["sure"]
    assert "from 3.00 to 1.10, on trials that were left out from 3.10 to 1.15; 1 is" in text["gap"]
    assert next(a for a in report.answers if a.id == "gap").verdict.replace("\u00a0", " ") == "93 % of it"
    assert "pitch rate in steady motion (at 0.7 m/s from 0.50 s to 1.50 s, 45" in text["where"]


def test_reasons_of_a_provisional_verdict_stand_under_the_sentence() -> None:
    first = steps(made_up_finding(repetitions=1))[0]
    assert "Provisional" in getattr(first.blocks[0], "text", "")
    assert getattr(first.blocks[1], "items", ()) == ("No command was driven twice",)


@pytest.fixture(scope="module")
def drawings(findings: dict[str, Finding]) -> list[Figure]:
    found = [d for f in findings.values() for d in assemble(f, "mine", SOURCE).figures]
    named = made_up_finding(
        names=HOSTILE.replace("{", "").replace("}", "") + "$a_{{1}}$ {speed} {repetition}"
    )
    return [*found, *assemble(named, "mine", SOURCE).figures]


def test_no_text_of_a_figure_is_cut_or_covered(drawings: list[Figure]) -> None:
    for drawing in drawings:
        with mpl.rc_context(RC):
            boxes = texts(drawing.draw())
        frame = drawing.draw().bbox
        for text, box in boxes:
            inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
            assert inside, (drawing.name, text)
        for (a, box_a), (b, box_b) in itertools.combinations(boxes, 2):
            over = Bbox.intersection(box_a, box_b)
            assert over is None or over.width <= 1 or over.height <= 2, (drawing.name, a, b)


def test_every_figure_has_a_unit_and_says_what_to_see(drawings: list[Figure]) -> None:
    for drawing in drawings:
        labels = [axis.get_xlabel() for axis in drawing.draw().axes]
        assert re.search(r"\[[^\]]+\]$", next(reversed(list(filter(None, labels)))), re.M), drawing.name
        assert drawing.caption.endswith((".", ")"))
        assert "nan" not in (drawing.caption + drawing.title).lower()
        assert drawing.alt


def test_a_discrepancy_is_a_share_of_the_rms_in_motion(findings: dict[str, Finding]) -> None:
    # a Gaussian bump of height h and width 0.2 s in a drive of T seconds has an rms of h √(0.2 √(π/2) / T)
    finding = findings["unknown"]
    lengths = [float((r.std > 0).sum() * 0.02) for r in finding.residuals if r.channel == "pitch_rate"]
    expected = STRENGTH / SIZE * math.sqrt(0.2 * math.sqrt(math.pi / 2) / float(np.mean(lengths)))
    before, after = discrepancies(finding)["pitch_rate"]
    assert before == pytest.approx(expected, rel=0.01)
    assert after == pytest.approx(LEFT * expected, rel=0.01)
    assert discrepancies(finding)["wheel"] == (0.0, 0.0)
    table = gaps_table(finding)
    assert table is not None
    row = next(r for r in table.rows if r[0].text == "pitch rate")
    assert row[-3].raw == (before,)


def test_histories_show_the_discrepancy_with_its_band(findings: dict[str, Finding]) -> None:
    finding = findings["unknown"]
    drawing = next(d for d in history_drawings(finding) if d.name == "found_history_0p30")
    axes = {axis.texts[0].get_text(): axis for axis in drawing.draw().axes}
    axis = axes["pitch rate: discrepancy ± 2 std"]
    assert axis.get_ylabel() == "[mrad/s]"
    before, after = (x for x in axis.get_lines() if len(np.asarray(x.get_xdata())) > 2)
    t, drawn = (np.asarray(v, dtype=float) for v in before.get_data())
    assert np.interp(np.mean(BUMP), t, drawn) == pytest.approx(3 * STRENGTH, rel=0.01)
    t, drawn = (np.asarray(v, dtype=float) for v in after.get_data())
    assert np.interp(np.mean(BUMP), t, drawn) == pytest.approx(3 * STRENGTH * LEFT, rel=0.01)
    low, high = axis.collections[0].get_datalim(axis.transData).intervaly
    assert high == pytest.approx(3 * STRENGTH * LEFT + 2 * 0.3, rel=0.01)
    assert low == pytest.approx(-2 * 0.3, rel=0.01)
    assert "pitch rate" in axes


def test_histories_are_means_over_the_repetitions_with_gaps_left_out(findings: dict[str, Finding]) -> None:
    n, own = next((n, m) for n, m in means(findings["named"]) if (m.channel, m.variant) == ("accel_x", 0.3))
    residuals = [r for r in findings["named"].residuals if (r.channel, r.variant) == ("accel_x", 0.3)]
    assert n == len(residuals) == 3
    assert np.isnan(own.measured[42])
    np.testing.assert_allclose(own.measured[60], np.mean([r.measured[60] for r in residuals]))


def test_intervals_stand_at_their_seconds(findings: dict[str, Finding]) -> None:
    drawing = intervals_drawing(findings["named"])
    assert drawing is not None
    panels = [axis for axis in drawing.draw().axes if axis.patches]
    assert len(panels) == 4
    assert [(p.get_x(), p.get_x() + p.get_width()) for p in panels[0].patches] == [BUMP]


def cells(table: Table | None, row: int = 0) -> dict[str, str]:
    assert table is not None
    pairs = zip(table.columns, table.rows[row], strict=True)
    return {column.title: cell.text.replace("\u00a0", " ") for column, cell in pairs}


def test_a_named_effect_stands_with_size_twins_probability_and_share(findings: dict[str, Finding]) -> None:
    finding = findings["named"]
    own = cells(effects_table(finding, library(), finding.effects))
    assert own["value"] == "0.300 ± 0.004"
    assert own["cannot be told from"] == "slip sinkage"
    assert own["probability"] == "97 %"
    assert own["closes of the gap"] == "93.0 ± 2.0 %"
    small = cells(effects_table(finding, library(), finding.small, small=True))
    assert (small["effect"], small["closes of the gap"]) == ("clock offset", "2.0 ± 1.0 %")


def test_scales_and_sand_stand_in_units_of_a_reader(findings: dict[str, Finding]) -> None:
    found = {row[0].text: row[1].text for row in getattr(scales_table(findings["named"]), "rows", ())}
    assert found == {
        "a_θ, from raking to raking": "± 5.0 %",
        "wheel radius, mean of all": "± 0.20 %",
        "tilt of the IMU": "± 0.57 °",
    }
    # a logarithm of 0.010 ± 0.005 is 1.005 ± 0.505 %
    assert cells(sand_table(findings["named"]))["off the file's value"] == "1.0 ± 0.5 %"


def test_the_report_has_all_its_files_and_the_json_of_the_command(discovery_folder: Path) -> None:
    for name in ("index.html", "report.md", "finding.json"):
        assert (discovery_folder / name).stat().st_size > 1000
    document = json.loads((discovery_folder / "finding.json").read_text(encoding="utf-8"))
    expected = finding_as_json(made_up_finding(twins=("slip_sinkage",)), discovery_folder / "model.toml")
    assert document == json.loads(json.dumps(expected, allow_nan=False))
    assert document["schema"] == "granite-lab/discovery/2"
    ids = {path.stem for path in (discovery_folder / "figures").glob("*.svg")}
    assert {path.stem for path in (discovery_folder / "figures").glob("*.png")} == ids
    assert {"found_gap", "found_discrepancy", "found_candidates", "found_held_out", "found_detectable"} <= ids
    for path in (discovery_folder / "figures").glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")


def test_virtual_data_are_labelled_on_every_figure_and_in_every_table(discovery_folder: Path) -> None:
    for path in (discovery_folder / "figures").glob("*.svg"):
        assert "virtual" in path.read_text(encoding="utf-8"), path
    for path in (discovery_folder / "tables").glob("found_*.csv"):
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
        assert rows
        assert all(row["data"] == "virtual" for row in rows), path
    text = (discovery_folder / "index.html").read_text(encoding="utf-8")
    for title in re.findall(r"<figcaption><strong>(.*?)</strong>", text):
        assert "(virtual data)" in title


@pytest.mark.usefixtures("no_png")
def test_a_real_search_is_not_called_virtual(tmp_path: Path) -> None:
    finding = made_up_finding(virtual=False, names="trial {speed} {repetition}", speeds=(0.3,))
    write_discovery(finding, tmp_path / "real", SOURCE)
    for path in (tmp_path / "real").rglob("*"):
        if path.suffix in (".html", ".md", ".svg", ".csv"):
            text = re.sub(r"<style>.*?</style>", "", path.read_text(encoding="utf-8"), flags=re.S)
            assert "virtual" not in text.lower(), path


@pytest.mark.usefixtures("no_png")
def test_the_same_finding_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        write_discovery(made_up_finding(speeds=(0.3, 0.7)), tmp_path / name / "report", SOURCE)
    files = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert files
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


@pytest.mark.usefixtures("no_png")
def test_the_case_is_a_section_of_a_studys_report(tmp_path: Path, findings: dict[str, Finding]) -> None:
    study = made_up_study(speeds=(0.5,), repetitions=1)
    write_report(study, tmp_path / "study", section(findings["named"], "model.toml"))
    page = parsed(tmp_path / "study")
    assert {"discovery", "found_gap", "found_discrepancy", "found_candidates"} <= set(page.ids)
    text = " ".join("".join(page.text).split())
    assert text.index("93 % of the gap is closed") < text.index("1. What do these trials say?")
    document = json.loads((tmp_path / "study" / "report.json").read_text(encoding="utf-8"))
    assert document["discovery"]["effects"][0]["id"] == "multi_pass"
    bare = bare_section(findings["named"], "model.toml")
    assert bare.data == section(findings["named"], "model.toml").data


def test_few_channels_and_one_speed_make_a_report_too() -> None:
    finding = made_up_finding(speeds=(0.2,), repetitions=2, channels=("wheel", "wheel_split"))
    report = assemble(finding, "mine", SOURCE)
    drawn = {d.name for d in report.figures}
    assert drawn >= {"found_gap", "found_history_0p20"}
    assert "found_intervals" not in drawn  # none of these channels is off


def test_an_effect_without_numbers_and_a_share_that_is_not_known_make_a_report_too() -> None:
    finding = made_up_finding()
    bare = dataclasses.replace(finding.effects[0], parameters=(), closes=Estimate(math.nan))
    finding = dataclasses.replace(finding, effects=(bare,), remainder=math.nan, candidates=(), detectable=())
    text = " ".join(a.text for a in assemble(finding, "mine", SOURCE).answers)
    assert "()" not in text
    assert "nan" not in text.lower().split()


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
    study = made_up_study(speeds=(0.2, 0.3, 0.5, 0.7), repetitions=3)
    discovered = section(made_up_finding(), "model.toml")
    before = cost_of_a_plain_figure()
    begin = time.process_time()
    write_report(study, tmp_path / "study", discovered)
    cost = time.process_time() - begin
    plain = (before + cost_of_a_plain_figure()) / 2
    drawn = len(list((tmp_path / "study").rglob("*.svg")))
    assert drawn > 35
    assert cost <= 2 * drawn * plain
    assert sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file()) <= 15_000_000
