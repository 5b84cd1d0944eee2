"""Faults injected into good trials: corrected, they are the good trial; else within the std, or refused."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from granite_lab.errors import EstimateError
from granite_lab.estimation import Motion, correct
from granite_lab.logs.trial import Trial, part
from granite_lab.parameters import WHEELS, Robot, load_robot, load_soil
from tests.soak import SOAK, in_turn, sampled
from tests.truth import faults
from tests.truth.motion import estimate
from tests.truth.trials import TruthTrial, generate
from tests.truth.trials import robot as mounted

Fault = Callable[[TruthTrial], Trial]

KINDS = (("industrial", 0.3), ("consumer", 0.5))
"""Grade and velocity of the trials that faults are injected into."""

BOTH = tuple(range(len(KINDS)))


@cache
def good(i: int) -> TruthTrial:
    grade, velocity = KINDS[i]
    return generate(700 + i, velocity=velocity, grade=grade, clock_offset=0.01)


def robot(i: int) -> Robot:
    return load_robot("granite", KINDS[i][0])


def hold(
    fault: Fault, trials: Sequence[int] = BOTH, *, grown: float = 0.0, slip: bool = True, said: str = ""
) -> list[tuple[Trial, Motion]]:
    """Inject a fault into trials, hold the estimates against their own std, and return them.

    Args:
        fault: what goes wrong.
        trials: their numbers.
        grown: the std of v must be so many times that of the good trial.
        slip: λ_R is defined.
        said: text that one of the warnings must contain.
    """
    inside, done = [], []
    for i in trials:
        truth = good(i)
        clean, motion = correct(fault(truth), robot(i))
        done.append((clean, motion))
        error, std = truth.errors(motion)
        assert np.isfinite(error).all()
        inside.append(np.abs(error) < 2 * std)
        travelled = float(truth.at(motion.t[-1], "x") - truth.at(motion.t[0], "x"))
        assert abs(motion.distance.value - travelled) < 3 * motion.distance.std
        if slip:
            true = truth.slip_ratio_between(*motion.steady)
            assert abs(motion.slip_ratio.value - true) < 3 * motion.slip_ratio.std
        if said:
            assert any(said in line for line in motion.warnings), motion.warnings
        if grown:
            assert np.mean(std) > grown * np.mean(truth.errors(plain(i))[1])
    assert np.mean(np.concatenate(inside)) >= 0.9
    return done


@cache
def corrected(i: int) -> tuple[Trial, Motion]:
    return correct(good(i).trial, robot(i))


def plain(i: int) -> Motion:
    return corrected(i)[1]


def ramp(truth: TruthTrial) -> tuple[float, float]:
    """Start and end of the commanded acceleration [s]."""
    info = truth.trial.info
    return truth.start, truth.start + info.v_desired / info.a_max


def blanked(truth: TruthTrial, begin: float, end: float, *columns: int) -> Trial:
    """Write NaN into columns of the IMU (0-2 force, 3-5 rate) between two instants."""
    imu = truth.trial.imu
    both = np.hstack([imu.specific_force, imu.angular_rate])
    both[np.ix_((imu.t > begin) & (imu.t < end), columns)] = np.nan
    return replace(truth.trial, imu=replace(imu, specific_force=both[:, :3], angular_rate=both[:, 3:]))


# the fault, by how much it makes the std of v grow at least, and what is said
SURVIVED: dict[str, tuple[Fault, float, str]] = {
    "a short gap of the IMU": (lambda d: faults.imu_dropout(d.trial, 5.0, 5.1), 1.02, "1 gap in the IMU"),
    "a gap of the IMU": (lambda d: faults.imu_dropout(d.trial, 5.0, 5.3), 1.02, "1 gap in the IMU"),
    "over the ramp": (lambda d: faults.imu_dropout(d.trial, ramp(d)[0] + 0.05, ramp(d)[1]), 1.5, "1 gap"),
    "a long gap at rest": (lambda d: faults.imu_dropout(d.trial, 0.6, 1.3), 0.0, ""),
    "single samples lost": (lambda d: faults.random_dropouts(d.trial, 5, 0.1), 0.0, ""),
    "a gap of the encoders": (lambda d: faults.wheel_dropout(d.trial, 5.0, 5.5), 0.0, ""),
    "x not a number": (lambda d: blanked(d, 5.0, 5.3, 0), 1.02, "in the IMU's samples"),
    "pitch rate not a number": (lambda d: blanked(d, 5.0, 5.3, 4), 1.02, "in the IMU's samples"),
    "the IMU not a number": (lambda d: blanked(d, 5.0, 5.3, *range(6)), 1.02, "in the IMU's samples"),
    "no pitch gyro": (lambda d: blanked(d, -1.0, 99.0, 4), 3.0, "no pitch rate"),
    "cut at a rail": (lambda d: faults.saturated(d.trial, 0.6 * d.trial.info.a_max), 3.0, "at its limit"),
    "readings thrown off": (lambda d: faults.spikes(d.trial, 3, 8, 30.0), 0.0, "thrown off"),
    "a restart in motion": (lambda d: faults.imu_restart(d.trial, 5.0, gap=0.2), 1.02, "a restart"),
    "a jump in motion": (lambda d: faults.imu_restart(d.trial, 5.0, gap=0.0), 1.02, "a restart"),
    "an encoder that never counts": (
        lambda d: faults.dead_encoder(d.trial, "fr", 0.0, 99.0), 0.0, "encoder fr gives no counts",
    ),
    "gravity removed": (lambda d: d.without_gravity(), 2.0, "gravity was removed by the logger"),
    "gravity removed by 0.3 deg": (
        lambda d: d.without_gravity(np.radians(0.3)), 2.0, "gravity was removed by the logger",
    ),
}  # fmt: skip


ALIKE = {
    "a short gap of the IMU": "a gap of the IMU",
    "x not a number": "pitch rate not a number",
    "the IMU not a number": "pitch rate not a number",
    "a jump in motion": "a restart in motion",
    "a restart in motion": "the test of what it leaves in the trial",
    "gravity removed": "the test of what is put back",
    "readings thrown off": "the test of what is left out",
}
"""What another one, or another test, shows outside of `make soak`."""


@pytest.mark.parametrize(
    ("name", "trial"), in_turn([name for name in SURVIVED if SOAK or name not in ALIKE], BOTH)
)
def test_what_is_survived_is_said_and_in_the_std(name: str, trial: int) -> None:
    fault, grown, said = SURVIVED[name]
    hold(fault, [trial], grown=grown, said=said)


@pytest.mark.parametrize("fault", [
    lambda d: faults.imu_dropout(d.trial, 5.0, 5.6),
    lambda d: blanked(d, 5.0, 5.7, 0, 1, 2, 3, 4, 5),
])  # fmt: skip
def test_long_gap_in_motion_is_refused(fault: Fault) -> None:
    with pytest.raises(
        EstimateError, match=r"no IMU samples from [45]\.\d+ s to 5\.\d+ s while the robot moved"
    ):
        estimate(fault(good(0)), robot(0))


def test_rail_known_from_the_grade_is_recognised() -> None:
    """One axis of an accelerometer, cut off at the range that the grade gives."""
    truth = good(0)
    limit = 0.7 * truth.trial.info.a_max
    imu = truth.trial.imu
    force = np.full_like(imu.specific_force, np.nan)
    force[:, 0] = np.clip(imu.specific_force[:, 0], -limit, limit)
    low = robot(0)
    low = replace(low, imu_grade=replace(low.imu_grade, accel_range=limit))
    motion = estimate(replace(truth.trial, imu=replace(imu, specific_force=force)), low)
    error, std = truth.errors(motion)
    assert motion.health.plateaus
    assert np.mean(np.abs(error) < 2 * std) >= 0.9
    assert np.mean(std) > 3 * np.mean(truth.errors(plain(0))[1])


@pytest.mark.parametrize(("how", "trial"), in_turn(sampled(["frozen", "missing", "zero"], 3), BOTH))
def test_dead_encoder_is_left_out_while_it_is_dead_and_goes_on_level(how: str, trial: int) -> None:
    ((clean, motion),) = hold(
        lambda d: faults.dead_encoder(d.trial, "rl", 4.0, 7.0, how), [trial],
        said="encoder rl gives no counts",
    )  # fmt: skip
    if trial:
        clean, motion = correct(faults.dead_encoder(good(0).trial, "rl", 4.0, 7.0, how), robot(0))
    dead = (motion.t > 4.1) & (motion.t < 6.9)
    column, t = WHEELS.index("rl"), clean.wheels.t
    assert np.isnan(clean.wheels.angle[(t > 4.05) & (t < 6.95), column]).all()
    assert np.isnan(motion.slip[dead, column]).all()
    assert np.isfinite(np.delete(motion.slip, column, axis=1)[dead]).all()
    alive = ((motion.t > 3.0) & (motion.t < 3.9)) | ((motion.t > 7.2) & (motion.t < 9.0))
    error = motion.v_wheel[alive, column] - good(0).at(motion.t[alive], "v_wheel")[:, column]
    assert np.abs(error).max() < 0.02
    after = (t > 7.1) & (t < 7.6)
    apart = clean.wheels.angle[after, column] - good(0).trial.wheels.angle[after, column]
    assert np.abs(apart).max() < 0.03 * 0.5 / robot(0).wheels.radius


@pytest.mark.parametrize(
    "pairs", sampled([[("fl", "fr"), ("rl", "rr")], [("fl", "rl"), ("fr", "rr")], [("fl", "rr")]], 3)
)
def test_exchanged_encoders_leave_the_body_as_it_is(pairs: list[tuple[str, str]]) -> None:
    """Nothing in straight motion shows which wheel an encoder is on; the mean of the sides counts."""
    trial = good(0).trial
    for one, other in pairs:
        trial = faults.swapped(trial, one, other)
    motion = estimate(trial, robot(0))
    assert motion.v == pytest.approx(plain(0).v, abs=2e-4)
    assert motion.slip_ratio.value == pytest.approx(plain(0).slip_ratio.value, abs=1e-3)


@pytest.mark.parametrize("degrees", [90.0, 180.0, -90.0])
def test_imu_in_other_axes_than_said_is_refused(degrees: float) -> None:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turned = faults.turned(good(0).trial, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    with pytest.raises(EstimateError, match="axis") as refusal:
        estimate(turned, robot(0))
    assert "rotation" in refusal.value.hint


@pytest.mark.parametrize(
    ("cut", "side", "trial"),
    [(*case, i) for case, i in in_turn([({"stop": 7.0}, "end"), ({"start": 4.0}, "start")], BOTH)],
)
def test_end_without_standstill_is_warned_of_and_grows_the_std(
    cut: dict[str, float], side: str, trial: int
) -> None:
    ((_, motion),) = hold(lambda d: faults.cut(d.trial, **cut), [trial], said=f"no standstill at the {side}")
    bare, anchored = (-1, 0) if side == "end" else (0, -1)
    middle = motion.t.size // 2
    assert motion.v_std[bare] > motion.v_std[middle] > motion.v_std[anchored]
    assert side in motion.health.verdict
    assert not motion.health.good


@pytest.mark.parametrize(
    ("slip", "grade"), sampled([(0.9, "industrial"), (0.3, "industrial"), (0.6, "consumer")], 3)
)
def test_without_any_standstill_a_steady_slip_of_any_size_is_inside_the_std(slip: float, grade: str) -> None:
    truth, robot = generate(7, velocity=0.3, slip=slip, grade=grade), load_robot("granite", grade)
    trial = faults.cut(truth.trial, start=4.0, stop=9.0)
    motion, whole = estimate(trial, robot), estimate(truth.trial, robot)
    assert any("no standstill" in line for line in motion.warnings)
    assert not motion.health.good
    assert "no standstill" in motion.health.verdict
    assert motion.v_std.min() > 2 * whole.v_std.mean()
    v = truth.at(motion.t, "v")
    assert np.mean(np.abs(motion.v - v) < 2 * motion.v_std) > 0.9
    true = truth.slip_ratio_between(*motion.steady)
    assert abs(motion.slip_ratio.value - true) < 2 * motion.slip_ratio.std
    parts = sum(part.contribution**2 for part in motion.slip_parts)
    assert np.sqrt(parts) == pytest.approx(motion.slip_ratio.std, rel=0.01)
    # ground that is known to slip little is believed
    firm = estimate(trial, robot, soil=replace(load_soil(), slip_std=0.05))
    assert np.median(firm.v_std) < 0.3 * np.median(motion.v_std)


def test_without_standstill_and_encoders_the_estimate_is_refused() -> None:
    bare = replace(faults.cut(good(0).trial, start=4.0, stop=8.0), wheels=None)
    with pytest.raises(EstimateError, match="nothing anchors the velocity") as refusal:
        estimate(bare, robot(0))
    assert "--rest" in refusal.value.hint


def test_without_imu_the_wheels_are_all_that_is_known() -> None:
    truth = good(0)
    motion = estimate(replace(truth.trial, imu=None), robot(0))
    assert np.isnan(motion.v).all()
    assert np.isnan(motion.slip_ratio.value)
    error = motion.v_wheel - truth.at(motion.t + truth.clock_offset, "v_wheel")
    assert np.sqrt(np.nanmean(error**2)) < 0.005
    assert any("no IMU" in line for line in motion.warnings)
    assert not motion.health.good


def test_without_encoders_the_body_is_still_known() -> None:
    for _, motion in hold(lambda d: replace(d.trial, wheels=None), slip=False, said="no encoders"):
        assert np.isnan(motion.slip_ratio.value)


def test_neither_imu_nor_encoders_is_refused() -> None:
    with pytest.raises(EstimateError, match="neither IMU nor encoder"):
        estimate(replace(good(0).trial, imu=None, wheels=None), robot(0))


def test_too_few_samples_are_told_from_none() -> None:
    trial = good(0).trial
    assert trial.imu is not None
    assert trial.wheels is not None
    imu, wheels = (
        part(stream, np.arange(stream.t.size) < n) for stream, n in ((trial.imu, 3), (trial.wheels, 2))
    )
    with pytest.raises(
        EstimateError, match=r"only 3 IMU and 2 encoder samples, expected 8 .* or 3 "
    ) as error:
        estimate(replace(trial, imu=imu, wheels=wheels), robot(0))
    assert "too short" in error.value.hint
    with pytest.raises(EstimateError, match="only 2 encoder samples"):
        estimate(replace(trial, imu=None, wheels=wheels), robot(0))
    assert estimate(replace(trial, imu=imu), robot(0)).health.verdict.startswith("Only 3 IMU samples")


def channels(trial: Trial) -> np.ndarray:
    """(N, 6) force and rate of a corrected trial at the good one's stamps."""
    imu = trial.imu
    both = np.hstack([imu.specific_force, imu.angular_rate])
    place = np.searchsorted(imu.t, good(0).trial.imu.t)
    return both[np.clip(place, 0, imu.t.size - 1)]


