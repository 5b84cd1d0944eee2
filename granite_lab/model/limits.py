"""What cannot be simulated, and how that is said."""

from __future__ import annotations

import numpy as np

from granite_lab.errors import EstimateError
from granite_lab.logs.trial import Array
from granite_lab.model.command import V_FLOOR, duration
from granite_lab.parameters import Variant

MAX_SAMPLES = 200_000
"""Longest run, in rows of its output grid: 1,000 s at the usual step."""

MAX_STEPS = 1_000
"""Most steps of CVODES from one row to the next; usual runs take up to 400, where the robot starts."""

SHORTEST_STEADY = 0.02
"""Shortest steady part over which a slip ratio is taken [s]."""

FASTEST_BACKWARDS = V_FLOOR
"""Velocity [m/s] up to which a robot may swing back, as it does when it comes to rest."""

LEAST_TURN = 1e-3
"""Wheels that turn less than this share of what was desired stand still."""

LARGEST_GIFT = 0.02
"""Largest share of the contact's energy that may come back over a run, as an error of integration."""

_TROUBLE = {
    "TOO_MUCH_WORK": "it needs too many steps",
    "ERR_FAILURE": "the error of a step stays too large however small the step",
    "CONV_FAILURE": "the equations of a step have no solution however small the step",
    "RHSFUNC_FAIL": "an acceleration is not a number",
    "FIRST_RHSFUNC_ERR": "an acceleration is not a number at the start",
}
"""What integrators give as their reason, in words."""


def most_steps(samples: int, corners: int) -> int:
    """Return how many steps of the compiled integrator a run of so many rows may take; usual are 400.

    From each corner of a course on it begins anew, with a step that is short.
    """
    return 10_000 + 10 * samples + 50 * corners


def refuse_long(variant: Variant, samples: int, step: float) -> None:
    """Refuse a run whose table would not fit into memory.

    Raises:
        EstimateError: more than `MAX_SAMPLES` rows, `step` [s] apart.
    """
    if samples > MAX_SAMPLES:
        raise EstimateError(
            f"the run would last {duration(variant):.0f} s, at most {MAX_SAMPLES * step:.0f} s are simulated",
            "choose a shorter distance or a higher velocity",
        )


def not_converged(text: str) -> EstimateError:
    """Return the user's version of what an integrator says."""
    last = next(iter(text.strip().splitlines()[-1:]), "no reason given")
    reason = next((words for name, words in _TROUBLE.items() if name in text), last)
    return EstimateError(
        f"the simulation does not converge: {reason}", "check the parameters with 'granite-lab params'"
    )


def refuse_unsteady(variant: Variant, start: float, end: float) -> None:
    """Refuse a trapezoid without a steady part, from `start` to `end` [s].

    Raises:
        EstimateError: the distance is too short for the velocity.
    """
    if end - start < SHORTEST_STEADY:
        needed = variant.velocity**2 / variant.acceleration + 2 * SHORTEST_STEADY * variant.velocity
        raise EstimateError(
            f"the desired velocity is never steady: {variant.distance:g} m are too short for "
            f"{variant.velocity:g} m/s at {variant.acceleration:g} m/s^2",
            f"choose a distance of at least {needed:.3g} m",
        )


def refuse_backwards(slowest: float, velocity: float) -> None:
    """Refuse a run in which the robot moved backwards, `slowest` being its least velocity [m/s].

    The resistance (13) always points backwards and the contact angle ϑ_1 is always in front: the
    model holds for forward motion. Where the resistance exceeds what the wheels can do, it would
    push the robot backwards without end and add energy.

    Raises:
        EstimateError: the robot moved backwards.
    """
    if slowest < -max(FASTEST_BACKWARDS, 0.05 * velocity):
        raise EstimateError(
            f"the ground pushes the robot backwards ({slowest:.3g} m/s): the model holds for forward motion",
            "the resistance exceeds the thrust of the wheels: check soil, k_92 or a_θ, and effects",
        )


def refuse_giving(signals: dict[str, Array], wheel_base: float) -> None:
    """Refuse a run in which the ground gives energy to the robot, over the whole run.

    With a k_92 near 1 on soil of great stiffness the thrust (14) of a wheel that is slower than
    the robot can exceed every resistance; the robot would run away from its wheels.

    Args:
        signals: outputs of the graph.
        wheel_base: L [m].

    Raises:
        EstimateError: the contact gave more than `LARGEST_GIFT` of the energy that went through it.
    """
    pitch, rate, v_z = signals["pitch_rad"], signals["pitch_rate_radps"], signals["v_z_mps"]
    v_x = (signals["v_mps"] + np.sin(pitch) * v_z) / np.cos(pitch)
    taken = np.zeros_like(pitch)
    for axle, sign in (("f", 1), ("r", -1)):
        lever = sign * wheel_base / 2
        x, z = v_x - rate * np.sin(pitch) * lever, v_z - rate * np.cos(pitch) * lever
        force_x, force_z = signals[f"force_x_{axle}_N"], signals[f"force_z_{axle}_N"]
        moment = signals[f"moment_{axle}_Nm"] * signals[f"omega_{axle}_radps"]
        taken -= 2 * (force_x * x + force_z * z + moment)
    total = float(np.trapezoid(taken, signals["t_s"]))
    through = float(np.trapezoid(np.abs(taken), signals["t_s"]))
    if total < -LARGEST_GIFT * through - 1e-6:
        raise EstimateError(
            f"the ground would drive the robot: it adds {-total:.2g} J, which is outside the model's range",
            "the wheels are always slower than the robot: check k_92 or a_θ, the soil and the effects",
        )


def refuse_standing(wheels: float, variant: Variant, start: float, end: float) -> None:
    """Refuse a slip ratio of wheels that came only `wheels` [m] far from `start` to `end` [s].

    Raises:
        EstimateError: the wheels stand still.
    """
    if wheels < LEAST_TURN * variant.velocity * (end - start):
        raise EstimateError(
            "the wheels do not turn in the steady part, so there is no slip ratio",
            "the motors are too weak for this robot on this soil: check [drive], masses and the soil",
        )
