"""Optional aids, and what the filter says of its own health."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from granite_lab.errors import EstimateError
from granite_lab.estimate import Estimate
from granite_lab.estimation import Motion, judge
from granite_lab.estimation.health import ljung_box
from granite_lab.estimation.smoother import correlation, slow_excess, usual
from granite_lab.logs.trial import Series, Trial
from granite_lab.parameters import load_robot
from tests.soak import sampled
from tests.truth.motion import estimate
from tests.truth.trials import TruthTrial, generate


@cache
def truth() -> TruthTrial:
    return generate(71, velocity=0.3, grade="consumer", clock_offset=0.02, reference=True)


@cache
def plain() -> Motion:
    return run(truth().trial)


def run(trial: Trial, **aids: object) -> Motion:
    return estimate(trial, load_robot("granite", "consumer"), **aids)


def travelled(motion: Motion) -> float:
    return float(truth().at(motion.t[-1], "x") - truth().at(motion.t[0], "x"))


def test_measured_distance_makes_the_estimate_surer_and_better() -> None:
    motion = run(truth().trial, distance_measured=Estimate(travelled(plain()), 0.005))
    assert motion.distance.std < 0.006 < plain().distance.std
    assert abs(motion.distance.value - travelled(plain())) < 0.01
    assert motion.v_std.mean() < plain().v_std.mean()
    assert motion.slip_ratio.std < plain().slip_ratio.std
    before, after = (np.mean((m.v - truth().at(m.t, "v")) ** 2) for m in (plain(), motion))
    assert after < before


def test_measured_distance_pulls_by_its_weight() -> None:
    """The pull is that of two estimates of one quantity, weighted by their variances."""
    own, std = plain().distance.value, plain().distance.std
    for measured in sampled((own + std, own - std)):
        pulled = run(truth().trial, distance_measured=Estimate(measured, std)).distance
        assert pulled.value == pytest.approx(0.5 * (own + measured), abs=0.1 * std)
        assert pulled.std == pytest.approx(std / np.sqrt(2), rel=0.05)


def test_measured_distance_that_contradicts_the_sensors_is_told() -> None:
    motion = run(truth().trial, distance_measured=Estimate(travelled(plain()) + 0.5, 0.005))
    assert motion.health.nis["distance"] > 50
    assert not motion.health.good
    assert "the measured distance" in motion.health.verdict


def test_judge_measures_against_the_reference_and_the_wheels() -> None:
    velocity, distance = judge(plain(), truth().trial)
    reference = truth().trial.reference_v
    error = np.interp(reference.t, plain().t, plain().v) - reference.value
    inside = (reference.t >= plain().t[0]) & (reference.t <= plain().t[-1])
    assert velocity.rmse == pytest.approx(np.sqrt(np.mean(error[inside] ** 2)), rel=1e-6)
    assert velocity.bias == pytest.approx(np.mean(error[inside]), abs=1e-9)
    assert velocity.rmse_wheels > 2 * velocity.rmse
    assert distance.quantity == "distance"
    shifted = replace(truth().trial, reference_v=Series(reference.t, reference.value + 0.1), reference_x=None)
    (off,) = judge(plain(), shifted)
    assert off.bias == pytest.approx(velocity.bias - 0.1, abs=1e-9)
    assert off.coverage < 0.1
    assert off.nees > 100


def test_reference_never_enters_the_estimate() -> None:
    without = replace(truth().trial, reference_v=None, reference_x=None)
    assert np.array_equal(run(without).v, plain().v)
    with pytest.raises(EstimateError, match="no external reference"):
        judge(plain(), without)
    late = replace(truth().trial, reference_x=None, reference_v=Series(np.array([90.0, 91.0]), np.zeros(2)))
    with pytest.raises(EstimateError, match="does not overlap"):
        judge(plain(), late)


def test_health_holds_what_the_report_draws() -> None:
    health = plain().health
    n = plain().t.size
    assert health.t.size == len(health.kind) == health.innovation.size == health.innovation_std.size > 300
    assert (np.diff(health.t) >= 0).all()
    assert (health.innovation_std > 0).all()
    assert set(health.nis) == set(health.kind) == {"zero_velocity", "zero_rate", "specific_force", "wheel"}
    for bias in (health.accel_bias, health.accel_bias_std, health.gyro_bias, health.gyro_bias_std):
        assert bias.shape == (n,)
        assert np.isfinite(bias).all()
    error = health.gyro_bias - truth().gyro_bias[1]
    assert np.mean(np.abs(error) < 3 * health.gyro_bias_std) > 0.9
    assert len(health.rests) == 2
    assert health.rests[0][1] == pytest.approx(truth().start, abs=0.15)
    acted = np.array([t for t, kind in zip(health.t, health.kind, strict=True) if kind == "zero_velocity"])
    assert all(any(a - 1e-9 <= t <= b + 1e-9 for a, b in health.rests) for t in acted)
    for kind in ("zero_rate", "specific_force", "wheel"):
        assert 0.3 < health.nis[kind] < 2.0
    assert health.verdict.startswith(
        "The estimate can be trusted: velocity is anchored at both ends, by 2 standstills"
    )


def test_verdict_on_a_bias_that_drifts() -> None:
    imu = truth().trial.imu
    drift = 0.02 * (imu.t - imu.t[0])[:, None] / imu.t[-1]
    motion = run(replace(truth().trial, imu=replace(imu, angular_rate=imu.angular_rate + drift)))
    assert not motion.health.good
    assert "biases changed" in motion.health.verdict or "drifts" in motion.health.verdict
    error, std = truth().errors(motion)
    assert np.mean(np.abs(error) < 2 * std) > 0.9
    assert motion.v_std.mean() > plain().v_std.mean()


def test_correlation_and_ljung_box_tell_white_from_coloured() -> None:
    rng = np.random.default_rng(0)
    chances = np.array([ljung_box(rng.standard_normal(400)) for _ in range(400)])
    # the probability of a true hypothesis is uniform: Kolmogorov's bound at 0.1 %
    deviation = np.abs(np.sort(chances) - (np.arange(400) + 0.5) / 400).max()
    assert deviation < 1.95 / np.sqrt(400)
    white = rng.standard_normal(2000)
    coloured = white[1:] + 0.3 * white[:-1]
    assert correlation(coloured) == pytest.approx(0.3 / 1.09, abs=0.07)
    assert ljung_box(coloured) < 1e-6
    assert np.isnan(ljung_box(white[:20]))


def test_slow_innovations_are_judged_by_what_adds_up() -> None:
    """The variance of means over many samples is that of white noise, times (1 + r) / (1 - r)."""
    rng = np.random.default_rng(2)
    white = rng.standard_normal(4000)
    assert slow_excess(white) == pytest.approx(1.0, abs=0.15)
    wander = 0.5 * np.sqrt(1.0 - 0.9**2) * lfilter([1.0], [1.0, -0.9], white)
    assert np.mean(wander**2) < 0.5
    means = wander.reshape(-1, 100).mean(axis=1)
    assert slow_excess(wander) == pytest.approx(0.25 * 19.0, rel=0.25)
    assert slow_excess(wander) == pytest.approx(100 * np.var(means), rel=0.6)
    assert slow_excess(white[:4]) == 0.0


def test_usual_nis_is_the_quantile_of_many_draws() -> None:
    rng = np.random.default_rng(1)
    for n in (1, 2, 30):
        draws = np.mean(rng.standard_normal((100_000, n)) ** 2, axis=1)
        assert np.mean(draws > usual(n)) == pytest.approx(0.001, abs=0.0004)
