"""What all tests share: no test sees what the user's own runs remember, nor leaves anything there; pictures
are coarse, and the machine seems to have one core."""

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests.soak import SOAK, examples

# neither a deadline nor slow draws: they judge what else the machine does
timeless = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("new draws", timeless)
settings.register_profile("same draws in each run", timeless, derandomize=True, max_examples=examples(100))
# new draws are for `make soak`: a change is judged by what it changes
settings.load_profile("new draws" if SOAK else "same draws in each run")


def pytest_collection_finish() -> None:
    """Let no collection of garbage look through what is there to the end: modules, and all the tests."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def cache_of_the_tests(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One for all processes of pytest: what one has compiled or analysed, no other does again."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRANITE_LAB_CACHE", str(folder / "cache"))
        yield


@pytest.fixture(scope="session", autouse=True)
def motions_and_fits(cache_of_the_tests: None) -> Iterator[None]:
    """What commands estimate and fit is remembered by the content of the trial, for all processes."""
    from granite_lab.stored import root
    from tests.remembered import corrected, fitted

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("granite_lab.estimation.correct", corrected(root() / "motions"))
        patch.setattr("granite_lab.fitting.fit_k92", fitted(root() / "fits"))
        yield


@pytest.fixture
def estimates_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests of what an estimation does, or how long it takes, when a command runs."""
    from tests.remembered import ANEW

    monkeypatch.setattr("granite_lab.estimation.correct", ANEW)


@pytest.fixture(scope="session", autouse=True)
def full_resolution() -> Iterator[int]:
    """Resolution of the pictures of a report; coarse ones, which tests get, take a fiftieth of the time."""
    from granite_lab.reporting import canvas

    full = canvas.DPI
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(canvas, "DPI", 20)
        yield full


@pytest.fixture(scope="session", autouse=True)
def one_core() -> Iterator[None]:
    """Trials are worked on in this process unless a test says how many do: a worker imports all again.

    Worker processes are shown by tests that ask for `jobs`, or that begin commands as processes.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "cpu_count", lambda: 1)
        yield


@pytest.fixture(scope="session", autouse=True)
def one_blas_thread() -> Iterator[None]:
    """Sums that are split among threads differ in their last digits with the number of threads.

    Nor do small matrices gain by them: two threads wait for each other, and those of two processes of pytest
    for the same cores. Processes that tests begin have as many as they would have.
    """
    from granite_lab.processes import one_thread

    with one_thread():
        yield


@pytest.fixture
def fits_by_slip(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let fits go by the slip alone, and return the cache that remembers them.

    For tests that show what is done with fits: a fit to the trajectory takes ten times as long.
    """
    from tests.running.processes import fit_by_slip

    return fit_by_slip(tmp_path_factory.mktemp("fits") / "cache", monkeypatch)


@pytest.fixture
def two_variants(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a hidden set have the two fastest of the variants of Table 2: for tests in which a set is a set."""
    from tests.running.processes import two_variants

    two_variants(monkeypatch)


@pytest.fixture
def one_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a report have its first picture alone, and blank ones: for tests of what is done with reports."""
    from tests.running.processes import one_picture

    one_picture(monkeypatch)
