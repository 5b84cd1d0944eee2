"""A study of two samples, made once."""

from __future__ import annotations

import pytest

from tests.running.processes import STUDY, TWO, Undisturbed, undisturbed


@pytest.fixture(scope="session")
def studied(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    return undisturbed(tmp_path_factory.mktemp("undisturbed") / "study", *STUDY, logs=TWO)
