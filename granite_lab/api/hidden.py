"""`hide`, `reveal` and `kit`: trials with a sealed answer, to judge discoveries."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granite_lab.api.arguments import File, refuse_outside
from granite_lab.errors import InputError, UsageError
from granite_lab.files import sha256, write_bytes, write_text
from granite_lab.hidden import kit_check
from granite_lab.hidden.kit_check import ALLOWED, ANSWER, SCHEMA
from granite_lab.hidden.lab import lab_of
from granite_lab.hidden.scoring import Score, read_finding, score
from granite_lab.hidden.sealed import NAME, open_answer, seal
from granite_lab.hidden.wish import Wish
from granite_lab.logs import write_canonical, write_truth
from granite_lab.parameters import CATALOGUE, load_robot, load_soil
from granite_lab.shown import frame, picked

if TYPE_CHECKING:
    import pandas as pd

TRIALS, FINDING = "trials", "finding"
"""Folders of a kit: the logs, and what `discover` wrote."""


@dataclass(frozen=True)
class HiddenSet:
    """Virtual trials in which something is hidden, or nothing, and the file with the sealed answer."""

    trials: tuple[Path, ...]
    sealed: Path

    def to_frame(self) -> pd.DataFrame:
        """Return the logs with their hashes, one row a trial; nothing of the answer is in it."""
        rows = [{"trial": p.stem, "path": str(p), "sha256": sha256(p)} for p in self.trials]
        return frame(rows, columns=["trial", "path", "sha256"])


@dataclass(frozen=True)
class Revealed:
    """The answer of a hidden set, the score of a discovery if one was given, and trials that have changed."""

    answer: Mapping[str, Any]
    score: Score | None
    warnings: tuple[str, ...]

    def to_frame(self) -> pd.DataFrame:
        """Return what was hidden, one row a parameter."""
        rows = [
            {"effect": e["id"], "parameter": name, "value": p["value"], "unit": p["unit"]}
            for e in self.answer["effects"]
            for name, p in e["parameters"].items()
        ]
        return frame(rows, columns=["effect", "parameter", "value", "unit"])


def hide(
    effect: str,
    out: str | Path,
    *,
    seed: int = 0,
    strength: float = 1.0,
    sizes: Mapping[str, float] | None = None,
    noise: float = 1.0,
    sand_off: bool = False,
    repetitions: int | None = None,
    lab: str = "bench",
    robot: File = None,
    soil: File = None,
    label: str = "hidden",
    truth: File = None,
    jobs: int = 1,
    done: Callable[[str], None] = lambda _: None,
) -> HiddenSet:
    """Write virtual trials with a hidden effect, by an independent simulator; seal the answer.

    Args:
        effect: ids joined by +; or ``random``: one of the library; ``pair``: two of it; ``outside``: one that
            it lacks; ``none``.
        out: folder of the trials and the sealed answer.
        seed: seed of all random numbers.
        strength: factor on the effect's size, 0.001 to 1000.
        sizes: parameters of the effect.
        noise: factor on the sensors' noise, 0 to 100.
        sand_off: change φ, K, n and μ_s of the soil by 5 to 20 %.
        repetitions: trials of each variant, 1 to 99; by default 3 (``bench``) or 2 to 4 (``wild``).
        lab: ``bench``: sensors, robot and sand as in the files; ``wild``: drawn by the seed, with files of
            robot and sand beside the trials.
        robot, soil: names of the catalogue or .toml files; granite and dry_sand by default.
        label: first word of the trials' names.
        truth: folder for the true motion of each trial (CSV).
        jobs: number of processes; 0 means one per core.
        done: called with the name of each finished trial.

    Raises:
        UsageError: unknown effect or size, or the folder holds a set already.
        EstimateError: the robot would dig itself in under this effect.
        LabError: a file cannot be written.
    """
    refuse_outside("seed", seed, 0)
    refuse_outside("strength", strength, 0.001, 1000)
    refuse_outside("noise", noise, 0, 100)
    refuse_outside("repetitions", repetitions, 1, 99)
    refuse_outside("jobs", jobs, 0)
    folder = Path(out)
    from granite_lab.hidden.making import make_set  # noqa: PLC0415, heavy

    if [*folder.glob(f"{label}_v*_r*.csv"), *folder.glob(NAME)]:
        raise UsageError(f"{folder}: holds a hidden set already", "choose another folder")
    if truth is not None and Path(truth).resolve() == folder.resolve():
        raise UsageError(
            f"{truth}: would hold logs and their truth under the same names", "choose two folders"
        )
    if truth is not None and (there := sorted(Path(truth).glob(f"{label}_v*_r*.csv"))):
        raise UsageError(f"{there[0]}: is there already", "choose another folder for the truth")
    true: dict[str, pd.DataFrame] = {}
    wish = Wish(effect, seed, strength, noise, sand_off, lab, dict(sizes or {}))
    the_robot, the_soil = load_robot(robot or "granite"), load_soil(soil or "dry_sand")
    own = lab_of(lab, seed, the_robot, the_soil).files()
    if there := [folder / name for name in own if (folder / name).exists()]:
        raise UsageError(f"{there[0]}: is there already", "choose another folder")
    trials, answer = make_set(
        wish, the_robot, the_soil,
        repetitions=repetitions, label=label, jobs=jobs or os.cpu_count() or 1, done=done,
        keep=true.__setitem__,
    )  # fmt: skip
    for name, text in own.items():
        write_text(folder / name, text)
    files = []
    for trial in trials:
        path = folder / f"{trial.name}.csv"
        write_canonical(path, trial)
        answer["trials"][trial.name]["sha256"] = sha256(path)
        files.append(path)
    write_bytes(folder / NAME, seal(answer))
    for name, motion in true.items() if truth else ():
        write_truth(Path(truth or "") / f"{name}.csv", motion)
    return HiddenSet(tuple(sorted(files)), folder / NAME)


def reveal(folder: str | Path, finding: File = None, *, jobs: int = 0) -> Revealed:
    """Open the sealed answer of a hidden set or of a kit, and judge a discovery by it.

    In a kit without a discovery, `discover` runs first and writes into the kit's folder ``finding``.

    Args:
        folder: folder written by `hide`, or a kit that another laboratory filled.
        finding: discovery to be judged: JSON of `discover` or `study`, or its folder.
        jobs: number of processes of that search; 0 means one per core.

    Raises:
        InputError: a file cannot be used, or the answer is not the one that was promised by its hash.
        EstimateError: the search of a kit is impossible.
    """
    refuse_outside("jobs", jobs, 0)
    place, said = Path(folder), Path(finding) if finding else None
    answer = open_answer(place)  # a seal that does not hold is told before a search, which takes a while
    if said is None and (place / TRIALS).is_dir():
        said = _searched_kit(place, jobs)
    judged = score(answer, read_finding(said)) if said else None
    return Revealed(answer, judged, tuple(_changed(place, answer)))


def _changed(folder: Path, answer: Mapping[str, Any]) -> list[str]:
    """Return a line for each trial that is not the one that was written."""
    lines = []
    if (folder / TRIALS).is_dir() and (folder / ANSWER).is_file():
        lines.append(f"{folder / ANSWER}: lies open beside the trials: nobody can know that it was not read")
    for name, trial in answer["trials"].items():
        path = folder / trial.get("file", f"{name}.csv")
        if not path.exists():
            lines.append(f"{path}: is missing")
        elif sha256(path) != trial["sha256"]:
            lines.append(f"{path}: has changed since it was written")
    return lines


@dataclass(frozen=True)
class Kit:
    """An empty kit: its folder and what is in it."""

    folder: Path
    files: tuple[Path, ...]

    def to_frame(self) -> pd.DataFrame:
        """Return what an answer may name, one row a parameter."""
        rows = [
            {"effect": name, "title": e["title"], "parameter": key} | p
            for name, e in _allowed().items()
            for key, p in e["parameters"].items()
        ]
        return frame(rows)


def _allowed() -> dict[str, Any]:
    """Return the effects that an answer may name, with unit, meaning and bounds of their parameters."""
    from granite_lab.effects import library  # noqa: PLC0415, heavy, and nothing to `hide`

    return {
        effect.id: {
            **picked(effect, "title", "equation"),
            "parameters": {p.name: picked(p, "unit", "meaning", "low", "high") for p in effect.parameters},
        }
        for effect in library().values()
    }


def kit(out: str | Path) -> Kit:
    """Write a template for a blind test: README, template of the answer, folder of the trials, and a checker.

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
        ALLOWED: json.dumps({"schema": "granite-lab/kit-allowed/1", "effects": _allowed()}, indent=1) + "\n",
        f"{TRIALS}/robot.toml": (CATALOGUE / "robots" / "granite.toml").read_text(encoding="utf-8"),
        f"{TRIALS}/soil.toml": (CATALOGUE / "soils" / "dry_sand.toml").read_text(encoding="utf-8"),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    return Kit(folder, tuple(folder / name for name in texts))


def _searched_kit(folder: Path, jobs: int) -> Path:
    """Return the folder with the discovery of a kit; where there is none, search for it."""
    from granite_lab.api.trials import discover  # noqa: PLC0415, heavy, and nothing to `hide`

    trials, found = folder / TRIALS, folder / FINDING
    if (found / "finding.json").is_file():
        return found
    if not kit_check.logs_of(folder):
        raise InputError(f"{trials}: contains no log", "the kit's README describes the logs")
    files = {key: trials / f"{key}.toml" for key in ("robot", "soil", "map")}
    given = {key: path if path.is_file() else None for key, path in files.items()}
    discover(
        kit_check.logs_of(folder), robot=given["robot"], soil=given["soil"], column_map=given["map"],
        out=found, jobs=jobs,
    )  # fmt: skip
    return found
