"""Logs that a command takes where none are named, and sheets of many logs."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest

import granite_lab as gl
from granite_lab.api.at_hand import logs_at_hand
from granite_lab.errors import InputError, UsageError
from tests.corpus.cli import GRANITE, lab, refused, succeeded, told
from tests.running.processes import short

pytestmark = pytest.mark.usefixtures("fits_by_slip", "one_picture")
A, B, C = "short_v0.3_r1", "short_v0.5_r1", "short_v0.7_r1"
GOOD = [A, B]


def write(name: str, log: Path) -> None:
    """Write a short trial, which takes half the time of a sample."""
    log.write_text(short(name), encoding="utf-8")


def three_commands(folder: Path) -> str:
    """Run the three commands of the README as they stand there; return the first line of the last."""
    succeeded("ingest", "trial.csv", cwd=folder)
    succeeded("simulate", "--variant", 0.5, cwd=folder)
    assert (folder / "reports" / "ingest" / "trial.csv").is_file()
    assert (folder / "reports" / "simulate" / "v0.5.csv").is_file()
    done = succeeded("fit-atheta", cwd=folder)
    assert "a_θ = " in " ".join(done.out.split())  # lines are wrapped
    return done.err.splitlines()[0]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(A, tmp_path / "trial.csv")
    return tmp_path


def test_the_three_commands_work_in_a_folder_with_a_log_and_in_a_clone_which_has_the_samples(
    folder: Path,
) -> None:
    refused(lab("fit-atheta", cwd=folder), 2, "no trials given", "ingest them first")
    samples = folder / "data" / "samples"
    samples.mkdir(parents=True)
    for name in (A, B, C):
        write(name, samples / f"{name}.csv")
    done = succeeded("fit-atheta", "--json", cwd=folder)
    assert done.err.splitlines()[0] == "logs: 3 logs, samples (data/samples)"
    assert [p["trial"] for p in json.loads(done.out)["points"]] == [A, B, C]
    assert three_commands(folder) == "logs: trial.csv, ingested (reports/ingest)"
    shutil.rmtree(folder / "data")
    assert [p["trial"] for p in told("fit-atheta", cwd=folder)["points"]] == ["trial"]


def test_the_three_commands_work_in_a_project_that_names_its_logs(folder: Path) -> None:
    (folder / "runs").mkdir()
    for name in (B, C):
        write(name, folder / "runs" / f"{name}.csv")
    (folder / "mine.toml").write_text(GRANITE, encoding="utf-8")
    text = f'logs = ["runs", "trial.csv"]\nrobot = "mine.toml"\n[[exclude]]\ntrial = "{C}"\nreason = "rain"\n'
    (folder / "granite-lab.toml").write_text(text, encoding="utf-8")
    assert three_commands(folder) == "logs: 3 logs, by granite-lab.toml"
    document = told("fit-k92", cwd=folder)
    assert [fit["trial"] for fit in document["fits"]] == [B, "trial"]
    assert document["excluded"] == [{"trial": C, "reason": "rain"}]
    assert {"name": "robot", "value": "mine.toml"} in document["provenance"]["options"]


def test_a_project_without_names_stands_beside_its_logs(folder: Path) -> None:
    (folder / "granite-lab.toml").write_text('soil = "dry_sand"\n', encoding="utf-8")
    assert logs_at_hand(folder).logs == (folder / "trial.csv",)
    (folder / "granite-lab.toml").write_text('logs = ["none"]\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"logs: 'none': does not exist"):
        logs_at_hand(folder)


@pytest.mark.parametrize("command", ["fit-k92", "check", "compare", "study --no-discover --no-recordings"])
def test_every_command_over_trials_takes_the_same_logs(command: str, folder: Path) -> None:
    succeeded("ingest", "trial.csv", "--out", "reports/mine", cwd=folder)
    done = succeeded(*command.split(), "--json", cwd=folder)
    assert done.err.splitlines()[0] == "logs: trial.csv, ingested (reports/mine)"
    assert json.loads(done.out)["schema"].startswith("granite-lab/")


def test_discover_takes_them_too(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The search itself is tested elsewhere."""

    def search(trials: list[gl.Checked], *_: object, **__: object) -> None:
        raise gl.EstimateError(", ".join(trial.name for trial in trials), "enough")

    monkeypatch.setattr("granite_lab.api.trials.find_effect", search)
    succeeded("ingest", "trial.csv", cwd=folder)
    done = lab("discover", "--jobs", 1, cwd=folder)
    assert done.err.splitlines()[0].startswith("logs: trial.csv")
    refused(done, 4, "trial", "enough")


