"""Stages that a test of the command line does not show, made short."""

from pathlib import Path

import pytest

from granite_lab.errors import EstimateError
from tests.running.processes import own_cache


@pytest.fixture
def fits_by_slip(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let fits go by the slip alone, and return the cache that remembers them.

    The fit to the trajectory takes ten times as long; tests/fitting shows it.
    """

    def left_out(*_: object) -> None:
        raise EstimateError("left out by a test")

    cache = own_cache(tmp_path_factory.mktemp("fits") / "cache")
    monkeypatch.setattr("granite_lab.fitting.k92._with_trajectory", left_out)
    monkeypatch.setenv("GRANITE_LAB_CACHE", str(cache))
    return cache
