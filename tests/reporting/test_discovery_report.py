"""The case for a discovery: what it says, what its pictures show, and what it never leaves out."""

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
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from granite_lab.discovery import Finding, finding_as_json
from granite_lab.discovery.finding import Verdict
from granite_lab.effects import library
from granite_lab.model import simulate
from granite_lab.parameters import load_robot, load_soil, variant_of
from granite_lab.reporting import figures, write, write_discovery, write_report
from granite_lab.reporting.canvas import RC, Drawing
from granite_lab.reporting.content import Source
from granite_lab.reporting.discovery import section
from granite_lab.reporting.discovery.answers import missing_answer, sure_answer
from granite_lab.reporting.discovery.evidence import steps
from granite_lab.reporting.discovery.plot_law import law_drawing
from granite_lab.reporting.discovery.plot_left import left_drawing
from granite_lab.reporting.discovery.plot_where import intervals_drawing, map_drawing
from granite_lab.reporting.discovery.report import assemble
from granite_lab.reporting.discovery.residue import means, spectra, strengths
from granite_lab.reporting.discovery.tables import intervals_table
from granite_lab.reporting.document import Gallery, Section
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import CHANNELS, made_up_finding
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


def test_a_named_effect_goes_through_every_step(findings: dict[str, Finding]) -> None:
    assert titles(steps(findings["named"], "model.toml")) == [
        "Where do model and trials disagree?", "Which effect explains it?",
        "Does it hold on trials that were left out?", "What cannot be told apart?", "How large is it?",
        "How much of the gap closes?", "Before and after, over time", "What is left, and is it noise?",
        "What could these trials show?", "What could not be told", "What next?",
    ]  # fmt: skip


def test_an_unknown_effect_is_drawn_as_a_law_and_nothing_is_claimed_of_its_size(
    findings: dict[str, Finding],
) -> None:
    found = titles(steps(findings["unknown"]))
    assert "What does the missing quantity look like?" in found
    assert not {"How large is it?", "What cannot be told apart?"} & set(found)


def test_nothing_missing_tells_what_would_have_been_seen(findings: dict[str, Finding]) -> None:
    found = titles(steps(findings["none"]))
    assert "What could these trials show?" in found
    assert not {"How much of the gap closes?", "Does it hold on trials that were left out?"} & set(found)


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_step_but_limits_and_advice_has_a_picture(findings: dict[str, Finding], verdict: str) -> None:
    for step in steps(findings[verdict]):
        if not step.id.endswith(("limits", "next")):
            assert any(isinstance(block, Gallery) for block in step.blocks), step.title


def test_the_first_page_says_what_is_missing_how_sure_and_how_much_it_closes(
    findings: dict[str, Finding],
) -> None:
    report = assemble(findings["named"], "mine", SOURCE)
    text = {a.id: a.text.replace("\u00a0", " ") for a in report.answers}
    for needed in ("ear wheels in the compacted rut", "0.300 ± 0.004", "slip sinkage", "5000", "18 in one"):
        assert needed in text["missing"]
    # (3.10 - 1.15) / (3.10 - 1) of the gap on trials left out
    assert "3.10 to 1.15 times the noise: 93 % of it closes" in text["missing"]
    assert "12 of 12 trials" in text["sure"]
    assert "4 of 4 speeds" in text["sure"]
    assert "may as well be slip sinkage" in text["sure"]
    assert "pitch rate in steady motion (at 0.7 m/s from 0.50 s to 1.50 s" in text["where"]


def test_the_same_sentences_stand_on_the_first_page_of_a_study(findings: dict[str, Finding]) -> None:
    answer = section(findings["named"]).answer
    assert answer.id == "missing"
    assert "93 % of it closes" in answer.text


def test_an_unknown_effect_is_said_to_be_unknown_with_what_came_closest(findings: dict[str, Finding]) -> None:
    answer = missing_answer(findings["unknown"])
    assert answer.verdict == "not known"
    assert "What came closest, multi pass, explains too little to be named." in answer.text


def test_nothing_found_is_no_empty_page(findings: dict[str, Finding]) -> None:
    answer = missing_answer(findings["none"])
    assert answer.verdict == "nothing"
    assert "multi pass, has an evidence of 9.0; chance alone reaches 18" in answer.text
    # 2 % of what is expected suffices for each candidate but the one that these trials cannot show
    sure = sure_answer(findings["none"], library()).text
    assert f"{len(library()) - 1} of {len(library())} candidates would have been seen" in sure


def test_one_trial_proves_nothing_by_leaving_out() -> None:
    finding = made_up_finding(speeds=(0.3,), repetitions=1)
    assert "nothing can be left out" in sure_answer(finding, library()).text
    assert "left out of the fit" not in missing_answer(finding).text
    assert "Does it hold on trials that were left out?" not in titles(steps(finding))


