"""Encoders of any range, resolution and rate: what is read is the angle that the wheel turned by."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from granite_lab.errors import InputError
from granite_lab.logs import read_trial
from granite_lab.logs.layouts import Column
from granite_lab.logs.quantities import find_unit
from granite_lab.logs.sensors.doubt import Doubt
from granite_lab.logs.sensors.encoders import Wheel, convert, lattice
from granite_lab.logs.trial import Trial
from tests.logs import make
from tests.soak import examples

PLAIN = Column(to=())
TURN = 2 * np.pi
COUNTS = ["enc_fl_counts", "enc_fr_counts", "enc_rl_counts", "enc_rr_counts"]
FASTEST = 0.3 / 0.9 / make.RADIUS  # rad/s, of the wheels of `make`


def drive(hz: float, speed: float = FASTEST) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (N,) [s] and angle (N,) [rad] of a wheel that rests, turns at `speed` [rad/s] and rests."""
    t = np.arange(0, 8, 1 / hz)
    v = speed * np.clip(np.minimum(t - 1, 7 - t), 0, 1)
    fine = np.arange(0, 8, 1e-3)
    angle = np.cumsum(speed * np.clip(np.minimum(fine - 1, 7 - fine), 0, 1)) * 1e-3
    assert v.max() == pytest.approx(speed)
    return t, np.interp(t, fine, angle)


def counted(angle: np.ndarray, per_rev: float, width: float, start: int, signed: bool) -> np.ndarray:
    """Return what a counter that starts again after `width` counts reads."""
    raw = np.mod(np.floor(angle / TURN * per_rev) + start, width)
    return np.where(raw >= width / 2, raw - width, raw) if signed else raw


@given(
    bits=st.integers(7, 32), signed=st.booleans(), start=st.floats(0, 1), backwards=st.booleans(),
    hz=st.sampled_from([10, 20, 50, 100, 200]), share=st.floats(0.002, 0.2),
)  # fmt: skip
@example(bits=7, signed=False, start=0.0, backwards=False, hz=10, share=0.0546875)
@settings(max_examples=examples(60))
def test_a_counter_of_any_power_of_two_is_unwrapped_at_any_rate(
    bits: int, signed: bool, start: float, backwards: bool, hz: float, share: float
) -> None:
    """It moves by up to `share` of its range from sample to sample."""
    t, angle = drive(hz)
    per_rev = share * 2**bits * hz / FASTEST * TURN
    true = np.floor((-angle if backwards else angle) / TURN * per_rev)
    raw = counted(-angle if backwards else angle, per_rev, 2**bits, int(start * 2**bits), signed)
    read = convert(t, raw, find_unit("counts"), PLAIN, Wheel(per_rev, 0.1), []).angle / TURN * per_rev
    np.testing.assert_allclose(read - read[0], true - true[0], rtol=1e-12, atol=1e-5)


@pytest.mark.parametrize("hz", [5, 20, 100])
@pytest.mark.parametrize(
    ("unit", "low", "high"),
    [("deg", 0, 360), ("deg", -180, 180), ("rad", -np.pi, np.pi), ("rad", 0, TURN), ("rev", 0, 1)],
)
def test_an_angle_that_starts_again_each_turn_is_unwrapped(
    hz: float, unit: str, low: float, high: float
) -> None:
    """Written with four digits: a rounded angle may go a little beyond the turn."""
    t, angle = drive(hz)
    raw = np.round(np.mod(angle / TURN * (high - low) + 0.3 * high - low, high - low) + low, 4)
    read = convert(t, raw, find_unit(unit), PLAIN, Wheel(106_000, 0.1), []).angle
    np.testing.assert_allclose(read - read[0], angle - angle[0], atol=1e-4 * TURN)


def log(counts: np.ndarray, per_rev: float, every: int, begin: float = 0.0) -> str:
    """Return the drive of `make` with counts (N, 4) of each `every`th sample, from `begin` [s] on."""
    t, imu, _ = make.rows()
    head = f'# robot = "granite"\n# enc_counts_per_rev = {per_rev}\n'
    lines = [",".join(["t_s", *make.IMU, *COUNTS])]
    for k, (stamp, row) in enumerate(zip(t, imu, strict=True)):
        cells = [f"{x:.0f}" for x in counts[k]] if k % every == 0 else [""] * 4
        if stamp >= begin:
            lines.append(",".join([f"{stamp:.6f}", *(f"{x:.6g}" for x in row), *cells]))
    return head + "\n".join(lines) + "\n"


