"""The code keeps its shape: stages know only earlier ones, modules stay readable."""

import ast
import re
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "granite_lab"
MODULES = sorted(PACKAGE.rglob("*.py"))

STAGES = [
    {"errors", "estimate", "__init__", "__version__"},
    {"files", "folders", "processes", "rounding", "shown"},
    {"columns", "stored"},
    {"parameters"},
    {"logs"},
    {"origin"},
    {"hidden"},
    {"estimation"},
    {"model"},
    {"effects"},
    {"inference"},
    {"fitting"},
    {"comparison"},
    {"discovery"},
    {"planning"},
    {"results"},
    {"reporting"},
    {"two_studies"},
    {"options"},
    {"running"},
    {"chain"},
    {"study_folder"},
    {"api"},
    {"commands"},
    {"cli"},
    {"__main__"},
]
RANK = {name: rank for rank, names in enumerate(STAGES) for name in names}


def stage_of(module: str) -> str:
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


NAMES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in MODULES
}
"""Module to file."""

WITHIN = NAMES.keys() - {"granite_lab"}


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    return list(ast.walk(tree_of(path)))


@cache
def imports_of(path: Path) -> set[str]:
    """Return the modules a file imports, wherever in the file it does so, or names in a text."""
    found = set()
    for node in nodes_of(path):
        if isinstance(node, ast.ImportFrom):
            module = node.module or ""
            within = {f"{module}.{alias.name}" for alias in node.names}
            found |= {name if name in NAMES or module == "granite_lab" else module for name in within}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Constant) and node.value in WITHIN:
            found.add(node.value)
    return found


def own(path: Path) -> str:
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def test_a_stage_imports_nothing_of_a_later_one() -> None:
    assert {own(path) for path in MODULES} == set(RANK) - {"__version__"}
    for path in MODULES:
        if own(path) == "__init__":  # the door to all of them, through which no stage may go
            continue
        for module in imports_of(path):
            if module.startswith("granite_lab"):
                other = stage_of(module)
                assert RANK[other] <= RANK[own(path)], f"{path} imports {module}"


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = {name: imports_of(path) & NAMES.keys() - {name} for name, path in NAMES.items()}
    assert sum(map(len, graph.values())) > len(graph)
    order = list(TopologicalSorter(graph).static_order())  # raises CycleError and names the circle
    assert order.index("granite_lab.errors") < order.index("granite_lab.cli")


def test_what_hides_and_what_finds_know_nothing_of_each_other() -> None:
    """The judge's data come from other code than what is judged, and its answers stay out of reach."""
    for path in MODULES:
        known = {stage_of(module) for module in imports_of(path) if module.startswith("granite_lab")}
        if own(path) == "hidden":
            first = {"__version__", "errors", "files", "estimate", "processes"}
            assert known <= first | {"parameters", "logs", "hidden"}, path
        elif own(path) not in ("api", "commands", "cli", "__init__"):
            assert "hidden" not in known, path
            assert "import hidden" not in path.read_text(encoding="utf-8"), path


def test_a_module_stays_short() -> None:
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    assert [path for path, count in lines.items() if count > 500] == []


VERBS = {"api", "commands"}
"""Packages whose functions have the options of a verb."""

MEASURES = {("reporting/canvas.py", "panels")}
"""What lays out a figure takes each of its measures."""


def test_functions_stay_short_and_take_few_arguments() -> None:
    functions = {
        (path.relative_to(PACKAGE).as_posix(), node.name): node
        for path in MODULES
        if own(path) not in VERBS
        for node in nodes_of(path)
        if isinstance(node, ast.FunctionDef)
    }
    assert len(functions) > 1000
    assert [name for name, f in functions.items() if (f.end_lineno or 0) - f.lineno >= 60] == []
    taken = {name: f.args.posonlyargs + f.args.args + f.args.kwonlyargs for name, f in functions.items()}
    assert {name for name, arguments in taken.items() if len(arguments) > 7} <= MEASURES


