"""`hide` and `reveal`: trials with an answer, to judge discoveries."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granite_lab.api.arguments import File, refuse_outside
from granite_lab.errors import UsageError
from granite_lab.files import sha256, write_bytes, write_text
from granite_lab.hidden.lab import lab_of
from granite_lab.hidden.scoring import Score, read_finding, score
from granite_lab.hidden.sealed import NAME, OPEN, open_answer, read_answer, seal
from granite_lab.hidden.spec import CAUSES, COMMANDS, CONTROLS, Spec
from granite_lab.logs import write_canonical, write_truth
from granite_lab.parameters import Variant, load_robot, load_soil
from granite_lab.shown import Shown, frame

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class HiddenSet(Shown):
    """Virtual trials in which something is hidden, or nothing, and the file with the sealed answer."""

    trials: tuple[Path, ...]
    sealed: Path

    def __repr__(self) -> str:
        return f"HiddenSet({len(self.trials)} virtual trials, answer sealed in {self.sealed.name})"

    def to_frame(self) -> pd.DataFrame:
        """Return the logs with their hashes, one row a trial; nothing of the answer is in it."""
        rows = [{"trial": p.stem, "path": str(p), "sha256": sha256(p)} for p in self.trials]
        return frame(rows, columns=["trial", "path", "sha256"])


@dataclass(frozen=True)
class Revealed(Shown):
    """The answer of a hidden set, the score of a discovery if one was given, and trials that have changed."""

    answer: Mapping[str, Any]
    score: Score | None
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        hidden = ", ".join(effect["id"] for effect in self.answer["effects"]) or "nothing"
        return f"Revealed({hidden}{'' if self.score is None else ', with the score of a discovery'})"

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
    causes: int = 3,
    soil_law: str = "",
    command: str = "trapezoid",
    log_command: bool = False,
    controller: str = "paper",
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
            it lacks; ``mixture``: several `causes`; ``none``.
        out: folder of the trials and the sealed answer.
        causes: of a mixture, 2 to 5. Without any of them a tenth of the squared gap is left.
        soil_law: contact law in place of the paper's: ``stress_ahead``, ``exit_by_sinkage``,
            ``shear_softening``, ``bearing_limit``, or ``random``; the paper's by default.
        command: ``trapezoid``: the variants of Table 2; ``joystick``: a person's stick, another one in each
            trial; ``recorded``: sticks, the same in all repetitions.
        log_command: the desired velocity is a column of the logs.
        controller: ``paper``: (25), (26) by the robot's file; ``unknown``: one that no file states, drawn.
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
        UsageError: unknown effect, size, command or controller, or the folder holds a set already.
        EstimateError: the robot would dig itself in under this effect.
        LabError: a file cannot be written.
    """
    for kind, value, choices in (("command", command, COMMANDS), ("controller", controller, CONTROLS)):
        if value not in choices:
            raise UsageError(f"unknown {kind} '{value}'", f"known: {', '.join(choices)}")
    refuse_outside("causes", causes, *CAUSES)
    refuse_outside("seed", seed, 0)
    refuse_outside("strength", strength, 0.001, 1000)
    refuse_outside("noise", noise, 0, 100)
    refuse_outside("repetitions", repetitions, 1, 99)
    refuse_outside("jobs", jobs, 0)
    folder = Path(out)
    from granite_lab.hidden.making import make_set  # noqa: PLC0415, heavy

    if [*folder.glob(f"{label}_[vs]*_r*.csv"), *folder.glob(NAME)]:
        raise UsageError(f"{folder}: holds a hidden set already", "choose another folder")
    if truth is not None and Path(truth).resolve() == folder.resolve():
        raise UsageError(
            f"{truth}: would hold logs and their truth under the same names", "choose two folders"
        )
    if truth is not None and (there := sorted(Path(truth).glob(f"{label}_[vs]*_r*.csv"))):
        raise UsageError(f"{there[0]}: exists already", "choose another folder for the truth")
    spec = Spec(
        effect, seed, strength, noise, sand_off, dict(sizes or {}), repetitions=repetitions, label=label,
        causes=causes, soil_law=soil_law, command=command, logged=log_command, controller=controller,
    )  # fmt: skip
    place = lab_of(lab, seed, load_robot(robot or "granite"), load_soil(soil or "dry_sand"))
    lab_files = place.files()
    if there := [folder / name for name in lab_files if (folder / name).exists()]:
        raise UsageError(f"{there[0]}: exists already", "choose another folder")
    made, answer = make_set(spec, place, jobs=jobs, done=done)
    for name, text in lab_files.items():
        write_text(folder / name, text)
    files = []
    for trial, _ in made:
        path = folder / f"{trial.name}.csv"
        write_canonical(path, trial)
        answer["trials"][trial.name]["sha256"] = sha256(path)
        files.append(path)
    write_bytes(folder / NAME, seal(answer))
    for trial, motion in made if truth else ():
        write_truth(Path(truth or "") / f"{trial.name}.csv", motion)
    return HiddenSet(tuple(sorted(files)), folder / NAME)


