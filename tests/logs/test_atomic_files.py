"""Files are written whole or not at all."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from granite_lab.errors import InputError, LabError
from granite_lab.files import readable, sha256, write_bytes, write_text, writing


def test_the_old_content_stays_until_the_new_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old\n")

    def fail() -> None:
        with writing(path) as file:
            file.write(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "old\n"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_an_interrupt_leaves_nothing_behind(tmp_path: Path) -> None:
    def interrupted() -> None:
        with writing(tmp_path / "a.txt") as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_text_is_utf8_with_plain_line_ends_in_folders_that_are_made(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "a.txt"
    write_text(path, "λ_R = 8 %\n")
    assert path.read_bytes() == "λ_R = 8 %\n".encode()


def test_the_mode_follows_the_umask(tmp_path: Path) -> None:
    old = os.umask(0o027)
    try:
        write_bytes(tmp_path / "a", b"x")
    finally:
        os.umask(old)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640


def test_a_link_keeps_pointing_where_it_did(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("old")
    link.symlink_to(target)
    write_text(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_a_long_name_is_no_trouble_but_a_too_long_one_is_said(tmp_path: Path) -> None:
    write_text(tmp_path / ("a" * 250), "x")
    with pytest.raises(LabError, match="file name is too long") as caught:
        write_text(tmp_path / ("a" * 300), "x")
    assert caught.value.exit_code == 1


def test_a_folder_in_the_way(tmp_path: Path) -> None:
    with pytest.raises(LabError, match="cannot be written: is a directory"):
        write_text(tmp_path, "x")


def test_a_full_disk_is_said() -> None:
    full = OSError(28, "No space left on device")
    error = readable(full, "x.csv", "write")
    assert "no space left on the device" in error.message
    assert error.exit_code == 1


def test_the_hash_is_sha256(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"granite" * 100_000)
    assert sha256(path) == hashlib.sha256(b"granite" * 100_000).hexdigest()
    with pytest.raises(InputError, match="does not exist"):
        sha256(tmp_path / "b")
