"""The simulator conserves what must be conserved and knows its limits.

It gives the known figures as it agrees with `tests.truth.simulator`, which is held to them.
"""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from granite_lab.effects import get
from granite_lab.errors import EstimateError, InputError
from granite_lab.model import Run, simulate, simulator
from granite_lab.model.effect import activate
from granite_lab.model.simulator import integrate
from granite_lab.model.symbols import model_parameters
from granite_lab.parameters import GRAVITY, Variant, load_paper, load_variants, variant_of
from tests.model.box import ROBOT, SOIL, altered


def run_of(variant: Variant, **options: object) -> Run:
    return simulate(variant, ROBOT, SOIL, **options)


@pytest.mark.parametrize("options", [{"k92": 0.1}, {"a_theta": 4.919}, {"k92": 1.0}])
def test_a_robot_at_rest_neither_creeps_nor_drifts(options: dict[str, float]) -> None:
    still = Variant(velocity=0.3, acceleration=1.2, distance=2.0)
    run = run_of(still, **options)
    before = run.t < 0
    assert np.abs(run["x_m"][before]).max() < 1e-9
    assert np.abs(run["v_mps"][before]).max() < 1e-9
    assert np.ptp(run["pitch_rad"][before]) < 1e-9
    assert abs(run["v_mps"][-1]) < 2e-4  # coasting out, (26) cannot brake


def test_at_rest_the_ground_carries_the_weight_and_the_accelerometer_reads_gravity() -> None:
    run = run_of(variant_of(0.3))
    weight = ROBOT.chassis.total_mass * GRAVITY
    assert 2 * (run["force_z_f_N"][0] + run["force_z_r_N"][0]) == pytest.approx(weight, rel=1e-8)
    pitch = run["pitch_rad"][0]
    assert run["imu_ax_mps2"][0] == pytest.approx(-GRAVITY * np.sin(pitch), abs=1e-6)
    assert run["imu_az_mps2"][0] == pytest.approx(GRAVITY * np.cos(pitch), rel=1e-6)


def test_slip_grows_as_the_rear_contact_angle_shrinks() -> None:
    slips = [run_of(variant_of(0.3), k92=k).slip_ratio for k in (1.0, 0.6, 0.3, 0.1, 0.0)]
    assert all(a < b for a, b in pairwise(slips))


def test_a_robot_too_heavy_for_the_soil_is_refused() -> None:
    heavy = altered(ROBOT, chassis={"body_mass": 2000.0})
    with pytest.raises(EstimateError, match="sinks to its axles"):
        simulate(variant_of(0.3), heavy, dataclasses.replace(SOIL, frictional_modulus=1e4))


def test_a_robot_without_chassis_cannot_be_simulated() -> None:
    bare = dataclasses.replace(ROBOT, chassis=None)
    with pytest.raises(InputError, match=r"no \[chassis\] table"):
        simulate(variant_of(0.3), bare, SOIL)


def test_each_run_is_integrated_unless_sensors_with_faults_look_at_the_same_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    p = model_parameters(ROBOT, SOIL, load_variants()[3], a_theta=load_paper().a_theta)
    looked = 0

    def evaluated(*args: object) -> object:
        nonlocal looked
        looked += 1
        return rest(*args)

    rest = simulator._rest_state
    monkeypatch.setattr(simulator, "_rest_state", evaluated)
    simulator._remembered.cache_clear()  # another test may have looked at this motion
    for _ in range(2):
        integrate(p)
    assert looked == 2
    tilted = [integrate(p, [activate(get("imu_tilt"), {"tilt": tilt})]) for tilt in (1.0, 2.0)]
    assert looked == 3
    assert (tilted[0]["v_mps"] == tilted[1]["v_mps"]).all()
    assert (tilted[0]["imu_ax_mps2"] != tilted[1]["imu_ax_mps2"]).any()
