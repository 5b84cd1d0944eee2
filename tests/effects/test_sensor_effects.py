"""Sensor effects change what is read and nothing that moves, unless a controller follows the reading."""

from __future__ import annotations

import numpy as np
import pytest

from granite_lab.parameters import GRAVITY
from tests.effects.runs import ROBOT, at, run

# effect: (its values, the readings that are scaled, and by how much)
SENSOR_EFFECTS: dict[str, tuple[dict[str, float], dict[str, float]]] = {
    "imu_tilt": ({"tilt": 1.0}, {}),
    "clock_offset": ({"offset": 0.02}, {}),
    "wheel_radius_error": ({"error": 0.02}, {"enc_f_rad": 1.02, "enc_r_rad": 1.02}),
    "accel_scale_error": ({"x": 0.02, "z": 0.01}, {"imu_ax_mps2": 1.02, "imu_az_mps2": 1.01}),
}


@pytest.mark.parametrize("effect_id", SENSOR_EFFECTS)
def test_readings_are_scaled_as_said_and_what_the_robot_does_stays_as_it_was(effect_id: str) -> None:
    values, scaled = SENSOR_EFFECTS[effect_id]
    plain, changed = run(), run(effect_id, **values)
    for name in plain.signals:
        if name in scaled or name[:4] not in ("imu_", "enc_", "cur_"):
            expected = plain[name] * scaled.get(name, 1.0)
            np.testing.assert_allclose(changed[name], expected, rtol=1e-12, atol=1e-9, err_msg=name)


def test_late_stamps_shift_encoders_and_currents_and_not_the_imu() -> None:
    plain, changed = run(step=0.001), run("clock_offset", step=0.001, offset=0.013)
    t = np.linspace(-0.5, 6, 400)
    for name in ("enc_f_rad", "enc_r_rad", "cur_f_A", "cur_r_A"):
        expected = np.interp(t - 0.013, plain.t, plain[name])
        np.testing.assert_allclose(np.interp(t, changed.t, changed[name]), expected, atol=0.003)
        assert np.abs(np.interp(t, plain.t, plain[name]) - expected).max() > 0.05
    np.testing.assert_array_equal(changed["imu_ax_mps2"], plain["imu_ax_mps2"])
    early = run("clock_offset", offset=-0.013)
    assert at(early, 0.3, "enc_f_rad") > at(plain, 0.3, "enc_f_rad") > at(changed, 0.3, "enc_f_rad")


def test_a_tilted_imu_reads_a_part_of_gravity_along_x() -> None:
    """Nose down, x of the sensor points into the ground a little: at rest it reads -g sin(tilt)."""
    plain, changed = run(), run("imu_tilt", tilt=1.0)
    shift = at(changed, -0.5, "imu_ax_mps2") - at(plain, -0.5, "imu_ax_mps2")
    assert shift == pytest.approx(-GRAVITY * np.sin(np.radians(1.0)), rel=1e-3)


def test_an_encoder_out_of_true_sends_the_wheel_ahead_and_behind_once_a_revolution() -> None:
    """The controller keeps the reading even, so that it is the wheel that swings."""
    c, s = 0.02, 0.01
    plain, changed = run(), run("encoder_eccentricity", cos_front=c, sin_front=s)
    angle = changed["theta_f_rad"]
    error = changed["enc_f_rad"] - angle
    np.testing.assert_allclose(error, c * np.sin(angle) + s * (np.cos(angle) - 1), atol=1e-12)
    even = np.gradient(changed["enc_f_rad"], changed.t)
    steady = (changed.t > changed.steady[0]) & (changed.t < changed.steady[1])
    swing, left = np.ptp(changed["omega_f_radps"][steady]), np.ptp(even[steady])
    assert swing == pytest.approx(2 * np.hypot(c, s) * 0.5 / ROBOT.wheels.radius, rel=0.2)
    assert left < 0.2 * swing  # the back-EMF is the wheel's, so that a little is left
    np.testing.assert_array_equal(changed["enc_r_rad"], changed["theta_r_rad"])
    assert np.ptp(plain["omega_f_radps"][steady]) < 0.05 * swing
