"""Motions that several tests need: each is estimated once for all processes of pytest."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from granite_lab.estimation import Motion, correct
from granite_lab.logs.trial import Trial
from granite_lab.parameters import Robot, Soil
from granite_lab.running.cache import Cache, code, digest_of
from granite_lab.running.codec import content, encode

Correct = Callable[..., tuple[Trial, Motion]]

ANEW: Correct = correct
"""Estimates a trial whether that was done before or not."""


def by_content(folder: Path) -> Correct:
    """Return `correct` that remembers in a folder what it made of which trial, robot and soil.

    Commands estimate the same few samples again and again. Where the file of a trial lies does not matter.
    """
    cache = Cache(folder)

    def once(trial: Trial, robot: Robot, *, soil: Soil | None = None) -> tuple[Trial, Motion]:
        key = digest_of(code(), *map(content, (replace(trial, inputs=()), robot, soil)))
        found = cache.get(key)
        if found is None:
            found = ANEW(trial, robot, soil=soil)
            cache.put(key, encode(((), found)))
        clean, motion = found
        return replace(clean, inputs=trial.inputs), motion

    return once
