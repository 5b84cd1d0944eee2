"""`simulate`: one run of the model, and the log that its sensors would write."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from granite_lab.api.calls import checked
from granite_lab.effects import get, library, load_effects
from granite_lab.effects.model_file import ModelFile, load_model
from granite_lab.errors import UsageError
from granite_lab.logs import write_canonical, write_truth
from granite_lab.model import Accuracy, Run
from granite_lab.model import simulate as run_model
from granite_lab.model.effect import activate
from granite_lab.model.virtual import Scatter, rake, virtual_trial
from granite_lab.parameters import Robot, Soil, Variant, load_paper, load_robot, load_soil, variant_of
from granite_lab.parameters.catalogue import forget
from granite_lab.parameters.quantity import build


@checked
def simulate(
    variant: float | Variant | None = None,
    *,
    v: float | None = None,
    a: float | None = None,
    distance: float | None = None,
    k92: float | None = None,
    a_theta: float | None = None,
    robot: str | Path | Robot | None = None,
    soil: str | Path | Soil | None = None,
    grade: str | None = None,
    model: str | Path | None = None,
    effects: str | Path | None = None,
    active: Mapping[str, Mapping[str, float]] | None = None,
    log: str | Path | None = None,
    truth: str | Path | None = None,
    seed: int = 0,
    scatter: bool = False,
    repetition: int = 1,
) -> Run:
    """Simulate one run: equations (1)-(26), with k_92 = exp(-a_θ v) unless `k92` is given.

    Args:
        variant: a variant of Table 2 by its velocity [m/s], or any trapezoid.
        v, a, distance: or its velocity [m/s], acceleration [m/s^2] and distance [m].
        k92: a constant k_92.
        a_theta: a_θ of the law (5) [s/m]; the paper's by default.
        robot, soil: names or files of the catalogue, or records.
        grade: IMU grade instead of the robot's.
        model: model.toml, the paper's model with effects switched on.
        effects: your own effect file (.py). It is run: use only code you trust.
        active: effects to switch on, id to its parameters, as ``{"drive_reaction": {"share": 1.0}}``.
        log: write the log that virtual sensors would write here (CSV).
        truth: with `log`, keep the true motion aside here (CSV).
        seed: with `log` or `scatter`, of sensors and sand.
        scatter: scatter the sand as raking does.
        repetition: with `log`, number of the repetition.

    Returns:
        the run; its table has a row for each instant.

    Raises:
        UsageError: unknown name, or arguments that do not fit together.
        InputError: a number out of its bounds, or a file that cannot be used.
        EstimateError: the robot finds no rest on this soil, or the simulation does not converge.
    """
    if k92 is not None and a_theta is not None:
        raise UsageError("--k92 and --a-theta exclude each other", "give one of the two")
    if truth is not None and log is None:
        raise UsageError("--truth needs --log", "give the virtual log a path with --log")
    forget()
    chosen = trapezoid(variant, v, a, distance)
    base = load_model(Path(model), Path(effects) if effects else None) if model else None
    known = library() | (load_effects(Path(effects)) if effects and not model else {})
    switched = tuple(activate(get(name, known), values) for name, values in (active or {}).items())
    body = (
        robot if isinstance(robot, Robot) else load_robot(robot or (base.robot if base else "granite"), grade)
    )
    ground = soil if isinstance(soil, Soil) else load_soil(soil or (base.soil if base else "dry_sand"))
    if k92 is None and a_theta is None and base:
        k92, a_theta = _law(base)
    if scatter:
        exponent = load_paper().a_theta if a_theta is None else a_theta
        ground, a_theta = rake(ground, exponent, Scatter(), np.random.default_rng([seed, 1]))
    run = run_model(
        chosen, body, ground, k92=k92, a_theta=a_theta, effects=(base.effects if base else ()) + switched,
        accuracy=Accuracy(1e-6, 1e-8, 0.0025) if log else Accuracy(),
    )  # fmt: skip
    if log:
        _write_log(run, Path(log), Path(truth) if truth else None, seed, repetition)
    return run


def _law(base: ModelFile) -> tuple[float | None, float | None]:
    return base.k92, base.a_theta


def trapezoid(
    variant: float | Variant | None, v: float | None, a: float | None, distance: float | None
) -> Variant:
    """Return the motion that was asked for: a row of Table 2, or one given by its three numbers.

    Raises:
        UsageError: nothing or too much was given, or no such variant.
        InputError: a number is out of its bounds.
    """
    given: dict[str, Any] = {"velocity_mps": v, "acceleration_mps2": a, "distance_m": distance}
    if variant is not None:
        if any(value is not None for value in given.values()):
            raise UsageError("--variant excludes --v, --a and --distance", "give one or the other")
        return variant if isinstance(variant, Variant) else variant_of(variant)
    if any(value is None for value in given.values()):
        raise UsageError("the motion is not given", "use --variant 0.5, or all of --v, --a and --distance")
    return build(Variant, given, "command line")


def _write_log(run: Run, log: Path, truth: Path | None, seed: int, repetition: int) -> None:
    trial, true = virtual_trial(run, seed, log.stem, repetition=repetition)
    write_canonical(log, trial)
    if truth:
        write_truth(truth, true)
