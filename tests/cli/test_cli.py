"""The command line as a user meets it: output, errors, exit codes, of whole processes where that matters."""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import granite_lab as gl
from granite_lab.parameters import GRAVITY
from tests.corpus.cli import SAMPLES, Done, lab, refused, succeeded, told
from tests.logs import make

SLOW, SAMPLE = SAMPLES / "virtual_v0.3_r1.csv", SAMPLES / "virtual_v0.7_r1.csv"
TRIALS = [SLOW, SAMPLE]
MAIN = "from granite_lab.cli import main; main()"


def process(*args: object) -> Done:
    """Run a command in a process of its own, which costs a second for its imports."""
    command = [sys.executable, "-W", "ignore", "-c", MAIN, *map(str, args)]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    return Done(done.returncode, done.stdout, done.stderr)


def test_help_and_version() -> None:
    assert "study" in process("--help").out
    assert "study" in process("-h").out
    words = [sys.executable, "-m", "granite_lab", "--version"]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout.startswith("granite-lab ")


def test_a_virtual_log_is_made_again_to_the_byte(tmp_path: Path) -> None:
    logs = [tmp_path / f"{k}.csv" for k in range(3)]
    for log, run, seed in zip(logs, (lab, process, lab), (104, 104, 105), strict=True):
        words = ("simulate", "--v", 0.5, "--a", 2, "--distance", 0.3, "--seed", seed, "--log", log)
        assert run(*words, "--out", tmp_path / "run.out").code == 0
    first, again, other = (log.read_bytes() for log in logs)
    assert first == again != other
    assert b"# virtual = true" in first


NO, MANY = "cannot be understood", "exclude"
REFUSED: list[tuple[str, int, str, str]] = [
    ("studdy", 2, "no such command 'studdy'", "did you mean 'study'? granite-lab --help"),
    ("effects chek", 2, "no such command 'chek'", "did you mean 'check'?"),
    ("study --foo", 2, "no such option: --foo", "granite-lab study --help"),
    ("study --jobs many", 2, "invalid value for '--jobs'", "granite-lab study --help"),
    ("view", 2, "missing argument", "granite-lab view --help"),
    ("simulate --variant 0.4", 2, "unknown variant '0.4'", "0.2, 0.3, 0.5, 0.7"),
    ("simulate", 2, "the motion is not given", "--variant 0.5"),
    ("simulate --variant 0.5 --v 0.5", 2, "--variant excludes", "one or the other"),
    ("simulate --v -1 --a 1 --distance 1", 3, "velocity_mps = -1 is out of", "0.01"),
    ("simulate --variant 0.5 --robot granit", 2, "unknown robot 'granit'", "'granite'"),
    ("simulate --variant 0.5 --k92 0.1 --a-theta 4", 2, "exclude each other", ""),
    ("simulate --variant 0.3 --format xlsx", 2, "--format xlsx: not known", ""),
    ("simulate --variant 0.3 --format csv --out x.parquet", 2, "does not fit", ""),
    ("ingest", 2, "no trials given", ""),
    ("fit-atheta", 2, "no trials given", ""),
    (f"ingest {SLOW} --rest 2:1", 2, f"--rest 2:1: {NO}", "0:1.2"),
    (f"fit-atheta --published {SLOW}", 2, "--published takes no trials", ""),
    (f"inspect {SLOW} --plot a.jpg", 2, "not a picture", ""),
    (f"inspect {SLOW} {SLOW} --plot a.png", 2, "--plot", ""),
    ("effects show drive_reactio", 2, "drive_reactio", "drive_reaction"),
    ("wheel --slip 2", 2, "slip 2 is out of range", ""),
    ("wheel --slip fast", 2, NO, ""),
    ("wheel --slip 0:1", 2, NO, ""),
    ("wheel --slip 1:0:0.1", 2, NO, ""),
    ("wheel --slip nan", 2, "out of range", ""),
    ("wheel --slip 0:nan:0.1", 2, NO, ""),
    ("wheel --slip -1:1:1e-9", 2, NO, ""),
    ("wheel --k92 1.5", 2, "out of range", ""),
    ("wheel --k92 0.5 --a-theta 2", 2, MANY, ""),
    ("wheel --load 5 --sinkage 5", 2, MANY, ""),
    ("wheel --load -5", 2, "out of range", ""),
    ("wheel --robot kobuki", 2, "the load is not given", ""),
    ("wheel --set soil.cohesion_Pa=-1", 3, "out of range", ""),
    ("wheel --set soil.cohesion=1", 3, "unknown key 'soil.cohesion'", "soil.cohesion_Pa"),
    ("wheel --effect bulldozing.strength=x", 2, NO, ""),
    ("wheel --plot wheel.jpg", 2, "not a picture", ""),
]


