"""Places that cannot be read or written, and names and cells from logs that are no plain text."""

import errno
import io
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest

from granite_lab.errors import printable
from granite_lab.logs import inspect_logs, read_trial
from granite_lab.parameters import load_variants
from tests.corpus.cli import LOG, SAMPLES, lab, refused
from tests.effects.example import EXAMPLE

SAMPLE = SAMPLES / "virtual_v0.3_r1.csv"
NOBODY = 65534


@contextmanager
def somebody_else() -> Iterator[None]:
    """Act as a user without rights; root may read everything."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


PLACES: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (str, "does not exist"),
    "folder": (Path.mkdir, "is a directory"),
    "loop": (lambda path: path.symlink_to(path), "its symbolic links form a loop"),
    "pipe": (os.mkfifo, "is not a regular file"),
    "device": (lambda path: path.symlink_to("/dev/zero"), "is not a regular file"),
    "forbidden": (lambda path: path.touch(mode=0), "permission denied"),
}

# what is asked, with the bad path in place of None; the file's name
READERS: dict[str, tuple[tuple[object, ...], str]] = {
    "ingest": (("ingest", None), "a.csv"),
    "ingest a bag": (("ingest", None), "a.bag"),
    "the wheels": (("ingest", SAMPLE, "--encoders", None), "a.csv"),
    "fit-k92": (("fit-k92", None), "a.csv"),
    "compare": (("compare", None), "a.csv"),
    "a map": (("ingest", SAMPLE, "--map", None), "a.toml"),
    "a robot": (("params", "--robot", None), "a.toml"),
    "a soil": (("params", "--soil", None), "a.toml"),
    "a model": (("simulate", "--variant", "0.5", "--model", None), "a.toml"),
    "an effect file": (("effects", "--effects", None), "a.py"),
    "a recording": (("view", None), "a.rrd"),
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("reader", READERS)
def test_what_cannot_be_read_is_one_line(
    reader: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, said = PLACES[place]
    args, name = READERS[reader]
    path = tmp_path / name
    words = [path if a is None else a for a in args]
    if place == "forbidden":
        lab(*words)  # imports what it needs: root's Python may be unreadable, too
    make(path)
    code = 3
    if place == "folder" and reader in ("ingest", "ingest a bag", "fit-k92", "compare"):
        code, said = 2, "the folder holds no log"
    elif place == "folder" and reader == "a recording":
        said = "no recording in it"
    monkeypatch.chdir("/" if place == "forbidden" else tmp_path)
    with somebody_else() if place == "forbidden" else nullcontext():
        done = lab(*words)
    refused(done, code, said, "permissions" if place == "forbidden" else "")
    assert str(path) in done.error
    assert not (tmp_path / "reports").exists()


WRITERS: dict[str, tuple[object, ...]] = {
    "a run": ("simulate", "--variant", "0.5", "--out", "OUT/run.csv"),
    "a run as Parquet": ("simulate", "--variant", "0.5", "--out", "OUT/run.parquet"),
    "a virtual log": ("simulate", "--variant", "0.5", "--out", "RUN", "--log", "OUT/log.csv"),
    "a motion": ("ingest", SAMPLE, "--out", "OUT", "--jobs", "1"),
    "a map": ("inspect", SAMPLE, "--write-map", "OUT/map.toml"),
    "a comparison": ("compare", SAMPLE, "--out", "OUT", "--jobs", "1"),
    "a report": ("study", SAMPLE, "--out", "OUT", "--jobs", "1", "--no-discover", "--no-recordings"),
    "a recording": ("study", SAMPLE, "--out", "OUT", "--jobs", "1", "--no-discover"),
    "a hidden set": ("hide", "--effect", "none", "--out", "OUT", "--repetitions", "1"),
}


def command(writer: str, out: Path, run: Path) -> list[str]:
    return [str(a).replace("OUT", str(out)).replace("RUN", str(run)) for a in WRITERS[writer]]


@pytest.fixture
def one_variant(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a hidden set have one trial: what goes wrong goes wrong at the first."""
    (slow, *_) = load_variants()
    monkeypatch.setattr("granite_lab.hidden.making.load_variants", lambda: (slow,))


@pytest.mark.usefixtures("fits_by_slip", "one_picture", "one_variant")
@pytest.mark.parametrize("writer", WRITERS)
def test_a_file_in_the_way_and_a_folder_without_permission_are_one_line(writer: str, tmp_path: Path) -> None:
    out, closed = tmp_path / "out", tmp_path / "closed"
    out.write_text("mine")
    refused(lab(*command(writer, out, tmp_path / "run.csv")), 1, "cannot be written")
    assert out.read_text() == "mine"
    for above in [tmp_path, *tmp_path.parents[:3]]:
        above.chmod(0o755)
    closed.mkdir(mode=0o555)
    with somebody_else():
        done = lab(*command(writer, closed, Path("/nowhere/run.csv")))
    assert done.code == 1, done
    assert "permission denied" in done.error
    assert "Traceback" not in done.err
    assert not list(closed.iterdir())


class Full(io.BytesIO):
    """A file on a disk that is full after some bytes."""

    room = 4000

    def write(self, data: Any) -> int:
        if self.tell() + len(data) > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)


