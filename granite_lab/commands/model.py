"""Commands on the model: its runs, numbers and effects, and virtual trials in which an effect is hidden."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab import reporting
from granite_lab.api import hidden
from granite_lab.api import model as api
from granite_lab.api.records import Records
from granite_lab.commands.command import Call, command, warn, write_picture
from granite_lab.commands.options import Flag, Format
from granite_lab.commands.options import picture as picture_file
from granite_lab.effects import get
from granite_lab.errors import UsageError
from granite_lab.files import ending_of, write_table
from granite_lab.hidden.scoring import MEANING, Score
from granite_lab.parameters import load_paper, load_robot, load_soil, load_variants, names
from granite_lab.shown import picked

if TYPE_CHECKING:
    from granite_lab.effects.contract import Check
    from granite_lab.model.effect import Effect
    from granite_lab.model.run import Run
    from granite_lab.parameters.catalogue import Provenance

PARTS = {"train": "trials in the fit", "held_out": "trials left out of the fit"}
"""Parts of the trials that a discovery tells of, as they are printed."""


@command(api.simulate)
def simulate(
    call: Call[Run],
    out: Annotated[Path | None, typer.Option(help="File for the run (CSV or Parquet).")] = None,
    table_format: Format = None,
) -> None:
    """All signals are written into a table; means of the steady part are printed."""
    ending, log = ending_of(out, table_format), call.said.get("log")
    run = call()
    path = out or Path("reports") / "simulate" / f"v{run.variant.velocity:g}{ending}"
    write_table(path, run.to_frame(), ending)
    document = picked(run, "slip_ratio", "k92_law", "k92_value", "effects")
    document |= {"variant_mps": run.variant.velocity, "steady_s": run.steady, "wall_s": run.wall}
    call.json("simulate/1", document | {"run": path, "log": log})
    call.say(f"Simulated run, {run.variant.velocity:g} m/s", "bold")
    steady = (run.t >= run.steady[0]) & (run.t <= run.steady[1])
    rows = [
        (label, *(factor * run[name.format(axle)][steady].mean() for axle in "fr"), unit)
        for label, name, factor, unit in (
            ("slip ratio", "slip_{}", 100, "%"),
            ("sinkage", "sinkage_{}_m", 1000, "mm"),
            ("driving torque", "torque_{}_Nm", 1, "N m"),
            ("motor current", "current_{}_A", 1, "A"),
        )
    ]
    call.rows("run", rows)
    law = f"k_92 = {run.k92_value:g}" if run.k92_law == "constant" else f"a_θ = {run.k92_value:g} s/m"
    call.line(f"slip ratio of the robot λ_R = {100 * run.slip_ratio:.2f} % over the steady part, {law}")
    for name, values_of in run.effects.items():
        call.line(f"with {name}: " + ", ".join(f"{k} = {x:g}" for k, x in values_of.items()))
    call.line(f"integrated in {run.wall * 1000:.0f} ms; all signals: {path}")
    if log:
        call.line(f"virtual sensor log: {log}")


@command(api.wheel)
def wheel(
    call: Call[api.WheelRun],
    out: Annotated[Path | None, typer.Option(help="File for the table, a row for each slip.")] = None,
    arc: Annotated[Path | None, typer.Option(help="File for the stresses over the contact arc.")] = None,
    plot: Annotated[
        Path | None, picture_file("Draw the sweep over slip, or the stresses at one slip")
    ] = None,
    table_format: Format = None,
) -> None:
    """The table has a row for each slip."""
    endings = [ending_of(path, table_format) for path in (out, arc)]
    run = call()
    for path, frame, ending in zip((out, arc), (run.to_frame, run.arcs), endings, strict=True):
        if path:
            write_table(path, frame(), ending)
    if plot:
        title = f"{run.points[0].load:.1f} N on {run.soil.name}, k_92 {run.points[0].k92:.3g}"
        write_picture(plot, reporting.pictures.wheel_figure(run.points, title))
    if run.fades:
        warn(["slower than 0.02 m/s: there the model reduces slip and shear towards standstill"])
    warn([f"{name}: does not act on a single wheel" for name in run.left_out])
    document = {"wheel": run.wheels, "soil": run.soil, "points": run.to_frame().to_dict("records")}
    call.json("wheel/1", document | {"effects": {e.id: e.as_dict() for e in run.effects}})
    call.say(f"wheel of radius {run.wheels.radius:g} m and width {run.wheels.width:g} m on {run.soil.name}")
    for e in run.effects:
        call.say(f"with {e.id}: " + ", ".join(f"{k} = {x:g}" for k, x in e.as_dict().items()))
    call.rows("wheel", run.points, {"stress": lambda p: f"{p.normal_stress.max() / 1000:.1f}"})


@command(api.params)
def params(
    call: Call[Records[Provenance]],
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder whose granite-lab.toml applies.")
    ] = Path(),
) -> None:
    """Robot and soil are taken from the options, else from granite-lab.toml in the folder."""
    chosen = api.chosen_in(folder, call.said.get("robot"), call.said.get("soil"))
    rows = list(call(robot=chosen["robot"]["value"], soil=chosen["soil"]["value"]))
    document = {
        "chosen": chosen,
        "parameters": rows,
        "variants": load_variants(),
        "paper": load_paper(),
        "catalogue": {kind: names(kind) for kind in ("robots", "soils", "loggers")},
    }
    call.json("params/1", document)
    for key, value in chosen.items():
        call.line(f"{key}: {value['value']} ({value['origin']})")
    reporting.terminal.show_parameters(rows, load_variants(), call.shown)


effects = typer.Typer(
    help="List, describe and check effects.", invoke_without_command=True, rich_markup_mode=None,
    add_completion=False,
)  # fmt: skip


@effects.callback(invoke_without_command=True)
@command(api.list_effects)
def listing(call: Call[Records[Effect]], context: typer.Context) -> None:
    """The subcommand `show` describes one, `check` checks an effect file."""
    if context.invoked_subcommand is None:
        known = call()
        call.json("effects/1", {"effects": [_described(e) for e in known]})
        reporting.terminal.show_effects(known, call.shown)


@effects.command("show")
@command(api.show_effect)
def show_effect(
    call: Call[Effect],
    picture: Annotated[
        Path | None,
        picture_file(
            "Draw how the effect changes the sensor readings over the four variants",
            show_default="reports/effects/ID.png",
        ),
    ] = None,
    no_picture: Annotated[bool, typer.Option("--no-picture", help="Text only; simulates nothing.")] = False,
) -> None:
    """A picture shows how sensor readings change."""
    if picture and no_picture:
        raise UsageError("--picture and --no-picture exclude each other", "give one of the two")
    effect = call()
    if not (call.as_json or no_picture):
        picture = picture or Path("reports") / "effects" / f"{effect.id}.png"
    sentence = _draw(effect, picture) if picture else ""
    drawn = {"picture": picture, "picture_shows": sentence} if picture else {}
    call.json("effect/1", _described(effect) | drawn)
    reporting.terminal.show_effect(effect, call.shown)
    if picture:
        call.line(f"picture: {picture}")
        call.say(sentence)


def _contracts(effect: str) -> dict[str, tuple[Effect, list[Check]]]:
    """Check an effect file.

    Args:
        effect: effect file (.py), which is executed, or an id.
    """
    from granite_lab.effects.contract import contract
    from granite_lab.effects.library import read_effects

    own = effect.endswith(".py") or "/" in effect
    known = read_effects(effect) if own else {effect: get(effect)}
    return {name: (one, contract(one)) for name, one in known.items()}


@effects.command("check")
@command(_contracts, effect=Flag(metavar="FILE"))
def check_effect(call: Call[dict[str, tuple[Effect, list[Check]]]]) -> None:
    """The exit code is 3 if a check fails."""
    from granite_lab.effects.contract import refuse_failed

    found = call()
    checks = {name: own for name, (_, own) in found.items()}
    call.json("effect-check/1", {"effects": checks})
    mark = {"mark": lambda check: {True: "ok", False: "FAILED", None: "-"}[check.passed]}
    for name, (effect, own) in found.items():
        call.say(f"{name}: {effect.title}", "bold")
        call.rows("checks", own, mark | {"found": lambda check: check.detail})
    refuse_failed(checks, call.said["effect"])


def _draw(effect: Effect, path: Path) -> str:
    """Write the picture of an effect's signature at a typical size, and return what to see in it."""
    from granite_lab.effects.contract import typical
    from granite_lab.planning.imprint import imprint

    jobs = min(4, os.cpu_count() or 1)
    found = imprint(typical(effect), load_robot(), load_soil(), load_variants(), jobs=jobs)
    drawing = reporting.pictures.effect_drawing(found)
    write_picture(path, drawing.draw())
    return drawing.caption