@pytest.mark.parametrize(("line", "code", "error", "hint"), REFUSED, ids=[line for line, *_ in REFUSED])
def test_known_trouble_is_one_line_a_hint_and_an_exit_code(
    tmp_path: Path, line: str, code: int, error: str, hint: str
) -> None:
    refused(lab(*line.split(), cwd=tmp_path), code, error, hint)
    assert not list(tmp_path.iterdir())


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


@pytest.mark.parametrize("sample", sorted(SAMPLES.glob("virtual_*_r1.csv")), ids=lambda p: p.stem)
def test_a_good_run_is_green_on_one_screen(sample: Path) -> None:
    done = succeeded("check", sample)
    assert "The run is good." in done.out
    assert "virtual data" in done.out
    assert len(done.out.splitlines()) <= 24
    assert max(map(len, done.out.splitlines())) <= 80


@pytest.mark.usefixtures("estimates_anew")
def test_a_check_takes_hardly_longer_than_the_estimate_on_which_it_rests() -> None:
    gl.check(SAMPLE)
    begin = time.process_time()
    gl.check(SAMPLE)
    checked = time.process_time()
    gl.ingest(SAMPLE)
    assert checked - begin < 1.5 * (time.process_time() - checked)


def held(column: str, value: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """Let a column read one value throughout."""
    return lambda table: table.assign(**{column: table[column].where(table[column].isna(), value)})


@pytest.mark.parametrize(
    ("change", "code", "named"),
    [
        (held("imu_ax_mps2", 0.01), 3, ("imu_ax_mps2", "acceleration x")),  # by the reader, or by the check
        (held("imu_gy_radps", 0.0), 3, ("imu_gy_radps", "rate y")),
        (held("enc_fl_rad", 0.3), 3, ("encoder fl stands still",)),
        (held("cur_rr_A", 0.0), 3, ("constant at 0 A",)),
        (lambda table: table[table["t_s"] < 6.0], 4, ("standstill",)),
    ],
)
def test_a_dead_channel_and_an_end_in_motion_are_red(
    tmp_path: Path, change: Callable[[pd.DataFrame], pd.DataFrame], code: int, named: tuple[str, ...]
) -> None:
    path = make.changed(tmp_path, SAMPLE, change)
    done = lab("check", path, "--json")
    assert done.code == code
    document = json.loads(done.out)
    assert not document["good"]
    bad = " ".join([done.error, *(c["found"] for c in document["checks"] if not c["good"])])
    assert any(name in bad for name in named)
    assert done.error
    assert done.hint
    assert "BAD" in lab("check", path).out


def test_a_log_that_cannot_be_read_is_red(tmp_path: Path) -> None:
    path = make.written(tmp_path, "hello\nworld\n", "notes.csv")
    done = lab("check", path)
    assert done.code == 3
    assert "BAD" in done.out
    refused(lab("inspect", path, "--plot", tmp_path / "a.png"), 3, "notes.csv")
    assert list(tmp_path.iterdir()) == [path]
    (found,) = gl.check(path)
    assert not found.good
    assert isinstance(found.error, gl.InputError)
    assert list(found.to_frame()["good"]) == [False]


def test_a_sweep_becomes_a_table_and_a_picture(tmp_path: Path) -> None:
    out, plot = tmp_path / "sweep.csv", tmp_path / "sweep.svg"
    words = ["--slip", "-0.4:0.8:0.2", "--k92", "0.3", "--load", "60", "--effect", "bulldozing.strength=0.5"]
    shown = succeeded("wheel", *words, "--out", out, "--plot", plot).out
    assert "with bulldozing: strength = 0.5" in shown
    table = pd.read_csv(out)
    assert table["slip"].tolist() == pytest.approx([-0.4, -0.2, 0, 0.2, 0.4, 0.6, 0.8])
    assert table["load_N"].tolist() == pytest.approx([60] * 7)
    assert table["drawbar_pull_N"].is_monotonic_increasing
    assert "sinkage [mm]" in plot.read_text()


def test_a_wheel_has_a_quarter_of_the_robot_the_law_of_the_paper_and_any_soil_and_says_what_idles() -> None:
    one = gl.wheel(0.2, v=0.4).points[0]
    assert one.load == pytest.approx(43.1 * GRAVITY / 4)
    assert one.k92 == pytest.approx(np.exp(-4.919 * 0.5), rel=1e-3)  # ω r = 0.4 / 0.8
    found = gl.wheel([0.1, 0.3], load=30, k92=0.5, changes={"soil.cohesion_Pa": 0, "soil.exponent": 1})
    assert (found.soil.cohesion, found.soil.exponent, found.soil.friction_angle) == (0, 1, 30)
    assert [p.slip for p in found.points] == [0.1, 0.3]
    slow = gl.wheel(0.2, v=0.01, k92=0.3, active={"drive_reaction": {"share": 1.0}})
    assert slow.fades
    assert slow.left_out == ("drive_reaction",)
