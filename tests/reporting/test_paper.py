"""``report.pdf``: four pages of A4 that answer what the first screen answers."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import pytest
from pypdf import PdfReader

from granite_lab.reporting import write_report
from granite_lab.reporting.report import study_report
from granite_lab.results import StudyResult
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
        assert [float(x) for x in page.mediabox] == pytest.approx([0, 0, 595.28, 841.89], abs=0.1)
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


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("trials", [1, 30])
def test_a_study_without_anything_found_and_a_long_one_have_four_pages_too(
    trials: int, tmp_path: Path
) -> None:
    """What is too much for a page is set smaller, so that none of it is cut off."""
    one = rename(made_up_study(speeds=(0.3,), repetitions=1), HOSTILE)
    long = dataclasses.replace(one, trials=one.trials * trials, failures=one.failures * trials)
    write_report(long, tmp_path / "small")
    pages = text_of(PdfReader(tmp_path / "small" / "report.pdf"))
    assert [page.endswith(f"page {k} of 4") for k, page in enumerate(pages, 1)] == [True] * 4
    assert "How to repeat this" in pages[3]


def test_figures_in_pdf_embed_their_fonts_and_keep_their_text(twelve_folder: Path) -> None:
    page = PdfReader(twelve_folder / "figures" / "slip_over_speed.pdf").pages[0]
    assert "robot slip ratio [%]" in page.extract_text()
    kinds = {font["/DescendantFonts"][0]["/Subtype"] for font in page["/Resources"]["/Font"].values()}
    assert kinds == {"/CIDFontType2"}  # TrueType, which journals take
