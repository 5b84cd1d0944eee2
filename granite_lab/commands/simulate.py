"""`granite-lab simulate`: one run of the model, and virtual logs of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from granite_lab.commands.common import (
    EffectsOption,
    JsonOption,
    ModelOption,
    RobotOption,
    SoilOption,
    console,
    print_json,
)
from granite_lab.errors import UsageError

if TYPE_CHECKING:
    from granite_lab.effects.model_file import ModelFile
    from granite_lab.model.effect import Active
    from granite_lab.model.run import Run
    from granite_lab.parameters import Robot, Soil, Variant


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
    out: Annotated[Path | None, typer.Option(help="CSV file for the run.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Simulate one run: equations (1)-(26), with k_92 = exp(-a_θ v) unless --k92 is given."""
    import numpy as np

    from granite_lab.files import write_text
    from granite_lab.model import Accuracy
    from granite_lab.model import simulate as run_model
    from granite_lab.model.virtual import Scatter, rake
    from granite_lab.parameters import load_paper, load_robot, load_soil

    if k92 is not None and a_theta is not None:
        raise UsageError("--k92 and --a-theta exclude each other", "give one of the two")
    if truth is not None and log is None:
        raise UsageError("--truth needs --log", "give the virtual log a path with --log")
    chosen = _motion(variant, v, a, distance)
    base = _model(model, effects) if model else None
    body: Robot = load_robot(robot or (base.robot if base else "granite"), grade)
    ground: Soil = load_soil(soil or (base.soil if base else "dry_sand"))
    active: tuple[Active, ...] = base.effects if base else ()
    if k92 is None and a_theta is None and base:
        k92, a_theta = base.k92, base.a_theta
    if scatter:
        exponent = load_paper().a_theta if a_theta is None else a_theta
        ground, a_theta = rake(ground, exponent, Scatter(), np.random.default_rng([seed, 1]))
    accuracy = Accuracy(1e-6, 1e-8, 0.0025) if log else Accuracy()
    run = run_model(chosen, body, ground, k92=k92, a_theta=a_theta, effects=active, accuracy=accuracy)
    path = out or Path("reports") / "simulate" / f"v{chosen.velocity:g}.csv"
    write_text(path, run.to_frame().to_csv(index=False, float_format="%.9g"))
    if log:
        _write_log(run, log, truth, seed, repetition)
    if as_json:
        print_json(
            {
                "schema": "granite-lab/simulate/1",
                "variant_mps": chosen.velocity,
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


def _model(path: Path, effects: Path | None) -> ModelFile:
    from granite_lab.effects.model_file import load_model

    return load_model(path, effects)


def _motion(variant: float | None, v: float | None, a: float | None, distance: float | None) -> Variant:
    """Return the trapezoid that was asked for: a row of Table 2, or one given by its three numbers."""
    from granite_lab.parameters import Variant, variant_of
    from granite_lab.parameters.quantity import build

    given = {"velocity_mps": v, "acceleration_mps2": a, "distance_m": distance}
    if variant is not None:
        if any(value is not None for value in given.values()):
            raise UsageError("--variant excludes --v, --a and --distance", "give one or the other")
        return variant_of(variant)
    if any(value is None for value in given.values()):
        raise UsageError("the motion is not given", "use --variant 0.5, or all of --v, --a and --distance")
    return build(Variant, given, "command line")


def _write_log(run: Run, log: Path, truth: Path | None, seed: int, repetition: int) -> None:
    from granite_lab.files import write_text
    from granite_lab.logs import write_canonical
    from granite_lab.model.virtual import virtual_trial

    trial, true = virtual_trial(run, seed, log.stem, repetition=repetition)
    write_canonical(log, trial)
    if truth:
        header = "".join(
            f"# {key} = {value!r}\n".replace("'", '"')
            for key, value in {"virtual": True, **true.attrs}.items()
        ).replace("True", "true")
        write_text(truth, header + true.to_csv(index=False, float_format="%.7g"))


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
