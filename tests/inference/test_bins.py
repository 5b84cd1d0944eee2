"""What was measured: bins that simulations go through too, one clock of a logger, noise, and the sensors."""

import dataclasses
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter, lsim

from granite_lab.effects import get
from granite_lab.estimate import Estimate
from granite_lab.estimation.motion import Motion
from granite_lab.inference import binning
from granite_lab.inference.binning import means
from granite_lab.inference.constants import LOW_PASS_STD
from granite_lab.inference.derivatives import differentiate
from granite_lab.inference.noise import STRETCH, at_rest, errors, identify, stretches
from granite_lab.inference.nuisances import SENSORS, TrialModel
from granite_lab.inference.observation import Observation, bin_width, observe
from granite_lab.inference.point import SHARED
from granite_lab.inference.pool import ACCURACY, SAND, SAND_PER_TRIAL, SIGNALS
from granite_lab.inference.problem import Problem
from granite_lab.inference.setup import clock_choices, learnt
from granite_lab.logs.trial import Array, CurrentStream, ImuStream, Trial, TrialInfo, WheelStream
from granite_lab.model.effect import activate
from granite_lab.model.instants import Accuracy
from granite_lab.model.simulator import integrate
from granite_lab.model.symbols import model_parameters
from granite_lab.parameters import GRAVITY, Variant, load_paper, load_robot, load_soil, load_variants
from tests.fitting.made_up import made_up_trial
from tests.inference.stub import PLACE, measured, predicted, problem_of
from tests.truth import faults

VARIANT = load_variants()[3]
START = 2.013
ROBOT = load_robot()
GRID = -1.0 + 0.0025 * np.arange(3400)


def signal(name: str, t: Array) -> Array:
    """A smooth signal of each sensor with corners no bin can follow exactly; at rest before the start."""
    t = np.fmax(t, 0.0)
    k = SIGNALS.index(name)
    if name.startswith("enc"):
        return 7 * (t - 0.1 * (1 - np.exp(-t / 0.1))) + 0.01 * k * np.sin(6 * t)
    return np.sin((5 + k) * t) * np.exp(-t) + (GRAVITY if name == "imu_az_mps2" else 0.0)


def averaged(name: str, t: Array) -> Array:
    """What an IMU shows that integrates over its 5 ms."""
    return np.mean([signal(name, t + shift) for shift in 0.005 * (np.arange(50) - 24.5) / 50], axis=0)


def trial(rng: np.random.Generator, *, jitter: float = 3e-4, end: float = 9.0) -> Trial:
    def stamps(rate: float) -> Array:
        t = np.arange(0.0, end, 1 / rate)
        return t + np.clip(jitter * rng.normal(size=t.size), -0.3 / rate, 0.3 / rate)

    t_imu, t_enc, t_cur = stamps(200), stamps(100), stamps(100)
    force, rate = np.zeros((t_imu.size, 3)), np.zeros((t_imu.size, 3))
    force[:, 0], force[:, 2] = (averaged(n, t_imu - START) for n in ("imu_ax_mps2", "imu_az_mps2"))
    rate[:, 1] = averaged("imu_gy_radps", t_imu - START)
    angle = np.stack([signal(f"enc_{a}_rad", t_enc - START) for a in "ffrr"], axis=1)
    current = np.stack([signal(f"cur_{a}_A", t_cur - START) for a in "ffrr"], axis=1)
    return Trial(
        name="bins",
        info=TrialInfo(v_desired=0.7),
        imu=ImuStream(t_imu, force, rate),
        wheels=WheelStream(t_enc, angle + 0.4),
        currents=CurrentStream(t_cur, current),
    )


def response() -> Array:
    return np.stack([signal(name, GRID) for name in SIGNALS])


def left_over(o: Observation, channel: str, of: Array) -> Array:
    """Measured minus predicted; angles up to the constant from which they are counted, a nuisance."""
    left = o.values[channel] - o.binned(GRID, of, 0.0)[channel]
    return left - np.nanmean(left) if o.streams[channel].is_angle else left


def test_a_perfect_model_leaves_nothing_in_the_bins() -> None:
    o = observe(trial(np.random.default_rng(1)), ROBOT, VARIANT, START)
    for channel in o.streams:
        left = left_over(o, channel, response())
        assert np.nanmax(np.abs(left)) < 1e-4, channel  # interpolation of the grid of 2.5 ms


