"""A kit for strangers is checked and sealed; every outcome of a judgement, from a table of answers."""

import base64
import hashlib
import json
import shutil
import subprocess
import sys
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import granite_lab as gl
from granite_lab.effects import library
from granite_lab.errors import InputError, UsageError
from granite_lab.hidden import kit_check
from granite_lab.hidden.kit_check import HEAD
from granite_lab.hidden.scoring import SCHEMA, read_finding, score
from granite_lab.hidden.sealed import LARGEST, open_answer, seal, unseal
from granite_lab.logs import read_trial
from tests.corpus.cli import SAMPLES, lab, refused, succeeded, told

OUTSIDE = Path(__file__).parent.parent / "data" / "outside" / "o03"
REACTION = [{"id": "drive_reaction", "parameters": {"share": 0.8}}]


@pytest.fixture
def kit(tmp_path: Path) -> Path:
    """Return a kit that a stranger filled with trials of a simulator in C."""
    folder = tmp_path / "kit"
    gl.kit(folder)
    for log in OUTSIDE.glob("*.csv"):
        shutil.copy(log, folder / "trials")
    answered(folder, REACTION)
    return folder


def answered(kit: Path, effects: object, **more: object) -> None:
    told = json.loads((kit / "answer.json").read_text())
    told |= {"made_by": "planar simulator in C", "virtual": True, "effects": effects} | more
    (kit / "answer.json").write_text(json.dumps(told))


