"""`granite-lab simulate`: one run of the model, and virtual logs of it."""

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
)

if TYPE_CHECKING:
    from granite_lab.model.run import Run


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command("simulate")(simulate)


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
    robot: RobotOption = None,
    soil: SoilOption = None,
    model: ModelOption = None,
    effects: EffectsOption = None,
    log: Annotated[Path | None, typer.Option(help="Write a virtual sensor log (CSV) of the run.")] = None,
    truth: Annotated[Path | None, typer.Option(help="With --log: keep the true motion aside (CSV).")] = None,
    seed: Annotated[int, typer.Option(min=0, help="With --log: seed of sensors and sand.")] = 0,
    scatter: Annotated[bool, typer.Option(help="With --log: scatter the sand as raking does.")] = False,
    repetition: Annotated[int, typer.Option(min=1, help="With --log: number of the repetition.")] = 1,
    grade: Annotated[str | None, typer.Option(help="IMU grade instead of the robot's.")] = None,
    out: Annotated[Path | None, typer.Option(help="File for the run (CSV or Parquet).")] = None,
    table_format: FormatOption = None,
    as_json: JsonOption = False,
) -> None:
    """Simulate one run: equations (1)-(26), with k_92 = exp(-a_θ v) unless --k92 is given."""
    from granite_lab.api.simulate import simulate as run_model
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
        _show(run, path, log)


def _show(run: Run, path: Path, log: Path | None) -> None:
    from rich.table import Table

    steady = (run.t >= run.steady[0]) & (run.t <= run.steady[1])
    table = Table(title=f"Simulated run, {run.variant.velocity:g} m/s", title_justify="left")
    for heading in ("quantity", "front", "rear", "unit"):
        table.add_column(heading, justify="left" if heading in ("quantity", "unit") else "right")
    for label, name, factor, unit in (
        ("slip ratio", "slip_{}", 100, "%"),
        ("sinkage", "sinkage_{}_m", 1000, "mm"),
        ("driving torque", "torque_{}_Nm", 1, "N m"),
        ("motor current", "current_{}_A", 1, "A"),
    ):
        values = [f"{factor * run[name.format(axle)][steady].mean():.2f}" for axle in "fr"]
        table.add_row(label, *values, unit)
    shown = console()
    shown.print(table)
    law = f"k_92 = {run.k92_value:g}" if run.k92_law == "constant" else f"a_θ = {run.k92_value:g} s/m"
    shown.print(f"slip ratio of the robot λ_R = {100 * run.slip_ratio:.2f} % over the steady part, {law}")
    for name, values_of in run.effects.items():
        shown.print(f"with {name}: " + ", ".join(f"{k} = {x:g}" for k, x in values_of.items()))
    shown.print(f"integrated in {run.wall * 1000:.0f} ms; all signals: {path}", soft_wrap=True)
    if log:
        shown.print(f"virtual sensor log: {log}", soft_wrap=True)
