"""The CasADi simulator against the independent implementation in `tests.truth` (plain NumPy, LSODA)."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pytest

from granite_lab.model import Run, simulate
from granite_lab.parameters import (
    GRAVITY,
    Variant,
    load_paper,
    load_robot,
    load_soil,
    variant_of,
)
from tests.model.box import altered
from tests.truth.simulator import Result
from tests.truth.simulator import simulate as reference

Array = npt.NDArray[np.float64]

AFTER = 1.5
"""Time after the command's end that is compared [s]."""

PUBLISHED = {row.velocity: row.k92 for row in load_paper().table3}

CASES = [(v, law) for v in sorted(PUBLISHED) for law in ("constant", "exponential")]

# signal of the package, signal of the reference, tolerance as a share of the signal's peak
BOTH_AXLES = [
    ("omega_{}_radps", "omega", 2e-3),
    ("theta_{}_rad", "angle", 2e-4),
    ("v_wheel_{}_mps", "v_o", 2e-3),
    ("slip_{}", "slip", 1e-2),
    ("sinkage_{}_m", "sinkage", 1e-3),
    ("load_{}_N", "W", 1e-2),
    ("resistance_{}_N", "R", 1e-2),
    ("thrust_{}_N", "F", 1e-2),
    ("force_z_{}_N", "normal", 1e-2),
    ("moment_{}_Nm", "M", 1e-2),
    ("torque_{}_Nm", "torque", 1e-2),
    ("current_{}_A", "current", 1e-2),
    ("voltage_{}_V", "voltage", 1e-2),
]
WHOLE_ROBOT = [
    ("pitch_rad", "pitch", 5e-3),
    ("k92", "k92", 1e-9),
    ("v_desired_mps", "v_d", 1e-9),
    ("s_desired_m", "s_d", 1e-9),
]


def law_of(velocity: float, law: str) -> dict[str, float]:
    return {"k92": PUBLISHED[velocity]} if law == "constant" else {"a_theta": load_paper().a_theta}


@lru_cache
def both(velocity: float, law: str) -> tuple[Run, Result]:
    variant, chosen = variant_of(velocity), law_of(velocity, law)
    run = simulate(variant, load_robot(), load_soil(), **chosen)
    return run, reference(variant, settle=0.5, after=AFTER, **chosen)


def difference(run: Run, name: str, truth: Result, values: Array) -> Array:
    """Package minus reference at the package's samples that both cover."""
    known = (run.t >= truth.t[0]) & (run.t <= truth.t[-1])
    assert run.t[known][-1] > truth.t[-1] - 0.01
    return np.asarray(run[name][known] - np.interp(run.t[known], truth.t, values))


@pytest.mark.parametrize(("velocity", "law"), CASES)
def test_every_signal_agrees(velocity: float, law: str) -> None:
    run, truth = both(velocity, law)
    assert np.abs(difference(run, "v_mps", truth, truth.v)).max() < 1e-4
    assert np.abs(difference(run, "x_m", truth, truth.x)).max() < 1e-4
    assert run.slip_ratio == pytest.approx(truth.slip_ratio(*run.steady), abs=1e-4)
    pairs = [(name, np.asarray(getattr(truth, other)), share) for name, other, share in WHOLE_ROBOT]
    for name, other, share in BOTH_AXLES:
        for i, axle in enumerate("fr"):
            pairs.append((name.format(axle), getattr(truth, other)[:, i], share))
    for name, values, share in pairs:
        assert np.abs(difference(run, name, truth, values)).max() < share * np.abs(values).max(), name


@pytest.mark.parametrize("velocity", sorted(PUBLISHED))
def test_imu_feels_what_rigid_body_kinematics_says(velocity: float) -> None:
    run, truth = both(velocity, "exponential")
    arm, s, c = load_robot().imu, np.sin(truth.pitch), np.cos(truth.pitch)
    q, dq = truth.pitch_rate, truth.pitch_acceleration
    along = truth.acceleration[:, 0] + dq * arm.z - q**2 * arm.x - GRAVITY * s
    up = truth.acceleration[:, 1] - dq * arm.x - q**2 * arm.z + GRAVITY * c
    # at the kinks of the command the acceleration changes within a sample
    for name, values in (("imu_ax_mps2", along), ("imu_az_mps2", up)):
        assert np.sqrt(np.mean(difference(run, name, truth, values) ** 2)) < 5e-3
    assert np.abs(difference(run, "imu_gy_radps", truth, q)).max() < 2e-4


def test_another_robot_on_another_soil_agrees_too() -> None:
    """No number of the paper's robot or sand is built in."""
    chassis = {
        "wheel_base": 0.5, "body_mass": 28.0, "wheel_mass": 2.2, "com_x": 0.03, "com_z": 0.1,
        "wheel_inertia": 0.03, "pitch_inertia": 0.8, "contact_damping": 700.0,
    }  # fmt: skip
    drive = {
        "inductance": 2e-4, "resistance": 0.5, "emf_constant": 0.025, "torque_constant": 0.028,
        "gear_ratio": 60, "gear_efficiency": 0.7, "voltage_max": 24.0, "voltage_min": -24.0,
        "gain_p": 20.0, "gain_d": 6.0,
    }  # fmt: skip
    robot = altered(load_robot(), wheels={"radius": 0.13, "width": 0.09}, chassis=chassis, drive=drive)
    soil = dataclasses.replace(
        load_soil(), exponent=0.9, cohesive_modulus=5e3, frictional_modulus=9e5, cohesion=300.0,
        friction_angle=27.0, shear_modulus=0.018, tyre_friction=0.8,
    )  # fmt: skip
    variant = Variant(velocity=0.4, acceleration=0.8, distance=0.9)
    run = simulate(variant, robot, soil, k92=0.2)
    truth = reference(variant, robot=robot, soil=soil, settle=0.5, after=AFTER, k92=0.2)
    assert truth.v.max() > 0.2
    assert np.abs(difference(run, "v_mps", truth, truth.v)).max() < 1e-4
    for i, axle in enumerate("fr"):
        torque = truth.torque[:, i]
        assert np.abs(difference(run, f"torque_{axle}_Nm", truth, torque)).max() < 0.01 * np.abs(torque).max()
    assert np.abs(difference(run, "pitch_rad", truth, truth.pitch)).max() < 2e-5