def check(kit: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run the checker as a stranger does: no site-packages, no granite-lab."""
    command = [sys.executable, "-I", "-S", str(kit / "check.py"), *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=kit.parent)


def sealed(kit: Path, *, keep: bool = False) -> Path:
    done = check(kit, "--seal")
    assert done.returncode == 0, done.stdout + done.stderr
    if not keep:
        (kit / "answer.json").unlink()
    return kit


def finding(kit: Path, verdict: str, *ids: str) -> None:
    effects = [{"id": i, "parameters": {"share": {"value": 0.78, "std": 0.05}}} for i in ids]
    (kit / "finding").mkdir()
    gap = {"train": {"before": 3.0, "after": 1.0}}
    document = {"schema": SCHEMA, "verdict": verdict, "effects": effects, "gap": gap}
    (kit / "finding" / "finding.json").write_text(json.dumps(document))


def test_an_empty_kit_holds_readme_template_checker_and_the_allowed_names(tmp_path: Path) -> None:
    assert told("kit", tmp_path / "told")["folder"] == str(tmp_path / "told")
    made = gl.kit(tmp_path / "new")
    assert {path.relative_to(made.folder).as_posix() for path in made.files} == {
        "README.md", "check.py", "answer.json", "allowed.json", "trials/robot.toml", "trials/soil.toml",
    }  # fmt: skip
    # one text seals kits and hidden sets
    assert (made.folder / "check.py").read_text() == Path(kit_check.__file__).read_text()
    allowed = json.loads((made.folder / "allowed.json").read_text())["effects"]
    assert set(allowed) == set(library())
    high = allowed["drive_reaction"]["parameters"]["share"]["high"]
    assert high == library()["drive_reaction"].parameters[0].high
    assert set(made.to_frame()["effect"]) == set(library())
    with pytest.raises(UsageError, match="not empty"):
        gl.kit(tmp_path / "new")
    done = check(made.folder)
    assert done.returncode == 3
    assert "made_by is empty" in done.stdout
    assert "contains no log" in done.stdout


def test_the_log_that_the_readme_shows_is_one_that_can_be_read(kit: Path) -> None:
    """Its header above the rows of a sample; robot and soil are the kit's files."""
    text = (kit / "README.md").read_text()
    block = [line.strip() for line in text.splitlines() if line.startswith(("    # ", "    t_s"))]
    rows = (SAMPLES / "virtual_v0.3_r1.csv").read_text().splitlines()
    first = next(k for k, line in enumerate(rows) if line.startswith("t_s"))
    assert block[-1] == rows[first]
    log = kit / "trials" / "from_readme.csv"
    log.write_text("\n".join(block + rows[first + 1 :]) + "\n")
    assert check(kit).returncode == 0
    trial = read_trial(log)
    assert trial.info.v_desired == 0.3
    assert Path(str(trial.info.robot)).name == "robot.toml"


def test_a_good_kit_is_sealed_and_its_hash_holds(kit: Path) -> None:
    sealed(kit, keep=True)
    digest = (kit / "seal.sha256").read_text().split()[0]
    assert digest == hashlib.sha256((kit / "sealed.bin").read_bytes()).hexdigest()
    assert "drive_reaction" not in (kit / "sealed.bin").read_text()
    sealed(kit)  # the salt is new: equal answers have other hashes
    assert digest != (kit / "seal.sha256").read_text().split()[0]


BREACHES: list[tuple[Callable[[Path], Any], str]] = [
    (lambda k: (k / "answer.json").write_text("{"), "not valid"),
    (lambda k: (k / "answer.json").unlink(), "answer.json: cannot be read"),
    (lambda k: (k / "answer.json").write_text('{"schema": "x"}'), "schema is not"),
    (lambda k: answered(k, "none"), "effects is not a list"),
    (lambda k: answered(k, [], virtual="yes"), "neither true"),
    (lambda k: answered(k, [{"id": "tire_windup"}]), "'tire_windup' is not an id"),
    (lambda k: answered(k, [{"id": "unknown"}]), "needs a title"),
    (lambda k: answered(k, [{"id": "drive_reaction", "parameters": {"size": 1}}]), "known: share"),
    (lambda k: answered(k, [{"id": "drive_reaction", "parameters": {"share": "1"}}]), "is not a number"),
    (lambda k: answered(k, [{"id": "drive_reaction", "parameters": {"share": 99}}]), "is out of range"),
    (lambda k: (k / "trials" / "a.csv").write_text("# x = 1\nt_s,ax\n"), "no column for imu_ax"),
    (lambda k: (k / "trials" / "a.csv").write_text("t_s\n0\n"), "'# v_desired_mps = …' is missing"),
    (lambda k: edit(k, "0.2_1", lambda rows: [*rows[:-1], "x" + rows[-1]]), "not a number"),
    (lambda k: edit(k, "0.2_1", lambda rows: [*rows, rows[-300]]), "time runs backwards"),
    (lambda k: edit(k, "0.2_1", lambda rows: rows[:50]), "rows"),
]  # fmt: skip


def edit(kit: Path, name: str, change: Callable[[list[str]], list[str]]) -> None:
    log = kit / "trials" / f"trial_{name}.csv"
    log.write_text("\n".join(change(log.read_text().splitlines())) + "\n")


@pytest.mark.parametrize(("breach", "said"), BREACHES, ids=[said for _, said in BREACHES])
def test_what_is_wrong_is_told_and_not_sealed(kit: Path, breach: Callable[[Path], Any], said: str) -> None:
    breach(kit)
    done = check(kit, "--seal")
    assert done.returncode == 3
    assert said in done.stdout
    assert not (kit / "sealed.bin").exists()


def test_few_logs_at_one_speed_are_warned_of(kit: Path) -> None:
    for log in (kit / "trials").glob("trial_0.[57]_*.csv"):
        log.unlink()
    done = check(kit)
    assert done.returncode == 0
    assert "2 logs; a small effect needs more" in done.stdout
    assert "all at one speed" in done.stdout


@pytest.mark.parametrize(
    ("effects", "verdict", "ids", "outcome"),
    [
        (REACTION, "named", ("drive_reaction",), "right"),
        ([], "none", (), "right"),
        ([{"id": "unknown", "title": "magnets"}], "unknown", (), "abstained"),
    ],
)
def test_a_finding_in_the_kit_is_judged(
    kit: Path, effects: list[dict[str, Any]], verdict: str, ids: tuple[str, ...], outcome: str
) -> None:
    answered(kit, effects)
    sealed(kit)
    finding(kit, verdict, *ids)
    opened = gl.reveal(kit)
    said = succeeded("reveal", kit).out
    assert "made by planar simulator in C" in said
    assert "judgement: right" in said
    assert "gap closed, trials in the fit: 100.0 %" in said
    assert "[-]" not in said
    assert opened.score.outcome == outcome
    assert opened.warnings == ()
    if outcome == "right" and ids:
        assert opened.score.parameters[0].true == 0.8
        assert opened.score.parameters[0].z == pytest.approx(-0.4)


def test_a_kit_without_finding_is_searched_with_its_files(kit: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}

    def discover(logs: list[Path], **options: Any) -> None:
        asked.update(options, logs=logs)
        finding(kit, "named", "drive_reaction")

    monkeypatch.setattr("granite_lab.api.trials.discover", discover)
    (kit / "trials" / "soil.toml").unlink()
    opened = gl.reveal(sealed(kit), jobs=2)
    assert opened.score.right
    assert len(asked["logs"]) == 6
    assert (asked["robot"], asked["soil"]) == (kit / "trials" / "robot.toml", None)
    assert (asked["out"], asked["jobs"]) == (kit / "finding", 2)


def test_an_answer_that_was_not_promised_is_refused_and_changed_logs_are_told(kit: Path) -> None:
    sealed(kit, keep=True)
    finding(kit, "none")
    old = (kit / "seal.sha256").read_text()
    edit(kit, "0.2_1", lambda rows: rows[:-1])
    (kit / "trials" / "trial_0.5_1.csv").unlink()
    lines = gl.reveal(kit).warnings
    assert any("answer.json: lies open" in line for line in lines)
    assert any("trial_0.2_1.csv: has changed" in line for line in lines)
    assert any("trial_0.5_1.csv: is missing" in line for line in lines)
    sealed(kit)
    (kit / "seal.sha256").write_text(old)
    with pytest.raises(InputError, match="does not match the hash in seal"):
        gl.reveal(kit)
    (kit / "seal.sha256").write_text("")
    with pytest.raises(InputError, match="contains no hash"):
        gl.reveal(kit)
    (kit / "sealed.bin").unlink()
    with pytest.raises(InputError, match=r"sealed\.bin: is missing, only its hash"):
        gl.reveal(kit)
    (kit / "seal.sha256").unlink()
    with pytest.raises(InputError, match=r"sealed\.bin: .*does not exist"):
        gl.reveal(kit)
    (kit / "sealed.bin").write_bytes(b"something else")
    with pytest.raises(InputError, match="not a sealed answer"):
        open_answer(kit)


def answer(*ids: str, library: bool = True) -> dict[str, Any]:
    parameters = {"size": {"value": 2.0, "unit": "N", "kind": "exact"}}
    return {"effects": [{"id": name, "library": library, "parameters": parameters} for name in ids]}


def verdict_of(verdict: str, *effects: tuple[str, ...], **gap: Any) -> dict[str, Any]:
    return {
        "schema": "granite-lab/discovery/2",
        "verdict": verdict,
        "effects": [
            {
                "id": first,
                "parameters": {"size": {"value": 2.5, "std": 0.25, "unit": "N"}},
                "indistinguishable_from": list(twins),
            }
            for first, *twins in effects
        ],
        "gap": gap,
    }


@pytest.mark.parametrize(
    ("hidden", "found", "outcome", "right"),
    [
        (answer(), verdict_of("none"), "right", True),
        (answer(), verdict_of("named", ("a",)), "false_alarm", False),
        (answer(), verdict_of("unknown"), "false_alarm", False),
        (answer("a"), verdict_of("none"), "missed", False),
        (answer("a"), verdict_of("unknown"), "abstained", False),
        (answer("a"), verdict_of("named"), "abstained", False),
        (answer("a"), verdict_of("named", ("a",)), "right", True),
        (answer("a"), verdict_of("named", ("a", "b")), "right", True),
        (answer("a"), verdict_of("named", ("b", "a")), "twin_set", True),
        (answer("a"), verdict_of("named", ("b", "a", "c")), "twin_set", True),
        (answer("a"), verdict_of("named", ("b", "a", "c", "d")), "vague", False),
        (answer("a"), verdict_of("named", ("a", "b", "c", "d")), "vague", False),
        (answer("a"), verdict_of("named", ("b",)), "wrong_name", False),
        (answer("a"), verdict_of("named", ("b", "c")), "wrong_name", False),
        (answer("a"), verdict_of("named", ("a",), ("b",)), "spurious", False),
        (answer("a"), verdict_of("named", ("b",), ("c", "a")), "spurious", False),
        (answer("a", "b"), verdict_of("named", ("b",), ("a",)), "right", True),
        (answer("a", "b"), verdict_of("named", ("c", "b"), ("a",)), "twin_set", True),
        (answer("a", "b"), verdict_of("named", ("b", "a"), ("a", "b")), "right", True),
        (answer("a", "b"), verdict_of("named", ("b", "a")), "partial", False),
        (answer("a", "b"), verdict_of("named", ("a",), ("c",)), "wrong_name", False),
        (answer("a", "b"), verdict_of("named", ("c",), ("d",)), "wrong_name", False),
        (answer("a", "b"), verdict_of("none"), "missed", False),
        (answer("com_offset"), verdict_of("named", ("drive_reaction",)), "near_twin", False),
        (answer("com_offset"), verdict_of("named", ("drive_reaction",), ("a",)), "wrong_name", False),
        (answer("x", library=False), verdict_of("unknown"), "abstained", True),
        (answer("x", library=False), verdict_of("none"), "missed", False),
        (answer("x", library=False), verdict_of("named", ("a",)), "wrong_name", False),
    ],
)
def test_outcomes(hidden: dict[str, Any], found: dict[str, Any], outcome: str, right: bool) -> None:
    judged = score(hidden, found)
    assert (judged.outcome, judged.right) == (outcome, right)


def test_parameters_are_judged_where_the_name_is_right() -> None:
    (parameter,) = score(answer("a", "b"), verdict_of("named", ("a",))).parameters
    assert (parameter.effect, parameter.true, parameter.value) == ("a", 2.0, 2.5)
    assert parameter.z == pytest.approx(2.0)
    assert parameter.relative == pytest.approx(0.25)
    assert score(answer("b"), verdict_of("named", ("a",))).parameters == ()
    without = verdict_of("named", ("a",))
    without["effects"][0]["parameters"]["size"]["std"] = None
    (parameter,) = score(answer("a"), without).parameters
    assert parameter.z is None
    assert parameter.relative == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("gap", "closed"),
    [
        ({"before": 5.0, "after": 1.4}, 0.9),
        ({"before": 5.0, "after": 5.0}, 0.0),
        ({"before": 5.0, "after": 6.0}, -0.25),
        ({"before": 1.0, "after": 1.0}, None),
        ({"before": None, "after": 1.0}, None),
        ({}, None),
    ],
)
def test_the_gap_closed_is_a_share_of_what_is_not_explained(gap: dict[str, Any], closed: float) -> None:
    judged = score(answer("a"), verdict_of("named", ("a",), held_out=gap))
    assert judged.gap_closed["held_out"] == (None if closed is None else pytest.approx(closed))
    assert judged.gap_closed["train"] is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON"),
        ("[]", "expected schema"),
        ('{"schema": "granite-lab/fit/1"}', "expected schema"),
        ('{"schema": "granite-lab/discovery/2", "verdict": "maybe"}', "verdict is 'maybe'"),
        ('{"schema": "granite-lab/discovery/2", "verdict": "named", "effects": ["a"]}', "malformed"),
        (
            '{"schema": "granite-lab/discovery/2", "verdict": "named", "effects": [{"name": "a"}]}',
            "malformed",
        ),
    ],
)
def test_a_file_that_is_no_discovery_is_named(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "finding.json"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as error:
        read_finding(path)
    assert str(path) in error.value.message


def test_a_sealed_answer_opens_to_what_was_sealed_and_cannot_be_read_by_eye(tmp_path: Path) -> None:
    effect = {"id": "tyre_windup", "title": "x", "account": "", "library": True, "parameters": {}}
    whole = _answer(effects=[effect], seed=7) | {"μ": 0.5}
    data = seal(whole)
    assert unseal(data, "x") == whole
    assert b"tyre" not in data
    assert seal(whole) == data
    (tmp_path / "sealed.bin").write_bytes(data)
    assert open_answer(tmp_path) == whole
    assert json.dumps(whole)[:8].encode() not in data


@pytest.mark.parametrize("place", [70, 125, 150, -4])
def test_a_changed_seal_is_noticed(place: int) -> None:
    data = bytearray(seal({"effects": [], "seed": 3, "text": "a longer text, so that there is something"}))
    data[place] = ord("A") if data[place] != ord("A") else ord("B")
    with pytest.raises(InputError, match="damaged"):
        unseal(bytes(data), "x")


def test_a_sealed_answer_that_would_fill_the_memory_is_refused() -> None:
    body = base64.encodebytes(zlib.compress(bytes(10 * LARGEST), 9)[::-1])
    data = HEAD + hashlib.sha256(bytes(10 * LARGEST)).hexdigest().encode() + b"\n" + body
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="is damaged"):
            unseal(data, "sealed.bin")
        assert tracemalloc.get_traced_memory()[1] < 3 * LARGEST
    finally:
        tracemalloc.stop()


def _answer(**changes: Any) -> dict[str, Any]:
    effect = {"id": "x", "title": "", "account": "", "library": True, "parameters": {}}
    trials = {"a": {"file": "trials/a.csv", "sha256": "0"}}
    return {"made_by": "me", "effects": [effect], "trials": trials} | changes


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"trials": None}, "no trials"),
        ({"trials": {}}, "no trials"),
        ({"trials": {"a": {}}}, "no hash of each trial"),
        ({"effects": 1}, "no list of effects"),
        ({"effects": [{"id": "x"}]}, "no list of effects"),
        ({"effects": [_answer()["effects"][0] | {"parameters": {"p": 1}}]}, "no list of effects"),
    ],
)
def test_a_sealed_answer_that_lacks_something_is_told_in_one_line(
    changes: dict[str, Any], said: str, tmp_path: Path
) -> None:
    assert unseal(seal(_answer()), "x") == _answer()
    (tmp_path / "sealed.bin").write_bytes(seal(_answer(**changes)))
    refused(lab("reveal", tmp_path), 3, f"sealed.bin: the sealed answer holds {said}")
