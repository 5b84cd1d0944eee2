"""Lines that README and pages show are run as printed; what they name exists; the example report."""

import json
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from granite_lab import Estimate
from granite_lab.effects import get
from granite_lab.errors import InputError
from granite_lab.files import sha256
from granite_lab.hidden.scoring import MEANING, score
from granite_lab.hidden.sealed import open_answer
from granite_lab.logs import read_trial
from granite_lab.parameters import load_robot
from tests.corpus.cli import Done, lab
from tests.docs.pages import PAGES, ROOT, blocks, command_of, lines_to_run, save_files, text_of
from tests.effects.example import EXAMPLE
from tests.logs.bags import Bag
from tests.running.processes import ALONE, fit_by_slip

SAMPLES = ROOT / "data" / "samples"
LOG = SAMPLES / "virtual_v0.3_r1.csv"
HOW_TO = ("robot", "soil", "effect", "logger")
QUICK = ("README.md", "docs/model.md", "docs/logs.md", *(f"docs/how-to-{x}.md" for x in HOW_TO))
STUDIED = ("docs/tutorial.md", "README.md", "docs/paper.md", "docs/strangers.md")
"""Pages whose lines need a study; these run one after the other in one folder, on two logs."""

ELSEWHERE = {
    "make study": "installs, then runs the study of the tutorial",
    ". .venv/bin/activate": "the tests run in an environment already",
    "granite-lab study runs": "tests/logs/test_other_files.py",
    "granite-lab study runs --map maps": "tests/logs/test_other_files.py",
    "granite-lab hide --effect mixture --causes 3 --soil-law random --seed 7 --out sets/mixture-7": (
        "takes a minute: tests/hidden/test_hidden_sets.py"
    ),
    "granite-lab view reports/my-sand": "opens a window: tests/recording",
    "granite-lab view reports/mylab --trial run07": "opens a window: tests/recording",
    "rerun --bind 127.0.0.1 --serve-web reports/mylab/recordings/run07.rrd": "serves until Ctrl+C",
    "granite-lab discover data/samples --effects towed_sledge.py": "a search: tests/discovery",
    "granite-lab hide --effect random --lab wild --seed 7 --out sets/7": "tests/hidden/test_hidden_sets.py",
    "granite-lab hide --effect none --command joystick --controller unknown --seed 7 --out sets/stick-7": (
        "tests/hidden/test_hidden_commands.py"
    ),
    "granite-lab discover sets/7 --json > finding.json": "the search of the tutorial",
    "granite-lab reveal sets/7 --finding finding.json": "as in the tutorial",
    "granite-lab study trials/ --out reports/my-sand": "the study of the tutorial",
    "granite-lab discover data/samples": "the search of the tutorial",
    "granite-lab discover my-trials --out my-trials/finding": "the search of the tutorial",
    "granite-lab plan-next reports/discover": "as in the tutorial",
    "granite-lab study --verify reports/sand-a": "a study again: tests/running/test_whole_runs.py",
    "granite-lab study --verify reports/my-sand": "a study again: tests/running/test_whole_runs.py",
    "granite-lab study moved/logs --verify reports/my-sand": "tests/running/test_whole_runs.py",
    "GRANITE_SOAK=1 python -m pytest -rP tests/running/test_whole_runs.py tests/running/test_cluster.py": (
        "takes hours"
    ),
}
"""Lines that are not run here, with the reason."""

SMALLER = {
    "granite-lab hide --effect random --seed 1 --out set": (
        "granite-lab hide --effect random --seed 1 --out set --repetitions 1"
    ),
    "granite-lab compare mylab --map my_logger.toml --model reports/mylab-found/model.toml": (
        "granite-lab compare mylab/run07.csv --map my_logger.toml --model reports/mylab-found/model.toml"
    ),
    "granite-lab discover data/samples --json > finding.json": (
        "granite-lab discover mylab --map my_logger.toml --json > finding.json"
    ),
}
"""Lines that are run on fewer logs; the search of the two logs is done only once."""

SAID = {
    "inspect": "encoders", "check": "The run is good.", "ingest": "slip", "simulate": "λ_R",
    "wheel": "drawbar pull", "fit-k92": "trajectory", "fit-atheta": "4.919", "compare": "pitch rate",
    "effects": "tyre_windup", "effects show": "spring balance", "params": "wheel_base_m", "robot": "allowed",
    "effects check": "machine code gives the same run", "hide": "4 virtual trials", "reveal": "seed",
    "reveal --finding": "judgement",
    "study": "How far can this be trusted?", "view": "run07.png", "discover": "model.toml",
    "discover --json": '"schema"', "plan-next": "next trial", "compare-studies": "no difference seen",
}  # fmt: skip
"""Words of a line to a text of its output, where the page shows none; the longest that fits counts."""


