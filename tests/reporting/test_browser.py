"""The report as a browser shows it; skipped where there is no Chromium."""

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.reporting.chromium import Page, browser, chromium

ARTEFACTS = Path(__file__).parent.parent / "artefacts"

pytestmark = pytest.mark.skipif(chromium() is None, reason="needs Chromium")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("profile")) as tab:
        yield tab


@pytest.mark.parametrize("which", ["twelve_folder", "hostile_folder", "discovery_folder"])
@pytest.mark.parametrize(("name", "width", "height"), [("phone", 390, 844), ("desktop", 1280, 900)])
def test_the_page_fits_its_window(
    page: Page, which: str, name: str, width: int, height: int, request: pytest.FixtureRequest
) -> None:
    folder: Path = request.getfixturevalue(which)
    page.open(folder / "index.html", width, height)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    assert page.evaluate("overflowing()") == []
    assert page.complaints() == []
    if which != "hostile_folder":
        assert page.evaluate("stackedLetters()") == []
        assert page.evaluate("cutTables()") == []
    picture = ARTEFACTS / f"report_{which.removesuffix('_folder')}_{name}.png"
    page.save(picture, "Page.captureScreenshot", captureBeyondViewport=True)
    assert picture.stat().st_size > 50_000
    if (name, which) != ("phone", "hostile_folder"):
        assert page.evaluate("cutInFigures()") == []  # by the browser's own fonts


def luminance(colour: str) -> float:
    r, g, b = (int(part) / 255 for part in colour[colour.index("(") + 1 : -1].split(",")[:3])
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (r, g, b)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("dark", [False, True])
def test_light_and_dark_are_both_readable(page: Page, folder: Path, dark: bool) -> None:
    page.open(folder / "index.html", 1280, 900, dark=dark)
    ground, text, figure = (luminance(colour) for colour in page.evaluate("colours()"))
    assert (ground < 0.05) is dark
    for ink in (text, figure):  # WCAG 2 contrast, AAA
        assert (max(ink, ground) + 0.05) / (min(ink, ground) + 0.05) >= 7
    page.save(ARTEFACTS / f"report_{'dark' if dark else 'light'}.png", "Page.captureScreenshot")


def test_the_page_is_short_with_all_details_closed(page: Page, twelve_folder: Path) -> None:
    page.open(twelve_folder / "index.html", 1280, 900)
    assert page.evaluate("document.documentElement.scrollHeight") <= 9000
    bottom = page.evaluate("document.getElementById('answers').getBoundingClientRect().bottom")
    assert bottom <= 1100  # the answers stand on the first screen
    assert page.evaluate("document.querySelectorAll('details[open]').length") == 0


def test_the_answers_leave_no_empty_space_on_the_first_screen(page: Page, twelve_folder: Path) -> None:
    """The rows of the grid are full, and the card with the table has room for little more than it holds."""
    page.open(twelve_folder / "index.html", 1280, 900)
    width, cards = page.evaluate(
        "[document.getElementById('answers').clientWidth, [...document.querySelectorAll('.answer')].map(a => "
        "[a.getBoundingClientRect().top, a.clientWidth, a.clientHeight, "
        "a.lastElementChild.getBoundingClientRect().bottom - a.getBoundingClientRect().top])]"
    )
    rows: dict[float, float] = {}
    for top, wide, _, _ in cards:
        rows[top] = rows.get(top, 0.0) + wide
    assert len(rows) >= 3
    assert min(rows.values()) > 0.94 * width
    _, _, tall, filled = cards[0]
    assert filled > 0.8 * tall


def test_a_formula_in_a_cell_stays_whole_on_a_phone(page: Page, twelve_folder: Path) -> None:
    page.open(twelve_folder / "index.html", 390, 844)
    page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    gaps = page.evaluate(
        "[...document.querySelectorAll('tbody sub')].filter(s => s.previousSibling).map(s => { "
        "const r = document.createRange(), before = s.previousSibling; "
        "r.setStart(before, before.length - 1); r.setEnd(before, before.length); "
        "const [a, b] = [r.getBoundingClientRect(), s.getBoundingClientRect()]; "
        "return Math.abs(b.left - a.right) + Math.max(0, b.top - a.bottom); })"
    )
    assert len(gaps) > 3
    assert max(gaps) < 2


def test_print_takes_eight_pages_and_leaves_no_heading_alone(page: Page, twelve_folder: Path) -> None:
    page.open(twelve_folder / "index.html", 794, 1123, media="print")
    assert not page.evaluate(
        "[...document.querySelectorAll('details figure')].filter(f => f.checkVisibility()).length"
    )
    assert page.evaluate("cutTables()") == []
    options = {"preferCSSPageSize": True, "printBackground": True}
    path = page.save(ARTEFACTS / "report.pdf", "Page.printToPDF", **options)
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", path.read_bytes())) <= 8
    if shutil.which("pdftotext") is None:
        return
    text = subprocess.run(
        ["pdftotext", "-layout", path, "-"], capture_output=True, text=True, check=True
    ).stdout
    headings = {" ".join(h.split()) for h in page.evaluate("headings()")}
    for sheet in text.split("\f"):
        lines = [" ".join(line.split()) for line in sheet.splitlines() if line.strip()]
        assert not lines or lines[-1] not in headings, lines[-1]


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize(("width", "height"), [(390, 844), (1280, 900)])
def test_lines_can_be_chosen_and_a_zoom_is_shared(
    page: Page, twelve_folder: Path, width: int, height: int, dark: bool
) -> None:
    page.open(twelve_folder / "explore.html", width, height, dark=dark)
    drawn = "document.querySelectorAll('.plot.js-plotly-plot')"
    page.evaluate(f"new Promise(go => {{ const w = () => {drawn}.length ? go(1) : setTimeout(w, 50); w() }})")
    assert page.evaluate("document.documentElement.scrollWidth") == width
    assert page.evaluate("document.getElementById('trial').value") == "virtual_0.2_1"
    assert page.evaluate("document.querySelectorAll('.plot').length") == 12
    count = "document.querySelector('.plot').data.length"
    all_lines = page.evaluate(count)
    assert all_lines == 7  # two bands, estimate, and twice simulation and difference
    page.evaluate("document.querySelectorAll('#lines input')[2].click()")  # the bands
    assert page.evaluate(count) == all_lines - 2
    page.evaluate("document.querySelectorAll('#lines input')[2].click()")
    ranges = page.evaluate(
        "Plotly.relayout(document.querySelector('.plot'), {'xaxis2.range': [1, 2]})"
        f".then(() => new Promise(go => setTimeout(go, 500))).then(() => [...{drawn}].map(d => "
        "[d.layout.xaxis.range, d.layout.xaxis2.range]))"
    )
    assert len(ranges) > 1
    assert all(pair == [[1, 2], [1, 2]] for pair in ranges)
    page.evaluate("location.hash = 'trial=virtual_0.7_2&quantity=search_wheel'")
    page.evaluate("new Promise(go => setTimeout(go, 500))")
    assert page.evaluate("document.getElementById('about').textContent").startswith("virtual_0.7_2, 0.7 m/s")
    assert page.evaluate("document.querySelectorAll('.plot').length") == 1
    assert page.complaints() == []
    name = f"explore_{width}_{'dark' if dark else 'light'}.png"
    page.save(ARTEFACTS / name, "Page.captureScreenshot")
