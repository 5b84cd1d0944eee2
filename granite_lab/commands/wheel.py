"""`granite-lab wheel`: one wheel on one soil by the contact model, at one slip or over a sweep."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from granite_lab.commands.common import (
    EffectsOption,
    FormatOption,
    JsonOption,
    ModelOption,
    RobotOption,
    SoilOption,
    console,
    print_json,
    warn,
)
from granite_lab.errors import UsageError

if TYPE_CHECKING:
    from granite_lab.api.wheel import WheelRun


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command("wheel")(wheel)


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
    robot: RobotOption = None,
    radius: Annotated[float | None, typer.Option(help="Radius instead of the robot's [m].")] = None,
    width: Annotated[float | None, typer.Option(help="Width instead of the robot's [m].")] = None,
    soil: SoilOption = None,
    soil_value: Annotated[
        list[str] | None, typer.Option(help="A value instead of the soil's, as cohesion_Pa=500; repeatable.")
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(help="Switch an effect on, as bulldozing.strength=0.5; may be repeated."),
    ] = None,
    model: ModelOption = None,
    effects: EffectsOption = None,
    out: Annotated[Path | None, typer.Option(help="File for the table, a row for each slip.")] = None,
    arc: Annotated[Path | None, typer.Option(help="File for the stresses over the contact arc.")] = None,
    plot: Annotated[
        Path | None, typer.Option(help="PNG or SVG: a sweep over slip, or the stresses at one slip.")
    ] = None,
    table_format: FormatOption = None,
    as_json: JsonOption = False,
) -> None:
    """Roll one wheel on one soil: drawbar pull, torque, sinkage and stresses, equations (4), (6)-(17)."""
    from math import radians

    from granite_lab.api.wheel import wheel as run_wheel
    from granite_lab.files import ending_of, write_bytes, write_table

    endings = [ending_of(path, table_format) for path in (out, arc)]
    if plot and plot.suffix.lower() not in (".png", ".svg"):
        raise UsageError(f"--plot {plot}: not a picture", "end the name in .png or .svg")
    active: dict[str, dict[str, float]] = {}
    for name, value in _numbers("--effect", effect, "id.parameter").items():
        active.setdefault(name.partition(".")[0], {})[name.partition(".")[2]] = value
    run = run_wheel(
        slips_of(slip), load=load, sinkage=None if sinkage is None else sinkage / 1000, k92=k92,
        a_theta=a_theta, omega=omega, v=v, angle=radians(angle), robot=robot, radius=radius, width=width,
        soil=soil, soil_values=_numbers("--soil-value", soil_value, "key"), model=model, effects=effects,
        active=active,
    )  # fmt: skip
    for path, frame, ending in zip((out, arc), (run.to_frame, run.arcs), endings, strict=True):
        if path:
            write_table(path, frame(), ending)
    if plot:
        from granite_lab.reporting.canvas import to_png, to_svg
        from granite_lab.reporting.plot_wheel import arc_figure, sweep_figure

        title = f"{run.points[0].load:.1f} N on {run.soil.name}, k_92 {run.points[0].k92:.3g}"
        figure = sweep_figure(run.points, title) if len(run.points) > 1 else arc_figure(run.points[0], title)
        write_bytes(plot, to_svg(figure).encode() if plot.suffix.lower() == ".svg" else to_png(figure))
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
        _show(run)


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


def _numbers(option: str, given: list[str] | None, shape: str) -> dict[str, float]:
    found = {}
    for text in given or ():
        name, _, value = text.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise UsageError(f"{option} {text}: cannot be understood", f"write {shape}=number") from None
    return found


def _show(run: WheelRun) -> None:
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
