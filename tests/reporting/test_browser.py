"""The report as a browser shows it; skipped where there is no Chromium."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from granite_lab.reporting import write, write_report
from granite_lab.reporting.content import StudyResult
from tests.reporting.chromium import Page, browser, chromium

ARTEFACTS = Path(__file__).parent.parent / "artefacts"

pytestmark = pytest.mark.skipif(chromium() is None, reason="needs Chromium")

OVERFLOWING = """(() => {
  const found = [];
  for (const e of document.querySelectorAll('body *')) {
    if (e.closest('svg')) continue;
    const style = getComputedStyle(e), name = e.tagName + '.' + e.className;
    if (e.closest('details:not([open])') && e.tagName !== 'SUMMARY') continue;
    if (e.classList.contains('scroll')) continue;
    if (style.overflowX !== 'visible' && e.scrollWidth > e.clientWidth + 1)
      found.push('clips ' + name);
    const box = e.getBoundingClientRect();
    if (!e.closest('.scroll') && box.width > 0 && (box.right > innerWidth + 1 || box.left < -1))
      found.push('beyond ' + name + ' ' + box.right);
  }
  return found;
})()"""

CUT_IN_FIGURES = """(() => {
  const found = [];
  for (const d of document.querySelectorAll('details')) d.open = true;
  for (const svg of document.querySelectorAll('figure svg')) {
    const frame = svg.getBoundingClientRect();
    const boxes = [];
    for (const text of svg.querySelectorAll('text')) {
      const b = text.getBoundingClientRect();
      if (!b.width) continue;
      const aside = b.left < frame.left - 1 || b.right > frame.right + 1;
      if (aside || b.top < frame.top - 1 || b.bottom > frame.bottom + 1)
        found.push(svg.closest('figure').id + ' cuts ' + text.textContent);
      boxes.push([b, text.textContent]);
    }
    for (let i = 0; i < boxes.length; i++) for (let j = 0; j < i; j++) {
      const [a, s] = boxes[i], [b, t] = boxes[j];
      const w = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const h = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (w > 1 && h > 4) found.push(svg.closest('figure').id + ' covers ' + s + ' with ' + t);
    }
  }
  return found;
})()"""

STACKED_LETTERS = """(() => {
  const found = [], range = document.createRange();
  for (const d of document.querySelectorAll('details')) d.open = true;
  for (const cell of document.querySelectorAll('th, td')) {
    range.selectNodeContents(cell);
    const lines = new Set([...range.getClientRects()].map(box => Math.round(box.bottom / 8))).size;
    if (lines > 3 && cell.textContent.length / lines < 4) found.push(cell.textContent);
  }
  return found;
})()"""

CUT_TABLES = """[...document.querySelectorAll('.scroll')]
  .filter(e => e.checkVisibility() && e.scrollWidth > e.clientWidth + 1)
  .map(e => e.getAttribute('aria-labelledby'))"""

HEADINGS = "[...document.querySelectorAll('h2, h3')].filter(e => e.checkVisibility()).map(e => e.textContent)"

JUMP = """(async () => {
  const images = [...document.querySelectorAll('figure img')], image = images[images.length >> 1];
  location.hash = image.closest('figure').id;
  while (!image.complete || !image.naturalWidth) await new Promise(done => setTimeout(done, 50));
  await new Promise(done => setTimeout(done, 300));
  const top = image.closest('figure').getBoundingClientRect().top;
  return [images.length > 5, Math.abs(top) <= 0.5];  // a page scrolls by whole pixels
})()"""

COLOURS = """(() => {
  const of = (e, p) => getComputedStyle(e)[p];
  return [of(document.body, 'backgroundColor'), of(document.body, 'color'),
          of(document.querySelector('figure svg text'), 'fill')];
})()"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("profile")) as tab:
        yield tab


