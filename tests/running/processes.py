"""Whole runs as processes of their own, which a test can end in any way."""

import os
import re
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import pytest

import granite_lab as gl
from granite_lab.errors import EstimateError
from granite_lab.parameters import load_variants
from tests.corpus.cli import SAMPLES
from tests.remembered import FITTED_ANEW
from tests.soak import SOAK

ONE_PICTURE = """
from granite_lab.reporting import write
def first_alone(figures, k, draw=write._drawn):
    return draw(figures, k) if k == 0 else BLANK
BLANK = b'<svg width="99pt" height="9pt" viewBox="0 0 99 9" xmlns="http://www.w3.org/2000/svg"></svg>'
write._drawn = first_alone
"""
"""Lets a process draw the first figure of a report alone, as `one_picture`; `make soak` draws all."""
# A shell that starts the tests in the background has them, and all that they start, ignore Ctrl-C.
# Pictures are as coarse as in tests that start no process.
MAIN = (
    f"{'' if SOAK else ONE_PICTURE}\n"
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
    "from granite_lab.cli import main; from granite_lab.reporting import canvas; canvas.DPI = 20; main()"
)
FEW = ("drive_reaction", "tyre_windup")
"""Effects of a search that is short."""
ALONE = FEW[:1]
"""Where it does not matter which effect is named."""
AMONG_FEW = (
    "from granite_lab import chain; from granite_lab.effects import get;"
    f"chain.library = lambda *_: {{name: get(name) for name in {FEW}}};"
)
"""Lets a process search among these alone; `make soak` searches among all."""
BY_SLIP = """
from granite_lab.errors import EstimateError
from granite_lab.fitting import k92
def left_out(*_):
    raise EstimateError("left out by a test")
k92._with_trajectory = left_out
"""
"""Lets a process fit by the slip alone, as `fit_by_slip`."""
TWO = ("short_v0.5_r1", "short_v0.7_r2")
"""Short trials of the plain model, whose fits converge at once: for tests of what is done with a run."""
STUDY = (
    "study", "logs", "--out", "report", "--jobs", "2", "--no-recordings",
    "--discover" if SOAK else "--no-discover",
)  # fmt: skip


def own_cache(folder: Path) -> Path:
    """Return a cache that remembers no result of another test; what is compiled for one is for all."""
    compiled = folder / "machine-code"
    if not compiled.exists():
        folder.mkdir(parents=True, exist_ok=True)
        common = Path(os.environ["GRANITE_LAB_CACHE"]) / compiled.name
        common.mkdir(parents=True, exist_ok=True)
        compiled.symlink_to(common)
    return folder


def fit_by_slip(cache: Path, patch: pytest.MonkeyPatch) -> Path:
    """Let fits go by the slip alone until `patch` is undone; return the cache that remembers them."""

    def left_out(*_: object) -> None:
        raise EstimateError("left out by a test")

    patch.setattr("granite_lab.fitting.fit_k92", FITTED_ANEW)
    patch.setattr("granite_lab.fitting.k92._with_trajectory", left_out)
    patch.setenv("GRANITE_LAB_CACHE", str(own_cache(cache)))
    return cache


def one_picture(patch: pytest.MonkeyPatch) -> None:
    """Let reports have their first picture and blank ones until `patch` is undone; `make soak` draws all.

    For tests of what is done with reports: to draw the pictures takes longer than all else.
    """
    from granite_lab.reporting import write

    patch.setattr(write, "_drawn", write._drawn)  # what the text below sets is undone with it
    exec("" if SOAK else ONE_PICTURE, globals())  # where another process finds the function


def two_variants(patch: pytest.MonkeyPatch) -> None:
    """Let hidden sets have the two fastest variants until `patch` is undone: their trials are short."""
    fast = load_variants()[-2:]
    patch.setattr("granite_lab.hidden.making.load_variants", lambda: fast)


def begin(folder: Path, *args: object, cache: Path | None = None, first: str = "") -> subprocess.Popen[str]:
    """Start a command in a session of its own, so that all its processes can be found.

    Args:
        cache: as `own_cache` makes it.
        first: Python that the process runs before the command.
    """
    environment = dict(os.environ)
    if cache:
        environment["GRANITE_LAB_CACHE"] = str(own_cache(cache))
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", first + MAIN, *map(str, args)],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def members(session: int) -> list[int]:
    """Return the processes of a session that still run."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, of = stat.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(of) == session and state not in ("Z", "X"):
            found.append(int(stat.parent.name))
    return found


def gone(session: int, within: float = 20.0) -> bool:
    """Wait until no process of a session is left; say whether that came true."""
    end = time.monotonic() + within
    while members(session):
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


def results(report: Path) -> dict[str, bytes]:
    """Return numbers and tables of a report, byte by byte; the page's hash goes by its command and date."""
    text = (report / "report.json").read_bytes()
    numbers = re.sub(rb' "files": \[.*?\n \],?\n', b"", text, flags=re.DOTALL)
    assert numbers != text
    tables = sorted((report / "tables").glob("*.csv"))
    return {"report.json": numbers} | {path.name: path.read_bytes() for path in tables}


def everything(report: Path) -> dict[str, bytes]:
    """Return all files of a report, byte by byte."""
    return {str(p.relative_to(report)): p.read_bytes() for p in sorted(report.rglob("*")) if p.is_file()}


def unfinished(folder: Path) -> list[str]:
    """Return what interrupted writing leaves behind."""
    return [str(p) for p in folder.rglob(".*") if p.name not in (".", "..")]


def trials(folder: Path, *names: str) -> list[str]:
    """Write trials, of the samples or short ones, and return their paths as a user in `folder` names them."""
    (folder / "logs").mkdir(parents=True)
    for name in names:
        log = folder / "logs" / f"{name}.csv"
        log.write_text(short(name) if name.startswith("short") else sampled(name), encoding="utf-8")
    return [f"logs/{name}.csv" for name in names]


def sampled(name: str) -> str:
    return (SAMPLES / f"{name}.csv").read_text(encoding="utf-8")


@cache
def short(name: str, share: float = 0.0) -> str:
    """Return the log of a drive over 0.8 m at the speed and of the seed that its name has, in 8 s.

    Args:
        name: as ``short_v0.5_r1``.
        share: of the drives' reaction that the body feels, an effect that the plain model lacks.
    """
    found = re.fullmatch(r"short_v(0\.\d)_r(\d)", name)
    assert found, name
    active = {"drive_reaction": {"share": share}} if share else None
    with TemporaryDirectory() as folder:
        log = Path(folder) / f"{name}.csv"
        gl.simulate(v=float(found[1]), a=2.0, distance=0.8, seed=int(found[2]), log=log, active=active)
        return log.read_text(encoding="utf-8")


class Undisturbed(NamedTuple):
    """A folder with `logs`, `cache` and `report`, and what the run took [s]."""

    folder: Path
    wall: float


def undisturbed(folder: Path, *args: str, logs: tuple[str, ...]) -> Undisturbed:
    trials(folder, *logs)
    start = time.monotonic()
    run = begin(folder, *args, cache=folder / "cache")
    _, errors = run.communicate()
    assert run.returncode == 0, errors
    return Undisturbed(folder, time.monotonic() - start)
