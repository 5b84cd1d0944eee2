"""Motions and fits that several tests need: each is made once for all processes of pytest.

Commands analyse the same few samples again and again. What was made of which content is kept in a folder;
where the file of a trial lies, and its name, do not matter. What tests of one module share is kept, too.
"""

import os
import pickle
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar

from granite_lab.estimation import Motion, correct
from granite_lab.fitting import K92Fit, fit_k92
from granite_lab.logs.trial import Trial
from granite_lab.model.effect import Active
from granite_lab.parameters import Robot, Soil
from granite_lab.running.cache import Cache, code, digest_of
from granite_lab.running.codec import content, encode
from granite_lab.stored import root

T = TypeVar("T")
PATIENCE = 600.0
"""Time [s] after which a process makes what another one has begun to make and not finished."""

ANEW, FITTED_ANEW = correct, fit_k92
"""The functions themselves, which work whether that was done before or not."""


def _kept(cache: Cache, work: Callable[[], Any], *given: Any) -> Any:
    """Return what some work makes of the records that it is given, or has made of equal ones."""
    key = digest_of(code(), *map(content, given))
    found = cache.get(key)
    if found is None:
        found = work()
        cache.put(key, encode(((), found)))
    return found


def _nameless(trial: Trial) -> Trial:
    return replace(trial, name="", inputs=())


def corrected(folder: Path) -> Callable[..., tuple[Trial, Motion]]:
    """Return `correct` that remembers in a folder."""
    cache = Cache(folder)

    def once(trial: Trial, robot: Robot, *, soil: Soil | None = None) -> tuple[Trial, Motion]:
        clean, motion = _kept(cache, lambda: ANEW(trial, robot, soil=soil), _nameless(trial), robot, soil)
        return replace(clean, name=trial.name, inputs=trial.inputs), replace(motion, trial=trial.name)

    return once


def fitted(folder: Path) -> Callable[..., K92Fit]:
    """Return `fit_k92` that remembers in a folder, but not fits with effects, whose code may be a test's."""
    cache = Cache(folder)

    def once(
        motion: Motion, trial: Trial, robot: Robot, soil: Soil, *,
        effects: Sequence[Active] = (), trajectory: bool = True,
    ) -> K92Fit:  # fmt: skip
        if effects or not trajectory:
            return FITTED_ANEW(motion, trial, robot, soil, effects=effects, trajectory=trajectory)
        given = replace(motion, trial=""), _nameless(trial), robot, soil
        found = _kept(cache, lambda: FITTED_ANEW(motion, trial, robot, soil), *given)
        return replace(found, trial=trial.name)

    return once


def made_once(make: Callable[[], T]) -> Callable[[], T]:
    """Let a function without arguments work in one process alone; others wait for what it returns.

    `root` is that of the tests when it is called: decorate what a test or a fixture calls.
    """

    @cache
    @wraps(make)
    def made() -> T:
        folder = root() / "made-once"
        folder.mkdir(parents=True, exist_ok=True)
        found = folder / f"{make.__module__}.{make.__qualname__}.pickle"
        begun, end = found.with_suffix(".begun"), time.monotonic() + PATIENCE
        while not found.exists():
            try:
                begun.touch(exist_ok=False)
            except FileExistsError:
                if time.monotonic() < end:
                    time.sleep(0.05)
                    continue
            try:
                value = make()
                whole = found.with_suffix(f".{os.getpid()}")
                whole.write_bytes(pickle.dumps(value))
                whole.replace(found)
            finally:
                begun.unlink(missing_ok=True)
        result: T = pickle.loads(found.read_bytes())
        return result

    return made