def said(lines: Sequence[str], *words: str) -> bool:
    return any(all(word in line for word in words) for line in lines)


def test_good_trial_is_left_as_it_is() -> None:
    clean, _ = corrected(0)
    logged = good(0).trial
    assert clean.doubts == logged.doubts
    assert clean.imu.robot_axes
    assert np.array_equal(clean.imu.specific_force, logged.imu.specific_force)
    assert np.array_equal(clean.wheels.angle, logged.wheels.angle)
    assert np.array_equal(clean.wheels.t, logged.wheels.t)
    assert np.array_equal(clean.currents.current, logged.currents.current)


def test_corrected_trial_is_estimated_as_the_log_was() -> None:
    turned = faults.flipped(faults.spikes(good(0).trial, 3, 8, 30.0), "rl")
    clean, motion = correct(turned, robot(0))
    again, repeated = correct(clean, robot(0))
    apart = repeated.v - np.interp(repeated.t, motion.t, motion.v)
    assert np.all(np.abs(apart) < np.interp(repeated.t, motion.t, motion.v_std) + 3e-4)
    assert again.doubts == clean.doubts


@pytest.mark.parametrize("wheels", sampled([("fr", "rl"), ("fl",), ("fl", "rl"), ("fr", "rr"), WHEELS], 5))
def test_reversed_encoders_are_the_good_ones(wheels: tuple[str, ...]) -> None:
    clean, motion = correct(faults.flipped(good(0).trial, *wheels), robot(0))
    assert np.array_equal(clean.wheels.angle, corrected(0)[0].wheels.angle)
    assert np.array_equal(motion.v, corrected(0)[1].v)
    assert said(motion.warnings, "sign", "turned")


