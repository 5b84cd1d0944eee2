"""Making a set of virtual trials: four variants, some repetitions, one hidden effect or none."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

import numpy as np

from granite_lab import __version__
from granite_lab.errors import EstimateError
from granite_lab.hidden.catalogue import LIBRARY, influence, model_of
from granite_lab.hidden.contact import Array
from granite_lab.hidden.lab import Lab, lab_of
from granite_lab.hidden.parts import Trapezoid, exponential_k92
from granite_lab.hidden.sensors import louder, read_currents, read_imu, read_wheels
from granite_lab.hidden.simulator import DT, Body, body_from_states, solve
from granite_lab.hidden.vehicle import ClockOffset
from granite_lab.hidden.wish import Wish, chosen, drawn, raked, sand
from granite_lab.logs.trial import CurrentStream, ImuStream, Trial, TrialInfo, WheelStream
from granite_lab.parameters import Robot, Soil, Variant, load_variants

if TYPE_CHECKING:
    import pandas as pd

RELATIVE, ABSOLUTE = 3e-6, 1e-7
"""Tolerances of the integration: the velocity is then within 0.002 mm/s of that at 1e-8."""


@dataclass(frozen=True)
class Plan:
    """One trial to be made; picklable.

    Attributes:
        names: ids of the influences; sizes: their parameters in this trial, phases included.
        lab: where it is made; its robot is as it really is, but for what the influences change.
        soil, a_theta: of this trial; raking: by which factors it changed them.
        variant, repetition: which trial it is.
        seed: key of its random numbers.
        noise: factor on the noise of the sensors.
        label: with which its name begins.
    """

    names: tuple[str, ...]
    sizes: Mapping[str, Mapping[str, float]]
    lab: Lab
    soil: Soil
    a_theta: float
    raking: Mapping[str, float]
    variant: Variant
    repetition: int
    seed: tuple[int, ...]
    noise: float
    label: str

    @property
    def name(self) -> str:
        """Name of the trial, which tells nothing."""
        return f"{self.label}_v{self.variant.velocity:g}_r{self.repetition}"

    @property
    def radii(self) -> Array:
        """True radius of each wheel in this trial over the filed one, (4,)."""
        rng = np.random.default_rng([*self.seed, 2])
        return np.asarray(1 + self.lab.radius * rng.standard_normal(4))


def make_set(
    wish: Wish,
    robot: Robot,
    soil: Soil,
    *,
    repetitions: int | None = None,
    variants: tuple[Variant, ...] = (),
    jobs: int = 1,
    label: str = "hidden",
    done: Callable[[str], None] = lambda _: None,
    keep: Callable[[str, pd.DataFrame], None] = lambda *_: None,
) -> tuple[list[Trial], dict[str, Any]]:
    """Make all trials of a set, with the answer.

    Args:
        wish: what to hide.
        robot, soil: records that the trials will name.
        repetitions: of each variant; 3 when the laboratory does not say.
        variants: those of Table 2 when empty.
        jobs: processes.
        label: with which the trials' names begin.
        done: called with the name of each finished trial.
        keep: called with the name and the true motion of each trial, see `true_motion`.

    Raises:
        UsageError: unknown effect or size, or a robot without chassis, drive or IMU.
        EstimateError: the robot would dig itself in under this effect.
    """
    lab = lab_of(wish.lab, wish.seed, robot, soil)
    names = chosen(wish)
    sizes = drawn(wish, names)
    # the weakest ground shows at the highest speed: that comes first, so that a bad draw costs little
    ordered = sorted(variants or load_variants(), key=lambda v: -v.velocity)
    count = repetitions or lab.repetitions or 3
    # Sand drawn off its file may be too weak for the slope, drag or speed at hand; it is drawn again then.
    for attempt in range(8 if wish.sand_off else 1):
        ground, off = sand(wish, lab.soil, attempt)
        plans = []
        for (k, variant), repetition in product(enumerate(ordered), range(1, count + 1)):
            seed = (wish.seed, 4, k, repetition)
            rng = np.random.default_rng([*seed, 0])
            there, a_theta, factors = raked(ground, lab.a_theta, lab.scatter, rng)
            own = {name: influence(name).of_trial(sizes[name], rng) for name in names}
            plans.append(
                Plan(names, own, lab, there, a_theta, factors, variant, repetition, seed, wish.noise, label)
            )
        made = []
        for one in _run(plans, jobs):
            if one is None:
                break
            made.append(one)
            done(one[0].name)
        if len(made) == len(plans):
            for trial, motion in made:
                keep(trial.name, motion)
            return [trial for trial, _ in made], _answer(wish, lab, names, sizes, off, plans)
    raise EstimateError(
        "the robot sinks to its axles with the hidden effect", "choose a smaller --strength or another --seed"
    )


def _run(plans: list[Plan], jobs: int) -> Iterator[tuple[Trial, pd.DataFrame] | None]:
    if jobs <= 1:
        yield from map(make_trial, plans)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(make_trial, plans)


def make_trial(plan: Plan) -> tuple[Trial, pd.DataFrame] | None:
    """Simulate and log one trial, with its true motion; None if the robot digs itself in."""
    rng, lab = np.random.default_rng([*plan.seed, 1]), plan.lab
    command = Trapezoid(plan.variant.velocity, plan.variant.acceleration, plan.variant.distance)
    radii = plan.radii
    rolling = radii if lab.rolls else np.ones(4)
    truth = model_of(
        plan.names, lab.robot, plan.soil, command, exponential_k92(plan.a_theta), plan.sizes,
        near_rest=lab.near_rest, radii=(float(rolling[:2].mean()), float(rolling[2:].mean())),
    )  # fmt: skip
    before, after = rng.uniform(*lab.before), rng.uniform(*lab.after)
    steps = np.arange(-round(before / DT), round((command.end + after) / DT) + 1)
    t = np.asarray(steps * DT)
    try:
        state = solve(truth, t, rtol=RELATIVE, atol=ABSOLUTE)
    except RuntimeError:
        return None
    body = body_from_states(truth, t, state)
    if not np.isfinite(state).all() or body.x[-1] < 0.35 * command.distance:
        return None
    rig, wrong = louder(lab.robot, plan.noise), truth.misreading()
    imu, *_ = read_imu(
        rng, body, rig, scale_error=lab.imu_gain, misreading=wrong,
        jitter=lab.imu_jitter, late=lab.late if lab.stamped_at_end else None,
    )  # fmt: skip
    wheels = read_wheels(rng, body, rig, -wrong.late, wrong.encoder / (1.0 if lab.rolls else radii))
    currents = read_currents(rng, body, rig, -wrong.late * wrong.later, lab.ripple)
    info = TrialInfo(
        robot=lab.robot_name, soil=lab.soil_name, v_desired=plan.variant.velocity,
        a_max=plan.variant.acceleration, distance=plan.variant.distance, repetition=plan.repetition,
        virtual=True, extra={"made_by": f"granite-lab {__version__} hide"},
    )  # fmt: skip
    trial = Trial(
        name=plan.name,
        info=info,
        imu=ImuStream(imu.t.round(6), imu.specific_force.round(7), imu.angular_rate.round(8)),
        wheels=WheelStream(wheels.t.round(6), wheels.angle.round(8), resolution=wheels.resolution),
        currents=None if currents is None else CurrentStream(currents.t.round(6), currents.current.round(5)),
    )
    return trial, true_motion(plan, command, body)


def true_motion(plan: Plan, command: Trapezoid, body: Body) -> pd.DataFrame:
    """Return what really happened: columns with units in their names, and single numbers as attributes.

    The slip ratio (2) is that of the second half of the constant desired velocity.
    """
    import pandas as pd  # noqa: PLC0415, heavy

    front, rear = body.v_wheel[:, 0], body.v_wheel[:, 2]
    start = body.start + command.ramp + np.array([0.5, 1.0]) * command.hold
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
        "frictional_modulus_Pa_mn": plan.soil.frictional_modulus,
        "cohesion_Pa": plan.soil.cohesion,
    }
    return frame


def _answer(
    wish: Wish,
    lab: Lab,
    names: tuple[str, ...],
    sizes: Mapping[str, Mapping[str, float]],
    off: Mapping[str, float],
    plans: list[Plan],
) -> dict[str, Any]:
    effects = [
        {
            "id": name,
            "title": influence(name).title,
            "account": influence(name).account,
            "library": name in LIBRARY,
            "parameters": {
                size.name: {
                    # whoever sees only the stamps sees the IMU's lateness in the offset of the clocks
                    "value": sizes[name][size.name] - (lab.imu_late if name == ClockOffset.id else 0.0),
                    "unit": size.unit,
                    "kind": size.kind,
                }
                for size in influence(name).declared
            },
        }
        for name in names
    ]
    return {
        "schema": "granite-lab/sealed/1",
        "version": __version__,
        "asked": wish.effect,
        "seed": wish.seed,
        "strength": wish.strength,
        "noise": wish.noise,
        "sand_off": off,
        "lab": {"name": lab.name, **lab.drawn},
        "effects": effects,
        "trials": {
            plan.name: {
                "raking": plan.raking,
                "radii": plan.radii.tolist(),
                "sizes": plan.sizes,
            }
            for plan in plans
        },
    }
