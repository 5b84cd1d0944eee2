"""Where the trials of a set are made: a robot, its sand, its logger, and their files.

On the bench all is as filed. A wild laboratory is drawn from a seed: another logger, and often another robot
or sand. A range is what data sheets, publications or trials of other programs show; none comes from what
the analysis can do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np

from granite_lab.errors import UsageError
from granite_lab.hidden.command import trapezoid
from granite_lab.hidden.contact import FLOOR, V_FLOOR, NearRest
from granite_lab.hidden.model import Setup, Truth
from granite_lab.hidden.parts import CompleteRobot, complete, exponential_k92
from granite_lab.hidden.random_numbers import factors, generator, magnitude, scaled
from granite_lab.hidden.sensors import Logger
from granite_lab.parameters import Robot, Soil, load_paper, load_soil
from granite_lab.parameters.quantity import table_of, toml_line

R = TypeVar("R", CompleteRobot, Soil)

LABS = ("bench", "wild")

SCATTER = {"frictional_modulus": 0.05, "cohesion": 0.05, "a_theta": 0.03}
"""Relative std from trial to trial on the bench, as raking leaves it; an assumption."""

FASTEST = 0.7, 2.4, 3.0
"""Variant of Table 2 that loads sand and drive most: velocity, acceleration, distance."""

MOST_SLIP, DEEPEST = 0.35, 0.22
"""Slip ratio in the fastest variant and sinkage over radius at rest of a robot that can be measured at all:
Table 3 ends at 0.23, and the paper's robot sinks by 0.14."""

PUBLISHED = ("dry_sand_lll", "lete_sand", "hit_simulant", "regolith_simulant")
"""Sands of the catalogue other than Table 1's, dry and loose."""

OFF = {
    "friction_angle": 0.04, "shear_modulus": 0.20, "exponent": 0.05, "tyre_friction": 0.05,
    "frictional_modulus": 0.15, "cohesion": 0.20,
}  # fmt: skip
"""Relative std of the sand about its file. φ: half of the 5-11 % that Phoon and Kulhawy (Canadian
Geotechnical Journal 36, 1999, 612-624) find in sand of one site. K: 10 to 25 mm are published for dry sand.
Moduli and cohesion: at the low pressure of light robots sand departs from the Mohr-Coulomb line that tests
at higher pressure give (Senatore and Iagnemma, ISTVS 2011); how far is assumed."""


@dataclass(frozen=True)
class Filed(Generic[R]):
    """A robot or a sand.

    Attributes:
        name: of the file that the trials name; ending in .toml where it lies beside them.
        filed: the record in that file.
        real: the robot or, on the average of the trials, the sand as it is.
    """

    name: str
    filed: R
    real: R


@dataclass(frozen=True)
class Lab:
    """Robot, sand and logger of a set.

    Attributes:
        name: one of `LABS`.
        robot, soil: filed and real.
        a_theta: of (5) on the average of the trials [s/m].
        scatter: relative std of k_φ, c and a_θ from trial to trial.
        repetitions: of each variant; 0: as asked for, else 3.
        logger: what the logger adds to the errors that the robot's record states.
        radius: relative std of each wheel's radius in each trial.
        rolls: True where the wheels have these radii; False where all radii are equal and the logged angles
            are wrong by the same factors.
        before, after: least and most of the standstills [s].
        near_rest: how the forces and the drive go on near rest.
    """

    name: str
    robot: Filed[CompleteRobot]
    soil: Filed[Soil]
    a_theta: float
    scatter: Mapping[str, float] = field(default_factory=lambda: SCATTER)
    repetitions: int = 0
    logger: Logger = field(default_factory=Logger)
    radius: float = 0.0
    rolls: bool = True
    before: tuple[float, float] = (1.5, 2.5)
    after: tuple[float, float] = (3.0, 3.5)
    near_rest: NearRest = FLOOR

    def files(self) -> dict[str, str]:
        """Return the TOML files that lie beside the trials: what the laboratory knows of robot and sand."""
        return {
            x.name: toml_of(table_of(x.filed)) for x in (self.robot, self.soil) if x.name.endswith(".toml")
        }


def bench(robot: CompleteRobot, soil: Soil) -> Lab:
    """Return the laboratory in which robot, sand and sensors are as their files say."""
    return Lab("bench", Filed(robot.name, robot, robot), Filed(soil.name, soil, soil), load_paper().a_theta)


def toml_of(table: Mapping[str, Any], above: str = "") -> str:
    """Return a table, as `table_of` makes it of a robot or a soil, as TOML."""
    inside = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    lines = [f"{toml_line(k, v)}\n" for k, v in table.items() if k not in inside and v != []]
    tables = [f"\n[{above}{key}]\n{toml_of(value, f'{above}{key}.')}" for key, value in inside.items()]
    return "".join(lines + tables)


