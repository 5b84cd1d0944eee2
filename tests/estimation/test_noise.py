"""Noise, vibration and scatter of the slip are heard in the trial itself, and taken for nothing else."""

import dataclasses

import numpy as np
import pytest
from scipy.special import softmax

from granite_lab.estimation import slip, white
from granite_lab.estimation.error_model import SlipModel
from granite_lab.estimation.motion import Motion
from granite_lab.estimation.nodes import heading
from granite_lab.estimation.nominal import Nominal, quieten
from granite_lab.parameters import load_robot
from tests.soak import SOAK, sampled
from tests.truth import TruthTrial, generate
from tests.truth.long_logs import Drive, cycles, drive
from tests.truth.motion import estimate

SEEDS = (11, 12)


def louder(truth: TruthTrial, grade: str, seed: int, *, force: float = 0.0, pitch: float = 0.0) -> Motion:
    """Estimate a trial whose IMU has more white noise in motion [m/s^2 sqrt(s)], [rad/s sqrt(s)]."""
    robot, imu, rng = load_robot("granite", grade), truth.trial.imu, np.random.default_rng(seed)
    moving = np.sqrt(robot.imu_grade.rate) * ((imu.t > truth.start) & (imu.t < truth.stop + 0.2))
    shaken, turned = imu.specific_force.copy(), imu.angular_rate.copy()
    if force:
        shaken += force * moving[:, None] * rng.standard_normal(shaken.shape)
    if pitch:
        turned[:, 1] += pitch * moving * rng.standard_normal(imu.t.size)
    stream = dataclasses.replace(imu, specific_force=shaken, angular_rate=turned)
    return estimate(dataclasses.replace(truth.trial, imu=stream), robot)


def nees(motion: Motion, truth: TruthTrial) -> float:
    error, std = truth.errors(motion)
    return float(np.mean((error / std) ** 2))


@pytest.mark.parametrize("grade", sampled(["industrial", "consumer"]))
def test_the_uncertainty_grows_with_noise_that_is_ten_times_as_loud_in_motion(grade: str) -> None:
    """Without it NEES is 21 to 27. Two trials' mean of a NEES of 1 lies within 0.1 and 3."""
    found, loud = [], []
    for seed in SEEDS:
        truth = generate(seed, velocity=0.3, duration=15.0, grade=grade)
        once = load_robot("granite", grade).imu_grade.accel_noise
        motion = louder(truth, grade, seed, force=once * np.sqrt(0.5 * (10.0**2 - 1.0)))
        noise = motion.noise
        assert 6.0 < noise["accel_noise_in_motion_mps2_sqrts"] / noise["accel_noise_mps2_sqrts"] < 15.0
        found.append(nees(motion, truth))
        loud.append(np.median(motion.v_std))
    assert 0.1 < np.mean(found) < 3.0
    quiet = louder(truth, grade, seed)
    assert loud[-1] > 1.5 * np.median(quiet.v_std)


@pytest.mark.parametrize(
    ("grade", "velocity"), sampled([("industrial", 0.3), ("industrial", 0.5), ("consumer", 0.7)])
)
def test_vibration_alone_is_not_taken_for_white_noise(grade: str, velocity: float) -> None:
    truth = generate(21, velocity=velocity, duration=15.0, grade=grade)
    motion = estimate(truth.trial, load_robot("granite", grade))
    assert motion.noise["vibration_mps2"] > 0.05
    # sampled 100 times a second without a filter, vibration folds: by less than the noise at rest
    most = motion.noise["accel_noise_mps2_sqrts"] if grade == "consumer" else 0.0
    assert motion.noise["accel_noise_in_motion_mps2_sqrts"] <= most


def level(frequency: np.ndarray, density: np.ndarray, seed: int) -> float:
    """The white noise found in a periodogram whose ordinates scatter exponentially about its density."""
    seen = density * np.random.default_rng(seed).exponential(size=frequency.size)
    found = white.levels(frequency, seen)
    return float(softmax(np.logaddexp(found.flat, found.rising)) @ found.white)


@pytest.mark.parametrize("top", [3.5, 7.0, 35.0, 175.0])
@pytest.mark.parametrize("size", [10.0, 1000.0])
def test_a_flat_spectrum_is_white_noise_at_any_sampling_rate(top: float, size: float) -> None:
    """Logs of 28 s at 10 to 500 Hz: half of the ordinates are independent, so 50 know it to some 20 %."""
    frequency = np.arange(0.15, top, 1.0 / 28.0)
    for seed in SEEDS:
        assert 0.7 * size < level(frequency, np.full(frequency.size, size), seed) < 1.4 * size