def test_logs_are_taken_with_what_they_were_ingested_with(folder: Path) -> None:
    (folder / "mine.toml").write_text(GRANITE, encoding="utf-8")
    text = (folder / "trial.csv").read_text(encoding="utf-8").replace("imu_gy_radps", "tilt")
    (folder / "trial.csv").write_text(text, encoding="utf-8")
    path = folder / "map.toml"
    write(A, folder / "as-filed.txt")
    succeeded("inspect", "as-filed.txt", "--write-map", path, cwd=folder)
    path.write_text(path.read_text(encoding="utf-8").replace("imu_gy_radps", "tilt"), encoding="utf-8")
    given = ("--robot", "mine.toml", "--map", "map.toml", "--from", 0.5)
    succeeded("ingest", "trial.csv", *given, cwd=folder)
    assert logs_at_hand(folder).keywords == {
        "robot": "mine.toml", "column_map": "map.toml", "window": [0.5, float("inf")],
    }  # fmt: skip
    document = told("fit-k92", cwd=folder)
    assert {o["name"]: o["value"] for o in document["provenance"]["options"]} == {
        "robot": "mine.toml", "map": "map.toml", "from": "0.5",
    }  # fmt: skip
    write(B, folder / f"{B}.csv")
    succeeded("ingest", f"{B}.csv", cwd=folder)
    refused(lab("fit-k92", cwd=folder), 2, "ingested with different options", "name the logs")
    (folder / "reports" / "ingest" / "trial.csv").unlink()  # which takes its log off the list
    assert [fit["trial"] for fit in told("fit-k92", cwd=folder)["fits"]] == [B]
    known = ("--rest", "0:1", "--distance-measured", "0.83±0.02", "--set", "soil.cohesion_Pa=500")
    succeeded("ingest", f"{B}.csv", *known, cwd=folder)
    document = told("fit-k92", cwd=folder)
    assert {o["name"]: o["value"] for o in document["provenance"]["options"]} == {
        "rest": "0:1", "distance-measured": "0.83±0.02", "set": "soil.cohesion_Pa=500.0",
    }  # fmt: skip
    assert document["provenance"]["command"].endswith(
        "--distance-measured '0.83±0.02' --rest 0:1 --set soil.cohesion_Pa=500.0"
    )
    succeeded("ingest", f"{B}.csv", "--variant", "0.7", cwd=folder)
    refused(lab("fit-k92", cwd=folder), 2, "ingested with --variant, which only ingest has", "TOML file")
    (folder / f"{B}.csv").unlink()
    with pytest.raises(InputError, match="is gone since it was ingested"):
        logs_at_hand(folder)
    (folder / "reports" / "ingest" / "ingest.json").write_text("{}", encoding="utf-8")
    refused(lab("fit-k92", cwd=folder), 3, "expected schema", "remove it")


def test_ingest_replaces_its_own_tables_and_no_log(folder: Path) -> None:
    before = (folder / "trial.csv").read_bytes()
    refused(lab("ingest", "trial.csv", "--out", ".", cwd=folder), 1, "trial.csv: was not written by ingest")
    assert (folder / "trial.csv").read_bytes() == before
    assert [path.name for path in folder.iterdir()] == ["trial.csv"]
    for _ in range(2):
        succeeded("ingest", "trial.csv", cwd=folder)


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two good logs, one without sensors, one without a standstill at its end, and a text."""
    root = tmp_path_factory.mktemp("many")
    for name in GOOD:
        write(name, root / f"{name}.csv")
    text = (root / f"{A}.csv").read_text(encoding="utf-8")
    (root / "broken.csv").write_text("t_s,imu_ax_mps2\n0,1\n", encoding="utf-8")
    (root / "notes.csv").write_text("hello\nworld\n", encoding="utf-8")
    head, _, rows = text.partition("t_s,")
    lines = rows.splitlines(keepends=True)
    begin = [line for line in lines[1:] if float(line.partition(",")[0]) < 3.0]
    (root / "cut.csv").write_text("".join([head, "t_s,", lines[0], *begin]), encoding="utf-8")
    return root


def test_ingest_of_a_folder_gives_what_can_be_used_and_tells_the_rest(many: Path, tmp_path: Path) -> None:
    done = succeeded("ingest", many, "--out", tmp_path / "out", "--json")
    document = json.loads(done.out)
    assert {trial["name"] for trial in document["trials"]} >= set(GOOD)
    assert {"broken", "notes"} <= {failure["trial"] for failure in document["failures"]}
    assert "warning: broken: left out: " in done.err
    assert all(len(pd.read_csv(tmp_path / "out" / f"{name}.csv")) > 1000 for name in GOOD)
    assert "left out: broken" in lab("ingest", many, "--out", tmp_path / "out").out
    strict = lab("ingest", many, "--out", tmp_path / "strict", "--strict")
    refused(strict, 3, "broken")
    assert not (tmp_path / "strict").exists()


def test_check_of_a_folder_is_a_sheet_with_one_line_a_run(many: Path) -> None:
    done = lab("check", many)
    assert done.code == 3
    lines = {line.split()[1]: line for line in done.out.splitlines()}
    assert len(done.out.splitlines()) == len(lines) == 5
    assert all(lines[name].startswith("good ") and "λ_R" in lines[name] for name in GOOD)
    assert all("estimate good" in lines[name] for name in GOOD)
    for name, reason in (("broken", "log: "), ("notes", "no table"), ("cut", "standstills")):
        assert lines[name].startswith("BAD ")
        assert reason in lines[name]
    assert done.error == "3 of 5 runs are bad"
    document = json.loads(lab("check", many, "--json").out)
    assert document["schema"] == "granite-lab/check/2"
    assert not document["good"]
    grades = {Path(run["log"]).stem: run["health"]["grade"] for run in document["runs"]}
    ingested = gl.ingest(many)
    assert {name for name, _ in ingested.left_out} == {"broken", "notes"}
    assert {i.name: i.motion.health.grade for i in ingested} == {n: grades[n] for n in (*GOOD, "cut")}
    assert grades["broken"] is None
    good = succeeded("check", many / f"{A}.csv", many / f"{B}.csv")
    assert good.out.splitlines()[-1] == "All 2 runs are good."
    assert lab("check", many / f"{A}.csv", many / "cut.csv").code == 4


def test_inspect_of_a_folder_looks_at_every_log_in_it(many: Path, tmp_path: Path) -> None:
    files = told("inspect", many)["files"]
    assert [Path(file["path"]).name for file in files] == sorted(path.name for path in many.iterdir())
    assert {Path(file["path"]).stem for file in files if file["problem"]} >= {"broken", "notes"}
    refused(lab("inspect", tmp_path), 2, "the folder holds no log")
    with pytest.raises(UsageError, match="no log given"):
        gl.inspect([])
