"""Robots, soils, variants and sensor grades as frozen records; units and bounds in the metadata.

Fields that the paper names carry its symbol. SI units inside; the TOML key of a field is its
name with the unit behind it (`wheel_base_m`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from granite_lab.parameters.quantity import quantity

WHEELS = ("fl", "fr", "rl", "rr")
"""The order of the wheels everywhere: front left, front right, rear left, rear right."""

GRAVITY = 9.81
"""Acceleration of gravity g [m/s^2] (paper, section 4)."""


@dataclass(frozen=True, kw_only=True)
class Wheels:
    """The wheels; all that estimation needs to know of the running gear."""

    radius: float = quantity("m", 0.01, 1.0, "wheel radius", "r")
    width: float = quantity("m", 0.005, 1.0, "width of the tyre tread (both tyres of a dual)", "b", 0.1)
    lugs: float = quantity("", 0, 200, "tread lugs on the circumference", "", 24.0)
    radius_std: float = quantity("m", 0, 0.1, "std of the wheel radius (0: not stated)", "", 0.0)
    radii_m: tuple[float, ...] = field(
        default=(),
        metadata={
            "meaning": "radius of each wheel [m], front left, front right, rear left, rear right",
            "length": 4, "low": 0.01, "high": 1.0,
        },
    )  # fmt: skip

    @property
    def uneven(self) -> float:
        """Largest difference of a wheel from the radius r, over r."""
        return max((abs(r / self.radius - 1) for r in self.radii_m), default=0.0)


@dataclass(frozen=True, kw_only=True)
class Chassis:
    """Masses and dimensions of the multi-body model (17)-(23)."""

    wheel_base: float = quantity("m", 0.05, 5.0, "distance between the axles", "L")
    track: float = quantity("m", 0.05, 5.0, "distance between left and right wheels", "W")
    body_mass: float = quantity("kg", 0.1, 2000, "mass of the body without wheels", "m_0")
    wheel_mass: float = quantity("kg", 0.0, 100, "mass of one wheel", "m_i")
    com_x: float = quantity("m", -2.0, 2.0, "centre of mass, forward of the middle between the axles", "x_CM")
    com_z: float = quantity("m", -1.0, 2.0, "centre of mass, above the wheel centres", "z_CM")
    wheel_inertia: float = quantity("kg m^2", 1e-5, 50, "moment of inertia of a wheel about its spin", "I_Wy")
    pitch_inertia: float = quantity("kg m^2", 1e-3, 1000, "moment of inertia in pitch", "I_Ry")
    contact_damping: float = quantity("N s/m", 0.0, 1e5, "damping of the tyre-ground system", "c_t")
    tyre_stiffness: float = quantity(
        "N/m", 1e3, 1e8, "radial stiffness of the tyre, unused in (1)-(26)", "k_r"
    )

    @property
    def total_mass(self) -> float:
        """m_R [kg], the body and four wheels."""
        return self.body_mass + 4 * self.wheel_mass


@dataclass(frozen=True, kw_only=True)
class Drive:
    """DC motor and gear (24) and the wheel controller (26)."""

    inductance: float = quantity("H", 1e-6, 1.0, "inductance of the rotor", "L_d")
    resistance: float = quantity("ohm", 1e-3, 100, "resistance of the rotor", "R_d")
    emf_constant: float = quantity("V s/rad", 1e-4, 10, "electromotive force constant", "k_e")
    torque_constant: float = quantity("N m/A", 1e-4, 10, "torque constant", "k_m")
    gear_ratio: float = quantity("", 1, 1000, "gear ratio", "n_d")
    gear_efficiency: float = quantity("", 0.05, 1.0, "efficiency of the gear", "η_d")
    voltage_max: float = quantity("V", 1, 1000, "largest motor voltage", "u_max")
    voltage_min: float = quantity("V", -1000, 0, "smallest motor voltage", "u_min", 0.0)
    gain_p: float = quantity("V/rad", 0, 1e4, "controller gain on the wheel angle", "k_P")
    gain_d: float = quantity("V s/rad", 0, 1e4, "controller gain on the wheel speed", "k_D")


@dataclass(frozen=True, kw_only=True)
class ImuGrade:
    """How good an inertial measurement unit is (per axis unless said otherwise)."""

    rate: float = quantity("Hz", 5, 10000, "samples a second")
    accel_noise: float = quantity("m/s^2/sqrt(Hz)", 0, 1, "white noise density of the accelerometer")
    gyro_noise: float = quantity("rad/s/sqrt(Hz)", 0, 1, "white noise density of the gyroscope")
    accel_bias: float = quantity("m/s^2", 0, 5, "std of the accelerometer's turn-on bias")
    gyro_bias: float = quantity("rad/s", 0, 1, "std of the gyroscope's turn-on bias")
    accel_instability: float = quantity("m/s^2", 0, 1, "bias instability of the accelerometer (std, slow)")
    gyro_instability: float = quantity("rad/s", 0, 1, "bias instability of the gyroscope (std, slow)")
    instability_time: float = quantity("s", 1, 1e5, "correlation time of the bias instability", default=100.0)
    accel_scale: float = quantity("", 0, 0.1, "std of the accelerometer's scale error", default=0.002)
    gyro_scale: float = quantity("", 0, 0.1, "std of the gyroscope's scale error", default=0.02)
    accel_range: float = quantity("m/s^2", 1, 10000, "largest acceleration that can be read", default=157.0)
    gyro_range: float = quantity("rad/s", 0.1, 1000, "largest rate that can be read", default=34.9)
    accel_step: float = quantity("m/s^2", 0, 1, "resolution of the accelerometer", default=0.0)
    gyro_step: float = quantity("rad/s", 0, 1, "resolution of the gyroscope", default=0.0)


@dataclass(frozen=True, kw_only=True)
class Imu:
    """Where the inertial measurement unit sits and what shakes it."""

    grade: str = "industrial"
    x: float = quantity("m", -5, 5, "position forward of R", default=0.0)
    z: float = quantity("m", -5, 5, "position above R", default=0.0)
    rotation: tuple[float, ...] = field(
        default=(0.0, 0.0, 0.0),
        metadata={"length": 3, "meaning": "roll, pitch, yaw [deg]: v_robot = Rz Ry Rx v_sensor"},
    )
    forward: str = field(
        default="given",
        metadata={
            "choices": ("given", "find"),
            "meaning": "is the rotation given, or to be found from standstill and the acceleration phases?",
        },
    )
    tilt: float = quantity("deg", 0, 20, "std of the unknown mounting tilt", default=0.3)
    vibration: float = quantity("m/s^2", 0, 50, "rms of the frame's vibration at 0.5 m/s", default=0.0)
    vibration_rate: float = quantity(
        "rad/s", 0, 5, "rms of the frame's pitch vibration at 0.5 m/s", default=0.0
    )
    vibration_frequency: float = quantity("Hz", 0.5, 500, "where the vibration is loudest", default=25.0)


@dataclass(frozen=True, kw_only=True)
class Encoders:
    """Wheel encoders, behind the gear unless the counts say otherwise."""

    rate: float = quantity("Hz", 0.5, 10000, "samples a second", default=100.0)
    counts: float = quantity("1/rev", 0, 1e9, "counts per wheel revolution (0: not known)", default=0.0)
    jitter: float = quantity("s", 0, 0.1, "std of the time stamps", default=0.0)


@dataclass(frozen=True, kw_only=True)
class Currents:
    """Motor current sensors."""

    rate: float = quantity("Hz", 0.5, 10000, "samples a second", default=100.0)
    noise: float = quantity("A", 0, 10, "std of the noise", default=0.05)
    offset: float = quantity("A", 0, 10, "std of the offset", default=0.05)
    gain: float = quantity("", 0, 0.5, "std of the gain error", default=0.01)
    step: float = quantity("A", 0, 1, "resolution", default=0.01)


@dataclass(frozen=True, kw_only=True)
class Tow:
    """A load that the robot tows: it pulls back along the ground while it is driven, and is slack at rest."""

    force: float = quantity("N", 0, 1e4, "towing force")
    height: float = quantity("m", -2.0, 2.0, "where it pulls, above the wheel centres", default=0.0)


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A robot: what a log of it needs for estimation, and, with chassis and drive, for simulation."""

    name: str
    title: str
    wheels: Wheels
    source: str = ""
    chassis: Chassis | None = None
    drive: Drive | None = None
    imu: Imu = Imu()
    encoders: Encoders = Encoders()
    currents: Currents = Currents()
    tow: Tow | None = None
    motors: str = field(
        default="wheel",
        metadata={
            "choices": ("wheel", "side"),
            "meaning": "does a motor drive one wheel, or those of a side?",
        },
    )
    imu_grade: ImuGrade


