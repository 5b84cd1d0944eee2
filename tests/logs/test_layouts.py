"""Logs of other programs are recognised by their columns, or guessed; maps of either read them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from granite_lab.errors import InputError, UsageError
from granite_lab.logs import Excerpt, inspect_logs
from granite_lab.logs.inspection import FileReport
from granite_lab.logs.layouts import all_layouts, load_layout
from granite_lab.logs.quantities import by_name
from granite_lab.parameters import variant_of
from tests.corpus.cli import SAMPLES
from tests.logs import make
from tests.soak import examples

N = 200
T = np.arange(N) / 100  # [s]
G = 9.80665
EPOCH = 1_494_450_133_515_674_721


def table(header: str, row: str) -> str:
    """Fill a row's pattern for every instant; k is its number, t its time."""
    noise = np.random.default_rng(1).normal(0, 0.003, (N, 6))
    rows = [
        row.format(
            k=k, t=T[k], ns=EPOCH + 10_000_000 * k, ms=1000 * T[k], us=10_000 * k,
            ax=0.1 + noise[k, 0], ay=0.2 + noise[k, 1], az=9.8 + noise[k, 2],
            gx=0.01 + noise[k, 3] / 10, gy=0.02 + noise[k, 4] / 10, gz=0.03 + noise[k, 5] / 10,
            ga=0.1 / G, gb=0.2 / G, gc=9.8 / G, dx=0.573, dy=1.146, dz=1.719, turn=0.05 * k,
        )
        for k in range(N)
    ]  # fmt: skip
    return "\n".join([header, *rows]) + "\n"