def clone(folder: Path, *samples: str) -> None:
    """Make a folder like a fresh clone with some of the samples."""
    (folder / "data" / "samples").mkdir(parents=True)
    for name in ("sealed.bin", *(f"virtual_{name}.csv" for name in samples)):
        (folder / "data" / "samples" / name).symlink_to(SAMPLES / name)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A clone with two samples, and the files of one's own that several pages name."""
    clone(tmp_path, "v0.3_r1", "v0.7_r1")
    monkeypatch.chdir(tmp_path)
    shutil.copy(LOG, "trial.csv")
    Path("my_effect.py").write_text(EXAMPLE, encoding="utf-8")
    foreign(LOG, "run.csv")
    save_files("docs/how-to-logger.md", tmp_path)
    return tmp_path


def write_logs_of_other_loggers(folder: Path) -> None:
    """Write the sample as docs/logs.md supposes it: by other names, in several files, as a bag."""
    table = pd.read_csv(LOG, comment="#")
    stamp = table[["t_s"]]
    for name, start in (("imu", "imu_"), ("wheels", "enc_"), ("motors", "cur_")):
        stamp.join(table.filter(regex=f"^{start}")).dropna().to_csv(f"{name}.csv", index=False)
    truth = pd.read_csv(SAMPLES / "truth" / LOG.name, comment="#")
    truth[["t_s"]].assign(ref_v_mps=truth["v_mps"]).to_csv("gps.csv", index=False)
    pd.concat(table.assign(run_id=n) for n in (3, 4)).to_csv("runs.csv", index=False)
    bag = Bag("mcap file")
    outside = ((t, bag.odometry(t, x, v)) for t, x, v in truth[["t_s", "x_m", "v_mps"]][::4].to_numpy())
    messages = [
        *((topic.replace("data", "raw"), t, m) for topic, t, m in bag.trial(read_trial(LOG))),
        *(("/mocap/odom", t, m) for t, m in outside),
    ]
    shutil.move(bag.write(folder, "bag", messages), "drive.mcap")


def foreign(log: Path, out: str) -> None:
    """Write a sample as the logger of how-to-logger.md would: other names and units."""
    table = pd.read_csv(log, comment="#")
    deg = 57.29577951308232
    scale = {"t_s": 1000.0} | {f"imu_a{a}_mps2": 1 / 9.81 for a in "xyz"}
    scale |= {f"imu_g{a}_radps": deg for a in "xyz"}
    scale |= {f"enc_{w}_rad": deg for w in ("fl", "fr", "rl", "rr")}
    (header,) = (b.code.strip().split(";") for b in blocks("docs/how-to-logger.md") if b.language == "csv")
    made = pd.DataFrame({new: table[old] * k for new, (old, k) in zip(header, scale.items(), strict=True)})
    made.to_csv(out, sep=";", index=False)


def run(line: str) -> Done:
    """Run a line as it is printed, with one process; what it prints may go to a file.

    A study or a search fits by the slip alone, and remembers what it does elsewhere.
    """
    text, _, target = line.partition(" > ")
    words = shlex.split(text)
    if words[0] == "python":
        done = subprocess.run([sys.executable, *words[1:]], capture_output=True, text=True, check=False)
        return Done(done.returncode, done.stdout, done.stderr)
    command, _ = command_of(words[1:])
    with pytest.MonkeyPatch.context() as patch:
        if is_long(line):
            fit_by_slip(Path.cwd().with_name(f"{Path.cwd().name}-by-slip"), patch)
        done = lab(*words[1:], *(["-j", "1"] if any("--jobs" in p.opts for p in command.params) else []))
    if target:
        Path(target).write_text(done.out, encoding="utf-8")
    return done


def follow(
    page: str, chosen: Callable[[str], bool], then: Callable[[str], None] = lambda _: None
) -> list[Done]:
    """Run the chosen lines of a page in order; each ends with exit code 0 and prints what the page shows.

    Args:
        page: its file.
        chosen: whether a line is run.
        then: what is done after a line.
    """
    found = []
    for line, shown in lines_to_run(page):
        if line in ELSEWHERE or not chosen(line):
            continue
        done = run(SMALLER.get(line, line))
        assert done.code == 0, (line, done.err or done.out)
        printed = " ".join((done.out + done.err).split())
        if line.startswith("granite-lab ") and (is_long(line) or not shown):
            key = max((key for key in SAID if set(key.split()) <= set(line.split())), key=len)
            assert SAID[key] in printed, (line, done.out)
        if not is_long(line):
            assert not missing(shown, printed), (line, done.out)
        found.append(done)
        then(line)
    return found


