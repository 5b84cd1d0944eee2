"""The effects of this package, found by listing its folder, and those of a user's own file."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import sys
import traceback
import types
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from granite_lab.errors import InputError, UsageError, at, known_names, nearest
from granite_lab.files import readable, refuse_special
from granite_lab.model.dictionary import dictionary
from granite_lab.model.effect import Effect, EffectParameter
from granite_lab.model.graph import STATES, Graph, build_graph
from granite_lab.model.symbols import model_parameters, vector_of
from granite_lab.parameters import load_robot, load_soil, load_variants


@lru_cache
def _library() -> dict[str, Effect]:
    effects: dict[str, Effect] = {}
    for info in sorted(pkgutil.iter_modules([str(Path(__file__).parent)]), key=lambda m: m.name):
        module = importlib.import_module(f"{__package__}.{info.name}")
        effects |= {effect.id: effect for effect in _effects_of(module)}
    return effects


def library(file: Path | str | None = None) -> dict[str, Effect]:
    """Return every effect of the package by its id, in alphabetical order.

    Args:
        file: a user's effect file, whose effects are added as `load_effects` returns them.

    Raises:
        InputError: of `load_effects`.
    """
    return _library() | (load_effects(file) if file else {})


_met: dict[str, Effect] = {}


def met(effect_id: str) -> Effect | None:
    """Return an effect of the package or of a user's file that this process has read, for the words in it."""
    return _library().get(effect_id) or _met.get(effect_id) or dictionary().get(effect_id)


def get(effect_id: str, effects: Mapping[str, Effect] | None = None) -> Effect:
    """Return one effect.

    Args:
        effect_id: its id.
        effects: where to look; the package's effects by default.

    Raises:
        UsageError: no such effect; the hint names the nearest.
    """
    table = library() if effects is None else effects
    if effect_id in table:
        return table[effect_id]
    raise UsageError(f"unknown effect '{effect_id}'", known_names(effect_id, table, 0.4))


def load_effects(path: Path | str) -> dict[str, Effect]:
    """Run a user's Python file and return the effects it defines, by id.

    The file's code is executed with the rights of the user: load only files you trust. Each
    subclass of `granite_lab.model.effect.Effect` in the file becomes a candidate beside those of
    the package; it is checked against the paper's model at its neutral values.

    Raises:
        InputError: the file cannot be read or run, or an effect in it is not complete; the message
            carries file and line.
    """
    effects = read_effects(path)
    for effect in effects.values():
        _check_neutral(effect, str(Path(path)))
    _met.update(effects)
    return effects


def read_effects(path: Path | str) -> dict[str, Effect]:
    """Run a user's Python file as `load_effects` does, but leave the paper's model aside.

    Raises:
        InputError: the file cannot be read or run, or an effect in it is not complete.
    """
    file = Path(path)
    refuse_special(file)
    try:
        code = file.read_bytes()
    except OSError as error:
        raise readable(error, file) from None
    return dict(_load(str(file), code))


@lru_cache(maxsize=16)
def _load(path: str, code: bytes) -> dict[str, Effect]:
    """Run the code; cached on its content, so that an effect stays one object while it is unchanged."""
    name = "granite_lab_user_" + re.sub(r"\W", "_", Path(path).stem)
    module = types.ModuleType(name)
    module.__file__ = path
    sys.modules[name] = module  # dataclasses and annotations look their module up there
    try:
        exec(compile(code, path, "exec"), module.__dict__)
    except SyntaxError as error:
        raise InputError(
            f"{at(path, error.lineno)}: not valid Python: {error.msg}", "an effect file is a Python module"
        ) from None
    except (Exception, SystemExit) as error:  # a file that ends the process would end it in silence
        raise _trouble(path, error) from error
    effects = _effects_of(module, path)
    if not effects:
        raise InputError(
            f"{path}: defines no effect",
            "write a subclass of granite_lab.model.effect.Effect; docs/how-to-effect.md shows one",
        )
    for effect in effects:
        if effect.id in _library():
            raise InputError(
                f"{path}: the id '{effect.id}' belongs to an effect of the library", "choose another id"
            )
    return {effect.id: effect for effect in effects}


def _effects_of(module: types.ModuleType, path: str | None = None) -> list[Effect]:
    """Return one instance of each effect that a module defines itself."""
    classes = [
        item
        for _, item in inspect.getmembers(module, inspect.isclass)
        if issubclass(item, Effect) and item.__module__ == module.__name__ and "id" in item.__dict__
    ]
    effects = []
    for cls in classes:
        check_declaration(cls, path or str(module.__file__))
        effects.append(cls())
    return effects