@pytest.mark.usefixtures("one_variant")
@pytest.mark.parametrize(
    "writer", ["a run", "a run as Parquet", "a virtual log", "a motion", "a map", "a hidden set"]
)
def test_a_full_disk_is_one_line_and_leaves_nothing(
    writer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Single files go through one door, `files.writing`; here the disk behind it is small."""
    real = Path.open

    def small(self: Path, mode: str = "r", *args: Any, **kwargs: Any) -> Any:
        if self.name.endswith(".part"):
            real(self, mode, *args, **kwargs).close()
            return Full()
        return real(self, mode, *args, **kwargs)

    monkeypatch.setattr(Path, "open", small)
    Full.room = 100 if writer == "a map" else 4000
    out = tmp_path / "out"
    done = lab(*command(writer, out, out / "run.csv"))
    refused(done, 1, "no space left on the device", "free some space")
    assert not [p for p in out.rglob("*") if p.is_file() and p.stat().st_size]


def test_the_user_s_own_code_is_said_to_be_run_and_nothing_else_is(tmp_path: Path) -> None:
    for name in ("simulate", "effects", "study", "fit-k92", "discover"):
        shown = " ".join(lab(name, "--help").out.replace("│", " ").split())
        assert "It is executed: use only code you trust" in shown, name
    trace = tmp_path / "was_run"
    code = f"import pathlib\npathlib.Path({str(trace)!r}).touch()\n"
    for kind, args in {
        "a.toml": ("params", "--robot"),
        "b.toml": ("simulate", "--variant", "0.5", "--model"),
        "c.csv": ("ingest",),
        "d.toml": ("ingest", SAMPLE, "--map"),
    }.items():
        path = tmp_path / kind
        path.write_text(code)
        assert lab(*args, path).code == 3
    assert not trace.exists()
    own = tmp_path / "own.py"
    own.write_text(code + EXAMPLE)
    assert lab("effects", "--effects", own).code == 0
    assert trace.exists()


NAMES = {
    "markup": "[bold red]sand",
    "an open bracket": "sand[",
    "an escape sequence": "sand\x1b[2J\x1b]0;title\x07",
    "HTML": "<script>alert(1)<",
    "a formula": "=cmd|' C calc'!A0",
    "a link": "[x](javascript:alert(1))",
    "reading direction": "sand\u202egnp",
    "not a character": "sand\udcff",
    "quotes": "a\"b'c`d",
    "a line end": "two\nlines",
    "an option": "-rf",
}


def tame(text: str) -> bool:
    """Say whether a terminal shows a text as it stands."""
    return not any(c in text for c in "\x1b\x07\u202e\udcff\r")


@pytest.mark.parametrize("kind", NAMES)
def test_a_name_is_text_on_the_terminal_in_a_message_and_in_json(kind: str, tmp_path: Path) -> None:
    log, out = tmp_path / f"{NAMES[kind]}.csv", tmp_path / "out"
    done = lab("ingest", log)
    assert done.code == 3
    assert len(done.err.splitlines()) == 2
    assert tame(done.err)
    log.write_text(LOG)
    ingest, inspect = lab("ingest", log, "--out", out, "--jobs", 1), lab("inspect", log)
    for done in (ingest, inspect):
        assert done.code == 0, done
        assert tame(done.out), done.out
        assert tame(done.err), done.err
    if kind in ("markup", "an open bracket", "HTML", "a formula"):
        assert NAMES[kind].replace(" ", "")[:6] in "".join(ingest.out.split())
    document = json.loads(lab("inspect", log, "--json").out)
    assert document["files"][0]["path"].encode("utf-8", "replace") == str(log).encode("utf-8", "replace")


@pytest.mark.parametrize("kind", sorted({*NAMES} - {"not a character"}))
def test_a_name_within_a_log_is_text_in_map_metadata_and_message(kind: str, tmp_path: Path) -> None:
    header, _, rows = LOG.partition("\n")
    name = '"' + NAMES[kind].replace('"', '""').replace("\n", " ") + '"'
    log, own = tmp_path / "log.csv", tmp_path / "map.toml"
    log.write_text(header.replace("enc_rr_rad", name) + "\n" + rows, encoding="utf-8")
    own.write_text(inspect_logs([log]).to_map_toml(), encoding="utf-8")
    assert lab("inspect", log, "--map", own).code == 0
    listed = lab("inspect", log)
    log.write_text(f"# operator = {json.dumps(NAMES[kind])}\n" + LOG, encoding="utf-8")
    assert read_trial(log).info.extra["operator"] == NAMES[kind]
    log.write_text(f"# robot = {json.dumps(NAMES[kind])}\n" + LOG, encoding="utf-8")
    done = lab("ingest", log)
    assert done.code in (2, 3)
    assert len(done.err.splitlines()) == 2
    assert tame(listed.out + listed.err + done.err)


def test_a_line_for_the_terminal_is_one_line() -> None:
    assert printable("a\n b\tc") == "a b c"
    assert printable("a\x1b[1mb") == "a\ufffd[1mb"
    assert printable("Müller, 20 °C, λ_R ≤ 5 %") == "Müller, 20 °C, λ_R ≤ 5 %"
