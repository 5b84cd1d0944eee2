"""`granite-lab hide` and `granite-lab reveal`: virtual trials with a sealed answer, to judge discoveries."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands.common import (
    JobsOption,
    JsonOption,
    QuietOption,
    RobotOption,
    SoilOption,
    console,
    print_json,
    progress,
    warn,
)
from granite_lab.errors import UsageError

if TYPE_CHECKING:
    from granite_lab.hidden.scoring import Score


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.command("hide")(hide)
    app.command("reveal")(reveal)


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
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
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
    robot: RobotOption = None,
    soil: SoilOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a set that is there.")] = False,
    label: Annotated[str, typer.Option("--name", help="First word of the trials' names.")] = "hidden",
    truth: Annotated[Path | None, typer.Option(help="Folder to keep the true motion aside (CSV).")] = None,
    jobs: JobsOption = 1,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write virtual trials in which an effect is hidden, by an independent simulator; seal the answer."""
    from granite_lab.api.hidden import hide as run
    from granite_lab.parameters import load_variants

    with progress(quiet) as display:
        task = display.add_task("trials", total=repetitions and repetitions * len(load_variants()))
        made = run(
            effect, out, seed=seed, strength=strength, sizes=_sizes(size or []), noise=noise,
            sand_off=sand_off, repetitions=repetitions, lab=lab,
            robot=robot, soil=soil, overwrite=overwrite, label=label,
            truth=truth, jobs=jobs,
            done=lambda _: display.advance(task),
        )  # fmt: skip
    if as_json:
        print_json({"schema": "granite-lab/hide/1", "trials": made.trials, "sealed": made.sealed})
    else:
        shown = console()
        shown.print(
            f"{len(made.trials)} virtual trials in {out}, the answer sealed in {made.sealed}", soft_wrap=True
        )
        folder, finding = shlex.quote(str(out)), shlex.quote(str(out / "finding.json"))
        for line in (
            f"find it: granite-lab discover {folder} --json > {finding}",
            f"then:    granite-lab reveal {folder} --finding {finding}",
        ):
            shown.print(line, soft_wrap=True, markup=False)


def _sizes(given: list[str]) -> dict[str, float]:
    found = {}
    for text in given:
        name, _, value = text.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise UsageError(
                f"--size {text}: not a number", "write name=value, as in --size play=1.5"
            ) from None
    return found


def reveal(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder written by `hide`, or a kit that was filled in.")
    ],
    finding: Annotated[
        Path | None,
        typer.Option(
            help="A discovery to be judged: its JSON, or a folder written by `discover` or `study`."
        ),
    ] = None,
    jobs: JobsOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Open the sealed answer of a hidden set or a kit, and judge a discovery by it.

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
    from rich.table import Table

    shown = console()
    trials = "virtual trials" if answer.get("virtual", True) else "trials"
    table = Table(title=f"Hidden in these {trials}", title_justify="left")
    for heading in ("effect", "parameter", "value", "unit"):
        table.add_column(heading, justify="right" if heading == "value" else "left")
    for effect in answer["effects"]:
        named = effect["id"] + ("" if effect["library"] else " (not in the library)")
        if not effect["parameters"]:
            table.add_row(named, "", "", "")
        for k, (name, parameter) in enumerate(effect["parameters"].items()):
            table.add_row(named if k == 0 else "", name, f"{parameter['value']:.4g}", parameter["unit"])
    if answer["effects"]:
        shown.print(table)
        for effect in answer["effects"]:
            told = ". ".join(part for part in (effect["title"], effect["account"]) if part)
            shown.print(f"{effect['id']}: {told}.", markup=False)
    else:
        shown.print(f"Nothing is hidden in these {trials}.")
    if "made_by" in answer:
        shown.print(f"made by {answer['made_by']}", markup=False)
        return
    if answer["sand_off"]:
        off = ", ".join(f"{name} {100 * (x - 1):+.1f} %" for name, x in answer["sand_off"].items())
        shown.print(f"sand off its file: {off}")
    if answer.get("lab", {}).get("name") == "wild":
        _show_lab(answer["lab"])
    shown.print(f"seed {answer['seed']}, strength {answer['strength']:g}, noise {answer['noise']:g}")


def _show_lab(lab: Mapping[str, Any]) -> None:
    """Print what was drawn of robot, sand and logger, a line each."""
    for part, drawn in lab.items():
        if isinstance(drawn, Mapping):
            told = ", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in drawn.items())
        else:
            told = f"{drawn:.4g}" if isinstance(drawn, float) else str(drawn)
        console().print(f"{part}: {told}", markup=False, soft_wrap=True)


def _show_score(judged: Score) -> None:
    from rich.table import Table

    from granite_lab.hidden.scoring import MEANING

    shown = console()
    mark = "right" if judged.right else "wrong"
    named = ", ".join(judged.named) or judged.verdict
    shown.print(f"judgement: {mark}; {MEANING[judged.outcome]} (found: {named})", markup=False)
    if judged.parameters:
        table = Table(title="Parameters", title_justify="left")
        for heading in ("effect", "parameter", "hidden", "found", "std", "z", "meaning"):
            table.add_column(
                heading, justify="left" if heading in ("effect", "parameter", "meaning") else "right"
            )
        for p in judged.parameters:
            table.add_row(
                p.effect, f"{p.name} [{p.unit}]", f"{p.true:.4g}", f"{p.value:.4g}",
                "" if p.std is None else f"{p.std:.2g}", "" if p.z is None else f"{p.z:+.1f}", p.kind,
            )  # fmt: skip
        shown.print(table)
    for part, share in judged.gap_closed.items():
        if share is not None:
            shown.print(f"gap closed, {part.replace('_', ' ')} trials: {100 * share:.1f} %")
