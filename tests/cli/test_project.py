"""`granite-lab.toml` beside the logs says what holds for all of them; the command line wins."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest

import granite_lab as gl
from granite_lab.api.project import FILE, choose, results_folder
from granite_lab.files import sha256
from granite_lab.logs.trial import TrialInfo
from granite_lab.options import Options
from tests.corpus.cli import GRANITE, SAMPLES, lab, refused, succeeded, told
from tests.running.processes import trials
from tests.soak import sampled

pytestmark = pytest.mark.usefixtures("fits_by_slip", "one_picture")
A, B = "virtual_v0.3_r1", "virtual_v0.7_r1"


def folder_with(tmp_path: Path, text: str) -> Path:
    folder = tmp_path / "logs"
    trials(tmp_path, A, B)
    (folder / FILE).write_text(text, encoding="utf-8")
    return folder


EXCLUDE = f'[[exclude]]\ntrial = "{B}"\nreason = "a wheel hit a stone"\n'


def test_robot_of_the_file_is_used_where_none_is_given(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, 'robot = "mine.toml"\nout = "results"\n')
    (folder / "mine.toml").write_text(GRANITE, encoding="utf-8")
    found = choose(folder, Options())
    assert found.options.robot == str(folder / "mine.toml")
    assert results_folder(folder, "study") == folder / "results" / "study"
    assert found.options.soil is None
    assert choose(folder, Options(robot="granite")).options.robot == "granite"


def test_a_report_of_other_logs_is_not_overwritten_by_default(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, 'out = "results"\n')
    report = folder / "results" / "study" / "report.json"
    report.parent.mkdir(parents=True)

    def holds(*shas: str) -> None:
        inputs = [{"file": "run.csv", "sha256": sha} for sha in shas]
        report.write_text(json.dumps({"provenance": {"inputs": inputs}}), encoding="utf-8")

    holds("00" * 32)
    assert results_folder(folder, "study") == folder / "results" / "study-2"
    holds("00" * 32, sha256(folder / f"{A}.csv"))  # a trial of this study is among them
    assert results_folder(folder, "study") == report.parent
    report.write_text("no JSON", encoding="utf-8")
    assert results_folder(folder, "study") == report.parent


def test_ingest_follows_the_file_and_lists_what_it_excludes(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, f'robot = "granite"\nout = "results"\n{EXCLUDE}')
    done = succeeded("ingest", folder, "--jobs", 1, "--json")
    document = json.loads(done.out)
    assert [t["name"] for t in document["trials"]] == [A]
    assert document["excluded"] == [{"trial": B, "reason": "a wheel hit a stone"}]
    assert f"{B}: excluded: a wheel hit a stone" in done.err
    assert (folder / "results" / "ingest" / f"{A}.csv").is_file()
    assert [item.name for item in gl.ingest(folder)] == [A]
    fits = gl.fit_k92(folder)
    assert [fit.trial for fit in fits] == [A]
    assert fits.left_out == ((B, "a wheel hit a stone"),)
    assert f"left out: {B}: a wheel hit a stone" in repr(fits)
    assert lab("check", folder / f"{B}.csv").code == 0


@pytest.mark.parametrize("by", sampled([FILE, "--exclude"]))
def test_a_study_lists_excluded_trials_and_set_numbers_and_is_verified_with_both(
    tmp_path: Path, by: str
) -> None:
    folder = folder_with(tmp_path, EXCLUDE if by == FILE else "")
    out = tmp_path / "report"
    options = ("--no-discover", "--no-recordings", "--jobs", 1, "--set", "robot.wheels.radius_m=0.1")
    options += ("--exclude", f"{B}=a wheel hit a stone") if by == "--exclude" else ()
    succeeded("study", folder, "--out", out, *options)
    document = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert document["failures"] == [{"trial": B, "message": "excluded: a wheel hit a stone", "hint": ""}]
    said = document["provenance"]
    assert "--set robot.wheels.radius_m=0.1" in said["command"]
    assert (f"--exclude '{B}=a wheel hit a stone'" in said["command"]) is (by == "--exclude")
    (radius,) = (row for row in said["parameters"] if row["key"] == "robot.wheels.radius_m")
    assert (radius["value"], radius["origin"]) == ("0.1", "--set")
    page = (out / "index.html").read_text(encoding="utf-8")
    assert "1 more trial excluded by the user." in page
    assert f"{B}: excluded: a wheel hit a stone" in page
    assert "could not be used" not in page
    succeeded("study", folder, "--verify", out, "--jobs", 1)


def test_what_is_given_excludes_besides_the_file_and_is_told_what_is_wrong(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, EXCLUDE)
    again = choose(folder, Options(exclude=((B, "rain"),)))
    assert [(f.trial, f.reason) for f in again.excluded] == [(B, "rain")]
    for wrong, error, hint in (
        (f"{A}=slid", "--exclude: excludes all trials", "reason given: slid"),
        ("virtual_v0.3=slid", "--exclude virtual_v0.3: no such log", A),
        (f"{A}= ", f"--exclude {A}: the reason is empty", "say why"),
        (A, f"--exclude {A}: cannot be understood", "trial='reason'"),
    ):
        refused(lab("study", folder, "--exclude", wrong), 2, error, hint)


@pytest.mark.parametrize(
    ("text", "code", "error", "hint"),
    [
        ('robt = "granite"', 3, "robt", "robot"),
        ('robot = "granit"', 3, "robot = 'granit': unknown robot", "'granite'"),
        ('soil = "wet.toml"', 3, "soil = 'wet.toml': no such file", "paths start at"),
        ('[[exclude]]\ntrial = "virtual_v0.7"\nreason = "x"', 3, "no such log in this folder", B),
        (f'[[exclude]]\ntrial = "{B}"\nreason = " "', 3, "reason is empty", "say why"),
        (f'[[exclude]]\ntrial = "{B}"', 3, "'reason' is missing", ""),
        (f'{EXCLUDE}[[exclude]]\ntrial = "{A}"\nreason = "x"', 2, "excludes all trials", "reason given: x"),
    ],
)
def test_a_wrong_file_is_told_in_one_line(
    tmp_path: Path, text: str, code: int, error: str, hint: str
) -> None:
    folder = folder_with(tmp_path, text)
    done = lab("fit-k92", folder)
    assert done.code == code
    assert done.error.startswith(str(folder / FILE))
    assert error in done.error
    assert hint in done.hint
    assert done.out == ""


def test_folders_that_disagree_need_the_option(tmp_path: Path) -> None:
    first, second = folder_with(tmp_path, 'soil = "dry_sand"\n'), tmp_path / "other"
    second.mkdir()
    shutil.copy(SAMPLES / "virtual_v0.3_r2.csv", second)
    done = lab("fit-k92", first, second)
    assert done.code == 2
    assert "not the same soil" in done.error
    assert choose([first, second], Options(soil="dry_sand")).options.soil == "dry_sand"


def test_what_ends_a_command_over_several_trials_names_the_trial(tmp_path: Path) -> None:
    rows = (SAMPLES / f"{A}.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "still.csv").write_text("".join(rows[:400]), encoding="utf-8")
    done = lab("fit-k92", SAMPLES / f"{B}.csv", tmp_path / "still.csv", "--strict", "--jobs", 1)
    refused(done, 4, "still: its wheels do not turn", "a trial in which the robot drives")


def test_params_shows_where_robot_and_soil_come_from(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, 'robot = "granite"\n')
    chosen = told("params", folder)["chosen"]
    assert chosen["robot"] == {"value": "granite", "origin": str(folder / FILE)}
    assert chosen["soil"]["origin"] == "unless a log names another"
    shown = lab("params", folder).out
    assert f"robot: granite ({folder / FILE})" in shown
    assert all(len(line) <= 80 or line.startswith("robot: ") for line in shown.splitlines())
    given = told("params", folder, "--robot", "granite")["chosen"]
    assert given["robot"]["origin"] == "--robot"
    refused(lab("params", tmp_path / "nowhere"), 3, "nowhere: does not exist", "folder")
    refused(lab("params", folder / FILE), 3, "is not a folder", "folder")


def test_the_file_says_what_is_known_of_single_trials(tmp_path: Path) -> None:
    text = f'use_reference = true\nref_x_std_m = 0.01\n[[trial]]\nname = "{A}"\nrests = [[0, 1]]\n'
    folder = folder_with(tmp_path, text)
    options = choose(folder, Options(info=TrialInfo(ref_x_std=0.02))).options
    one, other = (options.info_of(folder / f"{name}.csv") for name in (A, B))
    assert one == TrialInfo(rests=((0.0, 1.0),), use_reference=True, ref_x_std=0.02)
    assert other == TrialInfo(use_reference=True, ref_x_std=0.02)
    done = lab("ingest", folder, "--jobs", 1)
    assert done.code == 4
    assert "there is no external reference to use" in done.error
    (folder / FILE).write_text(text.replace(A, "virtual_v0.4_r1"), encoding="utf-8")
    refused(lab("ingest", folder), 3, "[trial.1]: name = 'virtual_v0.4_r1': no such log", A[:9])


def test_with_a_reference_ingest_also_compares_the_estimate_without_it(tmp_path: Path) -> None:
    trials(tmp_path, A)
    path = tmp_path / "logs" / f"{A}.csv"
    motion = gl.ingest(path)[0].motion
    frame = pd.DataFrame({"t_s": motion.t, "ref_x_m": motion.x})
    frame.to_csv(tmp_path / "tape.csv", index=False)
    apart = gl.ingest(path, reference=tmp_path / "tape.csv", use_reference=True, ref_x_std=0.001)[0]
    assert apart.motion.slip_ratio.std < 0.5 * motion.slip_ratio.std
    places = {one.quantity: one for one in apart.judgement}
    assert places["distance"].rmse < 1e-3
    options = "--use-reference", "--ref-x-std", 0.001
    done = succeeded("ingest", path, "--reference", tmp_path / "tape.csv", *options, cwd=tmp_path)
    assert "estimated without the reference: distance" in done.out
