"""What all tests share: no test sees what the user's own runs remember, nor leaves anything there."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session", autouse=True)
def cache_of_the_tests(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    before = os.environ.get("GRANITE_LAB_CACHE")
    os.environ["GRANITE_LAB_CACHE"] = str(tmp_path_factory.mktemp("cache"))
    yield
    if before is None:
        del os.environ["GRANITE_LAB_CACHE"]
    else:
        os.environ["GRANITE_LAB_CACHE"] = before
