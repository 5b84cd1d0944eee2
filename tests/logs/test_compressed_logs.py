"""Logs in `.csv.gz` and `.zip`: the records of the plain file, and clear words about damaged archives."""

from __future__ import annotations

import gzip
import zipfile
from pathlib import Path

import numpy as np
import pytest

from granite_lab.errors import InputError
from granite_lab.logs import inspect_logs, read_trial
from granite_lab.logs.named import name_of, trial_files
from tests.logs import make

META = 'v_desired_mps = 0.3\nsoil = "dry_sand"\n'


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    path = tmp_path / "plain" / "run.csv"
    path.parent.mkdir()
    path.write_text(make.text())
    path.with_suffix(".toml").write_text(META)
    return path


def packed(plain: Path, name: str, inside: tuple[str, ...] = ("run.csv",)) -> Path:
    path = plain.parent.parent / name
    (path.parent / "run.toml").write_text(META)
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
    assert one.imu is not None
    assert other.imu is not None
    np.testing.assert_array_equal(other.imu.t, one.imu.t)
    np.testing.assert_array_equal(other.imu.specific_force, one.imu.specific_force)
    assert inspect_logs([path]).files[0].layout == "canonical"


def test_a_fault_in_a_compressed_log_has_its_line(plain: Path) -> None:
    plain.write_text(plain.read_text().replace("\n0.5,", "\n0.5x,"))
    with pytest.raises(InputError, match=r"run\.csv\.gz:52: column 't_s': '0\.5x' is not a number"):
        read_trial(packed(plain, "run.csv.gz"))


def test_damaged_and_unclear_archives_are_refused(plain: Path) -> None:
    cut = packed(plain, "cut.csv.gz")
    cut.write_bytes(cut.read_bytes()[:-2000])
    broken = packed(plain, "broken.zip")
    broken.write_bytes(broken.read_bytes()[:-30])
    false = plain.parent.parent / "false.csv.gz"
    false.write_text(plain.read_text())
    for path in (cut, broken, false):
        with pytest.raises(InputError, match="cannot be unpacked") as caught:
            read_trial(path)
        assert caught.value.hint
    with pytest.raises(InputError, match=r"expected one table .* in the archive, found a\.csv, b\.csv"):
        read_trial(packed(plain, "two.zip", ("a.csv", "b.csv")))
    with pytest.raises(InputError, match=r"expected one table .* in the archive, found none"):
        read_trial(packed(plain, "none.zip", ("a.pdf",)))


def test_a_folder_holds_compressed_logs_once(plain: Path) -> None:
    for name in ("run.csv.gz", "other.csv.gz"):
        packed(plain, name).rename(plain.parent / name)
    assert [path.name for path in trial_files(plain.parent)] == ["other.csv.gz", "run.csv"]
    assert name_of(Path("a.b.csv.gz")) == "a.b"
