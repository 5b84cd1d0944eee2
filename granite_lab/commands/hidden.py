"""`granite-lab hide`, `reveal` and `kit`: trials with a sealed answer, to judge discoveries."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands import options as o
from granite_lab.commands.printing import console, print_json, progress, show, warn

if TYPE_CHECKING:
    from granite_lab.hidden.scoring import Score


def _effects(incomplete: str) -> list[str]:
    from granite_lab.hidden.catalogue import LIBRARY, OUTSIDE
    from granite_lab.hidden.wish import LOTS

    return [name for name in (*LOTS, *LIBRARY, *OUTSIDE) if name.startswith(incomplete)]


def _labs(incomplete: str) -> list[str]:
    from granite_lab.hidden.lab import LABS

    return [name for name in LABS if name.startswith(incomplete)]


def hide(
    effect: Annotated[
        str,
        typer.Option(
            help="An id (also ids joined by +), or random, none, outside (the library), pair.",
            autocompletion=_effects,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the trials and the sealed answer.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 0,
    strength: Annotated[float, typer.Option(min=0.001, max=1000, help="Factor on the effect's size.")] = 1.0,
    size: Annotated[
        list[str] | None, typer.Option(help="A parameter of the effect: name=value, or id.name=value.")
    ] = None,
    noise: Annotated[float, typer.Option(min=0, max=100, help="Factor on the sensors' noise.")] = 1.0,
    sand_off: Annotated[bool, typer.Option("--sand-off", help="φ, K, n, μ_s 5-20 % off the file.")] = False,
    repetitions: Annotated[
        int | None, typer.Option(min=1, max=99, help="Trials of each variant.", show_default="3 on the bench")
    ] = None,
    lab: Annotated[
        str,
        typer.Option(help="bench, or wild: logger, robot and sand drawn by the seed.", autocompletion=_labs),
    ] = "bench",
    robot: o.Robot = None,
    soil: o.Soil = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a set that is there.")] = False,
    label: Annotated[str, typer.Option("--name", help="First word of the trials' names.")] = "hidden",
    truth: Annotated[Path | None, typer.Option(help="Folder to keep the true motion aside (CSV).")] = None,
    jobs: o.Jobs = 1,
    quiet: o.Quiet = False,
    as_json: o.Json = False,
) -> None:
    """Write virtual trials with a hidden effect.

    An independent simulator writes them; the answer is sealed.
    """
    from granite_lab.api.hidden import hide as run
    from granite_lab.parameters import load_variants

    total = repetitions * len(load_variants()) if repetitions else None
    with progress(quiet, "trials", total) as shown:
        made = run(
            effect, out, seed=seed, strength=strength, sizes=o.numbers_of("--size", size, "name"),
            noise=noise, sand_off=sand_off, repetitions=repetitions, lab=lab,
            robot=robot, soil=soil, overwrite=overwrite, label=label,
            truth=truth, jobs=jobs,
            done=shown.done,
        )  # fmt: skip
    if as_json:
        print_json({"schema": "granite-lab/hide/1", "trials": made.trials, "sealed": made.sealed})
    else:
        folder, finding = shlex.quote(str(out)), shlex.quote(str(out / "finding.json"))
        show(f"{len(made.trials)} virtual trials in {out}, the answer sealed in {made.sealed}")
        show(f"find it: granite-lab discover {folder} --json > {finding}")
        show(f"then:    granite-lab reveal {folder} --finding {finding}")


def reveal(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="Folder written by `hide`, or a kit that was filled in."),
    ],
    finding: Annotated[
        Path | None,
        typer.Option(
            help="A discovery to be judged: its JSON, or a folder written by `discover` or `study`."
        ),
    ] = None,
    jobs: o.Jobs = 0,
    as_json: o.Json = False,
) -> None:
    """Open a sealed answer and judge a discovery.

    A kit without a discovery in its folder `finding` is searched first.
    """
    from granite_lab.api.hidden import reveal as run

    opened = run(folder, finding, jobs=jobs)
    warn(opened.warnings)
    if as_json:
        print_json({"schema": "granite-lab/reveal/1", "answer": opened.answer, "score": opened.score})
        return
    _show_answer(opened.answer)
    if opened.score:
        _show_score(opened.score)


def _show_answer(answer: Mapping[str, Any]) -> None:
    from granite_lab.reporting.grid import grid, row_of, say

    trials = "virtual trials" if answer.get("virtual", True) else "trials"
    if answer["effects"]:
        say(console(), f"Hidden in these {trials}", "bold")
        table = grid("effect", "parameter", "value", "unit", words=(0, 1, 3))
        for effect in answer["effects"]:
            named = effect["id"] + ("" if effect["library"] else " (not in the library)")
            values = [(name, f"{p['value']:.4g}", p["unit"]) for name, p in effect["parameters"].items()]
            for k, cells in enumerate(values or [("", "", "")]):
                table.add_row(*row_of(named if k == 0 else "", *cells))
        console().print(table)
        for effect in answer["effects"]:
            told = ". ".join(part for part in (effect["title"], effect["account"]) if part)
            say(console(), f"{effect['id']}: {told}.")
    else:
        say(console(), f"Nothing is hidden in these {trials}.")
    if "made_by" in answer:
        say(console(), f"made by {answer['made_by']}")
        return
    if answer["sand_off"]:
        off = ", ".join(f"{name} {100 * (x - 1):+.1f} %" for name, x in answer["sand_off"].items())
        say(console(), f"sand off its file: {off}")
    lab = answer.get("lab", {})
    for part, drawn in lab.items() if lab.get("name") == "wild" else ():
        each = drawn.items() if isinstance(drawn, Mapping) else [("", drawn)]
        told = ", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in each)
        show(f"{part}: {told.strip()}")
    say(console(), f"seed {answer['seed']}, strength {answer['strength']:g}, noise {answer['noise']:g}")


def _show_score(judged: Score) -> None:
    from granite_lab.hidden.scoring import MEANING
    from granite_lab.reporting.grid import grid, row_of, say

    mark = "right" if judged.right else "wrong"
    named = ", ".join(judged.named) or judged.verdict
    say(console(), f"judgement: {mark}; {MEANING[judged.outcome]} (found: {named})")
    if judged.parameters:
        table = grid("effect", "parameter", "hidden", "found", "std", "z", "meaning", words=(0, 1, 6))
        for p in judged.parameters:
            std, z = "" if p.std is None else f"{p.std:.2g}", "" if p.z is None else f"{p.z:+.1f}"
            cells = (p.effect, f"{p.name} [{p.unit}]", f"{p.true:.4g}", f"{p.value:.4g}", std, z, p.kind)
            table.add_row(*row_of(*cells))
        console().print(table)
    for part, share in judged.gap_closed.items():
        if share is not None:
            say(console(), f"gap closed, {part.replace('_', ' ')} trials: {100 * share:.1f} %")


def kit(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="New folder of the kit.")],
    as_json: o.Json = False,
) -> None:
    """Write a template for a blind test.

    Another laboratory fills it in, and `reveal` judges `discover`.
    """
    from granite_lab.api.hidden import kit as write

    made = write(out)
    if as_json:
        print_json({"schema": "granite-lab/kit/1", "folder": made.folder, "files": made.files})
        return
    for path in made.files:
        show(path)
    show(f"read {made.folder / 'README.md'}; python {made.folder / 'check.py'} checks and seals it")
