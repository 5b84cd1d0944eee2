"""Logs that are no plain text file: compressed, MATLAB, a folder with a file a sensor."""

import gzip
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from granite_lab.errors import InputError
from granite_lab.logs import inspect_logs, read_trial
from granite_lab.logs.trial import name_of, trial_files
from tests.corpus.cli import succeeded
from tests.logs import make

META = 'robot = "granite"\nv_desired_mps = 0.3\nsoil = "dry_sand"\n'


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    make.written(tmp_path, META, "plain/run.toml")
    return make.written(tmp_path, make.text(), "plain/run.csv")


def packed(plain: Path, name: str, inside: tuple[str, ...] = ("run.csv",)) -> Path:
    path = plain.parent.parent / name
    make.written(path.parent, META, "run.toml")
    if name.endswith(".gz"):
        path.write_bytes(gzip.compress(plain.read_bytes()))
    else:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for member in inside:
                archive.write(plain, member)
    return path


@pytest.mark.parametrize("name", ["run.csv.gz", "run.zip", "run.csv.zip"])
def test_a_compressed_log_gives_the_record_of_the_plain_file(name: str, plain: Path) -> None:
    path = packed(plain, name, ("folder/run.csv", "__MACOSX/._run.csv", "notes.md"))
    one, other = read_trial(plain), read_trial(path)
    assert other.name == "run"
    assert (other.info, other.warnings, other.layout) == (one.info, one.warnings, one.layout)
    make.same(one, other)
    assert inspect_logs([path]).files[0].layout == "canonical"


def test_a_fault_in_a_compressed_log_has_its_line(plain: Path) -> None:
    plain.write_text(plain.read_text().replace("\n0.5,", "\n0.5x,"))
    said = read_trial(packed(plain, "run.csv.gz")).warnings
    assert any("run.csv.gz:52: column 't_s': '0.5x' is not a number" in line for line in said)


@pytest.mark.parametrize("kind", ["ZIP_DEFLATED", "ZIP_BZIP2", "ZIP_LZMA"])
def test_a_damaged_archive_of_any_kind_is_refused_in_one_line(kind: str, plain: Path) -> None:
    path = plain.parent / "run.zip"
    with zipfile.ZipFile(path, "w", getattr(zipfile, kind)) as archive:
        archive.write(plain, "run.csv")
    whole = path.read_bytes()
    assert read_trial(path).imu is not None
    for place in range(40, min(len(whole) - 200, 400), 7):
        path.write_bytes(
            whole[:place] + bytes(b ^ 0x5A for b in whole[place : place + 9]) + whole[place + 9 :]
        )
        with pytest.raises(InputError, match="cannot be unpacked"):
            read_trial(path)


def test_damaged_and_unclear_archives_are_refused(plain: Path) -> None:
    cut, broken = packed(plain, "cut.csv.gz"), packed(plain, "broken.zip")
    cut.write_bytes(cut.read_bytes()[:-2000])
    broken.write_bytes(broken.read_bytes()[:-30])
    for path in (cut, broken, make.written(plain.parent, plain.read_bytes(), "false.csv.gz")):
        with pytest.raises(InputError, match="cannot be unpacked") as caught:
            read_trial(path)
        assert caught.value.hint
    for members, found in ((("a.csv", "b.csv"), r"a\.csv, b\.csv"), (("a.pdf",), "none")):
        with pytest.raises(InputError, match=rf"expected one table .* in the archive, found {found}"):
            read_trial(packed(plain, "archive.zip", members))


def test_a_folder_holds_compressed_logs_once(plain: Path) -> None:
    for name in ("run.csv.gz", "other.csv.gz"):
        packed(plain, name).rename(plain.parent / name)
    assert [path.name for path in trial_files(plain.parent)] == ["other.csv.gz", "run.csv"]
    assert name_of(Path("a.b.csv.gz")) == "a.b"


def vectors() -> dict[str, np.ndarray]:
    """The log, a vector a column."""
    table = np.array([line.split(",") for line in make.lines()[1:]], dtype=float)
    return dict(zip(make.COLUMNS, table.T, strict=True))


def matlab(folder: Path, content: dict[str, Any]) -> Path:
    path = folder / "run.mat"
    savemat(path, content)
    return path


@pytest.mark.parametrize(
    "content",
    [
        vectors(),
        {"log": vectors(), "robot": "granite", "gain": np.array([1.0, 2.0, 3.0])},
        {"log": {**vectors(), "T": np.zeros(30)}},
        {"log": {"imu": dict(list(vectors().items())[:7]), "wheels": dict(list(vectors().items())[7:])}},
    ],
    ids=["vectors", "a struct", "a vector that is no column", "structs in a struct"],
)
def test_a_matlab_file_gives_the_record_of_the_plain_file(
    content: dict[str, Any], plain: Path, tmp_path: Path
) -> None:
    make.written(tmp_path, META, "run.toml")
    path = matlab(tmp_path, content)
    one, other = read_trial(plain), read_trial(path)
    make.same(one, other)
    assert (other.name, other.info, other.layout, other.warnings) == ("run", one.info, "canonical", ())
    assert inspect_logs([path]).files[0].dialect is None


