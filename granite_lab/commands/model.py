"""Commands on the model: its runs, one wheel, its numbers and its effects."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

import granite_lab as gl
from granite_lab import reporting
from granite_lab.commands.options import (
    Changes,
    ColumnMap,
    EffectFile,
    Format,
    Json,
    ModelFile,
    Robot,
    Soil,
    changes_of,
    effects_of,
    picture,
    read_all,
    slips_of,
)
from granite_lab.commands.printer import Printer, warn, write_picture
from granite_lab.effects import get
from granite_lab.errors import InputError, UsageError
from granite_lab.files import ending_of, write_table
from granite_lab.model.effect import EFFECTS
from granite_lab.parameters import load_paper, load_variants, names
from granite_lab.parameters.analyses import ALLOWED, allowed_by
from granite_lab.parameters.changes import checked
from granite_lab.parameters.new_robot import questions
from granite_lab.shown import picked

if TYPE_CHECKING:
    from granite_lab.model.effect import Effect

K92 = Annotated[float | None, Option(
    help="Constant k_92; by default the law (5), k_92 = exp(-a_θ v) (0 to 1).")]  # fmt: skip
ATheta = Annotated[float | None, Option(
    help="Exponent a_θ of the law (5) [s/m]; the paper's by default (0 to 100).")]  # fmt: skip
ModelRobot = Annotated[str | None, Option(
    help="The robot: a name of the catalogue or a .toml file; granite by default.")]  # fmt: skip
ModelSoil = Annotated[str | None, Option(
    help="The soil: a name of the catalogue or a .toml file; dry_sand by default.")]  # fmt: skip
Active = Annotated[list[str] | None, Option(
    "--effect", help="Switch an effect on, as bulldozing.strength=0.5; may be repeated.")]  # fmt: skip


def simulate(
    variant: Annotated[float | None, Option(help="Variant of Table 2, named by its velocity [m/s].")] = None,
    v: Annotated[float | None, Option(
        help="Desired velocity [m/s] instead of a variant; needs --a and --distance.")] = None,
    a: Annotated[float | None, Option(help="Largest acceleration [m/s²] (with --v).")] = None,
    distance: Annotated[float | None, Option(help="Total distance [m] (with --v).")] = None,
    command: Annotated[str | None, Option(
        help="Any desired velocity, linear between times, as '0:0, 1:0.3, 5:0.3, 6:0' [s, m/s].")] = None,
    wheels: Annotated[Path | None, Option(
        help="Log whose measured wheel speeds drive the simulation.")] = None,
    column_map: ColumnMap = None,
    log: Annotated[Path | None, Option(help="File for the log of virtual sensors (CSV).")] = None,
    seed: Annotated[int, Option(help="Seed of the random numbers of the sensors.")] = 0,
    k92: K92 = None, a_theta: ATheta = None, robot: ModelRobot = None, soil: ModelSoil = None,
    changes: Changes = None,
    model: ModelFile = None, effects: EffectFile = None, active: Active = None,
    out: Annotated[Path | None, Option(help="File for the run (CSV or Parquet).")] = None,
    table_format: Format = None, as_json: Json = False,
) -> None:  # fmt: skip
    """Simulate one run by equations (1)-(26), with k_92 = exp(-a_θ v) or a constant --k92.

    All signals are written into a table; means of the steady part are printed.
    """
    ending = ending_of(out, table_format)
    run = gl.simulate(
        variant, v=v, a=a, distance=distance, command=command, wheels=wheels, column_map=column_map, log=log,
        seed=seed,
        k92=k92, a_theta=a_theta, robot=robot, soil=soil, model=model, effects=effects,
        active=effects_of(active), changes=changes_of(changes),
    )  # fmt: skip
    path = out or Path("reports") / "simulate" / f"v{run.variant.velocity:g}{ending}"
    write_table(path, run.to_frame(), ending)
    document = picked(run, "slip_ratio", "k92_law", "k92_value", "effects")
    document |= {"variant_mps": run.variant.velocity, "steady_s": run.steady, "wall_s": run.wall}
    printer = Printer(as_json)
    printer.json("simulate/1", document | {"run": path, "log": log})
    printer.say(f"Simulated run, {run.variant.velocity:g} m/s", "bold")
    reporting.terminal.show_run(run, printer.shown)
    law = f"k_92 = {run.k92_value:.4g}" if run.k92_law == "constant" else f"a_θ = {run.k92_value:.4g} s/m"
    printer.line(f"slip ratio of the robot λ_R = {100 * run.slip_ratio:.2f} % over the steady part, {law}")
    for name, values_of in run.effects.items():
        printer.say(f"with {name}: {reporting.names.in_units(name, values_of)}")
    printer.line(f"integrated in {run.wall * 1000:.0f} ms; all signals: {path}")
    if log:
        printer.line(f"virtual sensor log: {log}")


def wheel(
    slip: Annotated[str, Option(
        help="Slip ratio λ of (1), as 0.2, or a sweep start:end:step, as -0.5:0.9:0.1.")] = "0.2",
    load: Annotated[float | None, Option(
        help="Vertical load [N]; a quarter of the robot's weight by default (0.001 to 100000).")] = None,
    sinkage: Annotated[float | None, Option(help="Sinkage [mm] instead of a load.")] = None,
    v: Annotated[float | None, Option(help="Velocity of the wheel's centre [m/s].")] = None,
    k92: K92 = None, a_theta: ATheta = None, robot: ModelRobot = None, soil: ModelSoil = None,
    changes: Changes = None,
    model: ModelFile = None, effects: EffectFile = None, active: Active = None,
    out: Annotated[Path | None, Option(help="File for the table, a row for each slip.")] = None,
    plot: Annotated[Path | None, picture("Draw the sweep over slip, or the stresses at one slip")] = None,
    table_format: Format = None, as_json: Json = False,
) -> None:  # fmt: skip
    """Compute one wheel on the soil, at a load or a sinkage, by the contact model (4), (6)-(17).

    Without --v, the larger of ω r and v is 0.1 m/s. Above 0.02 m/s only effects depend on it. The law (5) is
    evaluated at this velocity.

    The table has a row for each slip.
    """
    (slips,) = read_all("--slip", [slip], slips_of, "write 0.2, or start:end:step, as 0:0.9:0.1")
    ending = ending_of(out, table_format)
    run = gl.wheel(
        slips, load=load, sinkage=None if sinkage is None else sinkage / 1000, v=v,
        k92=k92, a_theta=a_theta, robot=robot, soil=soil, model=model, effects=effects,
        active=effects_of(active), changes=changes_of(changes),
    )  # fmt: skip
    if out:
        write_table(out, run.to_frame(), ending)
    if plot:
        title = f"{run.points[0].load:.1f} N on {run.soil.name}, k_92 {run.points[0].k92:.3g}"
        write_picture(plot, reporting.pictures.wheel_figure(run.points, title))
    if run.fades:
        warn(["slower than 0.02 m/s: there the model reduces slip and shear towards standstill"])
    warn([f"{name}: does not act on a single wheel" for name in run.left_out])
    document = {"wheel": run.wheels, "soil": run.soil, "points": run.to_frame().to_dict("records")}
    printer = Printer(as_json)
    printer.json("wheel/1", document | {"effects": {e.id: e.as_dict() for e in run.effects}})
    printer.say(
        f"wheel of radius {run.wheels.radius:g} m and width {run.wheels.width:g} m on {run.soil.name}"
    )
    for e in run.effects:
        printer.say(f"with {e.id}: {reporting.names.in_units(e.id, e.as_dict())}")
    from granite_lab.model.single_wheel import WHEEL_POINTS

    printer.rows(WHEEL_POINTS, run.points)


def params(
    folder: Annotated[Path, Argument(
        metavar="FOLDER", help="Folder whose granite-lab.toml applies.")] = Path(),
    robot: Robot = None,
    soil: Soil = None,
    as_json: Json = False,
) -> None:  # fmt: skip
    """List every number in force with its unit, allowed range and origin.

    Robot and soil are taken from the options, else from granite-lab.toml in the folder.
    """
    from granite_lab.api.model import chosen_in

    chosen = chosen_in(folder, robot, soil)
    rows = list(gl.params(robot=chosen["robot"]["value"], soil=chosen["soil"]["value"]))
    analyses = allowed_by(rows)
    document = {
        "chosen": chosen,
        "parameters": rows,
        "analyses": analyses,
        "variants": load_variants(),
        "paper": load_paper(),
        "catalogue": {kind: names(kind) for kind in ("robots", "soils", "loggers")},
    }
    printer = Printer(as_json)
    printer.json("params/1", document)
    for key, value in chosen.items():
        printer.line(f"{key}: {value['value']} ({value['origin']})")
    reporting.terminal.show_parameters(rows, load_variants(), printer.shown)
    printer.line("")
    printer.line("analyses that the robot's file allows", "bold")
    printer.rows(ALLOWED, analyses)


def robot(
    new: Annotated[Path, Argument(metavar="NEW.toml", help="The file to write.")],
    changes: Annotated[list[str] | None, Option(
        "--set", help="A number of the robot, as robot.wheels.radius_m=0.106; may be repeated.")] = None,
    like: Annotated[str | None, Option(
        help="A robot whose numbers stand in for those that are not given: a name of the catalogue or a "
        ".toml file.")] = None,
    analysis: Annotated[str, Option(
        help="Ask on a terminal for the numbers that this analysis needs: estimate, counts, wheels or "
        "motors. Each needs those of the ones before it, too.")] = "motors",
    as_json: Json = False,
) -> None:  # fmt: skip
    """Write the commented file of a robot, and say which analyses it allows.

    On a terminal each number that --set does not give is asked for; Enter leaves it out.
    """
    asked = questions(analysis)
    given = changes_of(changes)
    if sys.stdin.isatty() and not as_json and not new.exists():
        given |= _answers({key: text for key, text in asked.items() if key not in given})
    made, printer = gl.robot(new, changes=given, like=like), Printer(as_json)
    printer.json("robot/1", vars(made))
    printer.line(f"robot: {made.path}")
    printer.rows(ALLOWED, made.analyses)
    printer.line(f"then: granite-lab params --robot {shlex.quote(str(made.path))}")


def _answers(questions: Mapping[str, str]) -> dict[str, float]:
    """Ask for numbers by their keys on the terminal, each until the answer is a valid number or empty."""
    answers: dict[str, float] = {}
    for key, question in questions.items():
        while text := typer.prompt(question, default="", show_default=False, err=True).strip():
            try:
                answers |= checked(changes_of([f"{key}={text}"]))
                break
            except (UsageError, InputError) as error:
                typer.echo(f"{error.message}; {error.hint}", err=True)
    return answers


effects = typer.Typer(
    help="List, describe and check effects.", invoke_without_command=True, rich_markup_mode=None,
    add_completion=False,
)  # fmt: skip


@effects.callback(invoke_without_command=True)
def list_effects(context: typer.Context, effects: EffectFile = None, as_json: Json = False) -> None:
    """List every effect that can be added to the paper's model.

    The subcommand show describes one, check checks an effect file.
    """
    if context.invoked_subcommand is None:
        listed, printer = gl.list_effects(effects), Printer(as_json)
        printer.json("effects/1", {"effects": [_described(effect) for effect in listed]})
        printer.rows(EFFECTS, listed)


@effects.command("show")
def show_effect(
    effect_id: Annotated[str, Argument(metavar="ID", help="Its id.")],
    effects: EffectFile = None,
    as_json: Json = False,
) -> None:  # fmt: skip
    """Describe one effect: equation, source and parameters."""
    effect, printer = gl.show_effect(effect_id, effects), Printer(as_json)
    printer.json("effect/1", _described(effect))
    reporting.terminal.show_effect(effect, printer.shown)


@effects.command("check")
def check_effect(
    effect: Annotated[str, Argument(metavar="FILE", help="Effect file (.py), which is executed, or an id.")],
    as_json: Json = False,
) -> None:
    """Check an effect file.

    The exit code is 3 if a check fails.
    """
    from granite_lab.effects.contract import CHECKS, contract, refuse_failed
    from granite_lab.effects.library import read_effects

    is_file = effect.endswith(".py") or "/" in effect
    effects = read_effects(effect) if is_file else {effect: get(effect)}
    checks = {name: contract(described) for name, described in effects.items()}
    printer = Printer(as_json)
    printer.json("effect-check/1", {"effects": checks})
    for name, described in effects.items():
        printer.say(f"{name}: {described.title}", "bold")
        printer.rows(CHECKS, checks[name])
    refuse_failed(checks, effect)


def _described(effect: Effect) -> dict[str, Any]:
    """Return an effect as it stands in JSON."""
    return picked(effect, "id", "title", "equation", "source", "signature", "parameters")
