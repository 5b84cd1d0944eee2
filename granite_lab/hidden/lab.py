"""Where the trials of a set are made: a robot, its sand, its logger, and what their files say of them.

On the bench all is as filed. A wild laboratory is drawn from a seed: another logger, and often another robot
or sand. A range is what data sheets, publications or trials of other programs show; none comes from what
the analysis can do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np

from granite_lab.errors import UsageError
from granite_lab.hidden.contact import FLOOR, V_FLOOR, NearRest
from granite_lab.hidden.model import Truth
from granite_lab.hidden.parts import Trapezoid, exponential_k92
from granite_lab.parameters import Robot, Soil, load_paper
from granite_lab.parameters.quantity import key_of, toml_line

LABS = ("bench", "wild")

SCATTER = {"frictional_modulus": 0.05, "cohesion": 0.05, "a_theta": 0.03}
"""Relative std from trial to trial on the bench, as raking leaves it; an assumption."""

FASTEST = 0.7, 2.4, 3.0
"""Variant of Table 2 that asks most of sand and drive: velocity, acceleration, distance."""

MOST_SLIP, DEEPEST = 0.35, 0.22
"""Slip ratio in the fastest variant and sinkage over radius at rest of a robot that can be measured at all:
Table 3 ends at 0.23, and the paper's robot sinks by 0.14."""

PUBLISHED = (
    Soil(
        name="dry_sand_lll", title="Dry sand, Land Locomotion Laboratory",
        source="Wong, Theory of Ground Vehicles, 4th ed., Wiley 2008, table 2.3; K as in Table 1",
        exponent=1.1, cohesive_modulus=0.99e3, frictional_modulus=1528.43e3, cohesion=1040.0,
        friction_angle=28.0, shear_modulus=0.025, tyre_friction=0.55,
    ),
    Soil(
        name="lete_sand", title="LETE sand",
        source="Wong, Terramechanics and Off-Road Vehicle Engineering, 2nd ed., Elsevier 2010 (bevameter)",
        exponent=0.79, cohesive_modulus=102e3, frictional_modulus=5301e3, cohesion=1300.0,
        friction_angle=31.1, shear_modulus=0.012, tyre_friction=0.63,
    ),
    Soil(
        name="hit_simulant", title="Planetary soil simulant of HIT",
        source="Ding et al., Journal of Terramechanics 48, 2011, 27-45",
        exponent=1.1, cohesive_modulus=15.6e3, frictional_modulus=2407.4e3, cohesion=250.0,
        friction_angle=31.9, shear_modulus=0.0114, tyre_friction=0.65,
    ),
    Soil(
        name="regolith_simulant", title="Lunar regolith simulant",
        source="Ishigami et al., Journal of Field Robotics 24, 2007, 233-250; K at no slip angle",
        exponent=1.0, cohesive_modulus=1.37e3, frictional_modulus=814e3, cohesion=800.0,
        friction_angle=37.2, shear_modulus=0.036, tyre_friction=0.79,
    ),
)  # fmt: skip
"""Sands other than Table 1's, dry and loose; μ_s is 1.04 tan φ as there."""

OFF = {
    "friction_angle": 0.04, "shear_modulus": 0.20, "exponent": 0.05, "tyre_friction": 0.05,
    "frictional_modulus": 0.15, "cohesion": 0.20,
}  # fmt: skip
"""Relative std of the sand about its file. φ: half of the 5-11 % that Phoon and Kulhawy (Canadian
Geotechnical Journal 36, 1999, 612-624) find in sand of one site. K: 10 to 25 mm are published for dry sand.
Moduli and cohesion: at the low pressure of light robots sand departs from the Mohr-Coulomb line that tests
at higher pressure give (Senatore and Iagnemma, ISTVS 2011); how far is assumed."""


