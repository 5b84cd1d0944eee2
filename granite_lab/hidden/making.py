"""Making a set of virtual trials: four commands, some repetitions, one hidden effect or none."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from granite_lab import __version__
from granite_lab.errors import EstimateError
from granite_lab.hidden.catalogue import UNKNOWN_TO_LIBRARY, influence, model_of
from granite_lab.hidden.command import Command, draw_stick, trapezoid
from granite_lab.hidden.contact import Array
from granite_lab.hidden.controller import CONTROLLERS
from granite_lab.hidden.gaps import LEAST, Gaps, MakeTrials
from granite_lab.hidden.lab import Lab
from granite_lab.hidden.mixture import (
    ATTEMPTS,
    STRONGER,
    motion_of,
    stronger,
    withheld_variant,
)
from granite_lab.hidden.model import DigsInError, Setup
from granite_lab.hidden.parts import exponential_k92
from granite_lab.hidden.random_numbers import generator, scaled
from granite_lab.hidden.sensors import read_currents, read_imu, read_wheels, with_noise
from granite_lab.hidden.simulator import DT, Body, drive
from granite_lab.hidden.spec import Spec, chosen, drawn, raked, sand
from granite_lab.hidden.vehicle import ClockOffset
from granite_lab.logs.trial import CurrentStream, ImuStream, Series, Trial, TrialInfo, WheelStream
from granite_lab.parameters import Soil, Variant, load_variants
from granite_lab.processes import forked_map

if TYPE_CHECKING:
    import pandas as pd

AS_FAST = 0.8, 1.1
"""Fastest speed of a stick over that of the variant in whose place it stands."""

LOGGED = 50.0
"""Rate at which a desired velocity is logged, as far as the encoders' rate allows [Hz]."""


@dataclass(frozen=True)
class Plan:
    """One trial to be made.

    Attributes:
        spec: of the set.
        lab: where it is made; its robot is as it really is, but for what the influences change.
        setup: of its model, with the sand and the radii of this trial.
        sizes: parameters of the influences by id in this trial, phases included.
        a_theta: of this trial; raking: the factors by which it and the sand were changed.
        command, repetition: which trial it is.
        seed: key of its random numbers.
        radii: (4,) true radius of each wheel over the filed one.
    """

    spec: Spec
    lab: Lab
    setup: Setup
    sizes: Mapping[str, Mapping[str, float]]
    a_theta: float
    raking: Mapping[str, float]
    command: Command
    repetition: int
    seed: tuple[int, ...]
    radii: Array

    @property
    def name(self) -> str:
        """Name of the trial, which tells nothing."""
        return f"{self.spec.label}_{self.command.label}_r{self.repetition}"


def make_set(
    spec: Spec, lab: Lab, *, jobs: int = 1, done: Callable[[str], None] = lambda _: None
) -> tuple[list[tuple[Trial, pd.DataFrame]], dict[str, Any]]:
    """Make all trials of a set, each with its true motion (`true_motion`), and the answer.

    Args:
        spec: what to hide.
        lab: where, as `lab_of` draws it; the trials name its robot and sand.
        jobs: processes.
        done: called with the name of each finished trial.

    Raises:
        UsageError: unknown effect or size.
        EstimateError: the robot would dig itself in under this effect.
        LabError: a process died.
    """
    for plans, off, gaps in _draws(spec, lab):
        made = []
        with suppress(DigsInError):
            for trial, motion in forked_map(_make, plans, len(plans), "made a trial", jobs=jobs):
                made.append((trial, motion))
                done(trial.name)
            answer = _answer(spec, off, plans)
            return made, answer | _of_mixture(plans, off, gaps) if gaps else answer
    raise EstimateError(
        "the robot sinks to its axles with the hidden effect, or a cause of a mixture does not count",
        "choose a smaller --strength or another --seed",
    )


def _draws(spec: Spec, lab: Lab) -> Iterator[tuple[list[Plan], dict[str, float], Gaps | None]]:
    """Yield the plans of a set, the factors on its sand, and the gaps of the causes of a mixture.

    They are drawn anew where the last were of no use. Sand drawn off its file may be too weak for the slope,
    drag or speed at hand. All of a mixture is drawn again, after causes that nearly count were made stronger.
    """
    mixed = spec.effect == "mixture"
    for attempt in range(ATTEMPTS if mixed else 8 if spec.sand_off else 1):
        names = chosen(spec, attempt if mixed else 0)
        sizes = drawn(spec, names, attempt if mixed else 0)
        ground, off = sand(spec, lab.soil.real, attempt)
        plans = _plans(spec, lab, ground, sizes)
        if not mixed:
            yield plans, off, None
            continue
        gaps = _gaps(plans)
        if gaps is not None and min(gaps.reopened().values()) < LEAST:
            sizes = {name: stronger(name, sizes[name], share) for name, share in gaps.reopened().items()}
            plans = _plans(spec, lab, ground, sizes)
            gaps = _gaps(plans)
        if gaps is not None and min(gaps.reopened().values()) >= LEAST:
            yield plans, off, gaps


