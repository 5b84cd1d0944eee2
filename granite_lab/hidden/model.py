"""Equations (1)-(26) for the whole robot, in plain NumPy: the right-hand side of the tests' own truth.

Written from the paper and nothing else of the project; robot and soil numbers come from the
parameter records. The motion is formulated in the ground frame O about the centre of mass, which
is (20)-(22) rotated by (19).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq, fsolve

from granite_lab.hidden.command import Trapezoid
from granite_lab.hidden.contact import V_FLOOR, Array, Contact, Ground, contact, smoothstep
from granite_lab.parameters import GRAVITY, Robot, Soil

X, Z, PITCH, VX, VZ, Q = range(6)
ANGLE, OMEGA, CURRENT = slice(6, 8), slice(8, 10), slice(10, 12)
"""Places in the state: centre of mass in O, pitch, their rates; then front and rear wheel of each kind."""

Law = Callable[[float], float]


def constant_k92(value: float) -> Law:
    """Return k_92(v_d) of Table 3: constant while driving, 1 at rest, blended below v_floor."""
    return lambda v_d: 1.0 + (value - 1.0) * float(smoothstep(v_d / V_FLOOR))


def exponential_k92(a_theta: float) -> Law:
    """Return k_92(v_d) of (5)."""
    return lambda v_d: float(np.exp(-a_theta * v_d))


class Truth:
    """The model for one robot, soil, command and law of k_92.

    The methods are small so that a variation of the model overrides one of them.
    """

    def __init__(self, robot: Robot, soil: Soil, command: Trapezoid, law: Law, intervals: int = 32) -> None:
        if robot.chassis is None or robot.drive is None:
            raise ValueError("the robot has no chassis or no drive")
        self.chassis, self.drive, self.command, self.law = robot.chassis, robot.drive, command, law
        self.intervals = intervals
        self.r = robot.wheels.radius
        ch = robot.chassis
        self.mass = ch.body_mass + 4 * ch.wheel_mass
        self.arm_x = np.array([0.5, -0.5]) * ch.wheel_base - ch.com_x
        self.arm_z = -ch.com_z
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

    def k92(self, t: float) -> float:
        """Return k_92 in force."""
        return self.law(self.command.velocity(t))

    def velocity(self, y: Array) -> float:
        """Return the longitudinal component in R of the velocity of the wheel centres, and of R [m/s]."""
        return float(np.cos(y[PITCH]) * y[VX] - np.sin(y[PITCH]) * y[VZ] + y[Q] * self.arm_z)

    def contact(self, t: float, y: Array) -> Contact:
        """Return the wheel forces in the state y."""
        s, c = np.sin(y[PITCH]), np.cos(y[PITCH])
        height = y[Z] - s * self.arm_x + c * self.arm_z
        rising = y[VZ] - y[Q] * (c * self.arm_x + s * self.arm_z)
        return contact(
            self.ground,
            v_o=y[OMEGA] * self.r,
            v=np.full(2, self.velocity(y)),
            z0=self.r - height,
            dz0=-rising,
            k92=self.k92(t),
            intervals=self.intervals,
        )

    def voltage(self, t: float, y: Array) -> Array:
        """Return the motor voltages (25), (26) [V]."""
        d = self.drive
        e_theta = self.command.position(t) / self.r - y[ANGLE]
        e_omega = self.command.velocity(t) / self.r - y[OMEGA]
        return np.clip(d.gain_p * e_theta + d.gain_d * e_omega, d.voltage_min, d.voltage_max)

    def torque(self, y: Array) -> Array:
        """Return the driving torques at the wheels (24) [N m]."""
        d = self.drive
        return np.asarray(d.gear_efficiency * d.gear_ratio * d.torque_constant * y[CURRENT])

    def derivative(self, t: float, y: Array) -> Array:
        """Return dy/dt."""
        return self.rates(t, y, self.contact(t, y))

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Return dy/dt under the given wheel forces."""
        d, ch = self.drive, self.chassis
        s, c = np.sin(y[PITCH]), np.cos(y[PITCH])
        f_x, f_z = wheel.F + wheel.R, wheel.normal  # (16)-(18), in O
        f_rx, f_rz = c * f_x - s * f_z, s * f_x + c * f_z  # (19)
        dy = np.empty_like(y)
        dy[X], dy[Z], dy[PITCH] = y[VX], y[VZ], y[Q]
        dy[VX] = 2 * f_x.sum() / self.mass  # (20) and (21), seen from O
        dy[VZ] = 2 * f_z.sum() / self.mass - GRAVITY
        dy[Q] = 2 * (self.arm_z * f_rx - self.arm_x * f_rz).sum() / ch.pitch_inertia  # (22)
        dy[ANGLE] = y[OMEGA]
        dy[OMEGA] = (self.torque(y) + wheel.M) / ch.wheel_inertia  # (23)
        back_emf = d.emf_constant * d.gear_ratio * y[OMEGA]
        dy[CURRENT] = (self.voltage(t, y) - back_emf - d.resistance * y[CURRENT]) / d.inductance  # (24)
        return dy

    def rest(self) -> Array:
        """Return the state of equilibrium at standstill, R above the origin of O."""
        fore, aft = self.arm_x
        load = self.mass * GRAVITY / 2 * np.array([-aft, fore]) / (fore - aft)

        def excess(z0: float, wanted: float) -> float:
            still = np.zeros(1)
            return float(
                contact(self.ground, v_o=still, v=still, z0=still + z0, dz0=still, k92=1.0).W[0] - wanted
            )

        z0 = [float(brentq(excess, 1e-6, 0.9 * self.r, args=(wanted,))) for wanted in load]
        y = np.zeros(12)
        y[PITCH] = np.arcsin((z0[0] - z0[1]) / (fore - aft))
        y[Z] = self.r - z0[0] + np.sin(y[PITCH]) * fore - np.cos(y[PITCH]) * self.arm_z

        def unbalanced(u: Array) -> Array:
            return self.derivative(-1.0, self._with(y, {Z: u[0], PITCH: u[1]}))[[VZ, Q]]

        y[[Z, PITCH]] = fsolve(unbalanced, y[[Z, PITCH]], xtol=1e-13)
        y[X] = self.chassis.com_x * np.cos(y[PITCH]) - self.arm_z * np.sin(y[PITCH])
        return y

    def cruise(self) -> tuple[Array, float]:
        """Return the state of steady motion by algebra alone, with its slip ratio λ_R.

        The wheels then turn with the desired velocity, so drive and controller drop out of (20)-(22).
        """
        v_d = self.command.v
        t = self.command.ramp + 0.5 * self.command.hold
        y = self._with(self.rest(), dict.fromkeys((8, 9), v_d / self.r))

        def unbalanced(u: Array) -> Array:
            state = self._with(y, {Z: u[0], PITCH: u[1], VX: u[2]})
            return self.derivative(t, state)[[VZ, Q, VX]]

        y[[Z, PITCH, VX]] = fsolve(unbalanced, [y[Z] - 0.004, y[PITCH], 0.85 * v_d], xtol=1e-13)
        return y, 1.0 - float(y[VX]) / v_d

    @staticmethod
    def _with(y: Array, values: dict[int, float]) -> Array:
        """Return a copy of the state with some of its places replaced."""
        new = y.copy()
        for place, value in values.items():
            new[place] = value
        return new
