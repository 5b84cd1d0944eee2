"""The canonical log: what is written is read back to the last bit; units come from the suffix."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from granite_lab.errors import InputError
from granite_lab.fitting import tow
from granite_lab.inference.conditions import KEYS
from granite_lab.logs import read_trial, write_canonical
from granite_lab.logs.canonical import CONDITIONS
from granite_lab.logs.trial import CurrentStream, ImuStream, Series, Trial, TrialInfo, WheelStream
from tests.logs import make
from tests.soak import examples

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
    # Gravity stands far above the rest, for units are checked by it, or is removed and said to be.
    removed = draw(st.booleans())
    force = force * 1e-3 + [0, 0, 0.0 if removed else 9.81]
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
        imu=ImuStream(ti, force, rate, gravity_removed=removed),
        wheels=WheelStream(tw, angle, None, (draw(st.sampled_from([0.0, 1e-4])),) * 4),
        currents=draw(st.none() | st.just(CurrentStream(tc, current))),
        reference_v=draw(st.none() | st.just(Series(tw, angle[:, 0]))),
    )


@given(trial=trials())
@settings(max_examples=examples(60), suppress_health_check=list(HealthCheck))
def test_what_is_written_is_read_back_to_the_last_bit(trial: Trial, tmp_path: Path) -> None:
    path = tmp_path / "any.csv"
    write_canonical(path, trial)
    back = read_trial(path)
    make.same(back, trial)
    assert back.imu.gravity_removed == trial.imu.gravity_removed
    assert back.info == trial.info
    assert back.info.extra == trial.info.extra
    if trial.wheels.step:
        assert back.wheels.step == trial.wheels.step


def test_logged_rates_are_written_as_rates_and_integrated_again(tmp_path: Path) -> None:
    t = np.arange(50) / 50
    rate = np.repeat(np.sin(t)[:, None], 4, axis=1)
    wheels = WheelStream(t, np.zeros_like(rate), rate, (0.01,) * 4)
    write_canonical(tmp_path / "rates.csv", Trial("rates", TrialInfo(robot="granite"), wheels=wheels))
    back = read_trial(tmp_path / "rates.csv").wheels
    np.testing.assert_array_equal(back.rate, rate)
    assert back.angle[-1, 0] == pytest.approx(1 - np.cos(t[-1]), abs=1e-4)
    assert back.step == 0.01


def test_currents_in_milliamperes_and_rates_in_turns_a_minute(tmp_path: Path) -> None:
    rows = [f"{0.02 * k},{1000 + k},{60},{60},{60},{30 + k}" for k in range(50)]
    head = '# robot = "granite"\nt_s,cur_fl_mA,enc_fl_rpm,enc_fr_rpm,enc_rl_rpm,enc_rr_rpm\n'
    trial = make.read(tmp_path, head + "\n".join(rows))
    assert trial.currents.current[3, 0] == pytest.approx(1.003)
    assert np.isnan(trial.currents.current[3, 1:]).all()
    assert trial.wheels.rate[0, 0] == pytest.approx(2 * np.pi)
    assert trial.wheels.angle[-1, 0] == pytest.approx(2 * np.pi * 0.98)


def test_counts_take_their_size_from_the_log_before_the_robot(tmp_path: Path) -> None:
    rows = [f"{0.02 * k},{k},{k},{k},{k}" for k in range(50)]
    body = "t_s,enc_fl_counts,enc_fr_counts,enc_rl_counts,enc_rr_counts\n" + "\n".join(rows)
    wheels = make.read(tmp_path, '# robot = "granite"\n' + body).wheels
    assert wheels.angle[-1, 2] == pytest.approx(49 * 2 * np.pi / 106000, rel=1e-14)
    wheels = make.read(tmp_path, '# robot = "granite"\n# enc_counts_per_rev = 1000\n' + body).wheels
    assert wheels.angle[-1, 2] == pytest.approx(49 * 2 * np.pi / 1000, rel=1e-14)
    assert wheels.step == pytest.approx(2 * np.pi / 1000)


def test_sparse_rows_give_each_sensor_its_own_stamps(tmp_path: Path) -> None:
    header, *rows = make.lines()
    sparse = [header]
    for k, row in enumerate(rows):
        cells = row.split(",")
        sparse.append(",".join([*cells[:7], "", "", "", ""]))
        if k % 2 == 0:
            sparse.append(",".join([f"{float(cells[0]) + 0.003:.6f}", *[""] * 6, *cells[7:]]))
    trial = make.read(tmp_path, "\n".join(sparse))
    assert (len(trial.imu.t), len(trial.wheels.t)) == (600, 300)
    assert trial.wheels.t[1] == 0.023


def test_metadata_of_comments_sidecar_and_caller_in_this_order(tmp_path: Path) -> None:
    make.written(tmp_path, 'v_desired_mps = 0.3\nsoil = "dry_sand"\n[notes]\nweather = "wet"\n', "trial.toml")
    head = (
        '# robot = "granite"\n# a remark, not TOML = really\n# v_desired_mps = 0.2\n# distance_m = 2.0\n'
        "# operator = Jan\n# a_max_mps = 2.0\n#\n"
    )
    trial = make.read(tmp_path, head + make.text(), info=TrialInfo(soil="loam.toml"))
    assert (trial.info.v_desired, trial.info.distance, trial.info.soil) == (0.3, 2.0, "loam.toml")
    assert trial.info.extra == {"operator": "Jan", "weather": "wet", "a_max_mps": "2.0"}
    assert any("did you mean 'a_max_mps2'" in line for line in trial.warnings)
    assert [file.path.name for file in trial.inputs] == ["trial.csv", "trial.toml"]


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("rest = [[0, 1]]", "unknown key 'rest'", "did you mean 'rests'?"),
        ("v_desired = 0.3", "unknown key 'v_desired'", "'v_desired_mps'"),
        ("weather = 'wet'", "unknown key 'weather'", "[notes]"),
        ("rests = [[1, 0]]", "1 to 0 s is no interval", "the start comes first"),
        ("rests = [0, 1]", "0 is no interval", "[[start, end], …]"),
        ("body_rests = [[0, 'x']]", "'x' is not a number", ""),
        ("ref_v_std_mps = 0", "out of range", ""),
    ],
)
def test_a_sidecar_says_only_what_is_understood(tmp_path: Path, text: str, message: str, hint: str) -> None:
    side = make.written(tmp_path, text, "trial.toml")
    with pytest.raises(InputError) as refusal:
        make.read(tmp_path, make.text())
    assert f"{side}:1: " in refusal.value.message
    assert message in refusal.value.message
    assert hint in refusal.value.hint


@pytest.mark.parametrize("key", ["rests", "body_rests"])
def test_a_standstill_named_outside_of_the_log_is_refused(tmp_path: Path, key: str) -> None:
    make.written(tmp_path, f"{key} = [[0, 1.2], [1760000008, 1760000009]]\n", "trial.toml")
    with pytest.raises(InputError, match=r"from 1\.76e\+09 s .* lies outside of the log"):
        make.read(tmp_path, make.text())


def test_what_a_laboratory_knows_is_read_and_written(tmp_path: Path) -> None:
    text = "rests = [[0, 1.2], [5, 6]]\nbody_rests = [[3, 4.0]]\ndistance_measured_m = 2.03\nturned = true\n"
    make.written(
        tmp_path, text + "use_reference = true\nref_x_std_m = 0.002\nclock_offset_s = 0\n", "trial.toml"
    )
    trial = make.read(tmp_path, make.text())
    info = trial.info
    assert info.rests == ((0.0, 1.2), (5.0, 6.0))
    assert (info.body_rests, info.distance_measured, info.use_reference) == (((3.0, 4.0),), 2.03, True)
    assert (info.ref_x_std, info.ref_v_std, info.clock_offset) == (0.002, None, 0.0)
    write_canonical(tmp_path / "again.csv", trial)
    assert read_trial(tmp_path / "again.csv").info == info


def test_the_conditions_that_later_stages_read_are_known() -> None:
    assert set(CONDITIONS) == {*KEYS, tow.KEY}


@pytest.mark.parametrize("name", ["t_ns", "time_ns", "timestamp_ns", "stamp_ns"])
def test_a_column_of_time_may_have_any_of_the_usual_names_with_its_unit(tmp_path: Path, name: str) -> None:
    rows = "".join(f"{1_760_000_000_000_000_000 + 10_000_000 * k},0,0,9.81,0,0,0\n" for k in range(50))
    columns = "imu_ax_mps2,imu_ay_mps2,imu_az_mps2,imu_gx_radps,imu_gy_radps,imu_gz_radps"
    path = tmp_path / "log.csv"
    path.write_text(f"{name},{columns}\n{rows}")
    t = read_trial(path).imu.t
    assert np.diff(t) == pytest.approx(0.01, abs=1e-6)