def reveal(folder: str | Path, finding: File = None) -> Revealed:
    """Decode the answer of a set of trials, and compare a finding with it.

    Args:
        folder: folder written by `hide`, or of another laboratory: with its answer in ``answer.json``.
        finding: discovery to be judged: JSON of `discover` or `study`, or its folder.

    Raises:
        InputError: a file cannot be used.
    """
    place = Path(folder)
    written = place / OPEN
    if written.is_file() and not (place / NAME).exists():
        from granite_lab.effects import library  # noqa: PLC0415, heavy, and nothing to `hide`

        units = {e.id: {p.name: p.unit for p in e.parameters} for e in library().values()}
        answer = read_answer(written, units)
    else:
        answer = open_answer(place)
    judged = None
    if finding:
        document = read_finding(Path(finding))
        judged = score(answer, document, _closed_withheld(answer, Path(finding)))
    return Revealed(answer, judged, tuple(_changed(place, answer)))


def _closed_withheld(answer: Mapping[str, Any], finding: Path) -> float | None:
    """Return the share of the gap at the withheld speed that the model beside a finding closes.

    The paper's model and the saved one are simulated, the saved one without what has a new phase in each
    trial; None where the answer withholds nothing, or no model was saved.
    """
    if "withheld" not in answer:
        return None
    from granite_lab.discovery.finding import MODEL  # noqa: PLC0415, heavy
    from granite_lab.effects.model_file import load_model  # noqa: PLC0415, heavy
    from granite_lab.hidden.mixture import share_closed  # noqa: PLC0415, heavy
    from granite_lab.model import simulate  # noqa: PLC0415, heavy

    saved = (finding if finding.is_dir() else finding.parent) / MODEL
    if not saved.is_file():
        return None
    hidden = answer["withheld"]
    variant = Variant(**{key: hidden[key] for key in ("velocity", "acceleration", "distance")})
    model = load_model(saved)
    runs = (
        simulate(variant, load_robot(model.robot), load_soil(model.soil)),
        simulate(
            variant, model.machine, model.ground,
            k92=model.k92, a_theta=model.a_theta, effects=model.mean_effects,
        ),
    )  # fmt: skip
    currents = (0.5 * (run["current_f_A"] + run["current_r_A"]) for run in runs)
    signals = zip(runs, currents, strict=True)
    return share_closed(hidden, *({"t_s": r.t, "v_mps": r["v_mps"], "current": i} for r, i in signals))


def _changed(folder: Path, answer: Mapping[str, Any]) -> list[str]:
    """Return a line for each trial whose log was changed since it was written."""
    lines = []
    for name, trial in answer["trials"].items():
        path = folder / f"{name}.csv"
        if not path.exists():
            lines.append(f"{path}: is missing")
        elif sha256(path) != trial["sha256"]:
            lines.append(f"{path}: has changed since it was written")
    return lines
