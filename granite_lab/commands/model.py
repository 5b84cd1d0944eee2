"""`granite-lab simulate`, `wheel`, `params` and `effects`: the model and its numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granite_lab.commands import options as o
from granite_lab.commands.printing import console, print_json, show, warn, write_picture
from granite_lab.errors import UsageError

if TYPE_CHECKING:
    from granite_lab.api.model import WheelRun
    from granite_lab.model.effect import Effect
    from granite_lab.model.run import Run


def _velocities(incomplete: str) -> list[str]:
    from granite_lab.parameters import load_variants

    return [t for v in load_variants() if (t := f"{v.velocity:g}").startswith(incomplete)]


def simulate(
    variant: Annotated[
        float | None,
        typer.Option(help="Variant of Table 2, by its velocity [m/s].", autocompletion=_velocities),
    ] = None,
    v: Annotated[float | None, typer.Option("--v", help="Desired velocity [m/s].")] = None,
    a: Annotated[float | None, typer.Option("--a", help="Largest acceleration [m/s²].")] = None,
    distance: Annotated[float | None, typer.Option(help="Total distance [m].")] = None,
    k92: Annotated[
        float | None, typer.Option(min=0, max=1, help="Constant k_92 instead of the law (5).")
    ] = None,
    a_theta: Annotated[float | None, typer.Option(min=0, max=100, help="a_θ of the law (5) [s/m].")] = None,
    robot: o.Robot = None,
    soil: o.Soil = None,
    model: o.Model = None,
    effects: o.Effects = None,
    log: Annotated[Path | None, typer.Option(help="Write a virtual sensor log (CSV) of the run.")] = None,
    truth: Annotated[Path | None, typer.Option(help="With --log: keep the true motion aside (CSV).")] = None,
    seed: Annotated[int, typer.Option(min=0, help="With --log: seed of sensors and sand.")] = 0,
    scatter: Annotated[bool, typer.Option(help="With --log: scatter the sand as raking does.")] = False,
    repetition: Annotated[int, typer.Option(min=1, help="With --log: number of the repetition.")] = 1,
    grade: o.Grade = None,
    out: Annotated[Path | None, typer.Option(help="File for the run (CSV or Parquet).")] = None,
    table_format: o.Format = None,
    as_json: o.Json = False,
) -> None:
    """Simulate one run.

    Equations (1)-(26) with k_92 = exp(-a_θ v) unless --k92 is given.
    """
    from granite_lab.api.model import simulate as run_model
    from granite_lab.files import ending_of, write_table

    ending = ending_of(out, table_format)
    run = run_model(
        variant, v=v, a=a, distance=distance, k92=k92, a_theta=a_theta, robot=robot, soil=soil, grade=grade,
        model=model, effects=effects, log=log, truth=truth, seed=seed, scatter=scatter, repetition=repetition,
    )  # fmt: skip
    path = out or Path("reports") / "simulate" / f"v{run.variant.velocity:g}{ending}"
    write_table(path, run.to_frame(), ending)
    if as_json:
        print_json(
            {
                "schema": "granite-lab/simulate/1",
                "variant_mps": run.variant.velocity,
                "slip_ratio": run.slip_ratio,
                "steady_s": run.steady,
                "k92_law": run.k92_law,
                "k92_value": run.k92_value,
                "effects": run.effects,
                "wall_s": run.wall,
                "run": path,
                "log": log,
            }
        )
    else:
        _show_run(run, path, log)


def _show_run(run: Run, path: Path, log: Path | None) -> None:
    from granite_lab.reporting.grid import grid, row_of, say

    steady = (run.t >= run.steady[0]) & (run.t <= run.steady[1])
    say(console(), f"Simulated run, {run.variant.velocity:g} m/s", "bold")
    table = grid("quantity", "front", "rear", "unit", words=(0, 3))
    for label, name, factor, unit in (
        ("slip ratio", "slip_{}", 100, "%"),
        ("sinkage", "sinkage_{}_m", 1000, "mm"),
        ("driving torque", "torque_{}_Nm", 1, "N m"),
        ("motor current", "current_{}_A", 1, "A"),
    ):
        values = [f"{factor * run[name.format(axle)][steady].mean():.2f}" for axle in "fr"]
        table.add_row(*row_of(label, *values, unit))
    console().print(table)
    law = f"k_92 = {run.k92_value:g}" if run.k92_law == "constant" else f"a_θ = {run.k92_value:g} s/m"
    show(f"slip ratio of the robot λ_R = {100 * run.slip_ratio:.2f} % over the steady part, {law}")
    for name, values_of in run.effects.items():
        show(f"with {name}: " + ", ".join(f"{k} = {x:g}" for k, x in values_of.items()))
    show(f"integrated in {run.wall * 1000:.0f} ms; all signals: {path}")
    if log:
        show(f"virtual sensor log: {log}")


def wheel(
    slip: Annotated[
        str, typer.Option(help="Slip ratio λ of (1), as 0.2, or a sweep start:end:step, as -0.5:0.9:0.1.")
    ] = "0.2",
    load: Annotated[
        float | None, typer.Option(help="Vertical load [N].", show_default="a quarter of the robot's weight")
    ] = None,
    sinkage: Annotated[float | None, typer.Option(help="Sinkage [mm] instead of a load.")] = None,
    k92: Annotated[float | None, typer.Option(help="Constant k_92 instead of the law (5).")] = None,
    a_theta: Annotated[float | None, typer.Option(help="a_θ of the law (5) [s/m].")] = None,
    omega: Annotated[float | None, typer.Option(help="Angular velocity of the wheel [rad/s].")] = None,
    v: Annotated[float | None, typer.Option("--v", help="Velocity of the wheel's centre [m/s].")] = None,
    angle: Annotated[float, typer.Option(help="Angle of the wheel [°], for effects with lugs.")] = 0.0,
    robot: o.Robot = None,
    radius: Annotated[float | None, typer.Option(help="Radius instead of the robot's [m].")] = None,
    width: Annotated[float | None, typer.Option(help="Width instead of the robot's [m].")] = None,
    soil: o.Soil = None,
    soil_value: Annotated[
        list[str] | None, typer.Option(help="A value instead of the soil's, as cohesion_Pa=500; repeatable.")
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(help="Switch an effect on, as bulldozing.strength=0.5; may be repeated."),
    ] = None,
    model: o.Model = None,
    effects: o.Effects = None,
    out: Annotated[Path | None, typer.Option(help="File for the table, a row for each slip.")] = None,
    arc: Annotated[Path | None, typer.Option(help="File for the stresses over the contact arc.")] = None,
    plot: Annotated[
        Path | None, typer.Option(help="PNG or SVG: a sweep over slip, or the stresses at one slip.")
    ] = None,
    table_format: o.Format = None,
    as_json: o.Json = False,
) -> None:
    """Compute one wheel on the soil.

    Drawbar pull, torque, sinkage and stresses by equations (4), (6)-(17).
    """
    from math import radians

    from granite_lab.api.model import wheel as run_wheel
    from granite_lab.files import ending_of, write_table

    endings = [ending_of(path, table_format) for path in (out, arc)]
    o.picture_of("--plot", plot)
    active: dict[str, dict[str, float]] = {}
    for name, value in o.numbers_of("--effect", effect, "id.parameter").items():
        active.setdefault(name.partition(".")[0], {})[name.partition(".")[2]] = value
    run = run_wheel(
        slips_of(slip), load=load, sinkage=None if sinkage is None else sinkage / 1000, k92=k92,
        a_theta=a_theta, omega=omega, v=v, angle=radians(angle), robot=robot, radius=radius, width=width,
        soil=soil, soil_values=o.numbers_of("--soil-value", soil_value, "key"), model=model, effects=effects,
        active=active,
    )  # fmt: skip
    for path, frame, ending in zip((out, arc), (run.to_frame, run.arcs), endings, strict=True):
        if path:
            write_table(path, frame(), ending)
    if plot:
        from granite_lab.reporting.plot_model import arc_figure, sweep_figure

        title = f"{run.points[0].load:.1f} N on {run.soil.name}, k_92 {run.points[0].k92:.3g}"
        figure = sweep_figure(run.points, title) if len(run.points) > 1 else arc_figure(run.points[0], title)
        write_picture(plot, figure)
    if run.fades:
        warn(["slower than 0.02 m/s: there the model reduces slip and shear towards standstill"])
    warn([f"{name}: does not act on a single wheel" for name in run.left_out])
    if as_json:
        print_json(
            {
                "schema": "granite-lab/wheel/1",
                "wheel": run.wheels,
                "soil": run.soil,
                "effects": {e.id: e.as_dict() for e in run.effects},
                "points": run.to_frame().to_dict("records"),
            }
        )
    else:
        _show_wheel(run)


def slips_of(text: str) -> list[float]:
    """Return the slip ratios that a text asks for: one, or start:end:step with both ends.

    Raises:
        UsageError: the text cannot be understood.
    """
    try:
        parts = [float(part) for part in text.split(":")]
    except ValueError:
        parts = []
    if len(parts) == 1:
        return parts
    if len(parts) != 3 or not parts[0] <= parts[1] or parts[2] <= 0 or parts[1] - parts[0] > 2:
        raise UsageError(f"--slip {text}: cannot be understood", "write 0.2, or start:end:step, as 0:0.9:0.1")
    steps = round((parts[1] - parts[0]) / parts[2])
    if steps > 10_000:
        raise UsageError(f"--slip {text}: {steps} steps are too many", "at most 10000")
    return [round(parts[0] + k * parts[2], 12) for k in range(steps + 1)]


def _show_wheel(run: WheelRun) -> None:
    from granite_lab.reporting.grid import grid, row_of, say

    table = grid("slip", "drawbar pull", "torque", "sinkage", "load", "k_92", "front", "rear", "σ max")
    table.add_row(*row_of("", "N", "N m", "mm", "N", "", "°", "°", "kPa"), style="dim")
    for p, row in zip(run.points, run.to_frame().itertuples(), strict=True):
        table.add_row(
            *row_of(
                f"{p.slip:g}", f"{p.drawbar_pull:.2f}", f"{p.torque:.3f}", f"{row.sinkage_mm:.2f}",
                f"{p.load:.1f}", f"{p.k92:.3f}", f"{row.angle_front_deg:.1f}", f"{row.angle_rear_deg:.1f}",
                f"{p.normal_stress.max() / 1000:.1f}",
            )
        )  # fmt: skip
    shown = console()
    say(shown, f"wheel of radius {run.wheels.radius:g} m and width {run.wheels.width:g} m on {run.soil.name}")
    for e in run.effects:
        say(shown, f"with {e.id}: " + ", ".join(f"{k} = {x:g}" for k, x in e.as_dict().items()))
    shown.print(table)


def params(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder whose granite-lab.toml applies.")
    ] = Path(),
    robot: o.Robot = None,
    soil: o.Soil = None,
    grade: o.Grade = None,
    as_json: o.Json = False,
) -> None:
    """Print the parameters in force.

    Each with unit, allowed range and origin.
    """
    from granite_lab.api.model import chosen_in
    from granite_lab.api.model import params as run
    from granite_lab.parameters import load_paper, load_variants, names

    chosen = chosen_in(folder, robot, soil)
    rows = list(run(chosen["robot"]["value"], chosen["soil"]["value"], grade))
    if as_json:
        print_json(
            {
                "schema": "granite-lab/params/1",
                "chosen": chosen,
                "parameters": rows,
                "variants": load_variants(),
                "paper": load_paper(),
                "catalogue": {kind: names(kind) for kind in ("robots", "soils", "loggers")},
            }
        )
    else:
        from granite_lab.reporting.terminal import show_parameters

        for key, value in chosen.items():
            show(f"{key}: {value['value']} ({value['origin']})")
        show_parameters(rows, load_variants(), console())


effects_app = typer.Typer(
    help="List, describe and check effects.",
    invoke_without_command=True,
    rich_markup_mode=None,
)


def _ids(incomplete: str) -> list[str]:
    from granite_lab.effects import library

    return [name for name in library() if name.startswith(incomplete)]


@effects_app.callback(invoke_without_command=True)
def listing(
    context: typer.Context,
    effects: o.Effects = None,
    as_json: o.Json = False,
) -> None:
    """List the effects."""
    if context.invoked_subcommand is not None:
        return
    from granite_lab.api.model import list_effects

    known = list_effects(effects)
    if as_json:
        print_json({"schema": "granite-lab/effects/1", "effects": [_described(e) for e in known]})
    else:
        from granite_lab.reporting.terminal import show_effects

        show_effects(known, console())


@effects_app.command("show")
def show_effect(
    effect_id: Annotated[str, typer.Argument(metavar="ID", autocompletion=_ids)],
    picture: Annotated[
        Path | None,
        typer.Option(
            help="PNG or SVG file for the change of the sensor readings by the effect "
            "over the four variants.",
            show_default="reports/effects/ID.png",
        ),
    ] = None,
    no_picture: Annotated[bool, typer.Option("--no-picture", help="Text only; simulates nothing.")] = False,
    effects: o.Effects = None,
    as_json: o.Json = False,
) -> None:
    """Describe an effect.

    Equation, source, parameters, and a picture of how sensor readings change.
    """
    from granite_lab.api.model import show_effect as run

    if picture and no_picture:
        raise UsageError("--picture and --no-picture exclude each other", "give one of the two")
    o.picture_of("--picture", picture)
    effect = run(effect_id, effects)
    if not as_json:
        from granite_lab.reporting import terminal

        terminal.show_effect(effect, console())
        picture = picture or (None if no_picture else Path("reports") / "effects" / f"{effect.id}.png")
    sentence = _draw(effect, picture) if picture else None
    if as_json:
        shown = {"picture": picture, "picture_shows": sentence} if picture else {}
        print_json({"schema": "granite-lab/effect/1"} | _described(effect) | shown)
    elif picture:
        show(f"picture: {picture}")
        console().print(sentence, markup=False)


@effects_app.command("check")
def check(
    effect: Annotated[
        str, typer.Argument(metavar="FILE", help="Effect file (.py), which is executed, or an id.")
    ],
    as_json: o.Json = False,
) -> None:
    """Check an effect file.

    The exit code is 3 if a check fails.
    """
    from granite_lab.effects import get
    from granite_lab.effects.contract import contract, refuse_failed
    from granite_lab.effects.library import read_effects

    known = read_effects(effect) if effect.endswith(".py") or "/" in effect else {effect: get(effect)}
    found = {name: contract(one) for name, one in known.items()}
    if as_json:
        print_json({"schema": "granite-lab/effect-check/1", "effects": found})
    else:
        from granite_lab.reporting.grid import grid, row_of, say

        shown = console()
        for name, checks in found.items():
            say(shown, f"{name}: {known[name].title}", "bold")
            table = grid("", "check", "found", words=(0, 1, 2))
            for c in checks:
                mark = {True: "ok", False: "FAILED", None: "-"}[c.passed]
                table.add_row(*row_of(mark, c.name, c.detail))
            shown.print(table)
    refuse_failed(found, effect)


def _draw(effect: Effect, path: Path) -> str:
    """Write the picture of an effect's signature at a typical size, and return what to see in it.

    Raises:
        EstimateError: a simulation does not converge.
    """
    import os

    from granite_lab.effects.contract import typical
    from granite_lab.parameters import load_robot, load_soil, load_variants
    from granite_lab.planning.imprint import imprint
    from granite_lab.reporting.plot_model import effect_drawing

    found = imprint(
        typical(effect), load_robot(), load_soil(), load_variants(), jobs=min(4, os.cpu_count() or 1)
    )
    drawing = effect_drawing(found)
    write_picture(path, drawing.draw())
    return drawing.caption


def _described(effect: Effect) -> dict[str, Any]:
    """Return an effect as it stands in JSON."""
    names = ("id", "title", "equation", "source", "signature", "parameters")
    return {name: getattr(effect, name) for name in names}