def near_half(folder: Path, step: float, begin: float = 0.0, clear: bool = False) -> tuple[Trial, np.ndarray]:
    """Read a counter of 8 bits that moves by up to `step` of its range between samples at 20 Hz; the truth.

    With `clear`, the right wheels' counters have 32 bits.
    """
    _, _, angle = make.rows()
    per_rev = step * 256 * 20 / FASTEST * TURN
    raw = counted(angle, per_rev, 256, 40, False)
    if clear:
        raw[:, 1::2] = np.floor(angle[:, 1::2] / TURN * per_rev)
    trial = make.read(folder, log(raw, per_rev, every=5, begin=begin))
    return trial, (np.floor(angle / TURN * per_rev) * TURN / per_rev)[::5]


@pytest.mark.parametrize("step", [0.3, 0.45, 0.49, 0.55, 0.7])
@pytest.mark.parametrize("clear", [False, True])
def test_near_half_its_range_a_counter_is_read_as_the_imu_or_the_other_wheels_say(
    step: float, clear: bool, tmp_path: Path
) -> None:
    trial, true = near_half(tmp_path, step, clear=clear)
    np.testing.assert_allclose(trial.wheels.angle - trial.wheels.angle[0], true - true[0], atol=1e-9)
    said = [line for line in trial.warnings if "of its range from sample to sample" in line]
    witness = "the other wheels" if clear else "the IMU"
    assert len(said) == (0 if step < 0.4 else 2 if clear else 4)
    assert all(f"which {witness} confirms; log faster" in line for line in said)


def test_a_counter_that_changes_its_step_too_much_is_refused(tmp_path: Path) -> None:
    """By three times its range in the 0.25 s of the ramp, of which 20 Hz show 5 samples."""
    what = (
        r"column 'enc_fl_counts': the counter moves by .* forward or back by the rest: the IMU fits neither"
    )
    with pytest.raises(InputError, match=what) as refusal:
        near_half(tmp_path, 3.1)
    assert "log faster" in refusal.value.hint


def rate_of(raw: np.ndarray, hz: float, unit: str = "counts/s", wrap: float = 0.0, per_rev: float = 106_000):
    """Read rates (N,) logged at `hz`; return what is read, and the doubts."""
    t = np.arange(len(raw)) / hz
    spec, doubts = Column(to=(), wrap=wrap), list[Doubt]()
    read = convert(t, raw, find_unit(unit), spec, Wheel(per_rev, make.RADIUS, 60.0), doubts)
    return read, [*map(str, doubts)]


def speeds(hz: float, speed: float) -> np.ndarray:
    """Rates (N,) [rad/s] of the wheel of `drive`."""
    t = np.arange(0, 8, 1 / hz)
    return speed * np.clip(np.minimum(t - 1, 7 - t), 0, 1)


@pytest.mark.parametrize("wrap", [0.0, 65536.0], ids=["found", "in the map"])
@pytest.mark.parametrize("hz", [20, 100])
def test_rates_that_overflow_16_bits_are_unwrapped(hz: float, wrap: float) -> None:
    true = np.rint(speeds(hz, 6.0) / TURN * 106_000 + 11 * np.sin(np.arange(8 * hz)) * (speeds(hz, 1) > 0))
    assert true.max() > 65536 + 32768
    raw = (true + 32768) % 65536 - 32768
    found, doubts = rate_of(raw, hz, wrap=wrap)
    np.testing.assert_allclose(found.rate / TURN * 106_000, true, atol=1e-6)
    assert any("the rate overflowed 4 times at 65536; unwrapped" in doubt for doubt in doubts)


def test_rates_that_change_by_half_their_range_are_refused() -> None:
    true = np.rint(speeds(4, 7.0) / TURN * 106_000)
    with pytest.raises(InputError, match=r"the rate overflows at 65536 and .*not to be read"):
        rate_of((true + 32768) % 65536 - 32768, 4, wrap=65536)


