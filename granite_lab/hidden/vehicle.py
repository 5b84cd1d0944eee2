"""Influences of the vehicle and of its sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from granite_lab.hidden.contact import Array, Contact
from granite_lab.hidden.influence import Influence, Size
from granite_lab.hidden.model import OMEGA, Q
from granite_lab.hidden.parts import CompleteRobot, Misreading
from granite_lab.hidden.sensors import rotation
from granite_lab.parameters import GRAVITY


class DriveReaction(Influence):
    """What the motors push against, and what it takes to spin their rotors."""

    id = "drive_reaction"
    title = "reaction of the driving torques on the body"
    account = (
        "Newton's third law: −share Σ(T + J n ω̇) about y, the rotors turning as the wheels do; J n is a "
        "fifth of the wheel's inertia"
    )
    declared = (Size("share", "-", "part of ΣT that the body takes", 0.7, 1.2, -0.5, 2),)

    def rates(self, t: float, y: Array, wheel: Contact) -> Array:
        """Add the moment, which lifts the nose when driving."""
        dy, ch = super().rates(t, y, wheel), self.chassis
        turning = self.torque(y) + 0.2 * ch.wheel_inertia * dy[OMEGA]
        dy[Q] -= 2 * self.sizes[DriveReaction.id]["share"] * turning.sum(axis=0) / ch.pitch_inertia
        return dy


class ComOffset(Influence):
    """A centre of mass elsewhere than in the robot's file, for something that stands on top."""

    id = "com_offset"
    title = "centre of mass shifted along the robot"
    account = "(22) with another centre of mass, higher by a third of the shift"
    declared = (Size("forward", "m", "shift, forward positive", 0.012, 0.03, -0.1, 0.1, signed=True),)

    @classmethod
    def altered(cls, robot: CompleteRobot, sizes: Mapping[str, float]) -> CompleteRobot:
        """Move the centre of mass."""
        x, z = robot.chassis.com_x + sizes["forward"], robot.chassis.com_z + abs(sizes["forward"]) / 3
        return replace(robot, chassis=replace(robot.chassis, com_x=x, com_z=z))


class PayloadMass(Influence):
    """A box between the axles, with the inertia of its size."""

    id = "payload_mass"
    title = "mass that the robot's file does not know of"
    account = "(20) to (22) of robot and box as one body; radius of gyration of the box 5 cm"
    declared = (
        Size("mass", "kg", "additional mass", 2.0, 6.0, -20, 100),
        Size("place", "m", "forward of the middle between the axles", 0, 0.12, -0.2, 0.2, True, "shape"),
    )

    @classmethod
    def altered(cls, robot: CompleteRobot, sizes: Mapping[str, float]) -> CompleteRobot:
        """Load the robot."""
        plain, mass, place = robot.chassis, sizes["mass"], sizes["place"]
        bodies = np.array([[plain.total_mass, plain.com_x], [mass, place]])
        centre = float(bodies[:, 0] @ bodies[:, 1] / bodies[:, 0].sum())
        apart = float(bodies[:, 0] @ (bodies[:, 1] - centre) ** 2)
        inertia = plain.pitch_inertia + apart + max(mass, 0.0) * 0.05**2
        heavier = replace(plain, body_mass=plain.body_mass + mass, com_x=centre, pitch_inertia=inertia)
        return replace(robot, chassis=heavier)


class GroundSlope(Influence):
    """Ground that rises; O is tilted with it. At rest the sand holds the robot."""

    id = "ground_slope"
    title = "ground that rises or falls"
    account = "gravity turned by the slope in (20), (21), and by a third of it across; held at rest"
    declared = (Size("slope", "deg", "rise in the direction of travel", 0.5, 1.5, -15, 15, signed=True),)

    def setup(self) -> None:
        """Tilt the ground."""
        super().setup()
        self.rise = float(np.radians(self.sizes[GroundSlope.id]["slope"]))
        self.bank = self.rise / 3

    def push(self, t: float, y: Array, wheel: Contact) -> Array:
        """Turn the weight; what holds it at rest acts at the axles."""
        push, weight, fade = super().push(t, y, wheel), self.mass * GRAVITY, self.fade(y)
        back = weight * np.sin(self.rise)
        push[0] -= fade * back
        push[1] += weight * (1 - np.cos(self.rise))
        push[2] += (1 - fade) * back * self.arm_z
        return push