def test_spikes_are_absent_and_the_rest_untouched() -> None:
    thrown = faults.spikes(good(0).trial, 3, 8, 30.0)
    ((clean, motion),) = hold(lambda _: thrown, [0], said="thrown off")
    hit = (thrown.imu.specific_force != good(0).trial.imu.specific_force).any(axis=1)
    found = channels(clean)
    far = hit & (np.abs(thrown.imu.specific_force - good(0).trial.imu.specific_force).max(axis=1) > 3.0)
    assert np.isnan(found[far]).all()
    assert np.isnan(found).any(axis=1).sum() <= hit.sum()
    kept = np.isfinite(found)
    kept[hit] = False
    assert np.array_equal(found[kept], channels(corrected(0)[0])[kept])
    assert said(motion.warnings, f"{np.isnan(found).any(axis=1).sum()} single reading", "thrown off")


@pytest.mark.parametrize("angles", sampled([(10.0, -80.0, 35.0), (0.0, 0.0, 90.0), (180.0, 0.0, 0.0)], 3))
def test_imu_in_other_axes_is_in_the_robots(angles: tuple[float, float, float]) -> None:
    turn = Rotation.from_euler("ZYX", angles[::-1], degrees=True).as_matrix()
    clean, _ = correct(faults.turned(good(0).trial, turn.T), mounted(rotation=angles))
    assert channels(clean) == pytest.approx(channels(corrected(0)[0]), abs=1e-9)