@pytest.mark.parametrize("which", ["folder", "hostile_folder", "discovery_folder"])
@pytest.mark.parametrize(("name", "width", "height"), [("phone", 390, 844), ("desktop", 1280, 900)])
def test_the_page_fits_its_window(
    page: Page, which: str, name: str, width: int, height: int, request: pytest.FixtureRequest
) -> None:
    folder: Path = request.getfixturevalue(which)
    page.open((folder / "index.html").as_uri(), width, height)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    assert page.evaluate(OVERFLOWING) == []
    assert page.complaints() == []
    if which != "hostile_folder":
        assert page.evaluate(STACKED_LETTERS) == []
    page.screenshot(ARTEFACTS / f"report_{which.removesuffix('_folder')}_{name}.png")
    assert (ARTEFACTS / f"report_{which.removesuffix('_folder')}_{name}.png").stat().st_size > 50_000


@pytest.mark.parametrize("which", ["folder", "discovery_folder"])
def test_text_in_figures_is_whole_in_the_browsers_own_fonts(
    page: Page, which: str, request: pytest.FixtureRequest
) -> None:
    folder: Path = request.getfixturevalue(which)
    page.open((folder / "index.html").as_uri(), 1280, 900)
    assert page.evaluate(CUT_IN_FIGURES) == []


def test_a_jump_to_a_figure_in_a_file_ends_at_that_figure(
    page: Page, study: StudyResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(write, "INLINE", 1)
    page.open(write_report(study, tmp_path / "many").as_uri(), 1280, 900)
    assert page.evaluate(JUMP) == [True, True]


def luminance(colour: str) -> float:
    r, g, b = (int(part) / 255 for part in colour[colour.index("(") + 1 : -1].split(",")[:3])
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (r, g, b)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("dark", [False, True])
def test_light_and_dark_are_both_readable(page: Page, folder: Path, dark: bool) -> None:
    page.open((folder / "index.html").as_uri(), 1280, 900, dark=dark)
    ground, text, figure = (luminance(colour) for colour in page.evaluate(COLOURS))
    assert (ground < 0.05) is dark
    for ink in (text, figure):  # WCAG 2 contrast, AAA
        assert (max(ink, ground) + 0.05) / (min(ink, ground) + 0.05) >= 7
    page.screenshot(ARTEFACTS / f"report_{'dark' if dark else 'light'}.png", whole=False)


def test_the_page_is_short_with_all_details_closed(page: Page, twelve_folder: Path) -> None:
    page.open((twelve_folder / "index.html").as_uri(), 1280, 900)
    assert page.evaluate("document.documentElement.scrollHeight") <= 9000
    bottom = page.evaluate("document.getElementById('answers').getBoundingClientRect().bottom")
    assert bottom <= 1100  # the answers stand on the first screen
    assert page.evaluate("document.querySelectorAll('details[open]').length") == 0


@pytest.mark.parametrize("width", [390, 1280])
def test_no_open_table_is_cut_off(page: Page, twelve_folder: Path, width: int) -> None:
    page.open((twelve_folder / "index.html").as_uri(), width, 900)
    assert page.evaluate(CUT_TABLES) == []


def test_print_takes_eight_pages_with_details_closed_and_no_heading_alone(
    page: Page, twelve_folder: Path
) -> None:
    page.open((twelve_folder / "index.html").as_uri(), 794, 1123, media="print")
    assert not page.evaluate(
        "[...document.querySelectorAll('details figure')].filter(f => f.checkVisibility()).length"
    )
    assert page.evaluate(CUT_TABLES) == []
    path = ARTEFACTS / "report.pdf"
    page.pdf(path)
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", path.read_bytes())) <= 8
    if shutil.which("pdftotext") is None:
        return
    text = subprocess.run(
        ["pdftotext", "-layout", path, "-"], capture_output=True, text=True, check=True
    ).stdout
    headings = {" ".join(h.split()) for h in page.evaluate(HEADINGS)}
    for sheet in text.split("\f"):
        lines = [" ".join(line.split()) for line in sheet.splitlines() if line.strip()]
        assert not lines or lines[-1] not in headings, lines[-1]