@dataclass(frozen=True)
class Lab:
    """Robot, sand and logger of a set.

    Attributes:
        name: one of `LABS`.
        filed, robot: the robot as its file has it, and as it is, sensors included.
        filed_soil, soil: the same of the sand, on the average of the trials.
        robot_name, soil_name: what the trials call the files; ending in .toml where they lie beside them.
        a_theta: of (5) on the average of the trials [s/m].
        scatter: relative std of k_φ, c and a_θ from trial to trial.
        repetitions: of each variant; 0 leaves it to who asks.
        late: of the IMU's stamps behind the instants they stand for [s]; stamped_at_end: they are given
            at the end of the interval over which a sample is the mean.
        imu_jitter: std of the IMU's stamps [s].
        imu_gain: std of the scale of each axis in each trial.
        radius: relative std of each wheel's radius in each trial.
        rolls: the wheels roll by these radii, and angles are logged as they are; otherwise the wheels are
            alike and the logger counts their angles by these factors.
        ripple: relative std of the currents' fluctuation while the wheels turn.
        before, after: least and most of the standstills [s].
        near_rest: how the forces and the drive go on near rest.
        drawn: what of all this was drawn, for the answer.
    """

    name: str
    filed: Robot
    robot: Robot
    filed_soil: Soil
    soil: Soil
    robot_name: str
    soil_name: str
    a_theta: float
    scatter: Mapping[str, float] = field(default_factory=lambda: SCATTER)
    repetitions: int = 0
    late: float = 0.0
    stamped_at_end: bool = False
    imu_jitter: float = 1e-4
    imu_gain: float = 5e-4
    radius: float = 0.0
    rolls: bool = True
    ripple: float = 0.01
    before: tuple[float, float] = (1.5, 2.5)
    after: tuple[float, float] = (3.0, 3.5)
    near_rest: NearRest = FLOOR
    drawn: Mapping[str, Any] = field(default_factory=dict)

    @property
    def imu_late(self) -> float:
        """By how much the IMU's stamps come after the middle of what they stand for [s]."""
        grade = self.robot.imu_grade
        return self.late + 0.5 / grade.rate if self.stamped_at_end and grade is not None else 0.0

    def files(self) -> dict[str, str]:
        """Return the TOML files that lie beside the trials: what the laboratory knows of robot and sand."""
        records = {self.robot_name: self.filed, self.soil_name: self.filed_soil}
        return {name: toml_of(record) for name, record in records.items() if name.endswith(".toml")}


def bench(robot: Robot, soil: Soil) -> Lab:
    """Return the laboratory in which robot, sand and sensors are as their files say."""
    return Lab("bench", robot, robot, soil, soil, robot.name, soil.name, load_paper().a_theta)


def toml_of(record: Any, table: str = "") -> str:
    """Return a record of robot or soil as the TOML that reads back as the same."""
    lines, tables = [], []
    for each in fields(record):
        value, key = getattr(record, each.name), key_of(each)
        if is_dataclass(value):
            name = f"{table}.{key}" if table else key
            tables.append(f"\n[{name}]\n{toml_of(value, name)}")
        elif value is not None:
            lines.append(f"{toml_line(key, value)}\n")
    return "".join(lines + tables)


def lab_of(name: str, seed: int, robot: Robot, soil: Soil) -> Lab:
    """Return a laboratory by name.

    Raises:
        UsageError: there is none of that name, or the robot cannot be simulated.
    """
    if name not in LABS:
        raise UsageError(f"unknown laboratory '{name}'", f"known: {', '.join(LABS)}")
    if robot.chassis is None or robot.drive is None or robot.imu_grade is None:
        raise UsageError(f"robot '{robot.name}' cannot be simulated", "give one with chassis, drive and IMU")
    return bench(robot, soil) if name == "bench" else wild(seed, robot, soil)


def wild(seed: int, robot: Robot, soil: Soil) -> Lab:
    """Return the laboratory of a seed: half of them have the given robot, two fifths the given sand."""
    for attempt in range(200):
        rng = np.random.default_rng([seed, 5, attempt])
        lab = _draw(rng, robot, soil)
        if drives(lab):
            return lab
    raise UsageError(f"robot '{robot.name}' cannot drive on any of the sands", "give another robot")


