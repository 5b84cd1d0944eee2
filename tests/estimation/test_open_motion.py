"""What nothing in a log closes: biases that drift, limits that are touched, wheels that fall silent."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from granite_lab.estimate import Estimate
from granite_lab.estimation.clock_rate import doubt_rate
from granite_lab.estimation.error_model import V, in_order, updates_of
from granite_lab.estimation.noise import white
from granite_lab.estimation.smoother import Innovations, widening
from granite_lab.estimation.stages import roll, stand, stand_again
from granite_lab.logs import read_trial
from granite_lab.logs.sensors.imu import rail
from granite_lab.parameters import load_robot
from tests.soak import sampled
from tests.truth import faults, generate
from tests.truth.motion import estimate
from tests.truth.trials import Logger, observe, random_body

ROBOT = load_robot("granite", "industrial")
SEEDS = (31, 32, 33)


@pytest.mark.parametrize(("corner", "rate"), [(5.0, 50), (5.0, 20), (20.0, 100), (100.0, 1000)])
def test_noise_behind_a_low_pass_is_as_loud_at_low_frequencies_as_before_it(corner: float, rate: int) -> None:
    """White noise of density 1, behind a second-order low-pass, over standstills of 2 s and 1.5 s."""
    rng, fine = np.random.default_rng(4), 1000
    a, step = np.exp(-2.0 * np.pi * corner / fine), fine // rate
    t = np.arange(0.0, 8.0, 1.0 / rate)
    found = []
    for _ in range(30):
        noise = rng.normal(size=9 * fine) * np.sqrt(fine)
        for _ in range(2):
            noise = lfilter([1.0 - a], [1.0, -a], noise)
        values = noise[fine::step][: t.size]
        found.append(white(t, values, [(0.0, 2.0), (6.5, 8.0)], 1.0))
    assert 0.8 < np.sqrt(np.mean(np.square(found))) < 2.0
    assert np.quantile(found, 0.1) > 0.5


def shaken(limit: float, step: float, seed: int = 5) -> np.ndarray:
    """(2000,) vibration of 1 at 30 Hz with noise in the second half of the time, in steps, within a limit."""
    rng, t = np.random.default_rng(seed), np.arange(2000) / 200.0
    on = (t > 5.0) * (1.0 + 0.3 * np.sin(7.0 * t))
    signal = on * np.sin(2.0 * np.pi * 30.3 * t) + 0.05 * rng.normal(size=t.size)
    return np.clip(np.round(signal / step) * step, -limit, limit)


@pytest.mark.parametrize("step", [1e-6, 1e-3])
def test_a_limit_that_vibration_touches_for_a_sample_at_a_time_is_a_rail(step: float) -> None:
    signal = shaken(0.9, step)
    assert np.array_equal(rail(signal), np.abs(signal) == 0.9)


@pytest.mark.parametrize("step", [1e-6, 1e-3, 0.01, 0.1])
def test_the_largest_reading_of_a_signal_with_room_to_swing_is_no_rail(step: float) -> None:
    assert not any(rail(shaken(9.0, step, seed)).any() for seed in range(20))


@pytest.mark.parametrize(("kind", "widens"), [("zero_rate", True), ("wheel", True), ("reference_v", False)])
def test_innovations_that_wander_by_less_than_their_noise_widen_the_std(kind: str, widens: bool) -> None:
    """A bias that drifts at rest: successive innovations correlate, and hardly exceed their std."""
    n, rng = 80, np.random.default_rng(3)
    ratio = 1.1 * lfilter([np.sqrt(1.0 - 0.6**2)], [1.0, -0.6], rng.normal(size=(40, n)), axis=1)[:, 8:]
    updates = updates_of(kind, np.arange(n - 8), 0.0, {V: 1.0}, 1.0)
    none = np.ones(n - 8), np.zeros((n - 8, 14))
    factors = [widening(Innovations(updates, one, *none)) for one in ratio]
    chance = rng.normal(size=(40, n - 8))
    assert (np.mean(np.array(factors) > 3.0) > 0.6) == widens
    assert np.mean([widening(Innovations(updates, one, *none)) > 1.0 for one in chance]) < 0.05


@pytest.mark.parametrize("referred", [True, False])
def test_wheels_that_wander_against_the_imu_widen_no_std_that_a_reference_gives(referred: bool) -> None:
    """As those of a rover in snow, whose slip goes up and down for seconds."""
    n, rng = 1000, np.random.default_rng(4)
    wander = lfilter([np.sqrt(1.0 - 0.99**2)], [1.0, -0.99], rng.normal(size=n))
    kinds = ("wheel", "reference_v") if referred else ("wheel",)
    updates = in_order([updates_of(kind, np.arange(n), 0.0, {V: 1.0}, 1.0) for kind in kinds])
    ratio = np.where(updates.kind == "wheel", wander[updates.node], rng.normal(size=updates.node.size))
    came = Innovations(updates, ratio, np.ones(ratio.size), np.zeros((ratio.size, 14)))
    assert (widening(came) > 50.0) != referred
    assert not referred or widening(replace(came, value=3.0 * ratio)) == pytest.approx(9.0, rel=0.3)


@pytest.mark.parametrize("side", ["start", "end"])
def test_a_bias_that_changes_where_no_standstill_shows_it_is_never_good(side: str) -> None:
    for seed in sampled(SEEDS, 3):
        truth = generate(seed, velocity=0.3)
        assert truth.trial.imu is not None
        middle = 0.5 * (truth.start + truth.stop)
        after = (truth.trial.imu.t > middle)[:, None]
        imu = replace(truth.trial.imu, specific_force=truth.trial.imu.specific_force + 0.05 * after)
        cut = {"start": truth.start + 1.0} if side == "start" else {"stop": truth.stop - 1.0}
        motion = estimate(faults.cut(replace(truth.trial, imu=imu), **cut), ROBOT)
        assert motion.health.grade != "good"
        assert f"no standstill at the {side}" in motion.health.verdict
        error = motion.slip_ratio.value - truth.slip_ratio_between(*motion.steady)
        assert abs(error) < 2.5 * motion.slip_ratio.std


@pytest.mark.parametrize("offset", [-0.5, 0.0, 0.5])
def test_an_end_is_open_where_the_robot_moves_there_whatever_the_clock_of_the_encoders_says(
    offset: float,
) -> None:
    truth = generate(31, velocity=0.3, clock_offset=offset)
    problem = stand_again(stand(roll(truth.trial, ROBOT)), Estimate(offset))
    begin, rested = float(problem.imu.t[0]), truth.start - 1.5
    for after, ends in ((-0.2, ()), (0.3, ("end",))):  # the log ends so much after the robot sets off [s]
        short = replace(problem.cut(begin, truth.start + after, offset), rests=((begin, rested),))
        assert short.open_ends == ends


def test_slip_while_the_rates_of_all_wheels_are_silent_is_assumed_and_said() -> None:
    truth = generate(31, velocity=0.3)
    wheels = truth.trial.wheels
    assert wheels is not None
    rate = np.gradient(wheels.angle, wheels.t, axis=0)
    whole = replace(truth.trial, wheels=replace(wheels, rate=rate))
    silent = (wheels.t > truth.start + 2.0) & (wheels.t < truth.stop - 1.0)
    lost = replace(truth.trial, wheels=replace(wheels, rate=np.where(silent[:, None], np.nan, rate)))
    assert "no rate of a wheel" not in estimate(whole, ROBOT).health.verdict
    motion = estimate(lost, ROBOT)
    assert motion.health.grade == "fair"
    assert "no rate of a wheel" in motion.health.verdict
    assert motion.slip_ratio.std > 0.05


def test_slow_ramps_of_clocks_that_run_alike_do_not_seem_to_run_apart() -> None:
    """Ramps of two seconds look alike over half a second; those of Table 2 last less than one."""
    for seed in range(4, 8):
        rng = np.random.default_rng(seed)
        body = random_body(rng, velocity=0.6, acceleration=0.27, robot=ROBOT)
        truth = observe(rng, body, ROBOT, name="slow", info=generate(31).trial.info, logger=Logger())
        assert doubt_rate(stand(roll(truth.trial, ROBOT))) == []


def test_a_log_that_is_shorter_than_the_lags_that_are_searched_is_doubtful(tmp_path: Path) -> None:
    """Two tenths of a second: 40 rows of a sample, whose writer was stopped."""
    sample = Path(__file__).parents[2] / "data" / "samples" / "virtual_v0.3_r1.csv"
    log = tmp_path / "short.csv"
    log.write_text("".join(sample.read_text("utf-8").splitlines(keepends=True)[:42]), "utf-8")
    motion = estimate(read_trial(log), load_robot())
    assert motion.health.grade == "poor"
    assert np.isnan(motion.slip_ratio.value)