WRONG = {
    "one beyond all motors": (slice(300, 301), -64_678.0),
    "one that the motor could make": (slice(300, 301), 9.0),
    "a burst": (slice(300, 312), np.array([3e4, -700, 12, 45, -5e3, 80, 9e4, -1, -22, 33, 5e5, -8e4])),
    "zeros": (slice(300, 320), 0.0),
    "the last one again": (slice(300, 345), None),
}


@pytest.mark.parametrize("case", WRONG)
def test_rates_that_the_wheel_cannot_have_are_left_out_and_said_once(case: str) -> None:
    """The way is that of the right ones within 1 mm a reading at most, at 0.5 m/s."""
    noise = np.random.default_rng(5).normal(0, 0.02, 800) * (speeds(100, 1) > 0)
    true = np.round(speeds(100, 5.2) + noise, 5)
    raw, (where, value) = true.copy(), WRONG[case]
    raw[where] = raw[where.start] if value is None else value
    found, doubts = rate_of(raw, 100, "rad/s")
    right, none = rate_of(true, 100, "rad/s")
    assert none == []
    assert len(doubts) == 1
    assert np.isnan(found.rate[where.start + (value is None) : where.stop]).all()
    np.testing.assert_array_equal(np.delete(found.rate, where), np.delete(true, where))
    assert abs(found.angle[-1] - right.angle[-1]) * make.RADIUS < 1e-3


def test_a_wheel_that_stops_for_a_moment_has_no_lost_samples() -> None:
    """From 0.5 m/s to 0 and back at 3 m/s^2."""
    t = np.arange(800) / 100
    true = np.round(np.clip(np.abs(t - 4) * 3.0, 0, 0.5) / make.RADIUS, 5)
    found, doubts = rate_of(true, 100, "rad/s")
    assert doubts == []
    np.testing.assert_array_equal(found.rate, true)


@pytest.mark.parametrize("hz", [10, 50, 200])
@pytest.mark.parametrize("per_rev", [256, 1000, 4096])
@pytest.mark.parametrize("unit", ["counts/s", "rad/s", "rpm"])
def test_rates_by_counts_per_period_are_read_as_the_counter(per_rev: int, hz: int, unit: str) -> None:
    _, angle = drive(hz)
    count = np.floor(angle / TURN * per_rev + 0.4)
    size = {"counts/s": 1.0, "rad/s": TURN / per_rev, "rpm": 60 / per_rev}[unit]
    raw = np.round(np.diff(count, prepend=0.0) * hz * size, 6)
    known = per_rev if unit == "counts/s" else 106_000
    found, doubts = rate_of(raw, hz, unit, per_rev=known)
    assert doubts == []
    if found.rate is None:
        assert found.resolution == pytest.approx(TURN / per_rev, rel=1e-3)
        np.testing.assert_allclose(found.angle / TURN * per_rev, count, atol=1e-3 * count.max())
    else:  # a grid of round numbers may be that of written digits
        assert found.resolution == pytest.approx(TURN / per_rev * hz, rel=1e-3)


@pytest.mark.parametrize("digits", [1, 2, 3])
def test_rates_that_were_rounded_stay_rates(digits: int) -> None:
    raw = np.round(speeds(100, 5.2) + 0.05 * np.sin(np.arange(800)), digits)
    found, _ = rate_of(raw, 100, "rad/s")
    assert found.rate is not None
    assert found.resolution == pytest.approx(10.0**-digits, rel=1e-6)


