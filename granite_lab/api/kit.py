"""`kit`: what another laboratory or simulator fills in so that `discover` can be judged blind."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granite_lab.api.calls import checked
from granite_lab.effects import library
from granite_lab.errors import InputError, UsageError
from granite_lab.files import write_text
from granite_lab.hidden import kit_check
from granite_lab.hidden.kit_check import ALLOWED, ANSWER, SCHEMA
from granite_lab.parameters import CATALOGUE

if TYPE_CHECKING:
    import pandas as pd

TRIALS, FINDING = "trials", "finding"
"""Folders of a kit: the logs, and what `discover` wrote."""


@dataclass(frozen=True)
class Kit:
    """An empty kit.

    Attributes:
        folder: where it lies.
        files: what is in it.
    """

    folder: Path
    files: tuple[Path, ...]

    def to_frame(self) -> pd.DataFrame:
        """Return what an answer may name, one row a parameter."""
        import pandas as pd  # noqa: PLC0415

        rows = [
            {"effect": name, "title": e["title"], "parameter": key} | p
            for name, e in allowed().items()
            for key, p in e["parameters"].items()
        ]
        return pd.DataFrame(rows)


def allowed() -> dict[str, Any]:
    """Return the effects that an answer may name, with unit, meaning and bounds of their parameters."""
    return {
        effect.id: {
            "title": effect.title,
            "equation": effect.equation,
            "parameters": {
                p.name: {"unit": p.unit, "meaning": p.meaning, "low": p.low, "high": p.high}
                for p in effect.parameters
            },
        }
        for effect in library().values()
    }


@checked
def kit(out: str | Path) -> Kit:
    """Write an empty kit: README, template of the answer, folder of the trials, and a checker.

    Args:
        out: folder to write.

    Raises:
        UsageError: the folder holds something already.
        LabError: a file cannot be written.
    """
    folder = Path(out)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder}: is there already and not empty", "choose another folder")
    template = {"schema": SCHEMA, "made_by": "", "virtual": True, "effects": [], "note": ""}
    texts = {
        "README.md": (CATALOGUE / "kit" / "README.md").read_text(encoding="utf-8"),
        "check.py": Path(kit_check.__file__).read_text(encoding="utf-8"),
        ANSWER: json.dumps(template, indent=2) + "\n",
        ALLOWED: json.dumps({"schema": "granite-lab/kit-allowed/1", "effects": allowed()}, indent=1) + "\n",
        f"{TRIALS}/robot.toml": (CATALOGUE / "robots" / "granite.toml").read_text(encoding="utf-8"),
        f"{TRIALS}/soil.toml": (CATALOGUE / "soils" / "dry_sand.toml").read_text(encoding="utf-8"),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    return Kit(folder, tuple(folder / name for name in texts))


def searched_kit(folder: Path, jobs: int) -> Path:
    """Return the folder with the discovery of a kit; where there is none, search for it.

    Raises:
        InputError: there is no log, or one cannot be used.
        EstimateError: the search is impossible.
    """
    from granite_lab.api.search import discover  # noqa: PLC0415, heavy, and nothing to `hide`

    trials, found = folder / TRIALS, folder / FINDING
    if (found / "finding.json").is_file():
        return found
    if not kit_check.logs_of(folder):
        raise InputError(f"{trials}: holds no log", "the kit's README says what a log is")
    files = {key: trials / f"{key}.toml" for key in ("robot", "soil", "map")}
    given = {key: path if path.is_file() else None for key, path in files.items()}
    discover(
        kit_check.logs_of(folder), robot=given["robot"], soil=given["soil"], column_map=given["map"],
        out=found, jobs=jobs,
    )  # fmt: skip
    return found