def resonator(frequency: np.ndarray, resonance: float, damping: float = 0.1) -> np.ndarray:
    """Density of the acceleration of a resonator that is shaken by a force, 1 far above the resonance."""
    r = frequency / resonance
    return r**4 / ((1.0 - r**2) ** 2 + (2.0 * damping * r) ** 2)


@pytest.mark.parametrize("resonance", [8.0, 15.0, 25.0])
def test_vibration_whose_resonance_is_seen_adds_no_white_noise(resonance: float) -> None:
    frequency = np.arange(0.5, 70.0, 1.0 / 8.0)
    for seed in SEEDS:
        assert level(frequency, 1.0 + 1e4 * resonator(frequency, resonance), seed) < 10.0


@pytest.mark.parametrize("resonance", [6.0, 15.0, 25.0])
def test_white_noise_is_found_below_vibration(resonance: float) -> None:
    frequency = np.arange(0.15, 35.0, 1.0 / 28.0)
    for seed in SEEDS:
        assert 60.0 < level(frequency, 100.0 + 1e4 * resonator(frequency, resonance), seed) < 250.0


def test_motion_below_the_vibration_is_not_taken_for_white_noise() -> None:
    frequency = np.arange(0.15, 70.0, 1.0 / 28.0)
    motion = 1e3 / (1.0 + (frequency / 0.5) ** 6)
    for seed in SEEDS:
        assert level(frequency, 1.0 + motion + 1e4 * resonator(frequency, 25.0), seed) < 3.0


def test_a_gyro_shows_how_the_body_turns_and_only_a_flat_spectrum_is_its_noise() -> None:
    frequency = np.arange(0.15, 35.0, 1.0 / 28.0)
    scatter = np.random.default_rng(1).exponential(size=frequency.size)
    rest = 1e-3
    flat, turning = (2.0 * rest**2 * density * scatter for density in (100.0, 3.0 + 5.0 * frequency))
    assert white.white_in_motion(frequency, flat, rest, turns=True) == pytest.approx(1e-2, rel=0.2)
    assert white.white_in_motion(frequency, turning, rest, turns=True) == 0.0


def test_a_gyro_that_loses_the_pitch_in_motion_widens_the_std_and_is_named() -> None:
    """Ten times the noise at rest, as rough ground gave the rover Pathfinder.

    Such a walk of the pitch, 30 s long, shows in its end alone: in about one trial of four too little.
    """
    found = []
    seeds = (1, 2, 3, 4, 5, 6) if SOAK else (1, 2)
    for seed in seeds:
        truth = generate(seed, velocity=0.3, duration=30.0, grade="industrial")
        motion = louder(truth, "industrial", seed, pitch=1e-3)
        named = "pitch gyro" in motion.health.verdict
        assert named == (motion.health.grade == "fair")
        found.append((named, nees(motion, truth)))
    assert sum(named for named, _ in found) >= len(seeds) / 2
    assert np.mean([size for named, size in found if named]) < 3.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_direction_of_a_robot_that_hardly_moves_is_no_matter_of_rounding(sign: float) -> None:
    """Slip would change its sign at every zero, and the std of the velocity at arrival with it."""
    trapezoid = sign * np.interp(np.arange(100.0), [10.0, 30.0, 70.0, 90.0], [0.0, 0.5, 0.5, 0.0])
    for seed in range(5):
        rounding = 1e-16 * np.random.default_rng(seed).standard_normal(100)
        assert (heading(trapezoid + rounding) == sign).all()
    there_and_back = np.concatenate([trapezoid, -trapezoid])
    assert np.flatnonzero(np.diff(heading(there_and_back))).tolist() == [110]  # where it drives off again
    assert heading(np.zeros(3)).tolist() == [1.0, 1.0, 1.0]


def test_a_gyro_that_keeps_the_pitch_is_not_blamed() -> None:
    for seed in (1, 2, 3) if SOAK else (1,):
        motion = louder(generate(seed, velocity=0.3, duration=30.0), "industrial", seed)
        assert motion.health.grade == "good"


T = np.arange(0.0, 10.0, 0.005)
SHAKE = 25.0
REST = (T < 1.0) | (T > 9.0)
STEADY = (T > 2.0) & (T < 8.0)
CORE = (T > 2.3) & (T < 7.7)


def going(v: np.ndarray) -> Nominal:
    zero = np.zeros(T.size)
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(T))])
    return Nominal(T, REST, x, v, zero, zero, 0.0, 0.0, zero + 9.81, 0.0)


