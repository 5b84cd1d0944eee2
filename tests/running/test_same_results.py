"""Same in, same out: byte by byte, in whichever order, by how many processes, in whichever language."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from tests.corpus.cli import lab, refused
from tests.running.processes import TWO, Undisturbed, begin, results, trials

pytestmark = pytest.mark.slow

NAMES = ("virtual_v0.7_r1", "virtual_v0.7_r2")
"""Of one speed, so that a search is short."""


def study(
    folder: Path, *args: object, code: int = 0, cache: Path | None = None, **environment: str
) -> tuple[str, str]:
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    try:
        run = begin(folder, "study", *args, cache=cache)
        output, errors = run.communicate()
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
    assert run.returncode == code, errors
    return output, errors


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study with its search for a missing effect, nothing remembered, by two processes."""
    folder = tmp_path_factory.mktemp("same")
    logs = trials(folder, *NAMES)
    study(folder, *logs, "--out", "a/report", "--no-recordings", "--no-cache", "--jobs", "2")
    return folder


def test_order_processes_language_and_memory_change_no_byte(folder: Path) -> None:
    logs = [f"logs/{name}.csv" for name in NAMES]
    for out, remembered in (("b/report", False), ("c/report", True)):
        study(
            folder, *reversed(logs), "--out", out, "--no-recordings", "--jobs", "1",
            cache=folder / "cache", LC_ALL="de_DE.UTF-8", LANG="de_DE.UTF-8",
            PYTHONHASHSEED="7", OPENBLAS_NUM_THREADS="1", TZ="Asia/Tokyo",
        )  # fmt: skip
        assert any((folder / "cache").glob("*/*.bin"))
        assert results(folder / out) == results(folder / "a" / "report"), f"remembered: {remembered}"


def test_a_report_says_what_it_was_made_from(folder: Path) -> None:
    origin = json.loads((folder / "a" / "report" / "report.json").read_bytes())["provenance"]
    assert [i["file"] for i in origin["inputs"]] == [f"logs/{name}.csv" for name in NAMES]
    assert all(len(i["sha256"]) == 64 for i in origin["inputs"])
    assert len(origin["code_sha256"]) == 64
    assert origin["version"]
    assert origin["options"] == []
    assert {"robot.wheels.radius_m", "soil.cohesion_Pa"} <= {p["key"] for p in origin["parameters"]}


def test_verify_finds_the_same_again_and_says_what_was_changed(tmp_path: Path, studied: Undisturbed) -> None:
    for name in ("logs", "report"):
        shutil.copytree(studied.folder / name, tmp_path / name)
    output, _ = study(tmp_path, "--verify", "report")
    assert output.strip() == "report/report.json: identical, recomputed from 2 logs"

    edited = tmp_path / "report" / "report.json"
    document = json.loads(edited.read_bytes())
    document["a_theta"]["value"] += 1e-12
    edited.write_text(json.dumps(document), encoding="utf-8")
    table = next((tmp_path / "report" / "tables").glob("*.csv"))
    table.write_text("0\n", encoding="utf-8")
    moved = tmp_path / "moved"
    shutil.copytree(tmp_path / "logs", moved)
    with (moved / f"{TWO[0]}.csv").open("a", encoding="utf-8") as log:
        log.write("\n")
    output, errors = study(tmp_path, "moved", "--verify", "report", "--json", code=1)
    found = json.loads(output)
    assert found["same"] is False
    told = "\n".join(found["differences"])
    assert "a_theta.value: " in told
    assert f"tables/{table.name}: differs" in told
    assert f"moved/{TWO[0]}.csv: its content is not what the report was made from" in told
    assert "differs in" in errors


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "does not exist"),
        ("{", "is not JSON"),
        ("[]", "is not the report of a study"),
        ('{"schema": "granite-lab/report/1"}', "is not the report of a study"),
    ],
)
def test_verify_refuses_what_is_no_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str | None, said: str
) -> None:
    if text is not None:
        (tmp_path / "report.json").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    done = lab("study", "--verify", "report.json")
    refused(done, 3, said)
    assert done.error.startswith("report.json")


def test_two_runs_do_not_write_into_one_folder(tmp_path: Path) -> None:
    from granite_lab.errors import LabError
    from granite_lab.running.output import claimed

    with (
        claimed(tmp_path / "report"),
        pytest.raises(LabError, match="another run"),
        claimed(tmp_path / "report"),
    ):
        pass
    assert not (tmp_path / "report").exists()


def test_what_a_killed_run_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    from granite_lab.running.output import claimed

    litter = [tmp_path / ".report.ab12_xyz" / "new", tmp_path / "report" / "recordings"]
    kept = [tmp_path / ".report.backup1" / "mine", tmp_path / ".other.ab12_xyz" / "new"]
    for path in litter + kept:
        path.mkdir(parents=True)
    part = tmp_path / "report" / "recordings" / ".x.rrd.0123456789ab.part"
    part.write_text("")
    (tmp_path / "report" / ".mine.part").write_text("")
    with claimed(tmp_path / "report"):
        pass
    assert not litter[0].parent.exists()
    assert not part.exists()
    assert all(path.exists() for path in kept)
    assert (tmp_path / "report" / ".mine.part").exists()