def lab_of(name: str, seed: int, robot: Robot, soil: Soil) -> Lab:
    """Return a laboratory by name.

    Raises:
        UsageError: there is none of that name, or the robot cannot be simulated.
    """
    if name not in LABS:
        raise UsageError(f"unknown laboratory '{name}'", f"known: {', '.join(LABS)}")
    whole = complete(robot)
    return bench(whole, soil) if name == "bench" else wild(seed, whole, soil)


def wild(seed: int, robot: CompleteRobot, soil: Soil) -> Lab:
    """Return the laboratory of a seed: half of them have the given robot, two fifths the given sand."""
    for attempt in range(200):
        lab = _drawn(generator(seed, 5, attempt), robot, soil)
        if drives(lab):
            return lab
    raise UsageError(f"robot '{robot.name}' cannot drive on any of the sands", "give another robot")


def drives(lab: Lab) -> bool:
    """Tell whether the robot stands and drives the fastest variant without digging itself in."""
    setup = Setup(lab.robot.real, lab.soil.real, exponential_k92(lab.a_theta), intervals=24)
    truth = Truth(setup, trapezoid(*FASTEST))
    try:
        with np.errstate(all="ignore"):
            sunk = truth.contact(-1.0, truth.rest()).sinkage.max()
            _, slip = truth.cruise()
    except (RuntimeError, ValueError):
        return False
    return bool(sunk < DEEPEST * truth.r and 0.0 < slip < MOST_SLIP)


def _drawn(rng: np.random.Generator, robot: CompleteRobot, soil: Soil) -> Lab:
    """Draw robot, sand, sensors, and what is left, in this order."""
    filed = robot if rng.random() < 0.5 else other_robot(rng, robot)
    sand = soil if rng.random() < 0.4 else load_soil(PUBLISHED[int(rng.integers(len(PUBLISHED)))])
    factors_off = factors(rng, OFF)
    real = _with_sensors(rng, filed)
    # about the 8, 5 and 3 % of the trials by another program
    scatter = {
        "frictional_modulus": rng.uniform(0.04, 0.10),
        "cohesion": rng.uniform(0.03, 0.07),
        "a_theta": rng.uniform(0.02, 0.05),
    }
    # What (1), (11) do below 2 to 3 cm/s is open; a gear locks itself, or the controller stays on.
    near_rest = NearRest(
        law="parabola",
        speed=rng.uniform(V_FLOOR, 0.03),
        holds_below=magnitude(rng, 5e-4, 2.5e-3) if rng.random() < 0.5 else 0.0,
    )
    before, after = rng.uniform(0.7, 3.5), rng.uniform(0.7, 3.5)
    a_theta = rng.uniform(4.4, 5.4)  # the paper's 4.919 and 10 %: these wheels on other sand are not known
    repetitions = int(rng.integers(2, 5))
    # An IMU's low-pass delays by 1.9 ms at 188 Hz and by 4.8 ms at 42 Hz (MPU-6050, register map);
    # a serial line adds 1-3 ms.
    late = rng.uniform(0.0, 0.008)
    jitter = magnitude(rng, 5e-5, 5e-4)
    gain = magnitude(rng, 5e-4, 5e-3)  # 0.05 to 0.5 %: calibrated units; BMI088 states 0.8 % at most
    # tyre under load and sand that sticks to it: 0.05-0.4 %, as in the trials of another program;
    # Borenstein and Feng (1996): tenths of a percent at best
    radius = magnitude(rng, 5e-4, 4e-3)
    rolls = rng.random() < 0.5
    return Lab(
        name="wild",
        robot=Filed(robot.name, robot, real)
        if filed is robot
        else Filed("robot.toml", _at_rates(filed, real), real),
        soil=Filed(sand.name if sand is soil else "soil.toml", sand, scaled(sand, factors_off)),
        a_theta=a_theta,
        scatter=scatter,
        repetitions=repetitions,
        logger=Logger(late, jitter, gain, ripple=rng.uniform(0.0, 0.02)),
        radius=radius,
        rolls=rolls,
        before=(before, before + 0.5),
        after=(after, after + 0.5),
        near_rest=near_rest,
    )