@given(step=st.floats(1e-4, 10), top=st.integers(2, 40), seed=st.integers(0, 1000))
@settings(max_examples=examples(40))
def test_a_coarse_grid_is_found_in_levels_that_scatter(step: float, top: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    whole = np.concatenate((np.arange(top + 1), rng.integers(0, top + 1, 300)))
    values = step * whole * (1 + rng.normal(0, 1e-5, whole.size))
    assert lattice(values) == pytest.approx(step, rel=1e-3)
    assert lattice(rng.normal(0, step, 400)) == 0.0


def test_each_encoder_has_the_resolution_of_its_own(tmp_path: Path) -> None:
    _, imu, angle = make.rows()
    sizes = TURN / np.array([512, 4096, 1024, 16384])
    steps = np.floor(angle / sizes) * sizes
    t = np.arange(600) / 100
    rows = [",".join(f"{x:.9g}" for x in (s, *a, *w)) for s, a, w in zip(t, imu, steps, strict=True)]
    head = '# robot = "granite"\n' + make.HEADER + "\n"
    wheels = make.read(tmp_path, head + "\n".join(rows)).wheels
    np.testing.assert_allclose(wheels.resolution, sizes, rtol=1e-4)
    assert wheels.step == max(wheels.resolution)


ENCODERS = dict(zip(("fl", "fr", "rl", "rr"), make.WHEELS, strict=True))
FEWER = {
    "rear axle": (("fl", "fr"), "no encoder fl, fr in the log"),
    "left side": (("fr", "rr"), "how the robot turns the wheels do not tell"),
    "one": (("fl", "fr", "rr"), "the robot's slip is by rl alone"),
    "three": (("fr",), "no encoder fr in the log"),
}


@pytest.mark.parametrize("case", FEWER)
@pytest.mark.parametrize("numbered", [False, True], ids=["canonical", "rover"])
def test_fewer_encoders_are_read_and_said_once(case: str, numbered: bool, tmp_path: Path) -> None:
    absent, words = FEWER[case]
    names = [name for name in make.COLUMNS if name not in [ENCODERS[wheel] for wheel in absent]]
    text = make.only(*names)
    for k, name in enumerate(make.WHEELS, 1) if numbered else ():
        text = text.replace(name, f"enc{k}_rad")
    text = text.replace("t_s,", "t,").replace("imu_a", "a").replace("imu_g", "g") if numbered else text
    trial = make.read(tmp_path, text)
    assert trial.layout == ("rover" if numbered else "canonical")
    known = np.isfinite(trial.wheels.angle).any(axis=0)
    assert [w for w, there in zip(ENCODERS, known, strict=True) if not there] == list(absent)
    said = [line for line in trial.warnings if "no encoder" in line]
    assert len(said) == 1
    assert words in said[0]


def test_an_encoder_by_another_name_is_not_taken_for_absent(tmp_path: Path) -> None:
    text = make.text().replace("enc_fr_rad", "encoder_front_right")
    with pytest.raises(InputError, match="column 'enc_fr' is missing, expected by layout 'canonical'"):
        read_trial(make.written(tmp_path, text))


@pytest.mark.parametrize(
    ("absent", "said"),
    [
        (("gx_radps", "gz_radps"), "gyroscope: no axis x, z in the log"),
        (("gx_radps", "gy_radps", "gz_radps"), "no gyroscope in the log"),
        (("ay_mps2", "az_mps2"), "accelerometer: no axis y, z in the log"),
        (("az_mps2",), "accelerometer: no axis z in the log"),
    ],
)
def test_fewer_axes_of_an_imu_are_read_and_said_once(
    absent: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    names = [name for name in make.COLUMNS if name.removeprefix("imu_") not in absent]
    trial = make.read(tmp_path, make.only(*names))
    assert sum(said in line for line in trial.warnings) == 1
    both = np.column_stack([trial.imu.specific_force, trial.imu.angular_rate])
    there = [name in names for name in make.IMU]
    np.testing.assert_array_equal(np.isfinite(both).all(axis=0), there)


@pytest.mark.parametrize("counts", [64, 308, 457, 1000])
def test_the_count_of_a_coarse_angle_shows_though_its_decimals_are_cut(counts: int) -> None:
    t = np.arange(0.0, 12.0, 0.01)
    speed = np.interp(t, [0, 2, 2.5, 9, 9.5, 12], [0, 0, 3.0, 3.0, 0, 0])
    ticks = np.floor(np.cumsum(speed) * 0.01 / TURN * counts + 0.4)
    raw = np.round(ticks / counts * TURN, 6)
    found = convert(t, raw, find_unit("rad"), PLAIN, Wheel(0.0, 0.1, 60.0), [])
    assert found.resolution == pytest.approx(TURN / counts, rel=1e-3)
    noise = np.random.default_rng(0).normal(0.0, 1e-4, t.size)
    smooth = np.cumsum(speed) * 0.01 + noise
    found = convert(t, smooth, find_unit("rad"), PLAIN, Wheel(0.0, 0.1, 60.0), [])
    assert found.resolution == 0.0


def test_a_wheel_of_one_sample_has_no_known_step() -> None:
    found = convert(np.array([0.0]), np.array([0.3]), find_unit("rad"), PLAIN, Wheel(0.0, 0.1), [])
    assert found.resolution == 0.0
    assert found.angle.tolist() == [0.3]
