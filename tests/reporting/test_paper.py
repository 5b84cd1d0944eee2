"""For the paper: four pages as PDF, budgets that add up to the stated std, and hashes of all files."""

import csv
import hashlib
import io
import json
import math
import shutil
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from pypdf import PdfReader

from granite_lab.comparison.compare import Comparison
from granite_lab.errors import InputError
from granite_lab.estimate import Part
from granite_lab.fitting import fit_a_theta
from granite_lab.folders import LIST
from granite_lab.reporting import write, write_report
from granite_lab.reporting.canvas import Figure
from granite_lab.reporting.json_report import changed_files
from granite_lab.reporting.report import study_report
from granite_lab.reporting.speeds import speeds_of
from granite_lab.reporting.tables import COMBINED, budget_tables
from granite_lab.results import StudyResult
from tests.reporting.conftest import HOSTILE
from tests.reporting.made_up import made_up_study, rename
from tests.reporting.made_up_finding import made_up_finding


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


@pytest.mark.parametrize("trials", [1, 30])
def test_a_study_without_a_finding_and_a_long_one_have_four_pages_too(
    trials: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is too much for a page is set smaller, so that none of it is cut off."""
    monkeypatch.setattr("granite_lab.reporting.write.FORMATS", ("svg",))  # the others are not looked at
    once: dict[str, bytes] = {}

    def drawn(figures: Sequence[Figure], k: int, draw: Callable[..., bytes]) -> bytes:
        """Draw what shows one of the trials, which are alike, as that of the first."""
        like = figures[k].name.rstrip("0123456789")
        if like not in once:
            once[like] = draw(figures, k)
        return once[like]

    monkeypatch.setattr(write, "_drawn", partial(drawn, draw=write._drawn))
    one = rename(made_up_study(speeds=(0.3,), repetitions=1), HOSTILE)
    long = replace(one, trials=one.trials * trials, failures=one.failures * trials)
    write_report(long, tmp_path / "small")
    pages = text_of(PdfReader(tmp_path / "small" / "report.pdf"))
    assert [page.endswith(f"page {k} of 4") for k, page in enumerate(pages, 1)] == [True] * 4
    assert "How to repeat this" in pages[3]


def test_a_table_with_more_rows_than_a_page_shows_names_the_file_that_has_them_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three effects with some numbers each have more rows than the eight that are shown."""
    monkeypatch.setattr("granite_lab.reporting.write.FORMATS", ("svg",))
    finding = made_up_finding()
    several = replace(finding, effects=finding.effects * 9)
    write_report(replace(made_up_study(), finding=several), tmp_path / "many")
    with (tmp_path / "many" / "tables" / "found_effects.csv").open(encoding="utf-8") as file:
        rows = len(list(csv.DictReader(file)))
    assert rows > 8
    last = text_of(PdfReader(tmp_path / "many" / "report.pdf"))[3]
    assert f"{rows - 8} more rows: tables/found_effects.csv" in last


def test_figures_in_pdf_embed_their_fonts_and_keep_their_text(twelve_folder: Path) -> None:
    page = PdfReader(twelve_folder / "figures" / "slip_over_speed.pdf").pages[0]
    assert "robot slip ratio [%]" in page.extract_text()
    kinds = {font["/DescendantFonts"][0]["/Subtype"] for font in page["/Resources"]["/Font"].values()}
    assert kinds == {"/CIDFontType2"}  # TrueType, which journals take


def with_parts(c: Comparison) -> Comparison:
    """Give the std of a trial two components that make it up."""

    def parts(std: float) -> tuple[Part, ...]:
        return (
            Part("accelerometer noise", "A", "normal", "m/s²/√Hz", 1e-3, 0.6 * std),
            Part("encoder counts and stamps", "B", "rectangular", "m", 1e-4, 0.8 * std),
        )

    motion = replace(c.motion, slip_parts=parts(c.motion.slip_ratio.std))
    fit = replace(c.fit, parts=parts(c.fit.k92.std))
    return replace(c, motion=motion, fit=fit)


@pytest.fixture(scope="module")
def budgeted() -> StudyResult:
    made = made_up_study()
    trials = tuple(map(with_parts, made.trials))
    return replace(made, trials=trials, a_theta=fit_a_theta([r.fit for r in trials]))


def test_the_contributions_add_up_to_the_stated_std_and_the_shares_to_one(budgeted: StudyResult) -> None:
    speeds = speeds_of(budgeted)
    squares: dict[tuple[str, str], float] = defaultdict(float)
    shares: dict[tuple[str, str], float] = defaultdict(float)
    for table in budget_tables(budgeted, speeds):
        for row in csv.DictReader(io.StringIO(table.to_csv())):
            if row["component"] != COMBINED:
                key = table.name, row.get("speed_mps", "")
                squares[key] += float(row["contribution"]) ** 2
                shares[key] += float(row["share"])
    sums = {key: math.sqrt(square) for key, square in squares.items()}
    assert {name for name, _ in sums} == {"budget_slip", "budget_k92", "budget_a_theta"}
    for s in speeds:  # the stated ones are rounded to two digits or fewer
        assert 100 * sums["budget_slip", f"{s.velocity:g}"] == pytest.approx(s.slip.std, rel=0.05)
        assert sums["budget_k92", f"{s.velocity:g}"] == pytest.approx(s.k92.std, rel=0.05)
    assert sums["budget_a_theta", ""] == pytest.approx(budgeted.a_theta.a_theta.std, rel=1e-6)
    assert [*shares.values()] == pytest.approx([1.0] * len(shares))


def test_the_budgets_stand_in_one_closed_part_of_the_report(budgeted: StudyResult) -> None:
    report = study_report(budgeted)
    folds = [b for s in report.sections for b in s.blocks if getattr(b, "title", "") == "Uncertainty budgets"]
    assert len(folds) == 1
    assert {t.virtual for t in report.tables if t.name.startswith("budget")} == {True}
    made = made_up_study(speeds=(0.2, 0.3, 0.5), repetitions=2)  # without components
    assert budget_tables(made, speeds_of(made)) == []


def test_report_json_holds_the_hash_of_every_other_file(folder: Path) -> None:
    held = {entry["file"]: entry["sha256"] for entry in document_of(folder)["files"]}
    files = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file()}
    del files["report.json"], files[LIST]
    assert held == {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()}
    assert {"index.html", "report.md", "report.pdf"} < set(held)
    assert not any("crate" in name for name in files)


def document_of(folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((folder / "report.json").read_bytes())
    return document


def test_a_changed_and_a_missing_file_are_named(folder: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(folder, tmp_path / "copy")
    document = document_of(copy)
    assert list(changed_files(document, copy / "report.json")) == []
    (copy / "report.md").write_text("edited")
    (copy / "report.pdf").unlink()
    assert list(changed_files(document, copy / "report.json")) == [
        "report.md: its content was changed",
        "report.pdf: is missing",
    ]


@pytest.mark.parametrize("name", ["../secret", "/etc/hostname", "tables/../../secret"])
def test_a_report_that_names_files_outside_its_folder_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not in the folder of the report"):
        list(changed_files({"files": [{"file": name, "sha256": ""}]}, tmp_path / "report.json"))


@pytest.mark.parametrize("document", [{}, {"files": None}, {"files": [1]}, {"files": [{"file": "x"}]}])
def test_a_report_without_hashes_is_refused(document: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no hashes"):
        list(changed_files(document, tmp_path / "report.json"))