def motion() -> np.ndarray:
    """Up, steady with the slow oscillation that slip makes, and down."""
    return np.interp(T, [1.0, 1.6, 8.4, 9.0], [0.0, 0.5, 0.5, 0.0]) + np.where(
        REST, 0.0, 0.01 * np.sin(2 * np.pi * 1.2 * T) * np.clip((T - 1.0), 0.0, 1.0)
    )


def test_vibration_goes_and_motion_ramps_and_standstill_stay() -> None:
    shake = np.where(REST, 0.0, 0.002 * np.sin(2 * np.pi * SHAKE * T))
    before = going(motion() + shake)
    found = quieten(before, STEADY, SHAKE)
    assert np.sqrt(np.mean((found.v - motion())[CORE] ** 2)) < 1e-4
    assert found.vibration_left[CORE].max() < 0.2
    assert np.array_equal(found.v[~STEADY], before.v[~STEADY])
    assert found.vibration_left[~STEADY] == pytest.approx(1.0)


def test_distance_is_the_integral_of_the_velocity_and_ends_where_it_did() -> None:
    rng = np.random.default_rng(0)
    before = going(motion() + np.where(REST, 0.0, rng.normal(0, 0.002, T.size)))
    found = quieten(before, STEADY, SHAKE)
    assert np.gradient(found.x, T)[CORE] == pytest.approx(found.v[CORE], abs=2e-4)
    assert found.x[-1] == pytest.approx(before.x[-1], abs=5e-5)


def test_what_is_left_of_slower_shaking_is_told() -> None:
    """Shaking of 8 Hz is not told from motion by a smoothing made for 25 Hz: its doubt stays."""
    slow = np.where(REST, 0.0, 0.002 * np.sin(2 * np.pi * 8.0 * T))
    found = quieten(going(motion() + slow), STEADY, SHAKE)
    left = np.sqrt(np.mean((found.v - motion())[CORE] ** 2) / np.mean(slow[CORE] ** 2))
    assert found.vibration_left[CORE].mean() == pytest.approx(left, rel=0.3)


def test_without_steady_motion_or_by_a_shake_too_slow_to_be_told_from_it_nothing_changes() -> None:
    before = going(motion())
    assert quieten(before, np.zeros(T.size, dtype=bool), SHAKE) is before
    assert quieten(before, STEADY, 6.5) is before


@pytest.mark.parametrize("mean", [0.006, 0.012, 0.03])
@pytest.mark.parametrize("spread", [0.1, 0.4])
def test_variance_is_the_mean_over_the_posterior(mean: float, spread: float) -> None:
    """A log-normal posterior of the scatter, sampled."""
    peak = np.log(mean)
    places = np.round((peak - np.log(0.01)) / np.log(2.0)) + np.array([-1.0, 0.0, 1.0])
    scores = [-0.5 * ((np.log(0.01 * 2.0**p) - peak) / spread) ** 2 for p in places]
    found = slip.expected(int(places[1]), *scores)
    draws = np.exp(np.random.default_rng(0).normal(peak, spread, 400_000))
    assert found == pytest.approx(np.sqrt(np.mean(draws**2)), rel=0.01)


def test_scatter_stays_within_its_bounds_where_the_likelihood_tells_nothing() -> None:
    for best, scores in ((-6, (0.0, 0.0, 0.0)), (6, (0.0, 0.0, 0.0)), (0, (-1e-6, 0.0, -1e-6))):
        assert slip.LEAST_SCATTER <= slip.expected(best, *scores) <= slip.MOST_SCATTER


def found_in(truth: Drive, monkeypatch: pytest.MonkeyPatch) -> float:
    """The scatter that the estimation of a drive settles on."""
    found: list[SlipModel] = []
    original = slip.identify_scatter

    def spy(problem, offset):
        found.append(original(problem, offset))
        return found[-1]

    monkeypatch.setattr("granite_lab.estimation.stages.identify_scatter", spy)
    estimate(truth.trial, load_robot("granite", "industrial"))
    return found[-1].scatter


def test_sand_that_scatters_more_is_heard_to_do_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """The truth wanders within half a second, smoothly; what counts is its speed of change."""
    calm, rough = (
        found_in(drive(3, cycles(1, 16.0), scatter=scatter, accel=3e-4, gyro=2e-5), monkeypatch)
        for scatter in (0.005, 0.03)
    )
    assert rough / calm == pytest.approx(6.0, rel=0.5)
