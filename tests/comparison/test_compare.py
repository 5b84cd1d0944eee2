"""One trial beside its simulation."""

import dataclasses
import math
from functools import lru_cache

import numpy as np
import pytest

from granite_lab.comparison.compare import compare, misfits_of
from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.fitting import fit_k92, simulate_k92
from granite_lab.parameters import load_robot, load_soil, variant_of
from tests.fitting.made_up import made_up_trial

ROBOT, SOIL = load_robot(), load_soil()
CHANNELS = {
    "velocity", "wheel_fl", "wheel_fr", "wheel_rl", "wheel_rr", "slip_f", "slip_r",
    "torque_f", "torque_r", "pitch", "accel", "pitch_rate",
}  # fmt: skip


@lru_cache
def fitted(velocity=0.3, k92=0.2286, seed=0):
    variant = variant_of(velocity)
    run = simulate_k92(variant, ROBOT, SOIL, k92)
    motion, trial, run, _ = made_up_trial(variant, k92, run=run, seed=seed, name=f"v{velocity}_{seed}")
    return motion, trial, run, fit_k92(motion, trial, ROBOT, SOIL)


def simulated(fit):
    return simulate_k92(fit.variant, ROBOT, SOIL, fit.k92.value)


def misfit(comparison, channel, phase="all"):
    return next(m for m in comparison.misfits if (m.channel, m.phase) == (channel, phase))


def test_every_channel_that_was_measured_is_there_on_the_motions_stamps():
    motion, trial, _, fit = fitted()
    c = compare(motion, trial, fit, simulated(fit))
    assert set(c.measured) == set(c.measured_std) == set(c.simulated) == set(c.units) == CHANNELS
    assert all(values.shape == motion.t.shape for values in c.measured.values())
    assert c.t == pytest.approx(motion.t - fit.t_start.value)
    assert {m.phase for m in c.misfits} == {"all", "rest", "accelerate", "steady", "brake"}
    bare = dataclasses.replace(trial, currents=None, imu=None)
    c = compare(motion, bare, fit, simulated(fit))
    assert set(c.measured) == CHANNELS - {"torque_f", "torque_r", "accel", "pitch_rate"}
    assert not [m for m in c.misfits if m.channel == "accel"]


def test_the_model_that_made_the_log_is_at_the_noise_floor():
    motion, trial, _, fit = fitted()
    c = compare(motion, trial, fit, simulated(fit))
    for channel, low, high in [
        ("velocity", 0.3, 2.0), ("torque_f", 0.5, 1.6), ("torque_r", 0.5, 1.6), ("accel", 0.9, 1.2),
        ("pitch_rate", 0.9, 1.2),
    ]:  # fmt: skip
        assert low < misfit(c, channel, "steady").normalised < high, channel
    assert misfit(c, "wheel_fl").rms < 1e-3
    assert misfit(c, "pitch").rms < 2e-4  # the made-up offset of 4 mrad is gone


def test_a_wrong_k92_shows_in_slip_and_velocity_and_not_in_the_wheels():
    motion, trial, _, fit = fitted()
    right = compare(motion, trial, fit, simulated(fit))
    wrong_run = simulate_k92(variant_of(0.3), ROBOT, SOIL, 0.10)
    wrong = compare(motion, trial, fit, wrong_run)
    assert wrong.run is wrong_run
    bias = misfit(wrong, "slip_f", "steady").bias
    assert bias == pytest.approx(0.170 - 0.0973, abs=0.01)  # λ_R of the two k_92
    assert misfit(wrong, "velocity", "steady").bias == pytest.approx(-0.3 * bias, abs=0.003)
    assert misfit(wrong, "velocity", "steady").normalised > 5 * misfit(right, "velocity", "steady").normalised
    assert abs(misfit(wrong, "wheel_fl", "steady").bias) < 1e-3


