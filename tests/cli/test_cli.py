"""The command line as a user meets it: output, errors, exit codes, of whole processes where that matters."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from tests.corpus.cli import SAMPLES, Done, lab, succeeded, told

SAMPLE = SAMPLES / "virtual_v0.3_r1.csv"
TRIALS = [SAMPLE, SAMPLES / "virtual_v0.7_r1.csv"]


def process(*args: object, cwd: Path | None = None) -> Done:
    """Run a command in a process of its own, which costs a second for its imports."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", "from granite_lab.cli import main; main()", *map(str, args)],
        capture_output=True, text=True, cwd=cwd, stdin=subprocess.DEVNULL, check=False,
    )  # fmt: skip
    return Done(done.returncode, done.stdout, done.stderr)


def test_help_and_version() -> None:
    assert "study" in process("--help").out
    assert "study" in process("-h").out
    assert process("--version").out.startswith("granite-lab ")


def test_help_costs_about_what_importing_numpy_costs() -> None:
    """0.25 s of processor time where NumPy takes 0.18; 0.4 s would be 2.2 times that."""

    def cost(*command: str) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-W", "ignore", "-c", *command], capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    costs = [
        (cost("from granite_lab.cli import main; main()", "--help"), cost("import numpy")) for _ in range(5)
    ]
    assert min(own for own, _ in costs) < 2.2 * min(numpy for _, numpy in costs)


def test_simulate_writes_a_run_and_one_json_document(tmp_path: Path) -> None:
    document = told("simulate", "--variant", "0.5", "--k92", "0.111", cwd=tmp_path)
    assert document["slip_ratio"] == pytest.approx(0.1625, abs=0.001)
    run = pd.read_csv(tmp_path / document["run"])
    named = (
        "t_s x_m v_mps pitch_rad pitch_rate_radps omega_f_radps omega_r_radps torque_f_Nm torque_r_Nm "
        "current_f_A current_r_A slip_f slip_r sinkage_f_m sinkage_r_m k92 imu_ax_mps2 enc_f_rad"
    )
    assert set(named.split()) <= set(run.columns)
    assert run["t_s"].iloc[0] == -1
    assert not run.isna().any().any()


def test_a_virtual_log_is_made_again_to_the_byte(tmp_path: Path) -> None:
    for name, run in (("a", lab), ("b", process)):
        done = run(
            "simulate", "--variant", "0.3", "--scatter", "--seed", "104", "--log", tmp_path / name / "x.csv",
            "--out", tmp_path / "run.csv",
        )  # fmt: skip
        assert done.code == 0, done.err
    assert (tmp_path / "a" / "x.csv").read_bytes() == (tmp_path / "b" / "x.csv").read_bytes()
    assert "# virtual = true" in (tmp_path / "a" / "x.csv").read_text()


@pytest.mark.parametrize(
    ("args", "code", "error", "hint"),
    [
        (["simulate", "--variant", "0.4"], 2, "unknown variant '0.4'", "0.2, 0.3, 0.5, 0.7"),
        (["simulate"], 2, "the motion is not given", "--variant 0.5"),
        (["simulate", "--variant", "0.5", "--v", "0.5"], 2, "--variant excludes", "one or the other"),
        (
            ["simulate", "--v", "-1", "--a", "1", "--distance", "1"],
            3,
            "velocity_mps = -1 is out of range",
            "0.01",
        ),
        (["simulate", "--variant", "0.5", "--robot", "granit"], 2, "unknown robot 'granit'", "'granite'"),
        (["simulate", "--variant", "0.5", "--soil", "none.toml"], 3, "none.toml: cannot be read", ""),
        (["simulate", "--variant", "0.5", "--k92", "0.1", "--a-theta", "4"], 2, "exclude each other", ""),
        (["ingest", "missing.csv"], 3, "missing.csv", ""),
        (["ingest"], 2, "no trials given", ""),
        (["fit-atheta"], 2, "no trials given", ""),
        (["ingest", SAMPLE, "--rest", "2:1"], 2, "--rest 2:1: cannot be understood", "0:1.2"),
        (["fit-atheta", "--published", SAMPLE], 2, "--published takes no trials", ""),
        (["effects", "show", "drive_reactio"], 2, "drive_reactio", "drive_reaction"),
    ],
)
def test_known_trouble_is_one_line_a_hint_and_an_exit_code(
    tmp_path: Path, args: list[object], code: int, error: str, hint: str
) -> None:
    run = process if args == ["simulate"] else lab
    done = run(*args, cwd=tmp_path)
    assert done.code == code, done.err
    lines = [line for line in done.err.splitlines() if line.startswith(("error: ", "hint: "))]
    assert lines[0].startswith("error: ")
    assert error in lines[0]
    assert len(lines) == (2 if hint or len(lines) == 2 else 1)
    assert hint in lines[-1]
    assert "Traceback" not in done.err
    assert done.out == ""
    assert not list(tmp_path.rglob("*.csv"))


def test_params_prints_every_number_with_its_origin() -> None:
    document = told("params")
    assert {"group", "key", "value", "unit", "low", "high", "origin"} <= set(document["parameters"][0])
    shown = lab("params").out
    assert max(map(len, shown.splitlines())) <= 80


def test_ingest_gives_the_motion_at_the_stamps_of_the_imu(tmp_path: Path) -> None:
    trial = told("ingest", SAMPLE, cwd=tmp_path)["trials"][0]
    assert trial["variant"]["velocity"] == 0.3
    motion = pd.read_csv(tmp_path / trial["motion"])
    named = "t_s x_m x_std_m v_mps v_std_mps pitch_rad pitch_std_rad phase"
    wheels = [f"{n}_{w}{s}" for w in ("fl", "fr", "rl", "rr") for n, s in
              (("v_wheel", "_mps"), ("slip", ""), ("slip", "_std"))]  # fmt: skip
    assert set(named.split()) | set(wheels) <= set(motion.columns)
    assert set(motion["phase"]) == {"rest", "accelerate", "steady", "brake"}
    log = pd.read_csv(SAMPLE, comment="#")
    stamps = log.loc[log["imu_ax_mps2"].notna(), "t_s"].to_numpy()
    assert motion["t_s"].to_numpy() == pytest.approx(stamps, abs=1e-9)


def test_notes_are_counted_and_listed_on_request(tmp_path: Path) -> None:
    out = tmp_path / "k92 of trials.csv"
    short, long = lab("fit-k92", *TRIALS, "--out", out), lab("fit-k92", *TRIALS, "--verbose")
    notes = {n for fit in told("fit-k92", *TRIALS)["fits"] for n in fit["notes"]}
    assert notes
    assert f"{len(notes)} notes of the fits: --verbose lists them" in short.out
    assert len(long.out.splitlines()) > len(short.out.splitlines())
    assert "--verbose" not in long.out
    assert max(map(len, (short.out + long.out).splitlines())) <= 80
    table = pd.read_csv(out)
    assert list(table["trial"]) == [path.stem for path in TRIALS]
    assert set(table["data"]) == {"virtual"}


def test_fit_atheta_names_its_trials_and_needs_three_speeds_for_a_verdict(tmp_path: Path) -> None:
    out = tmp_path / "points.csv"
    done = succeeded("fit-atheta", *TRIALS, "--out", out)
    assert "Not tested" in done.out
    shown = " ".join(done.out.split())
    assert "Virtual trials: virtual_v0.3_r1, virtual_v0.7_r1." in shown
    assert set(pd.read_csv(out)["data"]) == {"virtual"}
    assert told("fit-atheta", *TRIALS)["agrees"] is None