@pytest.fixture(scope="module")
def drawings(findings: dict[str, Finding]) -> list[Drawing]:
    found = [d for f in findings.values() for d in assemble(f, "mine", SOURCE).drawings]
    named = made_up_finding(
        names=HOSTILE.replace("{", "").replace("}", "") + "$a_{{1}}$ {speed} {repetition}"
    )
    return [*found, *assemble(named, "mine", SOURCE).drawings]


def test_no_text_of_a_figure_is_cut_or_covered(drawings: list[Drawing]) -> None:
    for drawing in drawings:
        with mpl.rc_context(RC):
            boxes = texts(drawing.figure)
        frame = drawing.figure.bbox
        for text, box in boxes:
            inside = frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
            assert inside, (drawing.id, text)
        for (a, box_a), (b, box_b) in itertools.combinations(boxes, 2):
            over = Bbox.intersection(box_a, box_b)
            assert over is None or over.width <= 1 or over.height <= 2, (drawing.id, a, b)


def test_every_figure_has_a_unit_and_says_what_to_see(drawings: list[Drawing]) -> None:
    for drawing in drawings:
        labels = [axis.get_xlabel() for axis in drawing.figure.axes]
        assert re.search(r"\[[^\]]+\]$", next(reversed(list(filter(None, labels)))), re.M), drawing.id
        assert drawing.sentence.endswith((".", ")"))
        assert "nan" not in (drawing.sentence + drawing.title).lower()
        assert drawing.alt


