"""Write `reports/example`: the report of data/samples, small enough to be kept in version control.

The page and the numbers are what `granite-lab study data/samples` writes. Of the figures only one PNG each is
kept, with fewer pixels and colours, for the Markdown; of the tables the CSV; there are no recordings.
The hashes are those of what is kept.

    python reports/make_example.py
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

from PIL import Image

from granite_lab.folders import LIST
from granite_lab.reporting.json_report import dumps, hashes_of

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "reports" / "example"
COLOURS = 48


def study() -> None:
    """Analyse the samples; what is remembered from before is used, and the old example is removed."""
    shutil.rmtree(EXAMPLE, ignore_errors=True)
    command = "from granite_lab.cli import main; main()"
    arguments = ["study", "data/samples", "--out", "reports/example", "--no-recordings"]
    subprocess.run([sys.executable, "-c", command, *arguments], cwd=ROOT, check=True)


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
    (EXAMPLE / LIST).unlink(missing_ok=True)
    page = EXAMPLE / "report.md"
    page.write_text(page.read_text(encoding="utf-8").replace(".svg)", ".png)"), encoding="utf-8")
    numbers = EXAMPLE / "report.json"
    document = json.loads(numbers.read_bytes())
    document["files"] = [entry for entry in hashes_of(EXAMPLE) if entry["file"] != numbers.name]
    numbers.write_text(dumps(document), encoding="utf-8")


if __name__ == "__main__":
    study()
    slim()
