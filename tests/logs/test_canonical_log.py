"""The canonical log: what is written is read back to the last bit; units come from the suffix."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from granite_lab.errors import InputError
from granite_lab.logs import read_trial, write_canonical
from granite_lab.logs.trial import CurrentStream, ImuStream, Series, Trial, TrialInfo, WheelStream
from tests.logs import make

numbers = st.floats(-50, 50, allow_subnormal=False)
texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\x00"), max_size=12)


@st.composite
def stamps(draw: st.DrawFn, step: float) -> np.ndarray:
    """Increasing stamps, about `step` apart."""
    count = draw(st.integers(3, 25))
    jitter = draw(arrays.arrays(float, count, elements=st.floats(0, 0.4)))
    origin = draw(st.sampled_from([0.0, -3.0, 12.5, 1.7e9]))
    return np.asarray(origin + step * (np.arange(count) + jitter))


@st.composite
def trials(draw: st.DrawFn) -> Trial:
    """Any trial that the format can hold."""
    ti, tw, tc = draw(stamps(0.01)), draw(stamps(0.02)), draw(stamps(0.02))
    tw, tc = tw - tw[0] + ti[0], tc - tc[0] + ti[0]
    force = draw(arrays.arrays(float, (len(ti), 3), elements=numbers))
    # Gravity stands far above the rest, for units are checked by it.
    force = force * 1e-3 + [0, 0, 9.81]
    rate = draw(arrays.arrays(float, (len(ti), 3), elements=numbers)) * 0.02
    angle = draw(arrays.arrays(float, (len(tw), 4), elements=numbers)) * 1e-3
    current = draw(arrays.arrays(float, (len(tc), 4), elements=numbers))
    info = TrialInfo(
        robot="granite",
        soil=draw(st.none() | st.just("dry_sand")),
        v_desired=draw(st.none() | st.floats(0, 5)),
        repetition=draw(st.none() | st.integers(0, 99)),
        virtual=draw(st.booleans()),
        clock_offset=draw(st.none() | st.floats(-1, 1)),
        extra={"note": draw(texts), draw(texts.filter(lambda s: s.strip() == s and s != "")) + "_key": "x"},
    )
    return Trial(
        name="any",
        info=info,
        imu=ImuStream(ti, force, rate),
        wheels=WheelStream(tw, angle, None, draw(st.sampled_from([0.0, 1e-4]))),
        currents=draw(st.none() | st.just(CurrentStream(tc, current))),
        reference_v=draw(st.none() | st.just(Series(tw, angle[:, 0]))),
    )


@given(trial=trials())
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
def test_what_is_written_is_read_back_to_the_last_bit(trial: Trial, tmp_path: Path) -> None:
    path = tmp_path / "any.csv"
    write_canonical(path, trial)
    back = read_trial(path)
    np.testing.assert_array_equal(back.imu.t, trial.imu.t)
    np.testing.assert_array_equal(back.imu.specific_force, trial.imu.specific_force)
    np.testing.assert_array_equal(back.imu.angular_rate, trial.imu.angular_rate)
    np.testing.assert_array_equal(back.wheels.t, trial.wheels.t)
    np.testing.assert_array_equal(back.wheels.angle, trial.wheels.angle)
    assert back.info == trial.info
    assert back.info.extra == trial.info.extra
    assert (back.currents is None) == (trial.currents is None)
    if trial.currents is not None and back.currents is not None:
        np.testing.assert_array_equal(back.currents.current, trial.currents.current)
    if trial.reference_v is not None:
        np.testing.assert_array_equal(back.reference_v.value, trial.reference_v.value)
    if trial.wheels.step:
        assert back.wheels.step == trial.wheels.step


def test_logged_rates_are_written_as_rates_and_integrated_again(tmp_path: Path) -> None:
    t = np.arange(50) / 50
    rate = np.repeat(np.sin(t)[:, None], 4, axis=1)
    path = tmp_path / "rates.csv"
    wheels = WheelStream(t, np.zeros_like(rate), rate, 0.01)
    write_canonical(path, Trial("rates", TrialInfo(robot="granite"), wheels=wheels))
    back = read_trial(path).wheels
    np.testing.assert_array_equal(back.rate, rate)
    assert back.angle[-1, 0] == pytest.approx(1 - np.cos(t[-1]), abs=1e-4)
    assert back.step == 0.01


def test_gravity_stays_removed(tmp_path: Path) -> None:
    t = np.arange(300) / 100
    force = np.random.default_rng(1).normal(0, 0.05, (300, 3))
    imu = ImuStream(t, force, np.zeros((300, 3)) + 1e-3 * force, gravity_removed=True)
    path = tmp_path / "free.csv"
    write_canonical(path, Trial("free", TrialInfo(robot="granite"), imu=imu))
    back = read_trial(path)
    assert back.imu.gravity_removed
    np.testing.assert_array_equal(back.imu.specific_force, force)


def test_nothing_is_left_behind_when_the_folder_cannot_be_written(tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("x")
    with pytest.raises(Exception, match="not a directory"):
        write_canonical(blocker / "trial.csv", Trial("x", TrialInfo()))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


SUFFIXES = [
    ("imu_ax", "mps2", "g", 1 / 9.80665),
    ("imu_ax", "mps2", "mg", 1000 / 9.80665),
    ("imu_gy", "radps", "dps", 180 / np.pi),
    ("imu_gy", "radps", "degps", 180 / np.pi),
    ("enc_fl", "rad", "deg", 180 / np.pi),
    ("enc_fl", "rad", "rev", 1 / (2 * np.pi)),
    ("t", "s", "ms", 1e3),
    ("t", "s", "us", 1e6),
    ("t", "s", "ns", 1e9),
]


@pytest.mark.parametrize(("channel", "old", "new", "factor"), SUFFIXES)
def test_the_suffix_gives_the_unit(channel: str, old: str, new: str, factor: float, tmp_path: Path) -> None:
    lines = make.lines()
    place = lines[0].split(",").index(f"{channel}_{old}")
    # All axes and wheels change together: units are judged by their sum.
    stem = (
        channel[:-1] if channel.startswith("imu") else channel[:4] if channel.startswith("enc") else channel
    )
    names = lines[0].split(",")
    hit = [i for i, name in enumerate(names) if name.startswith(stem)]
    assert place in hit
    changed = [",".join(n.rsplit("_", 1)[0] + f"_{new}" if i in hit else n for i, n in enumerate(names))]
    for line in lines[1:]:
        cells = line.split(",")
        changed.append(",".join(repr(float(c) * factor) if i in hit else c for i, c in enumerate(cells)))
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    plain.write_text("\n".join(lines))
    other.write_text("\n".join(changed))
    a, b = read_trial(plain), read_trial(other)
    np.testing.assert_allclose(b.imu.t, a.imu.t, rtol=0, atol=1e-12)
    np.testing.assert_allclose(b.imu.specific_force, a.imu.specific_force, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(b.imu.angular_rate, a.imu.angular_rate, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(b.wheels.angle, a.wheels.angle, rtol=1e-12, atol=1e-12)
    assert b.warnings == a.warnings


def test_currents_in_milliamperes_and_rates_in_turns_a_minute(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    rows = [f"{0.02 * k},{1000 + k},{60},{60},{60},{30 + k}" for k in range(50)]
    path.write_text(
        '# robot = "granite"\nt_s,cur_fl_mA,enc_fl_rpm,enc_fr_rpm,enc_rl_rpm,enc_rr_rpm\n' + "\n".join(rows)
    )
    trial = read_trial(path)
    assert trial.currents.current[3, 0] == pytest.approx(1.003)
    assert np.isnan(trial.currents.current[3, 1:]).all()
    assert trial.wheels.rate[0, 0] == pytest.approx(2 * np.pi)
    assert trial.wheels.angle[-1, 0] == pytest.approx(2 * np.pi * 0.98)


def test_counts_take_their_size_from_the_log_before_the_robot(tmp_path: Path) -> None:
    rows = [f"{0.02 * k},{k},{k},{k},{k}" for k in range(50)]
    body = "t_s,enc_fl_counts,enc_fr_counts,enc_rl_counts,enc_rr_counts\n" + "\n".join(rows)
    path = tmp_path / "c.csv"
    path.write_text('# robot = "granite"\n' + body)
    wheels = read_trial(path).wheels
    assert wheels.angle[-1, 2] == pytest.approx(49 * 2 * np.pi / 106000, rel=1e-14)
    path.write_text('# robot = "granite"\n# enc_counts_per_rev = 1000\n' + body)
    wheels = read_trial(path).wheels
    assert wheels.angle[-1, 2] == pytest.approx(49 * 2 * np.pi / 1000, rel=1e-14)
    assert wheels.step == pytest.approx(2 * np.pi / 1000)


def test_sparse_rows_give_each_sensor_its_own_stamps(tmp_path: Path) -> None:
    lines = make.lines()
    sparse = [lines[0]]
    for k, line in enumerate(lines[1:]):
        cells = line.split(",")
        stamp = float(cells[0])
        sparse.append(",".join([f"{stamp}", *cells[1:7], "", "", "", ""]))
        if k % 2 == 0:
            sparse.append(",".join([f"{stamp + 0.003:.6f}", *[""] * 6, *cells[7:]]))
    path = tmp_path / "sparse.csv"
    path.write_text("\n".join(sparse))
    trial = read_trial(path)
    assert (len(trial.imu.t), len(trial.wheels.t)) == (600, 300)
    assert trial.wheels.t[1] == 0.023


def test_metadata_of_comments_sidecar_and_caller_in_this_order(tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    path.write_text(
        '# robot = "granite"\n# a remark, not TOML = really\n# v_desired_mps = 0.2\n# distance_m = 2.0\n'
        "# operator = Jan\n#\n" + make.text()
    )
    path.with_suffix(".toml").write_text('v_desired_mps = 0.3\nsoil = "dry_sand"\nweather = "wet"\n')
    info = read_trial(path, info=TrialInfo(soil="loam.toml")).info
    assert (info.v_desired, info.distance, info.soil) == (0.3, 2.0, "loam.toml")
    assert info.extra == {"operator": "Jan", "weather": "wet"}
    assert [file.path.name for file in read_trial(path).inputs] == ["trial.csv", "trial.toml"]


def test_a_misspelt_metadata_key_is_pointed_out(tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    path.write_text('# robot = "granite"\n# v_desired_mp = 0.3\n' + make.text())
    assert any("did you mean 'v_desired_mps'" in line for line in read_trial(path).warnings)


def test_two_files_make_one_trial(tmp_path: Path) -> None:
    names = make.HEADER.split(",")
    whole, imu, wheels = (tmp_path / f"{n}.csv" for n in ("whole", "imu", "enc"))
    lines = make.lines()
    whole.write_text("\n".join(lines))
    imu.write_text("\n".join(",".join(line.split(",")[:7]) for line in lines))
    wheels.write_text("\n".join(",".join([line.split(",")[0], *line.split(",")[7:]]) for line in lines))
    assert names[7] == "enc_fl_rad"
    one, two = read_trial(whole), read_trial(imu, encoders=wheels)
    np.testing.assert_array_equal(two.imu.specific_force, one.imu.specific_force)
    np.testing.assert_array_equal(two.wheels.angle, one.wheels.angle)
    assert len(two.inputs) == 2


def test_the_angle_counts_where_the_rate_is_logged_too(tmp_path: Path) -> None:
    lines = make.lines()
    both = [lines[0] + ",enc_fl_radps", *(line + ",7.5" for line in lines[1:])]
    path = tmp_path / "both.csv"
    path.write_text("\n".join(both))
    trial = read_trial(path)
    assert trial.wheels.rate is None


def test_a_cell_that_is_empty_for_the_caller_is_no_sample(tmp_path: Path) -> None:
    path = tmp_path / "empty.csv"
    path.write_text("\n".join([make.HEADER, *(f"{k / 100}" + "," * 10 for k in range(200))]))
    with pytest.raises(InputError, match="neither IMU nor encoder samples"):
        read_trial(path)