def test_restart_of_the_imu_leaves_no_step() -> None:
    ((clean, motion),) = hold(
        lambda d: faults.imu_restart(d.trial, 4.0, gap=0.2), [0], grown=1.02, said="a restart"
    )
    after = good(0).trial.imu.t > 4.3
    apart = (channels(clean) - channels(corrected(0)[0]))[after]
    # gravity at the end is levelled by what the pitch is known to there: 0.6 deg make 0.1 m/s^2
    assert abs(np.mean(apart[:, 0])) < 0.1
    bias, std = motion.health.accel_bias, motion.health.gyro_bias_std
    assert bias[-1] - bias[0] == pytest.approx(0.15, abs=0.1)
    assert abs(np.mean(apart[:, 4])) < 3.0 * np.hypot(std[0], std[-1])
    gap = (clean.imu.t > 4.0) & (clean.imu.t < 4.2)
    assert gap.sum() == 2
    assert np.isnan(clean.imu.specific_force[gap]).all()
    assert motion.health.gaps


@cache
def quick() -> tuple[Trial, tuple[Trial, Motion]]:
    trial = generate(61, velocity=0.5, duration=5.0, grade="industrial", clock_offset=0.003).trial
    return trial, correct(trial, robot(0))


@pytest.mark.parametrize("offset", sampled([0.03, -0.05]))
def test_large_clock_offset_is_taken_out_of_the_stamps(offset: float) -> None:
    trial, (good_one, good_motion) = quick()
    late = faults.late(trial, -offset)
    clean, motion = correct(late, robot(0))
    std = motion.clock_offset.std
    apart = clean.wheels.t - good_one.wheels.t
    assert np.ptp(apart) < 1e-12
    left = motion.clock_left.value - good_motion.clock_left.value
    assert abs(apart[0] + left) < 0.5 * std + 1e-4  # stamps and what is left of the offset agree
    assert abs(apart[0]) < 2.0 * std
    assert clean.currents.t[0] - late.currents.t[0] == pytest.approx(motion.clock_applied)


