"""Whatever options and numbers a command gets: a result of numbers, or one line and an exit code."""

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from granite_lab import cli
from tests.corpus.cli import CODES, GRANITE, LOG, SAND, Done, lab, strict, succeeded
from tests.soak import SOAK

# Each example is a whole command, so shrinking one takes too long.
PHASES = (Phase.explicit, Phase.reuse, Phase.generate)
COMMANDS = {
    name: [p for p in cli.command_of(name).params if p.name not in ("help", "install_completion")]
    for name in cli.COMMANDS
}
TEXTS = st.one_of(
    st.sampled_from(
        ["", "-1", "0", "nan", "inf", "1e400", "0.5", "3", "granite", "dry_sand", "robot.toml", "trial.csv",
         "a\nb", "[red]x[/red]", "\x1b[2J", "=cmd|' /C calc'!A0", "<script>", "../..", "/dev/null", "~", "*",
         "--", "é", "\u202e", "imu=/imu", "run_id = 4", "0:1", "1:0", "2.03±0.01", "ref", "parquet",
         "tyre_windup", "random", "play=1.5"]
    ),
    st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12),
)  # fmt: skip
NUMBERS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True).map(repr),
    st.floats(1e-3, 10).map(lambda x: f"{x:.3g}"),
    st.integers(-5, 50).map(str),
)
HARMLESS = {"--out", "--log", "--write-map", "--plot"}
"""Options that name what is written: they stay in the test's folder."""


def folder_of(tmp_path: Path) -> Path:
    """Fill a folder with things that options can name."""
    if not (tmp_path / "trial.csv").exists():
        (tmp_path / "trial.csv").write_text(LOG)
        (tmp_path / "robot.toml").write_text(GRANITE)
        (tmp_path / "soil.toml").write_text(SAND)
        (tmp_path / "empty").mkdir()
    return tmp_path


@st.composite
def command_lines(draw: st.DrawFn, names: tuple[str, ...]) -> list[str]:
    """Draw a command with a few of its options, their values likely or not."""
    name = draw(st.sampled_from(names))
    args = [name]
    optional = [p for p in COMMANDS[name] if p.param_type_name == "option"]
    for option in draw(st.lists(st.sampled_from(optional), max_size=4, unique=True)):
        key = draw(st.sampled_from([*option.opts, *option.secondary_opts]))
        if key in ("--scheduler", "--jobs", "-j"):
            continue
        args.append(key)
        if not option.is_flag:
            args.append("x.out" if key in HARMLESS else draw(st.one_of(NUMBERS, TEXTS)))
    if name in ("inspect", "ingest", "fit-k92"):
        args += draw(st.lists(st.sampled_from(["trial.csv", "empty", "none.csv", "robot.toml"]), max_size=2))
    elif name in ("reveal", "plan-next", "view"):
        args.append(draw(st.sampled_from(["empty", "none", "trial.csv"])) if name != "view" else "empty")
    if name in ("ingest", "fit-k92"):
        args += ["--jobs", "1"]
    return args


def hold(done: Done, args: list[str]) -> None:
    """Hold a command to its promises."""
    assert done.code in CODES, (args, done)
    assert "Traceback" not in done.err, (args, done)
    if done.code in (1, 3, 4):
        assert done.error, (args, done)
    if done.code == 0 and "--json" in args:
        assert strict(done.out).get("schema") or "--help" in args


def examples(count: int, *, soak: int) -> settings:
    return settings(
        max_examples=soak if SOAK else count, phases=PHASES,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip


LIGHT = ("inspect", "ingest", "params", "effects", "wheel", "reveal", "plan-next", "view")


@given(args=command_lines(LIGHT))
@examples(80, soak=3000)
def test_any_command_line_ends_well(args: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder_of(tmp_path))
    hold(lab(*args), args)


@given(
    given_=st.dictionaries(
        st.sampled_from(["--variant", "--v", "--a", "--distance", "--k92", "--a-theta", "--seed"]),
        st.one_of(NUMBERS, st.sampled_from(["0.5", "0.3", "1.2", "2"])),
        max_size=5,
    )
)
@examples(40, soak=1000)
def test_any_motion_is_simulated_or_refused(
    given_: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    args = ["simulate", "--json", *(part for item in given_.items() for part in item)]
    done = lab(*args)
    hold(done, args)
    if done.code == 0:
        document = strict(done.out)
        assert -2 < document["slip_ratio"] < 1.01
        assert document["run"]


def numbers(text: str) -> list[tuple[str, str]]:
    """List (line, key) of the numbers of a TOML file."""
    return re.findall(r"^((\w+) *= *\d.*)$", text, re.MULTILINE)


VALUES = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True).map(repr),
    st.floats(1e-6, 1e6).map(repr),
    st.sampled_from(
        ['"1"', "true", "[1]", "{}", "1e400", "-0.0", "0", "2026-01-01", "0x10", "1_000", "", "1,5"]
    ),
)


@given(changes=st.lists(st.tuples(st.booleans(), st.integers(0, 100), VALUES), min_size=1, max_size=3))
@examples(40, soak=1500)
def test_any_parameter_file_is_used_or_refused(changes: list[tuple[bool, int, str]], tmp_path: Path) -> None:
    """Numbers of robot and soil replaced by anything; with what is accepted a run is made or refused."""
    texts = {True: GRANITE, False: SAND}
    for which, number, value in changes:
        lines = numbers(texts[which])
        line, key = lines[number % len(lines)]
        texts[which] = texts[which].replace(line, f"{key} = {value}", 1)
    robot, soil = tmp_path / "robot.toml", tmp_path / "soil.toml"
    robot.write_text(texts[True])
    soil.write_text(texts[False])
    args = ["params", "--robot", str(robot), "--soil", str(soil), "--json"]
    shown = lab(*args)
    hold(shown, args)
    assert shown.code in (0, 2, 3)
    run = lab("simulate", "--v", 0.3, "--a", 1, "--distance", 0.6, "--robot", robot, "--soil", soil,
              "--out", tmp_path / "run.csv", "--json")  # fmt: skip
    hold(run, ["simulate", "--json"])
    assert (run.code in (2, 3)) == (shown.code != 0)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_says_what_every_option_is(name: str) -> None:
    done = succeeded(name, "--help")
    assert "Usage: " in done.out
    for option in COMMANDS[name]:
        if option.param_type_name == "option":
            assert option.help, (name, option.name)
        if "[" in (option.help or ""):  # a unit, which rich would take for markup
            words = option.help.split()
            assert all(word in done.out for word in words if word.startswith("[")), option.name
    unknown = lab(name, "--no-such-option")
    assert unknown.code == 2
    assert "Traceback" not in unknown.err