def _described(effect: Effect) -> dict[str, Any]:
    """Return an effect as it stands in JSON."""
    return picked(effect, "id", "title", "equation", "source", "signature", "parameters")


@command(hidden.hide, busy="trials", effect=Flag(("--effect",)))
def hide(call: Call[hidden.HiddenSet]) -> None:
    """The trials and the sealed answer are written into the folder --out."""
    made, out = call(), call.said["out"]
    call.json("hide/1", vars(made))
    folder, finding = shlex.quote(str(out)), shlex.quote(str(out / "finding.json"))
    call.line(f"{len(made.trials)} virtual trials in {out}, the answer sealed in {made.sealed}")
    call.line(f"find it: granite-lab discover {folder} --json > {finding}")
    call.line(f"then:    granite-lab reveal {folder} --finding {finding}")


@command(hidden.reveal)
def reveal(call: Call[hidden.Revealed]) -> None:
    """Without a discovery, only the answer is printed."""
    opened = call()
    warn(opened.warnings)
    call.json("reveal/1", {"answer": opened.answer, "score": opened.score})
    _show_answer(opened.answer, call)
    if opened.score:
        _show_score(opened.score, call)


def _show_answer(answer: Mapping[str, Any], call: Call[Any]) -> None:
    if answer["effects"]:
        call.say("Hidden in these trials", "bold")
        rows = []
        for effect in answer["effects"]:
            named = effect["id"] + ("" if effect["library"] else " (not in the library)")
            values = [(k, p["value"], _unit(p["unit"])) for k, p in effect["parameters"].items()]
            rows += [("" if k else named, *cells) for k, cells in enumerate(values or [("", None, "")])]
        call.rows("hidden", rows, {"0": lambda row: row[0], "3": lambda row: row[3]})
        for effect in answer["effects"]:
            account = ". ".join(part for part in (effect["title"], effect["account"]) if part)
            if account:
                call.say(f"{effect['id']}: {account}.")
    else:
        call.say("Nothing is hidden in these trials.")
    if "seed" not in answer:
        return
    if answer["sand_off"]:
        off = ", ".join(f"{name} {100 * (x - 1):+.1f} %" for name, x in answer["sand_off"].items())
        call.say(f"sand off its file: {off}")
    lab = answer.get("lab", {})
    for part, drawn in lab.items() if lab.get("name") == "wild" else ():
        each = drawn.items() if isinstance(drawn, Mapping) else [("", drawn)]
        told = ", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in each)
        call.line(f"{part}: {told.strip()}")
    call.say(f"seed {answer['seed']}, strength {answer['strength']:g}, noise {answer['noise']:g}")


def _show_score(judged: Score, call: Call[Any]) -> None:
    mark = "right" if judged.right else "wrong"
    named = ", ".join(judged.named) or judged.verdict
    call.say(f"judgement: {mark}; {MEANING[judged.outcome]} (found: {named})")
    if judged.parameters:
        cells = {"parameter": lambda p: f"{p.name} [{_unit(p.unit)}]".removesuffix(" []")}
        call.rows("scored", judged.parameters, cells)
    for part, share in judged.gap_closed.items():
        if share is not None:
            call.say(f"gap closed, {PARTS[part]}: {100 * share:.1f} %")


def _unit(unit: str) -> str:
    """Return a unit as it is printed: nothing for a number without one."""
    return "" if unit == "-" else reporting.rounding.tidy_unit(unit)