@pytest.mark.parametrize("package", ["estimation", "logs"])
def test_no_local_hides_what_its_module_defines(package: str) -> None:
    """As a covariance P hides the state P."""
    for path in (PACKAGE / package).rglob("*.py"):
        tree = tree_of(path)
        assigned = [target for node in tree.body if isinstance(node, ast.Assign) for target in node.targets]
        defined = {n.id for target in assigned for n in ast.walk(target) if isinstance(n, ast.Name)}
        defined |= {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        imported = [a for node in tree.body if isinstance(node, ast.ImportFrom) for a in node.names]
        defined |= {alias.asname or alias.name for alias in imported}
        for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
            nodes = list(ast.walk(function))
            local = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
            local |= {n.arg for n in nodes if isinstance(n, ast.arg)}
            assert not local & defined, (path, function.name)


@pytest.mark.parametrize(
    ("library", "home"),
    [
        ("rerun", "reporting/recording"),
        ("tomllib", "parameters/quantity.py"),
        ("filterpy", "estimation"),
        ("llvmlite", "model/native"),
        ("distributed", "running/each.py"),
    ],
)
def test_a_library_has_one_home(library: str, home: str) -> None:
    users = [
        path.relative_to(PACKAGE).as_posix()
        for path in MODULES
        if any(module.split(".")[0] == library for module in imports_of(path))
    ]
    assert users
    assert [path for path in users if not path.startswith(home)] == []


def test_what_could_run_code_when_it_is_read_comes_from_a_private_folder_alone() -> None:
    assert len(MODULES) > 100
    for path in MODULES:
        stored = imports_of(path) & {"pickle", "shelve", "marshal", "dill", "cloudpickle"}
        assert stored <= ({"pickle"} if path == PACKAGE / "running" / "codec.py" else set()), path
    cache = (PACKAGE / "running" / "cache.py").read_text(encoding="utf-8")
    assert "self._store.read(" in cache
    assert not {"open(", "read_bytes("} & set(re.findall(r"\w+\(", cache))


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        ("granite_lab.cli", ("numpy", "scipy", "pandas", "casadi", "rerun")),
        ("granite_lab.api.trials", ("filterpy", "scipy.stats", "scipy.signal", "matplotlib", "rerun")),
    ],
    ids=["help", "search"],
)
def test_what_a_command_does_not_need_is_not_imported(code: str, heavy: tuple[str, ...]) -> None:
    shown = f"import sys; import {code}; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", shown], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


EARLY = (
    "simulate --variant 9", "wheel --k92 2", "params --robot nope", "params nope", "effects show nope",
    "hide --effect nope --out nope", "reveal nope", "check nope", "ingest nope", "plan-next nope",
    "fit-k92 nope", "fit-atheta nope", "fit-k92 . --soil nope", "compare . --model nope",
    "discover . --map nope", "study --verify nope", "view nope", "compare-studies nope nope",
)  # fmt: skip


def test_a_command_that_fails_early_imports_little(tmp_path: Path) -> None:
    """Wrong names and missing files are told within half a second: before anything heavy is imported."""
    (tmp_path / "log.csv").write_text("t\n0\n", encoding="utf-8")
    heavy = ("scipy.optimize", "scipy.signal", "scipy.stats", "pandas", "matplotlib", "rerun", "loky")
    shown = (
        "import sys; from granite_lab.cli import app; from granite_lab.errors import LabError\n"
        "for line in sys.argv[1:]:\n"
        "    try:\n        app(line.split())\n"
        "    except LabError as error:\n"
        f"        print(line, error.exit_code > 1, [m for m in {heavy} if m in sys.modules])"
    )
    argv = [sys.executable, "-c", shown, *EARLY]
    done = subprocess.run(argv, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout.splitlines() == [f"{line} True []" for line in EARLY], done.stderr