def test_bins_do_not_depend_on_where_the_samples_fall() -> None:
    trials = [trial(np.random.default_rng(seed), jitter=1e-3) for seed in (1, 2)]
    wrong = response() * 1.01  # an imperfect model must leave the same residual whatever the stamps
    for channel in observe(trials[0], ROBOT, VARIANT, START).streams:
        left = []
        for one in trials:
            o = observe(one, ROBOT, VARIANT, START)
            left.append(left_over(o, channel, wrong))
        scale = np.nanmax(np.abs(left[0]))
        assert np.nanmax(np.abs(left[0] - left[1])) < 0.05 * scale, channel


def test_a_late_start_shifts_the_simulation() -> None:
    o = observe(trial(np.random.default_rng(1)), ROBOT, VARIANT, START - 0.012)
    shifted = o.values["wheel"] - o.binned(GRID, response(), 0.012)["wheel"]
    # the angle counts from the first estimate of the start, where the wheel still stood
    assert np.nanmax(np.abs(shifted)) < 1e-4
    assert np.nanmax(np.abs(o.values["wheel"] - o.binned(GRID, response(), 0.0)["wheel"])) > 0.05


def test_a_jump_of_a_current_is_expected_as_stamps_that_jitter_show_it() -> None:
    """By drawing: the mean of what is read at many instants about each stamp."""
    grid = np.linspace(-1.0, 7.0, 160_001)
    jumped = np.tile((grid > 0.0123).astype(float), (len(SIGNALS), 1))
    drawn = ROBOT.encoders.jitter * np.random.default_rng(1).normal(size=(2000, 1))
    for start in 2.03 - 0.0123 + 1e-4 * np.arange(-5, 6):  # a stamp is about the jump
        o = observe(trial(np.random.default_rng(1), jitter=0.0), ROBOT, VARIANT, start)
        stream = o.streams["current_f"]
        read = np.mean(stream.t + drawn - start > 0.0123, axis=0)
        expected = binning.at_edges_or_between(stream, o.edges) @ read
        assert np.abs(o.binned(grid, jumped, 0.0)["current_f"] - expected).max() < 0.04


def test_a_gap_is_left_out_and_no_more() -> None:
    whole = trial(np.random.default_rng(1))
    keep = (whole.imu.t < 4.0) | (whole.imu.t > 4.3)
    imu = ImuStream(whole.imu.t[keep], whole.imu.specific_force[keep], whole.imu.angular_rate[keep])
    o = observe(dataclasses.replace(whole, imu=imu), ROBOT, VARIANT, START)
    lost = ~np.isfinite(o.values["accel_x"])
    middle = (o.edges[1:] + o.edges[:-1]) / 2
    assert lost[(middle > 4.02) & (middle < 4.28)].all()
    assert not lost[(middle < 3.97) | (middle > 4.33)].any()
    assert np.isfinite(o.values["wheel"]).all()


def test_channels_that_were_not_logged_are_absent() -> None:
    whole = trial(np.random.default_rng(1))
    o = observe(dataclasses.replace(whole, currents=None), ROBOT, VARIANT, START)
    assert set(o.streams) == {"accel_x", "accel_z", "pitch_rate", "wheel", "wheel_split"}
    angle = whole.wheels.angle.copy()
    angle[:, 2:] = np.nan  # no encoders on the rear axle
    o = observe(dataclasses.replace(whole, wheels=WheelStream(whole.wheels.t, angle)), ROBOT, VARIANT, START)
    assert "wheel_split" not in o.streams
    assert np.nanmax(np.abs(left_over(o, "wheel", response()))) < 1e-4


def test_slow_sensors_widen_the_bins() -> None:
    whole = trial(np.random.default_rng(1))
    slow = WheelStream(whole.wheels.t[::5], whole.wheels.angle[::5])
    assert bin_width(whole, ROBOT) == pytest.approx(0.02)
    assert bin_width(dataclasses.replace(whole, wheels=slow), ROBOT) == pytest.approx(0.06)


