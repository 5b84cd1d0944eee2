"""Write `reports/example`: the report of data/samples, small enough to be kept in version control.

The page and the numbers are what `granite-lab study data/samples` writes. Of the figures only one PNG each is
kept, with fewer pixels and colours, for the Markdown; of the tables the CSV; there are no recordings,
and no page of all lines. The hashes are those of what is kept. `reports/README.md` gets the judgement by the
sealed answer, between its two marks.

    python reports/make_example.py
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

from PIL import Image

from granite_lab.estimate import Estimate
from granite_lab.folders import LIST
from granite_lab.hidden.scoring import MEANING, score
from granite_lab.hidden.sealed import open_answer
from granite_lab.reporting.json_report import dumps, hashes_of
from granite_lab.reporting.names import LINES, scale_of
from granite_lab.rounding import plus_minus, significant, times, with_unit

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "reports" / "example"
COLOURS = 48
JUDGED = "<!-- judged -->", "<!-- end -->"
"""Marks in `reports/README.md`."""


def study() -> None:
    """Analyse the samples; what is remembered from before is used, and the old example is removed."""
    shutil.rmtree(EXAMPLE, ignore_errors=True)
    command = "from granite_lab.cli import main; main()"
    arguments = ["study", "data/samples", "--out", "reports/example", "--no-recordings"]
    subprocess.run([sys.executable, "-c", command, *arguments], cwd=ROOT, check=True)


def _if_there(link: re.Match[str]) -> str:
    """Return a link to a file that is kept; nothing in place of others."""
    return link[0] if (EXAMPLE / link[1].partition("#")[0]).exists() else ""


def slim() -> None:
    """Keep each figure once, as a small PNG of few colours, and let the Markdown show it."""
    for png in sorted((EXAMPLE / "figures").glob("*.png")):
        with Image.open(png) as picture:
            few = picture.convert("RGB").reduce(2).quantize(COLOURS, dither=Image.Dither.NONE)
        few.save(png, optimize=True)
        png.with_suffix(".svg").unlink(missing_ok=True)
        png.with_suffix(".pdf").unlink(missing_ok=True)
    for table in (EXAMPLE / "tables").glob("*.tex"):
        table.unlink()
    for name in (LIST, LINES):
        (EXAMPLE / name).unlink(missing_ok=True)
    first = EXAMPLE / "index.html"
    text = re.sub(
        r'(?:<li>)?<a href="([^"#][^"]*)">[^<]*</a>(?:</li>)? ?', _if_there, first.read_text(encoding="utf-8")
    )
    first.write_text(text, encoding="utf-8")
    page = EXAMPLE / "report.md"
    page.write_text(page.read_text(encoding="utf-8").replace(".svg)", ".png)"), encoding="utf-8")
    numbers = EXAMPLE / "report.json"
    document = json.loads(numbers.read_bytes())
    document["files"] = [entry for entry in hashes_of(EXAMPLE) if entry["file"] != numbers.name]
    numbers.write_text(dumps(document), encoding="utf-8")


def judge(text: str) -> str:
    """Return the text of `reports/README.md` with the judgement of the example by the sealed answer."""
    finding = json.loads((EXAMPLE / "report.json").read_bytes())["discovery"]
    judged = score(open_answer(ROOT / "data" / "samples"), finding)
    rows = ["| effect | number | hidden | found |", "|---|---|---|---|"]
    for p in judged.parameters:
        unit, scale = scale_of(p.effect, p.name, p.unit, p.true)
        hidden = with_unit(significant(scale * p.true), unit)
        found = plus_minus(Estimate(p.value, p.std or 0.0), unit, scale)
        rows.append(f"| `{p.effect}` | {p.name.replace('_', ' ')} | {hidden} | {found} |")
    before, after = finding["gap"]["held_out"].values()
    mark = "right" if judged.right else "wrong"
    verdict = f"**{mark}; {MEANING[judged.outcome]}**"
    sentences = (
        f"Judgement of `granite-lab reveal data/samples` with this finding: {verdict}.",
        (
            "On trials that were left out of the fit, the gap is "
            f"{times(before)} with the paper's model and {times(after)} with what was found;"
        ),
        "noise and tolerance explain a gap of 1.",
    )
    head, tail = text.split(JUDGED[0], maxsplit=1)[0], text.split(JUDGED[1])[1]
    return head + "\n".join([JUDGED[0], *rows, "", *sentences, JUDGED[1]]) + tail


if __name__ == "__main__":
    study()
    slim()
    readme = ROOT / "reports" / "README.md"
    readme.write_text(judge(readme.read_text(encoding="utf-8")), encoding="utf-8")
