import contextlib
import dataclasses
from pathlib import Path

import pytest

from granite_lab.reporting import write_report
from granite_lab.results import Source, StudyResult
from granite_lab.stored import root
from tests.remembered import made_once
from tests.reporting.made_up import made_up_study, rename
from tests.reporting.made_up_finding import made_up_finding

HOSTILE = "<script>alert(1)</script>|`x`\"'{{7*7}}</table>[a](b)=HYPERLINK()\n-z"


def reports() -> Path:
    """Return the folder of the reports that all tests read and none changes."""
    return root() / "reports"


@pytest.fixture(scope="session")
def study() -> StudyResult:
    return made_up_study(speeds=(0.3, 0.7), repetitions=2)


@made_once
def small() -> Path:
    folder = reports() / "small"
    study = made_up_study(speeds=(0.3, 0.7), repetitions=2)
    assert write_report(study, folder) == folder / "index.html"
    return folder


@pytest.fixture(scope="session")
def folder() -> Path:
    """The report of a small study."""
    return small()


@made_once
def hostile() -> Path:
    folder = reports() / "hostile"
    write_report(rename(made_up_study(speeds=(0.3,), repetitions=1), HOSTILE), folder)
    return folder


@pytest.fixture(scope="session")
def hostile_folder() -> Path:
    """The report of a study whose names try to break out of every format."""
    return hostile()


@made_once
def found() -> Path:
    folder = reports() / "found"
    finding = made_up_finding(twins=("slip_sinkage",))
    source = Source("0.1.0", "granite-lab discover trials", (), (("soil.n", "1.1", "-", "dry_sand.toml"),))
    write_report(StudyResult("found", (), (), None, source, finding), folder, model=folder / "model.toml")
    return folder


@pytest.fixture(scope="session")
def discovery_folder() -> Path:
    """The report of a search that named an effect with a twin."""
    return found()


def of_twelve() -> StudyResult:
    return dataclasses.replace(made_up_study(), finding=made_up_finding(twins=("slip_sinkage",)))


@pytest.fixture(scope="session")
def twelve() -> StudyResult:
    """Twelve trials of four speeds, with a finding."""
    return of_twelve()


@made_once
def twelve_written() -> Path:
    above = reports()
    above.mkdir(parents=True, exist_ok=True)
    with contextlib.chdir(above):
        write_report(of_twelve(), Path("twelve"), model="model.toml")
    return above / "twelve"


@pytest.fixture(scope="session")
def twelve_folder() -> Path:
    """Its report, written from the folder above as a user would: its commands name the folder."""
    return twelve_written()