def _with_sensors(rng: np.random.Generator, filed: CompleteRobot) -> CompleteRobot:
    """Draw the sensors of a robot: their rates, their errors and where the IMU sits."""
    # Rates that makers offer (Xsens MTi 100-400, VectorNav VN-100 up to 400, Analog Devices ADIS16460 and
    # TDK ICM-20948 dividers; motor controllers on CAN at 50-200).
    imu_rate, wheel_rate = float(rng.choice((100, 125, 200, 250, 400))), float(rng.choice((50, 100, 200)))
    current_rate = wheel_rate if rng.random() < 0.6 else float(rng.choice((50, 100, 200)))
    noise = magnitude(rng, 1.0, 3.0)  # 100 to 300 µg/√Hz, 0.003 to 0.01 °/s/√Hz: the catalogue's two grades
    return replace(
        filed,
        imu_grade=replace(
            filed.imu_grade,
            rate=imu_rate,
            accel_noise=0.00098 * noise,
            gyro_noise=5.2e-5 * noise * magnitude(rng, 0.7, 1.4),
            # what a calibration leaves of the 20 mg and 1 °/s that makers state for bare chips (BMI088)
            accel_bias=magnitude(rng, 0.02, 0.08),
            gyro_bias=magnitude(rng, 0.0017, 0.005),
            accel_instability=2e-4 * magnitude(rng, 1.0, 4.0),
            gyro_instability=1.5e-5 * magnitude(rng, 1.0, 3.0),
        ),
        imu=replace(
            filed.imu,
            # a ruler's and a bracket's error: 1 cm, as in the trials of another program
            x=filed.imu.x + 0.01 * rng.standard_normal(),
            z=filed.imu.z + 0.01 * rng.standard_normal(),
            tilt=rng.uniform(0.2, 1.2),  # brackets and cases align to 0.2-2°; new in each trial
            vibration=magnitude(rng, 0.08, 0.8),  # the catalogue: 0.25 on this robot, 0.5 to 3 on others
            vibration_rate=0.005 * magnitude(rng, 0.4, 2.5),
            vibration_frequency=magnitude(rng, 12.0, 45.0),
        ),
        encoders=replace(filed.encoders, rate=wheel_rate, jitter=magnitude(rng, 2e-5, 4e-4)),
        currents=replace(
            filed.currents,
            rate=current_rate,
            noise=magnitude(rng, 0.03, 0.15),  # tens of mA: Hall sensors (Allegro ACS712)
            offset=magnitude(rng, 0.02, 0.1),
            gain=rng.uniform(0.01, 0.04),  # ACS712: 1.5 % at 25 °C, more as it warms; per sensor and trial
            step=float(rng.choice((0.005, 0.01, 0.02))),
        ),
    )


def _at_rates(filed: CompleteRobot, real: CompleteRobot) -> CompleteRobot:
    """Return a robot of the catalogue with the sensor rates of the real robot, which its laboratory knows."""
    return replace(
        filed,
        encoders=replace(filed.encoders, rate=real.encoders.rate),
        currents=replace(filed.currents, rate=real.currents.rate),
        imu_grade=replace(filed.imu_grade, rate=real.imu_grade.rate),
    )


def other_robot(rng: np.random.Generator, robot: CompleteRobot) -> CompleteRobot:
    """Return a robot of other radius, width, lengths and mass.

    Masses follow the measures so that the pressure under the wheels stays in the range in which (8) was
    measured. The gear grows with the radius, so that top speed stays and motors keep their currents;
    inertias, damping and gains keep the time constants.
    """
    ch, d = robot.chassis, robot.drive
    r = magnitude(rng, 0.5, 2.0)
    width, length = (float(np.clip(r * np.exp(rng.uniform(-0.25, 0.25)), 0.5, 2.0)) for _ in range(2))
    mass = float(np.clip(r**2.2 * np.exp(rng.uniform(-0.4, 0.1)), 0.5, 2.0))
    chassis = replace(
        ch,
        wheel_base=ch.wheel_base * length, track=ch.track * length,
        body_mass=ch.body_mass * mass, wheel_mass=ch.wheel_mass * mass,
        com_x=ch.com_x * length, com_z=ch.com_z * length,
        wheel_inertia=ch.wheel_inertia * mass * r**2, pitch_inertia=ch.pitch_inertia * mass * length**2,
        contact_damping=ch.contact_damping * mass, tyre_stiffness=ch.tyre_stiffness * mass,
    )  # fmt: skip
    motor = float(np.sqrt(mass))  # a larger motor: stiffer constants, less resistance
    drive = replace(
        d,
        gear_ratio=d.gear_ratio * r / motor,
        torque_constant=d.torque_constant * motor, emf_constant=d.emf_constant * motor,
        resistance=d.resistance / mass, inductance=d.inductance / mass,
        gain_p=d.gain_p * r, gain_d=d.gain_d * r,
    )  # fmt: skip
    counts = robot.encoders.counts * r / motor
    return replace(
        robot,
        name="robot",
        title="Four driven wheels, other measures",
        source="drawn",
        wheels=replace(robot.wheels, radius=robot.wheels.radius * r, width=robot.wheels.width * width),
        chassis=chassis,
        drive=drive,
        imu=replace(robot.imu, x=robot.imu.x * length, z=robot.imu.z * length),
        encoders=replace(robot.encoders, counts=float(round(counts))),
    )