class RollingDrag(Influence):
    """Resistance as a sum of a linear and a quadratic part."""

    id = "rolling_drag"
    title = "resistance that grows with speed"
    account = "linear and quadratic in the speed, mixed so that the power at 0.5 m/s is the exponent"
    declared = (
        Size("force", "N", "drag of the robot at 0.5 m/s", 6.0, 18.0, 0, 200, kind="equivalent"),
        Size("exponent", "-", "power of the speed", 1.0, 2.0, 0.5, 3, kind="shape"),
    )

    def push(self, t: float, y: Array, wheel: Contact) -> Array:
        """Add the resistance."""
        sizes, u = self.sizes[RollingDrag.id], np.abs(self.velocity(y)) / 0.5
        linear = 2 - sizes["exponent"]
        against = self.drag(y, sizes["force"] * (linear * u + (1 - linear) * u**2))
        return super().push(t, y, wheel) + against


class ImuTilt(Influence):
    """An IMU that sits at an angle."""

    id = "imu_tilt"
    title = "IMU mounted at an angle"
    account = "rotation of both triads about y, and by a quarter of it about x and z"
    declared = (Size("tilt", "deg", "nose down positive", 0.8, 2.0, -20, 20, signed=True),)

    def misreading(self) -> Misreading:
        """Turn the axes."""
        tilt, other = float(np.radians(self.sizes[ImuTilt.id]["tilt"])), super().misreading()
        turn = rotation(tilt / 4, tilt, tilt / 4)
        return replace(other, accel=other.accel @ turn, gyro=other.gyro @ turn)


class ClockOffset(Influence):
    """Stamps given on arrival."""

    id = "clock_offset"
    title = "stamps of encoders and currents late against the IMU's"
    account = "constant delay of the stamps; the currents' message follows the angles', later by a tenth"
    declared = (Size("offset", "s", "by how much the stamps are late", 0.01, 0.03, -0.3, 0.3, signed=True),)

    def misreading(self) -> Misreading:
        """Delay the stamps."""
        other = super().misreading()
        return replace(other, late=other.late + self.sizes[ClockOffset.id]["offset"], later=1.1)


class WheelRadiusError(Influence):
    """Angles scaled by a wrong count or radius."""

    id = "wheel_radius_error"
    title = "wheel angles scaled by a wrong radius or count"
    account = "factor on the logged angles, an eighth larger on the left than on the right"
    declared = (Size("error", "-", "relative error of the reading", 0.01, 0.03, -0.2, 0.2, signed=True),)

    def misreading(self) -> Misreading:
        """Scale the angles."""
        other = super().misreading()
        sides = np.array([17, 15, 17, 15]) / 16
        return replace(other, encoder=other.encoder * (1 + self.sizes[WheelRadiusError.id]["error"] * sides))


class AccelScaleError(Influence):
    """An accelerometer off in scale along x and z."""

    id = "accel_scale_error"
    title = "scale of the accelerometer off"
    account = "factors on the sensor's own x and z, each with a tenth of it across to the other"
    declared = (
        Size("x", "-", "relative error of the longitudinal axis", 0.015, 0.04, -0.3, 0.3, signed=True),
        Size("z", "-", "relative error of the vertical axis", 0.002, 0.006, -0.3, 0.3, signed=True),
    )

    def misreading(self) -> Misreading:
        """Scale the axes."""
        sizes, other = self.sizes[AccelScaleError.id], super().misreading()
        x, z = sizes["x"], sizes["z"]
        wrong = np.array([[1 + x, 0, x / 10], [0, 1, 0], [z / 10, 0, 1 + z]])
        return replace(other, accel=wrong @ other.accel)