@dataclass(frozen=True, kw_only=True)
class Soil:
    """Pressure-sinkage and shear parameters of a soil (Table 1)."""

    name: str
    title: str
    exponent: float = quantity("", 0.1, 3.0, "exponent of deformation", "n")
    cohesive_modulus: float = quantity("Pa/m^(n-1)", 0, 1e7, "cohesive modulus of deformation", "k_c")
    frictional_modulus: float = quantity("Pa/m^n", 1e3, 1e9, "frictional modulus of deformation", "k_φ")
    cohesion: float = quantity("Pa", 0, 1e6, "cohesion", "c")
    friction_angle: float = quantity("deg", 5, 60, "angle of internal friction", "φ")
    shear_modulus: float = quantity("m", 1e-4, 0.5, "shear deformation parameter", "K")
    tyre_friction: float = quantity("", 0.05, 2.0, "static friction between tyre and soil", "μ_s")
    exponent_std: float = quantity("", 0, 1, "std of n (0: not stated, as for all below)", "", 0.0)
    frictional_modulus_std: float = quantity("Pa/m^n", 0, 1e9, "std of k_φ", "", 0.0)
    cohesion_std: float = quantity("Pa", 0, 1e6, "std of c", "", 0.0)
    friction_angle_std: float = quantity("deg", 0, 30, "std of φ", "", 0.0)
    shear_modulus_std: float = quantity("m", 0, 0.5, "std of K", "", 0.0)
    tyre_friction_std: float = quantity("", 0, 1, "std of μ_s", "", 0.0)
    slip: float = quantity("", 0.0, 0.5, "slip ratio expected of steady driving", "", 0.025)
    slip_std: float = quantity("", 0.001, 1.0, "its std, 1 where any slip is possible", "", 1.0)
    source: str = ""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One variant of motion (Table 2): a trapezoid of the desired velocity."""

    velocity: float = quantity("m/s", 0.01, 5.0, "desired velocity of the steady part", "v_Ru")
    acceleration: float = quantity("m/s^2", 0.01, 50, "largest acceleration and deceleration", "a_Rmax")
    distance: float = quantity("m", 0.05, 10000, "total distance", "L_p")


def by_speed(velocities: Iterable[float]) -> dict[float, tuple[int, ...]]:
    """Group commands by their desired velocity [m/s].

    Velocities that print alike, with three significant digits, are one speed, whatever other trials there
    are. Wherever trials are grouped by speed it is done here, so that tables, figures, recordings, answers,
    fits and searches have the same groups.

    Returns:
        each speed as printed [m/s], slowest first, and the positions of its commands.
    """
    groups: dict[float, list[int]] = {}
    for position, velocity in enumerate(velocities):
        groups.setdefault(float(f"{velocity:.3g}"), []).append(position)
    return {speed: tuple(groups[speed]) for speed in sorted(groups)}


@dataclass(frozen=True, kw_only=True)
class Published:
    """One column of Table 3: slip ratios as fractions, and the k_92 used for the simulation."""

    velocity: float = quantity("m/s", 0.01, 5.0, "desired velocity", "v_Ru")
    slip_simulated: float = quantity("", -1, 1, "simulated slip ratio of the robot", "λ_R")
    slip_measured: float = quantity("", -1, 1, "measured slip ratio of the robot", "λ_R")
    k92: float = quantity("", 0, 2, "ratio of the rear to the front contact angle", "k_92")


@dataclass(frozen=True, kw_only=True)
class Paper:
    """The figures of the paper that results are compared with."""

    a_theta: float = quantity("", 0, 100, "exponent of (27) [s/m]", "a_θ")
    fig4_intercept: float = quantity("", -5, 5, "k_92 at zero slip in Fig. 4", "b_0")
    fig4_slope: float = quantity("", -100, 100, "slope of Fig. 4 per unit of slip ratio", "b_1")
    table3: tuple[Published, ...] = ()
