"""`hide` and `reveal`: virtual trials with a sealed answer, to judge discoveries."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granite_lab.api.calls import checked
from granite_lab.api.kit import TRIALS, searched_kit
from granite_lab.errors import UsageError
from granite_lab.files import sha256, write_bytes, write_text
from granite_lab.hidden.kit_check import ANSWER
from granite_lab.hidden.making import make_set
from granite_lab.hidden.scoring import Score, read_finding, score
from granite_lab.hidden.sealed import NAME, open_answer, seal
from granite_lab.hidden.wild import lab_of
from granite_lab.hidden.wish import Wish
from granite_lab.logs import write_canonical, write_truth
from granite_lab.parameters import load_robot, load_soil

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class HiddenSet:
    """Virtual trials in which something is hidden, or nothing.

    Attributes:
        trials: the logs.
        sealed: the file with the sealed answer.
    """

    trials: tuple[Path, ...]
    sealed: Path

    def to_frame(self) -> pd.DataFrame:
        """Return the logs with their hashes, one row a trial; nothing of the answer is in it."""
        import pandas as pd  # noqa: PLC0415

        rows = [{"trial": p.stem, "path": str(p), "sha256": sha256(p)} for p in self.trials]
        return pd.DataFrame(rows, columns=["trial", "path", "sha256"])


@dataclass(frozen=True)
class Revealed:
    """The answer of a hidden set, and what it says of a discovery.

    Attributes:
        answer: as it was sealed.
        score: the judgement; None where no discovery was given.
        warnings: trials that are missing or have changed since they were written.
        finding: where the discovery stands.
    """

    answer: Mapping[str, Any]
    score: Score | None
    warnings: tuple[str, ...]
    finding: Path | None = None

    def to_frame(self) -> pd.DataFrame:
        """Return what was hidden, one row a parameter."""
        import pandas as pd  # noqa: PLC0415

        rows = [
            {"effect": e["id"], "parameter": name, "value": p["value"], "unit": p["unit"]}
            for e in self.answer["effects"]
            for name, p in e["parameters"].items()
        ]
        return pd.DataFrame(rows, columns=["effect", "parameter", "value", "unit"])


@checked
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
    robot: str | Path | None = None,
    soil: str | Path | None = None,
    overwrite: bool = False,
    label: str = "hidden",
    truth: str | Path | None = None,
    jobs: int = 1,
    done: Callable[[str], None] = lambda _: None,
) -> HiddenSet:
    """Write virtual trials in which an effect is hidden, by an independent simulator; seal the answer.

    Args:
        effect: an id (also ids joined by +), or ``random``, ``none``, ``outside``, ``pair``.
        out: folder of the trials and the sealed answer.
        seed: of everything random.
        strength: factor on the effect's size.
        sizes: parameters of the effect.
        noise: factor on the sensors' noise.
        sand_off: φ, K, n, μ_s 5-20 % off the file.
        repetitions: trials of each variant; 3 on the bench, as many as the wild laboratory is drawn with.
        lab: ``bench`` for the sensors of the robot's file, ``wild`` for a logger, a robot and a sand that
            are drawn by the seed; their files lie beside the trials where they are not the catalogue's.
        robot, soil: names or files; by default granite and dry_sand.
        overwrite: replace a set that is there.
        label: with which the trials' names begin.
        truth: folder in which the true motion of each trial is kept aside (CSV).
        jobs: number of processes; 0 means one per core.
        done: called with the name of each finished trial.

    Raises:
        UsageError: unknown effect or size, or the folder holds a set already.
        EstimateError: the robot would dig itself in under this effect.
        LabError: a file cannot be written.
    """
    folder = Path(out)
    old = [*folder.glob(f"{label}_v*_r*.csv"), *folder.glob(NAME)]
    if old and not overwrite:
        raise UsageError(f"{folder}: holds a hidden set already", "choose another folder, or add --overwrite")
    true: dict[str, pd.DataFrame] = {}
    wish = Wish(effect, seed, strength, noise, sand_off, lab, dict(sizes or {}))
    the_robot, the_soil = load_robot(robot or "granite"), load_soil(soil or "dry_sand")
    trials, answer = make_set(
        wish, the_robot, the_soil,
        repetitions=repetitions, label=label, jobs=jobs or os.cpu_count() or 1, done=done,
        keep=true.__setitem__,
    )  # fmt: skip
    for path in old:
        path.unlink()
    for name, text in lab_of(lab, seed, the_robot, the_soil).files().items():
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


@checked
def reveal(folder: str | Path, finding: str | Path | None = None, *, jobs: int = 0) -> Revealed:
    """Open the sealed answer of a hidden set or of a kit, and judge a discovery by it.

    In a kit, `discover` runs first where no discovery is given and none stands in its folder `finding`.

    Args:
        folder: written by `hide`, or a kit that another laboratory filled.
        finding: JSON of a discovery or of a study, or the folder in which it stands, to be judged.
        jobs: number of processes of a search.

    Raises:
        InputError: a file cannot be used, or the answer is not the one that was promised by its hash.
        EstimateError: the search of a kit is impossible.
    """
    place, said = Path(folder), Path(finding) if finding else None
    if said is None and (place / TRIALS).is_dir():
        open_answer(place)  # a seal that does not hold is told before the search, which takes a while
        said = searched_kit(place, jobs)
    answer = open_answer(place)
    judged = score(answer, _finding(said)) if said else None
    return Revealed(answer, judged, tuple(_changed(place, answer)), said)


def _finding(place: Path) -> Mapping[str, Any]:
    from granite_lab.api.found import finding_in, newest_in  # noqa: PLC0415, heavy, and nothing to `hide`

    return finding_in(newest_in(place) if place.is_dir() else place, read_finding)


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
