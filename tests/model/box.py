"""Random robots, soils and motions within the bounds of the parameters, and the energy of their runs."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from granite_lab.effects import library
from granite_lab.model import Run
from granite_lab.model.effect import Active, EffectParameter, activate
from granite_lab.parameters import GRAVITY, Robot, Soil, Variant, load_robot, load_soil

T = TypeVar("T")
ROBOT, SOIL = load_robot(), load_soil()
LONGEST = 30.0
"""Longest command that is drawn [s]; longer ones only take more time."""


@dataclass(frozen=True)
class Draw:
    """One point of the box."""

    kind: str
    robot: Robot
    soil: Soil
    variant: Variant
    k92: float | None
    a_theta: float | None
    effects: tuple[Active, ...]


def draw(seed: int, number: int) -> Draw:
    """Draw a point: anywhere in the box, around the robot of the paper, or around one of another size."""
    rng = np.random.default_rng([seed, number])
    kind = ("anywhere", "near", "another size", "near, with effects")[number % 4]
    if kind == "anywhere":
        robot = in_parts(ROBOT, lambda part: anywhere(part, rng))
        soil, variant = anywhere(SOIL, rng), _motion(rng, (0.01, 5.0), (0.01, 50.0))
    else:
        size = math.exp(rng.uniform(math.log(0.25), math.log(4))) if kind == "another size" else 1.0
        robot, soil = scaled(ROBOT, SOIL, size)
        factor = 1.3 if kind == "another size" else 2.0
        robot = in_parts(robot, lambda part: near(part, rng, factor))
        soil = near(soil, rng, factor)
        variant = _motion(rng, (0.05 * size**0.5, 2 * size**0.5), (0.1, 10.0))
    law = rng.integers(3)
    k92 = float(rng.uniform(0, 1)) if law == 0 else None
    a_theta = float(rng.uniform(0, 20)) if law == 1 else None
    effects: tuple[Active, ...] = ()
    if kind == "near, with effects":
        known = library()
        chosen = rng.choice(sorted(known), size=int(rng.integers(1, 3)), replace=False)
        wide = bool(rng.integers(2))

        def size(p: EffectParameter) -> float:
            return float(rng.uniform(*((p.low, p.high) if wide else (p.prior_low, p.prior_high))))

        effects = tuple(activate(known[n], {p.name: size(p) for p in known[n].parameters}) for n in chosen)
    return Draw(kind, robot, soil, variant, k92, a_theta, effects)


def in_parts(robot: Robot, change: Callable[[Any], Any]) -> Robot:
    """Return a robot with its wheels, chassis and drive changed, in this order."""
    return dataclasses.replace(
        robot, **{p: change(getattr(robot, p)) for p in ("wheels", "chassis", "drive")}
    )


def _motion(rng: np.random.Generator, v: tuple[float, float], a: tuple[float, float]) -> Variant:
    velocity = float(np.exp(rng.uniform(*np.log(v))))
    acceleration = float(np.exp(rng.uniform(*np.log(a))))
    level = float(np.exp(rng.uniform(math.log(0.5), math.log(LONGEST / 3))))
    distance = velocity * (level + velocity / acceleration)
    bounds = {f.name: f.metadata for f in dataclasses.fields(Variant)}
    values = {"velocity": velocity, "acceleration": acceleration, "distance": distance}
    return Variant(**{n: min(max(x, bounds[n]["low"]), bounds[n]["high"]) for n, x in values.items()})


def anywhere(record: T, rng: np.random.Generator) -> T:
    """Draw every number of a record within its bounds, evenly on a logarithmic scale where it is positive."""
    return _changed(record, lambda low, high, _: _log(rng, low, high) if low > 0 else rng.uniform(low, high))


def near(record: T, rng: np.random.Generator, factor: float) -> T:
    """Draw every number of a record up to a factor away, within its bounds."""
    return _changed(record, lambda _low, _high, x: x * _log(rng, 1 / factor, factor))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _changed(record: T, new: Any) -> T:
    changes = {}
    for field in dataclasses.fields(record):
        read = not field.name.startswith("slip") and not field.name.endswith("_std")  # by the simulator
        if "unit" in field.metadata and read:
            low, high = field.metadata["low"], field.metadata["high"]
            value = float(new(low, high, getattr(record, field.name)))
            changes[field.name] = min(max(value, low), high)
    return dataclasses.replace(record, **changes)


def scaled(robot: Robot, soil: Soil, size: float) -> tuple[Robot, Soil]:
    """Return a robot and soil that move alike at another size: lengths times `size`, same gravity.

    Masses grow with the cube, times and velocities with the root. Of the motors, voltages grow
    with `size` and currents with its power 2.5.
    """
    s, n = size, soil.exponent
    powers = {
        "wheels": {"radius": 1, "width": 1},
        "chassis": {
            "wheel_base": 1, "track": 1, "body_mass": 3, "wheel_mass": 3, "com_x": 1, "com_z": 1,
            "wheel_inertia": 5, "pitch_inertia": 5, "contact_damping": 2.5, "tyre_stiffness": 2,
        },
        "drive": {
            "inductance": -1, "resistance": -1.5, "emf_constant": 1.5, "torque_constant": 1.5,
            "voltage_max": 1, "voltage_min": 1, "gain_p": 1, "gain_d": 1.5,
        },
    }  # fmt: skip
    ground = {"cohesive_modulus": 2 - n, "frictional_modulus": 1 - n, "cohesion": 1, "shear_modulus": 1}
    return times(robot, s, **powers), grown(soil, s, ground)


def grown(record: T, factor: float, powers: dict[str, float]) -> T:
    """Return a record whose numbers are multiplied by powers of a factor."""
    return dataclasses.replace(record, **{k: getattr(record, k) * factor**p for k, p in powers.items()})


def times(robot: Robot, factor: float, **powers: dict[str, float]) -> Robot:
    """Return a robot, numbers of whose parts are multiplied by powers of a factor."""
    return dataclasses.replace(
        robot, **{part: grown(getattr(robot, part), factor, of) for part, of in powers.items()}
    )


def altered(robot: Robot, **parts: dict[str, float]) -> Robot:
    """Return a robot with other numbers in some of its parts."""
    return dataclasses.replace(
        robot, **{part: dataclasses.replace(getattr(robot, part), **values) for part, values in parts.items()}
    )


def energies(run: Run) -> tuple[float, float]:
    r"""Return what the balance of a run without effects leaves, and what the ground took, as shares of all.

    With the ground's forces F on a wheel's centre and moment M_ω on the wheel, the powers are

    .. math:: \sum 2 n_d k_m i ω = \dot E + \sum 2 (1 - η_d) n_d k_m i ω
              - \sum 2 (F_x \dot x_A + F_z \dot z_A + M_ω ω)

    where the sums run over the axles and E is the kinetic energy of body and wheels and m g z.
    Everything is taken in the ground frame from the motion of R, independently of (20)-(23).
    """
    c, d = run.robot.chassis, run.robot.drive
    t, Θ, q = run.t, run["pitch_rad"], run["pitch_rate_radps"]
    ż = run["v_z_mps"]
    ẋ = (run["v_mps"] + np.sin(Θ) * ż) / np.cos(Θ)

    def velocity(x: float, z: float) -> tuple[Any, Any]:
        dx, dz = np.cos(Θ) * x + np.sin(Θ) * z, -np.sin(Θ) * x + np.cos(Θ) * z
        return ẋ + q * dz, ż - q * dx

    vx, vz = velocity(c.com_x, c.com_z)
    height = run["z_m"] - np.sin(Θ) * c.com_x + np.cos(Θ) * c.com_z
    energy = c.total_mass * ((vx**2 + vz**2) / 2 + GRAVITY * height) + c.pitch_inertia * q**2 / 2
    shaft = ground = np.zeros_like(height)
    for axle, place in (("f", c.wheel_base / 2), ("r", -c.wheel_base / 2)):
        ω = run[f"omega_{axle}_radps"]
        ax, az = velocity(place, 0.0)
        energy = energy + c.wheel_inertia * ω**2
        shaft = shaft + 2 * d.gear_ratio * d.torque_constant * run[f"current_{axle}_A"] * ω
        ground = ground - 2 * (
            run[f"force_x_{axle}_N"] * ax + run[f"force_z_{axle}_N"] * az + run[f"moment_{axle}_Nm"] * ω
        )
    work, lost = float(np.trapezoid(shaft, t)), float(np.trapezoid(ground, t))
    scale = float(np.trapezoid(np.abs(shaft), t) + np.trapezoid(np.abs(ground), t) + np.ptp(energy))
    return float(d.gear_efficiency * work - (energy[-1] - energy[0]) - lost) / scale, lost / scale