def check_declaration(cls: type[Effect], path: str) -> None:
    """Check that an effect says all that it must say.

    Raises:
        InputError: a text or parameter is missing or does not fit.
    """
    where = f"{path}: effect '{cls.id}'"
    if not re.fullmatch(r"[a-z][a-z0-9_]*", cls.id):
        raise InputError(f"{where}: the id is not usable", "expected small letters, digits and underscores")
    for name in ("title", "equation", "source", "signature"):
        if not str(getattr(cls, name, "")).strip():
            raise InputError(f"{where}: '{name}' is missing", f'add {name} = "…" to the class')
    parameters = getattr(cls, "parameters", ())
    if not parameters or not all(isinstance(p, EffectParameter) for p in parameters):
        raise InputError(f"{where}: 'parameters' is missing", "add parameters = (EffectParameter(…), …)")
    if all(p.shape for p in parameters):
        raise InputError(
            f"{where}: every parameter is a shape",
            "at least one parameter must switch the effect off at its neutral value",
        )
    order = "the numbers of EffectParameter are: low, high, neutral, expected from, expected to"
    for p in parameters:
        if not p.low <= p.neutral <= p.high:
            raise InputError(
                f"{where}: {p.name}: neutral {p.neutral:g} is out of its bounds {p.low:g} to {p.high:g}",
                order,
            )
        if not p.low <= p.prior_low < p.prior_high <= p.high:
            raise InputError(
                f"{where}: {p.name}: prior range {p.prior_low:g} to {p.prior_high:g} is not inside "
                f"its bounds {p.low:g} to {p.high:g}",
                order,
            )
    free = [p.name for p in parameters if p.per_trial]
    for pair in cls.circles if isinstance(cls.circles, tuple) else (cls.circles,):
        if not isinstance(pair, tuple) or len(pair) != 2 or any(name not in free for name in pair):
            raise InputError(
                f"{where}: circles: {pair!r} is not a pair of parameters per trial",
                'expected circles = (("cosine", "sine"), …)',
            )
    public = {name for name, item in vars(cls).items() if inspect.isfunction(item) and name[0] != "_"}
    for name in sorted(public - set(vars(Effect))):
        hint = f"{nearest(name, vars(Effect))} begin the name of a helper with an underscore"
        raise InputError(f"{where}: '{name}' is not a hook", hint)


def neutral_gap(effect: Effect) -> float:
    """Return by how much an effect at neutral changes the model, relative; zero for a sound one.

    The rates of the paper's states and the sensors' signals are compared at random states.
    """
    p = model_parameters(load_robot(), load_soil(), load_variants()[2], a_theta=4.919)
    plain, graph = build_graph(()), build_graph((effect,))
    rng = np.random.default_rng(0)
    scale = np.array([0.5, 0.005, 0.02, 0.3, 0.01, 0.05, 3.0, 5.0, 3.0, 3.0, 5.0, 3.0])
    x = rng.normal(size=(20, len(STATES))) * scale
    x[:, 1] += 0.85 * p.wheels.radius + p.chassis.com_z
    extra = rng.normal(size=(20, len(graph.states) - len(STATES)))
    neutral = [q.neutral for q in effect.parameters]
    worst = 0.0
    before, after = _function(plain), _function(graph)
    for i, t in enumerate(np.linspace(-0.5, 7, 20)):
        a = before(t, x[i], vector_of(p)).full()
        b = after(t, np.concatenate([x[i], extra[i]]), vector_of(p) + neutral).full()
        gap = np.abs(b - a) / np.fmax(1, np.abs(a))
        worst = max(worst, float(np.nan_to_num(gap, nan=np.inf).max()))
    return worst


def _function(graph: Graph) -> Any:
    outputs = ca.vertcat(graph.rates[: len(STATES)], *graph.outputs.values())
    return ca.Function("f", [graph.t, graph.x, graph.p], [outputs])


@lru_cache(maxsize=64)
def _check_neutral(effect: Effect, path: str) -> None:
    """Build the model with a user's effect, at its neutral values.

    Raises:
        InputError: a hook fails, or the neutral values do not give the paper's model.
    """
    try:
        gap = neutral_gap(effect)
    except (Exception, SystemExit) as error:
        raise _trouble(path, error, f"effect '{effect.id}': ") from error
    if gap > 1e-9:
        raise InputError(
            f"{path}: effect '{effect.id}': its neutral values do not give the paper's model "
            f"(relative difference {gap:.1e})",
            "with neutral parameters each hook must return its input unchanged",
        )


def _trouble(path: str, error: BaseException, subject: str = "") -> InputError:
    """Name the line of the user's file at which an exception arose."""
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == path]
    return InputError(
        f"{at(path, lines[-1] if lines else None)}: {subject}{type(error).__name__}: {error}",
        "the error is in your file; docs/effects.md lists what each hook receives and returns",
    )