def drives(lab: Lab) -> bool:
    """Tell whether the robot stands and drives the fastest variant without digging itself in."""
    truth = Truth(lab.robot, lab.soil, Trapezoid(*FASTEST), exponential_k92(lab.a_theta), 24)
    try:
        with np.errstate(all="ignore"):
            sunk = truth.contact(-1.0, truth.rest()).sinkage.max()
            _, slip = truth.cruise()
    except (RuntimeError, ValueError):
        return False
    return bool(sunk < DEEPEST * truth.r and 0.0 < slip < MOST_SLIP)


def _draw(rng: np.random.Generator, robot: Robot, soil: Soil) -> Lab:
    filed, size = (robot, {}) if rng.random() < 0.5 else other_robot(rng, robot)
    own_soil = soil if rng.random() < 0.4 else PUBLISHED[int(rng.integers(len(PUBLISHED)))]
    off = {name: float(np.exp(std * rng.standard_normal())) for name, std in OFF.items()}
    there = replace(own_soil, **{name: getattr(own_soil, name) * factor for name, factor in off.items()})
    assert filed.imu_grade is not None

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def spread(low: float, high: float) -> float:
        """Draw between two magnitudes, each power of ten as likely."""
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def one_of(*values: float) -> float:
        return float(rng.choice(values))

    # Rates that makers offer (Xsens MTi 100-400, VectorNav VN-100 up to 400, Analog Devices ADIS16460 and
    # TDK ICM-20948 dividers; motor controllers on CAN at 50-200).
    imu_rate, wheel_rate = one_of(100, 125, 200, 250, 400), one_of(50, 100, 200)
    current_rate = wheel_rate if rng.random() < 0.6 else one_of(50, 100, 200)
    noise = spread(1.0, 3.0)  # 100 to 300 µg/√Hz, 0.003 to 0.01 °/s/√Hz: the catalogue's two grades
    grade = replace(
        filed.imu_grade,
        rate=imu_rate,
        accel_noise=0.00098 * noise,
        gyro_noise=5.2e-5 * noise * spread(0.7, 1.4),
        # what a calibration leaves of the 20 mg and 1 °/s that makers state for bare chips (BMI088)
        accel_bias=spread(0.02, 0.08),
        gyro_bias=spread(0.0017, 0.005),
        accel_instability=2e-4 * spread(1.0, 4.0),
        gyro_instability=1.5e-5 * spread(1.0, 3.0),
    )
    imu = replace(
        filed.imu,
        # a ruler's and a bracket's error: 1 cm, as in the trials of another program
        x=filed.imu.x + 0.01 * float(rng.standard_normal()),
        z=filed.imu.z + 0.01 * float(rng.standard_normal()),
        tilt=between(0.2, 1.2),  # brackets and cases align to 0.2-2°; new in each trial
        vibration=spread(0.08, 0.8),  # files of the catalogue: 0.25 on this robot, 0.5 to 3 on others
        vibration_rate=0.005 * spread(0.4, 2.5),
        vibration_frequency=spread(12.0, 45.0),
    )
    encoders = replace(filed.encoders, rate=wheel_rate, jitter=spread(2e-5, 4e-4))
    currents = replace(
        filed.currents,
        rate=current_rate,
        noise=spread(0.03, 0.15),  # tens of mA: Hall sensors (Allegro ACS712)
        offset=spread(0.02, 0.1),
        gain=between(0.01, 0.04),  # ACS712: 1.5 % at 25 °C, more as it warms; per sensor and trial
        step=one_of(0.005, 0.01, 0.02),
    )
    # about the 8, 5 and 3 % of the trials by another program
    scatter = {
        "frictional_modulus": between(0.04, 0.10),
        "cohesion": between(0.03, 0.07),
        "a_theta": between(0.02, 0.05),
    }
    # What (1), (11) do below 2 to 3 cm/s is open; a gear locks itself, or the controller stays on.
    near_rest = NearRest(
        law="parabola",
        speed=between(V_FLOOR, 0.03),
        holds_below=spread(5e-4, 2.5e-3) if rng.random() < 0.5 else 0.0,
    )
    before, after = between(0.7, 3.5), between(0.7, 3.5)
    # An IMU's low-pass delays by 1.9 ms at 188 Hz and by 4.8 ms at 42 Hz (MPU-6050, register map);
    # a serial line adds 1-3 ms.
    lab = Lab(
        name="wild",
        filed=filed if not size else replace(filed, encoders=replace(filed.encoders, rate=wheel_rate),
                                             currents=replace(filed.currents, rate=current_rate),
                                             imu_grade=replace(filed.imu_grade, rate=imu_rate)),
        robot=replace(filed, imu=imu, encoders=encoders, currents=currents, imu_grade=grade),
        filed_soil=own_soil,
        soil=there,
        robot_name="robot.toml" if size else filed.name,
        soil_name=own_soil.name if own_soil is soil else "soil.toml",
        a_theta=between(4.4, 5.4),  # the paper's 4.919 and 10 %: the same wheels on other sand are not known
        scatter=scatter,
        repetitions=int(rng.integers(2, 5)),
        late=between(0.0, 0.008),
        stamped_at_end=True,
        imu_jitter=spread(5e-5, 5e-4),
        imu_gain=spread(5e-4, 5e-3),  # 0.05 to 0.5 %: calibrated units; BMI088 states 0.8 % at most
        # tyre under load and sand that sticks to it: 0.05-0.4 %, as in the trials of another program;
        # Borenstein and Feng (1996): tenths of a percent at best
        radius=spread(5e-4, 4e-3),
        rolls=rng.random() < 0.5,
        ripple=between(0.0, 0.02),
        before=(before, before + 0.5),
        after=(after, after + 0.5),
        near_rest=near_rest,
    )  # fmt: skip
    return replace(lab, drawn=_told(lab, size, off))


