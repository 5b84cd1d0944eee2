"""Experiment analysis for a light four-wheeled robot driving straight over dry sand.

Every command is also a function here, as in ``import granite_lab as gl; gl.ingest("trial.csv")``;
see docs/api.md. Each is imported when it is first asked for, so that the package itself costs nothing.
"""

from __future__ import annotations

import sys
import types
from typing import Any

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


class _Package(types.ModuleType):
    """This package, in which `study` stays the function once the module of that name is imported."""

    @property
    def study(self) -> Any:
        """The function `granite_lab.api.trials.study`."""
        return __getattr__("study")

    @study.setter
    def study(self, module: types.ModuleType) -> None:
        """Let the import system bind the module; importing from it works all the same."""


sys.modules[__name__].__class__ = _Package
