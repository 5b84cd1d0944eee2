"""Commands, functions and stages: each command calls one function, by a short way."""

import ast
import inspect
import math
import re
import sys
import traceback
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_type_hints

import pytest

import granite_lab as gl
from granite_lab import estimation
from granite_lab.api.arguments import options
from granite_lab.cli import COMMANDS, command_of
from granite_lab.commands import model
from granite_lab.estimation import chain as stages
from tests.corpus.cli import ROOT, SAMPLES, lab

PACKAGE = ROOT / "granite_lab"
VERBS = {name: getattr(gl, name) for name in gl.__all__ if inspect.isfunction(getattr(gl, name))}

COMMAND_OF = {
    "fit_a_theta": "fit-atheta",
    "list_effects": "effects",
    "show_effect": "effects show",
}
"""Commands that are called in another way than their function."""

NO_COMMAND = {
    "plot": "inspect --plot", "record": "study", "report": "study", "verify": "study --verify",
}  # fmt: skip
"""Functions without a command of their own, and what does it on the command line."""

TERMINAL_ONLY = {
    "as_json", "quiet", "verbose", "table_format", "plot", "write_map",
}  # fmt: skip
"""Options of the terminal: what is printed, and pictures and tables of what a function returns."""

PRINTED = {"fit_k92", "fit_a_theta", "simulate", "wheel", "ingest", "plan_next", "compare_studies"}
"""Functions that only return; their commands write the table into `--out`."""

TOLD = {"done", "progress"}
"""Arguments by which a function says how far it is; a command shows it."""

OWN = {
    "study": {"report"},  # --verify
    "params": {"folder"},  # whose granite-lab.toml says robot and soil
    "robot": {"analysis"},  # what a terminal asks for
    "list_effects": {"context"},
}
"""Other options that one command alone has."""

READ: dict[str, Callable[[Any], Any]] = {
    "latency": lambda ms: ms / 1e3,
    "slip": float,
    "against_reference": lambda text: text == "ref",
}
"""Options in another unit or form than the argument, and how they are read."""


def commands() -> dict[str, Callable[..., Any]]:
    """Return the function behind each command."""
    found: dict[str, Callable[..., Any]] = {}
    modules = {name: f"granite_lab.commands.{module}" for name, (module, _) in COMMANDS.items()}
    for name, module in modules.items():
        __import__(module)
        function = getattr(sys.modules[module], name.replace("-", "_"))
        if name == "effects":
            found |= {"effects": model.list_effects, "effects show": model.show_effect}
        else:
            found[name] = function
    return found


def parameters(function: Callable[..., Any]) -> dict[str, Any]:
    """Return names and defaults; nothing given, be it None or no items, is one default."""
    empty = inspect.Parameter.empty
    names = inspect.signature(function).parameters.items()
    return {n: None if p.default in (empty, (), None) else p.default for n, p in names}


@pytest.mark.parametrize("name", [name for name in VERBS if name not in NO_COMMAND])
def test_a_command_takes_what_its_function_takes_with_the_same_defaults(name: str) -> None:
    command = commands()[COMMAND_OF.get(name, name.replace("_", "-"))]
    options, arguments = parameters(command), parameters(VERBS[name])
    assert ("begin" in options) == ("end" in options) == ("window" in arguments)
    window = {"begin", "end"} & options.keys()
    out = {"out"} if name in PRINTED else set()
    extra = TERMINAL_ONLY | OWN.get(name, set()) | window | out
    taken = {n: d for n, d in options.items() if n not in extra}
    offered = {n: d for n, d in arguments.items() if n not in TOLD | {"window"}}
    assert taken.keys() == offered.keys()
    for option, given in taken.items():
        default = READ[option](given) if option in READ and offered[option] is not None else given
        assert default == offered[option], option


def test_every_command_has_a_function_and_no_function_shares_a_module_s_name() -> None:
    named = {COMMAND_OF.get(name, name.replace("_", "-")) for name in VERBS if name not in NO_COMMAND}
    assert named == commands().keys()
    assert not {path.stem for path in PACKAGE.iterdir()} & set(gl.__all__)
    assert type(gl) is types.ModuleType


def test_a_function_is_what_its_file_says() -> None:
    """No decorator, no signature made at run time, every argument with a plain type."""
    for name, function in VERBS.items():
        tree = ast.parse(Path(inspect.getsourcefile(function) or "").read_text(encoding="utf-8"))
        (written,) = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == function.__name__]
        assert written.decorator_list == [], name
        arguments = [*written.args.args, *written.args.kwonlyargs]
        assert [a.arg for a in arguments] == list(inspect.signature(function).parameters), name
        assert written.args.kwarg is None, name
        assert all(a.annotation is not None for a in arguments), name