def missing(shown: str, printed: str) -> list[str]:
    """Return the words of a page that were not printed; numbers may differ in their last digit or by 5 %."""
    number = re.compile(r"−?\d+\.?\d*")
    values = np.array([float(x.replace("−", "-")) for x in number.findall(printed)])
    lost = []
    for word in re.sub(r"\[…\]|…|─+", " ", shown).split():
        known = word in printed
        if number.fullmatch(word):
            size, digits = float(word.replace("−", "-")), len(word.partition(".")[2])
            known = (abs(values - size) <= max(0.05 * abs(size), 2.01 * 10.0**-digits)).any()
        lost += [] if known else [word]
    return lost


def is_long(line: str) -> bool:
    """Tell whether a line needs a study or a search."""
    heads = ("study", "view", "discover", "plan-next", "compare-studies")
    return line.startswith(tuple(f"granite-lab {head}" for head in heads)) or "my-trials" in line


def slip_of(done: Done) -> float:
    """Return the slip ratio [%] that a simulation prints."""
    match = re.search(r"λ_R[^\d]*([\d.]+) ?%", done.out)
    assert match, done.out
    return float(match[1])


def measured(*words: str) -> float:
    """Return the slip ratio [%] that an estimation finds."""
    done = lab("ingest", *words, "-j", "1", "--json")
    return 100 * float(json.loads(done.out)["trials"][0]["slip_ratio"]["value"])


def quick(page: str, folder: Path) -> list[Done]:
    """Follow the lines of a page that need no study."""
    save_files(page, folder)
    return follow(page, lambda line: not is_long(line), prepare)


@pytest.mark.parametrize(
    ("page", "files"),
    [
        ("README.md", "virtual.csv set/sealed.bin reports/ingest/trial.csv"),
        ("docs/model.md", "wheel.png wheel.csv arc.png"),
    ],
)
def test_the_lines_of_a_page_write_what_they_name(page: str, files: str, folder: Path) -> None:
    assert quick(page, folder)
    for name in files.split():
        assert (folder / name).stat().st_size > 100


def test_the_lines_of_the_page_on_logs(folder: Path) -> None:
    write_logs_of_other_loggers(folder)
    several, one_of_them, seen, bag = quick("docs/logs.md", folder)
    sample = measured("trial.csv")
    for done, name in ((several, "imu"), (one_of_them, "runs"), (bag, "drive")):
        found = re.search(rf"{name} .* (\d+\.\d+) ± \d\.\d+ ", done.out)
        assert found, done.out
        assert float(found[1]) == pytest.approx(sample, abs=0.3), name
    assert "/imu/raw" in seen.out


def test_a_robot_by_the_page_simulates_and_its_log_is_read(folder: Path) -> None:
    written, params, simulated, _ = quick("docs/how-to-robot.md", folder)
    assert "allowed" in written.out
    assert re.search(r"body_mass_kg .* 18 ", params.out)
    assert 0 < slip_of(simulated) < 60
    assert measured("rover_virtual.csv", "--robot", "rover.toml") == pytest.approx(slip_of(simulated), abs=4)


def test_a_soil_by_the_page_changes_the_slip(folder: Path) -> None:
    params, paper, fine, _ = quick("docs/how-to-soil.md", folder)
    assert "fine_sand" in params.out
    assert abs(slip_of(fine) - slip_of(paper)) > 0.2


def test_a_logger_by_the_page_gives_the_same_slip(folder: Path) -> None:
    _, seen, _ = quick("docs/how-to-logger.md", folder)
    draft = (folder / "draft.toml").read_text(encoding="utf-8")
    assert all(f'name = "{name}"' in draft for name in pd.read_csv("run.csv", sep=";"))
    assert "variant 0.3 m/s" in " ".join(seen.out.split())
    assert measured("run.csv", "--map", "my_logger.toml") == pytest.approx(measured("trial.csv"), abs=0.1)


def test_an_effect_by_the_page_is_listed_and_slows_the_robot(folder: Path) -> None:
    listed, _, checked, without, with_it = quick("docs/how-to-effect.md", folder)
    assert "FAILED" not in checked.out
    assert "towed_sledge" in listed.out
    assert slip_of(with_it) > slip_of(without) + 0.5


