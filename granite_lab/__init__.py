"""Experiment analysis for a light four-wheeled robot driving straight over dry sand.

Every command is also a function here, as in ``import granite_lab as gl; gl.ingest("trial.csv")``;
see docs/api.md. Each is imported when it is first asked for, so that the package itself costs nothing.
"""

from __future__ import annotations

import sys
import types
from typing import TYPE_CHECKING, Any

from granite_lab.lazily import lazily

if TYPE_CHECKING:
    from granite_lab.api.check import Checked, check
    from granite_lab.api.hidden import hide, reveal
    from granite_lab.api.kit import kit
    from granite_lab.api.logs import ingest, inspect
    from granite_lab.api.parameters import list_effects, params, show_effect
    from granite_lab.api.plan import plan_next
    from granite_lab.api.search import discover
    from granite_lab.api.simulate import simulate
    from granite_lab.api.trials import compare, fit_a_theta, fit_k92, record, report, study
    from granite_lab.api.view import view
    from granite_lab.api.wheel import wheel
    from granite_lab.errors import EstimateError, InputError, LabError, UsageError
    from granite_lab.estimate import Estimate
    from granite_lab.reporting.two_studies import compare_studies

__version__ = "0.1.0"

__getattr__ = lazily(
    __name__,
    {
        "granite_lab.api.check": ("Checked", "check"),
        "granite_lab.api.hidden": ("hide", "reveal"),
        "granite_lab.api.kit": ("kit",),
        "granite_lab.api.logs": ("ingest", "inspect"),
        "granite_lab.api.parameters": ("list_effects", "params", "show_effect"),
        "granite_lab.api.plan": ("plan_next",),
        "granite_lab.api.search": ("discover",),
        "granite_lab.api.simulate": ("simulate",),
        "granite_lab.api.trials": ("compare", "fit_a_theta", "fit_k92", "record", "report", "study"),
        "granite_lab.api.view": ("view",),
        "granite_lab.api.wheel": ("wheel",),
        "granite_lab.errors": ("EstimateError", "InputError", "LabError", "UsageError"),
        "granite_lab.estimate": ("Estimate",),
        "granite_lab.reporting.two_studies": ("compare_studies",),
    },
)

__all__ = [
    "Checked",
    "Estimate",
    "EstimateError",
    "InputError",
    "LabError",
    "UsageError",
    "check",
    "compare",
    "compare_studies",
    "discover",
    "fit_a_theta",
    "fit_k92",
    "hide",
    "ingest",
    "inspect",
    "kit",
    "list_effects",
    "params",
    "plan_next",
    "record",
    "report",
    "reveal",
    "show_effect",
    "simulate",
    "study",
    "view",
    "wheel",
]


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


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