def test_what_is_said_of_logs_is_said_once_and_alike_by_all_functions() -> None:
    once = inspect.signature(options).parameters
    saying = {name: f for name, f in VERBS.items() if "options_of" in f.__code__.co_names}
    assert saying.keys() == {
        "check", "compare", "discover", "fit_a_theta", "fit_k92", "ingest", "study", "view"
    }  # fmt: skip
    for name, function in saying.items():
        own = inspect.signature(function).parameters
        for argument in own.keys() & once.keys():
            said, meant = own[argument], once[argument]
            assert (said.annotation, said.default) == (meant.annotation, meant.default), (name, argument)


LIMITED = re.compile(r"\(([\d.]+) (?:to ([\d.]+)|or more)\)\.$")


def limits() -> list[tuple[str, str, float, float]]:
    """List command, option, and the limits that its help states."""
    found = []
    for name in COMMANDS:
        for option in command_of(name).params:
            if match := LIMITED.search(getattr(option, "help", None) or ""):
                found.append((name, option.opts[0], float(match[1]), float(match[2] or math.inf)))
    return found


NEEDED = {
    "plan-next": ["."], "hide": ["--effect", "none", "--out", "x"],
    "ingest": [str(SAMPLES / "virtual_v0.3_r1.csv")],
    "simulate": ["--variant", "0.3"], "wheel": [],
}  # fmt: skip


@pytest.mark.parametrize(("command", "option", "low", "high"), limits())
def test_a_number_outside_of_the_limits_that_help_states_is_refused(
    command: str, option: str, low: float, high: float, tmp_path: Path
) -> None:
    for value in (low - 0.5, high * 2, math.nan):
        if math.isfinite(value) or math.isnan(value):
            number = int(value) if option == "--repetitions" and math.isfinite(value) else value
            done = lab(command, *NEEDED[command], option, number, cwd=tmp_path)
            assert done.code == 2, done
            if option != "--repetitions" or math.isfinite(value):
                assert f"{option} {number:g} is out of range" in done.error


def test_numbers_have_stated_limits() -> None:
    assert len(limits()) == 11


WALKS = {
    heading: re.findall(r"^\d\. `([\w/]+\.py):(\w+)`", body, re.MULTILINE)
    for heading, body in re.findall(
        r"^## `granite-lab (\w+)`.*?\n(.*?)(?=^## |\Z)",
        (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8"),
        re.MULTILINE | re.DOTALL,
    )
}
"""The page's walks from a command to the filter: file and function of each step."""


def test_the_page_walks_two_commands_in_six_calls_and_six_files() -> None:
    assert WALKS.keys() == {"study", "ingest"}
    for command, steps in WALKS.items():
        assert steps[0][0].startswith("commands/")
        assert steps[0][1] == command
        assert steps[-1] == ("estimation/chain.py", "solve")
        assert len(steps) - 1 <= 6
        assert len({file for file, _ in steps}) <= 6


@pytest.mark.parametrize("command", WALKS)
def test_each_step_of_a_walk_names_the_next(command: str) -> None:
    """A function that is handed to `each_trial` stands in the step before."""
    steps = WALKS[command]
    for k, (file, function) in enumerate(steps[:-1]):
        following = {steps[k + 1][1]}
        names = names_in(file, function)
        if function == "each_trial":
            names |= names_in(*steps[k - 1])
        assert following <= names, (file, function, following)


def names_in(file: str, function: str) -> set[str]:
    """Return the names that a function uses."""
    tree = ast.parse((PACKAGE / file).read_text(encoding="utf-8"))
    (written,) = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == function]
    nodes = list(ast.walk(written))
    names = {n.id for n in nodes if isinstance(n, ast.Name)}
    return names | {n.attr for n in nodes if isinstance(n, ast.Attribute)}


@pytest.mark.usefixtures("estimates_anew")
@pytest.mark.parametrize("command", WALKS)
def test_a_command_goes_the_way_that_the_page_walks(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stack where `solve` begins; helpers of the module that shares out the trials are passed over."""
    seen: list[tuple[str, str]] = []

    def solve(*_: object, **__: object) -> None:
        for frame in traceback.extract_stack():
            path = Path(frame.filename)
            if path.is_relative_to(PACKAGE) and path.name != "cli.py":
                seen.append((path.relative_to(PACKAGE).as_posix(), frame.name))
        raise gl.EstimateError("enough")

    monkeypatch.setattr(stages, "solve", solve)
    out = ("--no-cache",) if command == "study" else ()
    lab(command, SAMPLES / "virtual_v0.3_r1.csv", "--out", tmp_path / "out", "--jobs", 1, *out)
    way = [(file, name) for file, name in seen if not (file.startswith("running/") and name != "each_trial")]
    assert [*way, ("estimation/chain.py", "solve")] == WALKS[command]
    assert estimation.correct is stages.correct
    assert get_type_hints(stages.correct)