def test_the_map_shows_how_many_times_the_noise_a_known_residual_is(findings: dict[str, Finding]) -> None:
    # A cosine of amplitude 8 over the noise in one trial is one of 8 √3 in the mean of three, rms 8 √1.5.
    finding = findings["none"]
    changed = []
    for r in finding.residuals:
        steady = np.array([p == "steady" for p in r.phase])
        n = np.arange(steady.sum())
        wave = np.zeros(r.t.size)
        wave[steady] = 8 * np.cos(np.pi * (n + 0.5) * (n.size // 7) / n.size)  # 3.5 Hz
        changed.append(dataclasses.replace(r, white_before=wave) if r.channel == "accel_z" else r)
    found = strengths(dataclasses.replace(finding, residuals=tuple(changed)))
    energy = found["accel_z", "steady", 1].before ** 2 * found["accel_z", "steady", 1].count
    total = sum(s.count for (c, p, _), s in found.items() if (c, p) == ("accel_z", "steady"))
    assert energy == pytest.approx(8**2 * 1.5 * total, rel=0.01)
    assert found["accel_z", "steady", 0].before == pytest.approx(0, abs=1e-6)
    assert found["accel_z", "brake", 1].before == pytest.approx(0, abs=1e-6)
    assert found["pitch_rate", "steady", 2].before == pytest.approx(1, abs=0.1)  # white noise


def test_dots_mark_what_chance_does_not_explain(findings: dict[str, Finding]) -> None:
    before = map_drawing(findings["named"])
    marks = [line for line in before.figure.axes[0].get_lines() if line.get_marker() == "o"]
    rows = {float(np.asarray(line.get_ydata())[0]) for line in marks}
    assert rows == {float(list(CHANNELS).index("pitch_rate"))}  # the one with the bump
    after = map_drawing(findings["named"], after=True)
    assert not [line for line in after.figure.axes[0].get_lines() if line.get_marker() == "o"]
    assert "no dots" not in before.sentence


def test_intervals_stand_at_their_seconds(findings: dict[str, Finding]) -> None:
    drawing = intervals_drawing(findings["named"])
    assert drawing is not None
    panels = [axis for axis in drawing.figure.axes if axis.patches]
    assert len(panels) == 4
    bars = [(p.get_x(), p.get_x() + p.get_width()) for p in panels[0].patches]
    assert bars == [(0.5, 1.5)]
    table = intervals_table(findings["named"])
    assert table is not None
    assert [cell.text for cell in table.rows[0]][3:5] == ["0.50", "1.50"]


def test_what_is_left_is_one_where_there_is_only_noise(findings: dict[str, Finding]) -> None:
    before, after, count = spectra(findings["named"], np.array([0.1, 1.0, 5.0, 25.0]))
    assert before[0] > 5
    assert abs(after - 1).max() < 4 * np.sqrt(2 / count.min())
    assert "What is left is noise" in left_drawing(findings["named"]).sentence
    assert "more than noise" in left_drawing(findings["unknown"]).sentence


def test_histories_are_means_over_the_repetitions_with_gaps_left_out(findings: dict[str, Finding]) -> None:
    own = next(m for m in means(findings["named"]) if m.channel == "accel_x" and m.velocity == 0.3)
    residuals = [r for r in findings["named"].residuals if (r.channel, r.variant) == ("accel_x", 0.3)]
    assert own.trials == len(residuals) == 3
    assert np.isnan(own.measured[42])
    np.testing.assert_allclose(own.measured[60], np.mean([r.measured[60] for r in residuals]))
    np.testing.assert_allclose(own.z_before[60], sum(r.white_before[60] for r in residuals) / math.sqrt(3))


def test_the_law_is_drawn_as_its_terms_say(findings: dict[str, Finding]) -> None:
    drawing = law_drawing(findings["unknown"])
    assert drawing is not None
    force, moment, torque = drawing.figure.axes
    assert [a.get_ylabel() for a in (force, moment, torque)] == ["[N]", "[N m]", "[N m]"]
    line = next(x for x in force.get_lines() if x.get_label() == "0.5 m/s")
    run = simulate(variant_of(0.5), load_robot(), load_soil())
    t, drawn = (np.asarray(v, dtype=float) for v in line.get_data())
    x = np.interp(1.0, run.t, run["x_m"])
    assert np.interp(1.0, t, drawn) == pytest.approx(-2.9 * math.exp(-x / 0.2), rel=1e-3)
    line = next(x for x in torque.get_lines() if x.get_label() == "0.5 m/s")
    t, drawn = (np.asarray(v, dtype=float) for v in line.get_data())
    slip = np.interp(2.0, run.t, run["slip_r"])
    assert np.interp(2.0, t, drawn) == pytest.approx(0.05 * slip / 0.2, rel=1e-3)


def test_the_report_has_all_its_files_and_the_json_of_the_command(discovery_folder: Path) -> None:
    for name in ("index.html", "report.md", "finding.json"):
        assert (discovery_folder / name).stat().st_size > 1000
    document = json.loads((discovery_folder / "finding.json").read_text(encoding="utf-8"))
    expected = finding_as_json(made_up_finding(twins=("slip_sinkage",)), discovery_folder / "model.toml")
    assert document == json.loads(json.dumps(expected))
    assert document["schema"] == "granite-lab/discovery/1"
    ids = {path.stem for path in (discovery_folder / "figures").glob("*.svg")}
    assert {path.stem for path in (discovery_folder / "figures").glob("*.png")} == ids
    assert {"found_map_before", "found_candidates_1", "found_held_out", "found_sizes", "found_gap"} <= ids
    for path in (discovery_folder / "figures").glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")


def test_the_page_is_well_formed_and_needs_nothing_else(discovery_folder: Path) -> None:
    page = parsed(discovery_folder)
    assert not {tag for tag, _, _ in page.attributes} & {"script", "iframe", "object", "embed"}
    assert len(page.ids) == len(set(page.ids))
    assert all(b <= a + 1 for a, b in itertools.pairwise(page.headings))
    for _, name, value in page.attributes:
        if name in ("src", "href", "xlink:href"):
            assert value is not None
            assert value.startswith(("#", "data:,"))
            assert not value.startswith("#") or value[1:] in page.ids


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
def test_an_interrupted_report_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "report"
    folder.mkdir()
    (folder / "index.html").write_text("old")

    def fail(*_: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(write, "to_markdown", fail)
    with pytest.raises(KeyboardInterrupt):
        write_discovery(made_up_finding("none", speeds=(0.3,)), folder, SOURCE)
    assert [p.name for p in folder.iterdir()] == ["index.html"]
    assert [p.name for p in tmp_path.iterdir()] == ["report"]


@pytest.mark.usefixtures("no_png")
def test_the_case_is_a_section_of_a_studys_report(tmp_path: Path, findings: dict[str, Finding]) -> None:
    found = section(findings["named"], "model.toml")
    write_report(made_up_study(speeds=(0.5,), repetitions=1), tmp_path / "study", found)
    page = parsed(tmp_path / "study")
    assert {"discovery", "found_map_before", "found_gap", "found_left"} <= set(page.ids)
    text = " ".join("".join(page.text).split())
    assert text.index("93 % of it closes") < text.index("1. Where do model and trials disagree?")
    document = json.loads((tmp_path / "study" / "report.json").read_text(encoding="utf-8"))
    assert document["discovery"]["effects"][0]["id"] == "multi_pass"


def test_few_channels_and_one_speed_make_a_report_too() -> None:
    finding = made_up_finding(speeds=(0.2,), repetitions=2, channels=("wheel", "wheel_split"))
    report = assemble(finding, "mine", SOURCE)
    drawn = {d.id for d in report.drawings}
    assert drawn >= {"found_map_before", "found_gap", "found_history_0p20"}
    assert "found_intervals" not in drawn  # none of these channels is off


def cost_of_a_plain_figure() -> float:
    """Return what matplotlib takes for three panels with legends as SVG and PNG: a unit on any machine."""
    begin = time.process_time()
    figure = Figure(figsize=(7, 6))
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
    assert drawn > 40
    assert cost <= 2 * drawn * plain
    assert sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file()) <= 15_000_000
