from pathlib import Path

import pytest

from granite_lab.comparison.compare import Comparison
from granite_lab.discovery.finding import Finding
from granite_lab.reporting.recording import record_trial
from tests.recording.read_back import ReadBack
from tests.reporting.made_up import made_up_trial
from tests.reporting.made_up_finding import made_up_finding


@pytest.fixture(scope="session")
def trial() -> Comparison:
    return made_up_trial(0.3, repetition=2)


@pytest.fixture(scope="session")
def finding() -> Finding:
    return made_up_finding()


@pytest.fixture(scope="session")
def path(trial: Comparison, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    return record_trial(trial, folder / "trial.rrd")


@pytest.fixture(scope="session")
def back(path: Path) -> ReadBack:
    return ReadBack(path)


@pytest.fixture(scope="session")
def searched(trial: Comparison, finding: Finding, tmp_path_factory: pytest.TempPathFactory) -> ReadBack:
    """The same trial with what a search found."""
    folder = tmp_path_factory.mktemp("discovered")
    return ReadBack(record_trial(trial, folder / "trial.rrd", finding=finding))
