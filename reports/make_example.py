"""Write `reports/example`: the report of data/samples, small enough to be kept in version control.

The page and the numbers are what `granite-lab study data/samples` writes. Of the figures only one PNG each is
kept, with fewer pixels and colours, for the Markdown; of the tables the CSV; there are no recordings,
and no page of all lines. The hashes are those of what is kept.

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

from granite_lab.folders import LIST
from granite_lab.reporting.json_report import dumps, hashes_of
from granite_lab.reporting.names import LINES

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "reports" / "example"
COLOURS = 48


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
    text = re.sub(r'<a href="([^"#][^"]*)">[^<]*</a> ?', _if_there, first.read_text(encoding="utf-8"))
    first.write_text(text, encoding="utf-8")
    page = EXAMPLE / "report.md"
    page.write_text(page.read_text(encoding="utf-8").replace(".svg)", ".png)"), encoding="utf-8")
    numbers = EXAMPLE / "report.json"
    document = json.loads(numbers.read_bytes())
    document["files"] = [entry for entry in hashes_of(EXAMPLE) if entry["file"] != numbers.name]
    numbers.write_text(dumps(document), encoding="utf-8")


if __name__ == "__main__":
    study()
    slim()
