"""From measured and simulated slip to k_92 of each trial and a_θ over trials."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from granite_lab.fitting.atheta import fit_a_theta, published_fit
    from granite_lab.fitting.fit import AThetaFit, FitStatus, K92Fit, K92Law, Law
    from granite_lab.fitting.k92 import fit_k92, slip_interval
    from granite_lab.fitting.slip import fit_k92_to_slip, simulate_k92, simulated_slip

__all__ = [
    "AThetaFit",
    "FitStatus",
    "K92Fit",
    "K92Law",
    "Law",
    "fit_a_theta",
    "fit_k92",
    "fit_k92_to_slip",
    "published_fit",
    "simulate_k92",
    "simulated_slip",
    "slip_interval",
]

_HOMES = {
    "atheta": ("fit_a_theta", "published_fit"),
    "fit": ("AThetaFit", "FitStatus", "K92Fit", "K92Law", "Law"),
    "k92": ("fit_k92", "slip_interval"),
    "slip": ("fit_k92_to_slip", "simulate_k92", "simulated_slip"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is: who only needs the records does not wait for the fits."""
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME_OF[name]}"), name)