def _gaps(plans: list[Plan]) -> Gaps | None:
    """Return the gaps of the causes; None where the robot digs in, or one is too weak to be made stronger."""
    names, robot = tuple(plans[0].sizes), plans[0].lab.robot.filed
    with suppress(DigsInError):
        return Gaps.of(_maker(plans), names, robot, least=LEAST / STRONGER**2)
    return None


def _maker(plans: list[Plan]) -> MakeTrials:
    """Return what makes the first and the middle trial of a set on other sand, and under some causes."""
    pair = plans[0], plans[len(plans) // 2]

    def make(active: Sequence[str], number: str = "", factor: float = 1.0) -> list[Trial]:
        changed = [_on_other_sand(plan, number, factor) for plan in pair]
        return [make_trial(replace(p, sizes={name: p.sizes[name] for name in active}))[0] for p in changed]

    return make


def _on_other_sand(plan: Plan, number: str, factor: float) -> Plan:
    """Return a trial with one number of its sand changed, a_θ among them."""
    if number == "a_theta":
        return replace(plan, setup=replace(plan.setup, law=exponential_k92(factor * plan.a_theta)))
    soil = scaled(plan.setup.soil, {number: factor} if number else {})
    return replace(plan, setup=replace(plan.setup, soil=soil))


def _plans(spec: Spec, lab: Lab, ground: Soil, sizes: Mapping[str, Mapping[str, float]]) -> list[Plan]:
    """Return the trials of a set; each rakes the ground anew."""
    # the weakest ground shows at the highest speed: that comes first, so that a bad draw costs little
    variants = sorted(spec.variants or load_variants(), key=lambda v: -v.velocity)
    repetitions = range(1, (spec.repetitions or lab.repetitions or 3) + 1)
    plans, (controller, gains) = [], _controller(spec, lab)
    for (k, variant), repetition in product(enumerate(variants), repetitions):
        seed = (spec.seed, 4, k, repetition)
        rng = generator(*seed, 0)
        soil, a_theta, raking = raked(ground, lab.a_theta, lab.scatter, rng)
        of_trial = {name: influence(name).of_trial(size, rng) for name, size in sizes.items()}
        radii = np.asarray(1 + lab.radius * generator(*seed, 2).standard_normal(4))
        pairs = (float(radii[:2].mean()), float(radii[2:].mean())) if lab.rolls else (1.0, 1.0)
        law = exponential_k92(a_theta)
        setup = Setup(lab.robot.real, soil, law, lab.near_rest, pairs, controller=controller, gains=gains)
        command = _command(spec, k, repetition, variant)
        plans.append(Plan(spec, lab, setup, of_trial, a_theta, raking, command, repetition, seed, radii))
    return plans


def _controller(spec: Spec, lab: Lab) -> tuple[str, dict[str, float]]:
    """Draw who turns the wheels; the paper's controller has no name."""
    if spec.controller == "paper":
        return "", {}
    rng = generator(spec.seed, 7)
    name = str(rng.choice(sorted(CONTROLLERS)))
    return name, CONTROLLERS[name].drawn(rng, lab.robot.real)


def _command(spec: Spec, k: int, repetition: int, variant: Variant) -> Command:
    """Return the command of a trial; a stick goes about as fast as the variant in whose place it stands."""
    if spec.command == "trapezoid":
        return trapezoid(variant.velocity, variant.acceleration, variant.distance)
    rng = generator(spec.seed, 8, k, repetition if spec.command == "joystick" else 0)
    return draw_stick(rng, k + 1, variant.velocity * float(rng.uniform(*AS_FAST)))


def _of_mixture(plans: list[Plan], off: Mapping[str, float], gaps: Gaps) -> dict[str, Any]:
    """Return what the answer of a mixture holds beside: what each cause reopens, the withheld motion.

    Nothing acts on that motion of which no trial tells when. Of a phase that is new in each trial the motion
    is the mean over two opposite ones.
    """
    plan = plans[0]
    variant, lab = withheld_variant(plan.spec.seed, plan.spec.variants or load_variants()), plan.lab
    ground = scaled(lab.soil.real, off)
    setup = Setup(lab.robot.real, ground, exponential_k92(lab.a_theta), lab.near_rest)
    command = trapezoid(variant.velocity, variant.acceleration, variant.distance)
    sizes = {name: size for name, size in plan.sizes.items() if influence(name).predictable}
    opposite = {name: influence(name).opposite(size) for name, size in sizes.items()}
    phases = (sizes, opposite) if any(influence(name).has_phase() for name in sizes) else (sizes,)
    truths = [model_of(tuple(sizes), setup, command, of_phase) for of_phase in phases]
    return {
        "reopens": gaps.reopened(),
        "reopens_after_refit": gaps.reopened_after_refit(_maker(plans)),
        "withheld": motion_of(truths, variant),
    }


def _make(plans: list[Plan], k: int) -> tuple[Trial, pd.DataFrame]:
    return make_trial(plans[k])


def make_trial(plan: Plan) -> tuple[Trial, pd.DataFrame]:
    """Simulate and log one trial, with its true motion.

    Raises:
        DigsInError: the robot digs itself in.
    """
    rng, lab, command = generator(*plan.seed, 1), plan.lab, plan.command
    truth = model_of(tuple(plan.sizes), plan.setup, command, plan.sizes)
    body = drive(truth, rng.uniform(*lab.before), rng.uniform(*lab.after))
    rig, wrong = with_noise(lab.robot.real, plan.spec.noise), truth.misreading()
    imu, *_ = read_imu(rng, body, rig, lab.logger, wrong)
    wheels = read_wheels(rng, body, rig, -wrong.late, wrong.encoder / (1.0 if lab.rolls else plan.radii))
    currents = read_currents(rng, body, rig, -wrong.late * wrong.later, lab.logger)
    v, a, distance = command.stated or (None, None, None)
    info = TrialInfo(
        robot=lab.robot.name, soil=lab.soil.name, v_desired=v, a_max=a, distance=distance,
        repetition=plan.repetition, virtual=True, extra={"made_by": f"granite-lab {__version__} hide"},
    )  # fmt: skip
    trial = Trial(
        name=plan.name,
        info=info,
        imu=ImuStream(imu.t.round(6), imu.specific_force.round(7), imu.angular_rate.round(8)),
        wheels=WheelStream(wheels.t.round(6), wheels.angle.round(8), resolution=wheels.resolution),
        currents=CurrentStream(currents.t.round(6), currents.current.round(5)),
        command=_logged(command, body.start, wheels.t, wrong.late) if plan.spec.logged else None,
    )
    return trial, true_motion(plan, body)


def _logged(command: Command, start: float, stamps: Array, late: float) -> Series:
    """Return the desired velocity [m/s] as the logger of the encoders saw it, at `LOGGED` of its stamps."""
    step = max(1, round(1 / (LOGGED * float(np.median(np.diff(stamps))))))
    t = stamps[::step]
    return Series(t.round(6), np.array([command.velocity(x - late - start) for x in t]).round(3))


def true_motion(plan: Plan, body: Body) -> pd.DataFrame:
    """Return what really happened: columns with units in their names, and single numbers as attributes.

    The slip ratio (2) is taken over `Command.measured`.
    """
    import pandas as pd  # noqa: PLC0415, heavy

    front, rear = body.v_wheel[:, 0], body.v_wheel[:, 2]
    start = body.start + np.array(plan.command.measured)
    rolled = np.cumsum((front + rear) / 2) * DT
    gained = np.diff(np.interp(start, body.t, body.x)), np.diff(np.interp(start, body.t, rolled))
    frame = pd.DataFrame(  # at 200 Hz, as the IMU
        {
            "t_s": body.t, "x_m": body.x, "v_mps": body.v, "pitch_rad": body.pitch,
            "v_wheel_f_mps": front, "v_wheel_r_mps": rear,
        }
    ).iloc[:: round(0.005 / DT)]  # fmt: skip
    frame.attrs = {
        "slip_ratio": float(1 - gained[0][0] / gained[1][0]),
        "t_start_s": body.start,
        "k92_law": "exponential",
        "k92_value": plan.a_theta,
        "frictional_modulus_Pa_mn": plan.setup.soil.frictional_modulus,
        "cohesion_Pa": plan.setup.soil.cohesion,
    }
    return frame


def _answer(spec: Spec, off: Mapping[str, float], plans: list[Plan]) -> dict[str, Any]:
    lab, sizes = plans[0].lab, plans[0].sizes
    late = lab.logger.behind(lab.robot.real.imu_grade.rate)
    effects = [
        {
            "id": name,
            "title": influence(name).title,
            "account": influence(name).account,
            "library": name not in UNKNOWN_TO_LIBRARY,
            "parameters": {
                size.name: {
                    # in the stamps, the latency of the IMU is part of the offset of the clocks
                    "value": sizes[name][size.name] - (late if name == ClockOffset.id else 0.0),
                    "unit": size.unit,
                    "kind": size.kind,
                }
                for size in influence(name).declared
            },
        }
        for name in sizes
    ]
    return {
        "schema": "granite-lab/sealed/1",
        "version": __version__,
        "asked": spec.effect,
        "soil_law": spec.soil_law,
        "seed": spec.seed,
        "strength": spec.strength,
        "noise": spec.noise,
        "sand_off": off,
        "lab": asdict(lab),
        "lab_a_theta": lab.a_theta,
        "command": spec.command,
        "logged": spec.logged,
        "controller": {"id": plans[0].setup.controller or "paper", **plans[0].setup.gains},
        "effects": effects,
        "trials": {
            plan.name: {
                "raking": plan.raking,
                "radii": plan.radii.tolist(),
                "sizes": plan.sizes,
                "a_theta": plan.a_theta,
            }
            for plan in plans
        },
    }