SIX = "{gx},{gy},{gz},{ax},{ay},{az}"
ACC_FIRST = "{ax},{ay},{az},{gx},{gy},{gz}"
ROSTOPIC = ",".join(f"field.{v}.{a}" for v in ("angular_velocity", "linear_acceleration") for a in "xyz")
EUROC = ",".join(
    [f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"] + [f"a_RS_S_{axis} [m s^-2]" for axis in "xyz"]
)
XSENS = "// Start Time: Unknown\n// Sample rate: 100.0Hz\n// Firmware: 2.6.0\n"
DOT = "sep=,\nDeviceTag:,D1\nOutputRate:,100Hz\n\n"

# name: (file name, lines above the header, header, row, layout)
WRITTEN = {
    "plain": ("imu.csv", "", "time,wx,wy,wz,ax,ay,az", "{t}," + SIX, "plain_imu"),
    "plain with units": (
        "imu.csv", "",
        "timestamp (ms),acc_x (g),acc_y (g),acc_z (g),gyr_x (deg/s),gyr_y (deg/s),gyr_z (deg/s)",
        "{ms},{ga},{gb},{gc},{dx},{dy},{dz}", "plain_imu",
    ),
    "rostopic": (
        "imu.csv", "", f"%time,field.header.seq,field.header.stamp,field.header.frame_id,{ROSTOPIC}",
        "{ns},{k},{ns},imu_link," + SIX, "rostopic_imu",
    ),
    "rostopic without header stamp": (
        "imu.csv", "", f"%time,field.header.stamp,{ROSTOPIC}", "{ns},0," + SIX, "rostopic_imu",
    ),
    "Xsens MT": (
        "MT_0080003F51.txt", XSENS,
        "PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tMag_X",
        "{k}\t{k}00\t" + ACC_FIRST.replace(",", "\t") + "\t0.5", "xsens_mt",
    ),
    "Xsens DOT": (
        "D1.csv", DOT, "PacketCounter,SampleTimeFine,Euler_X,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,",
        "{k},{us},0.1,{ax},{ay},{az},{dx},{dy},{dz},", "xsens_dot",
    ),
    "EuRoC": ("data.csv", "", f"#timestamp [ns],{EUROC}", "{ns}," + SIX, "euroc"),
    "VESC": (
        "vesc.csv", "",
        "ms_today;input_voltage;current_motor;erpm;tachometer;speed_meters_per_sec;accX;accY;accZ;gyroX;gyroY;gyroZ;",
        "{ms};40.1;8.0;1000;5;0.0;{ga};{gb};{gc};{dx};{dy};{dz};", "vesc",
    ),
}  # fmt: skip
IMUS = {case: (above + table(*rows), name, layout) for case, (name, above, *rows, layout) in WRITTEN.items()}


@pytest.mark.parametrize("case", IMUS)
def test_an_imu_log_is_recognised(case: str, tmp_path: Path) -> None:
    content, name, layout = IMUS[case]
    trial = make.read(tmp_path, content, name, robot="granite")
    assert trial.layout == layout
    assert len(trial.imu.t) == N
    np.testing.assert_allclose(np.diff(trial.imu.t), 0.01, atol=3e-7)
    np.testing.assert_allclose(trial.imu.specific_force.mean(axis=0), [0.1, 0.2, 9.8], atol=2e-3)
    np.testing.assert_allclose(trial.imu.angular_rate.mean(axis=0), [0.01, 0.02, 0.03], atol=2e-4)
    expected = "the stamps are those of '%time'" if "without header stamp" in case else "constant"
    assert not [line for line in trial.warnings if expected not in line]


def test_columns_that_look_like_a_sensor_are_not_passed_over_in_silence(tmp_path: Path) -> None:
    content = table("time,wx,wy,wz,ax,ay,az,left_encoder,mood", "{t}," + SIX + ",{k},1")
    said = [line for line in make.read(tmp_path, content, "imu.csv").warnings if "not used" in line]
    assert len(said) == 1
    assert "imu.csv: left_encoder: not used, because layout 'plain_imu'" in said[0]


def test_an_axis_with_an_unknown_unit_is_not_passed_over_in_silence(tmp_path: Path) -> None:
    content = make.text().replace("imu_gx_radps", "imu_gx [furlong]", 1)
    said = [line for line in make.read(tmp_path, content).warnings if "not used" in line]
    assert len(said) == 1
    assert (
        "imu_gx [furlong]: not used, because layout 'canonical' does not know the name or its unit" in said[0]
    )


def test_phones_write_one_file_a_sensor(tmp_path: Path) -> None:
    header = "time,seconds_elapsed,z,y,x"
    gyro = make.written(tmp_path, table(header, "{ns},{t},{gz},{gy},{gx}"), "Gyroscope.csv")
    trial = make.read(
        tmp_path, table(header, "{ns},{t},{az},{ay},{ax}"), "TotalAcceleration.csv", beside={"imu": gyro}
    )
    assert trial.layout == "sensor_logger_total + sensor_logger_gyroscope"
    np.testing.assert_allclose(trial.imu.specific_force.mean(axis=0), [0.1, 0.2, 9.8], atol=2e-3)
    np.testing.assert_allclose(trial.imu.angular_rate.mean(axis=0), [0.01, 0.02, 0.03], atol=2e-4)
    assert not trial.imu.gravity_removed


def test_a_phone_that_takes_gravity_away_is_known(tmp_path: Path) -> None:
    content = table("time,seconds_elapsed,z,y,x", "{ns},{t},{gz},{gy},{gx}")
    trial = make.read(tmp_path, content, "Accelerometer.csv")
    assert trial.imu.gravity_removed


def test_phyphox_with_sensors_on_different_stamps(tmp_path: Path) -> None:
    acc = table(
        '"Time (s)";"Acceleration x (m/s^2)";"Acceleration y (m/s^2)";"Acceleration z (m/s^2)"',
        "{t};{ax};{ay};{az}",
    )
    lines = table(
        '"Time (s)";"Gyroscope x (rad/s)";"Gyroscope y (rad/s)";"Gyroscope z (rad/s)"', "{t};{gx};{gy};{gz}"
    ).splitlines()
    shifted = [f"{float(line.split(';')[0]) + 0.004};" + line.split(";", 1)[1] for line in lines[1:]]
    gyro = make.written(tmp_path, "\n".join([lines[0], *shifted]), "Gyroscope.csv")
    trial = make.read(tmp_path, acc, "Accelerometer.csv", beside={"imu": gyro})
    assert len(trial.imu.t) == N - 1
    assert trial.imu.t[0] == 0.01
    np.testing.assert_allclose(trial.imu.angular_rate.mean(axis=0), [0.01, 0.02, 0.03], atol=2e-4)
    assert any("interpolated" in line for line in trial.warnings)


def test_wheels_of_a_rover_a_vesc_and_rostopic(tmp_path: Path) -> None:
    header = "timestamp," + ",".join(f"enc{i}_rad" for i in range(1, 5))
    header += "," + ",".join(f"vel{i}_rad_s" for i in range(1, 5))
    header += "," + ",".join(f"current{i}" for i in range(1, 5))
    trial = make.read(tmp_path, table(header, "{t},{turn},1,2,3,9,9,9,9,0.1,0.2,0.3,0.4"), "rover.csv")
    assert trial.layout == "rover"
    assert trial.wheels.rate is None
    np.testing.assert_allclose(trial.wheels.angle[:, 0], 0.05 * np.arange(N))
    np.testing.assert_array_equal(trial.currents.current[0], [0.1, 0.2, 0.3, 0.4])
    trial = make.read(tmp_path, *IMUS["VESC"][:2])
    np.testing.assert_array_equal(trial.currents.current, 2.0)  # a share of the battery's
    assert trial.wheels.rate is not None
    odometry = table("%time,field.header.stamp,field.twist.twist.linear.x", "{ns},{ns},0.33")
    np.testing.assert_allclose(make.read(tmp_path, odometry, "odom.csv", robot="husky").wheels.rate, 2.0)


def test_a_clock_of_the_day_goes_past_midnight(tmp_path: Path) -> None:
    lines = IMUS["VESC"][0].splitlines()
    late = [
        f"{(86_399_000 + 10 * k) % 86_400_000};" + line.split(";", 1)[1] for k, line in enumerate(lines[1:])
    ]
    trial = make.read(tmp_path, "\n".join([lines[0], *late]), "vesc.csv")
    np.testing.assert_allclose(np.diff(trial.imu.t), 0.01, atol=1e-9)


MAP = """
name = "mine"
[table]
delimiter = ";"
[[column]]
name = "tick"
to = ["t"]
unit = "ms"
[[column]]
pattern = 'left_(?P<unit>.*)'
to = ["enc_fl", "enc_rl"]
[[column]]
name = "right"
to = ["enc_fr", "enc_rr"]
unit = "counts"
counts_per_rev = 100
scale = -1
"""


def own(folder: Path, text: str = MAP) -> Path:
    return make.written(folder, text, "mine.toml")


def test_a_new_logger_is_one_file(tmp_path: Path) -> None:
    content = table("tick;left_deg;right;mood", "{ms};{k};{k};good")
    trial = make.read(tmp_path, content, map=own(tmp_path))
    np.testing.assert_allclose(trial.wheels.angle[10], np.deg2rad([10, -36, 10, -36]))


def test_a_map_may_name_the_columns_of_a_file_without_header(tmp_path: Path) -> None:
    text = MAP.replace('delimiter = ";"', 'delimiter = "tab"\nnames = ["tick", "left_deg", "right"]')
    content = "\n".join(table("", "{ms}\t{k}\t{k}").splitlines()[1:])
    trial = make.read(tmp_path, content, map=own(tmp_path, text))
    assert len(trial.wheels.t) == N


def test_rows_are_chosen_by_a_column(tmp_path: Path) -> None:
    text = MAP + '[[column]]\nname = "run"\nto = []\n'
    content = "tick;left_deg;right;run\n" + "\n".join(
        f"{10 * (k % 100)};{k};{k};{k // 100}" for k in range(300)
    )
    path = own(tmp_path, text.replace('name = "mine"', 'name = "mine"\nsplit = "run"'))
    with pytest.raises(InputError, match="holds several runs: run = 0, 1, 2"):
        make.read(tmp_path, content, map=path)
    trial = make.read(tmp_path, content, map=path, excerpt=Excerpt(rows="run = 2"))
    assert trial.wheels.angle[0, 0] == pytest.approx(np.deg2rad(200))
    fixed = own(tmp_path, text.replace('name = "mine"', 'name = "mine"\nrows = "run = 1"'))
    trial = make.read(tmp_path, content, map=fixed)
    assert trial.wheels.angle[0, 0] == pytest.approx(np.deg2rad(100))
    for rows, said, error in (
        ("run = 7", "no row has run = 7", InputError),
        ("lap = 7", "there is no column 'lap'", InputError),
        ("run 7", "cannot be understood", UsageError),
    ):
        with pytest.raises(error, match=said):
            make.read(tmp_path, content, map=fixed, excerpt=Excerpt(rows=rows))


def test_two_maps_that_fit_equally_are_not_chosen_between(tmp_path: Path) -> None:
    other = MAP.replace('"mine"', '"other"').replace("scale = -1", "scale = 1")
    one, two = own(tmp_path), make.written(tmp_path, other, "other.toml")
    content = table("tick;left_deg;right", "{ms};{k};{k}")
    with pytest.raises(InputError, match="could be of layout 'mine' or 'other'"):
        make.read(tmp_path, content, map=[one, two])


def test_every_map_of_the_catalogue_is_valid_and_named_like_its_file() -> None:
    assert len(all_layouts()) >= 20
    for layout in all_layouts():
        assert load_layout(layout.name) == layout
        assert layout.title
        assert layout.source
    with pytest.raises(UsageError) as caught:
        load_layout("kobukki")
    assert "did you mean 'kobuki'" in caught.value.hint


def inspected(folder: Path, content: str) -> FileReport:
    return inspect_logs([make.written(folder, content)]).files[0]


STRANGE = {
    "t_s": "Zeit [ms]", "imu_ax_mps2": "Accelerometer.X (m/s²)", "imu_ay_mps2": "Accelerometer.Y (m/s²)",
    "imu_az_mps2": "Accelerometer.Z (m/s²)", "imu_gx_radps": "gyroX", "imu_gy_radps": "gyroY",
    "imu_gz_radps": "gyroZ", "enc_fl_rad": "wheel_front_left_pos", "enc_fr_rad": "wheel_front_right_pos",
    "enc_rl_rad": "wheel_rear_left_pos", "enc_rr_rad": "wheel_rear_right_pos",
}  # fmt: skip


def renamed(names: dict[str, str], delimiter: str) -> str:
    """Return the log whose columns have other names."""
    header, _, rows = make.text().replace(",", delimiter).partition("\n")
    return delimiter.join(names[name] for name in header.split(delimiter)) + "\n" + rows


def test_an_unknown_log_is_guessed_and_its_map_reads_it(tmp_path: Path) -> None:
    report = inspected(tmp_path, renamed({**STRANGE, "t_s": "time_stamp"}, ";"))
    assert report.layout == ""
    assert {c.name: c.to for c in report.columns}["wheel_rear_left_pos"] == ("enc_rl",)
    assert all(0 < c.confidence < 1 for c in report.columns)
    make.same(make.mapped(tmp_path, report.path), make.read(tmp_path, make.text(), "plain.csv"))


def test_without_telling_names_clock_and_gravity_are_found_by_value(tmp_path: Path) -> None:
    names = {name: f"Kanal {k}" for k, name in enumerate(make.COLUMNS)}
    to = [c.to for c in inspected(tmp_path, renamed(names, ",")).columns]
    assert to == [("t",), ("imu_ax",), ("imu_ay",), ("imu_az",), *[()] * 7]


@pytest.mark.parametrize(
    ("name", "to", "unit"),
    [
        ("gyroX (°/s)", ("imu_gx",), "deg/s"),
        ("accel_z_g", ("imu_az",), "g"),
        ("Acceleration Y", ("imu_ay",), "m/s^2"),
        ("AccY", ("imu_ay",), "m/s^2"),
        ("wz", ("imu_gz",), "rad/s"),
        ("left_encoder", ("enc_fl", "enc_rl"), "rad"),
        ("encoderRight", ("enc_fr", "enc_rr"), "rad"),
        ("enc3_rad", ("enc_rl",), "rad"),
        ("front_left_wheel_speed_rpm", ("enc_fl",), "rpm"),
        ("/joint_states/front_left_wheel_joint/velocity", ("enc_fl",), "rad/s"),
        ("left_wheel_vel", ("enc_fl", "enc_rl"), "rad/s"),
        ("motor_current_rr_mA", ("cur_rr",), "mA"),
        ("v_cmd_mps", ("v_cmd",), "m/s"),
        ("mocap_v_mps", ("ref_v",), "m/s"),
        ("timestamp_ns", ("t",), "ns"),
        ("rate_pitch", ("imu_gy",), "rad/s"),
        ("rear_left_rpm", ("enc_rl",), "rpm"),
        ("gps_longitude", ("ref_lon",), "deg"),
        ("mocap_y_mm", ("ref_y",), "mm"),
        ("field.position1", (), ""),
        ("field.pose.covariance1", (), ""),
        ("battery", (), ""),
    ],
)
def test_names_are_understood(name: str, to: tuple[str, ...], unit: str) -> None:
    found = by_name(name)
    assert (found.to, found.unit) == (to, unit)


@pytest.mark.parametrize("name", ["roll", "pitch_deg", "Euler_Z", "field.orientation.w", "quat_x", "q3"])
def test_a_logged_attitude_is_recognised_and_said_to_be_of_no_use(name: str, tmp_path: Path) -> None:
    header, *rows = make.lines()
    report = inspected(tmp_path, "\n".join([f"{header},{name}", *(f"{row},0.5" for row in rows)]))
    column = report.columns[-1]
    assert (column.name, column.to, report.layout) == (name, (), "canonical")
    assert "attitude: recognised, not used" in column.why
    assert f'# name = "{name}"' in report.to_map_toml()


@pytest.mark.parametrize("velocity", [0.2, 0.3, 0.5, 0.7])
def test_a_known_log_is_described_whole_with_its_variant(velocity: float) -> None:
    report = inspect_logs([SAMPLES / f"virtual_v{velocity}_r1.csv"]).files[0]
    assert report.layout == "canonical"
    imu, wheels = (next(s for s in report.streams if s.what == what) for what in ("imu", "encoders"))
    assert imu.rate == pytest.approx(200, rel=0.02)
    assert wheels.rate == pytest.approx(100, rel=0.02)
    assert imu.gaps == 0
    assert len(report.rests) == 2
    assert report.motion.velocity == pytest.approx(velocity, rel=0.05)
    assert report.motion.acceleration == pytest.approx(variant_of(velocity).acceleration, rel=0.3)
    assert report.motion.variant == variant_of(velocity)
    assert json.dumps(report.as_json())


def test_a_speed_of_no_variant_is_none(tmp_path: Path) -> None:
    faster = make.only(
        *make.COLUMNS, change=lambda row: [*row[:7], *(f"{float(c) * 1.25:.9g}" for c in row[7:])]
    )
    assert inspected(tmp_path, faster).motion.variant is None


def test_gaps_wraps_and_doubts_are_told(tmp_path: Path) -> None:
    def counted(row: list[str]) -> list[str]:
        return [*row[:7], *(str((65_000 + round(float(c) * 106_000 / (2 * np.pi))) % 2**16) for c in row[7:])]

    text = re.sub(r"_rad\b", "_counts", make.only(*make.COLUMNS, change=counted))
    lines = ["# enc_counts_per_rev = 106000", *text.splitlines()]
    report = inspected(tmp_path, "\n".join(lines[:301] + lines[313:]))
    assert report.streams[0].gaps == 1
    assert report.streams[0].longest_gap == pytest.approx(0.13)
    assert any("wrapped" in doubt for doubt in report.doubts)


def test_a_file_without_header_gets_a_usable_map(tmp_path: Path) -> None:
    report = inspected(tmp_path, make.text().partition("\n")[2])
    assert "no header line" in report.problem
    assert len(make.mapped(tmp_path, report.path).imu.t) == len(make.lines()) - 1


def test_names_with_blanks_around_them_in_a_map_that_does_not_fit_are_inspected(tmp_path: Path) -> None:
    names = [f" {name} " for name in make.COLUMNS]
    text = MAP.replace('delimiter = ";"', f"names = {names}")
    path = make.written(tmp_path, make.text().partition("\n")[2])
    report = inspect_logs([path], map=own(tmp_path, text)).files[0]
    assert "column 'tick' is missing (and 2 more), expected by layout 'mine'" in report.problem
    assert [c.to for c in report.columns][:2] == [("t",), ("imu_ax",)]
    assert report.trial is None


def test_every_column_is_listed_and_has_a_stub_in_the_map(tmp_path: Path) -> None:
    """Of a known layout, too: a column that is not used, one of texts, and an empty one."""
    header, *rows = make.lines()
    report = inspected(
        tmp_path, "\n".join([header + ",battery,note,spare", *(x + ",24.1,ok," for x in rows)])
    )
    assert [c.name for c in report.columns] == [*make.COLUMNS, "battery", "note", "spare"]
    assert all(c.why.startswith("not used") for c in report.columns[-3:])
    assert all(f'name = "{name}"' in report.to_map_toml() for name in ("battery", "note", "spare"))
    make.same(make.mapped(tmp_path, report.path), make.read(tmp_path, make.text(), "plain.csv"))


cell_names = st.text(st.characters(exclude_categories=["Cs", "Cc", "Zl", "Zp"]), max_size=15)


@given(names=st.lists(cell_names, min_size=7, max_size=7), seed=st.integers(0, 100))
@settings(max_examples=examples(60), suppress_health_check=list(HealthCheck))
def test_any_header_can_be_inspected_and_mapped(names: list[str], seed: int, tmp_path: Path) -> None:
    quoted = ['"' + name.replace('"', '""') + '"' for name in names]
    t, imu, _ = make.rows(duration=2, seed=seed)
    rows = [",".join(map(repr, row)) for row in np.column_stack([t, imu]).tolist()]
    report = inspected(tmp_path, "\n".join([",".join(quoted), *rows]))
    own = make.written(tmp_path, report.to_map_toml(), "map.toml")
    if any("t" in column.to for column in report.entries):
        report = inspect_logs([report.path], map=own).files[0]
    assert report.dialect is not None