@pytest.mark.usefixtures("one_picture")
def test_the_tutorial_and_what_builds_on_a_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its search is for one effect; tests/discovery searches among more."""
    few = {id_: get(id_) for id_ in ALONE}
    monkeypatch.setattr("granite_lab.chain.library", lambda *_: few)
    clone(tmp_path, *(path.stem.removeprefix("virtual_") for path in SAMPLES.glob("*.csv")))
    monkeypatch.chdir(tmp_path)
    save_files("docs/tutorial.md", tmp_path)
    save_files("docs/how-to-logger.md", tmp_path)
    follow("docs/tutorial.md", lambda _: True, prepare)
    draft = Path("draft.toml").read_text(encoding="utf-8")
    (guessed,) = (b.code for b in blocks("docs/tutorial.md") if "% sure" in b.code and b.language == "toml")
    for column in guessed.strip().split("\n\n"):
        assert column.partition("\n")[2] in draft
    for name in ("a", "b", "sand-a", "sand-b"):
        shutil.copytree("reports/mylab", f"reports/{name}")
    shutil.copytree("reports/mylab-found", "my-trials/finding")
    Path("my-trials/answer.json").write_text('{"effects": []}', encoding="utf-8")
    for page in STUDIED[1:]:
        follow(page, is_long, prepare)
    assert Path("reports/a-and-b.csv").is_file()


def prepare(line: str) -> None:
    """Do between two lines what a page leaves to its reader."""
    if line == "python make_logs.py":
        for path in Path("mylab").iterdir():
            if path.stem not in ("run04", "run07"):
                path.unlink()


def test_the_python_lines_of_the_page_on_estimation() -> None:
    (code,) = (b.code for b in blocks("docs/estimation.md") if b.language == "python")
    names = {
        "trial": read_trial(SAMPLES / "virtual_v0.5_r1.csv"),
        "robot": load_robot(),
        "Estimate": Estimate,
    }
    exec(code, names)
    assert names["motion"].slip_ratio.value == pytest.approx(0.186, abs=0.003)


def test_no_line_is_left_out_unseen() -> None:
    """Each page with lines is followed, or its lines say where they are run; tests/api runs api.md."""
    lines = {str(page.relative_to(ROOT)): [line for line, _ in lines_to_run(page)] for page in PAGES}
    assert set(ELSEWHERE) | set(SMALLER) <= {line for listed in lines.values() for line in listed}
    for page, listed in lines.items():
        for line in listed:
            followed = page in (STUDIED if is_long(line) else QUICK) or page == "docs/tutorial.md"
            assert followed or line in ELSEWHERE, (page, line)
    code = {str(page.relative_to(ROOT)) for page in PAGES for b in blocks(page) if b.language == "python"}
    assert code == {"docs/estimation.md", "docs/how-to-effect.md", "docs/tutorial.md", "docs/api.md"}


SHOWN = [line for page in PAGES for line, _ in lines_to_run(page) if line.startswith("granite-lab ")]
INLINE = [
    words
    for page in PAGES
    for words in re.findall(r"(?<!`)`granite-lab ([^`]+)`", re.sub(r"(?s)```.*?```", "", text_of(page)))
]
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+)(?:#([^)]*))?\)")


@pytest.mark.parametrize("line", sorted(set(SHOWN)))
def test_a_shown_command_is_understood(line: str) -> None:
    command, rest = command_of(shlex.split(line.split(" > ", maxsplit=1)[0])[1:])
    assert command.name != "granite-lab", line
    with suppress(InputError):  # the files of the page are not here
        command.make_context("granite-lab", rest)  # raises where an option or argument does not fit


@pytest.mark.parametrize("text", sorted(set(INLINE)))
def test_a_command_that_a_sentence_names_exists(text: str) -> None:
    command, rest = command_of(text.split())
    if not text.startswith("-"):
        assert command.name != "granite-lab", text
    known = {name for p in command.params for name in (*p.opts, *p.secondary_opts)} | {"--help", "-h"}
    assert {word.split("=")[0] for word in rest if word.startswith("-")} <= known


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_of_a_page_lead_somewhere(page: Path) -> None:
    for target, heading in LINK.findall(text_of(page)):
        assert (page.parent / target).exists(), target
        if heading:
            titles = re.findall(r"^#+ (.*)", text_of(page.parent / target), re.MULTILINE)
            anchors = [re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in titles]
            assert heading in anchors, (target, heading)


def test_every_page_is_linked_from_the_readme() -> None:
    linked = {(ROOT / target).resolve() for target, _ in LINK.findall(text_of("README.md"))}
    assert {page.resolve() for page in PAGES} - linked - {ROOT / "README.md"} == set()


def test_make_targets_that_are_named_exist() -> None:
    makefile = text_of("Makefile")
    named = {target for page in PAGES for target in re.findall(r"(?:`|^)make ([a-z-]+)", text_of(page), re.M)}
    assert len(named) > 5
    for target in named:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


SHOWN_REPORT = ROOT / "reports" / "example"


@pytest.fixture(scope="module")
def report() -> dict[str, Any]:
    document: dict[str, Any] = json.loads((SHOWN_REPORT / "report.json").read_text(encoding="utf-8"))
    return document


def test_it_is_small_shows_every_figure_and_is_of_the_samples_that_are_there(report: dict[str, Any]) -> None:
    files = [path for path in SHOWN_REPORT.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 6e6
    assert not [path for path in files if path.suffix == ".rrd"]
    page = (SHOWN_REPORT / "report.md").read_text(encoding="utf-8").replace("\\", "")
    shown = set(re.findall(r"\]\(figures/([^)]+)\)", page))
    assert shown == {path.name for path in (SHOWN_REPORT / "figures").iterdir()}
    text = json.dumps(report["provenance"])
    logs = sorted(SAMPLES.glob("*.csv"))
    assert len(logs) == 12
    for log in logs:
        assert sha256(log) in text, f"{log.name} has changed: run reports/make_example.py"


def test_its_first_screen_says_slip_a_theta_and_what_is_missing(report: dict[str, Any]) -> None:
    page = (SHOWN_REPORT / "report.md").read_text(encoding="utf-8").split("\n## ")[0]
    said = " ".join(page.replace("\\", "").split())  # no-break spaces, too
    for s in report["answers"]["speeds"]:
        low, high = (f"{x:.{2 if s['slip']['std'] < 0.355 else 1}f}" for x in s["slip"]["ci95"])
        assert re.search(rf"\| {s['speed_mps']:g} \| [\d.]+ \| {low} to {high} \|", said)
    law = r"k_92 falls with the desired velocity v as exp\(−a_θ v\)\."
    value = r"With soil and .{,30}, a_θ = [\d.]+ ± [\d.]+ s/m"
    assert re.search(rf"4\.919 s/m\?\*\* (Yes|No)\b.{{,60}}\. {law} {value}", said)
    if report["discovery"]["verdict"] == "named":
        assert re.search(r"How much of the gap does it close\?\*\* (Over )?\d+ %", said)


def test_the_numbers_of_a_study_in_the_tutorial_are_those_of_the_example(report: dict[str, Any]) -> None:
    """Its logs are the samples in other units: the numbers agree within the std that it prints."""
    page, pair = text_of("docs/tutorial.md"), r"([\d.]+) ± ([\d.]+)"
    rows = re.findall(rf"^ +(0\.\d) +([\d.]+) +[\d.]+ to [\d.]+ .* {pair} ", page, flags=re.M)
    by_speed = {s["speed_mps"]: s for s in report["answers"]["speeds"]}
    assert len(rows) == 2
    for speed, slip, k92, k92_std in rows:
        known = by_speed[float(speed)]
        assert float(slip) == pytest.approx(known["slip"]["value"], abs=known["slip"]["std"])
        assert float(k92) == pytest.approx(known["k92"]["value"], abs=float(k92_std))
    numbers = {"a_θ =": report["answers"]["a_theta"]["value"]}
    for effect in report["discovery"]["effects"]:
        assert f"`{effect['id']}`" in page
        numbers |= {name: p["value"] for name, p in effect["parameters"].items() if f"({name} " in page}
    assert len(numbers) == 3
    for name, value in numbers.items():
        said = re.search(rf"{name} {pair}( mrad)?", page)
        assert said, name
        scale = 1e3 if said[3] else 1.0
        assert float(said[1]) == pytest.approx(scale * value, abs=float(said[2])), name
    closes = next(q["verdict"] for q in report["answers"]["questions"] if q["id"] == "closes")
    assert "Yes, by {}.".format(closes.replace("\u00a0", " ")) in page


def test_the_readme_beside_it_tells_how_the_finding_was_judged(report: dict[str, Any]) -> None:
    judged = score(open_answer(SAMPLES), report["discovery"])
    said = " ".join(text_of("reports/README.md").split())
    assert MEANING[judged.outcome] in said
    for effect in (*judged.hidden, *judged.named):
        assert f"`{effect}`" in said
    text = text_of("reports/README.md")
    assert runpy.run_path(str(ROOT / "reports" / "make_example.py"))["judge"](text) == text
