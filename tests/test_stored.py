"""What is kept comes back whole, from nobody but the user, and not more of it than there is room for."""

import os
import time
from pathlib import Path

import pytest

from granite_lab.stored import Store

NAME = f"{'a1' * 32}.o"
FOREIGN = ("thesis.tex", "some.o", "a.result", "0" * 64, ".x.part", f"{'0' * 64}.csv")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """A store in a folder that is not there yet."""
    return Store(tmp_path / "kept", 1000, "results are")


def test_content_is_kept_for_the_next_process_and_damaged_content_is_not_taken(store: Store) -> None:
    assert store.keep(NAME, b"code") == ""
    assert store.read(NAME) == b"code"
    file = store.folder / NAME
    whole = file.read_bytes()
    for damaged in (whole[:-1], whole[:10], b"", whole[:-1] + b"x"):
        file.write_bytes(damaged)
        assert store.read(NAME) is None
    assert store.read("other.o") is None


def test_a_folder_that_cannot_be_used_is_no_fault_and_says_why(store: Store) -> None:
    store.folder.write_text("")
    assert "cannot be written" in store.keep(NAME, b"code")
    assert store.read(NAME) is None
    inside = Store(store.folder / "deeper", 1000, "results are")
    assert "cannot be written" in inside.keep(NAME, b"code")


def test_what_was_used_longest_ago_and_what_was_never_finished_is_removed(store: Store) -> None:
    names = [f"{k:064x}.result" for k in range(4)]
    for age, name in enumerate(names):
        store.keep(name, bytes(400))
        os.utime(store.folder / name, (time.time() - 100 + age,) * 2)
    begun = [store.folder / f".{'0' * 64}.result.{k:012x}.part" for k in range(2)]
    for path, used in zip(begun, (0.0, time.time()), strict=True):
        path.write_bytes(b"x")
        os.utime(path, (used, used))
    store.keep(NAME, bytes(400))
    assert sorted(store.folder.iterdir()) == sorted([begun[1], store.folder / NAME, store.folder / names[3]])


def test_nothing_is_removed_or_replaced_but_what_was_kept(store: Store) -> None:
    store.folder.mkdir(mode=0o700)
    for name in FOREIGN:
        (store.folder / name).write_text("mine" * 1000)
        os.utime(store.folder / name, (0, 0))
    inside = store.folder / f"{'1' * 64}.result" / "inside"
    inside.parent.mkdir()
    inside.write_text("mine")
    for name in (NAME, f"{'b2' * 32}.result"):
        store.keep(name, bytes(900))
    assert all((store.folder / name).read_text() == "mine" * 1000 for name in FOREIGN)
    assert inside.read_text() == "mine"
    assert not (store.folder / NAME).exists()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
def test_what_others_could_have_written_is_not_read_and_that_is_said(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = os.umask(0o002)  # as on systems that give each user a group
    try:
        store.keep(NAME, b"code")
    finally:
        os.umask(old)
    folder, file = store.folder, store.folder / NAME
    assert (folder.stat().st_mode & 0o777, file.stat().st_mode & 0o777) == (0o700, 0o600)
    assert store.read(NAME) == b"code"
    assert store.doubts() == ()
    for path, mode in ((file, 0o620), (folder, 0o770), (folder, 0o702)):
        before = path.stat().st_mode
        path.chmod(mode)
        assert store.read(NAME) is None
        path.chmod(before)
    folder.chmod(0o777)
    (line,) = store.doubts()
    assert line.startswith(f"{folder} belongs to another user or can be written by others, so results are")
    assert store.keep(f"{'b2' * 32}.o", b"code") == line
    assert [path.name for path in folder.iterdir()] == [NAME]
    folder.chmod(0o700)
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    assert store.read(NAME) is None
    assert len(store.doubts()) == 1
