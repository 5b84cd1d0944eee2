"""Results replace and remove what the same results wrote, and nothing of the user's."""

import dataclasses
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import granite_lab as gl
from granite_lab.errors import LabError, UsageError
from granite_lab.folders import LIST, MARK, UNFINISHED, distinct, files_of, remove_unfinished, replacing
from granite_lab.hidden.lab import lab_of
from granite_lab.parameters import load_robot, load_soil
from granite_lab.reporting import write_comparison, write_report
from granite_lab.results import StudyResult
from granite_lab.running.output import locked
from tests.corpus.cli import SAMPLES, lab, refused
from tests.reporting.made_up import made_up_study, rename

NAMES = ("index.html", "figures/a.svg", "figures/b.svg", "recordings/a.rrd", "deep/er/c.csv")


def content(folder: Path) -> dict[str, str]:
    """Return the files of a folder but its list."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != LIST)
    return {path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8") for path in files}


def write(folder: Path, part: str, names: set[str], text: str) -> None:
    with replacing(folder, part) as new:
        for name in names:
            (new / name).parent.mkdir(parents=True, exist_ok=True)
            (new / name).write_text(text, encoding="utf-8")


RUNS = st.lists(st.tuples(st.sampled_from(["report", "model"]), st.sets(st.sampled_from(NAMES))), max_size=5)


@given(mine=st.sets(st.sampled_from(NAMES)), runs=RUNS)
def test_any_runs_leave_the_files_of_others_and_none_of_their_own_that_is_old(
    mine: set[str], runs: list[tuple[str, set[str]]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("runs") / "out"
    for name in mine:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("mine", encoding="utf-8")
    expected, owner = dict.fromkeys(mine, "mine"), dict[str, str]()
    for number, (part, names) in enumerate(runs):
        before = content(folder)
        if names & mine:
            with pytest.raises(LabError, match="granite-lab did not write it"):
                write(folder, part, names, str(number))
            assert content(folder) == before
            continue
        write(folder, part, names, str(number))
        for name in [n for n, p in owner.items() if p == part and n not in names]:
            del expected[name], owner[name]
        expected |= dict.fromkeys(names, str(number))
        owner |= dict.fromkeys(names, part)
        assert content(folder) == expected
        assert {path.relative_to(folder).as_posix() for path in files_of(folder)} == set(owner)
        assert not [path for path in folder.rglob("*") if path.is_dir() and not any(path.iterdir())]
    assert [path.name for path in folder.parent.iterdir()] in ([], ["out"])


def test_an_old_file_that_was_edited_and_a_folder_in_the_way_stay(tmp_path: Path) -> None:
    write(tmp_path, "report", {"a.csv", "b.csv"}, "1")
    (tmp_path / "a.csv").write_text("edited", encoding="utf-8")
    write(tmp_path, "report", {"c.csv"}, "2")
    assert content(tmp_path) == {"a.csv": "edited", "c.csv": "2"}
    (tmp_path / "d.csv").mkdir()
    with pytest.raises(LabError, match=r"d\.csv: is in the way"):
        write(tmp_path, "report", {"d.csv"}, "3")
    for text in ("[]", '{"schema": "granite-lab/written/1", "parts": {"report": {"../b.csv": ""}}}'):
        (tmp_path / LIST).write_text(text, encoding="utf-8")
        with pytest.raises(LabError, match="is no list of written files"):
            write(tmp_path, "report", {"c.csv"}, "4")


def test_a_block_that_fails_changes_nothing(tmp_path: Path) -> None:
    def fails() -> None:
        with replacing(tmp_path / "out", "report") as new:
            (new / "b.csv").write_text("2", encoding="utf-8")
            raise ValueError("stop")

    write(tmp_path / "out", "report", {"a.csv"}, "1")
    with pytest.raises(ValueError, match="stop"):
        fails()
    assert content(tmp_path / "out") == {"a.csv": "1"}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_what_a_killed_run_left_is_known_by_its_mark_not_by_its_name(tmp_path: Path) -> None:
    out = tmp_path / "out"
    left = [tmp_path / ".out.ab12_xyz", out / ".recordings.ab12_xyz"]
    others = [tmp_path / ".out.backup_1", tmp_path / ".other.ab12_xyz", out / ".mine"]
    for folder in (*left, *others):
        (folder / "new").mkdir(parents=True)
    for folder in (*left, tmp_path / ".other.ab12_xyz"):
        (folder / MARK).write_text(UNFINISHED, encoding="utf-8")
    (tmp_path / ".out.backup_1" / MARK).write_text("mine", encoding="utf-8")
    (out / ".x.rrd.0123456789ab.part").write_text("mine", encoding="utf-8")
    unfinished = out / f".{LIST}.0123456789ab.part"
    unfinished.write_text("", encoding="utf-8")
    remove_unfinished(out)
    assert not unfinished.exists()
    assert not any(folder.exists() for folder in left)
    assert all((folder / "new").exists() for folder in others)
    assert (out / ".x.rrd.0123456789ab.part").exists()


def test_an_empty_folder_of_the_user_is_not_removed(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    with locked(tmp_path / "mine"):
        pass
    assert (tmp_path / "mine").is_dir()


@given(st.lists(st.sampled_from(["study", "Study", "study (2)", "a", "A"]), max_size=5))
def test_names_of_files_differ_where_capitals_do_not_count(names: list[str]) -> None:
    made = distinct(names)
    assert len({name.casefold() for name in made}) == len(made) == len(names)
    assert made[:1] == names[:1]


@pytest.fixture(scope="module")
def study() -> StudyResult:
    return made_up_study(speeds=(0.5,), repetitions=2)


def test_recordings_keep_those_of_others(tmp_path: Path, study: StudyResult) -> None:
    (tmp_path / "mine.rrd").write_bytes(b"mine")
    paths = gl.record(rename(study, "virtual_0.5_2"), tmp_path)
    assert [path.name for path in paths] == ["virtual_0.5_2.rrd", "virtual_0.5_2 (2).rrd"]
    fewer = dataclasses.replace(study, trials=study.trials[:1])
    assert [path.name for path in gl.record(fewer, tmp_path)] == ["virtual_0.5_1.rrd"]
    assert {path.name for path in tmp_path.glob("*.rrd")} == {"mine.rrd", "virtual_0.5_1.rrd"}
    assert (tmp_path / "mine.rrd").read_bytes() == b"mine"


@pytest.mark.usefixtures("one_picture")
def test_a_report_keeps_the_figures_and_tables_of_others(tmp_path: Path, study: StudyResult) -> None:
    for name in ("figures/mine.svg", "tables/mine.csv", "notes.md"):
        (tmp_path / "out" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "out" / name).write_text("mine", encoding="utf-8")
    write_report(study, tmp_path / "out")
    figures = {path.name for path in (tmp_path / "out" / "figures").iterdir()}
    assert figures > {"mine.svg", "motion_0p50.svg"}
    write_comparison([study.trials[0]], tmp_path / "out")
    compared = {path.name for path in (tmp_path / "out" / "figures").iterdir()} - figures
    assert compared
    write_report(made_up_study(speeds=(0.3,), repetitions=1), tmp_path / "out")
    there = {path.name for path in (tmp_path / "out" / "figures").iterdir()}
    assert there > compared | {"mine.svg", "motion_0p30.svg"}
    assert "motion_0p50.svg" not in there
    assert (tmp_path / "out" / "tables" / "mine.csv").read_text(encoding="utf-8") == "mine"
    shutil.rmtree(tmp_path / "out")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "index.html").write_text("mine", encoding="utf-8")
    with pytest.raises(LabError, match=r"index\.html: is in the way"):
        write_report(study, tmp_path / "out")
    early = lab("study", SAMPLES / "virtual_v0.3_r1.csv", "--out", tmp_path / "out")
    refused(early, 1, "index.html: is in the way", "choose another --out")
    assert content(tmp_path / "out") == {"index.html": "mine"}


def test_hide_replaces_neither_a_robot_nor_logs_by_their_truth(tmp_path: Path) -> None:
    hide = ("hide", "--effect", "none", "--repetitions", 1, "--out", tmp_path)
    refused(lab(*hide, "--truth", tmp_path), 2, "logs and their truth under the same names", "two folders")
    robot, soil = load_robot(), load_soil()
    seed = next(k for k in range(20) if len(lab_of("wild", k, robot, soil).files()) == 2)
    for name in ("robot.toml", "soil.toml"):
        (tmp_path / name).write_text("mine", encoding="utf-8")
    with pytest.raises(UsageError, match=r"robot\.toml: exists already"):
        gl.hide("none", tmp_path, lab="wild", seed=seed)
    assert {path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == {"mine"}
    truth = tmp_path / "truth"
    truth.mkdir()
    (truth / "hidden_v0.2_r1.csv").write_text("mine", encoding="utf-8")
    with pytest.raises(UsageError, match=r"hidden_v0\.2_r1\.csv: exists already"):
        gl.hide("none", tmp_path / "set", truth=truth)
