"""Drive unit and wheel controller: equations (24)-(26)."""

from __future__ import annotations

from typing import Any

import casadi as ca

from granite_lab.parameters import Drive


def control_voltage(drive: Drive, angle_error: Any, rate_error: Any) -> Any:
    """Return the motor voltage [V] for errors of wheel angle [rad] and rate [rad/s], (25), (26)."""
    demand = drive.gain_p * angle_error + drive.gain_d * rate_error
    return ca.fmin(ca.fmax(demand, drive.voltage_min), drive.voltage_max)


def current_rate(drive: Drive, voltage: Any, wheel_rate: Any, current: Any) -> Any:
    """Return di/dt [A/s] of a motor, (24)."""
    emf = drive.emf_constant * drive.gear_ratio * wheel_rate
    return (voltage - emf - drive.resistance * current) / drive.inductance


def drive_torque(drive: Drive, current: Any) -> Any:
    """Return the driving torque T at the wheel [N m], (24)."""
    return drive.gear_efficiency * drive.gear_ratio * drive.torque_constant * current
