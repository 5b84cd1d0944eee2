"""``report.pdf``: four pages of A4 that answer what the first screen answers."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from pypdf import PdfReader

from granite_lab.reporting import write_report
from granite_lab.reporting.content import StudyResult
from granite_lab.reporting.paper import HEIGHT, MARGIN, SMALL, WIDTH, Page, _widths, width_of, wrapped
from granite_lab.reporting.report import study_report
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study, rename


@pytest.fixture(scope="module")
def reader(twelve_folder: Path) -> PdfReader:
    return PdfReader(io.BytesIO((twelve_folder / "report.pdf").read_bytes()))


def text_of(reader: PdfReader) -> list[str]:
    return [" ".join(page.extract_text().split()) for page in reader.pages]


def test_it_has_four_pages_of_a4_and_each_says_that_the_data_are_virtual(reader: PdfReader) -> None:
    assert len(reader.pages) == 4
    for page in reader.pages:
        assert [float(x) for x in page.mediabox] == pytest.approx([0, 0, WIDTH, HEIGHT], abs=0.1)
    assert all(text.startswith("Virtual data") for text in text_of(reader))


def test_it_answers_every_question_of_the_first_screen(twelve: StudyResult, reader: PdfReader) -> None:
    text = " ".join(text_of(reader)).replace(" ", "")
    answers = study_report(twelve, model="model.toml").answers
    assert [q.id for q in answers.questions] == [
        "slip", "a_theta", "model", "missing", "closes", "trust", "next",
    ]  # fmt: skip
    for question in answers.questions:
        for sentence in (question.verdict, question.text):
            plain = "".join(sentence.split())
            if not {"_", "−"} & set(plain):  # symbols are set as formulas
                assert plain in text, question.id
    for speed in answers.speeds:
        assert "".join(speed.slip.interval.split()) in text


def test_a_study_without_anything_found_has_four_pages_too(tmp_path: Path) -> None:
    one = rename(made_up_study(speeds=(0.3,), repetitions=1), HOSTILE)
    write_report(one, tmp_path / "small")
    assert len(PdfReader(tmp_path / "small" / "report.pdf").pages) == 4


def test_no_line_is_longer_than_it_may_be() -> None:
    for text in ("one two three " * 20, "x" * 300, "k_92 and λ_R and a_θ " * 9):
        lines = wrapped(text, 120, 9)
        assert max(width_of(line, 9) for line in lines) <= 120
        assert "".join(lines).replace(" ", "") == text.replace(" ", "")


def test_no_word_of_a_printed_table_is_broken(twelve: StudyResult) -> None:
    printed = ("slip_by_speed", "channels", "found_effects")
    for table in (t for t in study_report(twelve).tables if t.name in printed):
        for row in table.rows:
            for cell, wide in zip(row, _widths(table), strict=True):
                assert " ".join(wrapped(cell.text, wide, SMALL)) == cell.text


def test_nothing_is_written_below_the_margin(study: StudyResult) -> None:
    page = Page(study_report(study), {})
    for _ in range(40):
        page.text("many words " * 60)
    low = [t.get_position()[1] * HEIGHT for t in page.figure.texts[:-40]]
    assert min(low) > MARGIN - 10