@given(seed=st.integers(0, 10_000), samples=st.integers(2, 60), rows=st.integers(0, 40))
def test_means_are_the_integrals_of_the_straight_lines(seed: int, samples: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(1e-3, 0.1, samples))
    y = rng.normal(size=samples)
    start = rng.uniform(t[0], t[-1], rows)
    end = np.fmin(start + rng.choice([0.0, 0.02, 1.0], rows), t[-1])
    line = make_interp_spline(t, y, k=1)
    wanted = [
        line.integrate(a, b) / (b - a) if b > a else float(line(a)) for a, b in zip(start, end, strict=True)
    ]
    assert means(t, start, end) @ y == pytest.approx(wanted, rel=1e-9, abs=1e-8)


@pytest.mark.parametrize("offset", [0.0, -0.6e-3, 0.6e-3], ids=lambda x: f"{1e3 * x:g} ms")
@pytest.mark.parametrize("variant", load_variants(), ids=lambda v: f"{v.velocity:g} m/s")
def test_lines_between_instants_of_a_run_show_its_corners_on_time(variant: Variant, offset: float) -> None:
    """Motors and tyres answer a corner of the command within milliseconds; 0.03 ms late was too much.

    A clock that is early shows the answer before the corner, where lines must be as short. What is late
    or early is drawn by lines twice; trials tell a clock's offset to 0.025 ms.
    """
    limit = 1e-5 if offset else 5e-6  # [s]
    p = model_parameters(ROBOT, load_soil(), variant, a_theta=load_paper().a_theta)
    clock = (activate(get("clock_offset"), {"offset": offset}),)
    exact, run = integrate(p, clock, Accuracy(1e-7, 1e-9, 1e-4)), integrate(p, clock, ACCURACY)
    for name in ("imu_ax_mps2", "cur_f_A", "enc_f_rad"):
        ahead = exact[name] - np.interp(exact["t_s"], run["t_s"], run[name])
        rate = np.gradient(exact[name], exact["t_s"])
        ahead, rate = (x[: x.size // 200 * 200].reshape(-1, 200).mean(axis=1) for x in (ahead, rate))
        assert abs(ahead @ rate / (rate @ rate)) < limit


STD = 0.006


@pytest.fixture(scope="module")
def one() -> tuple[Motion, Trial]:
    motion, trial, *_ = made_up_trial(load_variants()[3], 0.8)
    return motion, trial


def moved(one: tuple[Motion, Trial], applied: Sequence[float]) -> tuple[list[Trial], list[Motion]]:
    """Return a trial as often as there are offsets, as estimation leaves it after applying each."""
    motion, trial = one
    trials, motions = [], []
    for by in applied:
        trials.append(faults.late(trial, by))
        start = replace(motion.t_start, value=motion.t_start.value + by)
        motions.append(replace(motion, clock_offset=Estimate(by, STD), clock_applied=by, t_start=start))
    return trials, motions


@pytest.mark.parametrize("applied", [(0.042, 0.036, 0.04, 0.0), (0.0, 0.022, 0.0, 0.0)])
def test_stamps_of_one_logger_are_moved_alike(one: tuple[Motion, Trial], applied: tuple[float, ...]) -> None:
    """Also where one trial alone would have been left as it is, or where it alone was moved."""
    ((trials, motions),) = clock_choices(*moved(one, applied))
    common = float(np.median(applied))
    (expected,), (told,) = moved(one, [common])
    for trial, motion in zip(trials, motions, strict=True):
        assert motion.clock_applied == pytest.approx(common)
        assert motion.t_start.value == pytest.approx(told.t_start.value)
        for stream, wanted in ((trial.wheels, expected.wheels), (trial.currents, expected.currents)):
            np.testing.assert_allclose(stream.t, wanted.t, atol=1e-12)


def test_clocks_that_disagree_were_set_anew_or_are_one(one: tuple[Motion, Trial]) -> None:
    trials, motions = moved(one, (0.3, -0.2, 0.05, 0.12))
    stay, common = clock_choices(trials, motions)
    assert all(a is b for a, b in zip(stay[0], trials, strict=True))
    assert all(a is b for a, b in zip(stay[1], motions, strict=True))
    assert [m.clock_applied for m in common[1]] == pytest.approx([0.085] * 4)


N, WIDTH = 400, 0.02


def speed() -> np.ndarray:
    v = np.zeros(N)
    v[25:300] = np.minimum(1, np.arange(275) / 20)
    v[280:300] = np.linspace(1, 0, 20)
    return v


def slope() -> np.ndarray:
    s = np.zeros(N)
    s[25:30] = 1.0
    return s


def draw(rng: np.random.Generator) -> np.ndarray:
    """White noise of the sensor, a vibration that grows with speed, and jitter at a steep place."""
    vibration = lfilter([1.0], [1.0, 0.9, 0.6], rng.normal(size=N + 100))[100:]
    return 0.3 * rng.normal(size=N) + speed() * vibration + 0.8 * slope() * rng.normal(size=N)


@pytest.fixture(scope="module")
def missing() -> np.ndarray:
    """What the model lacks, the same in every repetition and far above the noise."""
    return 30 * speed() * np.sin(np.arange(N) / 15)


@pytest.mark.parametrize("repetitions", [3, 6])
def test_fresh_noise_comes_out_white(missing: np.ndarray, repetitions: int) -> None:
    rng = np.random.default_rng(repetitions)
    shown = []
    for _ in range(20):
        rows = [missing + draw(rng) for _ in range(repetitions)]
        whitener = identify(rows, speed(), slope(), 1e-3, WIDTH)[0]
        shown.append(whitener(draw(rng)))
    table = np.stack(shown)
    for part in (slice(0, 25), slice(30, 50), slice(50, 280), slice(305, N)):
        assert np.sqrt(np.mean(table[:, part] ** 2)) == pytest.approx(1.0, abs=0.15)
    for lag in (1, 2, 5):
        assert abs(np.mean(table[:, lag:] * table[:, :-lag])) < 0.06
    # the slow part, where effects live: the spectrum must not be thinner than noise there
    slow = np.array([np.sum(row[50:280]) / np.sqrt(230) for row in table])
    assert 0.6 < np.std(slow) < 1.5


def test_one_run_alone_does_not_take_a_slow_effect_for_noise(missing: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    noise = draw(rng)
    whitener = identify([missing / 5 + noise], speed(), slope(), 1e-3, WIDTH)[0]
    signal = whitener(missing / 5)
    assert np.sqrt(np.mean(whitener(noise)[50:280] ** 2)) == pytest.approx(1.0, abs=0.3)
    assert np.sum(signal**2) > 1000


@pytest.mark.parametrize("repetitions", [1, 3])
@pytest.mark.parametrize("share", [1.0, 0.7])
@pytest.mark.parametrize("rate", [20.0, 10.0, 7.0, 4.0, 2.0])
def test_noise_is_learnt_at_any_rate(rate: float, share: float, repetitions: int) -> None:
    """With wide bins no frequency lies above the cut, few bins are in motion and none may reach FAST.

    The noise is white: 1 at rest and 3 at full speed.
    """
    rng = np.random.default_rng(round(10 * rate) + repetitions)
    t = np.arange(-2.0, 8.0, 1 / rate)
    v = share * np.clip(np.minimum(t / 0.5, (4.0 - t) / 0.5), 0.0, 1.0)
    std = np.hypot(1.0, np.sqrt(8.0) * v)
    squares = []
    for _ in range(60):
        rows = list(std * rng.normal(size=(repetitions, t.size)))
        whitener = identify(rows, v, np.zeros(t.size), 1e-3, 1 / rate)[0]
        squares.append(whitener(std * rng.normal(size=t.size)) ** 2)
    table = np.median(squares, axis=0)  # few bins at rest may all be small by chance
    for part in (v == 0, v >= 0.8 * share):
        assert 0.6 < np.sqrt(table[part].mean() / 0.4549) < 1.8  # the median of a squared normal number


def test_run_out_with_another_phase_in_each_trial_is_no_noise() -> None:
    """Five times the noise, in step with the wheels: repetitions differ, the noise is that of the sensor."""
    problem, point, _ = measured(1, commands=(0, 0, 0, 1, 1, 1))
    shown = predicted(problem, point)
    noise = [t.measured - s for t, s in zip(problem.trials, shown, strict=True)]
    places = [(t.channels.index("accel_z"), t.channels.index("wheel")) for t in problem.trials]
    before = learnt(problem, noise)
    residuals = [r.copy() for r in noise]
    for i, (trial, (k, wheel)) in enumerate(zip(problem.trials, places, strict=True)):
        rate = np.gradient(shown[i][wheel])
        run_out = 5 * noise[i][k].std() * rate / rate.max() * np.cos(shown[i][wheel] + 2.1 * i)
        trial.measured[k] += run_out
        residuals[i][k] += run_out
    after = learnt(problem, residuals)
    for i, (k, _) in enumerate(places):
        stds = [whiteners[i][k](noise[i][k]).std() for whiteners in (before, after)]
        assert stds[1] == pytest.approx(stds[0], rel=0.1)


def test_the_noise_of_a_minute_is_white_in_every_stretch_and_takes_little_memory() -> None:
    """A vibration with a memory of several bins; one matrix for all of it would hold nine million numbers."""
    rng, n = np.random.default_rng(8), 3000
    v = np.clip(np.sin(np.arange(n) / 250) + 0.6, 0.0, 1.0)

    def noise() -> np.ndarray:
        return 0.3 * rng.normal(size=n) + v * lfilter([1.0], [1.0, 0.9, 0.6], rng.normal(size=n + 100))[100:]

    whitener = identify([noise() for _ in range(3)], v, np.zeros(n), 1e-3, WIDTH)[0]
    table = np.stack([whitener(noise()) for _ in range(20)])
    for part in stretches(n, WIDTH):
        assert np.sqrt(np.mean(table[:, part] ** 2)) == pytest.approx(1.0, abs=0.15)
    for lag in (1, 2, 5):  # across the cuts, too
        assert abs(np.mean(table[:, lag:] * table[:, :-lag])) < 0.06
    assert sum(f.inverse.size for f in whitener.filters) < n**2 / 14


def test_stretches_cover_a_trial_once_and_a_short_one_is_not_cut() -> None:
    assert stretches(700, WIDTH) == (slice(0, 700),)
    parts = stretches(3001, WIDTH)
    assert np.concatenate([np.arange(p.start, p.stop) for p in parts]).tolist() == list(range(3001))
    assert np.ptp([p.stop - p.start for p in parts]) <= 1
    assert max(p.stop - p.start for p in parts) * WIDTH <= STRETCH


def test_all_commands_together_tell_the_noise_at_rest_better_than_one() -> None:
    """Half a second of three repetitions that look alike by chance was once taken for a quiet sensor."""
    rng = np.random.default_rng(4)
    alone, together = [], []
    for _ in range(60):
        noise = [errors(list(rng.normal(size=(3, 24)))) for _ in range(4)]
        alone.append(at_rest(list(noise[0]), 1e-3, WIDTH).mean())
        together.append(at_rest([row for rows in noise for row in rows], 1e-3, WIDTH).mean())
    assert np.mean(together) == pytest.approx(1.0, abs=0.05)
    assert np.std(together) < 0.65 * np.std(alone)  # half of it, if they were normal numbers


def test_missing_bins_stay_out(missing: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    rows = [missing + draw(rng) for _ in range(3)]
    rows[1][100:120] = np.nan
    whiteners = identify(rows, speed(), slope(), 1e-3, WIDTH)
    assert (whiteners[1](rows[1])[100:120] == 0).all()
    assert np.isfinite(whiteners[1](rows[1])).all()
    assert np.array_equal(whiteners[0](rows[0]), whiteners[2](rows[0]))


def test_what_the_model_lacks_at_a_steep_place_is_no_jitter_of_one_run_alone() -> None:
    """A missing moment shakes the robot where the command has its corners."""
    rng = np.random.default_rng(3)
    missing = 20 * slope() * np.sin(np.arange(N))
    alone = identify([missing + draw(rng)], speed(), slope(), 1e-3, WIDTH)[0]
    assert np.sum(alone(missing) ** 2) > 300
    twice = identify([draw(rng), draw(rng)], speed(), slope(), 1e-3, WIDTH)[0]
    assert (
        np.diag(twice.filters[0].inverse)[25:30].max() < 0.8 * np.diag(alone.filters[0].inverse)[25:30].min()
    )


IMU = ("accel_x", "accel_z", "pitch_rate")
CURRENTS = ("current_f", "current_r")


@pytest.fixture(scope="module")
def problem() -> Problem:
    return problem_of((0, 1))


@pytest.fixture(scope="module")
def logged(problem: Problem) -> TrialModel:
    return problem.trials[1]


@pytest.fixture(scope="module")
def shown(problem: Problem) -> Array:
    found = problem.respond([problem.task(problem.neutral(), 1)])
    return found[0]


@pytest.mark.parametrize("off", [0.0, 0.1])
def test_all_columns_are_those_of_differences(problem: Problem, off: float) -> None:
    """In the files' sand, where a trial's response is that of its command; with gains, a tilt, a delay and an
    IMU that sits elsewhere, too."""
    point = problem.neutral()
    for name, value in (("arm_x", 0.5), ("arm_z", -0.4), ("latency", 0.03)):
        point.shared[SHARED.index(name)] = value * off
    for t, x in zip(problem.trials, point.trials, strict=True):
        x[[s.name == "tilt" or s.name.endswith(" gain") for s in t.slacks]] = off
    derivatives = differentiate(problem, point)
    first = np.cumsum([0, *(x.size for x in point.trials)])
    for i, t in enumerate(problem.trials):
        columns = problem.columns(i, point, derivatives)
        places = [*range(first[i], first[i + 1]), *range(first[-1], first[-1] + len(SHARED))]
        names = [*(s.name for s in t.slacks), *SHARED]
        assert columns.shape[1] == len(places)
        for name, place, column in zip(names, places, columns.T, strict=True):
            if name == "low_pass":
                continue  # at its bound
            h = 5e-4
            step = h * (np.arange(point.vector.size) == place)
            up, down = (predicted(problem, problem.stepped(point, s * step))[i].ravel() for s in (1, -1))
            wanted = (up - down) / (2 * h)
            assert np.abs(column - wanted).max() < 0.03 * np.abs(wanted).max() + 1e-9, name


def test_a_point_and_its_derivatives_take_each_matrix_once(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of((0,))
    (logged,), point, made = problem.trials, problem.neutral(), []
    (response,), derivatives = problem.respond([problem.task(point, 0)]), differentiate(problem, point)
    again = binning._Group.to_stamps

    def counted(group: binning._Group, t: Array, *shift: float) -> object:
        made.append((group.names, t.size, shift))
        return again(group, t, *shift)

    monkeypatch.setattr(binning._Group, "to_stamps", counted)
    logged.observation.binned._matrices.clear()
    first, second = (
        (logged.predict(response, point.trials[0], point.sensors), problem.columns(0, point, derivatives))
        for _ in range(2)
    )
    assert len(made) == len(set(made)) > 5
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("spread", [0.0, 2e-5])
def test_a_low_pass_moves_the_imu_alone_and_its_column_is_a_difference(
    problem: Problem, spread: float
) -> None:
    point, k = problem.neutral(), SHARED.index("low_pass")
    point.shared[k] = spread
    before = int(sum(x.size for x in point.trials))
    column = problem.columns(1, point, differentiate(problem, point))[:, point.trials[1].size + k]
    step = LOW_PASS_STD / 8 * (np.arange(point.vector.size) == before + k)
    up, down = (problem.stepped(point, sign * step) for sign in (1, -1))
    apart = up.shared[k] - down.shared[k]
    wanted = (predicted(problem, up)[1] - predicted(problem, down)[1]) / apart
    assert column.reshape(wanted.shape) == pytest.approx(wanted, abs=1e-6 * np.abs(wanted).max())
    moved = {c for c, row in zip(problem.trials[1].channels, wanted, strict=True) if np.abs(row).max() > 0}
    assert moved == set(IMU)


@pytest.mark.parametrize("cut_off", [15.0, 30.0])
def test_a_low_pass_of_first_order_is_a_latency_and_a_spread(
    logged: TrialModel, shown: Array, cut_off: float
) -> None:
    """The signals of the stub are slower than 3 Hz; the filter is integrated by another program."""
    τ, x, sensors = 1 / (2 * np.pi * cut_off), np.zeros(logged.size), np.zeros(len(SENSORS))
    fine = np.arange(logged.t[0], logged.t[-1], 1e-4)
    rate = 0.05 * np.sin(8 * fine) * (fine > 0)
    _, slow, _ = lsim(([1.0], [τ, 1.0]), rate, fine - fine[0])
    response, filtered = shown.copy(), shown.copy()
    response[2], filtered[2] = np.interp(logged.t, fine, rate), np.interp(logged.t, fine, slow)
    plain = logged.bins_of(response, x, sensors)["pitch_rate"]
    sensors[SENSORS.index("latency")] = τ
    late = logged.bins_of(response, x, sensors)["pitch_rate"]
    sensors[SENSORS.index("low_pass")] = τ**2
    both = logged.bins_of(response, x, sensors)["pitch_rate"]
    wanted = logged.bins_of(filtered, x, np.zeros(len(SENSORS)))["pitch_rate"]
    errors = [np.sqrt(np.mean((found - wanted) ** 2)) for found in (plain, late, both)]
    assert errors[2] < 0.4 * errors[1] < 0.4 * errors[0]


@pytest.mark.parametrize(("name", "own"), [("latency", IMU), ("current_latency", CURRENTS)])
def test_a_latency_moves_the_channels_of_its_sensor_alone(
    logged: TrialModel, shown: Array, name: str, own: tuple[str, ...]
) -> None:
    x, none, late = np.zeros(logged.size), np.zeros(len(SENSORS)), np.zeros(len(SENSORS))
    late[SENSORS.index(name)] = 0.004
    now, later = logged.predict(shown, x, none), logged.predict(shown, x, late)
    for k, c in enumerate(logged.channels):
        if c not in own:
            assert np.array_equal(now[k], later[k]), c
    shifted = np.stack([np.interp(logged.t - 0.004, logged.t, s) for s in shown])
    wanted = logged.predict(shifted, x, none)
    for c in own:
        k = logged.channels.index(c)
        change = np.abs(later[k] - now[k]).max()
        assert np.abs(later[k] - wanted[k]).max() < 0.05 * change, c


def test_an_imu_further_forward_feels_the_pitching(logged: TrialModel, shown: Array) -> None:
    """A rigid body: x forward, z up, Θ positive nose down; ω̇ × r for r = (x, 0, z)."""
    x = np.zeros(logged.size)
    now = logged.predict(shown, x, np.zeros(len(SENSORS)))
    pitching = logged.bins_of(
        np.stack([np.gradient(shown[2], logged.t)] * 2 + [*shown[2:]]), x, np.zeros(len(SENSORS))
    )["accel_x"]
    for name, channel, sign in (("arm_z", "accel_x", 1.0), ("arm_x", "accel_z", -1.0)):
        sensors = np.zeros(len(SENSORS))
        sensors[SENSORS.index(name)] = 0.02
        change = logged.predict(shown, x, sensors) - now
        for k, c in enumerate(logged.channels):
            wanted = sign * 0.02 * pitching if c == channel else np.zeros_like(pitching)
            assert change[k] == pytest.approx(wanted, abs=1e-12), (name, c)


def test_a_tilted_imu_turns_forces_and_keeps_their_size(logged: TrialModel, shown: Array) -> None:
    x = np.zeros(logged.size)
    x[[s.name for s in logged.slacks].index("tilt")] = 0.01
    plain = logged.predict(shown, np.zeros(logged.size), np.zeros(len(SENSORS)))
    tilted = logged.predict(shown, x, np.zeros(len(SENSORS)))
    k, j = (logged.channels.index(c) for c in ("accel_x", "accel_z"))
    before, after = np.hypot(plain[k], plain[j]), np.hypot(tilted[k], tilted[j])
    assert after == pytest.approx(before, rel=1e-4)
    assert tilted[k][0] == pytest.approx(plain[k][0] - 0.0981, abs=1e-6)


def test_a_trial_without_a_sensor_has_none_of_its_numbers() -> None:
    names = {s.name for s in problem_of((0,), ("wheel", "current_f")).trials[0].slacks}
    everything = {s.name for s in problem_of((0,), tuple(PLACE)).trials[0].slacks}
    assert {"tilt", "accel_x gain", "current_r gain"} <= everything - names
    assert {*SAND[:SAND_PER_TRIAL], "start", "wheel gain", "current_f gain"} <= names