def test_offset_given_by_hand_is_in_the_stamps() -> None:
    info = replace(good(0).trial.info, clock_offset=0.123)
    clean, motion = correct(replace(good(0).trial, info=info), robot(0))
    assert clean.wheels.t == pytest.approx(good(0).trial.wheels.t + 0.123)
    assert clean.info.clock_offset is None
    assert motion.clock_left.value == 0.0


@pytest.mark.parametrize("wheels", sampled([("fr", "rr"), ("fl",), WHEELS], 3))
def test_currents_of_the_wrong_sign_are_turned(wheels: tuple[str, ...]) -> None:
    currents = good(0).trial.currents
    sign = np.array([-1.0 if name in wheels else 1.0 for name in WHEELS])
    wrong = replace(good(0).trial, currents=replace(currents, current=currents.current * sign))
    clean, motion = correct(wrong, robot(0))
    assert np.array_equal(clean.currents.current, currents.current)
    assert said(motion.warnings, f"current {', '.join(wheels)}: flows against the wheels")


def test_gravity_that_the_logger_removed_is_put_back() -> None:
    ((clean, motion),) = hold(
        lambda d: d.without_gravity(), [0], grown=2.0, said="gravity was removed by the logger"
    )
    apart = (channels(clean) - channels(corrected(0)[0]))[:, [0, 2]]
    std = 9.81 * np.sqrt(np.mean(motion.pitch_std**2))
    assert not clean.imu.gravity_removed
    assert np.sqrt(np.mean(apart**2)) < 3.0 * std
    assert np.std(apart[:, 0]) < 0.05