def test_driving_torques_come_from_the_currents_by_24():
    motion, trial, run, fit = fitted()
    c = compare(motion, trial, fit, simulated(fit))
    i = int(np.argmin(np.abs(c.t - 4.0)))
    j = int(np.argmin(np.abs(trial.currents.t - motion.t[i])))
    still = trial.currents.t < fit.t_start.value - 0.1
    window = trial.currents.current[j - 10 : j + 11, :2].mean()
    expected = 0.8 * 53 * 0.03 * (window - trial.currents.current[still, :2].mean())
    assert c.measured["torque_f"][i - 20 : i + 21].mean() == pytest.approx(expected, abs=0.03)
    assert c.measured["torque_f"][i] == pytest.approx(np.interp(4.0, run.t, run["torque_f_Nm"]), abs=0.25)
    assert 0.8 * 53 * 0.03 * 0.05 / np.sqrt(2) < c.measured_std["torque_f"][i] < 0.1


@pytest.mark.parametrize("silent", [0, 1])
def test_an_offset_that_no_standstill_shows_is_in_the_std_of_the_torque_whichever_wheel_has_it(silent):
    motion, trial, _, fit = fitted()
    began = trial.currents.t > fit.t_start.value
    measured = {}
    for offset in (-ROBOT.currents.offset, ROBOT.currents.offset):
        current = trial.currents.current.copy()
        current[~began, silent] = np.nan
        current[:, silent] += offset
        log = dataclasses.replace(trial, currents=dataclasses.replace(trial.currents, current=current))
        c = compare(motion, log, fit, simulated(fit))
        measured[offset] = c.measured["torque_f"]
    low, high = measured.values()
    i = int(np.argmin(np.abs(c.t - 4.0)))
    one_std = (high[i] - low[i]) / 2  # what an offset of one std does to the mean of the pair
    assert one_std == pytest.approx(0.8 * 53 * 0.03 * ROBOT.currents.offset / 2)
    whole = compare(motion, trial, fit, simulated(fit)).measured_std["torque_f"][i]
    assert c.measured_std["torque_f"][i] == pytest.approx(np.hypot(whole, one_std), rel=0.02)


def test_an_unknown_start_is_refused():
    motion, trial, _, fit = fitted()
    nowhere = Estimate(math.nan)
    with pytest.raises(EstimateError, match="start of the command"):
        compare(
            dataclasses.replace(motion, t_start=nowhere), trial,
            dataclasses.replace(fit, t_start=nowhere), simulated(fit),
        )  # fmt: skip


def test_a_misfit_counts_what_it_says():
    phase = np.array(["rest", "steady", "steady", "brake"])
    measured = np.array([0.0, 1.0, 2.0, np.nan])
    simulated = np.array([0.0, 1.3, 1.6, 5.0])
    std = np.array([0.1, 0.1, 0.2, 0.1])
    found = {m.phase: m for m in misfits_of("velocity", measured, std, simulated, phase)}
    assert set(found) == {"all", "rest", "steady"}  # nothing was measured while braking
    steady = found["steady"]
    assert steady.rms == pytest.approx(math.sqrt((0.3**2 + 0.4**2) / 2))
    assert steady.bias == pytest.approx(-0.05)
    assert steady.peak == pytest.approx(0.4)
    assert steady.normalised == pytest.approx(math.sqrt((3**2 + 2**2) / 2))
    assert (steady.samples, found["all"].samples) == (2, 3)
    vague = np.array([0.01, 0.01, 0.5, 0.01])  # slip of unknown size is left out, and that at rest
    slip = misfits_of("slip_f", measured, vague, simulated, phase)
    assert {m.phase: m.samples for m in slip} == {"all": 1, "steady": 1}


def test_an_uncertain_start_counts_where_the_signal_is_steep():
    motion, trial, _, fit = fitted()
    for std in (0.01, math.nan):
        start = Estimate(fit.t_start.value, std)
        c = compare(motion, trial, dataclasses.replace(fit, t_start=start), simulated(fit))
        at = np.array(motion.phase) == "accelerate"
        ramp = np.gradient(c.simulated["velocity"], c.t)[at]
        assert np.median(ramp) > 0.5
        late = 0.0 if math.isnan(std) else std * np.abs(ramp)
        away = (c.simulated["velocity"] - c.measured["velocity"])[at]
        expected = np.sqrt(np.mean((away / np.hypot(c.measured_std["velocity"][at], late)) ** 2))
        assert misfit(c, "velocity", "accelerate").normalised == pytest.approx(expected)