def test_matrices_are_columns_along_their_longer_side(tmp_path: Path) -> None:
    table = np.array(list(vectors().values()))
    path = matlab(tmp_path, {"ts": table[0], "acc": table[1:4].T, "spin": table[4:7], "counts": table[7:]})
    report = inspect_logs([path]).files[0]
    to = {column.name: column.to for column in report.columns}
    assert (to["ts"], to["acc_x"], to["counts_4"]) == (("t",), ("imu_ax",), ("enc_rr",))
    text = report.to_map_toml().replace('unit = "counts"', 'unit = "rad"') + "".join(
        f'[[column]]\nname = "spin_{axis}"\nto = ["imu_g{axis}"]\nunit = "rad/s"\n' for axis in "xyz"
    )
    own = make.written(tmp_path, text, "map.toml")
    make.same(read_trial(path, map=own), make.read(tmp_path, make.text()))


MATLAB = {
    "different lengths": (
        {"imu": {"t": np.zeros(100), "ax": np.zeros(100)}, "enc": dict.fromkeys("tw", np.zeros(50))},
        r"vectors of different lengths: enc\.t \(50\), imu\.t \(100\)", "table2struct",
    ),
    "an array of structs": (
        {"runs": np.array([{"t": np.zeros(9)}, {"t": np.zeros(8)}], dtype=object)},
        "'runs' is an array of 2 structs, expected a file for each run", "s = runs(k)",
    ),
    "no vectors": ({"note": "nothing", "gain": 3.0}, "no vectors of numbers", "table2struct"),
    "damaged": (b"MATLAB 5.0 MAT-file" + bytes(200), "cannot be read as a MATLAB file", "again"),
    "text": (b"t_s,imu_ax_mps2\n0,1\n", "cannot be read as a MATLAB file", "again"),
    "version 7.3": (
        b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n" + bytes(500),
        "is a MATLAB file of version 7.3", "-v7",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", MATLAB)
def test_a_matlab_file_that_is_no_table_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    content, said, hint = MATLAB[case]
    path = tmp_path / "run.mat"
    matlab(tmp_path, content) if isinstance(content, dict) else path.write_bytes(content)
    with pytest.raises(InputError, match=said) as caught:
        read_trial(path)
    assert hint in caught.value.hint
    assert inspect_logs([path]).files[0].problem == caught.value.message


def test_a_folder_with_a_file_a_sensor_is_one_trial(plain: Path, tmp_path: Path) -> None:
    """Each file has a layout of its own; one takes a map from a folder of maps, another is passed over."""
    folder = tmp_path / "drive"
    wheels = make.only("t_s", *make.WHEELS).replace("t_s", "when").replace("enc_", "drehung ")
    make.written(folder, make.only("t_s", *make.IMU[:3]), "Accelerometer.csv")
    make.written(folder, make.only("t_s", *make.IMU[3:]).replace("t_s", "time"), "gyro.csv")
    make.written(folder, wheels, "wheel_encoders.csv")
    make.written(folder, "no,table\n", "Barometer.csv")
    make.written(tmp_path, META, "drive.toml")
    entries = "".join(
        f'[[column]]\nname = "drehung {name[4:]}"\nto = ["{name[:6]}"]\nunit = "rad"\n'
        for name in make.WHEELS
    )
    time = '[[column]]\nname = "{}"\nto = ["t"]\nunit = "s"\n'
    make.written(tmp_path, 'name = "wheels"\n' + time.format("when") + entries, "maps/wheels.toml")
    for kind, column in (("a", "t_s"), ("g", "time")):
        sensor = make.IMU[:3] if kind == "a" else make.IMU[3:]
        unit = "m/s^2" if kind == "a" else "rad/s"
        entries = "".join(f'[[column]]\nname = "{n}"\nto = ["{n[:6]}"]\nunit = "{unit}"\n' for n in sensor)
        make.written(tmp_path, f'name = "{kind}"\n' + time.format(column) + entries, f"maps/{kind}.toml")
    trial = read_trial(folder, map=tmp_path / "maps")
    make.same(trial, read_trial(plain))
    assert trial.name == "drive"
    assert trial.info.v_desired == 0.3
    assert trial_files(folder) == [folder]
    names = ["Accelerometer.csv", "gyro.csv", "wheel_encoders.csv"]
    assert [file.path.name for file in inspect_logs([folder], map=tmp_path / "maps").files] == names
    assert sorted(file.path.name for file in trial.inputs) == ["Accelerometer.csv", "drive.toml", *names[1:]]


@pytest.mark.usefixtures("fits_by_slip")
def test_every_command_takes_such_a_folder(tmp_path: Path) -> None:
    make.written(tmp_path, META, "runs/drive.toml")
    make.written(tmp_path, make.only("t_s", *make.IMU), "runs/drive/imu.csv")
    make.written(tmp_path, make.only("t_s", *make.WHEELS), "runs/drive/encoders.csv")
    for args in (("ingest", "--out"), ("study", "--no-discover", "--no-recordings", "--out")):
        out = tmp_path / args[0]
        done = succeeded(*args, out, tmp_path / "runs", "-q", "-j", 1)
        assert "drive" in done.out
