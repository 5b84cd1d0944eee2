"""The page stays short, and says each number once and alike wherever it stands."""

from __future__ import annotations

import dataclasses
import html
import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from rich.console import Console

from granite_lab.estimate import Estimate
from granite_lab.reporting.answers import Answers, of_study
from granite_lab.reporting.content import StudyResult, command_of
from granite_lab.reporting.report import Fold, Gallery, study_report
from granite_lab.reporting.rounding import decided
from granite_lab.reporting.tables import slip_table
from granite_lab.reporting.terminal import show_study
from tests.reporting.made_up import made_up_study
from tests.reporting.made_up_finding import made_up_finding

SPEEDS = (0.2, 0.3, 0.5, 0.7)
VOID = {"meta", "link", "br", "img", "input", "hr"}


class Shown(HTMLParser):
    """Collects what a reader sees while all details are closed, text inside figures too."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.text: list[str] = []
        self.figures = 0

    def hidden(self) -> bool:
        folded = "details" in self.open and "summary" not in self.open
        return folded or "style" in self.open or "title" in self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "details":
            assert "open" not in dict(attrs)
        if tag not in VOID:
            self.open.append(tag)
        self.figures += tag == "figure" and not self.hidden()

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Nothing is inside it."""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.hidden():
            self.text.append(data)


def test_at_most_3500_words_and_ten_figures_are_in_view(twelve_folder: Path) -> None:
    page = Shown()
    page.feed((twelve_folder / "index.html").read_text(encoding="utf-8"))
    words = " ".join(page.text).split()
    assert 500 < len(words) <= 3500
    assert 2 <= page.figures <= 10


@pytest.mark.parametrize("speeds", [(0.5,), SPEEDS])
def test_one_figure_a_speed_overlays_measured_and_simulated(speeds: tuple[float, ...]) -> None:
    report = study_report(made_up_study(speeds=speeds, repetitions=2))
    open_figures = [
        f.name for s in report.sections for b in s.blocks if isinstance(b, Gallery) for f in b.figures
    ]
    assert [n for n in open_figures if n.startswith("motion_")] == [
        f"motion_{v:.2f}".replace(".", "p") for v in speeds
    ]
    folds = [b for s in report.sections for b in s.blocks if isinstance(b, Fold)]
    assert folds


def everywhere(twelve: StudyResult, twelve_folder: Path) -> dict[str, str]:
    """Return each form of a report as plain text."""
    out = io.StringIO()
    show_study(twelve, Console(file=out, width=400), model="model.toml")
    page = re.sub(
        r"<(style|svg).*?</\1>", " ", (twelve_folder / "index.html").read_text(encoding="utf-8"), flags=re.S
    )
    texts = {
        "page": html.unescape(re.sub(r"<[^>]+>", "", page)),
        "Markdown": (twelve_folder / "report.md").read_text(encoding="utf-8").replace("\\", ""),
        "terminal": out.getvalue(),
        "JSON": (twelve_folder / "report.json").read_text(encoding="utf-8"),
    }
    return {form: " ".join(text.replace("\u00a0", " ").split()) for form, text in texts.items()}


def test_every_form_of_the_report_says_the_same_answers(twelve: StudyResult, twelve_folder: Path) -> None:
    decided_once = of_study(twelve, "model.toml")
    for form, text in everywhere(twelve, twelve_folder).items():
        for answer in decided_once.questions:
            for said in (answer.verdict, answer.text):
                plain = " ".join(said.replace("\u00a0", " ").split())
                for part in re.split(r"[_θ]+", plain):  # an index is set low on the page
                    assert part in text.replace('\\"', '"'), (form, answer.id)
        if form != "JSON":
            for s in decided_once.speeds:
                for shown in (s.slip.text, s.slip.interval, s.k92.with_std):
                    assert shown in text, (form, s.velocity)


def test_json_holds_the_numbers_as_they_are_printed(twelve: StudyResult, twelve_folder: Path) -> None:
    answers = json.loads((twelve_folder / "report.json").read_text(encoding="utf-8"))["answers"]
    for s, row in zip(of_study(twelve).speeds, answers["speeds"], strict=True):
        assert row["slip"]["value"] == float(s.slip.text)
        assert [f"{x:.{s.slip.decimals}f}" for x in row["slip"]["ci95"]] == s.slip.interval.split(" to ")
    assert answers["a_theta"]["value"] == 4.93


def test_a_theta_has_one_value(twelve: StudyResult, twelve_folder: Path) -> None:
    for form, text in everywhere(twelve, twelve_folder).items():
        if form != "JSON":
            assert set(re.findall(r"a_?θ = ([\d.]+)", text)) == {"4.93"}, form


def of_slips(*percent: float) -> Answers:
    study = made_up_study(speeds=(0.7,), repetitions=len(percent))
    trials = []
    for r, slip in zip(study.trials, percent, strict=True):
        motion = dataclasses.replace(r.comparison.motion, slip_ratio=Estimate(slip / 100, 0.001))
        trials.append(dataclasses.replace(r, comparison=dataclasses.replace(r.comparison, motion=motion)))
    return of_study(dataclasses.replace(study, trials=tuple(trials)))


def test_a_paper_value_is_compared_with_the_interval_as_it_is_printed() -> None:
    """The paper's 22.9 % is never said to differ from an interval that is printed as ending there."""
    for step in range(60):
        high = 22.80 + 0.004 * step
        (speed,) = of_slips(high - 0.4, high - 0.2).speeds
        low, top = (float(x.replace("−", "-")) for x in speed.slip.interval.split(" to "))
        assert speed.agrees is (low <= 22.9 <= top)
        row = slip_table(of_slips(high - 0.4, high - 0.2)).rows[0]
        assert (row[4].text == "yes") is speed.agrees


def test_value_std_and_interval_share_one_decimal_place() -> None:
    number = decided(0.22481, 0.00104, 0.22137, 0.22824, unit="%", scale=100)
    assert (number.text, number.with_std, number.interval) == ("22.48", "22.48 ± 0.10", "22.14 to 22.82")
    assert number.holds(22.82) is True
    assert number.holds(22.9) is False
    assert decided(0.3).holds(0.3) is None


def test_a_law_is_not_tested_by_fewer_than_three_speeds() -> None:
    for speeds, verdict in (((0.3, 0.7), "Not tested"), ((0.2, 0.3, 0.7), "Yes")):
        answer = of_study(made_up_study(speeds=speeds)).question("a_theta")
        assert answer is not None
        assert answer.verdict == verdict


def test_a_theta_that_differs_is_put_beside_what_is_missing(twelve: StudyResult) -> None:
    assert twelve.a_theta is not None
    off = dataclasses.replace(twelve.a_theta, a_theta=Estimate(3.6, 0.05), ci95=(3.5, 3.7))
    for finding, said in ((twelve.finding, True), (made_up_finding("none"), False)):
        answer = of_study(dataclasses.replace(twelve, a_theta=off, finding=finding)).question("a_theta")
        assert answer is not None
        assert answer.verdict == "No"
        assert ("what is missing can cause this" in answer.text) is said


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
