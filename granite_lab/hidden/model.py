"""Equations (1)-(26) for the whole robot, in plain NumPy: the right-hand side of the truth.

Written from the paper and nothing else of the project; robot and soil numbers come from the
parameter records. The motion is formulated in the ground frame O about the centre of mass, which
is (20)-(22) rotated by (19). What the paper leaves out overrides one of the small methods of
`Truth`, calls `super()` and so can be combined with any other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy

from granite_lab.hidden.command import Command
from granite_lab.hidden.contact import (
    FLOOR,
    V_FLOOR,
    Array,
    Contact,
    Ground,
    NearRest,
    Stance,
    contact,
    smoothstep,
)  # fmt: skip
from granite_lab.hidden.parts import CompleteRobot, Law, Method, Misreading, Sizes
from granite_lab.parameters import GRAVITY, Soil

X, Z, PITCH, VX, VZ, Q = range(6)
ANGLE, OMEGA, CURRENT = slice(6, 8), slice(8, 10), slice(10, 12)
"""Places in the state: centre of mass in O, pitch, their rates; then front and rear wheel of each kind.

A state y is an array (n,), or (n, m) where there are m states at once. A value of the robot is then a number
or (m,), one of its wheels (2,) or (2, m); constants (2,) of the wheels meet the transpose of such values.
"""

LOCKING_RATE = 5e4
"""Rate at which a locked gear stops its wheel [1/s]: under the torques at hand it gives by 1 mm/s at most."""


FREE = np.zeros(2)
"""Gears that are not locked."""


@dataclass(frozen=True)
class Setup:
    """Robot, soil and laws of a trial.

    Attributes:
        robot, soil, law: what the paper's model needs, with `law` that of k_92.
        near_rest: how wheels and drive go on near rest.
        radii: (2,) true radius of front and rear wheels over the filed one.
        intervals: of the quadrature along the arc.
        controller: id of a controller other than (26), empty for (26); gains: its numbers.
    """

    robot: CompleteRobot
    soil: Soil
    law: Law
    near_rest: NearRest = FLOOR
    radii: tuple[float, float] = (1.0, 1.0)
    intervals: int = 32
    controller: str = ""
    gains: Mapping[str, float] = field(default_factory=dict)


class DigsInError(RuntimeError):
    """A robot on its sand cannot be simulated to the end of a command: as a rule it digs itself in."""


class Truth:
    """The model of a trial.

    Args:
        setup: robot, soil and laws.
        command: the desired motion.
        sizes: parameters of the influences that a subclass adds, by the influence's id.
    """

    def __init__(self, setup: Setup, command: Command, sizes: Mapping[str, Sizes] | None = None) -> None:
        robot, soil = setup.robot, setup.soil
        self.robot, self.chassis, self.drive, self.command = robot, robot.chassis, robot.drive, command
        self.law, self.near_rest, self.intervals = setup.law, setup.near_rest, setup.intervals
        self.sizes, self.gains = dict(sizes or {}), dict(setup.gains)
        self.order = 12
        self.method: Method = "LSODA"  # of integration
        self.r = robot.wheels.radius
        self.rolling = self.r * np.array(setup.radii)
        self.rim_inertia = robot.chassis.wheel_inertia
        self.rise, self.bank = 0.0, 0.0  # of the ground, along and across the track [rad]
        ch = robot.chassis
        self.mass = ch.total_mass
        self.arm_x = np.array([0.5, -0.5]) * ch.wheel_base - ch.com_x
        self.arm_z = -ch.com_z
        self.emf = robot.drive.emf_constant * robot.drive.gear_ratio
        self.ground = Ground(
            r=self.r,
            b=robot.wheels.width,
            n=soil.exponent,
            k_c=soil.cohesive_modulus,
            k_phi=soil.frictional_modulus,
            c=soil.cohesion,
            tan_phi=float(np.tan(np.radians(soil.friction_angle))),
            K=soil.shear_modulus,
            mu_s=soil.tyre_friction,
            c_t=ch.contact_damping,
        )
        self.setup()

    def setup(self) -> None:
        """Claim states and work out constants; an influence does so here."""

    def claim(self, count: int) -> slice:
        """Return the place of further states, at the end of the state."""
        self.order += count
        return slice(self.order - count, self.order)

    def marks(self) -> tuple[float, ...]:
        """Return the instants at which a law changes [s]."""
        return self.command.corners(V_FLOOR)

    def demand(self, t: float) -> tuple[float, float]:
        """Return distance [m] and velocity [m/s] that the controller follows."""
        return self.command.position(t), self.command.velocity(t)

    def k92(self, t: float, y: Array) -> float | Array:
        """Return k_92 in force."""
        return self.law(self.command.velocity(t))

    def velocity(self, y: Array) -> Array:
        """Return the longitudinal component in R of the velocity of the wheel centres, and of R [m/s]."""
        return np.asarray(np.cos(y[PITCH]) * y[VX] - np.sin(y[PITCH]) * y[VZ] + y[Q] * self.arm_z)

    def places(self, y: Array) -> Array:
        """Return how far along O front and rear wheel centre are [m]."""
        along = np.multiply.outer(self.arm_x, np.cos(y[PITCH]))
        return np.asarray(y[X] + along + np.sin(y[PITCH]) * self.arm_z)

    def fade(self, y: Array) -> Array:
        """Return 0 at rest and 1 above v_floor: what the ground holds at rest acts on nothing."""
        return smoothstep(np.abs(self.velocity(y)) / V_FLOOR)

    def stance(self, t: float, y: Array) -> Stance:
        """Return how the wheels meet the ground."""
        s, c, v = np.sin(y[PITCH]), np.cos(y[PITCH]), self.velocity(y)
        height = y[Z] + c * self.arm_z - np.multiply.outer(self.arm_x, s)
        rate = y[Q] * (np.multiply.outer(self.arm_x, c) + s * self.arm_z) - y[VZ]
        return Stance((self.rolling * y[OMEGA].T).T, np.array([v, v]), self.r - height, rate)

    def soil(self, t: float, y: Array, at: Stance) -> Ground:
        """Return the soil under the wheels."""
        return self.ground

    def contact(self, t: float, y: Array) -> Contact:
        """Return the wheel forces in the state y."""
        at = self.stance(t, y)
        return contact(
            self.soil(t, y, at), at, self.k92(t, y), intervals=self.intervals, near_rest=self.near_rest
        )

    def shaft(self, y: Array) -> tuple[Array, Array]:
        """Return angle and rate at the wheel's side of the gear that encoder and back-EMF meet."""
        return y[ANGLE], y[OMEGA]

    def reading(self, y: Array) -> tuple[Array, Array]:
        """Return angle and rate that the encoder tells the controller and the log."""
        return self.shaft(y)

    def voltage(self, t: float, y: Array) -> Array:
        """Return the motor voltages (25), (26) [V]."""
        d = self.drive
        angle, rate = self.reading(y)
        s_d, v_d = self.demand(t)
        wanted = (d.gain_p * s_d + d.gain_d * v_d) / self.r - d.gain_p * angle - d.gain_d * rate
        return np.asarray(np.minimum(np.maximum(wanted, d.voltage_min), d.voltage_max))

    def resistance(self, y: Array) -> float | Array:
        """Return the resistance of the rotors [ohm]."""
        return self.drive.resistance

    def torque(self, y: Array) -> Array:
        """Return the driving torques at the wheels (24) [N m]."""
        d = self.drive
        return np.asarray(d.gear_efficiency * d.gear_ratio * d.torque_constant * y[CURRENT])

    def load(self, y: Array, wheel: Contact) -> Array:
        """Return the torques with which tyre and ground act on the rims [N m]."""
        return wheel.M

    def push(self, t: float, y: Array, wheel: Contact) -> Array:
        """Return what acts on the body besides the wheel forces, a new array (3,) or (3, m).

        Forces on the centre of mass along O's x and z [N], and the moment about y, nose down [N m].
        """
        push = np.zeros((3, *y.shape[1:]))
        push[1] = -self.mass * GRAVITY
        return push

    def misreading(self) -> Misreading:
        """Return the lasting errors of the sensors."""
        return Misreading()

    def derivative(self, t: float, y: Array) -> Array:
        """Return dy/dt."""
        return self.rates(t, y, self.contact(t, y))

    def locked(self, t: float, y: Array) -> Array:
        """Return how far the gears are locked: 0 not at all, 1 for good."""
        below = self.near_rest.holds_below
        if not below or t < self.command.end:
            return FREE
        return smoothstep(2.0 - np.abs(y[OMEGA]) * self.r / below)

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Return dy/dt under the given wheel forces."""
        push, voltage, locked = self.push(t, y, wheel), self.voltage(t, y), self.locked(t, y)
        dy, s, c = np.zeros(y.shape), np.sin(y[PITCH]), np.cos(y[PITCH])
        along, up = wheel.F + wheel.R, wheel.normal  # along O's axes
        f_x, f_z = c * along - s * up, s * along + c * up  # (19)
        dy[:3], dy[ANGLE] = y[3:6], y[OMEGA]
        dy[VX] = (2 * (along[0] + along[1]) + push[0]) / self.mass  # (20) and (21), seen from O
        dy[VZ] = (2 * (up[0] + up[1]) + push[1]) / self.mass
        turning = 2 * (self.arm_z * (f_x[0] + f_x[1]) - self.arm_x @ f_z) + push[2]
        dy[Q] = turning / self.chassis.pitch_inertia  # (22)
        dy[OMEGA] = (self.torque(y) + self.load(y, wheel)) / self.rim_inertia  # (23)
        if locked is not FREE:
            voltage = voltage * (1 - locked)
            dy[OMEGA] -= LOCKING_RATE * locked * y[OMEGA]
        back_emf = self.emf * self.shaft(y)[1]
        dy[CURRENT] = (voltage - back_emf - self.resistance(y) * y[CURRENT]) / self.drive.inductance  # (24)
        return dy

    def at_rest(self) -> Array:
        """Return the state at standstill, but for height and pitch."""
        return np.zeros(self.order)

    def rest(self) -> Array:
        """Return the state of equilibrium at standstill, R above the origin of O."""
        fore, aft = self.arm_x
        load = self.mass * GRAVITY / 2 * np.array([-aft, fore]) / (fore - aft)

        def excess(z0: float, wanted: float) -> float:
            still = np.zeros(1)
            return float(contact(self.ground, Stance(still, still, still + z0, still), 1.0).W[0] - wanted)

        z0 = [float(scipy.optimize.brentq(excess, 1e-6, 0.9 * self.r, args=(wanted,))) for wanted in load]
        y = self.at_rest()
        pitch = float(np.arcsin((z0[0] - z0[1]) / (fore - aft)))
        height = self.r - z0[0] + np.sin(pitch) * fore - np.cos(pitch) * self.arm_z

        def standing(u: Array) -> Array:
            state = y.copy()
            x = -0.5 * (fore + aft) * np.cos(u[1]) - self.arm_z * np.sin(u[1])
            state[[X, Z, PITCH]] = x, *u
            return state

        def unbalanced(u: Array) -> Array:
            return self.derivative(-1.0, standing(u))[[VZ, Q]]

        solution = scipy.optimize.root(unbalanced, [height, pitch], options={"xtol": 1e-13})
        if np.abs(solution.fun).max() > 1e-6:
            raise DigsInError(f"no equilibrium at rest: {solution.message}")
        return standing(solution.x)

    def cruise(self) -> tuple[Array, float]:
        """Return the state of steady motion by algebra alone, with its slip ratio λ_R.

        The wheels then turn with the desired velocity, so drive and controller drop out of (20)-(22). The
        command is a trapezoid.
        """
        t = self.command.measured[0]
        v_d = self.command.velocity(t)
        y = self.rest()
        y[OMEGA] = v_d / self.r

        def unbalanced(u: Array) -> Array:
            state = y.copy()
            state[[Z, PITCH, VX]] = u
            return self.derivative(t, state)[[VZ, Q, VX]]

        start = [y[Z] - 0.004, y[PITCH], 0.85 * v_d]
        y[[Z, PITCH, VX]] = scipy.optimize.fsolve(unbalanced, start, xtol=1e-13)
        return y, 1.0 - float(y[VX]) / v_d