def other_robot(rng: np.random.Generator, robot: Robot) -> tuple[Robot, dict[str, float]]:
    """Return a robot of other measures, and the factors on radius, width, lengths and mass.

    Masses follow the measures so that the pressure under the wheels stays in the range in which (8) was
    measured. The gear grows with the radius, so that top speed stays and motors keep their currents;
    inertias, damping and gains keep the time constants.
    """
    ch, d = robot.chassis, robot.drive
    assert ch is not None
    assert d is not None
    r = float(np.exp(rng.uniform(np.log(0.5), np.log(2.0))))
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
    made = replace(
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
    return made, {"radius": r, "width": width, "length": length, "mass": mass}


def _told(lab: Lab, size: Mapping[str, float], off: Mapping[str, float]) -> dict[str, Any]:
    """Return what was drawn, for the sealed answer."""
    imu, filed, grade, wheels, currents = (
        lab.robot.imu, lab.filed.imu, lab.robot.imu_grade, lab.robot.encoders, lab.robot.currents,
    )  # fmt: skip
    assert grade is not None
    return {
        "robot": dict(size) or lab.robot_name, "soil": lab.filed_soil.name, "sand_off": dict(off),
        "scatter": dict(lab.scatter), "a_theta": lab.a_theta, "repetitions": lab.repetitions,
        "imu": {
            "rate": grade.rate, "late": lab.late, "jitter": lab.imu_jitter, "gain": lab.imu_gain,
            "x_off": imu.x - filed.x, "z_off": imu.z - filed.z, "tilt": imu.tilt,
            "vibration": imu.vibration, "vibration_rate": imu.vibration_rate,
            "vibration_frequency": imu.vibration_frequency,
            "accel_noise": grade.accel_noise, "gyro_noise": grade.gyro_noise,
            "accel_bias": grade.accel_bias, "gyro_bias": grade.gyro_bias,
        },
        "wheels": {"rate": wheels.rate, "jitter": wheels.jitter, "radius": lab.radius,
                   "rolls": lab.rolls},
        "currents": {"rate": currents.rate, "noise": currents.noise, "offset": currents.offset,
                     "gain": currents.gain, "step": currents.step, "ripple": lab.ripple},
        "before": list(lab.before), "after": list(lab.after),
        "near_rest": {"speed": lab.near_rest.speed, "holds_below": lab.near_rest.holds_below},
    }  # fmt: skip
